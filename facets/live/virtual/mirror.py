"""The mirror of a virtual bench, whose true pose is to be measured."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ...core.units import Floats
from ...model.arrays import readings
from ...simulation.motion import find_motion, shaker_force, states

if TYPE_CHECKING:
    from ...core.settings import Config


#: A mirror with less than this fraction of the beam's power on a detector has left the beam.
MIN_POWER_FRACTION = 1e-3
#: Time that the mirror takes to come to speed, s.
RAMP_S = 1.0


class Mirror:
    """A mirror that repeats a motion.

    It is at rest at the motion's beginning until `begin` (s), then comes to speed within RAMP_S.
    forces: (n, 1) of a vibration's shaker at the motion's times, N; 0 without a shaker.
    """

    def __init__(self, config: Config, name: str, seed: int) -> None:
        self.sensor = config.sensor
        motion, rng = find_motion(config, name), np.random.default_rng(seed)
        force = shaker_force(motion, rng)
        times, self.states = states(motion, rng)
        self.forces = np.zeros((len(times), 1)) if force is None else force[:, None]
        self.is_shaken = force is not None
        #: A shaken body follows its force; a mirror that is moved comes to speed.
        self.ramp = 0.0 if self.is_shaken else RAMP_S
        self.times = times - times[0]
        step = self.times[-1] / (len(times) - 1) if len(times) > 1 else 1.0
        self.period = float(self.times[-1] + step)
        self.nodes = np.append(self.times, self.period)  # at the end as at the beginning
        self.begin = np.inf

    def leaves(self, place: Floats) -> bool:
        """Whether the motion takes the mirror out of a beam at a fixed place (2,), mm."""
        states = self.states.copy()
        states[:, 6:] = place
        power = readings(self.sensor, states)[:, 2::3]
        return not bool((power >= MIN_POWER_FRACTION * self.sensor.beam.power).all())

    def interpolate(self, time_: Floats) -> Floats:
        """States (n, 8) at times (n,), s."""
        return self.between(time_, self.states)

    def force(self, time_: Floats) -> Floats:
        """Force (n,) of the shaker at times (n,), s, in N; 0 without a shaker."""
        return self.between(time_, self.forces)[:, 0]

    def between(self, time_: Floats, nodes: Floats) -> Floats:
        """Interpolate `nodes` (m, d), given at the motion's times, at times (n,), s: (n, d)."""
        passed = np.maximum(time_ - self.begin, 0.0)
        if self.ramp:
            passed = np.where(
                passed < self.ramp, passed**2 / (2 * self.ramp), passed - self.ramp / 2
            )
        phase = np.mod(passed, self.period)
        last = np.searchsorted(self.nodes, phase, side="right") - 1
        fraction = (phase - self.nodes[last]) / (self.nodes[last + 1] - self.nodes[last])
        before: Floats = nodes[last]
        result: Floats = before + fraction[:, None] * (nodes[(last + 1) % len(nodes)] - before)
        return result
