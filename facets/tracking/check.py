"""The first use of a stage: small slow moves, and what the readings say that they did.

The mirror stands still. The stage moves the beam by STEP_MM along each axis and back, through the
same envelope as always, and the readings alone, without the encoder, say where the beam went. From
that follow the sign, the scale and the delay of each axis, and whether x and y are exchanged.
"""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any, NamedTuple

import numpy as np

from ..core.settings import Stage as Settings
from ..core.units import Floats
from .envelope import STALLED
from .limits import Limits
from .tracker import Sample, Tracker

#: How far the beam is moved along each axis, mm: a quarter of the paper's head's range.
STEP_MM, SPEED_MM_S = 0.05, 0.5
#: The stage stands for so long after each move, s; the beam's place is the mean over the last part.
DWELL_S, MEAN_S = 0.5, 0.25
#: A gap between good samples is waited for so long, s: nothing is sent, so the stage stands.
WAIT_S = 2.0
#: So many stalls of the loop do not end a check.
STALLS = 10
#: The scale of an axis may be off by this share, and the beam may leave its axis by this one.
SCALE, ACROSS = 0.05, 0.1
#: A beam that moves by less than this share hardly moves at all.
HARDLY = 0.1
#: A mirror that moves by more than this during the check is not at rest, mm.
MIRROR_MM = 0.01
#: The part of each move over which the delay is taken: a stage has then reached its speed.
RAMP = (0.3, 0.9)


class Axis(NamedTuple):
    """What a command does to the beam. scale: of the commanded way.  across: along the other axis,
    of the same.  delay: from the command to the light, s."""

    name: str
    scale: float
    across: float
    delay: float

    @property
    def sentence(self) -> str:
        return (
            f"{self.name}: the beam moves by {self.scale:+.3f} of the commanded way, and by "
            f"{self.across:+.3f} of it along the other axis, {1e3 * self.delay:.1f} ms later"
        )

    @property
    def fault(self) -> str:
        """What is wrong with the axis, or nothing."""
        if max(abs(self.scale), abs(self.across)) < HARDLY:
            what = f"hardly moves the beam: check that {self.name} is connected, and stage.step_um"
        elif abs(self.across) > abs(self.scale):
            what = "moves the beam along the other axis: exchange the cables of x and y"
        elif self.scale < 0:
            what = "moves the beam the wrong way: turn the axis round in its controller"
        elif abs(self.scale - 1) > SCALE:
            what = f"moves the beam {self.scale:.3g} times as far: correct stage.step_um"
        elif abs(self.across) > ACROSS:
            angle = np.degrees(np.arctan2(abs(self.across), self.scale))
            what = f"is rotated by {angle:.0f} degrees relative to the sensor: turn the stage"
        else:
            return ""
        return f"a command along {self.name} {what}"


def stage_identity(settings: Settings, port: str) -> str:
    """The stage that `stage.checked` is about, in words: another one needs a check of its own."""
    return f"{settings.driver} {port} {1e3 * settings.step:g} um"


def checked_today(settings: Settings, port: str) -> str:
    """The value of `stage.checked` after a check."""
    return f"{datetime.now(UTC):%Y-%m-%d} {stage_identity(settings, port)}"


class StageCheck(Tracker):
    """Moves the stage along x and back, along y and back, and notes where the beam goes.

    Needs samples that were solved with a free beam. outcome: the axes, once all is seen.
    """

    #: Where the beam goes, in steps from where it was, after a first look there.
    LEGS = ((0, 0), (1, 0), (0, 0), (0, 1), (0, 0))

    def __init__(self, *arguments: Any, **more: Any) -> None:
        super().__init__(*arguments, **more)
        full = self.envelope.limits
        self.narrow = Limits(full.low, full.high, min(full.speed, SPEED_MM_S), full.reach)
        self.origin = self.encoder.place
        self.leg, self.arrived, self.last = 0, np.inf, -np.inf
        self.commands: list[list[tuple[float, Floats]]] = [[] for _ in self.LEGS]
        self.beams: list[list[tuple[float, Floats]]] = [[] for _ in self.LEGS]
        self.apexes: list[Floats] = []

    @property
    def is_over(self) -> bool:
        """Whether all was seen, or the stage was stopped before."""
        latched = self.envelope.latched
        goes_on = latched == STALLED and self.envelope.stops <= STALLS
        return self.leg == len(self.LEGS) or bool(self.error or (latched and not goes_on))

    def follow(self, good: Sample, place: Floats, now: float) -> None:
        """The next small part of the move that is going on."""
        if self.is_over or good.apex is None:
            return
        if good.time > self.last:
            self.last = good.time
            self.beams[self.leg].append((good.time, good.beam))
            self.apexes.append(good.apex)
        goal = self.origin + STEP_MM * np.array(self.LEGS[self.leg])
        sent = self.envelope.go(goal, good.time, self.narrow)
        if sent is not None:
            self.count(sent)
            self.commands[self.leg].append((now, sent))
            if np.abs(sent - goal).max() < 1e-9:
                self.arrived = min(self.arrived, now)
        if good.time > self.arrived + DWELL_S:
            self.leg, self.arrived = self.leg + 1, np.inf

    def is_resumed(self, doubt: str, newest: Sample, now: float) -> bool:
        """After a loop that stalled, on a busy machine, the check goes on by itself: the person who
        began it is there, and no move is longer than STEP_MM."""
        stood = now - self.envelope.latched_at > self.envelope.arrival.patience
        if self.envelope.latched == STALLED and stood and self.envelope.stops <= STALLS:
            self.request = "the check"
        return super().is_resumed(doubt, newest, now)

    def bridge(self, now: float) -> bool:
        """Stands and waits for the next good sample, for a while."""
        return now - self.good.time < WAIT_S

    def axes(self) -> list[Axis]:
        """What was found."""
        means = [self.mean(leg) for leg in range(len(self.LEGS))]
        x = (2 * means[1] - means[0] - means[2]) / (2 * STEP_MM)
        y = (2 * means[3] - means[2] - means[4]) / (2 * STEP_MM)
        return [
            Axis("x", float(x[0]), float(x[1]), self.delay(1, 0, float(x[0]))),
            Axis("y", float(y[1]), float(y[0]), self.delay(3, 1, float(y[1]))),
        ]

    def mean(self, leg: int) -> Floats:
        """Where the beam stood at the end of a leg (2,), mm."""
        last = self.beams[leg][-1][0]
        places: Floats = np.mean([b for t, b in self.beams[leg] if t > last - MEAN_S], axis=0)
        return places

    def delay(self, leg: int, axis: int, scale: float) -> float:
        """From a command to the light, s: how far the beam is behind in the midst of a move."""
        times = np.array([time for time, _ in self.commands[leg]])
        commanded = np.array([place[axis] for _, place in self.commands[leg]]) - self.origin[axis]
        taken = np.array([time for time, _ in self.beams[leg]])
        beam = np.array([place[axis] for _, place in self.beams[leg]]) - self.mean(leg - 1)[axis]
        half = 0.5 / self.settings.rate  # a command holds for a period
        here = np.interp(taken - half, times, commanded, left=0.0)
        midst = (here > RAMP[0] * STEP_MM) & (here < RAMP[1] * STEP_MM)
        if not midst.any() or not scale:
            return float("nan")
        return float((here - beam / scale)[midst].mean() / self.narrow.speed)

    def faults(self) -> list[str]:
        """Why the stage must not be used, in sentences; none where it is as configured."""
        if self.leg < len(self.LEGS):
            why = self.error or self.envelope.latched or "the samples ended too soon"
            moved = "xxyy"[self.leg - 1] if self.leg else ""
            at = f" while the stage was to move along {moved}" if moved else ""
            return [f"the check was not completed{at}: {why}"]
        if np.ptp(np.array(self.apexes), axis=0).max() > MIRROR_MM:
            return ["the mirror moved during the check: it must stand still"]
        return [axis.fault for axis in self.axes() if axis.fault]
