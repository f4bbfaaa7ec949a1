"""Ranges, outlines and uncertainties of an object, beside those of the mirror at the poses that
quaternions give for the object's displacements."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import facets
from facets.characterization import (
    COARSE,
    LIGHT,
    PSD,
    Estimator,
    clearances,
    estimators,
    map_inside,
    resolve,
)

CONFIG = facets.load("paper")
TIP = facets.MeasuredObject((0, 0, 50.0))
SIDE = facets.MeasuredObject((30.0, -20.0, -80.0), (0.3, -0.2, 2.0))
REST = np.zeros(6)


def mirror_of(moved, body: facets.MeasuredObject) -> np.ndarray:
    """Mirror poses (n, 6) at displacements (n, 6): the mirror turns with the object about it."""
    own, turn = (Rotation.from_euler("xyz", a) for a in (body.orientation, moved[:, 3:]))
    mirror = own * turn * own.inv()
    place = np.array(body.point) + own.apply(moved[:, :3]) - mirror.apply(body.point)
    return np.hstack([place, mirror.as_euler("xyz")])


@pytest.mark.parametrize(("body", "tracking"), [(TIP, False), (SIDE, False), (SIDE, True)])
def test_ranges_end_where_those_of_the_mirror_end(body, tracking):
    fixed = replace(CONFIG.range, tracking=tracking)
    found = facets.axis_ranges(CONFIG.sensor, replace(fixed, object=body), REST)
    for i, axis in enumerate(found):
        for end, cause in ((axis.low, axis.low_cause), (axis.high, axis.high_cause)):
            moved = np.zeros((2, 6))
            moved[:, i] = end * 0.9999, end * 1.0001
            clear = clearances(CONFIG.sensor, mirror_of(moved, body), fixed)
            assert clear[0].min() > 0 > clear[1].min()
            assert int(clear[1].argmin()) == cause


def test_a_turn_about_a_distant_point_moves_the_apex_out_of_the_light():
    rules = replace(CONFIG.range, object=TIP)
    tip = facets.axis_ranges(CONFIG.sensor, rules, REST)
    apex = facets.axis_ranges(CONFIG.sensor, CONFIG.range, REST)
    assert (apex[4].low_cause, tip[4].low_cause) == (PSD, LIGHT)
    assert tip[4].symmetric == pytest.approx(apex[0].symmetric / 50, rel=3e-3)
    for i in (0, 1, 2, 5):
        assert tip[i].symmetric == pytest.approx(apex[i].symmetric, rel=1e-9)


@pytest.mark.parametrize("point", [50.0, pytest.param(-800.0, marks=pytest.mark.slow)])
def test_an_outline_is_long_where_the_apex_stays_in_the_beam(point):
    """The tip may go as far as the mirror may turn, along the line on which the apex stays."""
    body = facets.MeasuredObject((0, 0, point))
    rules = replace(CONFIG.range, object=body)
    found = facets.trace(CONFIG.sensor, rules, ("tx", "pitch"))
    assert (found.causes >= 0).all()
    turns = [a for a in facets.axis_ranges(CONFIG.sensor, CONFIG.range, REST) if a.name == "pitch"]
    assert found.extent[1] == pytest.approx(turns[0].total, rel=0.05)
    moved = found.poses(found.points)
    clear = clearances(CONFIG.sensor, mirror_of(moved, body), CONFIG.range).min(axis=1)
    assert np.abs(clear).max() < 0.05
    inside = clearances(CONFIG.sensor, mirror_of(0.99 * moved, body), CONFIG.range)
    assert (inside.min(axis=1) > 0).all()


def test_uncertainties_are_those_of_the_solver_at_the_point():
    state = np.array([[0.02, -0.03, 0.1, 2e-3, 3e-3, -4e-3, 0, 0]])
    free = facets.uncertainties(CONFIG.sensor, state, facets.Knowledge(), SIDE)
    solution = facets.solve(CONFIG.sensor, facets.readings(CONFIG.sensor, state), beam="free")
    moved = facets.transform(solution, SIDE, REST)
    np.testing.assert_allclose(free, moved.uncertainty, rtol=1e-6)
    parts = facets.budgets(CONFIG.sensor, state, facets.Knowledge(), SIDE)
    np.testing.assert_allclose(np.sqrt(parts.sum(axis=2)), free, rtol=1e-12)


@pytest.mark.slow
def test_the_worst_in_the_range_of_an_object_and_the_limit_of_its_uncertainty():
    rules = replace(CONFIG.range, object=SIDE)
    found = resolve(CONFIG.sensor, rules, estimators(0.005))[1]
    ends = [axis.symmetric / 2 for axis in facets.axis_ranges(CONFIG.sensor, rules, REST)]
    for i, (state, largest) in enumerate(zip(found.worst_state, found.worst, strict=True)):
        again = facets.uncertainties(CONFIG.sensor, state, Estimator("", np.inf), SIDE)
        assert again[i] == largest
        moved = facets.transform(state, SIDE, REST).pose
        assert (np.abs(moved) < np.array(ends)).all()
    limit = float(1.2 * found.nominal[0])
    coarse = replace(rules, coarsest=(limit, *[np.inf] * 5))
    ends = facets.axis_ranges(CONFIG.sensor, coarse, REST)
    assert COARSE in {axis.low_cause for axis in ends}
    for i, axis in enumerate(ends):
        if axis.low_cause == COARSE:
            moved = np.zeros((1, 6))
            moved[0, i] = axis.low
            state = np.append(mirror_of(moved, SIDE), np.zeros((1, 2)), axis=1)
            fine = facets.uncertainties(CONFIG.sensor, state, facets.Knowledge(), SIDE)[0, 0]
            assert fine == pytest.approx(limit, rel=1e-6)
    outline = facets.trace(CONFIG.sensor, rules, ("tz", "yaw"))
    _, _, values, _ = map_inside(CONFIG.sensor, rules, outline, "tx", count=21)
    assert values[10, 10] == pytest.approx(1e3 * found.nominal[0], rel=0.05)
