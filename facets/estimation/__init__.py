from typing import TYPE_CHECKING

from ..core.faces import load_on_use

if TYPE_CHECKING:
    from . import coverage as coverage
    from . import solution as solution
    from . import table as table
    from . import zero as zero
    from .measurement import Measurement as Measurement
    from .samples import Poses as Poses
    from .samples import Samples as Samples
    from .table import solve_table as solve_table
    from .tally import Tally as Tally
    from .zero import PoseColumns as PoseColumns
    from .zero import ZeroRequest as ZeroRequest
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
            "problem": "Results some_rows",
            "step": "ask estimate",
            "columns": "in_words",
            "measurement": "Measurement",
            "samples": "Poses Samples",
            "table": "solve_table",
            "tally": "Tally shift_per_kelvin",
            "varied": "solve_each",
            "zero": "PoseColumns ZeroRequest zero_findings zero_of_table",
        },
    )
