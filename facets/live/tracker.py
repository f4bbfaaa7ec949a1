"""The thread that makes the beam follow, and that stops it when anything is wrong."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.settings import Stage as Settings
from ..tracking.control import Law, Seen
from ..tracking.stage import Stage, StageError

Floats = NDArray[np.float64]


class Encoder(NamedTuple):
    """Where the stage said it was: at a host's time (s) a place (2,) mm, moving at a speed (2,)."""

    time: float
    place: Floats
    speed: Floats

    def at(self, times: Floats) -> Floats:
        """Places (n, 2) at host times (n,)."""
        ahead = np.clip(times - self.time, -REACH, REACH)
        return self.place + ahead[:, None] * self.speed


#: No place of the stage is believed longer than this, s: it then stands where it was.
REACH = 0.1


@dataclass
class Target:
    """The newest sample, as the tracker needs it. time: on the host's clock, s."""

    time: float = -np.inf
    powers: Floats = field(default_factory=lambda: np.full(3, np.nan))
    apex: Floats | None = None


class Tracker(threading.Thread):
    """Commands the stage at its rate for as long as the sample is fresh and has a pose.

    say: takes an event's name and what belongs to it. stopped: why it stands still, or nothing.
    moves: commands sent.
    """

    def __init__(
        self, stage: Stage, settings: Settings, law: Law, say: Callable[..., None], search: bool
    ) -> None:
        super().__init__(name="tracker", daemon=True)
        self.stage, self.settings, self.law, self.say = stage, settings, law, say
        self.search = Spiral(settings) if search else None
        self.target = Target()
        self.encoder = Encoder(time.monotonic(), stage.place(), np.zeros(2))
        self.ending = threading.Event()
        self.stopped = "waiting for light"
        self.error: StageError | None = None
        self.moves = 0

    def __enter__(self) -> Tracker:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        try:
            self.finish()
        finally:
            self.stage.close()

    def run(self) -> None:
        period = 1 / self.settings.rate
        due = time.monotonic()
        try:
            while not self.ending.is_set():
                self.cycle()
                due = max(due + period, time.monotonic())
                self.ending.wait(max(0.0, due - time.monotonic()))
        except StageError as error:
            self.error = error
            self.say("stage error", reason=str(error))
        finally:
            self.halt("end")

    def cycle(self) -> None:
        self.look()
        target = self.target
        age = time.monotonic() - target.time
        needs_pose = self.settings.law == "feedforward"
        lit = bool(np.isfinite(target.powers).all() and (target.powers > 0).all())
        if age > self.settings.stale:
            self.pause("no fresh sample")
        elif not lit or (needs_pose and target.apex is None):
            self.pause("no light on all detectors" if not lit else "no pose")
        else:
            self.stopped = ""
            if self.search:
                self.search.reset()
            now = time.monotonic()
            seen = Seen(target.time, now, target.powers, target.apex, self.encoder.place)
            self.go(self.law.command(seen))

    def look(self) -> None:
        before = time.monotonic()
        place = self.stage.place()
        now = (before + time.monotonic()) / 2
        old = self.encoder
        passed = now - old.time
        speed = (place - old.place) / passed if passed > 1e-4 else old.speed
        self.encoder = Encoder(now, place, speed)

    def go(self, place: Floats) -> None:
        self.moves += 1
        self.say("move", x=round(float(place[0]), 6), y=round(float(place[1]), 6))
        self.stage.move(place)

    def pause(self, reason: str) -> None:
        """Stands still, or looks for the mirror where that was asked for."""
        if self.stopped != reason:
            self.halt(reason)
            self.law.forget()
        if self.search and self.moves:
            place = self.search.next(self.encoder.place)
            if place is not None:
                self.go(place)

    def halt(self, reason: str) -> None:
        self.stopped = reason
        self.say("stop", reason=reason)
        try:
            self.stage.stop()
        except StageError as error:
            self.say("stage error", reason=str(error))

    def finish(self) -> None:
        """Stops the stage and waits for it."""
        self.ending.set()
        if self.is_alive():
            self.join(timeout=2.0)


class Spiral:
    """Places around where the beam was lost, further and further out."""

    #: Distance between turns and between places, mm, and how far out it goes.
    PITCH, FARTHEST = 0.1, 2.0

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.reset()

    def reset(self) -> None:
        self.centre: Floats | None = None
        self.turn = 0.0

    def next(self, place: Floats) -> Floats | None:
        """The next place (2,), or None past the end."""
        if self.centre is None:
            self.centre = place.copy()
        radius = self.PITCH * self.turn / (2 * np.pi)
        if radius > self.FARTHEST:
            return None
        self.turn += self.PITCH / max(radius, self.PITCH)
        at = self.centre + radius * np.array([np.cos(self.turn), np.sin(self.turn)])
        kept: Floats = np.clip(at, self.settings.low, self.settings.high)
        return kept
