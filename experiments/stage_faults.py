"""Test the whole tracker with random sequences of faults and check the stage's motion.

Drivers, envelope, search and tracker run unchanged against the virtual controllers, over a wire in
memory and on a simulated clock. Whatever fault occurs in samples, wire, controller or loop, the
stage stays within its soft limits and its speed limit, follows a prediction no longer and no
further from a good sample than the settings allow, and stands still within `stopping_time` of the
last sample that it may follow and of every fault that ends tracking. Every stop latches: nothing is
sent before somebody resumes. A controller that disobeys is detected by comparison with a second,
obedient stage; it can take the stage out of its limits by no more than `excursion`.

`python -m facets.experiments.stage_faults 5000 --seed 1` prints the counts as JSON; an error names
the seed of a sequence that fails. `--bytes` pulls the cable at each byte instead.
"""

from __future__ import annotations

import json
import sys
from collections import Counter, deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

import facets
from facets.core.settings import Stage as Settings
from facets.core.units import Floats
from facets.live.virtual.stages import PiController, ZaberDevice
from facets.tracking.arrival import MAX_PLACE_AGE_S, POSITION_SLACK_MM, settling_time
from facets.tracking.control import Law
from facets.tracking.envelope import stopping_time
from facets.tracking.limits import Limits
from facets.tracking.line import POLL_S
from facets.tracking.stage import StageError, StageModel
from facets.tracking.tracker import Tracker

CONFIG = facets.load("bench")
#: Ratio of the stage's own largest speed and acceleration to the settings' limits.
FASTER = 5.0
#: Steps of the simulated time, intervals of samples, and intervals of the watchdog, s.
TICK_S, SAMPLE_S, WATCH_S = 2e-3, 5e-3, 0.02
#: Largest distance that rounding to the stage's native unit carries it beyond a border, mm.
ROUNDING_MM = 1e-3
#: Largest relative increase of a speed by the same rounding.
ROUNDING_SHARE = 1e-2
#: Speed below which the stage counts as standing still, mm/s.
STILL_MM_S = 0.05

DATA = ("silence", "late", "nan", "garbage", "jump", "dark", "one dark", "clock")
WIRE = ("slow", "flip", "partial", "repeat", "unplug")
STAGE = ("refuse", "jam", "restart")
PROGRAM = ("stall", "bug", "disk full")
#: Controllers that accept a move and do another one, are moved by somebody else, or whose axes x
#: and y are exchanged, by the controller or by whoever laid the cables.
CONTROLLER = ("ignore", "backwards", "tenfold", "foreign", "swapped", "miswired")
KINDS = (*DATA, *WIRE, *STAGE, *PROGRAM, *CONTROLLER, "no permit")
#: Distance between the stage and an obedient one, mm, above which the tracker must stop.
FOUND_OUT_MM = 0.2
#: Largest motion commanded by somebody else, mm, and rate at which a person resumes, 1/s.
FOREIGN_MM, RESUMES_HZ = 1.0, 4.0


def excursion(settings: Settings) -> float:
    """Largest distance that a disobedient controller moves before it stands still, mm.

    It moves by `POSITION_SLACK_MM` unnoticed, then at the largest speed until the loop has asked
    for its position, received the answer and sent a stop; then it brakes.
    """
    s = settings
    noticed = 1 / s.rate + 2 * MAX_PLACE_AGE_S + s.latency
    return POSITION_SLACK_MM + s.step + s.max_speed * (noticed + s.max_speed / (2 * s.acceleration))


class Broken(BaseException):  # the tested code must not catch it
    """The stage left its envelope."""


@dataclass
class Fault:
    """kind, begin and end, s. amount: the random number that this kind needs, 0 to 1."""

    kind: str
    begin: float
    end: float
    amount: float


@dataclass
class Tried:
    """Counts of the sequences and their events, and the largest values reached."""

    sequences: int = 0
    refused_at_start: int = 0
    moves: int = 0
    stops: int = 0
    searches: int = 0
    predictions: int = 0
    found_again: int = 0
    resumes: int = 0
    auto_resumes: int = 0
    refused_resumes: int = 0
    steps: int = 0
    faults: Counter[str] = field(default_factory=Counter)
    drivers: Counter[str] = field(default_factory=Counter)
    ended_by: Counter[str] = field(default_factory=Counter)
    stopped_by: Counter[str] = field(default_factory=Counter)
    found_out: Counter[str] = field(default_factory=Counter)
    most_speed: float = 0.0
    most_past_border: float = -np.inf
    most_excursion: float = 0.0
    most_stopping: float = 0.0
    most_prediction_time: float = 0.0
    most_prediction_distance: float = 0.0  # the six limits are 1, 0 mm, 1, 1, 1 and 1


class Watched(StageModel):
    """Stage that checks place, speed, acceleration and target at each step."""

    STEP = TICK_S

    def __init__(self, settings: Settings, tried: Tried) -> None:
        super().__init__(settings)
        self.max_speed *= FASTER
        self.acceleration *= FASTER
        self.reach, self.tried = Limits.from_settings(settings).reach, tried
        self.low = np.add(settings.low, settings.zero)  # the limits are the stage's own
        self.high = np.add(settings.high, settings.zero)
        self.moved = 0.0  # time of the last motion, s
        self.sent: list[float] = []
        self.fault: Callable[[str], Fault | None] = lambda _: None
        self.ask: Callable[[], None] = lambda: None
        self.is_obedient, self.excursion = True, 0.0
        self.foreign = self.halted = np.full(2, np.nan)  # others' target, and place of the halt
        self.shadow = StageModel(settings)  # an obedient stage
        self.shadow.STEP = TICK_S

    def command(self, place: Floats) -> None:
        s = self.settings
        self.sent.append(self.now)
        self.ask()
        others = (place == self.foreign) | (place == self.halted)  # Zaber is sent axis by axis
        far = float(np.hypot(*np.where(others, 0.0, place - self.place)))
        may = self.reach + 2**0.5 * s.max_speed * (MAX_PLACE_AGE_S + s.latency) + ROUNDING_MM
        self.require(far <= may, f"sent {far:.4f} mm at once, {may:.4f} allowed")
        past = self.excess(np.where(others, self.low, place))
        self.require(past <= ROUNDING_MM, f"sent outside, to {place}")
        self.shadow.command(place)
        way = place - self.place
        if self.fault("ignore"):
            return
        if self.fault("backwards"):
            way = -way
        elif self.fault("tenfold"):
            way = 10 * way
        elif self.fault("swapped"):
            way = way[::-1]
        super().command(self.place + way)

    def halt(self) -> None:
        super().halt()
        self.halted = self.place.copy()
        self.shadow.halt()

    def obey_another(self, place: Floats) -> None:
        """Obey somebody else's target within our speed limit, so that speeds remain comparable."""
        self.max_speed = min(self.max_speed, self.settings.max_speed)
        self.acceleration = min(self.acceleration, self.settings.acceleration)
        super().command(place)
        self.foreign = place.copy()

    def advance(self, now: float) -> None:
        if now - self.now > 1e-12:
            self.shadow.now, self.shadow.jammed = self.now, self.jammed
            self.shadow.max_speed, self.shadow.acceleration = self.max_speed, self.acceleration
            self.shadow.advance(now)
        super().advance(now)

    def excess(self, place: Floats) -> float:
        """Distance of a place outside the soft limits, mm."""
        (x, y), low, high = place.tolist(), self.low.tolist(), self.high.tolist()
        return float(max(low[0] - x, low[1] - y, x - high[0], y - high[1]))

    def follow(self, step: float) -> None:
        (x, y), (u, v) = self.place.tolist(), self.speed.tolist()
        super().follow(step)
        (right, up), (faster, steeper) = self.place.tolist(), self.speed.tolist()
        s, tried = self.settings, self.tried
        fastest = max(abs(right - x), abs(up - y)) / step
        change = max(abs(faster - u), abs(steeper - v)) / step
        past = self.excess(self.place)
        if past > ROUNDING_MM + self.excursion:
            self.require(False, f"at ({right}, {up}), outside")
        if fastest > s.max_speed * (1 + ROUNDING_SHARE):
            self.require(False, f"{fastest:.3f} mm/s fast")
        if change > s.acceleration * (1 + ROUNDING_SHARE) + 1:
            self.require(False, f"{change:.1f} mm/s2")
        if fastest > STILL_MM_S:
            self.moved = self.now
        tried.steps += 1
        tried.most_speed = max(tried.most_speed, fastest / s.max_speed)
        if self.is_obedient:
            tried.most_past_border = max(tried.most_past_border, past)
        else:
            tried.most_excursion = max(tried.most_excursion, past / self.excursion)

    def require(self, good: bool, words: str) -> None:
        if not good:
            raise Broken(f"{words} at {self.now:.3f} s")


class World:
    """Simulated clock, mirror, samples, wire and stage; also the tracker's port."""

    def __init__(self, rng: np.random.Generator, tried: Tried, driver: str = "") -> None:
        self.rng, self.tried = rng, tried
        self.now = 10.0
        self.settings = draw_settings(rng, driver)
        self.law = Law.from_sensor(CONFIG.sensor, self.settings)
        self.model = Watched(self.settings, tried)
        self.model.now = self.now
        self.model.fault, self.model.ask = self.is_on, self.check_command
        zaber = self.settings.driver == "zaber"
        self.device = ZaberDevice(self.model) if zaber else PiController(self.model)
        self.faults: list[Fault] = []
        self.replies: deque[tuple[float, bytes]] = deque()
        self.ready = b""
        self.bytes, self.cut = 0, np.inf
        self.closed = False
        self.tracker: Tracker | None = None
        self.fed = self.watched = self.now
        self.followable = -np.inf  # time of the last sample that may be followed
        self.flag = (-np.inf, False)  # time and value of the board's last permit
        self.is_stopped, self.offset = False, np.zeros(2)
        self.parted = self.wrong = np.inf  # when they went astray
        self.good: deque[tuple[float, Floats]] = deque(maxlen=100)  # good samples
        self.failed = np.inf  # time at which the tracker gave up
        self.barred = np.inf  # time from which tracking is impossible
        low, high = np.array(self.settings.low), np.array(self.settings.high)
        self.centre = rng.uniform(low, high) * 0.7 + self.settings.zero
        for model in (self.model, self.model.shadow):
            model.place, model.target = self.centre.copy(), self.centre.copy()
        if isinstance(self.device, ZaberDevice):
            self.device.target = self.centre.copy()
        self.radius, self.turn = rng.uniform(0, 1.2), rng.uniform(-8, 8)

    def clock(self) -> float:
        return self.now

    def suffer(self, faults: list[Fault]) -> None:
        """Set the faults, and the excursion that they allow."""
        self.faults, s = faults, self.settings
        kinds = {fault.kind for fault in faults}
        if kinds.isdisjoint(CONTROLLER):
            return
        self.model.is_obedient, self.model.excursion = False, excursion(s)
        if "foreign" in kinds:
            self.model.excursion += FOREIGN_MM
        if "tenfold" in kinds and len(kinds) > 1:  # the loop may be unable to stop it
            self.model.excursion += 10 * self.model.reach

    @property
    def beam(self) -> Floats:
        """Position of the beam."""
        away = self.model.place - self.centre
        return self.centre + (away[::-1] if self.is_on("miswired") else away)

    # --- the port ------------------------------------------------------------------------

    def write(self, data: bytes) -> None:
        for n in range(len(data)):
            self.count_byte()
            answer = self.device.receive(data[n : n + 1])
            if answer:
                self.reply(answer)

    def read(self, size: int) -> bytes:
        until = self.now + POLL_S
        while not self.ready and self.now < until:
            self.count_byte(0)
            self.advance(TICK_S)
            while self.replies and self.replies[0][0] <= self.now:
                self.ready += self.replies.popleft()[1]
        out, self.ready = self.ready[:size], self.ready[size:]
        for _ in out:
            self.count_byte()
        return out

    def count_waiting(self) -> int:
        return len(self.ready)

    in_waiting = property(count_waiting)  # as in pyserial

    def close(self) -> None:
        self.closed = True

    def open_again(self) -> World:
        self.closed, self.ready = False, b""
        self.replies.clear()
        return self

    def count_byte(self, count: int = 1) -> None:
        """Count bytes over the wire; raise `OSError` once the cable is cut."""
        self.bytes += count
        if self.bytes > self.cut or self.is_on("unplug"):
            self.bar()
            raise OSError(5, "Input/output error")

    def reply(self, answer: bytes) -> None:
        rejected = b" RJ " in answer or b" WR " in answer or answer.strip() in (b"5", b"7")
        if rejected:
            self.bar(WATCH_S)
        due = self.now + self.rng.uniform(0, 2e-3)
        slow, flip = self.is_on("slow"), self.is_on("flip")
        if slow is not None:
            due += 10 ** (3 * slow.amount - 2.2)  # 6 ms to 6 s
        if flip is not None:
            spoilt = bytearray(answer)
            spoilt[self.rng.integers(len(spoilt))] ^= 1 << int(self.rng.integers(8))
            answer = bytes(spoilt)
        if (partial := self.is_on("partial")) is not None:
            answer = answer[: int(partial.amount * len(answer))]
        if self.is_on("repeat") is not None:
            answer += answer
        if self.replies:
            due = max(due, self.replies[-1][0])
        self.replies.append((due, answer))

    def bar(self, later: float = 0.0) -> None:
        """Forbid following from now on."""
        self.barred = min(self.barred, self.now + later)

    # --- time ----------------------------------------------------------------------------

    def is_on(self, kind: str) -> Fault | None:
        for fault in self.faults:
            if fault.kind == kind and fault.begin <= self.now < fault.end:
                return fault
        return None

    def advance(self, seconds: float) -> None:
        """Advance everything except the tracker's loop."""
        end = self.now + seconds
        while self.now < end - 1e-9:
            self.now += TICK_S
            self.device.refuse = self.is_on("refuse") is not None
            self.model.jammed = self.is_on("jam") is not None
            if (restart := self.is_on("restart")) is not None:
                restart.end = -1.0
                self.device.restart()
            foreign = self.is_on("foreign") if self.tracker else None
            if foreign is not None and foreign.amount >= 0:
                angle = 7 * foreign.amount
                step = FOREIGN_MM * foreign.amount * np.array([np.cos(angle), np.sin(angle)])
                self.model.obey_another(self.model.place + step)
                if isinstance(self.device, ZaberDevice):  # an axis that is not sent goes there
                    self.device.target = self.model.foreign.copy()
                foreign.amount = -1.0
            self.model.advance(self.now)
            if self.now - self.fed >= SAMPLE_S:
                self.fed = self.now
                self.feed()
            if self.tracker and self.now - self.watched >= WATCH_S:
                self.watched = self.now
                self.tracker.envelope.watch()
            self.check_standstill()

    def feed(self) -> None:
        """Feed a sample to the tracker, changed by the current faults."""
        if self.tracker is None or self.is_on("silence"):
            return
        taken = self.now - 2e-3
        angle = self.turn * (self.now - 10.0)
        reach = self.radius * np.array([np.cos(angle) - 1, np.sin(angle)])
        apex = self.centre + reach
        off, beam = apex - self.beam, self.beam
        powers = light(off)
        lit = bool((powers > 0).all())
        apex = apex if lit else np.full(2, np.nan)
        taken, powers, apex = self.spoil_sample(taken, powers, apex)
        if self.is_followable(taken, powers, apex):
            self.followable = self.now
        is_permitted = self.is_on("no permit") is None
        self.flag = taken, is_permitted
        rows = np.array([taken - 1e-3, taken])
        if np.isfinite(apex).all():
            self.good += [(row, apex) for row in rows.tolist()]
        with np.errstate(all="ignore"):
            lights, apexes, beams = (np.array([one, one]) for one in (powers, apex, beam))
            late = self.is_on("late")  # of some, the clock's line has taken the delay over
            delay = 0.5 * late.amount if late and late.amount > 0.5 else 0.0
            self.tracker.feed(rows + delay, lights, apexes, beams, is_permitted, delay)

    def spoil_sample(
        self, taken: float, powers: Floats, apex: Floats
    ) -> tuple[float, Floats, Floats]:
        """Apply the current faults to the time, powers and apex of a sample."""
        if (late := self.is_on("late")) is not None:
            taken -= 0.5 * late.amount
        if (clock := self.is_on("clock")) is not None:
            taken += (clock.amount - 0.5) * 10 ** (8 * abs(clock.amount - 0.5))
        if self.is_on("nan"):
            (powers if self.rng.random() < 0.5 else apex)[self.rng.integers(2)] = np.nan
        if self.is_on("garbage"):
            powers = self.rng.choice([-1, 1, np.inf, np.nan, 1e300, 1e-300, 0], 3)
            apex = self.rng.choice([-7, 7, np.inf, np.nan, 1e300, 0.3], 2)
        if (jump := self.is_on("jump")) is not None:
            apex = apex + 10 ** (4 * jump.amount - 2) * self.rng.uniform(-1, 1, 2)
        if self.is_on("dark"):
            powers, apex = np.zeros(3), np.full(2, np.nan)
        if self.is_on("one dark"):
            powers = np.where([True, True, False], powers, 0.0)
        return taken, powers, apex

    def is_followable(self, taken: float, powers: Floats, apex: Floats) -> bool:
        """Whether the stage may follow a sample: it is recent and has what the law needs."""
        assert self.tracker is not None
        searching = self.tracker.search is not None
        needs = searching or (
            (powers > 0).all()
            and (self.settings.law != "feedforward" or bool(np.isfinite(apex).all()))
        )
        known = np.isfinite(powers).all() or (searching and not np.isnan(powers).any())
        return bool(known and needs and abs(self.now - taken) <= self.settings.stale)

    def last_motion(self) -> float:
        """Time until which the stage may move, s."""
        s = self.settings
        bound = stopping_time(s)
        allowed = min(max(self.followable, 10.0), self.barred) + bound
        if self.tracker is not None and self.tracker.error:
            allowed = min(allowed, self.failed + bound)
        for fault in self.faults:  # a stage jammed at a cable cut moves on when it is free
            if fault.kind == "jam" and fault.begin <= self.barred:
                allowed = max(allowed, min(fault.end, self.now) + bound)
            if fault.kind == "foreign" and fault.begin <= self.now:
                allowed = max(allowed, fault.begin + FOREIGN_MM / self.settings.max_speed + bound)
            if fault.kind == "tenfold" and fault.begin <= self.barred < np.inf:
                allowed = max(allowed, self.barred + 10 * self.model.reach / s.max_speed + bound)
        return allowed

    def check_standstill(self) -> None:
        """Check that the stage stands still if it must."""
        moved, allowed, bound = self.model.moved, self.last_motion(), stopping_time(self.settings)
        if moved > allowed + TICK_S:
            raise Broken(f"moved at {moved:.3f} s, {moved - allowed + bound:.3f} s after the end")
        if self.followable > 10.0:
            share = (moved - allowed) / bound + 1
            self.tried.most_stopping = max(self.tried.most_stopping, share)

    def check_command(self) -> None:
        """Check that a command is allowed now."""
        if self.is_stopped:
            raise Broken("a stopped stage was sent somewhere before anybody resumed")
        if self.settings.permit:
            taken, is_permitted = self.flag
            if not is_permitted or self.now - taken > self.settings.stale + 2 * MAX_PLACE_AGE_S:
                raise Broken("sent without a permit")

    def note_errors(self, begun: float) -> tuple[float, float]:
        """Return the stage's error and the beam's error from the readings, mm; note the time since
        which the tracker must detect each."""
        assert self.tracker is not None
        away = float(np.abs(self.model.place - self.model.shadow.place).max())
        if self.tracker.searching:  # from now on the stage follows the measured beam
            self.offset, self.wrong = self.beam - self.model.place, np.inf
        split = float(np.hypot(*(self.beam - self.model.place - self.offset)))
        self.parted = min(self.parted, begun) if away > FOUND_OUT_MM else np.inf
        good = self.good and begun - self.good[-1][0] <= self.settings.stale / 2
        self.wrong = min(self.wrong, begun) if split > FOUND_OUT_MM and good else np.inf
        return away, split

    def check_step(self, begun: float, flag: tuple[float, bool]) -> None:
        """Check after a step of the loop that the stage is stopped if it must be.

        begun: time at which the step began, s.  flag: time and value of the permit at that time.
        """
        assert self.tracker is not None
        s, patience = self.settings, settling_time(self.settings) + 0.15
        away, split = self.note_errors(begun)
        if self.is_stopped:
            return
        if self.tracker.moves and begun - self.followable > max(s.stale, s.bridge) + 2 * TICK_S:
            raise Broken(f"not stopped {begun - self.followable:.3f} s after the last good sample")
        if s.permit and not flag[1] and abs(begun - flag[0]) <= s.stale - TICK_S:
            raise Broken("not stopped without a permit")
        if min(self.parted, self.wrong) < begun - patience:
            raise Broken(
                f"the stage is {away:.3f} mm and the beam {split:.3f} mm astray: unnoticed"
            )

    def say(self, name: str, **more: Any) -> None:
        if name == "stop":
            self.tried.stops += 1
            self.is_stopped = True
            reason = cause(more["reason"])
            self.tried.stopped_by[reason] += 1
            if reason in FINDINGS:
                self.tried.found_out.update(
                    one.kind for one in self.faults
                    if one.kind in CONTROLLER and one.begin <= self.now
                )  # fmt: skip
        if name == "resume":
            self.is_stopped, self.barred, self.failed = False, np.inf, np.inf
            self.parted = self.wrong = np.inf
            self.offset = self.beam - self.model.place  # a person has checked the beam
            self.model.shadow.place = self.model.place.copy()
            self.model.shadow.target = self.model.place.copy()
            self.tried.resumes += 1
            self.tried.auto_resumes += more["by"] == "auto"
        self.tried.refused_resumes += name == "resume refused"
        self.tried.searches += name == "search"
        self.tried.found_again += more.get("outcome") == "found"
        if more.get("predicted"):
            self.check_prediction(np.array([more["x"], more["y"]]))
        if self.is_on("disk full"):
            raise OSError(28, "No space left on device")

    def check_prediction(self, sent: Floats) -> None:
        """Check that some good sample is recent and near enough for a prediction."""
        s, tried = self.settings, self.tried
        if not s.bridge:
            raise Broken("predicted where that is turned off")
        shares = [
            (
                (self.model.sent[-1] - taken - TICK_S) / s.bridge,
                (float(np.hypot(*(sent - apex))) - ROUNDING_MM) / s.bridge_distance,
            )
            for taken, apex in self.good
        ]
        time, distance = min(shares, key=max)
        if max(time, distance) > 1:
            raise Broken(f"predicted {time:.3f} of the time, {distance:.3f} of the way allowed")
        tried.predictions += 1
        tried.most_prediction_time = max(tried.most_prediction_time, time)
        tried.most_prediction_distance = max(tried.most_prediction_distance, distance)


def light(off: Floats) -> Floats:
    """Approximate powers (3,), mW, with the apex `off` (2,) mm from the beam."""
    weights = np.array([[1, 0], [-0.5, 3**0.5 / 2], [-0.5, -(3**0.5) / 2]]) @ (-off / 0.2)
    shares = np.exp(np.clip(weights * 1.6, -700, 700))
    powers: Floats = 0.6 * shares / shares.sum()
    return np.where(powers < 1e-6, 0.0, powers) if np.hypot(*off) < 4 else np.zeros(3)


def draw_settings(rng: np.random.Generator, driver: str) -> Settings:
    size = float(rng.choice([0.5, 1.0, 7.0]))
    return replace(
        CONFIG.stage,
        driver=driver or str(rng.choice(["zaber", "pi"])),  # type: ignore[arg-type]
        zero=tuple(rng.uniform(-0.2, 0.2, 2)),
        low=(-size, -size),
        high=(size, size),
        law=str(rng.choice(["proportional", "pi", "feedforward", "feedforward"])),  # type: ignore[arg-type]
        max_speed=float(rng.choice([2.0, 20.0])),
        max_step=float(rng.choice([0.01, 0.1, 0.5])),
        rate=float(rng.choice([50.0, 100.0, 200.0])),
        stale=float(rng.choice([0.02, 0.05])),
        bridge=float(rng.choice([0.0, 0.06, 0.15, 0.15])),
        bridge_distance=float(rng.choice([0.05, 1.0])),
        lag=float(rng.choice([0.002, 0.008])),
        acceleration=float(rng.choice([300.0, 2000.0])),
        permit=str(rng.choice(["", "board"])) or None,
        resume=str(rng.choice(["person", "auto"])),  # type: ignore[arg-type]
        resumes_per_hour=1,
    )


def draw_faults(rng: np.random.Generator, kinds: Sequence[str]) -> list[Fault]:
    faults: list[Fault] = []
    for _ in range(int(rng.integers(1, 4))):
        begin = 10.0 + rng.uniform(0.05, 0.5) if rng.random() < 0.95 else 0.0
        length = float(rng.choice([0.01, 0.06, 0.3]))
        faults.append(Fault(str(rng.choice(kinds)), begin, begin + length, float(rng.random())))
        if faults[-1].kind in ("unplug", *CONTROLLER):
            faults[-1].end = np.inf
        if begin == 0.0:
            faults[-1].end = 10.5
    return faults


#: First words of the messages about a disobedient controller.
FINDINGS = ("the stage is at", "the stage accepted a", "the encoder disagrees with")


def begin(world: World, search: bool, again: bool) -> Tracker | None:
    """Start a tracker in a world; None if the stage is unusable and was not moved."""
    settings = replace(world.settings, search_distance=2.0 if search else 0.0)
    try:
        tracker = Tracker(
            world, settings, world.law, world.say, world.clock,
            world.open_again if again else None,
        )  # fmt: skip
    except (StageError, OSError):
        if not world.closed or world.model.sent:
            raise Broken("a stage that cannot be used was moved, or its port left open") from None
        return None
    world.tracker = tracker
    return tracker


def sequence(
    seed: int, tried: Tried, driver: str = "", cut: float = np.inf, kinds: Sequence[str] = KINDS
) -> None:
    """Run one sequence; raise `Broken` if the stage leaves its envelope."""
    rng = np.random.default_rng(seed)
    world = World(rng, tried, driver)
    world.suffer([] if np.isfinite(cut) else draw_faults(rng, kinds))
    world.cut = cut
    tried.sequences += 1
    tried.drivers[world.settings.driver] += 1
    tried.faults.update(fault.kind for fault in world.faults)
    tracker = begin(world, bool(rng.random() < 0.5), again=bool(rng.random() < 0.3))
    if tracker is None:
        tried.refused_at_start += 1
        return
    end = 11.0 + rng.choice([0.0, 1.5], p=[0.9, 0.1])
    drive(world, tracker, end if np.isinf(cut) else world.now + 0.25)
    tracker.close()
    world.failed = min(world.failed, world.now)
    world.bar()
    world.advance(stopping_time(world.settings) + 0.05)
    check_end(world, tracker)
    tried.moves += tracker.moves
    tried.ended_by[cause(tracker.error)] += 1


def drive(world: World, tracker: Tracker, end: float) -> None:
    """Run the tracker's loop on the world's clock."""
    due = world.now
    period = 1 / world.settings.rate
    is_watched = world.rng.random() < 0.6  # by a person, who resumes again and again
    while world.now < end:
        if (stall := world.is_on("stall")) is not None:
            world.advance(stall.amount)
        if world.is_on("bug"):
            world.law.inverse = None  # type: ignore[assignment]
            world.law.speed = None  # type: ignore[assignment]
        if is_watched and world.rng.random() < RESUMES_HZ * period:
            tracker.resume("person")
        begun, flag = world.now, world.flag
        tracker.step()
        if tracker.error and world.failed == np.inf:
            world.failed = world.now
        world.check_step(begun, flag)
        due = max(due + period, world.now + TICK_S)
        world.advance(due - world.now)


def check_end(world: World, tracker: Tracker) -> None:
    """Check that the stage stands, the port is closed and the tracker reported a cut cable."""
    if not world.closed:
        raise Broken("the port was left open")
    if world.model.moved > world.now - 0.04:
        raise Broken("the stage still moves")
    if world.bytes > world.cut and world.cut < np.inf and not tracker.error:
        raise Broken("the cable was pulled, and nobody was told")
    if world.is_on("unplug") and not tracker.error:
        raise Broken("the cable was pulled, and nobody was told")


def cause(error: str) -> str:
    """The first words of an error, without its numbers."""
    kept = " ".join(error.split(":")[0].split()[:4]) if error else "the end"
    return next((words for words in FINDINGS if kept.startswith(words)), kept)


def run(seeds: range, driver: str = "") -> Tried:
    """Run a number of sequences; a failure names its seed."""
    tried = Tried()
    for seed in seeds:
        try:
            sequence(seed, tried, driver)
        except (Exception, Broken) as error:
            raise Broken(f"seed {seed}: {type(error).__name__}: {error}") from error
    return tried


def pull_at_each_byte(driver: str, cuts: range) -> Tried:
    """Run one sequence for each number of bytes after which the cable is pulled."""
    tried = Tried()
    for cut in cuts:
        try:
            sequence(7, tried, driver, cut=cut)
        except (Exception, Broken) as error:
            raise Broken(f"{driver}, byte {cut}: {type(error).__name__}: {error}") from error
    return tried


def to_json(tried: Tried) -> str:
    return json.dumps(vars(tried), indent=1)


def main(words: list[str]) -> None:
    seed = int(words[words.index("--seed") + 1]) if "--seed" in words else 1
    count = int(words[0]) if words and words[0].isdigit() else 1000
    report: Callable[[str], object] = print
    if "--bytes" in words:
        for driver in ("zaber", "pi"):
            report(to_json(pull_at_each_byte(driver, range(count))))
    else:
        report(to_json(run(range(seed, seed + count))))


if __name__ == "__main__":
    main(sys.argv[1:])
