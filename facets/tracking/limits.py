"""Limits of the place, speed and distance of a stage's commands: pure arithmetic."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.settings import Stage as Settings
from ..core.units import Floats


@dataclass(frozen=True)
class Limits:
    """Limits of commands.  low, high: of the beam's place, mm.  speed: of each axis, mm/s.  reach:
    largest distance of a command from the stage's place, mm."""

    low: tuple[float, float]
    high: tuple[float, float]
    speed: float
    reach: float

    @classmethod
    def from_settings(cls, settings: Settings) -> Limits:
        """Limits of following: a command covers at most the stage's motion until the next one acts.

        The soft limits are the stage's own, so that an offset of the beam moves them, too.
        """
        s = settings
        ahead = s.max_speed * (s.lag + s.latency + 1 / s.rate)
        low = s.low[0] + s.zero[0], s.low[1] + s.zero[1]
        high = s.high[0] + s.zero[0], s.high[1] + s.zero[1]
        return cls(low, high, s.max_speed, min(s.max_step, ahead))

    def hold(self, target: Floats, place: Floats) -> Floats:
        """The allowed place nearest to `target` (2,) on the way from `place`."""
        step = target - place
        length = float(np.hypot(*step))
        near = place + step * min(1.0, self.reach / length) if length > 0 else target
        held: Floats = np.clip(near, self.low, self.high)
        return held
