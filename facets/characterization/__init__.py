from typing import TYPE_CHECKING

from ..core.faces import load_on_use

if TYPE_CHECKING:
    from . import ambiguity as ambiguity
    from . import axis_report as axis_report
    from . import axis_visits as axis_visits
    from . import error_motions as error_motions
    from . import frequency_response as frequency_response
    from . import noise_report as noise_report
    from . import outlines as outlines
    from . import pose_density as pose_density
    from . import propagation as propagation
    from . import random_poses as random_poses
    from . import ranges as ranges
    from . import resolution as resolution
    from . import response_findings as response_findings
    from . import response_forms as response_forms
    from . import response_signals as response_signals
    from . import rest as rest
    from . import sensitivity as sensitivity
    from . import singularity as singularity
    from . import state_box as state_box
    from . import tables as tables
    from . import trials as trials
    from . import universal_file as universal_file
else:
    __getattr__ = load_on_use(
        __name__,
        {
            "ambiguity": "find_ambiguous_pair find_pair_in_box find_singular_state",
            "axis_report": "evaluate_axis",
            "axis_visits": (
                "PoseSeries approach_directions find_visits match_stands "
                "measured_directions read_commands read_series recorded_series"
            ),
            "error_motions": "AxisTest Commands Visits measure_error_motions",
            "frequency_response": (
                "OutputChannel estimate_response find_stretches low_pass noise_spectrum "
                "response_table"
            ),
            "noise_model": "fit_noise",
            "noise_report": "longest_section",
            "outlines": "Boundary map_inside",
            "pose_density": "density_at_rest",
            "positioning": "evaluate_positioning",
            "propagation": "MonteCarlo coverage_intervals propagate_distributions tolerance",
            "ranges": "COARSE LIGHT PSD clearances scaled_jacobian",
            "resolution": "Estimator estimators resolve sources",
            "response_findings": "find_limits find_peaks",
            "response_forms": "FORMS ResponseForm",
            "response_signals": "build_signals",
            "rest": "find_faults reading_faults",
            "singularity": "direction_in_words measures samples search survey weakest_direction",
            "state_box": "StateBox apex_offset box_of_poses least_share parse_box range_box",
            "tables": "outline_columns resolution_columns",
            "trials": "default_states",
            "universal_file": "InputChannel Node input_type read_input_dof write_universal_file",
        },
    )
