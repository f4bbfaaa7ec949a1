"""Ranges, outlines and uncertainties of an object, beside those of the mirror at the poses that
quaternions give for the object's displacements."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import facets
from facets.characterization import COARSE, Estimator, clearances, map_inside, resolve

CONFIG = facets.load("paper")
SENSOR = CONFIG.sensor
SIDE = facets.MeasuredObject((30.0, -20.0, -80.0), (0.3, -0.2, 2.0))
REST = np.zeros(6)


def mirror_of(moved, body):
    """Mirror poses (n, 6) at displacements (n, 6): the mirror turns with the object about it."""
    own, turn = (Rotation.from_euler("xyz", a) for a in (body.orientation, moved[:, 3:]))
    mirror = own * turn * own.inv()
    place = np.array(body.point) + own.apply(moved[:, :3]) - mirror.apply(body.point)
    return np.hstack([place, mirror.as_euler("xyz")])


def uncertainties_at(moved, body):
    """Those of the object (n, 6) at its displacements (n, 6), by the solver's covariance."""
    states = np.hstack([mirror_of(moved, body), np.zeros((len(moved), 2))])
    solution = facets.solve(SENSOR, facets.readings(SENSOR, states), start=states)
    return facets.transform(solution, body, REST).uncertainty


@pytest.mark.parametrize("tracking", [False, True])
def test_ranges_end_where_those_of_the_mirror_end(tracking):
    fixed = replace(CONFIG.range, tracking=tracking)
    axes = facets.axis_ranges(SENSOR, replace(fixed, object=SIDE), REST)
    for i, axis in enumerate(axes):
        for end, cause in ((axis.low, axis.low_cause), (axis.high, axis.high_cause)):
            moved = np.outer([end * 0.9999, end * 1.0001], np.eye(6)[i])
            clear = clearances(SENSOR, mirror_of(moved, SIDE), fixed)
            assert clear[0].min() > 0 > clear[1].min()
            assert int(clear[1].argmin()) == cause


def test_an_outline_is_long_where_the_apex_stays_in_the_beam():
    """The tip may go as far as the mirror may turn, along the line on which the apex stays."""
    tip = facets.MeasuredObject((0, 0, 50.0))
    rules = replace(CONFIG.range, object=tip)
    outline = facets.trace(SENSOR, rules, ("tx", "pitch"))
    pitch = facets.axis_ranges(SENSOR, CONFIG.range, REST)[4]
    assert outline.extent[1] == pytest.approx(pitch.total, rel=0.05)
    moved = outline.poses(outline.points)
    for share, least, most in ((1, -0.05, 0.05), (0.99, 0, np.inf)):
        clear = clearances(SENSOR, mirror_of(share * moved, tip), CONFIG.range).min(axis=1)
        assert ((least < clear) & (clear < most)).all()
    x, y, values = map_inside(SENSOR, rules, outline, "tx", count=21)
    middle = uncertainties_at(outline.poses(np.array([[x[10], y[10]]])), tip)
    assert values[10, 10] == pytest.approx(1e3 * middle[0, 0], rel=1e-6)


def test_uncertainties_are_those_of_the_solver_at_the_point():
    moved = np.array([[0.02, -0.03, 0.1, 2e-4, 3e-4, -4e-4]])
    state = np.append(mirror_of(moved, SIDE), np.zeros((1, 2)), axis=1)
    free = facets.uncertainties(SENSOR, state, facets.Knowledge(), SIDE)
    np.testing.assert_allclose(free, uncertainties_at(moved, SIDE), rtol=1e-6)
    parts = facets.budgets(SENSOR, state, facets.Knowledge(), SIDE)
    np.testing.assert_allclose(np.sqrt(parts.sum(axis=2)), free, rtol=1e-12)
    limit = float(1.2 * facets.uncertainties(SENSOR, np.zeros(8), facets.Knowledge(), SIDE)[0])
    rules = replace(CONFIG.range, object=SIDE, coarsest=(limit, *[np.inf] * 5))
    ends = facets.axis_ranges(SENSOR, rules, REST)
    coarse = [axis.low * np.eye(6)[i] for i, axis in enumerate(ends) if axis.low_cause == COARSE]
    assert uncertainties_at(np.array(coarse), SIDE)[:, 0] == pytest.approx(limit, rel=1e-6)


@pytest.mark.slow
def test_the_worst_pose_is_in_the_range_of_the_object():
    rules = replace(CONFIG.range, object=SIDE)
    (row,) = resolve(SENSOR, rules, [Estimator("", facets.Knowledge())])
    again = facets.uncertainties(SENSOR, row.worst_state, row.how, SIDE)
    np.testing.assert_array_equal(again.diagonal(), row.worst)
    ends = [axis.symmetric / 2 for axis in facets.axis_ranges(SENSOR, rules, REST)]
    assert (np.abs(facets.transform(row.worst_state, SIDE, REST).pose) < ends).all()
