from typing import TYPE_CHECKING

from ..core.faces import load_on_use

if TYPE_CHECKING:
    from . import (
        ambiguity as ambiguity,
        outlines as outlines,
        pose_density as pose_density,
        propagation as propagation,
        random_poses as random_poses,
        ranges as ranges,
        resolution as resolution,
        sensitivity as sensitivity,
        singularity as singularity,
        state_box as state_box,
        tables as tables,
        trials as trials,
    )
else:
    __getattr__ = load_on_use(
        __name__,
        {
            "ambiguity": "find_ambiguous_pair find_pair_in_box find_singular_state",
            "outlines": "Boundary map_inside",
            "pose_density": "density_at_rest",
            "propagation": "MonteCarlo coverage_interval propagate_distributions tolerance",
            "ranges": "COARSE LIGHT PSD clearances scaled_jacobian",
            "resolution": "Estimator estimators resolve sources",
            "singularity": (
                "direction_in_words measures samples search_weakest survey weakest_direction"
            ),
            "sobol": "Sobol",
            "state_box": "StateBox apex_offset box_of_poses least_share parse_box range_box",
            "tables": "outline_columns resolution_columns",
            "trials": "default_states estimator_of",
        },
    )
