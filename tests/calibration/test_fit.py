"""How a fit gets to its end: in short fits, from far away, from any side; and the laser in it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import sensors
from facets.experiments.studies import rigs
from rig_samples import CONFIG, NOMINAL, accepted_effects, judge, sample_rig, settings
from scipy.spatial.transform import Rotation

import facets
from facets import InputError
from facets.calibration import (
    ALL,
    LOWER_BOUNDS_MM,
    OWN_COUNT,
    OWN_UNITS,
    PLACE,
    Choice,
    Data,
    Descent,
    Moves,
    block,
    choice,
    fit,
    fit_steady_laser,
    later_power,
    linearise_model,
    predict_readings,
    states_of,
    unknowns,
    values_of,
)
from facets.detectors import correct


@pytest.fixture(scope="module")
def data():
    return sample_rig(40)[1]


@pytest.fixture(scope="module")
def whole(data):
    return fit.fit(NOMINAL, data, rigs.choice(), None)


# ---- the pieces


def test_the_mirror_is_carried_as_a_rigid_body():
    """By SciPy's rotations: t = t_s + (R_s - 1) lever + apex, R = R_s R_m, R = Rz Ry Rx. A mirror
    that is turned by degrees on its reference reads as one with other facets does."""
    rng = np.random.default_rng(1)
    pose, still = rng.uniform(-0.01, 0.01, (20, 6)), np.zeros((20, OWN_COUNT))
    lever, apex, mount = rng.uniform(-5, 5, 3), [0.02, -0.01, 0.1], np.array([0.01, -0.02, 0.05])
    values = values_of(NOMINAL)
    values[block(unknowns.MOUNTING)] = np.concatenate([lever, apex, mount])
    data = Data(np.zeros((20, 9)), pose, np.ones(6), np.zeros((20, 2)))
    state = states_of(data, still, values)
    turn = Rotation.from_euler("ZYX", pose[:, [5, 4, 3]])
    place = pose[:, :3] + turn.apply(lever) - lever + apex
    np.testing.assert_allclose(state[:, :3], place, atol=1e-13)
    put = turn * Rotation.from_euler("ZYX", mount[[2, 1, 0]])
    np.testing.assert_allclose(state[:, [5, 4, 3]], put.as_euler("ZYX"), atol=1e-13)

    folded = unknowns.fold_mount(values)
    straight = states_of(data, still, folded)
    assert abs(state[:, 5] - straight[:, 5]).min() > 0.04
    other = facets.readings(unknowns.assign_values(NOMINAL, folded), straight)
    np.testing.assert_allclose(other, facets.readings(NOMINAL, state), atol=1e-10)


def test_derivatives_are_those_of_differences():
    """Every unknown there is and the nine of each sample, by central differences."""
    beam = replace(NOMINAL.beam, diameter_x=0.9, diameter_y=0.8, rotation=0.3)
    sensor, rng = replace(NOMINAL, beam=beam, light=sensors.ALL), np.random.default_rng(3)
    values = values_of(sensor)
    values[block(unknowns.MOUNTING)] += rng.normal(size=9) * np.repeat([5, 0.02, 1e-3], 3)
    values[block(unknowns.POWER_DRIFT)] = rng.uniform(-0.02, 0.02, 5)
    own_values = rng.normal(size=(4, OWN_COUNT)) * [*[1e-3] * 3, *[1e-4] * 3, 0.02, 1e-3, 1e-3]
    pose, still = rng.uniform(-1, 1, (4, 6)) * rigs.BOX, np.zeros((4, 2))
    data = Data(
        facets.readings(sensor, np.hstack([pose, still])), pose, rigs.REFERENCE, still,
        noise=np.ones((4, 9)), velocity=rng.normal(size=(4, 6)) * 0.1,
        clock=rng.uniform(-1, 1, (4, 3)), slow=rng.uniform(-1, 1, (4, 5)),
        moves=Moves(*(rng.normal(size=(4, 6)) * 0.1 for _ in range(5))),
    )  # fmt: skip
    made = unknowns.assign_values(sensor, values)
    slopes = linearise_model(made, data, own_values, values, Choice(ALL, np.ones(len(ALL))))

    def residuals(change, own_change):
        near, start = values + change, own_values + own_change
        made = unknowns.assign_values(sensor, near)
        state = states_of(data, start, near)
        return predict_readings(made, data, start, near, state) - correct(made, data.raw)

    def differences(change=0.0, own_change=0.0):
        return (residuals(change, own_change) - residuals(-change, -own_change)) / 2

    for n, name in enumerate(ALL):
        if name.startswith("spline_"):
            continue  # a spline is written as lines between fine places, see test_spline
        size = 1e-8 if "wavelength" in name else 1e-6
        slope = differences(size * (np.arange(len(ALL)) == n)) / size
        atol = 5e-5 * (np.abs(slope).max() + 1)
        np.testing.assert_allclose(slopes.common[:, :, n], slope, atol=atol, err_msg=name)
    for n in range(OWN_COUNT):
        slope = differences(own_change=1e-3 * OWN_UNITS * (np.arange(OWN_COUNT) == n)) / 1e-3
        np.testing.assert_allclose(slopes.by_own[:, :, n], slope, atol=1e-4 * np.abs(slope).max())


# ---- steps


def test_a_short_fit_says_so_and_goes_on_to_where_a_long_one_ends(data, whole):
    short = fit.fit(NOMINAL, data, rigs.choice(), None, rule=fit.StoppingRule(1, 1e-6))
    assert whole.ended
    assert not short.ended
    assert "still falls by" in short.cause
    assert "hold them" not in short.cause  # the samples tell these unknowns
    assert short.loss > whole.loss + 1
    again = fit.fit(NOMINAL, data, rigs.choice(), None, start=short)
    assert again.loss == pytest.approx(whole.loss, abs=0.01)
    assert np.abs((again.values - whole.values) / whole.uncertainty).max() < 0.1
    known = whole.sensor.calibration.degrees_of_freedom
    assert known == whole.freedom
    assert 260 < known < 330  # of 360 numbers, less what the unknowns take up


def test_a_fit_comes_back_from_far_away(data, whole):
    """Ten tolerances off in everything, where a plain step leads nowhere."""
    chosen, every = rigs.choice(), whole.all_values.copy()
    off = np.random.default_rng(1).uniform(-10, 10, len(chosen.names))
    every[chosen.places] += off * chosen.sigma
    back = fit.fit(NOMINAL, data, chosen, None, start=replace(whole, all_values=every))
    assert back.ended
    assert back.loss == pytest.approx(whole.loss, abs=0.01)


def test_a_fit_that_misses_something_does_not_advise_to_hold_what_it_creeps_along(data):
    wrong = data.raw * np.where(np.arange(9) == 3, -1, 1)
    creeping = fit.fit(NOMINAL, data._replace(raw=wrong), rigs.choice(), rule=fit.StoppingRule(3))
    assert not creeping.ended
    assert "the model does not describe these readings" in creeping.cause
    assert "hold" not in creeping.cause


def test_an_unknown_at_its_bound_stops_no_other(data):
    """A width of rolled-off edges that would become negative stays where it has a derivative."""
    chosen = rigs.choice().add_unknowns({"rolloff.width": 0.05})
    task, place = Descent(NOMINAL, data, chosen, None), PLACE["rolloff.width"]
    task.start[place] = 0.03
    at = task.guess(task.start, np.zeros((40, 9)))
    _, _, normal = task.linearise(at, np.inf)
    there = task.take_step(at, normal, np.append(np.full(len(chosen.names) - 1, 1e-4), -1.0))
    assert there.values[place] == LOWER_BOUNDS_MM["rolloff.width"]
    assert (there.values - at.values)[chosen.places][:-1] == pytest.approx(1e-4)
    matrix, side = task.hold_at_bounds(there, *task.add_prior(there, normal))
    assert np.linalg.solve(matrix, side)[-1] >= 0


def test_chi_square_exceeds_what_chance_allows_by_four_deviations(whole):
    """Of 800 degrees of freedom the reduced chi-square has the standard deviation 0.05."""
    for chi_square, excess in ((700.0, 0.0), (950.0, 0.0), (1200.0, 0.3)):
        other = replace(whole, chi_square=chi_square, freedom=800.0)
        assert other.reduced_chi_square == pytest.approx(chi_square / 800)
        assert other.excess == pytest.approx(excess)


# ---- the light


@pytest.mark.slow
@pytest.mark.parametrize("degrees", [5, 40, 95, 130])
def test_a_coating_is_found_whatever_the_polarisation(degrees):
    """Half a turn is a whole period: from one start, some would end on the wrong side."""
    asked = replace(settings(coating="auto"), power_per_sample=False, held_back=0.0)
    light = replace(NOMINAL.light, index=(1.37, 7.62), polarization=np.radians(degrees).item())
    judged = judge(sample_rig(80, light=light)[1], asked)
    assert accepted_effects(judged) == {"coating"}
    start = np.degrees(judged.search.sensor.light.polarization)
    assert start == pytest.approx(degrees, abs=5.1)  # the nearest of four
    place = judged.fit.choice.names.index("light.polarization")
    off = (judged.fit.values[place] - light.polarization + np.pi / 2) % np.pi - np.pi / 2
    assert abs(off) < 4 * judged.fit.uncertainty[place] < 0.4


@pytest.mark.parametrize("jitter", [0.0, 2e-3])
def test_a_laser_s_steadiness_is_taken_from_the_readings(jitter):
    """Not from the powers that a fit finds, whose scatter is mostly the fit's own."""

    def drift(sensor, state, exact):
        rng, count = np.random.default_rng(4), len(exact)
        power = 1 + 0.01 * np.sin(np.linspace(0, 3, count)) + jitter * rng.normal(size=count)
        exact[:, 2::3] *= power[:, None]
        return exact

    data = sample_rig(60, alter=drift)[1]
    steady = judge(data, replace(settings(), held_back=0.0)).fit
    assert steady.choice.power == pytest.approx(max(jitter, 2e-4), rel=0.8)


@pytest.mark.parametrize(("jitter", "power"), [(0.0, "known"), (2e-3, "prior"), (4e-2, "prior")])
def test_a_power_stays_known_unless_the_laser_changed_by_more_than_the_noise(jitter, power):
    """And the prior that takes its place is as wide as the change, and said."""

    def flicker(sensor, state, exact):
        exact[:, 2::3] *= 1 + jitter * np.random.default_rng(4).normal(size=(len(exact), 1))
        return exact

    judged = judge(sample_rig(60, alter=flicker)[1], asked := replace(settings(), held_back=0.0))
    before = replace(CONFIG.solve, beam="prior", beam_sigma=1.0, power="known")
    of = (asked, judged.sensor, judged.fit, judged.fitted)
    after, said = later_power(before, *of)
    assert after.power == power
    assert f"solve.power {'stays known' if power == 'known' else 'is changed from known'}" in (
        said[0].words
    )
    assert ("get the status unchecked" in said[0].words) == (jitter > 0.01)
    if power == "prior":
        assert after.power_sigma == pytest.approx(jitter, rel=0.3)
    chosen = replace(before, power="unknown")
    assert later_power(chosen, *of) == (chosen, [])


def test_a_mean_power_below_zero_is_refused(data):
    free = fit.fit(NOMINAL, data, choice(NOMINAL, CONFIG.calibrate), rule=fit.StoppingRule(1))
    dark = replace(free, own_values=free.own_values - 2.0 * (np.arange(9) == 6))
    with pytest.raises(InputError, match="the laser's mean power at -"):
        fit_steady_laser(NOMINAL, data._replace(slow=np.zeros((40, 5))), dark, None)
