"""How uncertain means and steps are: by rigs that are drawn from the calibration's covariance."""

from dataclasses import replace

import numpy as np
import pytest
from sensors import SIGMAS, calibrated

import facets
from facets.calibration import ALL, assign_values, values_of
from facets.detectors import MISFIT, MODEL_ERROR
from facets.estimation import lasting_covariance, make_plan, propagate_in_light

START = np.array([0.02, -0.03, 0.1, 1e-3, 2e-3, -1e-3, 0, 0])
END = np.array([-0.04, 0.02, -0.4, -2e-3, 1e-3, 3e-3, 0, 0])
KNOWN = {"beam": "known", "power": "unknown"}


def test_parts_of_an_uncertainty_are_the_whole():
    sensor = calibrated()
    reading = facets.readings(sensor, np.stack([START, END, START]))
    reading[2] = np.nan
    solution = facets.solve(sensor, reading, **KNOWN)
    noise, part = solution.noise_uncertainty, solution.calibration_uncertainty
    np.testing.assert_allclose(np.hypot(noise, part), solution.uncertainty, rtol=1e-6)
    assert np.isnan(part[2]).all()
    bare = facets.solve(replace(sensor, calibration=None), reading, **KNOWN)
    np.testing.assert_allclose(noise, bare.uncertainty, rtol=1e-6)
    with pytest.raises(facets.InputError, match="no calibration covariance"):
        bare.noise_uncertainty  # noqa: B018
    mean = facets.mean_uncertainty(sensor, solution.state[:2], 50, **KNOWN)
    np.testing.assert_allclose(mean, np.hypot(noise / np.sqrt(50), part)[:2], rtol=1e-6)


def test_a_prior_stays_in_means_and_twice_in_steps():
    sensor, prior = facets.load("paper").sensor, facets.Prior((0.0, 0.0), 1e-4)
    mean = facets.mean_uncertainty(sensor, START, 10**6, beam=prior)
    step = facets.difference_uncertainty(sensor, START, END, 10**6, beam=prior)
    np.testing.assert_allclose([mean[:2], step[:2] / np.sqrt(2)], 1e-4, rtol=0.02)
    assert mean[2] < 1e-5


def test_the_joint_covariance_of_two_states_is_that_of_rigs_and_of_their_step():
    """To first order by rigs that are off by a thousandth of each standard uncertainty."""
    sensor = replace(calibrated(), calibration=facets.Calibration(
        tuple(SIGMAS), tuple(map(tuple, np.diag(np.square([*SIGMAS.values()])).tolist()))
    ))  # fmt: skip
    ends, values, shifts = np.stack([START, END]), values_of(sensor), []
    for name, size in SIGMAS.items():
        off = values.copy()
        off[ALL.index(name)] += 1e-3 * size
        readings = facets.readings(assign_values(sensor, off), ends)
        shifts.append(1e3 * (facets.solve(sensor, readings, **KNOWN).state - ends))
    expected = np.einsum("pai,pbj->aibj", shifts, shifts)
    plan = make_plan(sensor, facets.Knowledge(**KNOWN), shape=(2,))
    whole = lasting_covariance(sensor, propagate_in_light(sensor, ends, plan), ends)
    sizes = np.sqrt(np.einsum("aiai->ai", expected) + 1e-30)
    scale = np.einsum("ai,bj->aibj", sizes, sizes)
    np.testing.assert_allclose(whole / scale, expected / scale, atol=1e-3)
    step = facets.difference_uncertainty(sensor, START, END, 10**12, **KNOWN)
    difference = whole[0, :, 0] + whole[1, :, 1] - whole[0, :, 1] - whole[1, :, 0]
    np.testing.assert_allclose(step**2, np.diag(difference), rtol=1e-4, atol=1e-22)


def test_the_model_errs_by_the_same_at_poses_that_are_near_each_other():
    """A misfit of an unknown cause counts twice in any step; the model's own error, in a long one
    only, and in none to the same pose."""
    ends, sizes = [START + part * (END - START) for part in (0, 0.01, 0.1, 1)], {}
    for name in (MISFIT[1], MODEL_ERROR[1]):
        sensor = replace(calibrated(), calibration=facets.Calibration((name,), ((1e-6,),)))
        steps = facets.difference_uncertainty(sensor, START, np.stack(ends), 10**12, **KNOWN)
        sizes[name] = steps[:, 2] / facets.mean_uncertainty(sensor, START, 10**12, **KNOWN)[2]
    np.testing.assert_allclose(sizes[MISFIT[1]], np.sqrt(2), rtol=0.06)
    same, short, middle, long = sizes[MODEL_ERROR[1]]
    assert same < 1e-3 < short < 0.1 < middle < 1 < long < 1.5


def test_many_states_and_bad_arguments():
    sensor, many = calibrated(), np.tile(START, (2, 3, 1))
    many[1, 2] = np.nan
    sizes = facets.difference_uncertainty(sensor, many, END, **KNOWN)
    assert np.isnan(sizes).sum(axis=2).tolist() == [[0, 0, 0], [0, 0, 8]]
    with pytest.raises(facets.InputError, match="samples is 0"):
        facets.mean_uncertainty(sensor, START, 0)
    with pytest.raises(facets.InputError, match="do not fit"):
        facets.difference_uncertainty(sensor, np.zeros((2, 8)), np.zeros((3, 8)))
