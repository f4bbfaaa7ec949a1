from typing import TYPE_CHECKING

from ..core.faces import load_on_use

if TYPE_CHECKING:
    from . import noise_report as noise_report, rest as rest
else:
    __getattr__ = load_on_use(
        __name__,
        {
            "noise_model": "fit_noise",
            "noise_report": "longest_section",
            "rest": "find_faults reading_faults",
        },
    )
