"""The check of a stage before its first use: small slow moves, measured by the readings.

The mirror is at rest. The stage moves the beam by STEP_MM along each axis and back, within the
same envelope as in a run, and the readings alone, without the encoder, measure the beam's place.
The result is the sign, the scale and the delay of each axis, and whether x and y are exchanged.

The units of the envelope's limits are not trusted before the check, so the light bounds the moves.
The first move is a single native step, and each further one is twice as long. The check ends at the
first sample without a good pose, or with the beam more than SLACK_MM from its expected place.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..core.names import escape_undecodable
from ..core.units import Floats
from .arrival import distance_to_box, settling_time, words
from .control import Law
from .envelope import STALLED, Envelope
from .limits import Limits
from .tracker import STALE, Sample, Tracker

#: The beam's distance along each axis, mm (a quarter of the paper's head's range), and speed.
STEP_MM, SPEED_MM_S = 0.05, 0.5
#: Largest distance of the beam from where its move was to bring it, mm: more than the noise.
SLACK_MM = 0.01
#: The stage dwells for DWELL_S at both ends of STEP_MM; the beam's place is the mean over the last
#: MEAN_S.
DWELL_S, MEAN_S = 0.5, 0.25
#: Longest time without any sample, s; the stage gets no command in it, so it is at rest.
WAIT_S = 2.0
#: Longest time of a check, s.
LONGEST_S = 60.0
#: A check ends after more than this number of stalls of the loop.
MAX_STALLS = 10
#: Largest error of an axis's scale, and largest fraction of a move across its axis.
MAX_SCALE_ERROR, MAX_ACROSS = 0.05, 0.1
#: A beam that moves by less than this fraction of the command counts as not moved.
HARDLY_MOVED_FRACTION = 0.1
#: A mirror that moves by more than this during the check is not at rest, mm.
MAX_MIRROR_MM = 0.01
#: The part of the way back over which the delay is measured: a stage has then reached its speed.
RAMP_PART = (0.1, 0.7)


class Axis(NamedTuple):
    """The beam's response to a command along one axis.

    scale: move along the axis over the command.  across: move along the other axis over the
    command.  delay: time from the command to the light, s.
    """

    name: str
    scale: float
    across: float
    delay: float

    @property
    def sentence(self) -> str:
        """The result of the check of this axis as a sentence."""
        return (
            f"{self.name}: the beam moves by {self.scale:+.3f} of the commanded way, and by "
            f"{self.across:+.3f} of it along the other axis, {1e3 * self.delay:.1f} ms later"
        )

    @property
    def fault(self) -> str:
        """The fault of the axis; empty if there is none."""
        if max(abs(self.scale), abs(self.across)) < HARDLY_MOVED_FRACTION:
            what = f"hardly moves the beam: check that {self.name} is connected, and stage.step_um"
        elif abs(self.across) > abs(self.scale):
            what = "moves the beam along the other axis: exchange the cables of x and y"
        elif self.scale < 0:
            what = "moves the beam the wrong way: turn the axis round in its controller"
        elif abs(self.scale - 1) > MAX_SCALE_ERROR:
            what = f"moves the beam {self.scale:.3g} times as far: correct stage.step_um"
        elif abs(self.across) > MAX_ACROSS:
            angle = np.degrees(np.arctan2(abs(self.across), self.scale))
            what = f"is rotated by {angle:.0f} degrees relative to the sensor: turn the stage"
        else:
            return ""
        return f"a command along {self.name} {what}"


def response(axis: int, fraction: Floats, delay: float) -> Axis:
    """Return the response of axis 0 or 1 (x or y), whose command moves the beam by a fraction (2,)
    of the command."""
    return Axis("xy"[axis], float(fraction[axis]), float(fraction[1 - axis]), delay)


def stage_identity(driver: str, port: str, step: float) -> str:
    """The text that identifies a stage in `stage.checked`; every stage needs its own check."""
    return f"{driver} {escape_undecodable(port)} {1e3 * step:g} um"


class StageCheck(Tracker):
    """Moves of the stage along x and back and along y and back, and the beam's places.

    The samples must be solved with a free beam.
    """

    def __init__(self, envelope: Envelope, law: Law) -> None:
        super().__init__(envelope, law)
        self.search = None
        full = self.envelope.limits
        self.narrow = Limits(full.low, full.high, min(full.speed, SPEED_MM_S), full.reach)
        self.origin = self.encoder.place
        ways = [min(self.settings.step, STEP_MM)]
        while ways[-1] < STEP_MM:
            ways.append(min(2 * ways[-1], STEP_MM))
        x, y = ([way * unit for way in ways] for unit in np.eye(2))
        self.goals = np.array([np.zeros(2), *x, np.zeros(2), *y, np.zeros(2)])
        most = len(ways)
        self.ends = [0, most, most + 1, 2 * most + 1, 2 * most + 2]  # legs whose ends are measured
        self.leg, self.arrived, self.last = 0, np.inf, -np.inf
        self.is_surprised = False
        self.commands: list[list[tuple[float, Floats]]] = [[] for _ in self.goals]
        self.beams: list[list[tuple[float, Floats]]] = [[] for _ in self.goals]
        self.apexes: list[Floats] = []

    @property
    def is_resumable(self) -> bool:
        """Whether a person can end a stop."""
        return False

    @property
    def is_complete(self) -> bool:
        """Whether all moves were made."""
        return self.leg == len(self.goals)

    @property
    def is_at_rest(self) -> bool:
        """Whether a stopped stage has had the time to come to rest."""
        return self.clock() - self.envelope.latched_at > self.envelope.arrival.patience

    @property
    def is_over(self) -> bool:
        """Whether the check is complete, or the stage was stopped before."""
        ended = self.envelope.latched and not self.has_stalled and self.is_at_rest
        return self.is_complete or bool(self.error or ended)

    @property
    def has_stalled(self) -> bool:
        """Whether the check waits for the end of a stall of the loop, and then continues."""
        return self.envelope.latched == STALLED and self.envelope.stops <= MAX_STALLS

    def follow(self, good: Sample, place: Floats, now: float) -> None:
        """Look at the light, and continue the current move by a small part. It latches the stage if
        the check must end."""
        if self.is_complete:
            return
        if reason := self.reason_to_end(good, now):
            self.envelope.latch(reason)
            return
        if good.time > self.last:
            self.last = good.time
            self.beams[self.leg].append((good.time, good.beam))
            assert good.apex is not None
            self.apexes.append(good.apex)
        goal = self.origin + self.goals[self.leg]
        sent = self.envelope.go(goal, good.time, self.narrow)
        if sent is not None:
            self.count(sent)
            self.commands[self.leg].append((now, sent))
            if np.abs(sent - goal).max() < 1e-9:
                self.arrived = min(self.arrived, now)
        if self.has_dwelt(good.time):
            self.leg, self.arrived = self.leg + 1, np.inf

    def has_dwelt(self, time: float) -> bool:
        """Whether the stage has dwelt long enough at the goal of its leg."""
        dwell = DWELL_S if self.leg in self.ends else settling_time(self.settings)
        return time > self.arrived + dwell

    def reason_to_end(self, good: Sample, now: float) -> str:
        """The reason why the check must not go on; empty if there is none."""
        if now - self.first > LONGEST_S:
            return f"the check takes longer than {LONGEST_S:g} s"
        if good.apex is None or self.newest.doubt not in ("", STALE):
            return self.newest.doubt or "no pose"
        if not self.leg:
            return ""
        start, goal = self.goals[self.leg - 1 : self.leg + 1]
        moved = good.beam - self.mean(0)
        corners = np.array([goal if self.has_dwelt(good.time) else start, goal])
        self.is_surprised = not distance_to_box(moved, corners) <= SLACK_MM
        if not self.is_surprised:
            return ""
        return f"the beam has moved by {words(moved)} mm instead of {words(goal)} mm"

    def is_resumed(self, doubt: str, newest: Sample, now: float) -> bool:
        """Resume a check after a stall of the loop on a busy machine, but on no other request.

        The person who began the check is present, and no move is longer than STEP_MM.
        """
        self.request = "the check" if self.has_stalled and self.is_at_rest else ""
        return bool(self.request) and super().is_resumed(doubt, newest, now)

    def bridge(self, now: float) -> bool:
        """Wait without a command for up to WAIT_S while no samples come."""
        return self.newest.doubt in ("", STALE) and now - self.good.time < WAIT_S

    def axes(self) -> list[Axis]:
        """Compute the response of both axes."""
        responses = []
        for n in range(2):
            before, there, after = (self.mean(leg) for leg in self.ends[2 * n : 2 * n + 3])
            fraction = (2 * there - before - after) / (2 * STEP_MM)
            responses.append(
                response(n, fraction, self.delay(self.ends[2 * n + 2], n, fraction[n]))
            )
        return responses

    def mean(self, leg: int) -> Floats:
        """The mean place of the beam at the end of a leg (2,), mm."""
        last = self.beams[leg][-1][0]
        places: Floats = np.mean([b for t, b in self.beams[leg] if t > last - MEAN_S], axis=0)
        return places

    def delay(self, leg: int, axis: int, scale: float) -> float:
        """Time from a command to the light, s, by the beam's lag in the middle of a way back."""
        times = np.array([time for time, _ in self.commands[leg]])
        commanded = np.array([place[axis] for _, place in self.commands[leg]]) - self.origin[axis]
        taken = np.array([time for time, _ in self.beams[leg]])
        beam = np.array([place[axis] for _, place in self.beams[leg]]) - self.mean(leg)[axis]
        half = 0.5 / self.settings.rate  # a command lasts for one period
        at_command = np.interp(taken - half, times, commanded, left=STEP_MM)
        midst = (at_command > RAMP_PART[0] * STEP_MM) & (at_command < RAMP_PART[1] * STEP_MM)
        if not midst.any() or not scale:
            return float("nan")
        return float((beam / scale - at_command)[midst].mean() / self.narrow.speed)

    def faults(self) -> list[str]:
        """The reasons why the stage must not be used, in sentences; empty if there are none."""
        if not self.is_complete:
            why = self.error or self.envelope.latched or "the samples ended too soon"
            moved = " xy"[int(np.searchsorted(self.ends[::2], self.leg))]
            at = f" while the stage was to move along {moved}" if self.leg else ""
            return [f"the check was not completed{at}: {why}", *self.unexpected_response(moved)]
        if np.ptp(np.array(self.apexes), axis=0).max() > MAX_MIRROR_MM:
            return ["the mirror moved during the check: it must be at rest"]
        return [axis.fault for axis in self.axes() if axis.fault]

    def unexpected_response(self, name: str) -> list[str]:
        """The fault, in a list of one sentence or none, that the beam's unexpected place shows of
        the axis that was to move."""
        axis = "xy".find(name)
        way = float((self.encoder.place - self.origin)[axis])
        if not (self.is_surprised and way and self.goals[self.leg].any()):
            return []
        return [response(axis, (self.good.beam - self.mean(0)) / way, float("nan")).fault]
