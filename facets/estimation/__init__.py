from typing import TYPE_CHECKING

from ..core.faces import load_on_use

if TYPE_CHECKING:
    from . import solution as solution, table as table, uncertainty as uncertainty, zero as zero
    from .differences import (
        lasting_covariance as lasting_covariance,
        propagate_in_light as propagate_in_light,
    )
    from .dwells import (
        find_axis_dwells as find_axis_dwells,
        finite_means as finite_means,
        mean as mean,
        row_variance as row_variance,
    )
    from .measurement import Measurement as Measurement
    from .plan import Plan as Plan, make_plan as make_plan
    from .solution import (
        Poses as Poses,
        Samples as Samples,
        common_detectors as common_detectors,
        detectors_of as detectors_of,
        root_of_covariance as root_of_covariance,
    )
    from .table import solve_table as solve_table
    from .tally import Tally as Tally
    from .uncertainty import (
        Propagation as Propagation,
        carry as carry,
        coverage_factor as coverage_factor,
        propagate as propagate,
    )
    from .zero import PoseColumns as PoseColumns, ZeroRequest as ZeroRequest
else:
    __getattr__ = load_on_use(
        __name__,
        {
            "differences": "lasting_covariance propagate_in_light",
            "doubts": "has_fold",
            "dwells": "dwell_means finite_means mean row_variance find_dwells find_axis_dwells",
            "measurement": "Measurement",
            "plan": "FALSE_ALARM_RATE LIMITS Plan make_plan",
            "problem": "MIN_REDUNDANCY",
            "solution": (
                "Poses Samples common_detectors detectors_of root_of_covariance worded_columns"
            ),
            "solver": "solve_each",
            "table": "solve_table",
            "tally": "Misfit Tally shift_per_kelvin",
            "uncertainty": (
                "Propagation carry coverage_factor effective_degrees_of_freedom propagate "
                "region_factor"
            ),
            "zero": "PoseColumns ZeroRequest zero_findings zero_of_table",
        },
    )
