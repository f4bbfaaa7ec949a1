from typing import TYPE_CHECKING

from ..core.faces import load_on_use

if TYPE_CHECKING:
    from . import (
        findings as findings,
        forms as forms,
        frequency_response as frequency_response,
        signals as signals,
        universal_file as universal_file,
    )
else:
    __getattr__ = load_on_use(
        __name__,
        {
            "findings": "find_limits find_peaks",
            "forms": "FORMS ResponseForm",
            "frequency_response": (
                "OutputChannel estimate_response find_stretches low_pass noise_spectrum "
                "response_table"
            ),
            "signals": "build_signals",
            "universal_file": "InputChannel Node input_type read_input_dof write_universal_file",
        },
    )
