"""The loop that makes the beam follow the mirror, and the thread that watches the loop.

Places (2,) are in mm, times in s on the run's clock. Any error stops the stage; the loop ends
unless the stage's line can be opened again.
"""

from __future__ import annotations

import threading
from typing import Any, NamedTuple, Self

import numpy as np

from ..core.errors import FacetsError
from ..core.units import Floats
from .control import ControlInput, Law
from .encoder import Encoder
from .envelope import MAX_AHEAD_S, Envelope
from .interlock import BoardPermit
from .line import PATIENCE_S
from .priority import urgent
from .search import Search

#: Time between two checks whether the loop is stalled, s.
WATCH_INTERVAL_S = 0.02
#: Smallest and largest power of light that comes from the beam, as fractions of the beam's power.
MIN_LIGHT_FRACTION, MAX_LIGHT_FRACTION = 0.02, 3.0


class Sample(NamedTuple):
    """One sample for the tracker.

    time, came: of the sample and of its arrival, on the host's clock, s.  powers: (3,) mW, infinite
    where a detector is saturated.  apex: (2,) mm, or None.  beam: (2,) its place by the readings,
    mm, or NaN.  doubt: why the stage may not follow the sample, or ''.
    """

    time: float
    came: float
    powers: Floats
    apex: Floats | None
    beam: Floats
    doubt: str


class SolvedSamples(NamedTuple):
    """Samples in the order of their times, as they come to the tracker.

    times: (n,) on the host's clock, s.  powers: (n, 3) mW, infinite where a detector is saturated.
    apexes: (n, 2) mm or NaN.  beams: (n, 2) the beam's places by the readings, mm or NaN; None if
    these were not solved for.
    """

    times: Floats
    powers: Floats
    apexes: Floats
    beams: Floats | None = None


NO_BEAM = np.full(2, np.nan)
NOTHING = Sample(-np.inf, -np.inf, np.full(3, np.nan), None, NO_BEAM, "waiting for light")
STALE = "no fresh sample"
#: Time for which poses must have been found before `stage.resume: auto` ends a stop, s.
FOUND_S = 0.05
#: If the first good sample comes later than this after the start, a person must resume, s.
START_WITHIN_S = 10.0


def join(thread: threading.Thread) -> None:
    """Wait a limited time for a thread's end; do nothing if the thread is not alive."""
    if thread.is_alive() and thread is not threading.current_thread():
        thread.join(timeout=PATIENCE_S + 1)


class Tracker:
    """The loop that sends the stage after the newest good sample, while this sample is fresh.

    In a short gap the stage follows the predicted motion, within the bounds of the envelope. If no
    good sample ends the gap, the stage stops and stays stopped until `resume` is called; then it
    follows, or searches for the mirror. It begins stopped if the first fresh sample is not good.

    A context: the threads run within it, and at its end the stage is stopped and its port is
    closed. Faults within it raise nothing: they stop the stage, and `error` describes them.

    bridging: whether the followed motion is a prediction.  bridges: number of bridged gaps.  moves:
    number of commands.  begun: time of the first, s.
    """

    def __init__(self, envelope: Envelope, law: Law) -> None:
        """Follow with an open stage."""
        self.envelope, self.law, self.report = envelope, law, envelope.report
        self.settings, self.clock = envelope.settings, envelope.clock
        self.search = Search(self.settings) if self.settings.search_distance else None
        self.started = self.searching = self.bridging = False
        self.newest = self.good = NOTHING
        self.error = self.refused = self.request = self.offer = self.distrust = ""
        self.home = self.encoder.place
        self.halted, self.late, self.found_since = "", 0.0, np.inf
        self.moves = self.bridges = 0
        self.first = self.begun = np.inf
        self.ending = threading.Event()
        self.threads = [
            threading.Thread(target=self.loop, name="tracker", daemon=True),
            threading.Thread(target=self.watch, name="watchdog", daemon=True),
        ]

    @property
    def encoder(self) -> Encoder:
        """The last position of the stage."""
        assert self.envelope.encoder is not None
        return self.envelope.encoder

    @property
    def stop_reason(self) -> str:
        """The reason why the stage does not follow; '' while it follows."""
        return self.envelope.latched or ("" if self.started else NOTHING.doubt)

    @property
    def is_resumable(self) -> bool:
        """Whether a person can end a stop."""
        return not self.envelope.lost_reference

    @property
    def state(self) -> str:
        """The state of the stage, in words."""
        if self.envelope.latched:
            return f"stopped: {self.envelope.latched}"
        if self.searching:
            return "searching"
        return self.stop_reason or ("bridging a gap" if self.bridging else "following")

    @property
    def note(self) -> str:
        """A message for the user: why a resume was refused, and whether one would search."""
        return "; ".join(filter(None, (self.refused, self.offer)))

    def resume(self, by: str) -> None:
        """Ask the loop, from any thread, to let a stopped stage move again.  by: who resumes."""
        self.request = by

    def halt(self, reason: str) -> None:
        """Ask the loop, from any thread, to stop the stage until a person resumes."""
        self.halted = reason

    def __enter__(self) -> Self:
        for thread in self.threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Stop the stage, end the threads and close the port; may be called again. Never raises."""
        self.ending.set()
        loop, watchdog = self.threads
        if loop.is_alive():
            self.envelope.emergency_stop()  # the loop may be waiting for the stage's answer
            join(loop)
        if not self.envelope.close() and not self.error:
            self.error = "the stage did not answer when it was to stop at the end"
        join(watchdog)

    def take_permit(self, time: float, is_permitted: bool) -> None:
        """Take the board's permit of samples, before they are solved: the time of the last one, s,
        and whether all of them have it."""
        if isinstance(self.envelope.permit, BoardPermit):
            self.envelope.permit.take(time, is_permitted)

    def feed(self, samples: SolvedSamples, late: float = 0.0, doubt: str = "") -> None:
        """Take samples.  late: how much earlier than their times they may have been taken, s.
        doubt: why the stage may not follow them, or ''."""
        came = self.clock()
        if not len(samples.times):
            return
        times, self.late, self.distrust = samples.times - late, late, doubt
        for row in range(len(times) - 1, -1, -1):
            beam = NO_BEAM if samples.beams is None else samples.beams[row]
            sample = self.screen_sample(
                float(times[row]), came, samples.powers[row], samples.apexes[row], beam
            )
            if row == len(times) - 1:
                self.newest = sample
            if not sample.doubt:
                old = self.good  # an earlier time means that the board has restarted
                if sample.time > old.time or came - old.came > self.settings.stale:
                    self.good = sample
                break

    def screen_sample(
        self, taken: float, came: float, powers: Floats, apex: Floats, beam: Floats
    ) -> Sample:
        """Make a sample with the reason to doubt it, empty for a good one. taken, came: times, s.
        powers: (3,), mW. apex, beam: (2,), mm."""
        doubt, needs_pose = "", self.settings.law == "feedforward"
        if not came - self.settings.stale <= taken <= came + MAX_AHEAD_S:
            doubt = STALE
        elif np.isposinf(powers).any():
            doubt = "a detector is saturated"
        elif not (np.isfinite(powers).all() and (powers > 0).all()):
            doubt = "not every detector has light"
        elif (
            not MIN_LIGHT_FRACTION * self.law.power
            <= powers.max()
            <= MAX_LIGHT_FRACTION * self.law.power
        ):
            doubt = "light that does not come from the beam"
        elif needs_pose and not np.isfinite(apex).all():
            doubt = "no pose"
        else:
            doubt = self.distrust
        place = apex.copy() if np.isfinite(apex).all() else None
        return Sample(taken, came, powers.copy(), place, beam.copy(), doubt)

    def loop(self) -> None:
        """Run at the rate of the settings until the end is requested, or until the first error."""
        period = 1 / self.settings.rate
        due = self.clock()
        with urgent():
            while not self.ending.is_set() and self.step():
                due = max(due + period, self.clock())
                self.ending.wait(max(0.0, due - self.clock()))

    def watch(self) -> None:
        """Let the envelope watch the loop until the end; runs in its own thread."""
        with urgent():
            while not self.ending.wait(WATCH_INTERVAL_S):
                self.envelope.watch()

    def step(self) -> bool:
        """Run one cycle; every error stops the stage. Returns False if nobody can resume."""
        try:
            if not self.error:
                self.cycle()
            elif self.request and self.envelope.open_again:
                self.envelope.reopen()
                self.error = ""  # the stage stays stopped until the readings have been checked
        except Exception as error:
            self.error, self.request = words(error), ""
            self.envelope.fail(self.error)
        return not self.error or self.envelope.open_again is not None

    def cycle(self) -> None:
        """One period of the loop: read the stage, look for doubts, and send a command or stop."""
        place = self.envelope.look().place
        reason, self.halted = self.halted, ""
        if reason:
            self.envelope.latch(reason)
        now = self.clock()
        self.first = min(self.first, now)
        good, newest = self.good, self.newest
        doubt = self.doubt(good, newest, place, now)
        if not doubt:
            self.envelope.compare(good.time, good.beam)
        if self.envelope.latched and not self.is_resumed(doubt, newest, now):
            self.end_search(self.envelope.latched)
            self.offer = self.search_offer(doubt, newest, now)
            return
        self.request = self.offer = ""
        if not doubt:
            self.end_search("found")
            self.started, self.bridging, self.refused = True, False, ""
            self.home = self.encoder.places(np.array([good.time]))[0]
            self.follow(good, place, now)
        elif not self.started:
            self.wait(doubt, newest, now)
        elif self.searching and self.can_search(newest, now):
            self.look_for(newest, place)
        elif self.searching or not self.bridge(now):
            self.stop(doubt)

    def follow(self, good: Sample, place: Floats, now: float) -> None:
        """Send the stage after a good sample. place: the stage's (2,), mm."""
        measured = ControlInput(good.time, now, good.powers, good.apex, place)
        self.go(self.law.command(measured), good.time)

    def stop(self, reason: str) -> None:
        """Stop the stage for lack of good samples."""
        self.bridging = False
        self.envelope.latch(reason, is_for_auto=True)
        self.end_search(reason)

    def wait(self, doubt: str, newest: Sample, now: float) -> None:
        """Wait for the first good sample; a fresh sample that is not good stops the stage."""
        if self.is_fresh(newest, now):
            self.stop(doubt)
        elif now - self.first > START_WITHIN_S:
            self.stop(f"no fresh sample came in the first {START_WITHIN_S:g} s")

    def is_fresh(self, newest: Sample, now: float) -> bool:
        """Whether the newest sample was taken and came within `stale` of now, s."""
        fresh = now - newest.time <= self.settings.stale and newest.doubt != STALE
        return fresh and now - newest.came <= self.settings.stale

    def can_search(self, newest: Sample, now: float) -> bool:
        """Whether a search may continue, for which the light must be known."""
        is_known = self.is_fresh(newest, now) and not np.isnan(newest.powers).any()
        return is_known and self.search is not None and not self.distrust

    def search_offer(self, doubt: str, newest: Sample, now: float) -> str:
        """The search that a resume would begin, in words; '' if it would begin none."""
        if not doubt or self.search is None or not self.can_search(newest, now):
            return ""
        return f"a resume searches for the mirror {self.search.scope}"

    def is_found(self, doubt: str) -> bool:
        """Whether poses have been found for a while; to be asked in each cycle."""
        is_pose = not doubt and self.good.apex is not None
        self.found_since = min(self.found_since, self.good.time) if is_pose else np.inf
        return self.good.time - self.found_since >= FOUND_S

    def is_resumed(self, doubt: str, newest: Sample, now: float) -> bool:
        """Whether a stopped stage may move again, by a person's request or by `stage.resume`."""
        by, self.request = self.request, ""
        if not by:
            if not (self.is_found(doubt or newest.doubt) and self.envelope.resume_by_itself()):
                return False
        elif refusal := (
            doubt if doubt and not self.can_search(newest, now) else self.envelope.resume(by)
        ):
            self.refused = f"the stage was not resumed: {refusal}"
            self.report("resume refused", by=by, reason=refusal)
            return False
        self.law.forget()
        self.started, self.bridging, self.refused, self.found_since = True, False, "", np.inf
        if doubt and self.search:
            self.search.forget()
            self.searching = True
            x, y = self.encoder.place.round(6).tolist()
            self.report("search", reason=doubt, x=x, y=y)
        return True

    def bridge(self, now: float) -> bool:
        """Follow the predicted motion in a gap; return whether that is possible."""
        if self.law.last is None or self.distrust:
            return False
        time, apex = self.law.last
        if now - time > self.settings.bridge:
            return False
        self.bridges += not self.bridging
        self.bridging = True
        sent = self.envelope.bridge(self.law.predict_apex(now), time, apex)
        if sent is not None:
            self.count(sent, predicted=True)
        return True

    def doubt(self, good: Sample, newest: Sample, place: Floats, now: float) -> str:
        """The reason why the stage may not move; empty if there is none."""
        if self.distrust:  # it makes the predicted motion unreliable, too
            return self.distrust
        stale = self.settings.stale
        if now - good.time <= stale and now - good.came <= stale:
            clearance = self.law.clearance + self.settings.max_speed * (now - good.time)
            if good.apex is not None and np.abs(good.apex - place).max() > clearance:
                return "the pose is farther from the beam than its light allows"
            return ""
        if newest is NOTHING:
            return newest.doubt
        if newest.doubt not in ("", STALE) and now - newest.came <= stale:
            return newest.doubt
        return f"{STALE}: all come {1e3 * self.late:.0f} ms late" if self.late > stale else STALE

    def go(self, place: Floats, sampled: float, search: Search | None = None) -> None:
        """Send the stage to a place (2,), mm, if the sample's time allows it. sampled: s."""
        sent = self.envelope.go(place, sampled, search.limits if search else None)
        if sent is not None:  # otherwise the cycle took too long, and the next one decides again
            self.count(sent)

    def count(self, sent: Floats, **more: Any) -> None:
        """Count and report a command that was sent to a place (2,), mm."""
        self.moves += 1
        self.begun = min(self.begun, self.clock())
        self.report("move", x=round(float(sent[0]), 6), y=round(float(sent[1]), 6), **more)

    def look_for(self, newest: Sample, place: Floats) -> None:
        """Search for the mirror; the search ends with a stop when it finds no place."""
        assert self.search is not None
        beam = self.encoder.places(np.array([newest.time]))[0]
        towards = self.law.locate_apex(newest.powers, beam, MIN_LIGHT_FRACTION)
        goal = self.search.next(self.clock(), place, towards, self.home)
        if goal is None:
            self.stop(self.search.outcome)
        else:
            self.go(goal, newest.time, self.search)

    def end_search(self, outcome: str) -> None:
        """Report how a search ended, if there was one."""
        if self.searching:
            self.report("search ended", outcome=outcome)
        self.searching = False


def words(error: Exception) -> str:
    """Describe an error of any kind for the user."""
    if isinstance(error, FacetsError):
        return str(error)
    if isinstance(error, OSError):  # this includes pyserial's errors
        return f"the stage's line went away: {error}"
    return f"tracking failed with an internal error, {type(error).__name__}: {error}"
