"""The check of a stage before its first use: small slow moves, measured by the readings.

The mirror stands still. The stage moves the beam by STEP_MM along each axis and back, within the
same envelope as in a run, and the readings alone, without the encoder, measure the beam's place.
The result is the sign, the scale and the delay of each axis, and whether x and y are exchanged.
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

#: The beam's distance along each axis, mm (a quarter of the paper's head's range), and speed.
STEP_MM, SPEED_MM_S = 0.05, 0.5
#: The stage stands for DWELL_S after each move; the beam's place is the mean over the last MEAN_S.
DWELL_S, MEAN_S = 0.5, 0.25
#: Longest gap between good samples, s; the stage gets no command in a gap, so it stands.
WAIT_S = 2.0
#: A check ends after more than this number of stalls of the loop.
STALLS = 10
#: Largest error of an axis's scale, and largest share of a move across its axis.
SCALE, ACROSS = 0.05, 0.1
#: A beam that moves by less than this share of the command counts as not moved.
HARDLY = 0.1
#: A mirror that moves by more than this during the check is not at rest, mm.
MIRROR_MM = 0.01
#: The part of each move over which the delay is taken: a stage has then reached its speed.
RAMP = (0.3, 0.9)


class Axis(NamedTuple):
    """The beam's response to a command along one axis.  scale: move along the axis over the
    command.  across: the same for the other axis.  delay: from the command to the light, s."""

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
        """The fault of the axis; empty if there is none."""
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
    """The text that identifies a stage in `stage.checked`; every stage needs its own check."""
    return f"{settings.driver} {port} {1e3 * settings.step:g} um"


def checked_today(settings: Settings, port: str) -> str:
    """The value of `stage.checked` after a check."""
    return f"{datetime.now(UTC):%Y-%m-%d} {stage_identity(settings, port)}"


class StageCheck(Tracker):
    """Moves of the stage along x and back and along y and back, and the beam's places.

    The samples must be solved with a free beam.
    """

    #: Places to which the beam is moved, in steps from its first place.
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
        """Whether the check is complete, or the stage was stopped before."""
        latched = self.envelope.latched
        goes_on = latched == STALLED and self.envelope.stops <= STALLS
        return self.leg == len(self.LEGS) or bool(self.error or (latched and not goes_on))

    def follow(self, good: Sample, place: Floats, now: float) -> None:
        """Continue the current move by a small part."""
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
        """Resume a check by itself after a stall of the loop on a busy machine: the person who
        began the check is there, and no move is longer than STEP_MM."""
        stood = now - self.envelope.latched_at > self.envelope.arrival.patience
        if self.envelope.latched == STALLED and stood and self.envelope.stops <= STALLS:
            self.request = "the check"
        return super().is_resumed(doubt, newest, now)

    def bridge(self, now: float) -> bool:
        """Stand for up to WAIT_S and wait for the next good sample."""
        return now - self.good.time < WAIT_S

    def axes(self) -> list[Axis]:
        """Compute the response of both axes."""
        means = [self.mean(leg) for leg in range(len(self.LEGS))]
        x = (2 * means[1] - means[0] - means[2]) / (2 * STEP_MM)
        y = (2 * means[3] - means[2] - means[4]) / (2 * STEP_MM)
        return [
            Axis("x", float(x[0]), float(x[1]), self.delay(1, 0, float(x[0]))),
            Axis("y", float(y[1]), float(y[0]), self.delay(3, 1, float(y[1]))),
        ]

    def mean(self, leg: int) -> Floats:
        """The mean place of the beam at the end of a leg (2,), mm."""
        last = self.beams[leg][-1][0]
        places: Floats = np.mean([b for t, b in self.beams[leg] if t > last - MEAN_S], axis=0)
        return places

    def delay(self, leg: int, axis: int, scale: float) -> float:
        """Time from a command to the light, s, by the beam's lag in the middle of a move."""
        times = np.array([time for time, _ in self.commands[leg]])
        commanded = np.array([place[axis] for _, place in self.commands[leg]]) - self.origin[axis]
        taken = np.array([time for time, _ in self.beams[leg]])
        beam = np.array([place[axis] for _, place in self.beams[leg]]) - self.mean(leg - 1)[axis]
        half = 0.5 / self.settings.rate  # a command lasts for one period
        here = np.interp(taken - half, times, commanded, left=0.0)
        midst = (here > RAMP[0] * STEP_MM) & (here < RAMP[1] * STEP_MM)
        if not midst.any() or not scale:
            return float("nan")
        return float((here - beam / scale)[midst].mean() / self.narrow.speed)

    def faults(self) -> list[str]:
        """The reasons why the stage must not be used, in sentences; empty if there are none."""
        if self.leg < len(self.LEGS):
            why = self.error or self.envelope.latched or "the samples ended too soon"
            moved = "xxyy"[self.leg - 1] if self.leg else ""
            at = f" while the stage was to move along {moved}" if moved else ""
            return [f"the check was not completed{at}: {why}"]
        if np.ptp(np.array(self.apexes), axis=0).max() > MIRROR_MM:
            return ["the mirror moved during the check: it must stand still"]
        return [axis.fault for axis in self.axes() if axis.fault]
