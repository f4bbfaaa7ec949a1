"""The mirror of a virtual bench: the truth that is to be measured."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ...core.units import Floats
from ...model.arrays import readings
from ...simulation.motion import find_motion, states

if TYPE_CHECKING:
    from ...core.settings import Config


#: A mirror with less light than this on some detector has left the beam, as a share of its power.
LEFT = 1e-3
#: Time that the mirror takes to come to speed, s.
RAMP_S = 1.0


class Mirror:
    """The truth: where the mirror is at any time, going through a motion again and again.

    It stands at the motion's beginning until `begin` (s), then comes to speed within RAMP_S.
    """

    def __init__(self, config: Config, name: str, seed: int) -> None:
        self.sensor = config.sensor
        times, self.states = states(find_motion(config, name), np.random.default_rng(seed))
        self.times = times - times[0]
        step = self.times[-1] / (len(times) - 1) if len(times) > 1 else 1.0
        self.period = float(self.times[-1] + step)
        self.nodes = np.append(self.times, self.period)  # at the end as at the beginning
        self.begin = np.inf

    def leaves(self, place: Floats) -> bool:
        """Whether the motion takes the mirror out of a beam that stands at this place (2,), mm."""
        states = self.states.copy()
        states[:, 6:] = place
        power = readings(self.sensor, states)[:, 2::3]
        return not bool((power >= LEFT * self.sensor.beam.power).all())

    def interpolate(self, time_: Floats) -> Floats:
        """States (n, 8) at times (n,), s."""
        return self.between(time_, self.states)

    def between(self, time_: Floats, nodes: Floats) -> Floats:
        """What is `nodes` (m, d) at the times of the motion, at any times (n,), s: (n, d)."""
        passed = np.maximum(time_ - self.begin, 0.0)
        ramped = np.where(passed < RAMP_S, passed**2 / (2 * RAMP_S), passed - RAMP_S / 2)
        phase = np.mod(ramped, self.period)
        last = np.searchsorted(self.nodes, phase, side="right") - 1
        share = (phase - self.nodes[last]) / (self.nodes[last + 1] - self.nodes[last])
        here: Floats = nodes[last]
        there: Floats = here + share[:, None] * (nodes[(last + 1) % len(nodes)] - here)
        return there
