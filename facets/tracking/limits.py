"""How far, how fast and within which borders a stage may be sent: pure arithmetic."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.settings import Stage as Settings
from ..core.units import Floats


@dataclass(frozen=True)
class Limits:
    """low, high: borders of the beam's place, mm.  speed: of each axis, mm/s.  reach: how far from
    where the stage is a command may lie, mm."""

    low: tuple[float, float]
    high: tuple[float, float]
    speed: float
    reach: float

    @classmethod
    def from_settings(cls, settings: Settings) -> Limits:
        """Of tracking: no further ahead than the stage can come until the next command acts.

        The soft limits are the stage's own, so that an offset of the beam moves them with it.
        """
        s = settings
        ahead = s.max_speed * (s.lag + s.latency + 1 / s.rate)
        low = s.low[0] + s.zero[0], s.low[1] + s.zero[1]
        high = s.high[0] + s.zero[0], s.high[1] + s.zero[1]
        return cls(low, high, s.max_speed, min(s.max_step, ahead))

    def hold(self, target: Floats, place: Floats) -> Floats:
        """The place nearest to `target` (2,), on the way from `place`, that may be commanded."""
        step = target - place
        length = float(np.hypot(*step))
        kept = place + step * min(1.0, self.reach / length) if length > 0 else target
        held: Floats = np.clip(kept, self.low, self.high)
        return held
