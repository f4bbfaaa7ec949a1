"""Measurement ranges: limits, traced outlines against grids, and the paper's Table 2."""

from dataclasses import replace

import numpy as np
import pytest

import facets
from facets.characterization import ranges
from facets.characterization.ranges import CAUSES, LIGHT, PSD
from facets.core.errors import InputError
from facets.core.names import POSE
from facets.core.rules import Rules

SENSOR = facets.Sensor()
REST = np.zeros(6)
PAIRS = [("tx", "ty"), ("tx", "yaw"), ("tz", "pitch"), ("roll", "pitch"), ("pitch", "yaw")]


def test_table_2_from_one_signal_to_noise_ratio():
    """Ranges as the paper's, measured on a rig with its own tolerances, within 5 %: equally far to
    both sides, where x under a fixed beam is shorter than y, as measured."""
    fixed = {axis.name: axis for axis in ranges.axis_ranges(SENSOR, Rules(), REST)}
    tracked = {axis.name: axis for axis in ranges.axis_ranges(SENSOR, Rules(tracking=True), REST)}
    measured = {"tx": 0.36, "ty": 0.39, "tz": 12.3, "roll": 0.028, "pitch": 0.0245, "yaw": 0.048}
    for name, value in measured.items():
        assert fixed[name].symmetric == pytest.approx(value, rel=0.05)
        cause = LIGHT if name in ("tx", "ty") else PSD
        assert (fixed[name].low_cause, fixed[name].high_cause) == (cause, cause)
    assert tracked["tx"].symmetric == pytest.approx(13.6, rel=0.05)
    assert tracked["ty"].symmetric == pytest.approx(11.8, rel=0.05)


@pytest.mark.parametrize("axes", PAIRS)
@pytest.mark.parametrize("tracking", [False, True])
def test_outlines_are_those_of_a_grid(axes, tracking):
    """Grid points that differ lie within two tolerances of the outline."""
    rules = Rules(tracking=tracking)
    boundary = ranges.trace(SENSOR, rules, axes)
    x, y, cause = ranges.grid(SENSOR, rules, boundary, 150)
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    differ = ranges.inside(boundary, points) != (cause.ravel() < 0)
    fine = ranges.tolerances(axes)
    for point in points[differ]:
        starts = boundary.points / fine
        away = ranges.off_chord(
            np.tile(point / fine, (len(starts), 1)), starts, np.roll(starts, -1, 0)
        )
        assert away.min() < 2
    assert differ.sum() < 20


@pytest.mark.parametrize("axes", PAIRS)
def test_outlines_hold_their_tolerance_between_their_points(axes):
    """Rays in directions that were not asked end within a tolerance of the chord they cross."""
    boundary = ranges.trace(SENSOR, Rules(), axes)
    fine, scale = ranges.tolerances(axes), np.abs(boundary.points).max(axis=0)
    columns = [POSE.index(name) for name in axes]
    angles = np.random.default_rng(3).uniform(0, 2 * np.pi, 200)
    rays = np.zeros((200, 6))
    rays[:, columns] = 2 * scale * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    ends = (ranges.exits(SENSOR, Rules(), REST, rays, 1e-9).distance[:, None] * rays)[:, columns]
    corners = np.arctan2(*(boundary.points / scale).T[::-1]) % (2 * np.pi)
    order = np.argsort(corners)
    after = order[np.searchsorted(corners[order], angles) % len(order)]
    before = (after - 1) % len(corners)
    points = boundary.points / fine
    assert ranges.off_chord(ends / fine, points[before], points[after]).max() < 1.1


def test_the_cause_is_the_limit_that_is_broken():
    poses = np.zeros((3, 6))
    poses[0, 0] = 0.3  # past the light's reach
    poses[1, 2] = 7.0  # past the detector's edge
    clear = ranges.clearances(SENSOR, poses, Rules())
    assert (clear[2] > 0).all()
    assert [int(row.argmin()) for row in clear[:2]] == [LIGHT, PSD]
    assert CAUSES[LIGHT] == "too little light"


def test_a_limit_on_resolution_ends_the_range_where_it_is_met():
    limit = 3e-3
    rules = Rules(coarsest=(limit, *[np.inf] * 5))
    found = ranges.axis_ranges(SENSOR, rules, REST)[0]
    assert CAUSES[found.high_cause] == "too coarse"
    state = np.zeros(8)
    state[0] = found.high
    solution = facets.solve(SENSOR, facets.readings(SENSOR, state))
    assert solution.uncertainty[0] == pytest.approx(limit, rel=1e-4)
    assert found.high < ranges.axis_ranges(SENSOR, Rules(), REST)[0].high
    assert ranges.trace(SENSOR, rules, ("tx", "ty")).points[0, 0] == pytest.approx(
        found.high, abs=1e-4
    )


def test_a_limit_on_the_condition_ends_the_range():
    near = ranges.scaled_jacobian(SENSOR, np.zeros((1, 8)))[0]
    rules = Rules(condition=1.2 * np.linalg.cond(near))
    found = ranges.axis_ranges(SENSOR, rules, REST)[0]
    assert CAUSES[found.high_cause] == "Jacobian near singular"


@pytest.mark.slow
def test_the_box_is_inside_and_touches_a_limit():
    sizes = np.array([axis.symmetric / 2 for axis in ranges.axis_ranges(SENSOR, Rules(), REST)])
    half, cause = ranges.box(SENSOR, Rules(), REST, sizes)
    inside = np.random.default_rng(5).uniform(-half, half, (20_000, 6))
    assert (ranges.clearances(SENSOR, inside, Rules()).min(axis=1) > 0).mean() > 0.9999
    assert CAUSES[cause] == "spot leaves the PSD"


def test_a_centroid_goes_further_than_a_whole_spot():
    whole = ranges.axis_ranges(SENSOR, Rules(), REST)[2]
    centroid = ranges.axis_ranges(SENSOR, Rules(whole_spot=False), REST)[2]
    assert centroid.symmetric > whole.symmetric


def test_all_poses_inside_are_solved():
    for axes in PAIRS:
        boundary = ranges.trace(SENSOR, Rules(), axes)
        tried, right = ranges.solved(SENSOR, Rules(), boundary)
        assert tried == right > 100


def test_a_place_outside_the_range_is_no_start():
    with pytest.raises(InputError, match="spot leaves the PSD"):
        ranges.trace(SENSOR, Rules(), ("tx", "ty"), np.array([0, 0, 20.0, 0, 0, 0]))


def test_elsewhere_the_range_is_smaller():
    away = np.zeros(6)
    away[2] = 5.0
    rest = ranges.trace(SENSOR, Rules(), ("roll", "pitch")).extent
    assert (ranges.trace(SENSOR, Rules(), ("roll", "pitch"), away).extent < rest).all()


def test_cut_spots_leave_the_detector_as_whole_ones_do():
    cut = replace(SENSOR, apertures=facets.Apertures(detectors=True))
    a, b = (ranges.axis_ranges(sensor, Rules(), REST)[5] for sensor in (SENSOR, cut))
    assert a.symmetric == pytest.approx(b.symmetric, rel=1e-6)


def test_other_light_on_the_detectors_is_no_light_of_a_spot():
    """Else a range goes on in the dark: a room has more light than `range.snr` asks for."""
    sensor = replace(facets.Sensor(), noise=replace(facets.Noise(), power=1e-6))
    rules = Rules(snr=100)
    room = replace(sensor.light, background=((2e-3, 1, 2), (2e-3, -1, 0.5), (2e-3, 0, -2)))
    dark = ranges.axis_ranges(sensor, rules, np.zeros(6))[0]
    lit = ranges.axis_ranges(replace(sensor, light=room), rules, np.zeros(6))[0]
    assert lit.high_cause == dark.high_cause == LIGHT
    assert lit.high == pytest.approx(dark.high, rel=1e-3)
