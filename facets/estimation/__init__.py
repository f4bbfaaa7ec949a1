from typing import TYPE_CHECKING

from ..core.faces import load_on_use

if TYPE_CHECKING:
    from . import coverage as coverage
    from . import solution as solution
    from . import table as table
    from . import zero as zero
else:
    __getattr__ = load_on_use(
        __name__,
        {
            "block_code": "linearise",
            "blocks": "scales_of",
            "block_task": "Form SCALES",
            "chance": "FALSE_ALARM_RATE LIMITS",
            "coverage": "coverage_factor effective_degrees_of_freedom region_factor",
            "differences": "lasting_covariance propagate_in_light",
            "doubts": "has_fold",
            "dwells": "dwell_means stands stands_of_axis",
            "misfit": "Misfit",
            "plan": "make_plan",
            "series": "solve_series",
            "step": "ask estimate",
            "table": (
                "StatusCounts add_temperature_uncertainty labels object_columns "
                "pose_columns shift_per_kelvin solve_readings solve_table"
            ),
            "varied": "knowledge_of solve_each",
            "zero": "ZeroRequest zero_findings zero_of_table",
        },
    )
