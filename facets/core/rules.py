"""What counts as inside the measurement range."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

from .arguments import checked
from .errors import InputError


@checked
@dataclass(frozen=True)
class Rules:
    """What counts as inside the range.

    whole_spot: the footprint inside the 1/e^2 circle stays on the detector, else the centroid.
    snr: least power of a spot, without other light on its detector, over the noise of a power.
    condition: largest condition number of the Jacobian, columns in um and urad, rows in standard
    deviations.  coarsest: largest standard uncertainty of each axis of the pose, mm and rad.
    tracking: whether the beam follows the mirror in x and y, else it stands at (0, 0).
    """

    whole_spot: bool = True
    snr: float = 810.0
    condition: float = 1e8
    coarsest: tuple[float, ...] = (inf,) * 6
    tracking: bool = False

    def __post_init__(self) -> None:
        if len(self.coarsest) != 6:
            raise InputError(f"coarsest has {len(self.coarsest)} numbers; allowed: 6, one an axis")
