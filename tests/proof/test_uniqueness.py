"""Intervals hold what they claim to; what is singular is never certified; the checker checks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from flint import arb
from sensors import SENSORS

import facets
from facets.characterization import (
    StateBox,
    box_of_poses,
    clearances,
    find_pair_in_box,
    find_singular_state,
    least_share,
    parse_box,
    range_box,
    search,
)
from facets.model import parameters, sensor_with
from facets.proof import (
    calibration_tolerances,
    certify,
    cover_range,
    edges_over_rotations,
    least_share_in_box,
    slope_of_powers,
)
from facets.proof.interval_matrix import determinant, distance_from_zero, regularity
from facets.proof.light_sharing import bounds_at_fixed_shares, hull_of_bounds
from facets.proof.reach import find_reach
from facets.proof.spot_jacobian import interval_geometry, intervals_between, spot_jacobian
from facets.scalars import intervals

SMALL = parse_box("tx_mm=2,ty_mm=2,tz_mm=2,roll_mrad=4,pitch_mrad=4,yaw_mrad=6")
SHARE = 0.2


def bounds_of_light(sensor, domain, share):
    ball = interval_geometry(sensor)
    parts = edges_over_rotations(ball, domain)
    return ball, hull_of_bounds([bounds_at_fixed_shares(edges, share) for edges in parts])


def states_in(domain, sensor, share, count, seed=1):
    """States of the box at which every facet has its share."""
    rng = np.random.default_rng(seed)
    pose = domain.low[:6] + rng.random((count, 6)) * (domain.high[:6] - domain.low[:6])
    offset = rng.uniform(-0.3, 0.3, (count, 2))
    states = np.concatenate([pose, pose[:, :2] - offset], axis=1)
    lit = facets.readings(sensor, states)[:, 2::3].min(axis=1) >= share * sensor.beam.power
    return states[lit]


def with_powers_held(matrix):
    """The 6 x 6 that is left of a Jacobian (9, 8) when offset follows from two powers."""
    by_pose = matrix.copy()
    by_pose[:, :2] += matrix[:, 6:]  # the beam moves along: the offset stays
    spots, powers = [0, 1, 3, 4, 6, 7], [2, 5]
    drift = np.linalg.solve(matrix[np.ix_(powers, [6, 7])], by_pose[powers][:, :6])
    return by_pose[spots][:, :6] - matrix[np.ix_(spots, [6, 7])] @ drift


@pytest.mark.parametrize("name", ["paper", "skewed1", "skewed2"])
def test_random_states_lie_in_the_intervals(name):
    sensor = SENSORS[name]
    ball, shares = bounds_of_light(sensor, SMALL, SHARE)
    inside = intervals_between(SMALL.low[:6], SMALL.high[:6])
    bounds = np.array(
        [[intervals.ends(x) for x in row] for row in spot_jacobian(ball, shares, inside)]
    )
    states = states_in(SMALL, sensor, SHARE, 3000)
    assert len(states) > 100
    for matrix in facets.jacobian(sensor, states):
        found = with_powers_held(matrix)
        assert (found >= bounds[:, :, 0] - 1e-9).all()
        assert (found <= bounds[:, :, 1] + 1e-9).all()


@pytest.mark.parametrize("name", ["paper", "skewed1"])
def test_eq_11_is_the_product_of_its_two_parts(name):
    sensor = SENSORS[name]
    ball, shares = bounds_of_light(sensor, SMALL, SHARE)
    low, high = intervals.ends(slope_of_powers(ball, shares))
    for matrix in facets.jacobian(sensor, states_in(SMALL, sensor, SHARE, 500)):
        whole = np.linalg.det(np.delete(matrix, 8, axis=0))
        slope = np.linalg.det(matrix[np.ix_([2, 5], [6, 7])])
        assert whole == pytest.approx(slope * np.linalg.det(with_powers_held(matrix)), rel=1e-9)
        assert low <= slope <= high


@pytest.mark.parametrize("name", ["paper", "skewed1"])
def test_a_box_is_certified_and_its_bound_holds(name):
    sensor = SENSORS[name]
    found = certify(sensor, SMALL, SHARE)
    assert found.regular
    assert found.unique
    matrices = facets.jacobian(sensor, states_in(SMALL, sensor, SHARE, 2000))
    least = np.abs(np.linalg.det(np.delete(matrices, 8, axis=1))).min()
    assert 0 < found.at_least <= least


@pytest.mark.study  # the suite proves it for the certificate that test_check_certificate spoils
def test_the_paper_s_sensor_is_one_to_one_over_its_whole_range():
    config = facets.load("paper")
    share = least_share(config.sensor, config.range)
    cover = cover_range(config.sensor, config.range, share)
    assert cover is not None
    found = certify(config.sensor, box_of_poses(cover.low, cover.high), share)
    assert found.unique
    assert found.margin > 0.3
    axes = range_box(config.sensor, config.range)
    assert (cover.low <= axes.low[:6]).all()
    assert (cover.high >= axes.high[:6]).all()


@pytest.mark.parametrize("tracking", [False, True])
@pytest.mark.slow
def test_poses_that_keep_the_rules_lie_in_the_box_that_holds_the_range(tracking):
    """Poses near the corners of the range, which the box of the axes' ranges leaves out."""
    config = facets.load("paper")
    rules = replace(config.range, tracking=tracking)
    cover = cover_range(config.sensor, rules, least_share(config.sensor, rules))
    rng = np.random.default_rng(3)
    half = np.array([0.2, 0.2, 9, 0.025, 0.025, 0.04])
    half[:2] *= 75 if tracking else 1
    poses = rng.uniform(-half, half, (30_000, 6))
    kept = poses[clearances(config.sensor, poses, rules).min(axis=1) > 0]
    assert len(kept) > 60
    assert (kept >= cover.low).all()
    assert (kept <= cover.high).all()
    if tracking:
        axes = range_box(config.sensor, rules)
        assert ((kept < axes.low[:6]) | (kept > axes.high[:6])).any()


def test_a_range_without_an_end_has_no_box():
    config = facets.load("paper")
    assert cover_range(config.sensor, config.range, 0.108, work=10) is None
    large = replace(config.sensor, psds=tuple(replace(p, size_y=200.0) for p in config.sensor.psds))
    assert cover_range(large, config.range, 0.108, work=300) is None


def test_the_reach_is_the_same_whatever_the_clock_says(monkeypatch):
    import itertools
    import time

    box = parse_box("tx_mm=1,tz_mm=1,yaw_mrad=5")
    first = find_reach(SENSORS["paper"], box, 0.3, farthest=3.0)
    ticks = itertools.count(0, 1e6)
    monkeypatch.setattr(time, "perf_counter", lambda: float(next(ticks)))
    again = find_reach(SENSORS["paper"], box, 0.3, farthest=3.0)
    assert first[0] == again[0] == 3.0
    assert first[1].margin == again[1].margin


@pytest.mark.slow
def test_a_singular_sensor_has_no_reach():
    assert find_reach(singular(), SMALL, SHARE, work=50) == (1.0, None)


def test_tolerances_come_from_what_is_known_before():
    config = facets.load("paper")
    found = calibration_tolerances(config, 2.0)
    assert found.source == "calibrate.before"
    assert found.values[12] == pytest.approx(0.4)
    assert found.values[6] == pytest.approx(3e-3)
    assert found.values[12] >= 0.4
    assert "beam.power" in found.exact
    sensor = replace(
        config.sensor, calibration=facets.core.sensor.Calibration(("beam.tilt_x",), ((4e-8,),))
    )
    found = calibration_tolerances(replace(config, sensor=sensor), 3.0)
    assert found.source == "the sensor's calibration"
    assert found.values[4] == pytest.approx(6e-4)
    assert len(found.exact) == 29


@pytest.mark.slow
def test_jacobians_of_sensors_within_tolerances_lie_in_the_intervals():
    sensor, rng = SENSORS["paper"], np.random.default_rng(4)
    off = np.array(calibration_tolerances(facets.load("paper"), 1.0).values)
    ball = interval_geometry(sensor, off)
    parts = edges_over_rotations(ball, SMALL)
    shares = hull_of_bounds([bounds_at_fixed_shares(edges, SHARE) for edges in parts])
    inside = intervals_between(SMALL.low[:6], SMALL.high[:6])
    bounds = np.array(
        [[intervals.ends(x) for x in row] for row in spot_jacobian(ball, shares, inside)]
    )
    for _ in range(20):
        other = sensor_with(sensor, np.array(parameters(sensor)) + rng.choice([-1, 1], 30) * off)
        for matrix in facets.jacobian(other, states_in(SMALL, other, SHARE, 100)):
            found = with_powers_held(matrix)
            assert (found >= bounds[:, :, 0] - 1e-9).all()
            assert (found <= bounds[:, :, 1] + 1e-9).all()


@pytest.mark.slow
def test_a_pair_is_found_in_the_box_of_a_singular_sensor():
    config = facets.load("singular")
    box, share = range_box(config.sensor, config.range), least_share(config.sensor, config.range)
    weak = search(config.sensor, box, 1).state
    found = find_pair_in_box(config.sensor, box, share, weak)
    assert found.outside == 0
    pair = np.array([found.pair.one, found.pair.other])
    seen = facets.readings(config.sensor, pair)
    np.testing.assert_allclose(seen[0], seen[1], atol=1e-10)
    assert np.abs(pair[0] - pair[1])[:3].max() > 0.05
    assert (pair[:, :6] >= box.low[:6]).all()
    assert (pair[:, :6] <= box.high[:6]).all()
    assert (seen[:, 2::3] >= share * config.sensor.beam.power).all()


def test_a_straight_sensor_has_no_singular_state_near():
    assert find_singular_state(SENSORS["paper"], np.zeros(8)) is None


def test_matrices_of_intervals():
    eye = [[arb(float(i == j)) for j in range(6)] for i in range(6)]
    margin, inverse, _ = regularity(eye)
    assert 0.9 < margin <= 1
    np.testing.assert_allclose(inverse, np.eye(6))
    assert distance_from_zero(determinant(eye)) == pytest.approx(1)
    eye[0][0] = intervals.interval(-1, 1)
    assert regularity(eye)[0] <= 0
    assert distance_from_zero(determinant(eye)) == 0
    eye[0][0] = arb("nan")
    assert not regularity(eye)[0] > 0
    assert distance_from_zero(determinant(eye)) == 0


def test_a_box_of_offsets_is_covered_by_its_least_share():
    sensor = SENSORS["paper"]
    box = parse_box("tx_mm=1,yaw_mrad=3,offset_x_mm=0.1,offset_y_mm=0.1")
    ball = interval_geometry(sensor)
    share = least_share_in_box(ball, edges_over_rotations(ball, box), box)
    states = box.states(np.random.default_rng(2).random((2000, 8)))
    seen = facets.readings(sensor, states)[:, 2::3].min() / sensor.beam.power
    assert 0.3 * seen < share <= seen
    assert certify(sensor, box).unique


def singular():
    return facets.load("singular").sensor


def blind():
    """A detector that looks along its sub-beam's plane."""
    sensor = SENSORS["paper"]
    return replace(sensor, psds=(replace(sensor.psds[0], yaw=np.pi / 2), *sensor.psds[1:]))


def coincident():
    """Detectors at the apex have no lever for rotations."""
    sensor = SENSORS["paper"]
    return replace(sensor, psds=tuple(replace(psd, radius=1e-3) for psd in sensor.psds))


@pytest.mark.parametrize("make", [singular, blind, coincident])
@pytest.mark.slow
def test_a_bad_design_is_never_certified(make):
    found = certify(make(), SMALL, SHARE, work=400)
    assert not found.regular
    assert not found.unique
    assert found.doubtful or found.reason


def test_a_share_that_three_facets_can_not_all_have_is_no_proof():
    found = certify(SENSORS["paper"], SMALL, 0.9)
    assert not found.unique
    assert found.reason


def test_the_light_of_a_bench_is_no_proof():
    light = facets.core.sensor.BenchLight(curvature_xx=1e-3)
    found = certify(replace(SENSORS["paper"], light=light), SMALL, SHARE)
    assert not found.unique
    assert "sensor.light" in found.reason


def test_light_that_apertures_cut_is_no_proof():
    sensor = replace(SENSORS["paper"], apertures=facets.Apertures(beam=1.0))
    found = certify(sensor, SMALL, SHARE)
    assert not found.unique
    assert "apertures" in found.reason


def test_a_box_where_a_facet_turns_over_is_no_proof():
    found = certify(SENSORS["paper"], parse_box("roll_mrad=1500"), 0.1, work=400)
    assert not found.unique


def test_intervals_hold_what_they_should():
    x = intervals.interval(-1.0, 2.0)
    assert intervals.ends(intervals.square(x))[0] >= -1e-8
    assert intervals.square(x).contains(arb(4))
    assert intervals.square(x).contains(arb(0))
    assert intervals.ends(
        intervals.nonnegative_product(intervals.interval(1, 2), intervals.interval(3, 4))
    )[1] == pytest.approx(8)
    assert (
        intervals.ends(
            intervals.nonnegative_product(intervals.interval(-1, 2), intervals.interval(-3, 4))
        )[0]
        <= 0
    )


def test_a_box_has_two_ends():
    with pytest.raises(facets.InputError, match="the box runs"):
        StateBox(np.ones(8), -np.ones(8))
