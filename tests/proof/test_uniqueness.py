"""Intervals hold what they claim to; what is singular is never certified."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from facets.experiments import certificate_optics
from flint import arb
from sensors import SENSORS, lit_states

import facets
from facets.characterization import (
    StateBox,
    find_pair_in_box,
    find_singular_state,
    least_share,
    parse_box,
    range_box,
    search_weakest,
)
from facets.model import parameters, sensor_with
from facets.proof import (
    calibration_tolerances,
    certify,
    edges_over_rotations,
    light_sharing,
    slope_of_powers,
)
from facets.proof.interval_matrix import determinant, distance_from_zero, regularity
from facets.proof.spot_jacobian import interval_geometry, intervals_between, spot_jacobian
from facets.scalars import intervals

SMALL = parse_box("tx_mm=2,ty_mm=2,tz_mm=2,roll_mrad=4,pitch_mrad=4,yaw_mrad=6")
SHARE = 0.2
PAPER = SENSORS["paper"]


def with_powers_held(matrix):
    """The 6 x 6 that is left of a Jacobian (9, 8) when offset follows from two powers."""
    by_pose = matrix.copy()
    by_pose[:, :2] += matrix[:, 6:]  # the beam moves along: the offset stays
    spots, powers = [0, 1, 3, 4, 6, 7], [2, 5]
    drift = np.linalg.solve(matrix[np.ix_(powers, [6, 7])], by_pose[powers][:, :6])
    return by_pose[spots][:, :6] - matrix[np.ix_(spots, [6, 7])] @ drift


@pytest.mark.parametrize(
    ("name", "factor"),
    [("paper", 0.0), ("skewed1", 0.0), pytest.param("paper", 1.0, marks=pytest.mark.slow)],
)
def test_jacobians_at_random_states_lie_in_what_is_proved(name, factor):
    """Those of a sensor, and of sensors at the ends of their tolerances."""
    sensor, rng = SENSORS[name], np.random.default_rng(4)
    off = np.array(calibration_tolerances(facets.load("paper"), factor).values)
    certificate = certify(sensor, SMALL, SHARE, tolerances=off)
    assert certificate.regular
    assert certificate.unique
    ball = interval_geometry(sensor, off)
    parts = edges_over_rotations(ball, SMALL)
    shares = light_sharing.hull_of_bounds(
        [light_sharing.bounds_at_fixed_shares(edges, SHARE) for edges in parts]
    )
    inside = intervals_between(SMALL.low[:6], SMALL.high[:6])
    bounds = np.array(
        [[intervals.ends(x) for x in row] for row in spot_jacobian(ball, shares, inside)]
    )
    least_slope, largest_slope = intervals.ends(slope_of_powers(ball, shares))
    for _ in range(10):
        real = sensor_with(sensor, np.array(parameters(sensor)) + rng.choice([-1, 1], 30) * off)
        matrices = facets.jacobian(
            real, lit_states(real, SMALL.low[:6], SMALL.high[:6], SHARE, 200, rng)
        )
        determinants = np.abs(np.linalg.det(np.delete(matrices, 8, axis=1)))
        assert 0 < certificate.at_least <= determinants.min()
        for matrix in matrices:
            held = with_powers_held(matrix)
            assert (held >= bounds[:, :, 0] - 1e-9).all()
            assert (held <= bounds[:, :, 1] + 1e-9).all()
            assert least_slope <= np.linalg.det(matrix[np.ix_([2, 5], [6, 7])]) <= largest_slope


def test_tolerances_come_from_what_is_known_before():
    config = facets.load("paper")
    before = calibration_tolerances(config, 2.0)
    assert before.source == "calibrate.before"
    assert before.values[12] >= 0.4
    assert before.values[12] == pytest.approx(0.4)
    assert before.values[6] == pytest.approx(3e-3)
    assert "beam.power" in before.exact
    known = facets.Calibration(("beam.tilt_x",), ((4e-8,),))
    after = calibration_tolerances(replace(config, sensor=replace(PAPER, calibration=known)), 3.0)
    assert after.source == "the sensor's calibration"
    assert after.values[4] == pytest.approx(6e-4)
    assert len(after.exact) == 29


@pytest.mark.slow
def test_a_pair_is_found_in_the_box_of_a_singular_sensor():
    config = facets.load("singular")
    box, share = range_box(config.sensor, config.range), least_share(config.sensor, config.range)
    weak = search_weakest(config.sensor, box).state
    result = find_pair_in_box(config.sensor, box, share, weak)
    pair = np.array([result.first, result.second])
    readings = facets.readings(config.sensor, pair)
    np.testing.assert_allclose(readings[0], readings[1], atol=1e-10)
    assert np.abs(pair[0] - pair[1])[:3].max() > 0.05
    assert (pair[:, :6] >= box.low[:6]).all()
    assert (pair[:, :6] <= box.high[:6]).all()
    assert (readings[:, 2::3] >= share * config.sensor.beam.power).all()
    assert find_singular_state(PAPER, np.zeros(8)) is None


def test_a_box_of_offsets_is_covered_by_its_least_share():
    box = parse_box("tx_mm=1,yaw_mrad=3,offset_x_mm=0.1,offset_y_mm=0.1")
    certificate = certify(PAPER, box)
    assert certificate.unique
    states = box.states(np.random.default_rng(2).random((2000, 8)))
    least = facets.readings(PAPER, states)[:, 2::3].min() / PAPER.beam.power
    assert 0.3 * least < certificate.least_share <= least


#: A detector that looks along its sub-beam's plane, and detectors without a lever for rotations.
BLIND = replace(PAPER, psds=(replace(PAPER.psds[0], yaw=np.pi / 2), *PAPER.psds[1:]))
COINCIDENT = replace(PAPER, psds=tuple(replace(psd, radius=1e-3) for psd in PAPER.psds))
CUT = replace(PAPER, apertures=facets.Apertures(beam=1.0))
BENCH = replace(PAPER, light=facets.BenchLight(curvature_xx=1e-3))


@pytest.mark.parametrize(
    ("sensor", "box", "share", "reason"),
    [
        pytest.param(facets.load("singular").sensor, SMALL, SHARE, "", marks=pytest.mark.slow),
        (BLIND, SMALL, SHARE, ""),
        (COINCIDENT, SMALL, SHARE, ""),
        (CUT, SMALL, SHARE, "apertures"),
        (BENCH, SMALL, SHARE, "sensor.light"),
        (PAPER, SMALL, 0.9, "three lit wedges"),
        (PAPER, parse_box("roll_mrad=1500"), 0.1, ""),
    ],
    ids=["singular", "blind", "coincident", "cut", "bench", "share", "turned over"],
)
def test_what_is_not_so_is_never_certified(sensor, box, share, reason):
    certificate = certify(sensor, box, share, pieces=400)
    assert not certificate.regular
    assert not certificate.unique
    assert certificate.doubtful or certificate.reason
    assert reason in certificate.reason


def test_matrices_of_intervals():
    eye = np.array([[arb(float(i == j)) for j in range(6)] for i in range(6)])
    margin, inverse, _ = regularity(eye)
    assert 0.9 < margin <= 1
    np.testing.assert_allclose(inverse, np.eye(6))
    assert distance_from_zero(determinant(eye)) == pytest.approx(1)
    for entry in (intervals.interval(-1, 1), arb("nan")):
        eye[0, 0] = entry
        assert not regularity(eye)[0] > 0
        assert distance_from_zero(determinant(eye)) == 0
    assert intervals.magnitude(arb("nan")) == np.inf


@pytest.mark.parametrize("least_sine", [light_sharing.least_sine, certificate_optics.least_sine])
def test_the_sine_of_an_opening_about_a_right_angle_is_not_taken_as_1(least_sine):
    right = math.pi / 2
    assert least_sine(intervals.interval(right - 0.3, right + 0.4)) <= math.sin(right + 0.4) + 1e-12
    assert least_sine(intervals.interval(right + 0.1, right + 0.2)) <= math.sin(right + 0.2) + 1e-12
    assert least_sine(intervals.interval(right - 0.3, right - 0.1)) == 1


def test_a_box_has_two_ends():
    with pytest.raises(facets.InputError, match="the box runs"):
        StateBox(np.ones(8), -np.ones(8))
