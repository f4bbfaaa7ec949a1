"""Rules that define the measurement range."""

from __future__ import annotations

from dataclasses import dataclass

from .arguments import check_arguments
from .axis_keys import PER_AXIS, convert_fine_units
from .errors import InputError
from .keys import key
from .rigid_body import MeasuredObject


@check_arguments
@dataclass(frozen=True)
class Rules:
    """Rules that every pose inside the measurement range keeps.

    whole_spot: whether the spot inside the 1/e^2 circle must stay on the detector, instead of its
    centroid.  snr: least power of a spot, without other light on its detector, over the noise of a
    power.  condition: largest condition number of the Jacobian, columns in um and urad, rows in
    standard deviations.  coarsest: (6,) largest standard uncertainties of the pose, mm and rad.
    tracking: whether the beam follows the mirror in x and y; otherwise it stays at (0, 0).
    object: object whose displacement from its pose at the mirror's zero the ranges refer to; None:
    they refer to the mirror's pose.
    """

    whole_spot: bool = key(
        "spot",
        "whole",
        "what stays on the PSD: all of a spot inside the 1/e^2 circle, or its centroid",
        words={"whole": True, "centroid": False},
    )
    snr: float = key(
        "snr",
        810.0,
        "least power of a spot, without other light, over the noise of a PSD's power",
        gt=0,
        le=1e9,
    )
    condition: float = key(
        "condition", 1e8, "largest condition number of the weighted Jacobian", gt=1, le=1e15
    )
    coarsest: tuple[float, ...] = key(
        "coarsest",
        {},
        "largest standard uncertainty of each axis",
        block=PER_AXIS,
        convert=convert_fine_units,
    )
    tracking: bool = False
    object: MeasuredObject | None = None

    def __post_init__(self) -> None:
        if len(self.coarsest) != 6:
            raise InputError(
                f"coarsest has {len(self.coarsest)} numbers; allowed: 6, one for each axis"
            )
