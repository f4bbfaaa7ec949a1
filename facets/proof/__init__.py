from typing import TYPE_CHECKING

from ..core.faces import load_on_use

if TYPE_CHECKING:
    from . import certificate as certificate
    from . import designs as designs
    from . import range_cover as range_cover
    from . import reach as reach
    from . import tolerances as tolerances
    from . import uniqueness as uniqueness
else:
    __getattr__ = load_on_use(
        __name__,
        {
            "certificate": "write_certificate",
            "range_cover": "cover_range",
            "tolerances": "Tolerances calibration_tolerances",
            "uniqueness": ("Certificate Effort certify edges_over_rotations slope_of_powers"),
        },
    )
