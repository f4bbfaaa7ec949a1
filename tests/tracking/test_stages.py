"""Drivers and emulators as exchanged bytes; what the tracker says and does at its face."""

from __future__ import annotations

import re
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sensors import SENSORS
from stage_world import stage_on

import facets
from facets.tracking import (
    ENABLE_S,
    START_WITHIN_S,
    Envelope,
    Law,
    Line,
    Pi,
    StageError,
    Tracker,
    Zaber,
)

STAGE = replace(facets.load("bench").stage, zero=(0.5, 0.0))
PI = replace(STAGE, driver="pi")


class Script:
    """A port that gives prepared replies, whatever it is told.

    chatter: what it says besides, now and then.  late: what it says after 4 s.
    """

    late = b""

    def __init__(self, reply, chatter=b""):
        self.reply, self.chatter, self.now = reply, chatter, 0.0

    def clock(self):
        return self.now

    def write(self, data):
        pass

    def read(self, size):
        self.reply += self.chatter if int(self.now * 50) % 5 == 0 else b""
        self.now += 0.0 if self.reply else 0.02
        if self.now > 4.0:
            self.reply, self.late = self.reply + self.late, b""
        data, self.reply = self.reply[:size], self.reply[size:]
        return data


def driver_on(made, port, settings=STAGE):
    return made(Line(port, port.clock), settings)


def envelope_on(port, settings=STAGE):
    return Envelope(port, settings, print, port.clock)


def test_zaber_speaks_as_its_manual_says():
    port = stage_on(STAGE)
    port.replies = b"!01 0 IDLE --\r\n@01 0 88 OK IDLE -- 7 7\r\n"  # an alert and a late answer
    driver = driver_on(Zaber, port)
    np.testing.assert_allclose(driver.place(), [0.5, 0.0])
    driver.move(np.array([1.5, -0.25]))
    assert [line.partition(":")[0] for line in port.sent] == [
        "/1 0 01 get pos",
        "/1 1 02 move abs 10000",
        "/1 2 03 move abs -2500",
    ]
    spoilt = port.sent[1].replace("10000", "90000")
    assert port.device.receive(spoilt.encode()) == b""
    port.wait(2.0)
    np.testing.assert_allclose(driver.place(), [1.5, -0.25], atol=1e-3)
    driver.stop()
    assert port.sent[-1].startswith("/1 0 05 stop:")


@pytest.mark.parametrize(
    ("reply", "chatter", "words"),
    [
        (b"@01 0 01 OK IDLE -- 10", b"", "has not answered for 5 s"),
        (b"@01 0 01 RJ IDLE -- BADDATA\r\n", b"", "refused 'get pos': BADDATA"),
        (b"@01 0 01 OK IDLE FS 0 0\r\n", b"", "fault, FS"),
        (b"@01 0 01 OK IDLE WR 0 0\r\n", b"", "it was restarted"),
        (b"@01 0\r\n", b"", "cannot be understood"),
        (b"@01 0 01 OK IDLE -- 0 9:00\r\n", b"", "cannot be understood"),
        (b"@01 0 01 OK IDLE -- nan 0\r\n", b"", "cannot be understood"),
        (b"@01 0 01 OK IDLE -- 1\r\n", b"", "cannot be understood"),
        (b"\xff" * 2000, b"", "without line ends"),
        (b"!01 0 IDLE --\r\n" * 2000, b"", "sends data, but does not answer"),
        (b"", b"@01 0 99 OK IDLE -- 0\r\n", "answer"),  # it answers each cry, and nothing else
    ],
)
def test_zaber_says_what_is_wrong(reply, chatter, words):
    port = Script(reply, chatter)
    with pytest.raises(StageError, match=words):
        driver_on(Zaber, port).place()
    assert port.now < 11.0


def test_pi_speaks_as_its_manual_says():
    port = stage_on(PI)
    driver = driver_on(Pi, port, PI)
    np.testing.assert_allclose(driver.place(), [0.5, 0.0])
    driver.move(np.array([1.5, -0.25]))
    assert port.sent == ["POS? 1 2\n", "MOV 1 1.000000 2 -0.250000\nERR?\n"]
    port.wait(2.0)
    np.testing.assert_allclose(driver.place(), [1.5, -0.25], atol=1e-3)
    driver.stop()
    assert port.sent[-1] == "STP\nERR?\n"
    driver.cry()  # leaves an error that is no refusal
    driver.move(np.zeros(2))
    port.device.refuse = True
    with pytest.raises(StageError, match="GCS error 5"):
        driver.move(np.zeros(2))


@pytest.mark.parametrize(
    ("reply", "ask"),
    [
        (b"1=0.5\n", Pi.place),
        (b"1=0.5 \n2=nan\n", Pi.place),
        (b"1=1 \n" * 20, Pi.place),
        (b"taken\n", lambda driver: driver.move(np.zeros(2))),
    ],
)
def test_pi_does_not_believe_garbage(reply, ask):
    with pytest.raises(StageError, match=r"cannot be understood|has no end"):
        ask(driver_on(Pi, Script(reply), PI))


@pytest.mark.parametrize(
    ("made", "settings", "limits"),
    [(Zaber, STAGE, (32768, 3)), (Pi, PI, (2.0, 100.0))],
    ids=["zaber", "pi"],
)
def test_limits_are_written_into_the_controller_whatever_a_step_is_and_given_back(
    made, settings, limits
):
    port = stage_on(replace(settings, max_speed=200.0, acceleration=3e4))
    driver = driver_on(made, port, settings)
    before = driver.read_limits()
    wrong = replace(settings, step=settings.step / 1000, native_limits=limits)
    envelope = envelope_on(port, wrong)
    np.testing.assert_array_equal(driver.read_limits()[[0, -1]].T, [limits] * 2)
    envelope.go(np.array([0.5001, 0.0]), port.now)
    assert port.model.max_speed == pytest.approx(2.0, rel=1e-3)
    assert envelope.close()
    port.closed = False
    np.testing.assert_array_equal(driver.read_limits(), before)


@pytest.mark.parametrize("settings", [STAGE, PI])
def test_a_controller_that_keeps_other_limits_than_it_was_told_is_not_used(settings):
    port = stage_on(settings)
    port.device.set = lambda *_: "0"
    with pytest.raises(StageError, match="the stage keeps the limits"):
        envelope_on(port, replace(settings, max_speed=1.0))
    assert port.closed


def test_a_limit_that_a_controller_does_not_have_is_not_asked_of_it():
    port, missing = stage_on(PI), ("ACC", "DEC")
    answer = port.device.answer

    def answer_without(line):
        if line[:3] not in missing:
            return answer(line)
        port.device.error = 2
        return ""

    port.device.answer = answer_without
    envelope_on(port, PI).close()
    port.closed = False
    with pytest.raises(StageError, match="does not say its ACC"):
        envelope_on(port, replace(PI, native_limits=(1, 1)))


LIGHT, DARK = (0.1, 0.1, 0.1), (0.0, 0.0, 0.0)
GAP_S = STAGE.bridge + STAGE.stale


class Run:
    """A tracker on a virtual stage, whose clock goes on by `go`."""

    def __init__(self, settings=STAGE, search=0.0, again=False, clock=None):
        settings = replace(settings, search_distance=search)
        self.port, self.events, self.opened = stage_on(settings), [], 0
        self.model = self.port.model
        law = Law.from_sensor(SENSORS["paper"], settings)
        opener = self.open_again if again else None
        clock = clock or self.port.clock
        self.tracker = Tracker(self.port, settings, law, self.say, clock, opener)

    def say(self, name, **more):
        self.events.append((name, more))

    def open_again(self):
        self.opened += 1
        if self.port.error:
            raise self.port.error
        self.port.closed = False
        return self.port

    @property
    def names(self):
        return [name for name, _ in self.events]

    def feed(self, apex=(0.55, 0.0), powers=LIGHT, age=0.0, beam=None, **more):
        place = np.full(2, np.nan) if apex is None else np.array(apex, dtype=float)
        beams = None if beam is None else beam[None]
        times = np.array([self.port.now - age])
        self.tracker.feed(times, np.array([powers]), place[None], beams, **more)

    def step(self, seconds=0.01):
        """A step of the loop later."""
        self.port.wait(seconds)
        assert self.tracker.step(), self.tracker.error

    def go(self, seconds=0.01, count=1, **sample):
        """Steps of the loop later, each on a new sample."""
        for _ in range(count):
            self.port.now += seconds
            self.feed(**sample)
            self.step(0.0)

    def steady(self, speed=6.28, count=10):
        """Follow a mirror that moves along x; return its last place."""
        for n in range(count):
            self.go(apex=(0.5 + 0.01 * speed * n, 0.0))
        assert not self.tracker.stop_reason
        return 0.5 + 0.01 * speed * (count - 1)

    def resume(self, **sample):
        """A person waits until the stage stands, and says go."""
        self.tracker.resume("a person")
        self.go(0.5, **sample)

    def lose(self, powers):
        """The mirror is lost, the stage stops, and a person has it look for the mirror."""
        while not self.tracker.stop_reason:
            self.go(apex=None, powers=powers)
        self.resume(apex=None, powers=powers)
        assert self.tracker.searching


@pytest.mark.parametrize(
    "case",
    [
        {"apex": None},
        {"powers": (0.1, 0.0, 0.1)},
        {"powers": (0.1, np.nan, 0.1)},
        {"apex": (5.0, 0.0)},
        {"apex": (np.inf, 0.0)},
    ],
    ids=str,
)
def test_a_stage_begins_stopped_where_the_first_sample_is_not_good(case):
    run = Run()
    run.go(**case)
    run.go(0.1, count=3)  # good ones alone let nothing move
    assert run.tracker.stop_reason
    assert not run.port.device.moves
    run.resume()
    assert run.port.device.moves
    assert run.names == ["stop", "resume", "move"]


@pytest.mark.parametrize("age", [0.06, -10.0])
def test_a_stage_waits_for_a_first_fresh_sample_and_not_for_ever(age):
    run, late = Run(), Run()
    run.go(age=age)
    assert run.tracker.state == "waiting for light"
    run.go()
    assert run.port.device.moves
    late.step()
    late.step(START_WITHIN_S + 0.1)
    late.go()
    assert "no fresh sample came in the first 10 s" in late.tracker.stop_reason
    assert not late.port.device.moves


@pytest.mark.parametrize(
    ("sample", "reason"),
    [
        ({"age": 1.0}, "no fresh sample"),
        ({"late": 0.3}, "no fresh sample: all come 300 ms late"),
        ({"doubt": "the readings do not change"}, "the readings do not change"),
    ],
)
def test_a_stopped_stage_is_not_resumed_on_readings_that_are_not_to_be_followed(sample, reason):
    run = Run(search=2.0)
    run.steady()
    run.go(count=60, **sample)
    assert run.events[-1] == ("stop", {"reason": reason})
    assert run.tracker.state == f"stopped: {reason}"
    moves = run.tracker.moves
    run.resume(**sample)
    assert run.events[-1] == ("resume refused", {"by": "a person", "reason": reason})
    assert run.tracker.note == f"the stage was not resumed: {reason}"
    run.go(0.1, count=10)  # good samples alone change nothing
    assert run.tracker.moves == moves
    run.resume(apex=run.model.place)
    assert ("resume", {"by": "a person", "reason": reason}) in run.events
    assert run.tracker.moves == moves + 1
    assert not run.tracker.note


def test_the_envelope_itself_sends_nothing_while_it_is_stopped_or_that_is_too_old_or_too_far():
    port = stage_on(STAGE)
    envelope, there, origin = envelope_on(port), np.array([0.6, 0.0]), np.array([0.5, 0.0])
    assert envelope.go(there, port.now - STAGE.stale - 0.001) is None
    for age, start in (
        (STAGE.bridge + 0.001, origin),
        (-0.01, origin),
        (0.0, origin + 1.2 * STAGE.bridge_distance),
    ):
        assert envelope.bridge(there, port.now - age, start) is None
    for send in (envelope.go, lambda place, sampled: envelope.bridge(place, sampled, origin)):
        with pytest.raises(StageError, match="not a number"):
            send(np.array([np.nan, 0.0]), port.now)
    envelope.latch("no reason")
    assert envelope.go(there, port.now) is None
    assert envelope.bridge(there, port.now, there) is None
    assert not port.device.moves
    assert envelope.resume("somebody") == "it was stopped just now"
    port.now += 1.0
    envelope.look()
    assert envelope.resume("somebody") == ""
    np.testing.assert_allclose(envelope.bridge(there, port.now - 0.14, origin)[1], 0.0)


def test_no_run_resumes_by_itself_without_poses_and_a_search_is_announced():
    run, dark = Run(replace(STAGE, resume="auto"), search=2.0), {"apex": None, "powers": DARK}
    run.go()
    run.step(GAP_S)
    for n in range(200):
        run.go(**(dark if n % 4 else {}))  # a pose now and then
    assert run.tracker.moves == 1
    assert "resume" not in run.names
    run.go(STAGE.stale, count=2, **dark)
    assert run.tracker.note == "a resume searches for the mirror within 2 mm, in 15 s"
    run.go(count=7)
    assert ("resume", {"by": "auto", "reason": "no fresh sample"}) in run.events
    assert not run.tracker.note


@pytest.mark.parametrize("content", [None, "", "0", "11"])
def test_nothing_moves_without_the_permit(tmp_path, content):
    permit = tmp_path / "permit"
    if content is not None:
        permit.write_text(content)
    run = Run(replace(STAGE, permit=f"file:{permit}"))
    run.go()
    run.resume()
    assert run.tracker.stop_reason == "the external permit is not given"
    assert "permit" in run.tracker.note
    assert not run.port.device.moves
    permit.write_text("1\n")
    run.resume()
    assert run.port.device.moves


def test_nothing_moves_where_the_heartbeat_can_not_be_sent():
    run, frames, works = Run(replace(STAGE, heartbeat="board")), [], True
    run.go()
    assert not run.port.device.moves
    run.tracker.envelope.heartbeat.to_board = lambda data: frames.append(data[3]) or works
    for n in range(10):
        run.go(0.03)
        assert (run.tracker.moves > 0) == (0.03 * n >= ENABLE_S)  # a relay takes its time
    assert frames == [1] * 10
    works = False
    run.go(0.03)
    assert "heartbeat cannot be sent (board)" in run.tracker.stop_reason
    works = True
    run.step(0.03)
    assert frames.pop() == 0  # it lives, and says that the stage may not move


def test_a_heartbeat_ends_with_the_loop(tmp_path):
    beats = tmp_path / "beats"
    run = Run(replace(STAGE, heartbeat=f"file:{beats}"))
    run.step(0.03)
    count = beats.read_text()
    run.port.now += 10.0  # nobody goes round
    run.tracker.envelope.watch()
    assert beats.read_text() == count


def test_a_stage_that_somebody_else_moves_is_stopped():
    run = Run()
    run.go(count=3)
    run.model.command(np.array([2.0, 0.3]))
    while not run.tracker.stop_reason:
        run.step()
    assert "another program moves it" in run.tracker.stop_reason


def test_a_stage_can_be_resumed_after_a_fault_of_its_line_unless_its_reference_was_lost():
    run = Run(search=2.0, again=True)
    for shift in (0.0, 3.0, -3.0):
        run.go()
        moves, opened = run.tracker.moves, run.opened
        run.port.error = OSError(5, "Input/output error")
        run.go(count=2)
        assert "line went away" in run.tracker.error
        assert run.port.closed
        assert run.opened == opened  # nobody has said go
        run.resume()
        assert run.opened == opened + 1
        assert run.tracker.error
        run.port.error = None
        run.port.device.zero = run.port.device.zero - shift
        run.resume()  # opens the line, and the stage stays stopped
        assert not run.tracker.error
        assert run.tracker.moves == moves
        run.resume()
        assert (run.tracker.moves > moves) == (not shift)
        for words in (run.tracker.stop_reason, run.tracker.note):
            assert ("may have lost its reference" in words) == bool(shift)
    assert run.names.count("resume") == 1


def test_a_gap_is_bridged_along_the_motion_and_ends_in_a_stop():
    run = Run()
    last = run.steady(6.28)
    run.go(apex=None)  # one bad sample among good ones stops nothing
    assert run.tracker.state == "following"
    begin, offsets = run.port.now - 0.01, []
    while not run.tracker.stop_reason:
        assert run.tracker.state in ("following", "bridging a gap")
        run.go(apex=None, powers=(0.1, 0.0, 0.1))
        offsets.append(last + 6.28 * (run.port.now - begin) - run.model.place[0])
    assert run.tracker.bridges == 1
    assert run.port.now - begin == pytest.approx(STAGE.bridge, abs=0.011)
    assert np.abs(offsets[:-2]).max() < 0.05
    assert 8 <= sum(more.get("predicted", False) for _, more in run.events) <= 11
    assert run.events[-1] == ("stop", {"reason": "not every detector has light"})


@pytest.mark.parametrize(
    ("settings", "powers", "outcome"),
    [
        ({}, [DARK], "the mirror was not found within 0.6 mm, in 15 s"),
        ({"search_time": 0.1}, [DARK], "the mirror was not found within 0.6 mm, in 0.1 s"),
        ({}, [(0.3, 0, 0), (0, 0.15, 0.15)], "the light led back 6 times"),
    ],
    ids=["distance", "time", "reversals"],
)
def test_a_search_is_limited_in_distance_time_and_reversals(settings, powers, outcome):
    run, places = Run(replace(STAGE, **settings), search=0.6), []
    run.steady()
    home = run.tracker.home.copy()
    run.lose(powers[0])
    assert run.model.place[0] > home[0] + 0.5  # the prediction went on
    while run.tracker.searching and len(places) < 1000:
        run.go(apex=None, powers=powers[len(places) % len(powers)])
        places.append(run.model.place.copy())
    assert run.tracker.stop_reason == outcome
    assert run.names.count("search") == 1
    assert run.names[-2:] == ["search ended", "stop"]
    if outcome.endswith("15 s"):  # it begins at the last good place, and goes round there
        away = np.hypot(*(np.array(places) - home).T)
        assert away.min() < 0.02
        assert 0.5 < away[away.argmin() :].max() < 0.7
    moves = run.tracker.moves
    run.go(apex=None, powers=(0.3, 0.0, 0.0))
    assert run.tracker.moves == moves  # it does not begin again by itself


def test_a_search_goes_towards_the_light_of_a_saturated_detector_and_finds_the_mirror():
    run, powers = Run(search=2.0), (np.inf, 0.01, 0.01)
    run.go()
    run.lose(powers)
    run.go(count=30, apex=None, powers=powers)
    assert run.tracker.state == "searching"
    assert run.model.place[0] < -1.0
    assert abs(run.model.place[1]) < 1e-3
    assert run.tracker.law.locate_apex(np.array([np.nan, 0.1, 0.1]), np.zeros(2), 0.02) is None
    run.go(apex=run.model.place)
    assert ("search ended", {"outcome": "found"}) in run.events


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (OSError("unplugged"), "the stage's line went away: unplugged"),
        (TypeError("no integer"), "tracking failed with an internal error, TypeError: no integer"),
    ],
)
def test_any_error_stops_the_stage_and_is_told(error, words):
    run = Run()
    run.go()
    run.port.error = error
    assert not run.tracker.step()
    assert run.tracker.error == words
    assert run.names.count("stage error") == 1
    assert run.names.count("stop not answered") == 3
    assert run.port.closed
    run.tracker.close()


def test_a_stage_that_answers_after_4_s_is_not_dead():
    driver = driver_on(Zaber, Script(b""))
    driver.line.port.late = b"@01 0 01 OK IDLE -- 0 0\r\n"
    np.testing.assert_allclose(driver.place(), STAGE.zero)


def test_the_watchdog_stops_a_loop_that_stalls():
    run = Run()
    run.go()
    run.tracker.envelope.watch()
    assert not run.tracker.envelope.stalled
    run.port.now += 0.2
    for _ in range(2):
        run.tracker.envelope.watch()
    stop = ("stop", {"reason": "the loop has stalled"})
    assert run.events[-1] == stop
    assert "stop" in run.port.sent[-1]
    run.go(count=2)
    assert run.tracker.stop_reason == "the loop has stalled"
    assert run.events.count(stop) == 1
    run.resume()
    assert run.tracker.moves == 2


def test_the_threads_follow_and_leave_a_stage_that_stands():
    """With the clock of the machine: waits for what happens, however long that takes."""
    run, watching = Run(clock=time.monotonic), threading.Event()
    tracker, watch = run.tracker, run.tracker.envelope.watch

    def watch_late():  # as on a busy machine: it still looks when all is over
        watching.set()
        tracker.ending.wait()
        while not run.port.closed:
            time.sleep(0.01)
        time.sleep(0.05)
        watch()

    tracker.envelope.watch = watch_late
    with tracker:
        while not ("move" in run.names and watching.is_set()):
            run.feed(age=run.port.now - time.monotonic())
            time.sleep(0.01)
    assert run.port.closed
    assert "stop" in run.port.sent[-1]
    assert not tracker.error
    assert not any(thread.is_alive() for thread in tracker.threads)


def test_a_stage_outside_its_limits_is_left_alone():
    port = stage_on(STAGE)
    port.model.place[:] = 8.0
    with pytest.raises(StageError, match="outside its soft limits"):
        envelope_on(port)
    assert not port.device.moves


def test_nobody_reaches_a_stage_but_through_its_envelope():
    """Only envelope.py opens a driver, and nobody else takes its private parts."""
    root = Path(facets.__file__).parent
    drivers = {root / f"tracking/{name}.py"
               for name in ("envelope", "drivers", "zaber", "pi", "kinesis")}  # fmt: skip
    folders = (root, root.parent / "cli", root.parent / "experiments")
    paths = {path for folder in folders for path in folder.rglob("*.py")} - drivers
    assert len(paths) > 100
    forbidden = re.compile(
        r"import (\([^)]*|.*)\b(Zaber|Pi|Kinesis|open_driver|open_kinesis)\b|\._(driver|line)\b"
    )
    for path in paths:
        assert not forbidden.search(path.read_text("utf-8")), path
