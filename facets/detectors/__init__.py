from typing import TYPE_CHECKING

from ..core.faces import load_on_use

if TYPE_CHECKING:
    from .calibrated import MISFIT as MISFIT
    from .counts import SATURATED as SATURATED
    from .noise import step_variances as step_variances
else:
    __getattr__ = load_on_use(
        __name__,
        {
            "calibrated": "KNOWN MISFIT MODEL_ERROR TEMPERATURE",
            "correction": "NAMES coefficients correct correction_slopes invert_correction",
            "counts": (
                "SATURATED UNEQUAL counts_per_ampere counts_to_readings counts_to_xy_sum "
                "readings_to_counts"
            ),
            "drift": "draw_flicker draw_walk",
            "electrodes": "fractions places",
            "noise": (
                "ELECTRIC add_noise electrode_currents fullness least_light power_floor "
                "sample_readings standard_deviations step_variances variances"
            ),
            "skew": "align delay_states slopes",
            "temperature": "beam_shift exact_readings warmer_than_reference",
        },
    )
