"""A tracker, its stage, wire and mirror on a counted clock, and the judge of what the stage does.

Drivers, envelope, search and tracker run unchanged against the virtual controllers. `World.suffer`
begins a fault. Whatever it is, the stage stays within its soft limits and its speed limit, follows
a prediction no longer and no further from a good sample than the settings allow, and stands within
`stopping_time` of the last sample that it may follow and of every fault that ends tracking. Every
stop latches. A controller that disobeys is found out by comparison with a second, obedient
stage; it takes the stage out of its limits by no more than `excursion`.

What is not allowed ends by `pytest.fail`, whose exception the tested code does not catch.
"""

from __future__ import annotations

from collections import Counter, defaultdict, deque
from dataclasses import dataclass, replace

import numpy as np
import pytest

import facets
from facets.live import CONTROLLERS
from facets.tracking import (
    MAX_PLACE_AGE_S,
    POLL_S,
    Envelope,
    Law,
    Limits,
    SolvedSamples,
    StageError,
    StageModel,
    Tracker,
    excursion,
    settling_time,
    stopping_time,
)

SENSOR = facets.load("bench").sensor
#: Ratio of the stage's own largest speed and acceleration to the settings' limits.
FASTER = 5.0
#: Steps of the counted clock, intervals of samples, and intervals of the watchdog, s.
TICK_S, SAMPLE_S, WATCH_S = 2e-3, 5e-3, 0.02
#: Largest distance that rounding to the stage's native unit carries it beyond a border, mm.
ROUNDING_MM = 1e-3
#: Largest relative increase of a speed by the same rounding.
ROUNDING_RATIO = 1e-2
#: Speed below which the stage counts as standing still, mm/s.
STILL_MM_S = 0.05
#: Powers below this are no light, mW.
DARK_MW = 1e-4
#: Distance between the stage and an obedient one, mm, above which the tracker must stop.
FOUND_OUT_MM = 0.2
#: Largest motion commanded by somebody else, mm.
FOREIGN_MM = 1.0
#: Bytes after which a cable is pulled at most: more than a tracker exchanges until it follows.
PULLED_AFTER_BYTES = 500

WIRE = ("slow", "flip", "partial", "repeat", "unplug")
STAGE = ("refuse", "jam", "restart")
#: Controllers that accept a move and do another one, are moved by somebody else, or whose axes x
#: and y are exchanged, by the controller or by whoever laid the cables.
CONTROLLER = ("ignore", "backwards", "tenfold", "foreign", "swapped", "miswired")
#: Spoilt data, a lost permit, and what hinders the program.
OTHERS = (
    "silence", "late", "nan", "garbage", "jump", "dark", "one dark", "clock", "frozen",
    "no permit", "stall", "bug", "disk full",
)  # fmt: skip
KINDS = (*OTHERS, *WIRE, *STAGE, *CONTROLLER)
#: First words of the messages about a disobedient controller.
FINDINGS = ("the stage is at", "the stage accepted a", "the encoder disagrees with")
#: Faults for which an obedient stage may be taken for a disobedient one.
LIKE_DISOBEDIENCE = {*CONTROLLER, *WIRE, *STAGE, "late", "clock", "stall", "bug"}


@dataclass
class Fault:
    """kind, begin and end, s. amount: the number that this kind needs, 0 to 1."""

    kind: str
    begin: float
    end: float
    amount: float


class Tally:
    """Counts of events, and the largest shares reached of what is allowed."""

    def __init__(self):
        self.counts, self.shares = Counter(), defaultdict(float)

    def reach(self, name, share):
        self.shares[name] = max(self.shares[name], share)


class StagePort:
    """A port whose other end is an emulator, on a counted clock, which goes on by reading.

    sent: the lines that were written.  error: is raised at both ends while it is set, as if the
    cable had been pulled.  answers: whether the emulator's answers arrive.
    """

    now, closed, answers, error, replies = 10.0, False, True, None, b""

    def __init__(self, device):
        self.device, self.model, self.sent = device, device.model, []
        self.model.now, self.model.STEP = self.now, TICK_S

    def clock(self):
        return self.now

    def wait(self, seconds):
        """Let the stage move on."""
        self.now += seconds
        self.model.advance(self.now)

    def write(self, data):
        if self.error or self.closed:
            raise self.error or OSError("the port is closed")
        self.sent.append(data.decode())
        answer = self.device.receive(data)
        self.replies += answer if self.answers else b""

    def read(self, size):
        if self.error:
            raise self.error
        if not self.replies:
            self.wait(0.02)
        data, self.replies = self.replies[:size], self.replies[size:]
        return data

    def close(self):
        self.closed = True


def stage_on(settings):
    """A port on the virtual controller of the settings' driver."""
    return StagePort(CONTROLLERS[settings.driver](StageModel(settings)))


class WatchedStage(StageModel):
    """A stage whose place, speed, acceleration and targets are judged at each step."""

    STEP = TICK_S

    def __init__(self, settings, world):
        super().__init__(settings)
        self.max_speed *= FASTER
        self.acceleration *= FASTER
        self.world, self.reach = world, Limits.from_settings(settings).reach
        self.low = np.add(settings.low, settings.zero)  # the limits are the stage's own
        self.high = np.add(settings.high, settings.zero)
        self.moved = self.sent = 0.0  # times of the last motion and of the last command, s
        self.foreign = self.halted = np.full(2, np.nan)  # others' target, and place of the halt
        self.excursion = 0.0
        self.shadow = StageModel(settings)  # an obedient stage
        self.shadow.STEP = TICK_S

    def command(self, place):
        s, world = self.settings, self.world
        self.sent = self.now
        world.judge_command()
        others = (place == self.foreign) | (place == self.halted)  # Zaber is sent axis by axis
        far = np.hypot(*np.where(others, 0.0, place - self.place))
        most = self.reach + 2**0.5 * s.max_speed * (MAX_PLACE_AGE_S + s.latency) + ROUNDING_MM
        world.require(far <= most, f"sent {far:.4f} mm at once, {most:.4f} allowed")
        past = self.excess(np.where(others, self.low, place))
        world.require(past <= ROUNDING_MM, f"sent outside, to {place}")
        self.shadow.command(place)
        way = place - self.place
        if world.fault("ignore"):
            return
        if world.fault("backwards"):
            way = -way
        elif world.fault("tenfold"):
            way = 10 * way
        elif world.fault("swapped"):
            way = way[::-1]
        super().command(self.place + way)

    def halt(self):
        super().halt()
        self.halted = self.place.copy()
        self.shadow.halt()

    def obey_another(self, place):
        """Obey somebody else's target within our speed limit, so that speeds remain comparable."""
        self.max_speed = min(self.max_speed, self.settings.max_speed)
        self.acceleration = min(self.acceleration, self.settings.acceleration)
        super().command(place)
        self.foreign = place.copy()

    def advance(self, now):
        if now - self.now > 1e-12:
            self.shadow.now, self.shadow.jammed = self.now, self.jammed
            self.shadow.max_speed, self.shadow.acceleration = self.max_speed, self.acceleration
            self.shadow.advance(now)
        super().advance(now)

    def excess(self, place):
        """Distance of a place outside the soft limits, mm."""
        return max(*(self.low - place), *(place - self.high))

    def follow(self, step):
        place, speed = self.place.copy(), self.speed.copy()
        super().follow(step)
        s, world = self.settings, self.world
        fastest = max(abs(self.place - place)) / step
        change = max(abs(self.speed - speed)) / step
        past = self.excess(self.place)
        world.require(past <= ROUNDING_MM + self.excursion, "outside of the soft limits")
        world.require(fastest <= s.max_speed * (1 + ROUNDING_RATIO), "too fast")
        world.require(change <= s.acceleration * (1 + ROUNDING_RATIO) + 1, "accelerated too much")
        if fastest > STILL_MM_S:
            self.moved = self.now
        world.tally.reach("speed", fastest / s.max_speed)
        if self.excursion:
            world.tally.reach("excursion", past / self.excursion)


class World(StagePort):
    """Counted clock, mirror, samples, wire and stage; also the tracker's port.

    start: the stage's first place, as shares of its limits (2,); the mirror goes round on a circle
    through it, radius (mm), turn (rad/s). seed: of what is drawn within a fault.
    """

    fed = watched = 10.0
    followable = -np.inf  # time of the last sample that may be followed
    permitted = -np.inf  # time of the board's last permit
    barred = np.inf  # time from which tracking is impossible
    failed = np.inf  # time at which the tracker gave up
    parted = wrong = np.inf  # when stage and beam went astray
    tracker = cable = None
    closing = failing = is_stopped = needs_person = lacks_permit = False
    is_asked = is_moved = False  # by a person to resume, and to another zero
    resumed_by, ready, auto_resumes, bytes, cut = "", b"", 0, 0, np.inf
    offset = np.zeros(2)

    def __init__(self, settings, start, radius, turn, seed, tally):
        self.settings, self.radius, self.turn, self.tally = settings, radius, turn, tally
        self.rng, self.bound = np.random.default_rng(seed), stopping_time(settings)
        self.law = Law.from_sensor(SENSOR, settings)
        self.model = WatchedStage(settings, self)
        self.model.now = self.now
        self.device = CONTROLLERS[settings.driver](self.model)
        self.centre = np.array(settings.high) * start + settings.zero
        for stage in (self.model, self.model.shadow):
            stage.place, stage.target = self.centre.copy(), self.centre.copy()
        self.device.target = self.centre.copy()
        self.faults, self.replies = [], deque()
        self.good = deque(maxlen=100)  # times and apexes of good samples

    def require(self, is_so, words):
        if not is_so:
            self.failing = True
            pytest.fail(f"{words}, at {self.now:.3f} s: the stage is at {self.model.place}")

    # --- faults --------------------------------------------------------------------------

    def fault(self, kind):
        """The fault of a kind that lasts now, or None."""
        for fault in self.faults:
            if fault.kind == kind and fault.begin <= self.now < fault.end:
                return fault
        return None

    def suffer(self, kind, seconds, amount):
        """Begin a fault."""
        fault = Fault(kind, self.now, self.now + seconds, amount)
        self.tally.counts[f"fault: {kind}"] += 1
        if kind == "unplug":
            self.cut, self.cable = self.bytes + int(PULLED_AFTER_BYTES * amount), fault
            return
        if kind == "clock" and amount < 0.5 and self.tracker:  # whoever reads the board has seen it
            self.tracker.halt("the clock has moved")
            self.needs_person = True
        if kind in CONTROLLER:
            fault.end = np.inf
            self.model.excursion = max(self.model.excursion, excursion(self.settings))
        self.faults.append(fault)
        kinds = {fault.kind for fault in self.faults}
        if kind == "foreign":
            self.model.excursion += FOREIGN_MM
        if "tenfold" in kinds and len(self.faults) > 1:  # the loop may be unable to stop it
            self.model.excursion += 10 * self.model.reach

    def bar(self, later=0.0):
        """Forbid following from now on."""
        self.barred = min(self.barred, self.now + later)

    # --- the port ------------------------------------------------------------------------

    def write(self, data):
        for n in range(len(data)):
            self.count_byte()
            answer = self.device.receive(data[n : n + 1])
            if answer:
                self.reply(answer)

    def read(self, size):
        until = self.now + POLL_S
        while not self.ready and self.now < until:
            self.count_byte(0)
            self.advance(TICK_S)
            while self.replies and self.replies[0][0] <= self.now:
                self.ready += self.replies.popleft()[1]
        out, self.ready = self.ready[:size], self.ready[size:]
        self.count_byte(len(out))
        return out

    @property
    def in_waiting(self):
        return len(self.ready)

    def open_again(self):
        self.require(self.is_asked, "the line was opened again, and nobody had resumed")
        self.count_byte(0)
        if self.cable and self.cable.amount > 0.6 and not self.is_moved:
            self.is_moved = True
            self.device.zero = self.device.zero + 1.0 + self.cable.amount
        self.closed, self.ready = False, b""
        self.replies.clear()
        return self

    def count_byte(self, count=1):
        """Count bytes over the wire; raise `OSError` while the cable is pulled."""
        self.bytes += count
        if self.bytes > self.cut:
            length = self.cable.end - self.cable.begin
            self.cut, self.cable.begin, self.cable.end = np.inf, self.now, self.now + length
            self.faults.append(self.cable)
        if self.fault("unplug"):
            self.bar()
            raise OSError(5, "Input/output error")

    def reply(self, answer):
        rejected = b" RJ " in answer or b" WR " in answer or answer.strip() in (b"5", b"7")
        if rejected:
            self.bar(WATCH_S)
        due = self.now + self.rng.uniform(0, 2e-3)
        if slow := self.fault("slow"):
            due += 10 ** (3 * slow.amount - 2.2)  # 6 ms to 6 s
        if self.fault("flip"):
            spoilt = bytearray(answer)
            spoilt[self.rng.integers(len(spoilt))] ^= 1 << int(self.rng.integers(8))
            answer = bytes(spoilt)
        if partial := self.fault("partial"):
            answer = answer[: int(partial.amount * len(answer))]
        if self.fault("repeat"):
            answer += answer
        if self.replies:
            due = max(due, self.replies[-1][0])
        self.replies.append((due, answer))

    # --- time ----------------------------------------------------------------------------

    def start(self, search, again):
        """Start a tracker; a stage that cannot be used is not moved, and its port is closed."""
        settings = replace(self.settings, search_distance=2.0 if search else 0.0)
        opener = self.open_again if again else None
        try:
            self.tracker = Tracker(Envelope(self, settings, self.say, self.clock, opener), self.law)
        except (StageError, OSError):
            self.require(self.closed and not self.model.sent, "moved, or the port left open")

    def run(self, seconds):
        """Run the tracker's loop, if the stage could be used."""
        if not self.tracker:
            return
        period, end, due = 1 / self.settings.rate, self.now + seconds, self.now
        while self.now < end:
            if stall := self.fault("stall"):
                self.advance(stall.amount)
            if self.fault("bug"):
                self.law.inverse = self.law.speed = None
            begun, lacked_permit = self.now, self.lacks_permit
            self.tracker.step()
            if self.tracker.error:
                self.failed = min(self.failed, self.now)
            self.judge_step(begun, lacked_permit)
            due = max(due + period, self.now + TICK_S)
            self.advance(due - self.now)

    def resume(self):
        """Have a person resume."""
        if self.tracker:
            self.is_asked = True
            self.tracker.resume("a person")

    def advance(self, seconds):
        """Advance everything except the tracker's loop."""
        end = self.now + seconds
        while self.now < end - 1e-9:
            self.now += TICK_S
            self.device.refuse = self.fault("refuse") is not None
            self.model.jammed = self.fault("jam") is not None
            if restart := self.fault("restart"):
                restart.end = -1.0
                self.device.restart()
            foreign = self.fault("foreign")
            if self.tracker and foreign and foreign.amount >= 0:
                angle = 7 * foreign.amount
                step = FOREIGN_MM * foreign.amount * np.array([np.cos(angle), np.sin(angle)])
                self.model.obey_another(self.model.place + step)
                self.device.target = self.model.foreign.copy()  # an axis that is not sent goes
                foreign.amount = -1.0
            self.model.advance(self.now)
            if self.tracker and self.now - self.fed >= SAMPLE_S:
                self.fed = self.now
                self.feed()
            if self.tracker and self.now - self.watched >= WATCH_S:
                self.watched = self.now
                self.tracker.envelope.watch()
            self.judge_standstill()

    @property
    def beam(self):
        """Place of the beam; of a stage that is wired wrong x and y are exchanged, or too short."""
        away, wiring = self.model.place - self.centre, self.fault("miswired")
        if wiring:
            away = away[::-1] if wiring.amount < 0.7 else 0.3 * away
        return self.centre + away

    def feed(self):
        """Feed a sample to the tracker, changed by the current faults."""
        if self.fault("silence"):
            return
        angle = self.turn * (self.now - 10.0)
        apex = self.centre + self.radius * np.array([np.cos(angle) - 1, np.sin(angle)])
        beam = self.beam
        powers = facets.readings(SENSOR, np.array([*apex, 0, 0, 0, 0, *beam]))[2::3]
        powers = np.where(powers > DARK_MW, powers, 0.0)
        if not powers.all():
            apex = np.full(2, np.nan)
        taken, powers, apex = self.spoil_sample(self.now - 2e-3, powers, apex)
        doubt = "the readings do not change" if self.fault("frozen") else ""
        if self.is_followable(taken, powers, apex) and not doubt:
            self.followable = self.now
        rows = np.array([taken - 1e-3, taken])
        if np.isfinite(apex).all():
            self.good += [(row, apex) for row in rows.tolist()]
        is_permitted = not self.fault("no permit")
        self.permitted = taken if is_permitted else -np.inf
        self.lacks_permit |= self.settings.permit is not None and not is_permitted
        self.needs_person |= self.lacks_permit
        late = self.fault("late")  # of some, the clock's line has taken the delay over
        delay = 0.5 * late.amount if late and late.amount > 0.5 else 0.0
        with np.errstate(all="ignore"):
            pairs = (np.array([row, row]) for row in (powers, apex, beam))
            samples = SolvedSamples(rows + delay, *pairs)
            self.tracker.take_permit(taken, is_permitted)
            self.tracker.feed(samples, delay, doubt)

    def spoil_sample(self, taken, powers, apex):
        """Apply the current faults to the time, powers and apex of a sample."""
        if late := self.fault("late"):
            taken -= 0.5 * late.amount
        if clock := self.fault("clock"):
            taken += (clock.amount - 0.5) * 10 ** (8 * abs(clock.amount - 0.5))
        if self.fault("nan"):
            (powers if self.rng.random() < 0.5 else apex)[self.rng.integers(2)] = np.nan
        if self.fault("garbage"):
            powers = self.rng.choice([-1, 1, np.inf, np.nan, 1e300, 1e-300, 0], 3)
            apex = self.rng.choice([-7, 7, np.inf, np.nan, 1e300, 0.3], 2)
        if jump := self.fault("jump"):
            apex = apex + 10 ** (4 * jump.amount - 2) * self.rng.uniform(-1, 1, 2)
        if self.fault("dark"):
            powers, apex = np.zeros(3), np.full(2, np.nan)
        if self.fault("one dark"):
            powers = np.where([True, True, False], powers, 0.0)
        return taken, powers, apex

    def is_followable(self, taken, powers, apex):
        """Whether the stage may follow a sample: it is recent and has what the law needs."""
        searching = self.tracker.search is not None
        needs = searching or (
            (powers > 0).all() and (self.settings.law != "feedforward" or np.isfinite(apex).all())
        )
        known = np.isfinite(powers).all() or (searching and not np.isnan(powers).any())
        return known and needs and abs(self.now - taken) <= self.settings.stale

    # --- the judge -----------------------------------------------------------------------

    def last_motion(self):
        """Time until which the stage may move, s."""
        s, bound = self.settings, self.bound
        allowed = min(max(self.followable, 10.0), self.barred) + bound
        if self.tracker and self.tracker.error:
            allowed = min(allowed, self.failed + bound)
        for fault in self.faults:
            if fault.kind == "jam" and fault.begin <= self.barred:  # it moves on when it is free
                allowed = max(allowed, min(fault.end, self.now) + bound)
            if fault.kind == "foreign" and fault.begin <= self.now:
                jams = [min(jam.end, self.now) for jam in self.faults if jam.kind == "jam"]
                allowed = max(allowed, max([fault.begin, *jams]) + FOREIGN_MM / s.max_speed + bound)
            if fault.kind == "tenfold" and fault.begin <= self.barred < np.inf:
                allowed = max(allowed, self.barred + 10 * self.model.reach / s.max_speed + bound)
        return allowed

    def judge_standstill(self):
        """Check that the stage stands still if it must."""
        over, bound = self.model.moved - self.last_motion(), self.bound
        self.require(over <= TICK_S, f"moved {over + bound:.3f} s after the end")
        if self.followable > 10.0:
            self.tally.reach("stopping time", over / bound + 1)

    def judge_command(self):
        """Check that a command is allowed now."""
        self.require(not self.is_stopped, "a stopped stage was sent before anybody resumed")
        self.require(not self.lacks_permit, "sent after the permit had been lost")
        if self.settings.permit:
            age = self.now - self.permitted
            self.require(age <= self.settings.stale + 2 * MAX_PLACE_AGE_S, "sent without a permit")

    def judge_step(self, begun, lacked_permit):
        """Check after a step of the loop that the stage is stopped if it must be.

        begun: time at which the step began, s.  lacked_permit: whether the permit was lost then.
        """
        s, patience = self.settings, settling_time(self.settings) + 0.15
        away = float(np.abs(self.model.place - self.model.shadow.place).max())
        if self.tracker.searching:  # from now on the stage follows the measured beam
            self.offset, self.wrong = self.beam - self.model.place, np.inf
        split = float(np.hypot(*(self.beam - self.model.place - self.offset)))
        self.parted = min(self.parted, begun) if away > FOUND_OUT_MM else np.inf
        good = self.good and begun - self.good[-1][0] <= s.stale / 2
        self.wrong = min(self.wrong, begun) if split > FOUND_OUT_MM and good else np.inf
        if self.is_stopped:
            return
        blind = begun - self.followable
        self.require(
            not self.tracker.moves or blind <= max(s.stale, s.bridge) + 2 * TICK_S,
            f"not stopped {blind:.3f} s after the last good sample",
        )
        self.require(not (lacked_permit and self.lacks_permit), "not stopped without a permit")
        self.require(
            min(self.parted, self.wrong) >= begun - patience,
            f"unnoticed: the stage is {away:.3f} mm and the beam {split:.3f} mm astray",
        )

    def judge_prediction(self, sent):
        """Check that some good sample is recent and near enough for a prediction."""
        s = self.settings
        self.require(s.bridge, "predicted where that is turned off")
        time, distance = min(
            (
                ((self.model.sent - taken - TICK_S) / s.bridge,
                 (float(np.hypot(*(sent - apex))) - ROUNDING_MM) / s.bridge_distance)
                for taken, apex in self.good
            ),
            key=max,
        )  # fmt: skip
        self.require(
            max(time, distance) <= 1, f"predicted {time:.3f} and {distance:.3f} of allowed"
        )
        self.tally.counts["predictions"] += 1
        self.tally.reach("time of prediction", time)
        self.tally.reach("distance of prediction", distance)

    def judge_resume(self, by):
        """Check that a stop may end, and note that it has."""
        s, counts = self.settings, self.tally.counts
        self.require(self.now - self.followable <= s.stale + TICK_S, "resumed on nothing to follow")
        self.require(not self.is_moved, "resumed with another zero")
        if by == "auto":
            self.require(s.resume == "auto", "resumed by itself where that is turned off")
            self.require(not self.needs_person, "resumed by itself, and nobody had looked")
            self.auto_resumes += 1
            self.require(self.auto_resumes <= s.resumes_per_hour, "resumed by itself too often")
        counts["resumes after the line was closed"] += (
            self.cable in self.faults and not self.is_moved
        )
        counts[f"resumes by {by}"] += 1
        self.is_stopped = self.needs_person = self.lacks_permit = False
        self.resumed_by = by
        self.barred = self.failed = self.parted = self.wrong = np.inf
        self.offset = self.beam - self.model.place  # a person has checked the beam
        self.model.shadow.place = self.model.place.copy()
        self.model.shadow.target = self.model.place.copy()

    def say(self, name, **more):
        """Note and judge what the tracker tells."""
        self.tally.counts[name] += name in ("move", "search", "resume refused")
        self.tally.counts["found again"] += more.get("outcome") == "found"
        if name == "stop" and not self.closing:
            self.note_stop(more["reason"])
        elif name == "stage error":
            self.needs_person, self.is_asked = True, False
        elif name == "resume":
            self.judge_resume(more["by"])
        elif name == "search":
            self.require(self.tracker.search and self.resumed_by != "auto", "searches by itself")
        elif more.get("predicted"):
            self.judge_prediction(np.array([more["x"], more["y"]]))
        if self.fault("disk full"):
            raise OSError(28, "No space left on device")

    def note_stop(self, reason):
        self.is_stopped = True
        cause = next((words for words in FINDINGS if reason.startswith(words)), None)
        self.tally.counts[f"stopped by: {cause or ' '.join(reason.split(':')[0].split()[:4])}"] += 1
        if cause:
            self.needs_person = True
            kinds = {fault.kind for fault in self.faults}
            self.require(kinds & LIKE_DISOBEDIENCE, f"an obedient stage is blamed: {reason}")
            for kind in kinds.intersection(CONTROLLER):
                self.tally.counts[f"found out: {kind}"] += 1

    def end(self):
        """End tracking: the stage stands, the port is closed, and a pulled cable was told."""
        if self.failing or not self.tracker:
            return
        self.closing = True
        self.tracker.close()
        self.failed = min(self.failed, self.now)
        self.bar()
        self.advance(self.bound + 0.05)
        self.require(self.closed, "the port was left open")
        self.require(self.model.moved <= self.now - 0.04, "the stage still moves")
        self.require(not self.fault("unplug") or self.tracker.error, "a pulled cable was not told")
