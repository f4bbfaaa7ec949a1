"""Drivers and emulators as exchanged bytes; what the tracker does with samples and errors."""

from __future__ import annotations

import ast
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sensors import SENSORS

import facets
from facets.live import PiController, ZaberDevice
from facets.tracking import (
    AUTO_RESUME_AFTER_S,
    ENABLE_S,
    START_WITHIN_S,
    Envelope,
    Law,
    Limits,
    Line,
    Pi,
    StageError,
    StageModel,
    Tracker,
    Zaber,
    checksum,
)
from facets.tracking.search import Search

STAGE = replace(facets.load("bench").stage, zero=(0.5, 0.0))
PI = replace(STAGE, driver="pi")


class Port:
    """A port whose other end is an emulator; `clock` goes on by reading."""

    def __init__(self, device, first=b""):
        self.device, self.sent, self.replies = device, [], first
        self.now, self.closed = 10.0, False
        device.model.now, device.model.STEP = self.now, 2e-3
        self.answers = True

    def clock(self):
        return self.now

    def write(self, data):
        self.sent.append(data.decode())
        answer = self.device.receive(data)
        self.replies += answer if self.answers else b""

    def read(self, size):
        if not self.replies:
            self.now += 0.02
        data, self.replies = self.replies[:size], self.replies[size:]
        return data

    def close(self):
        self.closed = True


class Script:
    """A port that gives prepared replies, whatever it is told."""

    def __init__(self, reply):
        self.reply, self.now = reply, 0.0

    def clock(self):
        return self.now

    def write(self, data):
        pass

    def read(self, size):
        self.now += 0.0 if self.reply else 0.02
        data, self.reply = self.reply[:size], self.reply[size:]
        return data

    def close(self):
        pass


def driver_on(made, port, settings):
    return made(Line(port, port.clock), settings)


def test_zaber_speaks_as_its_manual_says():
    device = ZaberDevice(StageModel(STAGE))
    port = Port(device, b"!01 0 IDLE --\r\n")  # an alert in between is passed over
    driver = driver_on(Zaber, port, STAGE)
    np.testing.assert_allclose(driver.place(), [0.5, 0.0])
    driver.move(np.array([1.5, -0.25]))
    assert [line.partition(":")[0] for line in port.sent] == [
        "/1 0 01 get pos",
        "/1 1 02 move abs 10000",
        "/1 2 03 move abs -2500",
    ]
    device.model.advance(12.0)
    np.testing.assert_allclose(driver.place(), [1.5, -0.25], atol=1e-3)
    driver.stop()
    assert port.sent[-1].startswith("/1 0 05 stop:")


def test_a_spoilt_command_is_not_obeyed_and_a_spoilt_answer_not_believed():
    device = ZaberDevice(StageModel(STAGE))
    good = "1 1 07 move abs 1000"
    assert device.receive(f"/{good}:{checksum(good)}\n".encode()).startswith(b"@01 1 07 OK")
    assert device.receive(f"/{good.replace('1000', '9000')}:{checksum(good)}\n".encode()) == b""
    spoilt = b"@01 0 01 OK IDLE -- 0 9:00\r\n"
    with pytest.raises(StageError, match="cannot be understood"):
        driver_on(Zaber, Script(spoilt), STAGE).place()


def test_a_late_answer_is_told_from_the_one_that_is_waited_for():
    late = b"@01 0 88 OK IDLE -- 7 7\r\n@01 0 01 OK IDLE -- 1000 0\r\n"
    np.testing.assert_allclose(driver_on(Zaber, Script(late), STAGE).place(), [0.6, 0.0])


@pytest.mark.parametrize(
    ("reply", "words"),
    [
        (b"", "has not answered for"),
        (b"@01 0 01 OK IDLE -- 10", "has not answered for"),
        (b"@01 0 01 RJ IDLE -- BADDATA\r\n", "refused 'get pos': BADDATA"),
        (b"@01 0 01 OK IDLE FS 0 0\r\n", "fault, FS"),
        (b"@01 0 01 OK IDLE WR 0 0\r\n", "it was restarted"),
        (b"@01 0\r\n", "cannot be understood"),
        (b"@01 0 01 OK IDLE -- x y\r\n", "cannot be understood"),
        (b"@01 0 01 OK IDLE -- nan 0\r\n", "cannot be understood"),
        (b"@01 0 01 OK IDLE -- 1\r\n", "cannot be understood"),
        (b"\xff" * 2000, "without line ends"),
        (b"!01 0 IDLE --\r\n" * 2000, "sends data, but does not answer"),
    ],
)
def test_zaber_says_what_is_wrong(reply, words):
    with pytest.raises(StageError, match=words):
        driver_on(Zaber, Script(reply), STAGE).place()


def test_pi_speaks_as_its_manual_says():
    controller = PiController(StageModel(PI))
    port = Port(controller)
    driver = driver_on(Pi, port, PI)
    np.testing.assert_allclose(driver.place(), [0.5, 0.0])
    driver.move(np.array([1.5, -0.25]))
    assert port.sent == ["POS? 1 2\n", "MOV 1 1.000000 2 -0.250000\nERR?\n"]
    controller.model.advance(12.0)
    np.testing.assert_allclose(driver.place(), [1.5, -0.25], atol=1e-3)
    driver.stop()
    assert port.sent[-1] == "STP\nERR?\n"
    driver.cry()  # leaves an error that is no refusal
    driver.move(np.zeros(2))
    controller.refuse = True
    with pytest.raises(StageError, match="GCS error 5"):
        driver.move(np.zeros(2))


@pytest.mark.parametrize("reply", [b"1=0.5\n", b"1=0.5 \n2=nan\n", b"what\n", b"1=1 \n" * 20])
def test_pi_does_not_believe_garbage(reply):
    with pytest.raises(StageError, match=r"cannot be understood|has no end"):
        driver_on(Pi, Script(reply), PI).place()


@pytest.mark.parametrize("reply", [b"taken\n", b"0 \n0\n"])
def test_pi_refuses_an_answer_to_a_move_that_is_no_error_code(reply):
    with pytest.raises(StageError, match="cannot be understood"):
        driver_on(Pi, Script(reply), PI).move(np.zeros(2))


@pytest.mark.parametrize("settings", [STAGE, PI])
def test_a_stage_that_is_faster_than_allowed_is_held_back(settings):
    model = StageModel(settings)
    model.max_speed, model.acceleration = 10 * settings.max_speed, 10 * settings.acceleration
    port = Port(ZaberDevice(model) if settings is STAGE else PiController(model))
    envelope = Envelope(port, settings, lambda *_, **__: None, port.clock)
    envelope.go(np.array([3.0, 0.0]), port.now)
    assert model.max_speed == pytest.approx(settings.max_speed, rel=1e-3)
    assert model.acceleration == pytest.approx(settings.acceleration, rel=1e-3)


@pytest.mark.parametrize(
    ("settings", "limits"), [(STAGE, (32768, 3)), (PI, (2.0, 100.0))], ids=["zaber", "pi"]
)
def test_limits_are_written_into_the_controller_whatever_a_step_is_and_given_back(settings, limits):
    model = StageModel(settings)
    model.max_speed, model.acceleration = 200.0, 3e4
    port = Port((PiController if settings is PI else ZaberDevice)(model))
    driver = driver_on(Pi if settings is PI else Zaber, port, settings)
    before = driver.read_limits()
    wrong = replace(settings, step=settings.step / 1000, native_limits=limits)
    envelope = Envelope(port, wrong, lambda *_, **__: None, port.clock)
    np.testing.assert_array_equal(driver.read_limits()[[0, -1]].T, [limits] * 2)
    envelope.go(np.array([0.5001, 0.0]), port.now)
    assert model.max_speed == pytest.approx(2.0, rel=1e-3)
    assert envelope.close()
    np.testing.assert_array_equal(driver.read_limits(), before)


class Keeps(ZaberDevice):
    """A controller that accepts limits and keeps its own."""

    def set(self, axis, name, value):
        return "0"


class KeepsSpeed(PiController):
    """The same, of PI; `lacks` are commands that it does not have."""

    lacks = ()

    def set(self, name, words):
        if name == "MOV":
            super().set(name, words)

    def answer(self, line):
        if line.partition(" ")[0].strip("?") in self.lacks:
            self.error = 2
            return ""
        return super().answer(line)


@pytest.mark.parametrize(
    ("made", "settings"),
    [(Keeps, replace(STAGE, max_speed=1.0)), (KeepsSpeed, replace(PI, max_speed=1.0))],
    ids=["zaber", "pi"],
)
def test_a_controller_that_keeps_other_limits_than_it_was_told_is_not_used(made, settings):
    port = Port(made(StageModel(STAGE)))
    with pytest.raises(StageError, match="the stage keeps the limits"):
        Envelope(port, settings, lambda *_, **__: None, port.clock)
    assert port.closed


def test_a_limit_that_a_controller_does_not_have_is_not_asked_of_it():
    port = Port(KeepsSpeed(StageModel(PI)))
    port.device.lacks = ("ACC", "DEC")
    Envelope(port, PI, lambda *_, **__: None, port.clock)
    with pytest.raises(StageError, match="does not say its ACC"):
        Envelope(port, replace(PI, native_limits=(1, 1)), lambda *_, **__: None, port.clock)


def tracker(settings=STAGE, search=0.0):
    settings = replace(settings, search_distance=search)
    port = Port((ZaberDevice if settings.driver == "zaber" else PiController)(StageModel(settings)))
    events = []
    law = Law.from_sensor(SENSORS["paper"], settings)

    def say(name, **more):
        events.append((name, more))

    return Tracker(port, settings, law, say, clock=port.clock), port, events


def feed(follower, port, apex=(0.55, 0.0), powers=(0.1, 0.1, 0.1), age=0.0):
    place = np.full(2, np.nan) if apex is None else np.array(apex, dtype=float)
    follower.feed(np.array([port.now - age]), np.array([powers]), place[None])


def moves_of(port):
    return sum("move" in line or "MOV" in line for line in port.sent)


BAD_SAMPLES = [
    {"apex": None},
    {"powers": (0.1, 0.0, 0.1)},
    {"powers": (0.1, np.nan, 0.1)},
    {"apex": (5.0, 0.0)},
    {"apex": (np.inf, 0.0)},
]


def resume(follower, port, **sample):
    """A person who waits until the stage stands, and says go."""
    port.now += 0.5
    port.device.model.advance(port.now)
    feed(follower, port, **sample)
    follower.resume("a person")
    assert follower.step()


@pytest.mark.parametrize("settings", [STAGE, PI])
@pytest.mark.parametrize("case", BAD_SAMPLES, ids=str)
def test_a_stage_begins_stopped_where_the_first_sample_is_not_good(settings, case):
    follower, port, events = tracker(settings)
    feed(follower, port, **case)
    for _ in range(3):
        assert follower.step()
        assert follower.stop_reason
        port.now += 0.1
        feed(follower, port)  # good ones alone let nothing move
    assert moves_of(port) == 0
    assert follower.envelope.latched
    resume(follower, port)
    assert moves_of(port) > 0
    assert [name for name, _ in events] == ["stop", "resume", "move"]


@pytest.mark.parametrize("age", [0.06, -10.0])
def test_a_stage_waits_for_a_first_fresh_sample_and_not_for_ever(age):
    follower, port, _ = tracker()
    feed(follower, port, age=age)
    assert follower.step()
    assert follower.state == "waiting for light"
    feed(follower, port)
    assert follower.step()
    assert moves_of(port) > 0
    follower, port, _ = tracker()
    assert follower.step()
    port.now += START_WITHIN_S + 0.1
    assert follower.step()
    feed(follower, port)
    assert follower.step()
    assert "no fresh sample came in the first 10 s" in follower.stop_reason
    assert moves_of(port) == 0


def test_a_good_sample_counts_until_it_is_stale():
    follower, port, events = tracker()
    feed(follower, port)
    follower.step()
    feed(follower, port, apex=None)  # one bad sample among good ones stops nothing
    follower.step()
    assert follower.moves == 2
    port.now += 0.06
    feed(follower, port, apex=None)
    follower.step()
    assert follower.state == "bridging a gap"
    assert events[-1][1]["predicted"]
    port.now += STAGE.bridge
    feed(follower, port, apex=None)
    follower.step()
    assert follower.moves == 3
    assert follower.stop_reason == "no pose"
    assert follower.state == "stopped: no pose"
    assert events[-1] == ("stop", {"reason": "no pose"})


def test_a_stopped_stage_stays_stopped_until_a_person_says_go():
    follower, port, events = tracker()
    steady(follower, port, 6.28)
    while not follower.stop_reason:
        port.now += 0.01
        feed(follower, port, apex=None)
        assert follower.step()
    moves = follower.moves
    for _ in range(100):
        port.now += 0.1
        feed(follower, port)
        assert follower.step()
    assert follower.moves == moves
    follower.resume("a person")
    port.now += 0.1  # a stale sample is no reason to go, whoever says so
    assert follower.step()
    assert events[-1] == ("resume refused", {"by": "a person", "reason": "no fresh sample"})
    assert "not resumed: no fresh sample" in follower.note
    feed(follower, port)
    assert follower.step()
    assert follower.moves == moves
    resume(follower, port)
    assert follower.moves == moves + 1
    assert ("resume", {"by": "a person", "reason": "no pose"}) in events
    assert not follower.note


def test_a_stage_is_not_resumed_on_late_data_and_not_by_itself_where_a_clock_moved():
    follower, port, events = tracker(replace(STAGE, resume="auto"), search=2.0)
    steady(follower, port, 6.28)
    moves, light, place = follower.moves, np.full((1, 3), 0.1), np.array([[0.55, 0.0]])
    for n in range(100):
        port.now += 0.05
        port.device.model.advance(port.now)
        follower.feed(np.array([port.now]), light, place, late=0.3 * (n < 50))
        if n == 40:
            follower.halt("the clock has moved")
            follower.resume("a person")
        assert follower.step()
    assert follower.moves == moves + 2  # predicted ones
    assert "the stage was not resumed: no fresh sample: all come 300 ms late" in follower.note
    assert follower.stop_reason.startswith("no fresh sample")
    resume(follower, port)
    assert follower.moves > moves + 2
    follower.halt("the clock has moved")
    assert follower.step()
    assert ("stop", {"reason": "the clock has moved"}) in events


def test_the_envelope_itself_sends_nothing_while_it_is_stopped():
    port = Port(ZaberDevice(StageModel(STAGE)))
    envelope = Envelope(port, STAGE, lambda *_, **__: None, port.clock)
    there = np.array([0.55, 0.0])
    envelope.latch("no reason")
    assert envelope.go(there, port.now) is None
    assert envelope.bridge(there, port.now, there) is None
    assert moves_of(port) == 0
    assert envelope.resume("somebody") == "it was stopped just now"
    port.now += 1.0
    envelope.look()
    assert envelope.resume("somebody") == ""
    assert envelope.go(there, port.now) is not None


def test_readings_that_are_not_to_be_trusted_stop_and_nobody_resumes_on_them():
    follower, port, _ = tracker(search=2.0)
    steady(follower, port, 6.28)
    light, place = np.full((1, 3), 0.1), np.array([[0.55, 0.0]])
    for n in range(100):
        port.now += 0.01
        port.device.model.advance(port.now)
        follower.feed(np.array([port.now]), light, place, doubt="the readings do not change")
        if n == 90:
            follower.resume("a person")
        assert follower.step()
    assert follower.stop_reason == "the readings do not change"
    assert follower.note == "the stage was not resumed: the readings do not change"
    moves = follower.moves
    resume(follower, port, apex=port.device.model.place)
    assert follower.moves > moves


def stop_for_a_gap(follower, port):
    """A gap that is longer than may be bridged, and the end of it."""
    port.now += STAGE.bridge + STAGE.stale
    port.device.model.advance(port.now)
    assert follower.step()
    assert follower.envelope.latched
    feed(follower, port)


def find(follower, port):
    """Poses for 60 ms."""
    for _ in range(7):
        feed(follower, port)
        assert follower.step()
        port.now += 0.01


def test_an_unattended_run_resumes_by_itself_no_more_often_than_it_may():
    follower, port, events = tracker(replace(STAGE, resume="auto", resumes_per_hour=2))
    feed(follower, port)
    assert follower.step()
    for n in range(4):
        stop_for_a_gap(follower, port)
        assert follower.step()
        assert follower.envelope.latched  # not before it has stood for a second
        port.now += AUTO_RESUME_AFTER_S
        find(follower, port)
        assert bool(follower.envelope.latched) == (n >= 2)
        if n >= 2:
            resume(follower, port)
    assert [more["by"] for name, more in events if name == "resume"] == [
        "auto", "auto", "a person", "a person",
    ]  # fmt: skip
    port.now += 3600
    stop_for_a_gap(follower, port)
    port.now += AUTO_RESUME_AFTER_S
    find(follower, port)
    assert not follower.envelope.latched


def test_no_run_resumes_by_itself_without_poses_and_a_search_is_announced():
    follower, port, events = tracker(replace(STAGE, resume="auto"), search=2.0)
    feed(follower, port)
    assert follower.step()
    stop_for_a_gap(follower, port)
    moves, dark = follower.moves, {"apex": None, "powers": (0.0, 0.0, 0.0)}
    for n in range(300):
        port.now += 0.01
        feed(follower, port, **(dark if n % 4 else {}))  # a pose now and then
        assert follower.step()
    assert follower.moves == moves
    assert "resume" not in [name for name, _ in events]
    feed(follower, port, **dark)
    port.now += STAGE.stale
    feed(follower, port, **dark)
    assert follower.step()
    assert follower.note == "a resume searches for the mirror within 2 mm, in 15 s"
    find(follower, port)
    assert ("resume", {"by": "auto", "reason": "no fresh sample"}) in events
    assert not follower.note


def test_no_run_resumes_by_itself_after_a_fault_of_the_stage(tmp_path):
    permit = tmp_path / "permit"
    permit.write_text("1\n")
    follower, port, _ = tracker(replace(STAGE, resume="auto", permit=f"file:{permit}"))
    feed(follower, port)
    assert follower.step()
    permit.write_text("0\n")
    assert follower.step()
    permit.write_text("1\n")
    for _ in range(100):
        port.now += 0.1
        feed(follower, port)
        assert follower.step()
    assert follower.stop_reason == "the external permit is not given"
    assert follower.moves == 1
    resume(follower, port)
    assert follower.moves == 2


@pytest.mark.parametrize("content", [None, "", "0", "11", "yes"])
def test_nothing_moves_without_the_permit(tmp_path, content):
    if content is not None:
        (tmp_path / "permit").write_text(content)
    follower, port, _ = tracker(replace(STAGE, permit=f"file:{tmp_path / 'permit'}"))
    feed(follower, port)
    assert follower.step()
    resume(follower, port)
    assert "permit" in follower.stop_reason
    assert "permit" in follower.note
    assert moves_of(port) == 0


def test_a_boards_permit_holds_while_samples_are_fresh_and_no_loss_is_too_short():
    follower, port, _ = tracker(replace(STAGE, permit="board"))
    place, light = np.array([[0.55, 0.0]]), np.full((1, 3), 0.1)

    def take(permit):
        follower.feed(np.array([port.now]), light, place, permit=permit)

    take(True)
    assert follower.step()
    assert follower.moves == 1
    take(False)
    take(True)
    assert follower.envelope.go(np.array([0.55, 0.0]), port.now) is None
    assert follower.step()
    assert follower.stop_reason == "the external permit is not given"
    assert follower.moves == 1
    port.now += 0.5
    take(True)
    follower.resume("a person")
    assert follower.step()
    assert follower.moves == 2
    follower, port, _ = tracker(replace(STAGE, permit="board"))
    take(True)
    assert follower.step()
    port.now += 0.1  # a gap that is bridged, but not without a permit
    assert follower.step()
    assert follower.state == "bridging a gap"
    assert follower.moves == 1


def test_nothing_moves_where_the_heartbeat_can_not_be_sent():
    follower, port, _ = tracker(replace(STAGE, heartbeat="board"))
    feed(follower, port)
    assert follower.step()
    assert moves_of(port) == 0
    frames, works = [], True

    def send(data):
        frames.append(data)
        return works

    follower.envelope.heartbeat.to_board = send
    for n in range(10):
        port.now += 0.03
        feed(follower, port)
        assert follower.step()
        assert (follower.moves > 0) == (0.03 * n >= ENABLE_S)  # a relay takes its time
    assert [frame[3] for frame in frames] == [1] * 10
    works = False
    port.now += 0.03
    feed(follower, port)
    assert follower.step()
    assert "heartbeat cannot be sent (board)" in follower.stop_reason
    works = True
    port.now += 0.03
    assert follower.step()
    assert frames[-1][3] == 0  # it lives, and says that the stage may not move


def test_a_heartbeat_ends_with_the_loop(tmp_path):
    follower, port, _ = tracker(replace(STAGE, heartbeat=f"file:{tmp_path / 'beats'}"))
    for _ in range(3):
        port.now += 0.03
        assert follower.step()
    count = (tmp_path / "beats").read_text()
    port.now += 10.0  # nobody goes round
    follower.envelope.watch()
    assert (tmp_path / "beats").read_text() == count


class Other(ZaberDevice):
    """A controller that accepts every move and does another one."""

    how = staticmethod(lambda place, goal: goal)

    def move(self, axis, words):
        reply = super().move(axis, words)
        self.model.waiting[-1] = (self.model.waiting[-1][0],
                                  self.how(self.model.place, self.target))  # fmt: skip
        return reply


@pytest.mark.parametrize(
    ("how", "words"),
    [
        (lambda place, goal: place, "has moved 0.000 mm of it"),
        (lambda place, goal: place + 0.02 * (goal - place), "accepted a move of"),
        (lambda place, goal: 2 * place - goal, "the wrong way or too far"),
        (lambda place, goal: place + 10 * (goal - place), "the wrong way or too far"),
        (lambda place, goal: place + (goal - place)[::-1], "the wrong way or too far"),
    ],
    ids=["stands", "stops short", "backwards", "tenfold", "swapped"],
)
def test_a_move_that_is_not_executed_stops_and_latches(how, words):
    follower, port, events = tracker()
    port.device.__class__ = Other
    port.device.how = how
    for _ in range(60):
        port.now += 0.01
        port.device.model.advance(port.now)
        feed(follower, port, apex=(1.0, 0.1))
        assert follower.step()
        if follower.stop_reason:
            break
    assert words in follower.stop_reason
    assert events[-1] == ("stop", {"reason": follower.stop_reason})
    assert "stop" in port.sent[-1]
    assert abs(port.device.model.place - 0.5).max() < 1.5


def test_a_stage_that_somebody_else_moves_is_stopped():
    follower, port, _ = tracker()
    for _ in range(3):
        port.now += 0.01
        port.device.model.advance(port.now)
        feed(follower, port)
        assert follower.step()
    port.device.model.command(np.array([2.0, 0.3]))
    for _ in range(30):
        port.now += 0.01
        port.device.model.advance(port.now)
        assert follower.step(), follower.error
        if follower.stop_reason:
            break
    assert "another program moves it" in follower.stop_reason


def test_an_encoder_that_the_readings_contradict_stops_the_stage():
    follower, port, _ = tracker()
    light = np.full((1, 3), 0.1)
    for n in range(100):
        port.now += 0.01
        port.device.model.advance(port.now)
        apex = np.array([[0.5 + 0.01 * n, 0.0]])
        beam = 0.5 + 0.5 * (port.device.model.place - 0.5)  # half as far as the encoder says
        follower.feed(np.array([port.now]), light, apex, beam[None])
        assert follower.step()
        if follower.stop_reason:
            break
    assert "the encoder disagrees with the readings" in follower.stop_reason


def test_a_stage_that_follows_at_full_speed_arrives_in_time():
    """No move that is executed as its settings say is taken for one that is not."""
    for settings in (
        STAGE,
        replace(STAGE, lag=0.03, acceleration=200.0),
        replace(STAGE, step=0.01),
    ):
        follower, port, _ = tracker(settings)
        for n in range(600):
            port.now += 0.01
            port.device.model.advance(port.now)
            apex = 0.5 + 0.4 * np.sin(0.1 * n)
            beam = port.device.model.place[None]
            follower.feed(np.array([port.now]), np.full((1, 3), 0.1), np.array([[apex, 0]]), beam)
            assert follower.step()
            assert not follower.stop_reason


def test_soft_limits_are_the_stages_own_whatever_offset_is_set():
    settings = replace(STAGE, zero=(3.0, -2.0), low=(-1.0, -1.0), high=(1.0, 1.0))
    model = StageModel(settings)
    port = Port(ZaberDevice(model))
    envelope = Envelope(port, settings, lambda *_, **__: None, port.clock)
    for _ in range(400):
        port.now += 0.01
        model.advance(port.now)
        envelope.look()
        envelope.go(np.array([9.0, 9.0]), port.now)
    np.testing.assert_allclose(model.place - model.settings.zero, [1.0, 1.0], atol=1e-3)
    units = [int(line.split()[5].partition(":")[0]) for line in port.sent if "move abs" in line]
    assert max(units) == round(1.0 / settings.step)


def test_a_stage_can_be_resumed_after_a_fault_of_its_line():
    port = Pulled(ZaberDevice(StageModel(STAGE)))
    law, opened = Law.from_sensor(SENSORS["paper"], STAGE), []

    def open_again():
        opened.append(port.pulled)
        if port.pulled:
            raise port.pulled
        port.closed = False
        return port

    follower = Tracker(port, STAGE, law, lambda *_, **__: None, port.clock, open_again)
    feed(follower, port)
    assert follower.step()
    port.pulled = OSError(5, "Input/output error")
    assert follower.step()
    assert "line went away" in follower.error
    assert port.closed
    assert follower.step()
    assert not opened  # nobody has said go
    follower.resume("a person")
    assert follower.step()
    assert len(opened) == 1
    assert follower.error
    port.pulled = None
    moves = follower.moves
    resume(follower, port)
    assert not follower.error
    assert follower.envelope.latched
    feed(follower, port)
    assert follower.step()
    assert follower.moves == moves + 1
    follower.close()
    assert port.closed


@pytest.mark.parametrize("settings", [STAGE, PI])
def test_a_reference_that_was_lost_while_the_line_was_closed_is_accepted_by_no_resume(settings):
    follower, port, events = tracker(settings, search=2.0)
    follower.envelope.open_again = lambda: port
    for shift, is_resumed in ((0.0, True), (3.0, False), (-3.0, False)):
        feed(follower, port)
        assert follower.step()
        moves = follower.moves
        follower.envelope.fail("the line went away")
        follower.error = "the line went away"
        port.device.zero = port.device.zero - shift
        for _ in range(2):  # the first opens the line again
            resume(follower, port)
        assert (follower.moves > moves) == is_resumed
    assert "may have lost its reference" in follower.stop_reason
    assert "may have lost its reference" in follower.note
    assert [name for name, _ in events].count("resume") == 1


def steady(follower, port, speed, count=10):
    """Feeds a mirror that moves along x, each 10 ms a sample; where it is at last."""
    for n in range(count):
        port.now = port.now + 0.01 if n else port.now
        port.device.model.advance(port.now)
        apex = (0.5 + 0.01 * speed * n, 0.0)
        feed(follower, port, apex=apex)
        assert follower.step()
        assert not follower.stop_reason
    return apex[0]


@pytest.mark.parametrize("speed", [6.28, 18.0])
def test_a_gap_is_bridged_along_the_motion_for_so_long_and_so_far_and_ends_in_a_stop(speed):
    follower, port, events = tracker()
    last, begin = steady(follower, port, speed), port.now
    events.clear()
    offsets = []
    while not follower.stop_reason:
        port.now += 0.01
        port.device.model.advance(port.now)
        feed(follower, port, apex=None, powers=(0.1, 0.0, 0.1))
        assert follower.step()
        offsets.append(last + speed * (port.now - begin) - port.device.model.place[0])
        assert port.now - begin < 1.0
    predicted = [(name, more) for name, more in events if more.get("predicted")]
    assert follower.bridges == 1
    assert 8 <= len(predicted) <= 11
    assert port.now - begin == pytest.approx(STAGE.bridge, abs=0.011)
    away = max(more["x"] for _, more in predicted) - last
    assert away <= STAGE.bridge_distance + 1e-5
    if speed < 10:  # else it is bound by the distance
        assert np.abs(offsets[:-2]).max() < 0.05
    else:
        assert away == pytest.approx(STAGE.bridge_distance, abs=1e-3)
    assert events[-1] == ("stop", {"reason": "not every detector has light"})
    moves = follower.moves
    for _ in range(20):
        port.now += 0.01
        feed(follower, port, apex=None, powers=(0.1, 0.0, 0.1))
        assert follower.step()
    assert follower.moves == moves


def test_no_gap_is_bridged_where_that_is_turned_off():
    follower, port, events = tracker(replace(STAGE, bridge=0.0))
    steady(follower, port, 6.28)
    port.now += 0.06
    assert follower.step()
    assert follower.stop_reason == "no fresh sample"
    assert not any(more.get("predicted") for _, more in events)


def test_the_envelope_predicts_no_older_and_no_further_than_the_settings_allow():
    port = Port(ZaberDevice(StageModel(STAGE)))
    envelope = Envelope(port, STAGE, lambda *_, **__: None, port.clock)
    there, origin = np.array([0.6, 0.0]), np.array([0.5, 0.0])
    assert envelope.bridge(there, port.now - STAGE.bridge - 0.001, origin) is None
    assert envelope.bridge(there, port.now + 0.01, origin) is None
    assert envelope.bridge(there, port.now, origin + 1.2 * STAGE.bridge_distance) is None
    assert moves_of(port) == 0
    np.testing.assert_allclose(envelope.bridge(there, port.now - 0.14, origin)[1], 0.0)
    with pytest.raises(StageError, match="not a number"):
        envelope.bridge(np.array([np.nan, 0.0]), port.now, origin)


def test_a_loss_stops_and_only_search_looks():
    for search in (0.0, 2.0):
        follower, port, _ = tracker(search=search)
        feed(follower, port)
        follower.step()
        port.now += STAGE.bridge
        dark = {"apex": None, "powers": (0.0, 0.0, 0.0)}
        for _ in range(6):
            port.now += 0.06
            port.device.model.advance(port.now)
            feed(follower, port, **dark)
            assert follower.step()
        assert follower.moves == 1
        resume(follower, port, **dark)
        assert (follower.moves > 1) == follower.searching == bool(search)
        assert ("not resumed" in follower.note) != bool(search)


def lose(follower, port, powers=(0.0, 0.0, 0.0)):
    """The mirror is gone, the stage stops, and a person has it look for the mirror."""
    while not follower.stop_reason:
        port.now += 0.01
        port.device.model.advance(port.now)
        feed(follower, port, apex=None, powers=powers)
        assert follower.step()
    resume(follower, port, apex=None, powers=powers)
    assert follower.searching


def test_a_search_does_not_move_on_stale_data():
    follower, port, _ = tracker(search=2.0)
    feed(follower, port)
    follower.step()
    for _ in range(50):
        port.now += 10.0
        assert follower.step()
        feed(follower, port, apex=None, powers=(0.0, 0.0, 0.0), age=10.0)
        assert follower.step()
    assert follower.moves == 1


def test_a_search_in_the_dark_ends_and_says_so():
    follower, port, events = tracker(search=2.0)
    feed(follower, port)
    follower.step()
    lose(follower, port)
    cycles, places = 0, []
    while "not found" not in follower.stop_reason:
        cycles += 1
        assert cycles < 10_000
        port.now += 0.01
        port.device.model.advance(port.now)
        places.append(port.device.model.place.copy())
        feed(follower, port, apex=None, powers=(0.0, 0.0, 0.0))
        assert follower.step()
    names = [name for name, _ in events]
    assert names.count("search") == 1
    assert names[-2:] == ["search ended", "stop"]
    away = np.hypot(*(np.array(places) - places[0]).T)
    assert 1.8 < away.max() < 2.2
    steps = np.hypot(*np.diff([[m["x"], m["y"]] for n, m in events if n == "move"], axis=0).T)
    assert steps[1:].max() <= STAGE.max_step
    before = follower.moves
    feed(follower, port, apex=None, powers=(0.3, 0.0, 0.0))
    follower.step()
    assert follower.moves == before  # it does not begin again by itself
    resume(follower, port, apex=None, powers=(0.3, 0.0, 0.0))
    assert follower.moves == before + 1
    assert follower.searching


def test_a_search_in_the_dark_begins_at_the_last_good_place():
    follower, port, events = tracker(search=2.0)
    steady(follower, port, 6.28)
    home = follower.home.copy()
    lose(follower, port)
    search = next(more for name, more in events if name == "search")
    assert search["reason"] == "not every detector has light"
    assert search["x"] > home[0] + 0.5  # the prediction went on
    np.testing.assert_allclose(follower.search.centre, home, atol=0.02)


def test_a_saturated_detector_shows_the_way_and_is_not_followed():
    follower, port, _ = tracker(search=2.0)
    feed(follower, port)
    follower.step()
    lose(follower, port, powers=(np.inf, 0.01, 0.01))
    for _ in range(30):
        port.now += 0.01
        port.device.model.advance(port.now)
        feed(follower, port, apex=None, powers=(np.inf, 0.01, 0.01))
        assert follower.step()
    assert follower.state == "searching"
    assert port.device.model.place[0] < -1.0
    assert abs(port.device.model.place[1]) < 1e-3
    dark = follower.law.locate_apex(np.array([np.nan, 0.1, 0.1]), np.zeros(2), 0.02)
    assert dark is None


def test_a_search_goes_towards_the_light_and_finds_it():
    follower, port, events = tracker(search=2.0)
    feed(follower, port)
    follower.step()
    apex = np.array([2.0, -1.0])
    lose(follower, port, powers=(0.3, 0.0, 0.0))
    for _ in range(2000):
        port.now += 0.01
        port.device.model.advance(port.now)
        place = port.device.model.place
        state = np.array([*apex, 0, 0, 0, 0, *place])
        powers = facets.readings(SENSORS["paper"], state)[2::3]
        powers = np.where(powers > 1e-4, powers, 0.0)
        near = np.hypot(*(apex - place)) < 0.3
        feed(follower, port, apex=apex if near else None, powers=powers)
        assert follower.step()
        if near and not follower.stop_reason:
            break
    assert ("search ended", {"outcome": "found"}) in events


def test_a_search_is_limited_in_place_time_distance_and_reversals():
    limits = replace(STAGE, max_step=0.01, zero=(0, 0), low=(-1, -1), high=(1, 1))
    search = Search(replace(limits, search_distance=2.0, search_time=60.0))
    place, places, here = np.zeros(2), [], np.zeros(2)
    while (goal := search.next(0.01 * len(places), place, None, here)) is not None:
        place = search.limits.hold(goal, place)
        places.append(place)
    assert search.outcome == "the mirror was not found within 2 mm, in 60 s"
    assert np.hypot(*np.diff(places, axis=0).T).max() <= 0.01 + 1e-12
    assert np.abs(places).max() == 1.0
    stuck, now = Search(replace(STAGE, search_distance=2.0)), 0.0
    while stuck.next(now, here, None, here) is not None:  # a stage that does not follow
        now += 0.01
    assert now == pytest.approx(STAGE.search_time, abs=0.02)
    hunting, goals = Search(replace(STAGE, search_distance=0.3)), []
    towards = np.array([1.0, 0.0])
    while (goal := hunting.next(0.0, here, towards, here)) is not None:
        goals.append(goal[0])
        towards = -towards
    np.testing.assert_allclose(np.abs(goals), 0.3)
    assert len(goals) == STAGE.search_reversals + 2
    assert hunting.outcome == "the light led back 6 times"


class Pulled(Port):
    """Its cable is pulled when `pulled` is set, with whatever error."""

    pulled: BaseException | None = None

    def write(self, data):
        if self.pulled is not None:
            raise self.pulled
        super().write(data)

    def read(self, size):
        if self.pulled is not None:
            raise self.pulled
        return super().read(size)


def errors():
    import serial

    return [
        serial.SerialException("device disconnected"),
        serial.PortNotOpenError(),
        OSError(5, "Input/output error"),
        ValueError("garbled"),
        TypeError("'NoneType' object cannot be interpreted as an integer"),
        StageError("no"),
        MemoryError(),
    ]


@pytest.mark.parametrize("error", errors(), ids=lambda error: type(error).__name__)
def test_any_error_stops_the_stage_and_is_told(error):
    port = Pulled(ZaberDevice(StageModel(STAGE)))
    events = []

    def say(name, **more):
        events.append(name)
        raise OSError(28, "No space left on device")  # telling fails, too

    law = Law.from_sensor(SENSORS["paper"], STAGE)
    follower = Tracker(port, STAGE, law, say, clock=port.clock)
    feed(follower, port)
    assert follower.step()
    port.pulled = error
    assert not follower.step()
    assert follower.error
    assert "stage error" in events
    assert events.count("stop not answered") == 3
    assert port.closed
    follower.close()
    follower.close()


def test_a_bug_in_the_law_stops_the_stage_by_its_stop():
    follower, port, _ = tracker()
    feed(follower, port)
    assert follower.step()
    follower.law.speed = None
    port.now += 0.01
    feed(follower, port)
    assert not follower.step()
    assert "an internal error, TypeError" in follower.error
    assert "stop" in port.sent[-1]
    assert port.closed


def test_a_stage_that_answers_late_is_not_dead_and_one_that_does_not_is():
    follower, port, _ = tracker()
    port.answers = False
    begin = port.now
    assert not follower.step()
    assert "has not answered for 5 s" in follower.error
    assert port.now - begin >= 5.0
    follower, port, _ = tracker()
    read = port.read

    def late(size):
        port.read, port.now = read, port.now + 4.0
        return b""

    port.read = late
    assert follower.step()


def test_the_watchdog_stops_a_loop_that_stalls():
    follower, port, events = tracker()
    feed(follower, port)
    follower.step()
    follower.envelope.watch()
    assert not follower.envelope.stalled
    port.now += 0.2
    follower.envelope.watch()
    follower.envelope.watch()
    assert [more["reason"] for name, more in events if name == "stop"] == ["the loop has stalled"]
    assert "stop" in port.sent[-1]
    feed(follower, port)
    assert follower.step()
    assert follower.stop_reason == "the loop has stalled"
    feed(follower, port)
    assert follower.step()
    assert follower.stop_reason == "the loop has stalled"
    moves = follower.moves
    resume(follower, port)
    assert follower.moves == moves + 1


def test_the_threads_follow_and_leave_a_stage_that_stands():
    """With the clock of the machine: waits for what happens, however long that takes."""
    port = Port(ZaberDevice(StageModel(STAGE)))
    moved = threading.Event()
    law = Law.from_sensor(SENSORS["paper"], STAGE)

    def say(name, **more):
        if name == "move":
            moved.set()

    def read(size):
        data, port.replies = port.replies[:size], port.replies[size:]
        return data

    port.read = read
    port.now = None
    follower = Tracker(port, STAGE, law, say)
    watch, watching = follower.envelope.watch, threading.Event()

    def watch_late():  # as on a busy machine: it still looks when all is over
        watching.set()
        follower.ending.wait()
        while not port.closed:
            time.sleep(0.01)
        time.sleep(0.2)
        watch()

    follower.envelope.watch = watch_late
    with follower:
        while not (moved.is_set() and watching.is_set()):
            now = time.monotonic()
            follower.feed(np.array([now]), np.full((1, 3), 0.1), np.array([[0.55, 0.0]]))
            moved.wait(0.01)
    assert port.closed
    assert "stop" in port.sent[-1]
    assert not follower.error
    assert not any(thread.is_alive() for thread in follower.threads)


def test_a_stage_outside_its_limits_is_left_alone():
    model = StageModel(STAGE)
    model.place[:] = 8.0
    port = Port(ZaberDevice(model))
    with pytest.raises(StageError, match="outside its soft limits"):
        Envelope(port, STAGE, lambda *_, **__: None, port.clock)
    assert moves_of(port) == 0
    assert port.closed


def test_limits_hold_a_command():
    limits = Limits((-1.0, -1.0), (1.0, 1.0), 20.0, 0.1)
    np.testing.assert_allclose(limits.hold(np.array([9.0, 0.0]), np.zeros(2)), [0.1, 0.0])
    np.testing.assert_allclose(limits.hold(np.array([9.0, 0.0]), np.array([0.95, 0])), [1.0, 0.0])


def test_nobody_reaches_a_stage_but_through_its_envelope():
    """Only envelope.py opens a driver, and nobody else takes its private parts."""
    root = Path(facets.__file__).parent
    folders = [root, root.parent / "cli", root.parent / "experiments"]
    allowed = {"envelope.py", "drivers.py", "zaber.py", "pi.py", "kinesis.py"}
    drivers = {"Zaber", "Pi", "Kinesis", "open_driver", "open_kinesis"}
    looked_at = 0
    for path in (path for folder in folders for path in folder.rglob("*.py")):
        looked_at += 1
        text = path.read_text("utf-8")
        if not any(word in text for word in (*drivers, "_driver", "_line")):
            continue
        for node in ast.walk(ast.parse(text)):
            names = {alias.name for alias in getattr(node, "names", []) if alias is not None
                     and isinstance(alias, ast.alias)}  # fmt: skip
            if path.name not in allowed:
                assert not names & drivers, f"{path} takes a driver"
                assert not (
                    isinstance(node, ast.Attribute) and node.attr in ("_driver", "_line")
                ), f"{path} reaches past the envelope"
    assert looked_at > 100


def test_answers_to_other_commands_do_not_keep_a_dead_stage_alive():
    """A stage that answers each cry, and never the command, is given up as one that is silent."""
    port = Script(b"")
    read = port.read

    def chatter(size):
        port.reply += b"@01 0 99 OK IDLE -- 0\r\n" if int(port.now * 50) % 5 == 0 else b""
        return read(size)

    port.read = chatter
    with pytest.raises(StageError, match="answer"):
        driver_on(Zaber, port, STAGE).place()
    assert port.now < 11.0
