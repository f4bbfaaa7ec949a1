"""Causes that a fit has no unknowns for: the score test, and each cause beside the others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from facets.experiments import rigs

import facets
from facets.calibration import Data, add_power_polynomials, choice, states_of
from facets.calibration.fit import fit
from facets.calibration.laser import fit_steady_laser
from facets.calibration.misfit import centre_sigma
from facets.calibration.scatter import NAMES, prior_variances
from facets.calibration.unmodelled import (
    BEAM,
    CHIP,
    FRINGES,
    GHOST,
    SEAT,
    Remainder,
    find_causes,
    log_chance,
    moments_of,
    undo_step,
    uneven_share,
)
from facets.calibration.unmodelled_findings import centre_findings, unmodelled_findings
from facets.detectors import add_noise, invert_correction

CONFIG = facets.load("paper")
NOMINAL = CONFIG.sensor
PLAIN = replace(CONFIG.calibrate, effects=dict.fromkeys(CONFIG.calibrate.effects, "off"))
SIGMA = NOMINAL.beam.diameter_x / 4
COUNT = 240
FIRST = 150
LIMIT = np.log(1e-6)


def samples(alter=None, beam=None, mirror=None):
    """Of a rig with ideal light.  alter: changes exact readings at states.  beam, mirror: displace
    it, (n, 2) and (n, 6)."""
    rng = np.random.default_rng(5)
    rig = rigs.draw_rig(NOMINAL, rng)
    pose = rng.uniform(-1, 1, (COUNT, 6)) * [0.25, 0.25, *rigs.BOX[2:]]
    beam = np.zeros((COUNT, 2)) if beam is None else beam
    there = pose if mirror is None else pose + mirror
    data = Data(np.zeros((COUNT, 9)), there, rigs.REFERENCE, beam)
    state = states_of(data, np.zeros((COUNT, 9)), rig.values)
    exact = facets.readings(rig.sensor, state)
    exact = exact if alter is None else alter(rig.sensor, state, exact)
    raw = invert_correction(rig.sensor, add_noise(rig.sensor, exact, rng))
    said = pose + rigs.REFERENCE * rng.standard_normal(pose.shape)
    return add_power_polynomials(data._replace(raw=raw, pose=said, beam=np.zeros((COUNT, 2))))


def remainder_of(data):
    free = fit(NOMINAL, data, choice(NOMINAL, PLAIN))
    return Remainder(NOMINAL, data, fit_steady_laser(NOMINAL, data, free, 3.0), 3.0)


def unmodelled(data):
    return find_causes(remainder_of(data))


def test_the_fall_is_that_of_the_whole_likelihood():
    """Against the dense covariance of every reading, the common unknowns with their prior in it."""
    data = samples().part(slice(0, 40))
    found = fit(NOMINAL, data, rigs.choice())
    remainder = Remainder(NOMINAL, data, found, None)
    like, rng = remainder.likelihood, np.random.default_rng(3)
    columns = rng.standard_normal((40, 9, 4)) * remainder.is_read[:, :, None]
    rows = like.common.reshape(360, -1)
    cover = rows @ np.linalg.solve(like.prior, rows.T)
    known = prior_variances(remainder.data, found.choice)
    for n, block in enumerate(like.variance(known, np.zeros(len(NAMES)))):
        cover[9 * n : 9 * n + 9, 9 * n : 9 * n + 9] += block
    left, flat = like.left.ravel() + rows @ like.before, columns.reshape(360, 4)
    side = flat.T @ np.linalg.solve(cover, left)
    fall = side @ np.linalg.solve(flat.T @ np.linalg.solve(cover, flat), side)
    assert remainder.test("", columns).fall == pytest.approx(fall, rel=1e-5)


def test_waves_and_steps_are_columns_like_others():
    data = samples().part(slice(0, 60))
    remainder = Remainder(NOMINAL, data, fit(NOMINAL, data, rigs.choice()), None)
    rng = np.random.default_rng(4)
    waves, columns = rng.standard_normal((60, 5, 2)), rng.standard_normal((60, 9, 2))
    best = remainder.test_waves("", waves, [0, 2], np.arange(5.0))
    both = np.zeros((60, 9, 4))
    for i, k in enumerate((0, 2)):
        both[:, 3 * k + 2, 2 * i : 2 * i + 2] = (
            waves[:, int(best.at)] * remainder.light[:, k : k + 1]
        )
    assert remainder.test("", both).fall == pytest.approx(best.fall, rel=1e-6)
    step = remainder.test_steps("", columns)
    behind = columns * (np.arange(60) >= step.at)[:, None, None]
    assert remainder.test("", behind).fall == pytest.approx(step.fall, rel=1e-6)


def test_the_chance_of_a_large_fall_is_no_zero():
    from scipy.special import chdtrc

    assert log_chance(30.0, 3) == pytest.approx(np.log(chdtrc(3, 30.0)))
    assert log_chance(1300.0, 6) == pytest.approx(np.log(chdtrc(6, 1300.0)), rel=1e-3)
    assert log_chance(5000.0, 6) < log_chance(4000.0, 6) < -1900


@pytest.mark.slow
def test_nothing_is_found_where_nothing_is_wrong():
    found = unmodelled(samples())
    assert not found.changes
    assert found.light[0].log_chance > LIMIT
    assert not unmodelled_findings(found)


def irradiance(state):
    place = state[:, :2] - state[:, 6:]
    return np.exp(-(place**2).sum(axis=1) / 2 / SIGMA**2) / (2 * np.pi * SIGMA**2)


def chip(sensor, state, exact):
    exact[:, 2] -= 3e-4 * sensor.beam.power * irradiance(state)
    return exact


def reflex(sensor, state, exact):
    """A share of the light beside the beam."""
    aside = state.copy()
    aside[:, 6:] += SIGMA * np.array([1.5, -1.0])
    other = facets.readings(sensor, aside)
    mixed = 0.99 * moments_of(exact) + 0.01 * moments_of(other)
    for m in (0, 1):
        mixed[:, m::3] /= mixed[:, 2::3]
    return mixed


def fringe(sensor, state, exact):
    phase = 2 * np.pi * state[:, 0] / 0.2
    for k in range(3):
        exact[:, 3 * k + 2] *= 1 + 1e-3 * np.cos(phase + k)
    return exact


def window(sensor, state, exact):
    exact[:, 5] *= 1 + 2e-3 * np.cos(2 * np.pi * exact[:, 4] / 0.7)
    return exact


@pytest.mark.parametrize(
    ("alter", "cause", "words"),
    [
        (chip, CHIP, "tip is chipped on facet A"),
        (reflex, GHOST, "a second reflex"),
        (fringe, FRINGES, "fringes across the beam, 0.2 mm apart"),
        (window, "window_b", "fringes of the window of detector B"),
    ],
)
@pytest.mark.slow
def test_light_of_another_kind_is_named(alter, cause, words):
    found = unmodelled(samples(alter))
    assert found.light[0].cause == cause
    (said,) = unmodelled_findings(found)
    assert said.bad
    assert words in said.words


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (lambda pose: 2e-3 * (pose[:, 0] / 0.25) ** 2, "Either the reference's axes or the light"),
        (lambda pose: 0.5 * pose[:, 4], "The reference's axes are not what they are said to be"),
    ],
    ids=["bow", "offset"],
)
def test_an_error_of_the_reference_is_not_told_as_light(error, words):
    """Errors in x, which the powers follow as they follow a beam that is not Gaussian."""
    drawn = np.random.default_rng(5)
    rigs.draw_rig(NOMINAL, drawn)
    pose = drawn.uniform(-1, 1, (COUNT, 6)) * [0.25, 0.25, *rigs.BOX[2:]]
    found = unmodelled(samples(mirror=np.outer(error(pose), np.eye(6)[0])))
    said = " ".join(one.words for one in unmodelled_findings(found))
    assert words in said
    assert "cross-section is not that of the model" not in said


def displaced(size):
    return np.where(np.arange(COUNT)[:, None] >= FIRST, size, 0.0)


def slip(sensor, state, exact):
    exact[FIRST:, 6:8] += [0.008, -0.004]
    return exact


def gain(sensor, state, exact):
    exact[FIRST:, 2] *= 1.005
    return exact


@pytest.mark.parametrize(
    ("wrong", "cause"),
    [
        ({"alter": slip}, "detector C"),
        ({"alter": gain}, "the gain of detector A"),
        ({"beam": displaced([3e-3, -2e-3])}, BEAM),
        ({"mirror": displaced([3e-3, 0, -4e-3, 0, 2e-5, 0])}, SEAT),
    ],
    ids=["detector", "gain", "beam", "mirror"],
)
@pytest.mark.slow
def test_a_jump_is_named_with_its_time_and_can_be_undone(wrong, cause):
    data = samples(**wrong)
    found = unmodelled(data)
    step = found.changes[0]
    assert step.cause == cause
    assert abs(step.at - FIRST) <= 1
    (said, *_) = unmodelled_findings(found)
    assert f"{cause} jumped" in said.words
    assert not unmodelled(undo_step(data, step, int(step.at) + 1)).changes


def test_an_offset_that_no_residual_shows_is_said():
    (said,) = centre_findings(1.3e-4)
    assert not said.bad
    assert "off together by 0.13 um" in said.words
    assert centre_findings(0.0) == []


@pytest.mark.slow
def test_a_slow_drift_is_no_jump():
    def drift(sensor, state, exact):
        exact[:, 3] += np.linspace(0, 0.01, COUNT)
        return exact

    found = unmodelled(samples(drift))
    assert found.changes[0].cause == "detector B"
    assert "Probably detector B drifted" in unmodelled_findings(found)[0].words


# ---- what the samples bound, and do not show


def test_how_far_the_lights_middle_may_be_off():
    """Samples of a Gaussian beam bound what was thought possible; those of a second beam beside it
    do not."""
    clean, bound = remainder_of(samples()), 0.6 * 2e-3
    assert centre_sigma(NOMINAL, clean, CONFIG.calibrate) == 0  # ideal light
    assert uneven_share(clean, 1e-9) == pytest.approx(1e-9, rel=1e-3)
    assert uneven_share(clean, 2e-3) < bound < uneven_share(remainder_of(samples(reflex)), 2e-3)
    choice = clean.found.choice.add_unknowns({"light.wavelength": 1e-3})
    clean.found = replace(clean.found, choice=choice)
    size = 1.5 * SIGMA * uneven_share(clean, 1e-3)
    assert centre_sigma(NOMINAL, clean, CONFIG.calibrate) == pytest.approx(size)
