"""The stage that carries the beam: what every one can do, and a model of how one moves."""

from __future__ import annotations

from collections import deque
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..core.errors import FacetsError
from ..core.settings import Stage as Settings

Floats = NDArray[np.float64]


class StageError(FacetsError):
    """The stage refused a command, does not answer, or says what can not be understood."""


class Stage(Protocol):
    """A two-axis stage; places are of the beam in the world frame, mm."""

    def place(self) -> Floats:
        """Where the encoders say the beam is: (2,)."""

    def move(self, place: Floats) -> None:
        """Starts towards a place (2,); does not wait."""

    def stop(self) -> None:
        """Stands still as soon as it can."""

    def close(self) -> None: ...


class StageModel:
    """Two axes that follow commands: latency, then a first-order lag within speed and acceleration.

    place, speed: (2,) mm, mm/s, at the time of the last `advance`.
    """

    #: No longer step of the model, s.
    STEP = 5e-4

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.place = np.array(settings.zero, dtype=float)
        self.speed = np.zeros(2)
        self.target = self.place.copy()
        self.now = 0.0
        self.waiting: deque[tuple[float, Floats]] = deque()
        self.jammed = False

    def command(self, place: Floats) -> None:
        """A move that begins after the latency."""
        self.waiting.append((self.now + self.settings.latency, np.array(place, dtype=float)))

    @property
    def settled(self) -> bool:
        """Whether it stands where it was last told to go, to 0.1 um."""
        return not self.waiting and bool(np.abs(self.target - self.place).max() < 1e-4)

    def halt(self) -> None:
        self.waiting.clear()
        self.target = self.place.copy()
        self.speed[:] = 0.0

    def advance(self, now: float) -> None:
        """To the time `now`, s."""
        while now - self.now > 1e-12:
            step = min(self.STEP, now - self.now)
            self.now += step
            while self.waiting and self.waiting[0][0] <= self.now:
                self.target = self.waiting.popleft()[1]
            if not self.jammed:
                self.follow(step)

    def follow(self, step: float) -> None:
        s = self.settings
        wanted = (self.target - self.place) / max(s.lag, step)
        wanted = np.clip(wanted, -s.max_speed, s.max_speed)
        change = np.clip(wanted - self.speed, -s.acceleration * step, s.acceleration * step)
        self.speed += change
        self.place += self.speed * step
