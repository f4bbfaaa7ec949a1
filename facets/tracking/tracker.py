"""The loop that makes the beam follow, and the thread that watches over it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import Any, NamedTuple

import numpy as np

from ..core.errors import FacetsError
from ..core.settings import Stage as Settings
from ..core.units import Floats
from .control import Law, Seen
from .encoder import Encoder
from .envelope import AHEAD, Envelope
from .line import PATIENCE
from .priority import urgent
from .search import Search

#: How often the loop is watched, s.
WATCH = 0.02
#: Between these shares of the beam's power light is taken for the beam's.
LIT, BRIGHT = 0.02, 3.0


class Sample(NamedTuple):
    """What the tracker needs of one. time: on the host's clock; came: when it was told, s.
    powers: (3,) mW, infinite where a detector is saturated.  apex: (2,) mm, or None.  doubt: why
    nothing may follow it, or nothing."""

    time: float
    came: float
    powers: Floats
    apex: Floats | None
    doubt: str


STALLED = "the loop has stalled"
NOTHING = Sample(-np.inf, -np.inf, np.full(3, np.nan), None, "waiting for light")


def join(thread: threading.Thread) -> None:
    """Waits for a thread's end, a while, where there is something to wait for."""
    if thread.is_alive() and thread is not threading.current_thread():
        thread.join(timeout=PATIENCE + 1)


class Tracker:
    """Sends the stage after the newest good sample, for as long as that is fresh.

    A short gap is bridged: the stage follows the predicted motion, within the bounds of the
    envelope. Where the mirror is not met again by then, the stage stops, or looks for the mirror.

    A context: the threads run within it, and at its end the stage stands and its port is closed.
    It never raises in between: whatever goes wrong stops the stage, and is told in `error`.

    stopped: why nothing is followed, '' while something is.  bridging: whether what is followed is
    a prediction.  bridges: gaps that were bridged, so far.  moves: commands sent.  begun: when the
    first was, s.  note: what a person should be told.
    """

    def __init__(
        self,
        port: Any,
        settings: Settings,
        law: Law,
        say: Callable[..., None],
        search: bool = False,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """port: of the stage, open, or its name; see `Envelope`. Raises StageError where the stage
        can not be used."""
        self.settings, self.law, self.clock = settings, law, clock
        self.envelope = Envelope(port, settings, say, clock)
        self.tell = self.envelope.tell
        self.search = Search(settings) if search else None
        self.searching = self.bridging = False
        self.newest = self.good = NOTHING
        self.stopped, self.error, self.note = NOTHING.doubt, "", ""
        self.home = self.encoder.place
        self.moves = self.bridges = 0
        self.begun = np.inf
        self.ending = threading.Event()
        self.threads = [
            threading.Thread(target=self.loop, name="tracker", daemon=True),
            threading.Thread(target=self.watch, name="watchdog", daemon=True),
        ]

    @property
    def encoder(self) -> Encoder:
        """Where the stage last said that it was."""
        assert self.envelope.encoder is not None
        return self.envelope.encoder

    @property
    def state(self) -> str:
        """What the stage does, in words."""
        if self.searching:
            return f"searching: {self.stopped}"
        return self.stopped or ("bridging a gap" if self.bridging else "following")

    def __enter__(self) -> Tracker:
        for thread in self.threads:
            thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Stops the stage, ends the threads and closes the port; again if need be. Never raises."""
        self.ending.set()
        loop, watchdog = self.threads
        if loop.is_alive():
            self.envelope.cry()  # the loop may be waiting for the stage's word
            join(loop)
        if not self.envelope.close() and not self.error:
            self.error = "the stage did not answer when it was to stop at the end"
        join(watchdog)

    def feed(self, times: Floats, powers: Floats, apexes: Floats) -> None:
        """Takes samples: host times (n,) s, powers (n, 3) mW, infinite where a detector is
        saturated, apexes (n, 2) mm or NaN."""
        came = self.clock()
        if not len(times):
            return
        for row in range(len(times) - 1, -1, -1):
            sample = self.judge(float(times[row]), came, powers[row], apexes[row])
            if row == len(times) - 1:
                self.newest = sample
            if not sample.doubt:
                old = self.good  # times go back only where the board has begun anew
                if sample.time > old.time or came - old.came > self.settings.stale:
                    self.good = sample
                break

    def judge(self, taken: float, came: float, powers: Floats, apex: Floats) -> Sample:
        doubt, needs_pose = "", self.settings.law == "feedforward"
        if not came - self.settings.stale <= taken <= came + AHEAD:
            doubt = "no fresh sample"
        elif np.isposinf(powers).any():
            doubt = "a detector is saturated"
        elif not (np.isfinite(powers).all() and (powers > 0).all()):
            doubt = "not every detector has light"
        elif not LIT * self.law.power <= powers.max() <= BRIGHT * self.law.power:
            doubt = "light that is not the beam's"
        elif needs_pose and not np.isfinite(apex).all():
            doubt = "no pose"
        place = apex.copy() if np.isfinite(apex).all() else None
        return Sample(taken, came, powers.copy(), place, doubt)

    def loop(self) -> None:
        """Goes round at the rate of the settings until told to end, or until the first error."""
        period = 1 / self.settings.rate
        due = self.clock()
        with urgent():
            while not self.ending.is_set() and self.step():
                due = max(due + period, self.clock())
                self.ending.wait(max(0.0, due - self.clock()))

    def watch(self) -> None:
        with urgent():
            while not self.ending.wait(WATCH):
                self.envelope.watch()

    def step(self) -> bool:
        """Once round; False after an error, of any kind, by which time the stage was stopped."""
        if self.error:
            return False
        try:
            self.cycle()
        except Exception as error:
            self.error = self.stopped = words(error)
            self.envelope.fail(self.error)
            return False
        return True

    def cycle(self) -> None:
        place = self.envelope.look().place
        now = self.clock()
        good, newest = self.good, self.newest
        doubt = self.doubt(good, newest, place, now)
        if self.envelope.stalled:
            doubt = STALLED
        if doubt:
            if self.envelope.stalled or not self.bridge(now):
                self.pause(doubt, newest, place, now)
            return
        self.end_search("found")
        self.stopped = self.note = ""
        self.bridging, self.home = False, self.encoder.at(np.array([good.time]))[0]
        seen = Seen(good.time, now, good.powers, good.apex, place)
        self.go(self.law.command(seen), good.time)

    def bridge(self, now: float) -> bool:
        """Follows the predicted motion in a gap; whether that is possible."""
        if self.stopped not in ("", STALLED) or self.law.last is None:
            return False
        time, apex = self.law.last
        if now - time > self.settings.bridge:
            return False
        self.bridges += not self.bridging
        self.bridging, self.stopped = True, ""
        sent = self.envelope.bridge(self.law.ahead(now), time, apex)
        if sent is not None:
            self.count(sent, predicted=True)
        return True

    def doubt(self, good: Sample, newest: Sample, place: Floats, now: float) -> str:
        """Why nothing may move, or nothing."""
        stale = self.settings.stale
        if now - good.time <= stale and now - good.came <= stale:
            room = self.law.room + self.settings.max_speed * (now - good.time)
            if good.apex is not None and np.abs(good.apex - place).max() > room:
                return "the pose is further from the beam than its light allows"
            return ""
        if newest is NOTHING or now - newest.came > stale:
            return "waiting for light" if newest is NOTHING else "no fresh sample"
        return newest.doubt or "no fresh sample"

    def go(self, place: Floats, sampled: float, search: Search | None = None) -> None:
        sent = self.envelope.go(place, sampled, search.limits if search else None)
        if sent is not None:  # else it took too long: the next round asks again, and may stop
            self.count(sent)

    def count(self, sent: Floats, **more: Any) -> None:
        self.moves += 1
        self.begun = min(self.begun, self.clock())
        self.tell("move", x=round(float(sent[0]), 6), y=round(float(sent[1]), 6), **more)

    def pause(self, reason: str, newest: Sample, place: Floats, now: float) -> None:
        """Stands still, or looks for the mirror where that was asked for."""
        fresh = now - newest.time <= self.settings.stale and newest.doubt != "no fresh sample"
        fresh = fresh and not np.isnan(newest.powers).any()
        search = self.search if fresh and self.moves > 0 else None
        towards = None
        if search is not None:
            beam = self.encoder.at(np.array([newest.time]))[0]
            towards = self.law.towards(newest.powers, beam, LIT)
            search = None if search.is_over(towards is not None) else search
        if self.envelope.stalled or (not search and (self.envelope.moving or not self.stopped)):
            self.envelope.halt(reason)
        self.law.forget(since=now - self.settings.bridge)
        self.stopped, self.bridging = reason, False
        if search is not None:
            self.look_for(search, newest, place, towards)

    def look_for(
        self, search: Search, newest: Sample, place: Floats, towards: Floats | None
    ) -> None:
        if not self.searching:
            self.searching = True
            at = {"x": round(float(place[0]), 6), "y": round(float(place[1]), 6)}
            self.tell("search", reason=self.stopped, **at)
        goal = search.next(place, towards, self.home)
        if goal is None:
            self.end_search(search.outcome)
            self.envelope.halt(search.outcome)
        else:
            self.go(goal, newest.time, search)

    def end_search(self, outcome: str) -> None:
        """Tells how a search ended, if there was one. One that failed is not begun again."""
        if self.searching:
            self.tell("search ended", outcome=outcome)
        self.searching = False
        if self.search is not None and outcome == "found":
            self.search.forget()
        elif self.search is not None:
            self.note = outcome


def words(error: Exception) -> str:
    """What a person is told of an error of any kind."""
    if isinstance(error, FacetsError):
        return str(error)
    if isinstance(error, OSError):  # pyserial's errors are of this kind, too
        return f"the stage's line went away: {error}"
    return f"tracking failed by an error of its own, {type(error).__name__}: {error}"
