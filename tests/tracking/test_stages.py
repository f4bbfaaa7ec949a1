"""Drivers and emulators as exchanged bytes; what the tracker says and does at its face."""

from __future__ import annotations

import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sensors import SENSORS
from stage_world import stage_on

import facets
from facets.tracking import (
    DRIVERS,
    ENABLE_S,
    Envelope,
    Law,
    SolvedSamples,
    StageError,
    Tracker,
    open_driver,
)

STAGE = replace(facets.load("bench").stage, zero=(0.5, 0.0))
PI = replace(STAGE, driver="pi")
NOWHERE = (np.nan, np.nan)
LIGHT, DARK = (0.1, 0.1, 0.1), (0.0, 0.0, 0.0)
GAP_S = STAGE.bridge + STAGE.stale


def scripted(reply, chatter=b""):
    """A port that gives a prepared reply, whatever it is told, and chatter each 20 ms."""
    port = stage_on(STAGE)
    port.answers, port.replies = False, reply

    def wait(seconds):
        port.now += seconds
        port.replies += chatter

    port.wait = wait
    return port


def driver_on(port, settings=STAGE):
    return open_driver(port, settings, port.clock)


def envelope_on(port, settings=STAGE):
    return Envelope(port, settings, print, port.clock)


def test_zaber_speaks_as_its_manual_says():
    port = stage_on(STAGE)
    port.replies = b"!01 0 IDLE --\r\n@01 0 88 OK IDLE -- 7 7\r\n"  # an alert and a late answer
    driver = driver_on(port)
    np.testing.assert_allclose(driver.place(), [0.5, 0.0])
    driver.move(np.array([1.5, -0.25]))
    assert [line.partition(":")[0] for line in port.sent] == [
        "/1 0 01 get pos",
        "/1 1 02 move abs 10000",
        "/1 2 03 move abs -2500",
    ]
    spoilt = port.sent[1].replace("10000", "90000")
    assert port.device.receive(spoilt.encode()) == b""
    driver.stop()
    assert port.sent[-1].startswith("/1 0 04 stop:")


@pytest.mark.parametrize(
    ("reply", "words", "chatter"),
    [
        (b"@01 0 01 OK IDLE -- 10", "has not answered for 5 s", b""),
        (b"@01 0 01 RJ IDLE -- BADDATA\r\n", "refused 'get pos': BADDATA", b""),
        (b"@01 0 01 OK IDLE FS 0 0\r\n", "fault, FS", b""),
        (b"@01 0 01 OK IDLE WR 0 0\r\n", "it was restarted", b""),
        (b"@01 0\r\n", "cannot be understood", b""),
        (b"@01 0 01 OK IDLE -- 0 9:00\r\n", "cannot be understood", b""),
        (b"@01 0 01 OK IDLE -- nan 0\r\n", "cannot be understood", b""),
        (b"\xff" * 2000, "without line ends", b""),
        (b"", "does not answer", b"@01 0 99 OK IDLE -- 0\r\n"),
    ],
)
def test_zaber_says_what_is_wrong(reply, words, chatter):
    port = scripted(reply, chatter)
    with pytest.raises(StageError, match=words):
        driver_on(port).place()
    assert port.now < 21.0


def test_zaber_passes_over_the_answers_to_many_stops_of_the_watchdog():
    port = scripted(600 * b"@01 0 99 OK IDLE -- 0\r\n" + b"@01 0 01 OK IDLE -- 0 0\r\n")
    port.in_waiting = 4096
    np.testing.assert_allclose(driver_on(port).place(), [0.5, 0.0])


def test_pi_speaks_as_its_manual_says():
    port = stage_on(PI)
    driver = driver_on(port, PI)
    np.testing.assert_allclose(driver.place(), [0.5, 0.0])
    driver.move(np.array([1.5, -0.25]))
    assert port.sent == ["POS? 1 2\n", "MOV 1 1.000000 2 -0.250000\nERR?\n"]
    driver.stop()
    assert port.sent[-1] == "STP\nERR?\n"
    driver.emergency_stop()  # leaves an error that is no refusal
    driver.move(np.zeros(2))
    port.device.refuse = True
    with pytest.raises(StageError, match="GCS error 5"):
        driver.move(np.zeros(2))


@pytest.mark.parametrize("reply", [b"1=0.5\n", b"1=0.5 \n2=nan\n", b"1=1 \n" * 20])
def test_pi_does_not_believe_garbage(reply):
    with pytest.raises(StageError, match=r"cannot be understood|has no end"):
        driver_on(scripted(reply), PI).place()


@pytest.mark.parametrize(("settings", "limits"), [(STAGE, (32768, 3)), (PI, (2.0, 100.0))])
def test_limits_are_written_into_the_controller_whatever_a_step_is_and_given_back(settings, limits):
    port = stage_on(replace(settings, max_speed=200.0, acceleration=3e4))
    driver = driver_on(port, settings)
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
    port = stage_on(PI)
    answer = port.device.answer

    def answer_without(line):
        if not line.startswith(("ACC", "DEC")):
            return answer(line)
        port.device.error = 2
        return ""

    port.device.answer = answer_without
    envelope_on(port, PI).close()
    port.closed = False
    with pytest.raises(StageError, match="does not say its ACC"):
        envelope_on(port, replace(PI, native_limits=(1, 1)))


def test_a_stage_outside_its_limits_is_left_alone():
    port = stage_on(STAGE)
    port.model.place[:] = 8.0
    with pytest.raises(StageError, match="outside its soft limits"):
        envelope_on(port)


def test_the_envelope_itself_sends_nothing_while_it_is_stopped_or_that_is_too_old_or_too_far():
    port = stage_on(STAGE)
    envelope, there, origin = envelope_on(port), np.array([0.6, 0.0]), np.array([0.5, 0.0])
    assert envelope.go(there, port.now - STAGE.stale - 0.001) is None
    assert envelope.bridge(there, port.now - STAGE.bridge - 0.001, origin) is None
    assert envelope.bridge(there, port.now, origin + 1.2 * STAGE.bridge_distance) is None
    with pytest.raises(StageError, match="not a number"):
        envelope.go(np.array(NOWHERE), port.now)
    envelope.latch("no reason")
    assert envelope.go(there, port.now) is None
    assert envelope.bridge(there, port.now, there) is None
    assert envelope.resume("somebody") == "it was stopped just now"
    assert not port.device.moves


class Run:
    """A tracker on a virtual stage, whose clock goes on by `go`."""

    def __init__(self, again=False, **settings):
        settings = replace(STAGE, **settings)
        self.port, self.events = stage_on(settings), []
        self.model = self.port.model
        law = Law.from_sensor(SENSORS["paper"], settings)
        opener = self.open_again if again else None
        self.tracker = Tracker(
            Envelope(self.port, settings, self.say, self.port.clock, opener), law
        )

    def say(self, name, **more):
        self.events.append((name, more))

    def open_again(self):
        self.port.closed = False
        return self.port

    @property
    def names(self):
        return [name for name, _ in self.events]

    def step(self, seconds=0.01):
        """A step of the loop later."""
        self.port.wait(seconds)
        assert self.tracker.step(), self.tracker.error

    def go(self, seconds=0.01, count=1, apex=(0.55, 0.0), powers=LIGHT, age=0.0, **more):
        """Steps of the loop later, each on a new sample."""
        for _ in range(count):
            self.port.now += seconds
            times = np.array([self.port.now - age])
            samples = SolvedSamples(times, np.array([powers]), np.array([apex]))
            self.tracker.feed(samples, **more)
            self.step(0.0)

    def steady(self):
        """Follow a mirror that moves along x by 6.28 mm/s; return its last place."""
        for place in 0.5 + 0.0628 * np.arange(10):
            self.go(apex=(place, 0.0))
        return place

    def resume(self, **sample):
        """A person waits until the stage stands, and says go."""
        self.tracker.resume("a person")
        self.go(0.5, **sample)

    def lose(self, powers):
        """The mirror is lost, the stage stops, and a person has it look for the mirror."""
        while not self.tracker.stop_reason:
            self.go(apex=NOWHERE, powers=powers)
        self.resume(apex=NOWHERE, powers=powers)
        assert self.tracker.searching


@pytest.mark.parametrize(
    "case", [{"apex": NOWHERE}, {"powers": (0.1, 0.0, 0.1)}, {"apex": (5.0, 0.0)}], ids=str
)
def test_a_stage_begins_stopped_where_the_first_sample_is_not_good(case):
    run = Run()
    run.go(**case)
    run.go(0.1, count=3)  # good ones alone let nothing move
    run.resume()
    assert run.names == ["stop", "resume", "move"]


def test_a_stage_waits_for_a_first_fresh_sample_and_not_for_ever():
    run, late = Run(), Run()
    run.go(age=0.06)
    assert run.tracker.state == "waiting for light"
    run.go()
    assert run.names == ["move"]
    late.step()
    late.step(10.1)
    late.go()
    assert late.names == ["stop"]


@pytest.mark.parametrize(
    ("sample", "reason"),
    [
        ({"late": 0.3}, "no fresh sample: all come 300 ms late"),
        ({"doubt": "the readings do not change"}, "the readings do not change"),
    ],
)
def test_a_stopped_stage_is_not_resumed_on_readings_that_are_not_to_be_followed(sample, reason):
    run = Run(search_distance=2.0)
    run.go()
    run.go(count=60, **sample)
    assert run.tracker.state == f"stopped: {reason}"
    run.resume(**sample)
    assert run.tracker.note == f"the stage was not resumed: {reason}"
    run.go(0.1, count=10)  # good samples alone change nothing
    run.resume(apex=run.model.place)
    assert run.names[-4:] == ["stop", "resume refused", "resume", "move"]


def test_no_run_resumes_by_itself_without_poses_and_a_search_is_announced():
    run, dark = Run(resume="auto", search_distance=2.0), {"apex": NOWHERE, "powers": DARK}
    run.go()
    run.step(GAP_S)
    for n in range(200):
        run.go(**(dark if n % 4 else {}))  # a pose now and then
    assert run.names == ["move", "stop"]
    run.go(STAGE.stale, count=2, **dark)
    assert run.tracker.note == "a resume searches for the mirror within 2 mm, in 15 s"
    run.go(count=7)
    assert ("resume", {"by": "auto", "reason": "no fresh sample"}) in run.events


@pytest.fixture
def permit(tmp_path):
    """A file that gives the permit."""
    path = tmp_path / "permit"
    path.write_text("1")
    return path


@pytest.mark.parametrize("content", ["", "0", "11"])
def test_nothing_moves_without_the_permit(permit, content):
    permit.write_text(content)
    run = Run(permit=f"file:{permit}")
    run.go()
    run.resume()
    assert run.tracker.stop_reason == "the external permit is not given"
    permit.write_text("1\n")
    run.resume()
    assert run.names == ["stop", "resume refused", "resume", "move"]


def test_a_permit_in_a_file_outlives_the_program_that_wrote_it(permit):
    os.utime(permit, (0, 0))
    run = Run(permit=f"file:{permit}")
    run.go(count=9)
    assert run.names == ["move"] * 9


def test_a_loss_of_the_permit_that_only_a_command_finds_stops_the_stage(permit, monkeypatch):
    run, contents = Run(permit=f"file:{permit}"), iter([b"1", b"0"])
    monkeypatch.setattr(Path, "read_bytes", lambda _: next(contents, b"1"))
    run.go(count=2)
    assert run.tracker.stop_reason == "the external permit is not given"
    assert run.names == ["stop"]


@pytest.mark.parametrize("fault", ["watchdog", "permit", "stage", "end"])
def test_a_stage_is_told_to_stop_before_anybody_else_hears_of_it(fault, permit):
    run, heard = Run(permit=f"file:{permit}"), []
    run.go()
    run.port.sent.clear()
    run.tracker.envelope.say = lambda *_, **__: heard.append("stop" in "".join(run.port.sent))
    if fault == "permit":
        permit.write_text("0")
        run.go()
    elif fault == "stage":
        run.port.answers = False
        run.tracker.step()
    elif fault == "end":
        run.tracker.close()
    else:
        run.port.now += 0.2
        run.tracker.envelope.watch()
    assert heard
    assert all(heard)


def test_nothing_moves_where_the_heartbeat_can_not_be_sent():
    run, frames, works = Run(heartbeat="board"), [], True
    run.go()
    run.tracker.envelope.heartbeat.to_board = lambda data: frames.append(data[3]) or works
    for n in range(10):
        run.go(0.03)
        assert (run.tracker.moves > 0) == (0.03 * n >= ENABLE_S)  # a relay takes its time
    works = False
    run.go(0.03)
    assert "heartbeat cannot be sent (board)" in run.tracker.stop_reason
    works = True
    run.step(0.03)
    assert frames == [*11 * [1], 0]  # at last it lives, and says that the stage may not move


def test_a_heartbeat_ends_with_the_loop(tmp_path):
    beats = tmp_path / "beats"
    run = Run(heartbeat=f"file:{beats}")
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
    run = Run(search_distance=2.0, again=True)
    for shift in (0.0, 3.0):
        run.go()
        moves = run.tracker.moves
        run.port.error = OSError(5, "Input/output error")
        run.go(count=2)
        run.resume()
        assert "line went away" in run.tracker.error
        run.port.error = None
        run.port.device.zero = run.port.device.zero - shift
        run.go()
        assert run.port.closed  # nobody has said go
        run.resume()  # opens the line, and the stage stays stopped
        assert not run.tracker.error
        assert run.tracker.moves == moves
        run.resume()
        assert (run.tracker.moves > moves) == (not shift)
    assert "may have lost its reference" in run.tracker.note


def test_a_gap_is_bridged_along_the_motion_and_ends_in_a_stop():
    run = Run()
    last = run.steady()
    begin, offsets = run.port.now, []
    while not run.tracker.stop_reason:
        run.go(apex=NOWHERE, powers=(0.1, 0.0, 0.1))
        offsets.append(last + 6.28 * (run.port.now - begin) - run.model.place[0])
    assert run.tracker.bridges == 1
    assert run.port.now - begin == pytest.approx(STAGE.bridge, abs=0.011)
    assert np.abs(offsets[:-2]).max() < 0.05
    assert run.events[-1] == ("stop", {"reason": "not every detector has light"})


def test_readings_that_are_not_to_be_followed_are_no_gap_that_is_bridged():
    run = Run()
    run.steady()
    run.go(apex=(1.2, 0.0), doubt="the readings do not change")
    assert run.events[-1] == ("stop", {"reason": "the readings do not change"})
    assert not run.tracker.bridges


def test_a_stage_that_meets_a_limit_switch_is_stopped():
    run = Run()
    follow = run.model.follow

    def follow_to_the_switch(step):
        follow(step)
        run.model.place[0] = min(run.model.place[0], 0.7)

    run.model.follow = follow_to_the_switch
    run.go()
    while not run.tracker.stop_reason:
        run.go(apex=(run.model.place[0] + 0.15, 0.0))
        assert run.port.now < 12.0
    assert run.tracker.stop_reason.startswith("the stage accepted a move of")


@pytest.mark.parametrize(
    ("seconds", "powers", "outcome"),
    [
        (15.0, [DARK], "the mirror was not found within 0.6 mm, in 15 s"),
        (0.1, [DARK], "the mirror was not found within 0.6 mm, in 0.1 s"),
        (15.0, [(0.3, 0, 0), (0, 0.15, 0.15)], "the light led back 6 times"),
    ],
    ids=["distance", "time", "reversals"],
)
def test_a_search_is_limited_in_distance_time_and_reversals(seconds, powers, outcome):
    run, places = Run(search_distance=0.6, search_time=seconds), []
    run.steady()
    home = run.tracker.home.copy()
    run.lose(powers[0])
    while run.tracker.searching and len(places) < 1000:
        run.go(apex=NOWHERE, powers=powers[len(places) % len(powers)])
        places.append(run.model.place.copy())
    assert run.tracker.stop_reason == outcome
    assert run.names[-2:] == ["stop", "search ended"]
    if outcome.endswith("15 s"):  # it begins at the last good place, and goes round there
        away = np.hypot(*(np.array(places) - home).T)
        assert away.min() < 0.02
        assert 0.5 < away[away.argmin() :].max() < 0.7


def test_a_search_goes_towards_the_light_of_a_saturated_detector_and_finds_the_mirror():
    run, powers = Run(search_distance=2.0), (np.inf, 0.01, 0.01)
    run.go()
    run.lose(powers)
    run.go(count=30, apex=NOWHERE, powers=powers)
    assert run.tracker.state == "searching"
    assert run.model.place[0] < -1.0
    assert abs(run.model.place[1]) < 1e-3
    run.go(apex=run.model.place)
    assert ("search ended", {"outcome": "found"}) in run.events


def test_the_watchdog_stops_a_loop_that_stalls():
    run = Run()
    run.go()
    run.tracker.envelope.watch()
    assert not run.tracker.envelope.stalled
    run.port.now += 0.2
    for _ in range(2):
        run.tracker.envelope.watch()
    assert "stop" in run.port.sent[-1]
    run.go(count=2)
    assert run.tracker.stop_reason == "the loop has stalled"
    run.resume()
    assert run.names == ["move", "stop", "resume", "move"]


def test_nobody_reaches_a_stage_but_through_its_envelope():
    """Nobody else opens a driver or takes the envelope's private parts."""
    names = "|".join(
        ["Kinesis", "open_driver", "open_kinesis", *(d.__name__ for d in DRIVERS.values())]
    )
    forbidden = rf"import (\([^)]*|.*)\b({names})\b|\._(driver|line)\b"
    root = Path(facets.__file__).parents[1]
    paths = [
        path for name in ("facets", "cli", "experiments") for path in (root / name).rglob("*.py")
    ]
    users = {path.stem for path in paths if re.search(forbidden, path.read_text("utf-8"))}
    assert users == {"drivers", "envelope"}
