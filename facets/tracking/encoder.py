"""A position of the stage by its encoders, and how long it is extrapolated."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..core.units import Floats

#: A position is extrapolated for at most this time, s; later the stage is assumed to be at rest.
MAX_EXTRAPOLATION_S = 0.1


class Encoder(NamedTuple):
    """A stage's position at a host's time (s): a place (2,) mm, and a speed (2,)."""

    time: float
    place: Floats
    speed: Floats

    def places(self, times: Floats) -> Floats:
        """The places (n, 2) at host times (n,), extrapolated."""
        ahead = np.clip(times - self.time, -MAX_EXTRAPOLATION_S, MAX_EXTRAPOLATION_S)
        return self.place + ahead[:, None] * self.speed
