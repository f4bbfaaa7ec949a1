"""Where a stage said that it was, and for how long that is believed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..core.units import Floats

#: A position of the stage is extrapolated over no more than this time, s; from then on the stage
#: is taken to stand.
MAX_EXTRAPOLATION_S = 0.1


class Encoder(NamedTuple):
    """Where the stage said it was: at a host's time (s) a place (2,) mm, moving at a speed (2,)."""

    time: float
    place: Floats
    speed: Floats

    def places(self, times: Floats) -> Floats:
        """Places (n, 2) at host times (n,)."""
        ahead = np.clip(times - self.time, -MAX_EXTRAPOLATION_S, MAX_EXTRAPOLATION_S)
        return self.place + ahead[:, None] * self.speed
