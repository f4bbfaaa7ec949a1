"""Where a stage said that it was, and for how long that is believed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..core.units import Floats

#: No place of the stage is believed longer than this, s: it then stands where it was.
REACH = 0.1


class Encoder(NamedTuple):
    """Where the stage said it was: at a host's time (s) a place (2,) mm, moving at a speed (2,)."""

    time: float
    place: Floats
    speed: Floats

    def places(self, times: Floats) -> Floats:
        """Places (n, 2) at host times (n,)."""
        ahead = np.clip(times - self.time, -REACH, REACH)
        return self.place + ahead[:, None] * self.speed
