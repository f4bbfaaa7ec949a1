"""Outlines of ranges: against grids and rays, and what is inside them."""

import numpy as np
import pytest

import facets
from facets import POSE, InputError, Rules
from facets.characterization import Boundary, find_exits, outline_columns, outlines

SENSOR = facets.Sensor()
REST = np.zeros(6)
PAIRS = [("tx", "ty"), ("tx", "yaw"), ("tz", "pitch"), ("roll", "pitch"), ("pitch", "yaw")]


@pytest.mark.parametrize(
    ("axes", "tracking"), [(pair, False) for pair in PAIRS] + [(pair, True) for pair in PAIRS[:2]]
)
def test_outlines_are_those_of_a_grid(axes, tracking):
    """Grid points that differ lie within two tolerances of the outline."""
    rules = Rules(tracking=tracking)
    boundary = outlines.trace(SENSOR, rules, axes)
    x, y, cause = outlines.cause_grid(SENSOR, rules, boundary, 150)
    points = outlines.grid_points(x, y)
    differ = outlines.encloses(boundary, points) != (cause.ravel() < 0)
    fine = outlines.tolerances(axes)
    for point in points[differ]:
        starts = boundary.points / fine
        away = outlines.chord_distance(
            np.tile(point / fine, (len(starts), 1)), starts, np.roll(starts, -1, 0)
        )
        assert away.min() < 2
    assert differ.sum() < 20


@pytest.mark.parametrize("axes", PAIRS)
def test_outlines_hold_their_tolerance_between_their_points(axes):
    """Rays in directions that were not asked end within a tolerance of the chord they cross."""
    boundary = outlines.trace(SENSOR, Rules(), axes)
    fine, scale = outlines.tolerances(axes), np.abs(boundary.points).max(axis=0)
    columns = [POSE.index(name) for name in axes]
    angles = np.random.default_rng(3).uniform(0, 2 * np.pi, 200)
    rays = np.zeros((200, 6))
    rays[:, columns] = 2 * scale * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    ends = (find_exits(SENSOR, Rules(), REST, rays, 1e-9).distance[:, None] * rays)[:, columns]
    corners = np.arctan2(*(boundary.points / scale).T[::-1]) % (2 * np.pi)
    order = np.argsort(corners)
    after = order[np.searchsorted(corners[order], angles) % len(order)]
    before = (after - 1) % len(corners)
    points = boundary.points / fine
    assert outlines.chord_distance(ends / fine, points[before], points[after]).max() < 1.1


def test_all_poses_inside_are_solved():
    for axes in PAIRS[1:3]:
        boundary = outlines.trace(SENSOR, Rules(), axes)
        tried, right = outlines.count_correct_solutions(SENSOR, Rules(), boundary)
        assert tried == right > 100


def test_a_place_outside_the_range_is_no_start():
    with pytest.raises(InputError, match="spot leaves the PSD"):
        outlines.trace(SENSOR, Rules(), ("tx", "ty"), np.array([0, 0, 20.0, 0, 0, 0]))


def test_elsewhere_the_range_is_smaller():
    away = np.zeros(6)
    away[2] = 5.0
    rest = outlines.trace(SENSOR, Rules(), ("roll", "pitch")).extent
    assert (outlines.trace(SENSOR, Rules(), ("roll", "pitch"), away).extent < rest).all()


def test_a_table_has_points_in_the_units_of_its_axes():
    edge = Boundary(("tx", "roll"), np.zeros(6), np.array([[0.3, 5e-3]]), np.array([-1]), 1)
    assert [column[0] for column in outline_columns([edge]).values()] == [
        "tx_mm", "roll_mrad", 0.3, 5.0, "nowhere",
    ]  # fmt: skip
