"""Laws, their limits, and the bounds that are told before a stage moves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sensors import SENSORS

import facets
from facets.tracking import Law, Seen, StageModel, margin_of, slope_of_error, tracking_error

PAPER = SENSORS["paper"]
STAGE = replace(facets.load("bench").stage, low=(-100.0, -100.0), high=(100.0, 100.0))


def powers(apex, beam, angles=(0, 0, 0)):
    state = np.array([*apex, 0, *angles, *beam], dtype=float)
    return facets.readings(PAPER, state)[2::3]


def followed(settings, speed, seconds=3.0):
    """The offset of the beam from a mirror that comes to speed along x in 1 s, at each command."""
    law, model = Law.from_sensor(PAPER, settings), StageModel(settings)
    offsets = []
    for n in range(int(seconds * settings.rate)):
        now = n / settings.rate
        model.advance(now)
        apex = np.array([speed * (now**2 / 2 if now < 1 else now - 0.5), 0.0])
        offsets.append(apex - model.place)
        if np.hypot(*offsets[-1]) > 0.5:
            return np.array(offsets), False
        seen = Seen(now, now, powers(apex, model.place), apex, model.place)
        model.command(law.command(seen))
    return np.array(offsets), True


def test_eq_14_is_zero_where_the_beam_meets_the_apex():
    np.testing.assert_allclose(tracking_error(powers((1, 2), (1, 2))), 0, atol=1e-12)
    assert tracking_error(powers((0, 0), (0.01, 0)))[0] > 0
    assert tracking_error(powers((0, 0), (0, 0.01)))[1] > 0


def test_the_slope_of_eq_14_is_that_of_the_powers():
    slope = slope_of_error(PAPER)
    assert slope == pytest.approx(slope[0, 0] * np.eye(2), abs=1e-6)
    off = np.linalg.solve(slope, tracking_error(powers((0, 0), (1e-3, -2e-3))))
    np.testing.assert_allclose(off, [1e-3, -2e-3], rtol=5e-3)


def test_eq_13_leaves_the_residual_that_the_paper_bounds():
    """Equal powers at 10 mrad of tilt: proportional control rests 0.85 um off; paper: < 0.89."""
    settings = replace(STAGE, law="proportional")
    law, beam = Law.from_sensor(PAPER, settings), np.zeros(2)
    for n in range(200):
        seen = Seen(n, n, powers((0, 0), beam, (0, 0.01, 0)), None, beam)
        beam = law.command(seen)
    assert 1e3 * np.hypot(*beam) == pytest.approx(0.85, abs=0.01)


@pytest.mark.parametrize("law", ["proportional", "pi", "feedforward"])
def test_a_standing_mirror_is_met(law):
    settings = replace(STAGE, law=law)
    controller, model = Law.from_sensor(PAPER, settings), StageModel(settings)
    apex = np.array([0.1, -0.05])
    for n in range(300):
        model.advance(n / settings.rate)
        now = n / settings.rate
        model.command(
            controller.command(Seen(now, now, powers(apex, model.place), apex, model.place))
        )
    assert np.hypot(*(model.place - apex)) < 1e-4


def test_proportional_control_lags_as_told():
    settings = replace(STAGE, law="proportional", gain=0.3)
    margin = margin_of(settings, 0.18)
    offsets, kept = followed(settings, 0.2 * margin.speed)
    assert kept
    told = 0.2 * margin.speed / (settings.gain * settings.rate)
    assert np.hypot(*offsets[-1]) == pytest.approx(told, rel=0.1)


def test_feedforward_and_integral_follow_faster():
    speed = 2 * margin_of(replace(STAGE, law="proportional", gain=0.3), 0.18).speed
    for law in ("pi", "feedforward"):
        offsets, kept = followed(replace(STAGE, law=law, gain=0.3, integral=0.05), speed)
        assert kept, law
        assert np.hypot(*offsets[-1]) < 0.05, law


def test_a_gain_past_the_margin_is_unstable():
    settings = replace(STAGE, law="proportional", gain=1.0, latency=0.03)
    assert margin_of(settings, 0.18).times < 1
    law, model = Law.from_sensor(PAPER, settings), StageModel(settings)
    model.place[:] = 0.02
    sizes = []
    for n in range(150):
        now = n / settings.rate
        model.advance(now)
        sizes.append(np.hypot(*model.place))
        model.command(law.command(Seen(now, now, powers((0, 0), model.place), None, model.place)))
    assert max(sizes[-20:]) > 2 * sizes[0]


def test_commands_stay_within_their_limits():
    law = Law.from_sensor(PAPER, replace(STAGE, max_step=0.01, low=(-7, -7), high=(7, 7)))
    beam = np.array([6.999, 0.0])
    place = law.command(Seen(0, 0, powers((0, 0), (0, 0)), np.array([9.0, 9.0]), beam))
    assert np.hypot(*(place - beam)) <= 0.01 + 1e-12
    assert place[0] <= 7.0
    assert law.limited == 1


def test_the_stage_model_keeps_its_limits():
    model = StageModel(replace(STAGE, max_speed=5.0, acceleration=100.0))
    model.command(np.array([3.0, 0.0]))
    speeds = []
    for n in range(2000):
        model.advance(n * 1e-3)
        speeds.append(model.speed[0])
    assert max(speeds) <= 5.0 + 1e-9
    assert np.abs(np.diff(speeds)).max() <= 100.0 * 1e-3 + 1e-9
    assert model.place[0] == pytest.approx(3.0, abs=0.01)


def test_a_command_that_is_held_back_a_little_at_a_far_place_is_seen():
    """Relative tolerances would take 50 nm at 5 mm for nothing, and the integral would grow."""
    settings = replace(STAGE, law="pi", max_step=1e-5)
    law, beam = Law.from_sensor(PAPER, settings), np.array([5.0, 0.0])
    law.command(Seen(0, 0, powers((5.0 + 5e-5, 0), beam), None, beam))
    assert law.limited == 1
    assert not law.summed.any()
