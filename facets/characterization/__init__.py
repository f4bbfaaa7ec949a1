from typing import TYPE_CHECKING

from ..core.faces import load_on_use

if TYPE_CHECKING:
    from . import ambiguity as ambiguity
    from . import outlines as outlines
    from . import pose_density as pose_density
    from . import propagation as propagation
    from . import random_poses as random_poses
    from . import ranges as ranges
    from . import resolution as resolution
    from . import sensitivity as sensitivity
    from . import singularity as singularity
    from . import state_box as state_box
    from . import tables as tables
    from . import trials as trials
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
