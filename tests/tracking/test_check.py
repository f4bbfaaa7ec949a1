"""The check of a stage's wiring before it may follow a mirror."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sensors import SENSORS

import facets
from facets.live import PiController, ZaberDevice
from facets.tracking import (
    SLACK_MM,
    STEP_MM,
    Law,
    StageCheck,
    StageModel,
    checked_today,
    stage_identity,
)

STAGE = replace(facets.load("bench").stage, zero=(0.5, 0.0))
PI = replace(STAGE, driver="pi")
RIGHT = ((1, 0), (0, 1))


class Bench:
    """A stage that moves the beam by `wiring` (2, 2) of its way, on a counted clock.

    scale: its native step in those of `settings`.
    """

    def __init__(self, settings=STAGE, wiring=RIGHT, drift=0.0, scale=1.0):
        self.model, self.now = StageModel(settings), 10.0
        settings = replace(settings, step=settings.step / scale)
        self.device = (PiController if settings.driver == "pi" else ZaberDevice)(self.model)
        self.model.advance(self.now)
        self.wiring, self.drift, self.replies = np.array(wiring), drift, b""
        self.home, self.way, self.targets = self.model.place.copy(), 0.0, []
        self.stalls = 0
        law = Law.from_sensor(SENSORS["paper"], settings)
        self.check = StageCheck(self, settings, law, lambda *_, **__: None, clock=self.clock)

    def clock(self):
        return self.now

    def write(self, data):
        self.replies += self.device.receive(data)

    def read(self, size):
        self.now += 0.0 if self.replies else 0.02
        data, self.replies = self.replies[:size], self.replies[size:]
        return data

    def close(self):
        pass

    def run(self, dark=(), steps=1000):
        """To the end; the faults."""
        for n in range(steps):
            self.now += 0.01
            if n % 30 == 20 and n < 30 * self.stalls:  # a busy machine
                self.now += 0.2
                self.check.envelope.watch()
            self.model.advance(self.now)
            away = self.model.place - self.home
            self.way = max(self.way, np.abs(away).max())
            self.targets.append(self.model.target.copy())
            is_dark = n in dark or np.hypot(*away) > 0.3
            light = np.full((1, 3), 0.0 if is_dark else 0.1)
            apex = self.home + self.drift * (self.now - 10.0)
            beam = self.home + self.wiring @ away
            self.check.feed(np.array([self.now]), light, apex[None], beam[None])
            self.check.step()
            if self.check.is_over:
                return self.check.faults()
        raise AssertionError("the check has no end")


@pytest.mark.parametrize("settings", [STAGE, PI])
def test_a_stage_that_is_wired_right_passes_with_its_scale_and_delay(settings):
    bench = Bench(settings)
    assert bench.run() == []
    for axis in bench.check.axes():
        assert axis.scale == pytest.approx(1, abs=5e-3)
        assert axis.across == pytest.approx(0, abs=5e-3)
        assert axis.delay == pytest.approx(settings.latency + settings.lag, abs=4e-3)
    assert np.abs(bench.model.place - bench.home).max() < 2e-3  # it is where it was
    assert bench.way == pytest.approx(STEP_MM, abs=2e-3)


def test_a_busy_machine_does_not_end_a_check():
    bench = Bench()
    bench.stalls = 5
    assert bench.run() == []
    assert bench.check.envelope.stops >= 4


def turned(degrees):
    angle = np.radians(degrees)
    return ((np.cos(angle), -np.sin(angle)), (np.sin(angle), np.cos(angle)))


@pytest.mark.parametrize("scale", [1e6, 1000.0, 30.0, 1.9, 1.5, 1.24])
def test_a_check_goes_no_further_than_its_light_allows_whatever_the_scale(scale):
    bench = Bench(scale=scale)
    assert "times as far: correct stage.step_um" in bench.run()[-1]
    assert bench.way < STEP_MM + 1.2 * SLACK_MM
    first = next(place for place in bench.targets if (place != bench.home).any())
    assert np.abs(first - bench.home).max() == pytest.approx(STAGE.step, rel=1e-3)


def test_a_check_ends_at_the_first_lost_sample():
    bench = Bench()
    (fault,) = bench.run(dark=[200])
    assert "not every detector has light" in fault
    assert np.ptp(bench.targets[201:], axis=0).max() < 1e-3
    bench.check.resume("a person")
    assert bench.check.step()
    assert bench.check.envelope.latched


def test_a_check_ends_after_a_minute():
    bench = Bench(replace(STAGE, lag=0.9))
    (fault,) = bench.run(steps=8000)
    assert "takes longer than 60 s" in fault


@pytest.mark.parametrize(
    ("wiring", "words"),
    [
        (((-1, 0), (0, 1)), ["a command along x moves the beam the wrong way"]),
        (((1, 0), (0, -1)), ["a command along y moves the beam the wrong way"]),
        (((0, 1), (1, 0)), ["exchange the cables of x and y"]),
        (((2, 0), (0, 1)), ["x moves the beam 2.01 times as far: correct stage.step_um"]),
        (((0.05, 0), (0, 0)), ["x hardly moves the beam"]),
        (turned(8), ["is rotated by 8 degrees relative to the sensor"] * 2),
    ],
    ids=["x backwards", "y backwards", "swapped", "scale", "still", "turned"],
)
def test_a_stage_that_is_wired_wrong_is_refused(wiring, words):
    faults = Bench(wiring=wiring).run()
    for fault, text in zip(faults[-len(words) :], words, strict=True):
        assert text in fault


def test_a_check_that_does_not_come_to_its_end_says_why():
    (fault,) = Bench().run(dark=range(60, 1000))
    assert fault.startswith("the check was not completed while the stage was to move along x")
    assert "not every detector has light" in fault
    (fault,) = Bench(drift=0.02).run()
    assert "the mirror moved during the check" in fault
    bench = Bench()
    bench.stalls = 11
    (fault,) = bench.run()
    assert "the loop has stalled" in fault
    bench = Bench()
    bench.device.refuse = True
    (fault,) = bench.run()
    assert "refused" in fault


def test_a_check_is_of_one_stage():
    value = checked_today(STAGE, "/dev/ttyUSB0")
    date, _, stage = value.partition(" ")
    assert len(date.split("-")) == 3
    assert stage == stage_identity(STAGE, "/dev/ttyUSB0") == "zaber /dev/ttyUSB0 0.1 um"
    assert stage != stage_identity(replace(STAGE, step=1e-3), "/dev/ttyUSB0")
    assert stage != stage_identity(PI, "/dev/ttyUSB0")
