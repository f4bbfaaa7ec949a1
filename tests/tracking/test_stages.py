"""Drivers and emulators as exchanged bytes; the tracker's safety."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest
from sensors import SENSORS

import facets
from facets.live.pi import Pi, PiController
from facets.live.tracker import Spiral, Target, Tracker
from facets.live.zaber import Zaber, ZaberDevice
from facets.tracking.control import Law
from facets.tracking.stage import StageError, StageModel

STAGE = replace(facets.load("bench").stage, zero=(0.5, 0.0))


class Line:
    """A port whose other end is an emulator."""

    def __init__(self, device, prefix=b""):
        self.device, self.sent, self.replies = device, [], prefix

    def write(self, data):
        self.sent.append(data.decode())
        self.replies += self.device.answer(data.decode()).encode()

    def readline(self):
        line, newline, self.replies = self.replies.partition(b"\n")
        return line + newline

    def close(self):
        pass


class Script:
    """A port that gives prepared replies."""

    def __init__(self, *replies):
        self.replies = list(replies)

    def write(self, data):
        pass

    def readline(self):
        return self.replies.pop(0) if self.replies else b""


def test_zaber_speaks_as_its_manual_says():
    device = ZaberDevice(StageModel(STAGE))
    line = Line(device, b"!01 0 IDLE --\r\n")  # an alert in between is passed over
    driver = Zaber(line, STAGE)
    np.testing.assert_allclose(driver.place(), [0.5, 0.0])
    driver.move(np.array([1.5, -0.25]))
    assert line.sent == ["/1 get pos\n", "/1 1 move abs 10000\n", "/1 2 move abs -2500\n"]
    device.model.advance(2.0)
    np.testing.assert_allclose(driver.place(), [1.5, -0.25], atol=1e-3)
    driver.stop()
    assert line.sent[-1] == "/1 stop\n"


@pytest.mark.parametrize(
    ("reply", "words"),
    [
        (b"", "does not answer"),
        (b"@01 0 RJ IDLE -- BADDATA\r\n", "refused 'get pos': BADDATA"),
        (b"@01 0 OK IDLE FS 0 0\r\n", "fault, FS"),
        (b"@01 0\r\n", "can not be understood"),
        (b"@01 0 OK IDLE -- x y\r\n", "can not be understood"),
    ],
)
def test_zaber_says_what_is_wrong(reply, words):
    with pytest.raises(StageError, match=words):
        Zaber(Script(reply), STAGE).place()


def test_pi_speaks_as_its_manual_says():
    controller = PiController(StageModel(STAGE))
    line = Line(controller)
    driver = Pi(line, STAGE)
    np.testing.assert_allclose(driver.place(), [0.5, 0.0])
    driver.move(np.array([1.5, -0.25]))
    assert line.sent == ["POS? 1 2\n", "MOV 1 1.000000 2 -0.250000\n", "ERR?\n"]
    controller.model.advance(2.0)
    np.testing.assert_allclose(driver.place(), [1.5, -0.25], atol=1e-3)
    driver.stop()
    assert line.sent[-2:] == ["STP\n", "ERR?\n"]
    controller.refuse = True
    with pytest.raises(StageError, match="GCS error 5"):
        driver.move(np.zeros(2))
    with pytest.raises(StageError, match="does not answer"):
        Pi(Script(), STAGE).place()


class Still:
    """A stage that only remembers."""

    def __init__(self):
        self.moves, self.stops = [], 0

    def place(self):
        return np.zeros(2)

    def move(self, place):
        self.moves.append(place)

    def stop(self):
        self.stops += 1

    def close(self):
        pass


def tracker(stage, search=False):
    events = []
    law = Law.of(SENSORS["paper"], STAGE)
    made = Tracker(stage, STAGE, law, lambda name, **more: events.append((name, more)), search)
    return made, events


def fresh(apex=(0.1, 0.0), powers=(0.1, 0.1, 0.1)):
    place = None if apex is None else np.array(apex)
    return Target(time.monotonic(), np.array(powers), place)


def test_nothing_moves_without_light_a_pose_or_fresh_data():
    stage = Still()
    follower, events = tracker(stage)
    for target in (
        Target(),
        fresh(apex=None),
        fresh(powers=(0.1, 0.0, 0.1)),
        fresh(powers=(0.1, np.nan, 0.1)),
        Target(0.0, np.full(3, 0.1), np.zeros(2)),
    ):
        follower.target = target
        follower.cycle()
    assert stage.moves == []
    assert stage.stops >= 1
    follower.target = fresh()
    follower.cycle()
    assert len(stage.moves) == 1
    assert [name for name, _ in events].count("move") == 1


def test_loss_stops_and_only_search_looks():
    for search in (False, True):
        stage = Still()
        follower, _ = tracker(stage, search)
        follower.target = fresh()
        follower.cycle()
        follower.target = fresh(powers=(0.3, 0.0, 0.0))
        for _ in range(5):
            follower.cycle()
        assert stage.stops == 1
        assert len(stage.moves) == (6 if search else 1)


def test_the_thread_stops_the_stage_at_its_end_and_on_an_error():
    stage = Still()
    follower, _ = tracker(stage)
    follower.start()
    time.sleep(0.05)
    follower.finish()
    assert stage.stops >= 1

    class Broken(Still):
        def move(self, place):
            raise StageError("no")

    broken = Broken()
    follower, _events = tracker(broken)
    follower.target = fresh()
    follower.run()
    assert isinstance(follower.error, StageError)
    assert broken.stops == 1


def test_the_search_spirals_outward_and_ends():
    spiral, places = Spiral(replace(STAGE, zero=(0, 0))), []
    while (place := spiral.next(np.zeros(2))) is not None:
        places.append(place)
    radius = np.hypot(*np.array(places).T)
    assert radius.max() <= Spiral.FARTHEST + 1e-9
    assert np.diff(radius).min() >= -1e-12
