"""Uncertainties of objects' poses and displacements: 95 % intervals hold over noise and rigs."""

from dataclasses import fields, replace

import numpy as np
import pytest
from oracle import object_motion
from sensors import calibrated

import facets
from facets.model import evaluate, parameters, vectors_of

HEAD = facets.MeasuredObject((10.0, -20.0, 50.0), (0.2, -0.4, 2.0))
FAR = facets.MeasuredObject((0.0, 0.0, -200.0))
STATE = np.array([0.02, -0.03, 0.1, 5e-3, 8e-3, -1e-2, 0, 0])
START = np.array([-0.02, 0.01, -0.2, -4e-3, 3e-3, 5e-3, 0, 0])
COUNT = 10_000
KNOWN = {"beam": "known", "power": "unknown"}


def pose_of(place, turn):
    return np.append(place, turn.as_euler("xyz"))


def displacement(body):
    """From START to STATE."""
    (place, turn), (start, turn_zero) = object_motion(STATE, body), object_motion(START, body)
    return pose_of(turn_zero.inv().apply(place - start), turn_zero.inv() * turn)


def check_intervals(pose, covariance, truth):
    """95 % intervals of the components hold, and the 95 % region of all six."""
    error, variance = pose - truth, np.einsum("nii->ni", covariance)
    shares = (np.abs(error) < 1.96 * np.sqrt(variance)).mean(axis=0)
    np.testing.assert_allclose(shares, 0.95, rtol=0, atol=0.02)
    squares = (error * np.linalg.solve(covariance, error[:, :, None])[:, :, 0]).sum(axis=1)
    assert 0.93 < (squares < 12.5916).mean() < 0.97  # chi-square of six numbers


@pytest.mark.parametrize("body", [HEAD, FAR])
@pytest.mark.parametrize("beam", ["free", "known"])
def test_intervals_at_points_hold_over_noise(body, beam):
    sensor, rng = facets.load("paper").sensor, np.random.default_rng(4)
    noisy = facets.add_noise(sensor, facets.readings(sensor, np.tile(STATE, (COUNT, 1))), rng)
    solution = facets.solve(sensor, noisy, beam=beam)
    found = facets.transform(solution, body)
    check_intervals(found.pose, found.covariance, pose_of(*object_motion(STATE, body)))
    found = facets.transform(solution, body, START)
    check_intervals(found.pose, found.covariance, displacement(body))


@pytest.mark.slow
@pytest.mark.parametrize("count", [1000, pytest.param(COUNT, marks=pytest.mark.study)])
def test_intervals_of_displacements_hold_over_rigs_and_noise(count):
    """Each rig is another draw of the calibration, with a zero of its own: the mean of four
    samples. The displacement of one of these is known better than by independent noise."""
    sensor, rng, samples = calibrated(), np.random.default_rng(5), 4
    known = sensor.calibration
    rigs = np.tile(parameters(sensor), (count, 1))
    draws = rng.multivariate_normal(np.zeros(len(known.names)), np.array(known.covariance), count)
    rigs[:, [facets.PARAMETERS.index(name) for name in known.names]] += draws
    states = np.tile(np.stack([START] * samples + [STATE]), (count, 1))
    owner = np.repeat(np.arange(count), samples + 1)
    reading = facets.add_noise(sensor, evaluate("readings", vectors_of(rigs), owner, states), rng)
    solution = facets.solve(sensor, reading.reshape(count, samples + 1, 9), **KNOWN)
    still = part_of(facets.transform(solution, HEAD), np.s_[:, samples])
    check_intervals(still.pose, still.covariance, pose_of(*object_motion(STATE, HEAD)))
    members = np.arange(samples + 1) < samples
    found = []
    for n, each in enumerate(solution.state):
        zero = facets.zero_pose(sensor, each[members], **KNOWN)
        found.append(facets.transform(part_of(solution, n), HEAD, zero, members=members))
    pose, covariance = (np.stack([getattr(x, k) for x in found]) for k in ("pose", "covariance"))
    check_intervals(pose[:, samples], covariance[:, samples], displacement(HEAD))
    check_intervals(pose[:, 0], covariance[:, 0], np.zeros(6))
    parts = found[0].noise_covariance + found[0].calibration_covariance
    np.testing.assert_allclose(covariance[0], parts, rtol=0.01, atol=1e-18)


def part_of(found, which):
    """Some rows of a solution or of poses of an object."""
    names = [field.name for field in fields(found)]
    rows = {k: v[which] for k in names if isinstance(v := getattr(found, k), np.ndarray)}
    return replace(found, **rows)


def test_a_zero_of_one_sample_is_exact_for_that_sample():
    sensor = calibrated()
    near = START + 0.02 * (STATE - START)
    solution = facets.solve(sensor, facets.readings(sensor, np.stack([START, near])), **KNOWN)
    zero = facets.zero_pose(sensor, solution.state[:1], **KNOWN)
    poses = facets.transform(solution, HEAD, zero, members=[True, False])
    np.testing.assert_allclose(poses.pose[0], 0, atol=1e-15)
    np.testing.assert_allclose(poses.covariance[0], 0, atol=1e-14)
    # The calibration errs by nearly the same at both poses, unless it may be another one.
    apart = replace(zero, same_calibration=False)
    same, whole, other = (
        facets.transform(solution, HEAD, start).calibration_uncertainty[1]
        for start in (zero, None, apart)
    )
    assert (20 * same < whole).all()
    assert (other > whole).all()


def test_poses_without_a_solution_stay_nan_and_bare_states_have_no_covariance():
    sensor = facets.load("paper").sensor
    readings = facets.readings(sensor, np.tile(STATE, (2, 3, 1)))
    readings[1, 2] = np.nan
    solution = facets.solve(sensor, readings)
    for zero in (START[:6], facets.zero_pose(sensor, START), None):
        poses = facets.transform(solution, HEAD, zero)
        assert poses.is_displacement == (zero is not None)
        for numbers in (poses.pose, poses.uncertainty):
            assert np.isnan(numbers).sum(axis=2).tolist() == [[0, 0, 0], [0, 0, 6]]
    bare = facets.transform(solution.state, HEAD)
    np.testing.assert_array_equal(bare.pose, poses.pose)
    with pytest.raises(facets.InputError, match="no covariance"):
        bare.uncertainty  # noqa: B018


def test_zeros_that_cannot_be():
    sensor = calibrated()
    solution = facets.solve(sensor, facets.readings(sensor, STATE), **KNOWN)
    zero, other = (facets.zero_pose(each, START) for each in (sensor, facets.load("paper").sensor))
    with pytest.raises(facets.InputError, match="no solved pose"):
        facets.zero_pose(sensor, np.full((3, 8), np.nan))
    for words, start, members in (
        ("different sensors", other, None),
        ("zero has shape", np.zeros((2, 8)), None),
        ("members has 3 values", zero, [1, 0, 0]),
    ):
        with pytest.raises(facets.InputError, match=words):
            facets.transform(solution, HEAD, start, members=members)
