"""The safety envelope, the only path of commands to a stage.

Each command is a short move to a place at most `Limits.reach` from the stage's place, within the
soft limits. It is made from a fresh sample and a fresh place, on a stage whose own speed and
acceleration are bounded. Without commands a stage comes to rest by itself, at most `stopping_time`
after the last good sample, even with the cable pulled or the process dead. Any doubt stops it
sooner. A short gap between samples may be bridged by predicted places, but only for
`stage.bridge_ms` after the last good sample, and only within `stage.bridge_mm` of the mirror's
place then. Beyond either limit it stops.

Every stop latches: nothing is sent until somebody resumes, even if all becomes good again. The
external permit and the heartbeat, if configured, are needed for every command, and a stage that
does not go where it is sent is stopped (`arrival`).

Places (2,) are in mm, times in s on the run's clock.
"""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np

from ..core.settings import Stage as Settings
from ..core.units import Floats
from .arrival import (
    MAX_PLACE_AGE_S,
    POSITION_SLACK_MM,
    Arrival,
    distance_to_box,
    settling_time,
    words,
)
from .drivers import RESTORE_LIMITS, Driver, open_driver
from .encoder import Encoder
from .interlock import ALWAYS, Heartbeat, Permit, close_line, open_permit
from .limits import Limits
from .native_limits import NativeLimits
from .stage import StageError

#: The watchdog stops the stage if its loop makes no step for this time, s.
STALL_S = 0.1
#: A slow loop counts as stalled only after this number of its periods.
STALL_PERIODS = 5
#: Time between two commands to stop a stage whose loop is stalled, s.
STOP_REPEAT_INTERVAL_S = 0.1
#: A sample whose time is later than the clock's by more than this is not used, s.
MAX_AHEAD_S = 2e-3
#: Number of attempts to stop a stage that does not answer.
STOP_ATTEMPTS = 3
#: Each attempt to stop waits up to this time for the stage's answer, s.
STOP_WAIT_S = 0.5
#: Time for which a stage is stopped before `stage.resume: auto` ends the stop, s.
AUTO_RESUME_AFTER_S = 1.0
HOUR_S = 3600.0
STALLED = "the loop has stalled"


def stopping_time(settings: Settings) -> float:
    """The longest time after the last good sample for which a stage can move, s.

    A command comes at most `stale` after its sample, a predicted one at most `bridge`.
    """
    return max(settings.stale, settings.bridge) + settling_time(settings)


class Envelope:
    """The only user of a stage's driver, which it opens, limits and closes.

    port: open; for `stage.driver: other` its name.  say: called with an event's name and its
    values, by the threads that protect: it should return at once, and delays no stop if it does
    not.  open_again: returns the port again after a fault.  failed: whether the line is closed.
    latched: the reason of a stop until somebody resumes, otherwise ''.  stops: their number.
    lost_reference: the reason why nobody can resume a stage that came back at another place, or ''.
    """

    def __init__(
        self,
        port: Any,
        settings: Settings,
        say: Callable[..., None],
        clock: Callable[[], float],
        open_again: Callable[[], Any] | None = None,
    ) -> None:
        """Stop the stage, bound its speed and read its place; close the port if that fails."""
        self.settings, self.say, self.clock = settings, say, clock
        self.limits, self.arrival = Limits.from_settings(settings), Arrival(settings)
        self.open_again = open_again
        self.failed = self.moving = self.stalled = self.closed = False
        self.latched, self.latched_at, self.is_for_auto = "", -math.inf, False
        self.stops, self.lost_reference = 0, ""
        self.resumed: deque[float] = deque()
        self.permit: Permit = ALWAYS
        self.heartbeat: Heartbeat | None = None
        self.beat = clock()
        self.emergency_stop_at = -math.inf
        self.sent: tuple[float, Floats] | None = None
        self.encoder: Encoder | None = None
        self.ending = threading.Lock()
        self._driver: Driver = open_driver(port, settings, clock)
        self._prepare()

    def _prepare(self) -> None:
        """Open the permit and the heartbeat, and prepare the driver; stop the stage and raise again
        if anything fails."""
        s = self.settings
        try:
            if self.permit is ALWAYS and s.permit:
                self.permit = open_permit(s.permit, s.stale)
            if not self.heartbeat and s.heartbeat:
                self.heartbeat = Heartbeat(s.heartbeat)
            self._driver.prepare()
            self.arrival.begin(self.look(forget_place=True).place)
        except BaseException:
            self._stop_by_every_means()
            raise

    def look(self, forget_place: bool = False) -> Encoder:
        """Read the stage's place; stop the stage if the place, permit or heartbeat requires a stop.

        forget_place: the line was just opened. Raises `StageError` for an impossible place.
        """
        self.beat = before = self.clock()
        place = self._driver.place()
        self.beat = after = self.clock()
        self._refuse_place(place)
        if forget_place and self.encoder:
            self._compare_reference(self.encoder.place, place)
        earlier = None if forget_place else self.encoder
        now = (before + after) / 2
        speed = np.zeros(2) if earlier is None else self._speed(earlier, now, after, place)
        self.encoder = Encoder(now, place, speed)
        if self.stalled:
            self.latch(STALLED, is_for_auto=True)
        if earlier is not None and not self.latched:
            self._require(self.arrival.complaint(before, place))
        self._require_permits(after)
        return self.encoder

    def _refuse_place(self, place: Floats) -> None:
        """Raise `StageError` for a place, mm, that is not finite or lies outside the soft
        limits."""
        if np.shape(place) != (2,) or not np.isfinite(place).all():
            raise StageError(f"the stage's driver gives an invalid position: {place}")
        low = np.array(self.limits.low) - POSITION_SLACK_MM
        high = np.array(self.limits.high) + POSITION_SLACK_MM
        if (place < low).any() or (place > high).any():
            raise StageError(
                f"the stage is at {(place - self.settings.zero).round(3).tolist()} mm, outside "
                "its soft limits (stage.low_mm, stage.high_mm); bring it back by its maker's "
                "program"
            )

    def _speed(self, earlier: Encoder, now: float, after: float, place: Floats) -> Floats:
        """The stage's speed since an earlier place (2,), mm/s; raises `StageError` for a jump."""
        s = self.settings
        most = 1.5 * s.max_speed * (after - earlier.time) + POSITION_SLACK_MM + s.step
        if np.abs(place - earlier.place).max() > most:
            raise StageError(
                f"the stage jumped from {earlier.place.round(3).tolist()} to "
                f"{place.round(3).tolist()} mm: was it restarted, or moved by another program?"
            )
        passed = now - earlier.time
        speed = (place - earlier.place) / passed if passed > 1e-4 else earlier.speed
        return np.clip(speed, -s.max_speed, s.max_speed)

    def _compare_reference(self, last: Floats, place: Floats) -> None:
        """Refuse every resume if the stage's place is neither that before its line was closed nor
        one that it was sent to then.

        last, place: (2,), mm, before and after. The soft limits may have moved with the reference.
        """
        sent = [goal for _, goal in (*self.arrival.goals, *filter(None, [self.sent]))]
        if (
            distance_to_box(place, np.array([last, *sent])) > self.arrival.slack
            and not self.lost_reference
        ):
            self.lost_reference = self.latched = (
                f"its controller may have lost its reference: the stage was at {words(last)} mm "
                f"before its line was closed, and says {words(place)} mm now; home it and begin "
                "a new run"
            )
            self.report("stop", reason=self.latched)

    def _require_permits(self, now: float) -> None:
        """Stop the stage without the external permit, or if no heartbeat can be sent."""
        if self.permit.allows_motion(now) is False:
            self._require("the external permit is not given")
        if self.heartbeat:
            self.heartbeat.beat(now, not self.latched)
            if self.moving and not self.heartbeat.is_sent:
                self._require(f"the heartbeat cannot be sent ({self.settings.heartbeat})")

    def _require(self, complaint: str) -> None:
        """Stop the stage for a complaint, if any, so that only a person can resume."""
        if complaint and (not self.latched or self.is_for_auto):
            self.latch(complaint)

    def compare(self, time: float, beam: Floats) -> None:
        """Stop a stage whose encoder disagrees with the beam's place (2,), mm, by the readings of a
        time, s."""
        if self.encoder and not self.latched and np.isfinite(beam).all():
            self._require(self.arrival.compare(self.clock(), beam, self.encoder, time))

    def go(self, target: Floats, sampled: float, limits: Limits | None = None) -> Floats | None:
        """Send the stage towards a place (2,) within the limits; return the commanded place.

        sampled: time of the sample that gave the place, s.  limits: narrower ones. Returns None,
        without a command, if the sample or the stage's place is not fresh.
        """
        self.beat = now = self.clock()
        held = self._allow(target, now, limits or self.limits)
        if held is None or not -MAX_AHEAD_S <= now - sampled <= self.settings.stale:
            return None
        return self._send(held, now)

    def bridge(self, target: Floats, sampled: float, origin: Floats) -> Floats | None:
        """Send the stage towards a predicted place (2,), as `go` does; return the place or None.

        sampled: time of the last good sample, s.  origin: the mirror's place then (2,), mm;
        commands stay within the configured distance of that place.
        """
        self.beat = now = self.clock()
        most = self.settings.bridge_distance
        away = float(np.hypot(*(target - origin)))
        near = origin + (target - origin) * min(1.0, most / away) if away > 0 else target
        held = self._allow(near, now, self.limits)
        if held is None or not -MAX_AHEAD_S <= now - sampled <= self.settings.bridge:
            return None
        if np.hypot(*(held - origin)) > most:  # the stage itself is further away
            return None
        return self._send(held, now)

    def _allow(self, target: Floats, now: float, narrow: Limits) -> Floats | None:
        """The allowed place (2,) nearest to `target`, mm; None if no command is allowed now. Raises
        `StageError` for a target that is not finite."""
        at = self.encoder
        if not np.isfinite(target).all():
            raise StageError("the stage was to be sent to a position that is not a number")
        if self.latched or self.failed or at is None or now - at.time > MAX_PLACE_AGE_S:
            return None
        if not self.permit.allows_motion(now) or (
            self.heartbeat and not self.heartbeat.is_heard(now)
        ):
            return None
        held = self.limits.hold(narrow.hold(target, at.place), at.place)
        return self._limit_speed(held, now, at, min(narrow.speed, self.limits.speed))

    def _send(self, held: Floats, now: float) -> Floats:
        """Send the stage to a place (2,), mm, without a further check, and return it."""
        self.moving, self.sent = True, (now, held)
        self._driver.move(held)
        self.beat = self.clock()
        self.arrival.send(held, self.beat)
        return held

    def _limit_speed(self, held: Floats, now: float, at: Encoder, speed: float) -> Floats:
        """Limit a command (2,), mm, to the distance from the last one that the allowed speed
        covers."""
        period = 1 / self.settings.rate
        last, passed = at.place, period
        if self.sent is not None:
            last, passed = self.sent[1], min(now - self.sent[0], 2 * period)
        far = speed * max(passed, 0.0)
        slow = last + np.clip(held - last, -far, far)
        return self.limits.hold(slow, at.place)

    def latch(self, reason: str, is_for_auto: bool = False) -> None:
        """Stop the stage, wait for its answer, and keep it stopped until somebody resumes.

        is_for_auto: whether `stage.resume: auto` may end this stop.
        """
        self._begin_stop(reason, is_for_auto)
        self.sent = None
        self._driver.stop()
        self.moving = self.stalled = False
        self.beat = self.clock()

    def _begin_stop(self, reason: str, is_for_auto: bool) -> None:
        """Latch, command the stage to stop, and only then report the first reason of a stop.

        A later reason may require a person to resume.
        """
        is_first = not self.latched
        self.is_for_auto = is_for_auto and (self.is_for_auto or is_first)
        if is_first:
            self.latched, self.latched_at = reason, self.clock()
            self.stops += 1
        self.emergency_stop()
        if is_first:
            self.report("stop", reason=reason)

    def resume(self, by: str) -> str:
        """Let the stage move again; return the reason of a refusal, or ''.  by: who resumes."""
        now = self.clock()
        if self.failed or self.lost_reference:
            return self.lost_reference or "its line is closed"
        self.permit.was_lost = False
        if not self.permit.allows_motion(now):
            return "the external permit is not given"
        if now - self.latched_at < self.arrival.patience:
            return "it was stopped just now"
        assert self.encoder is not None
        self.report("resume", by=by, reason=self.latched)
        self.arrival.begin(self.encoder.place)
        self.latched, self.sent = "", None
        return ""

    def resume_by_itself(self) -> bool:
        """End a stop if `stage.resume: auto` allows it; return whether the stop ended."""
        s, now = self.settings, self.clock()
        while self.resumed and now - self.resumed[0] > HOUR_S:
            self.resumed.popleft()
        if not (s.resume == "auto" and self.is_for_auto) or len(self.resumed) >= s.resumes_per_hour:
            return False
        if now - self.latched_at < AUTO_RESUME_AFTER_S or self.resume("auto"):
            return False
        self.resumed.append(now)
        return True

    def reopen(self) -> None:
        """Open the line again after a fault; keep the stage stopped. Raises an error on failure."""
        assert self.open_again is not None
        driver = open_driver(self.open_again(), self.settings, self.clock)
        with self.ending:
            if self.closed:
                driver.close()
                return
            if isinstance(driver, NativeLimits) and isinstance(self._driver, NativeLimits):
                driver.original = self._driver.original
            self._driver, self.failed = driver, False
        self._prepare()

    def watch(self) -> None:
        """Stop a stage whose loop has stalled; another thread calls this function repeatedly."""
        patience = max(STALL_S, STALL_PERIODS / self.settings.rate)
        if self.failed or not self.moving or self.clock() - self.beat < patience:
            return
        if self.clock() - self.emergency_stop_at < STOP_REPEAT_INTERVAL_S:
            return
        self.emergency_stop_at, self.stalled = self.clock(), True
        self._begin_stop(STALLED, is_for_auto=True)

    def fail(self, reason: str) -> None:
        """Stop the stage by every remaining means, and close its line. Never raises."""
        with self.ending:
            if not self.failed:
                self._begin_stop(reason, is_for_auto=False)
                self._stop_by_every_means()
                self.report("stage error", reason=reason)

    def close(self, reason: str = "end") -> bool:
        """Stop the stage finally, and close its port. Never raises. Returns False if the stage did
        not answer, so that it may still move."""
        with self.ending:
            was_closed, self.closed = self.closed or self.failed, True
            answered = was_closed or self._stop_by_every_means()
            close_line(self.permit)
            close_line(self.heartbeat)
            if not was_closed:
                self.report("stop", reason=reason)
            return answered

    def emergency_stop(self) -> None:
        """Stop at once, without waiting for an answer; from any thread. Never raises."""
        with suppress(Exception):
            self._driver.emergency_stop()

    def _stop_by_every_means(self) -> bool:
        """Repeat the stop until it is answered; close the port. Never raises. False: no answer."""
        self.failed, failures = True, list[str]()
        for _ in range(STOP_ATTEMPTS):
            try:
                self._driver.emergency_stop()
                self._driver.stop(patience=STOP_WAIT_S)
                self.moving = False
                getattr(self._driver, RESTORE_LIMITS, lambda: None)()
                break
            except Exception as error:
                failures.append(str(error) or type(error).__name__)
        with suppress(Exception):
            self._driver.close()
        for reason in failures:
            self.report("stop not answered", reason=reason)
        return len(failures) < STOP_ATTEMPTS

    def report(self, name: str, **more: Any) -> None:
        """Report an event; a failure to record the event must not delay a stop."""
        with suppress(Exception):
            self.say(name, **more)
