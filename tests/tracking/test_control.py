"""Laws, their limits, and the bounds that are told before a stage moves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sensors import SENSORS

import facets
from facets.core import Steps
from facets.tracking import (
    ControlInput,
    Law,
    StageModel,
    capture_range,
    margin_of,
    slope_of_error,
    tracking_error,
)

PAPER = SENSORS["paper"]
STAGE = replace(facets.load("bench").stage, low=(-100.0, -100.0), high=(100.0, 100.0))
PROPORTIONAL = replace(STAGE, law="proportional", gain=0.3)
PULL_MM = 0.18


def powers(apex, beam, angles=(0, 0, 0)):
    state = np.array([*apex, 0, *angles, *beam], dtype=float)
    return facets.readings(PAPER, state)[2::3]


def follow(settings, apex_at, seconds=3.0, start=(0.0, 0.0)):
    """The offsets of the beam from a mirror, at each command."""
    law, model = Law.from_sensor(PAPER, settings), StageModel(settings)
    model.place = np.array(start)
    offsets = []
    for now in np.arange(0, seconds, 1 / settings.rate):
        model.advance(now)
        apex = np.array(apex_at(now))
        offsets.append(apex - model.place)
        seen = ControlInput(now, now, powers(apex, model.place), apex, model.place)
        model.command(law.command(seen))
    return np.hypot(*np.array(offsets).T)


def steady(speed):
    """A mirror that comes to a speed along x in 1 s."""
    return lambda now: (speed * (now**2 / 2 if now < 1 else now - 0.5), 0.0)


def test_eq_14_is_zero_where_the_beam_meets_the_apex_and_has_the_slope_of_the_powers():
    np.testing.assert_allclose(tracking_error(powers((1, 2), (1, 2))), 0, atol=1e-12)
    slope = slope_of_error(PAPER)
    assert slope == pytest.approx(slope[0, 0] * np.eye(2), abs=1e-6)
    # it saturates where one facet has no light: at half of its largest value
    assert capture_range(PAPER, 1.0) == pytest.approx(0.5 / slope[0, 0], rel=1e-3)
    off = np.linalg.solve(slope, tracking_error(powers((0, 0), (1e-3, -2e-3))))
    np.testing.assert_allclose(off, [1e-3, -2e-3], rtol=5e-3)


def test_eq_13_leaves_the_residual_that_the_paper_bounds():
    """Equal powers at 10 mrad of tilt: proportional control rests 0.85 um off; paper: < 0.89."""
    law, beam = Law.from_sensor(PAPER, PROPORTIONAL), np.zeros(2)
    for n in range(200):
        beam = law.command(ControlInput(n, n, powers((0, 0), beam, (0, 0.01, 0)), None, beam))
    assert 1e3 * np.hypot(*beam) == pytest.approx(0.85, abs=0.01)


@pytest.mark.parametrize("law", ["proportional", "pi", "feedforward"])
def test_a_standing_mirror_is_met_and_a_moving_one_followed(law):
    """Proportional control lags as told; the others follow faster."""
    settings, still = replace(PROPORTIONAL, law=law, integral=0.05), lambda now: (0.1, -0.05)
    assert follow(settings, still)[-1] < 1e-4
    speed = margin_of(PROPORTIONAL, PULL_MM).speed
    if law == "proportional":
        lag = 0.2 * speed / (PROPORTIONAL.gain * PROPORTIONAL.rate)
        assert follow(settings, steady(0.2 * speed))[-1] == pytest.approx(lag, rel=0.1)
    else:
        offsets = follow(settings, steady(2 * speed))
        assert offsets.max() < 0.5
        assert offsets[-1] < 0.05


def test_a_gain_past_the_margin_is_unstable():
    settings = replace(PROPORTIONAL, gain=1.0, latency=0.03)
    assert margin_of(settings, PULL_MM).times < 1
    offsets = follow(settings, lambda now: (0.0, 0.0), 1.5, start=(0.02, 0.02))
    assert offsets[-20:].max() > 2 * offsets[0]


def test_the_integral_does_not_grow_while_a_limit_shortens_the_commands():
    """Relative tolerances would take 50 nm at 5 mm for nothing, and the integral would grow."""
    law, beam = Law.from_sensor(PAPER, replace(STAGE, law="pi", max_step=1e-5)), np.array([5.0, 0])
    place = law.command(ControlInput(0, 0, powers((5.0 + 5e-5, 0), beam), None, beam))
    assert np.hypot(*(place - beam)) <= 1e-5 + 1e-12
    assert not law.summed.any()


@pytest.mark.parametrize(("apex", "beam"), [(0.2, 0.2), (9.0, 0.0)])
def test_a_simulated_stage_follows_the_mirror_and_stands_still_without_light(apex, beam):
    jump = Steps((0.0,) * 8, (apex, *(0.0,) * 7), 2, 200, 1000.0)
    config = replace(facets.load("bench"), motions={"jump": jump})
    (segment,) = facets.simulate(config, noise=False, track=True)
    np.testing.assert_allclose(segment.truth[-1, 6:], [beam, 0.0], atol=1e-3)
