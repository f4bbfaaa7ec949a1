from typing import TYPE_CHECKING

from ..core.faces import load_on_use

if TYPE_CHECKING:
    from . import certificate as certificate, tolerances as tolerances, uniqueness as uniqueness
else:
    __getattr__ = load_on_use(
        __name__,
        {
            "certificate": "write_certificate",
            "tolerances": "Tolerances calibration_tolerances",
            "uniqueness": ("Certificate certify edges_over_rotations slope_of_powers"),
        },
    )
