"""Footprints and margins, against points of the beam traced one by one."""

import numpy as np
import oracle
import pytest
from scipy.spatial.transform import Rotation
from sensors import SENSORS, states

import facets


def traced(sensor: facets.Sensor, state: np.ndarray) -> np.ndarray:
    """Least and largest psi and zeta of points of the 1/e^2 disc that meet each facet.

    A landing coordinate is linear over the disc, so that its extremes are at the rim or at the
    apex: 4,001 points of the rim, and few circles inside it.
    """
    at = oracle.setup(sensor, state)
    r, turn = np.meshgrid([0.0, 0.5, 1.0, 1.5, 1.9, 2.0], np.linspace(0, 2 * np.pi, 4001))
    points = np.stack([r * np.cos(turn), r * np.sin(turn)], axis=-1).reshape(-1, 2)
    points = np.concatenate([points, oracle.seen(at, at.apex - at.centre)[None]])
    start = at.centre + (points * at.sigmas) @ at.across.T
    depth = ((at.apex - start) @ at.normals.T) / (at.down @ at.normals.T)
    ends = np.empty((3, 5))
    for k in range(3):
        mine = depth[:, k] >= depth.max(axis=1) - 1e-9
        spots = oracle.land(at, k, points[mine])
        low, high = spots.min(axis=0), spots.max(axis=0)
        hits = start[mine] + depth[mine, k, None] * at.down - at.apex
        axis = Rotation.from_euler("ZYX", state[[5, 4, 3]]).apply([0, 0, 1])
        away = at.normals[k] - (at.normals[k] @ axis) * axis
        ends[k] = low[0], high[0], low[1], high[1], (hits @ away).max() / np.linalg.norm(away)
    return ends


def test_footprints_are_those_of_traced_points():
    """The rim's steps are 0.0008 mm in the beam: extremes agree to some times that."""
    for name, sensor in SENSORS.items():
        state = states(1, seed=40)[0]
        away = facets.footprints(sensor, state) - traced(sensor, state)
        assert np.abs(away).max() < 6e-3, name


def test_margins_of_footprints_and_of_centroids():
    """At rest a footprint hangs down from the apex's image by the beam's 1/e^2 radius."""
    sensor = facets.Sensor()
    assert facets.margins(sensor, np.zeros(8))[0, 2:4] == pytest.approx([6.5 - 0.425, 6.5])
    state = [0, 0, 1.0, 0, 0, 0.001, 0, 0]
    psi, zeta, _ = facets.readings(sensor, state)[:3]
    left, right, low, high = facets.margins(sensor, state, whole=False)[0, :4]
    assert (left, right) == pytest.approx((6.5 + psi, 6.5 - psi))
    assert (low, high) == pytest.approx((6.5 + zeta, 6.5 - zeta))


def test_a_facet_without_light_has_no_footprint():
    off = [3.0, 0, 0, 0, 0, 0, 0, 0]  # the beam falls on B and C alone
    ends = facets.footprints(facets.Sensor(), off)
    assert np.isnan(ends[0]).all()
    assert np.isfinite(ends[1:]).all()
