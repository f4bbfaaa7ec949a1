from typing import TYPE_CHECKING

from ..core.faces import load_on_use

if TYPE_CHECKING:
    from . import error_motions as error_motions, report as report, visits as visits
else:
    __getattr__ = load_on_use(
        __name__,
        {
            "error_motions": "AxisTest Commands Visits measure_error_motions",
            "positioning": "evaluate_positioning",
            "report": "evaluate_axis",
            "visits": (
                "PoseSeries approach_directions find_visits match_dwells "
                "measured_directions read_commands read_series series_of_columns"
            ),
        },
    )
