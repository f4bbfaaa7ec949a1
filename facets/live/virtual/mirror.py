"""The mirror of a virtual bench: the truth that is to be measured."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ...core.units import Floats
from ...simulation.motion import named, states

if TYPE_CHECKING:
    from ...core.settings import Config


#: How long the mirror takes to come to speed, s.
RAMP = 1.0


class Mirror:
    """The truth: where the mirror is at any time, going through a motion again and again.

    It stands at the motion's beginning until `begin` (s), then takes RAMP seconds to come to speed.
    """

    def __init__(self, config: Config, name: str, seed: int) -> None:
        times, self.states = states(named(config, name), np.random.default_rng(seed))
        self.times = times - times[0]
        step = self.times[-1] / (len(times) - 1) if len(times) > 1 else 1.0
        self.period = float(self.times[-1] + step)
        self.nodes = np.append(self.times, self.period)  # at the end as at the beginning
        self.there = np.vstack([self.states, self.states[:1]])
        self.begin = np.inf

    @property
    def reach(self) -> float:
        """How far it goes from where it begins, across the beam, mm."""
        return float(np.hypot(*(self.states[:, :2] - self.states[0, :2]).T).max())

    def at(self, time_: Floats) -> Floats:
        """States (n, 8) at times (n,), s."""
        passed = np.maximum(time_ - self.begin, 0.0)
        ramped = np.where(passed < RAMP, passed**2 / (2 * RAMP), passed - RAMP / 2)
        phase = np.mod(ramped, self.period)
        last = np.searchsorted(self.nodes, phase, side="right") - 1
        share = (phase - self.nodes[last]) / (self.nodes[last + 1] - self.nodes[last])
        here: Floats = self.there[last]
        there: Floats = here + share[:, None] * (self.there[last + 1] - here)
        return there
