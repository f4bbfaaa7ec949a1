from typing import TYPE_CHECKING

from ..core.faces import load_on_use

if TYPE_CHECKING:
    from . import solution as solution
    from . import table as table
    from . import uncertainty as uncertainty
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
            "differences": "lasting_covariance propagate_in_light",
            "doubts": "has_fold",
            "dwells": "dwell_means stands stands_of_axis",
            "measurement": "Measurement",
            "plan": "FALSE_ALARM_RATE LIMITS make_plan",
            "problem": "Form MIN_REDUNDANCY Results SCALES some_rows",
            "result": "worded_columns",
            "samples": "Poses Samples common_detectors detectors_of",
            "solver": "solve_each",
            "step": "ask estimate final_status",
            "table": "solve_table",
            "tally": "Misfit Tally shift_per_kelvin",
            "uncertainty": "coverage_factor effective_degrees_of_freedom region_factor",
            "zero": "PoseColumns ZeroRequest zero_findings zero_of_table",
        },
    )
