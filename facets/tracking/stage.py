"""The error of a stage, and a model of a stage's motion."""

from __future__ import annotations

from collections import deque
from math import sqrt

import numpy as np

from ..core.errors import FacetsError
from ..core.settings import Stage as Settings
from ..core.units import Floats


class StageError(FacetsError):
    """Error of a stage that refuses a command, does not answer, or sends an invalid answer."""


class StageModel:
    """Two axes that follow commands: latency, then a first-order lag within speed and acceleration.

    place, speed: (2,) mm, mm/s, at the time of the last `advance`.  max_speed, acceleration: of
    each axis; they start with the settings' values, and the axis's controller may change them.
    """

    #: Longest step of the model, s.
    STEP = 5e-4

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.place = np.array(settings.zero, dtype=float)
        self.speed = np.zeros(2)
        self.target = self.place.copy()
        self.now = 0.0
        self.waiting: deque[tuple[float, Floats]] = deque()
        self.max_speed, self.acceleration = settings.max_speed, settings.acceleration
        self.jammed = self.braking = False

    def command(self, place: Floats) -> None:
        """Start a move to a place (2,), mm, after the latency."""
        self.waiting.append((self.now + self.settings.latency, np.array(place, dtype=float)))

    @property
    def is_settled(self) -> bool:
        """Whether the stage is at rest at its last goal, to 0.1 um."""
        there = bool(np.abs(self.target - self.place).max() < 1e-4)
        return not self.waiting and not self.braking and there

    def halt(self) -> None:
        """Cancel the commands, and brake."""
        self.waiting.clear()
        self.target = self.place.copy()
        self.braking = True

    def advance(self, now: float) -> None:
        """Continue the motion to the time `now`, s."""
        while now - self.now > 1e-12:
            step = min(self.STEP, now - self.now)
            self.now += step
            while self.waiting and self.waiting[0][0] <= self.now:
                self.target = self.waiting.popleft()[1]
                self.braking = False
            if self.jammed:
                self.speed[:] = 0.0
            else:
                self.follow(step)

    def follow(self, step: float) -> None:
        """Move by one step, s, towards the target, or brake."""
        for axis in range(2):  # plain numbers: arrays of two are slow, and there are many steps
            speed, off = float(self.speed[axis]), float(self.target[axis] - self.place[axis])
            # At a higher speed the axis could not brake after this step and would pass its target.
            most = self.acceleration * (sqrt(step**2 + 2 * abs(off) / self.acceleration) - step)
            most = min(self.max_speed, most)
            target_speed = 0.0 if self.braking else off / max(self.settings.lag, step)
            change = min(max(target_speed, -most), most) - speed
            most = self.acceleration * step
            speed += min(max(change, -most), most)
            self.speed[axis] = speed
            self.place[axis] += speed * step
        if self.braking and not self.speed.any():
            self.target, self.braking = self.place.copy(), False
