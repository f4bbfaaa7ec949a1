from typing import TYPE_CHECKING

from ..core.faces import load_on_use

if TYPE_CHECKING:
    from . import axis_runs as axis_runs, motion as motion, run as run
else:
    __getattr__ = load_on_use(
        __name__,
        {
            "axis_runs": "command_columns run_states way_point_states way_points",
            "motion": "shaker_force states",
            "reference": "reference_columns reference_poses",
            "run": "axes pose_table reading_table reference_table statuses",
            "vibration": "receptance shake",
        },
    )
