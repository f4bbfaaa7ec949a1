"""The check of a stage's wiring before it may follow a mirror."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sensors import SENSORS
from stage_world import stage_on

import facets
from facets.tracking import SLACK_MM, STEP_MM, Envelope, Law, SolvedSamples, StageCheck

STAGE = replace(facets.load("bench").stage, zero=(0.5, 0.0))
RIGHT = ((1, 0), (0, 1))


class Bench:
    """A stage that moves the beam by `wiring` (2, 2) of its way, on a counted clock.

    scale: its native step in those of `settings`.
    """

    def __init__(self, settings=STAGE, wiring=RIGHT, drift=0.0, scale=1.0):
        self.port = stage_on(settings)
        self.model = self.port.model
        settings = replace(settings, step=settings.step / scale)
        self.wiring, self.drift = np.array(wiring), drift
        self.home, self.way, self.targets = self.model.place.copy(), 0.0, []
        law = Law.from_sensor(SENSORS["paper"], settings)
        self.check = StageCheck(Envelope(self.port, settings, print, self.port.clock), law)

    def run(self, dark=(), steps=1000, interval_s=0.01):
        """To the end; the faults."""
        for n in range(steps):
            self.port.wait(interval_s)
            away = self.model.place - self.home
            self.way = max(self.way, np.abs(away).max())
            self.targets.append(self.model.target.copy())
            is_dark = n in dark or np.hypot(*away) > 0.3
            light = np.full((1, 3), 0.0 if is_dark else 0.1)
            apex = self.home + self.drift * (self.port.now - 10.0)
            beam = self.home + self.wiring @ away
            now = np.array([self.port.now])
            self.check.feed(SolvedSamples(now, light, apex[None], beam[None]))
            self.check.step()
            if self.check.is_over:
                return self.check.faults()
        raise AssertionError("the check has no end")


def test_a_stage_that_is_wired_right_passes_with_its_scale_and_delay():
    bench = Bench()
    assert bench.run() == []
    for axis in bench.check.axes():
        assert axis.scale == pytest.approx(1, abs=5e-3)
        assert axis.across == pytest.approx(0, abs=5e-3)
        assert axis.delay == pytest.approx(STAGE.latency + STAGE.lag, abs=4e-3)
    assert np.abs(bench.model.place - bench.home).max() < 2e-3  # it is where it was


@pytest.mark.parametrize("scale", [1e6, 1.24])
def test_a_check_goes_no_further_than_its_light_allows_whatever_the_scale(scale):
    bench = Bench(scale=scale)
    assert "times as far: correct stage.step_um" in bench.run()[-1]
    assert bench.way < STEP_MM + 1.2 * SLACK_MM
    first = next(place for place in bench.targets if (place != bench.home).any())
    assert np.abs(first - bench.home).max() == pytest.approx(STAGE.step, rel=1e-3)


def test_a_check_ends_at_the_first_lost_sample():
    bench = Bench()
    (fault,) = bench.run(dark=[200])
    assert fault.startswith("the check was not completed while the stage was to move along")
    assert "not every detector has light" in fault
    assert np.ptp(bench.targets[201:], axis=0).max() < 1e-3
    bench.check.resume("a person")
    assert bench.check.step()
    assert bench.check.envelope.latched


def test_a_check_ends_after_a_minute():
    bench = Bench(replace(STAGE, lag=0.9))
    bench.model.STEP = 0.02
    (fault,) = bench.run(steps=2000, interval_s=0.04)
    assert "takes longer than 60 s" in fault


@pytest.mark.parametrize(
    ("wiring", "words"),
    [
        (((1, 0), (0, -1)), ["a command along y moves the beam the wrong way"]),
        (((0, 1), (1, 0)), ["exchange the cables of x and y"]),
        (((2, 0), (0, 1)), ["x moves the beam 2 times as far: correct stage.step_um"]),
        (((0.05, 0), (0, 0)), ["x hardly moves the beam"]),
        (((0.990, -0.139), (0.139, 0.990)), ["is rotated by 8 degrees relative to the sensor"] * 2),
    ],
    ids=["backwards", "swapped", "scale", "still", "turned"],
)
def test_a_stage_that_is_wired_wrong_is_refused(wiring, words):
    faults = Bench(wiring=wiring).run()
    for fault, text in zip(faults[-len(words) :], words, strict=True):
        assert text in fault


def test_a_mirror_that_moves_during_a_check_is_told():
    (fault,) = Bench(drift=0.02).run()
    assert "the mirror moved during the check" in fault
