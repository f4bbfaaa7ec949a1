"""Causes that a fit has no unknowns for: each is named beside the others, or bounded."""

from __future__ import annotations

import numpy as np
import pytest
from rig_samples import NOMINAL, judge, sample_rig, settings, words_of

import facets

SIGMA = NOMINAL.beam.diameter_x / 4
COUNT = 240
FIRST = 150


def mix_light(exact, share, other):
    """Mix the light of readings with that of others: powers, and places times powers, add up."""
    power = (1 - share) * exact[:, 2::3] + share * other[:, 2::3]
    for m in (0, 1):
        first = (1 - share) * exact[:, m::3] * exact[:, 2::3]
        exact[:, m::3] = (first + share * other[:, m::3] * other[:, 2::3]) / power
    exact[:, 2::3] = power
    return exact


def chip(sensor, state, exact):
    place = state[:, :2] - state[:, 6:]
    irradiance = np.exp(-(place**2).sum(axis=1) / 2 / SIGMA**2) / (2 * np.pi * SIGMA**2)
    exact[:, 2] -= 3e-4 * sensor.beam.power * irradiance
    return exact


def reflex(sensor, state, exact):
    aside = state.copy()
    aside[:, 6:] += SIGMA * np.array([1.5, -1.0])
    return mix_light(exact, 0.01, facets.readings(sensor, aside))


def fringe(sensor, state, exact):
    phase = 2 * np.pi * state[:, 0] / 0.2
    for k in range(3):
        exact[:, 3 * k + 2] *= 1 + 1e-3 * np.cos(phase + k)
    return exact


def window(sensor, state, exact):
    exact[:, 5] *= 1 + 2e-3 * np.cos(2 * np.pi * exact[:, 4] / 0.7)
    return exact


@pytest.mark.parametrize(
    ("alter", "words"),
    [
        (chip, "the mirror's tip is chipped on facet A."),
        (reflex, "a second reflex beside the beam"),
        pytest.param(fringe, "fringes across the beam, 0.2 mm apart", marks=pytest.mark.slow),
        pytest.param(window, "fringes of the window of detector B", marks=pytest.mark.slow),
    ],
)
def test_light_of_another_kind_is_named_and_not_trusted(alter, words):
    judged = judge(sample_rig(COUNT, alter=alter)[1])
    assert not judged.is_trusted
    assert f"The likeliest cause: {words}" in words_of(judged)


@pytest.mark.slow
def test_a_bowed_reference_is_not_told_as_light():
    """Errors in x, which the powers follow as they follow a beam that is not Gaussian."""

    def bow(pose, rng):
        return np.outer(4e-3 * (pose[:, 0] / 0.25) ** 2, np.eye(6)[0])

    judged = judge(sample_rig(COUNT, mirror=bow)[1])
    assert not judged.is_trusted
    assert "The reference's axes are not what they are said to be" in words_of(judged)
    assert "cross-section is not that of the model" not in words_of(judged)


# ---- something that was loose


def step(size):
    return np.where(np.arange(COUNT)[:, None] >= FIRST, size, 0.0)


def slip(sensor, state, exact):
    exact[FIRST:, 6:8] += [0.008, -0.004]
    return exact


def change_gain(sensor, state, exact):
    exact[FIRST:, 2] *= 1.005
    return exact


@pytest.mark.parametrize(
    ("alter", "words"),
    [
        (slip, "Between rows 149 and 151 detector C jumped, by 7.65 um along psi"),
        (change_gain, "Between rows 149 and 151 the gain of detector A jumped, by 0.509 %"),
    ],
)
def test_a_jump_is_named_with_its_time_and_size(alter, words):
    """Row 150 is held back."""
    judged = judge(sample_rig(COUNT, alter=alter)[1])
    assert not judged.is_trusted
    assert words in words_of(judged)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"beam": lambda count, rng: step([3e-3, -2e-3])}, "the beam jumped at row 151, by 2.94"),
        (
            {"mirror": lambda pose, rng: step([3e-3, 0, -4e-3, 0, 2e-5, 0])},
            "the mirror on the reference jumped at row 151, by 2.98 um in tx",
        ),
    ],
    ids=["beam", "mirror"],
)
@pytest.mark.slow
def test_a_large_jump_is_undone_as_a_fault_of_the_data(wrong, words):
    judged = judge(sample_rig(COUNT, **wrong)[1])
    assert not judged.is_trusted
    assert words in words_of(judged)


def test_a_slow_drift_is_no_jump():
    def drift(sensor, state, exact):
        exact[:, 3] += np.linspace(0, 0.01, COUNT)
        return exact

    judged = judge(sample_rig(COUNT, alter=drift)[1])
    assert "Probably detector B drifted" in words_of(judged)
    assert "jumped" not in words_of(judged)


# ---- what the samples bound, and do not show


def test_how_far_the_lights_middle_may_be_off_is_part_of_the_uncertainty():
    """All poses together, by as much as a second beam may move the light; nothing else. Samples of
    a Gaussian beam bound what was thought possible, 0.2 % of the power."""
    data = sample_rig(COUNT)[1]
    ideal, real = judge(data), judge(data, settings(diffraction="on"))
    assert "may be off together" not in words_of(ideal)  # ideal light is Gaussian
    known = real.sensor.calibration
    centre = np.sqrt(np.diag(known.covariance))[known.names.index("light.centre_x")]
    assert 0 < centre < 0.8 * 1.5 * 2e-3 * SIGMA
    assert f"x and y of all poses may be off together by {1e3 * centre:.2g} um" in words_of(real)
    at_rest = facets.readings(real.sensor, np.zeros((1, 8)))
    before, after = (
        facets.solve(sensor, at_rest, beam="known", power="unknown").uncertainty ** 2
        for sensor in (real.search.found.sensor, real.sensor)
    )
    assert np.sqrt((after - before)[:, :2]) == pytest.approx(centre, rel=0.01)
    assert np.sqrt(after[:, 2:6] / before[:, 2:6]).max() < 1.01
