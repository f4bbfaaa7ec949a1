from typing import TYPE_CHECKING

from ..core.faces import load_on_use

if TYPE_CHECKING:
    from . import (
        alternatives as alternatives,
        fitting as fitting,
        halves as halves,
        motions as motions,
        reference_join as reference_join,
        rezero as rezero,
        table as table,
        uncertainty as uncertainty,
        verdict as verdict,
    )
else:
    __getattr__ = load_on_use(
        __name__,
        {
            "alternatives": "faults scatter",
            "fitting": "fit unknowns",
            "fitting.bundle_adjustment": (
                "Data Moves OWN_COUNT OWN_UNITS eliminate_own_unknowns "
                "linearise_model own_sigma predict_readings states_of"
            ),
            "fitting.fit": "GAINS LOWER_BOUNDS_MM Descent Task prior_information",
            "alternatives.scatter": "fit_steady_laser",
            "alternatives.remainder": "Remainder",
            "findings": "later_power",
            "halves": "compare_halves half_findings",
            "motions": (
                "choose_poses information mean_reduction nearest_order pose_information travel "
                "weak_directions"
            ),
            "reference_join": "join_tables",
            "rezero": (
                "CHANGES ChangePriors LEAST_CHANCE StopReadings average_stop renew_zero "
                "stop_readings"
            ),
            "fitting.samples": "add_converter_steps",
            "table": (
                "REFERENCE choice choose_groups gather_samples read recording_time time_derivatives"
            ),
            "fitting.unknowns": "ALL Choice PLACE assign_values block fold_mount values_of",
        },
    )
