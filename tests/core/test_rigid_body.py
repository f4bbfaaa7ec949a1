"""Poses and displacements of objects beside scipy's rotations and mpmath's matrices, neither of
which shares a formula with them."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest
from digits import STEP, precise
from oracle import object_motion
from scipy.spatial.transform import Rotation

import facets
from facets.core import MeasuredObject, mirror_poses, object_displacements, object_poses

RNG = np.random.default_rng(33)
SIZES = np.array([5, 5, 5, 0.3, 0.3, 0.3])
POSES, ZEROS = (RNG.uniform(-1, 1, (200, 6)) * SIZES for _ in range(2))
HEAD = MeasuredObject((10.0, -20.0, 50.0), (0.4, -0.9, 3.0))


def angle_between(angles, turn: Rotation) -> float:
    return float((Rotation.from_euler("xyz", angles).inv() * turn).magnitude().max())


def test_bodies_move_about_points_as_quaternions_say():
    for body in (HEAD, MeasuredObject((0, 0, -300.0)), MeasuredObject()):
        place, turn = object_motion(POSES, body)
        start, turn_zero = object_motion(ZEROS, body)
        found, _ = object_poses(POSES, body)
        np.testing.assert_allclose(found[:, :3], place, rtol=0, atol=1e-12)
        assert angle_between(found[:, 3:], turn) < 1e-14
        moved, _, _ = object_displacements(POSES, ZEROS, body)
        np.testing.assert_allclose(
            moved[:, :3], turn_zero.inv().apply(place - start), rtol=0, atol=1e-12
        )
        assert angle_between(moved[:, 3:], turn_zero.inv() * turn) < 1e-14
        same, _, _ = object_displacements(POSES, POSES, body)
        np.testing.assert_allclose(same, 0, atol=1e-14)
        apart, _, _ = object_displacements(POSES, np.zeros(6), body)
        np.testing.assert_allclose(mirror_poses(apart, body), POSES, rtol=0, atol=1e-12)


def matrix(values) -> mp.matrix:
    """A pose as a 4 x 4 matrix, from the products of three turns about one axis each."""
    x, y, z, *angles = values
    found = mp.matrix([[1, 0, 0, x], [0, 1, 0, y], [0, 0, 1, z], [0, 0, 0, 1]])
    for axis in (2, 1, 0):
        turn, (i, j) = mp.eye(4), [(1, 2), (2, 0), (0, 1)][axis]
        turn[i, i] = turn[j, j] = mp.cos(angles[axis])
        turn[j, i] = mp.sin(angles[axis])
        turn[i, j] = -turn[j, i]
        found *= turn
    return found


def pose_of(m: mp.matrix) -> list:
    return [
        m[0, 3], m[1, 3], m[2, 3], mp.atan2(m[2, 1], m[2, 2]), -mp.asin(m[2, 0]),
        mp.atan2(m[1, 0], m[0, 0]),
    ]  # fmt: skip


@pytest.mark.parametrize("n", range(3))
def test_derivatives_are_exact_by_40_digits(n):
    with mp.workdps(40):
        own = matrix(precise([*HEAD.point, *HEAD.orientation]))
        both = precise([*POSES[n], *ZEROS[n]])

        def displacement(values) -> list:
            return pose_of((matrix(values[6:]) * own) ** -1 * matrix(values[:6]) * own)

        def pose(values) -> list:
            return pose_of(matrix(values[:6]) * own)

        for found, compute in (
            (np.hstack(object_displacements(POSES[n], ZEROS[n], HEAD)[1:]), displacement),
            (object_poses(POSES[n], HEAD)[1], pose),
        ):
            here = compute(both)
            for column in range(found.shape[1]):
                there = compute([v + STEP * (k == column) for k, v in enumerate(both)])
                slope = [float((b - a) / STEP) for a, b in zip(here, there, strict=True)]
                np.testing.assert_allclose(found[:, column], slope, rtol=1e-12, atol=1e-12)


def test_angles_stay_near_the_orientation_and_end_at_the_pole():
    half = MeasuredObject(orientation=(np.pi, 0.0, -np.pi))
    yaws = np.zeros((101, 6))
    yaws[:, 5] = np.linspace(-0.1, 0.1, 101)
    found, _ = object_poses(yaws, half)
    np.testing.assert_allclose(found[:, 5], yaws[:, 5] - np.pi, atol=1e-14)
    np.testing.assert_allclose(found[:, 3], np.pi, atol=1e-14)
    steep = MeasuredObject(orientation=(0, np.radians(80), 0))
    for degrees, is_finite in ((9.0, True), (9.6, False)):
        pose, slopes = object_poses(np.array([0, 0, 0, 0, np.radians(degrees), 0]), steep)
        assert np.isfinite(pose[[3, 5]]).all() == is_finite
        assert np.isfinite(pose[[0, 1, 2, 4]]).all()
        assert np.isfinite(slopes[:3]).all()
        assert np.isfinite(slopes).all() == is_finite


def test_objects_that_cannot_be(tmp_path):
    with pytest.raises(facets.InputError, match="orientation of the object is"):
        facets.MeasuredObject(orientation=(0.0, 1.5, 0.0))
    with pytest.raises(facets.InputError, match="point of the object is"):
        facets.MeasuredObject(point=(0.0, float("nan"), 0.0))
    path = tmp_path / "steep.yaml"
    path.write_text("extends: paper\nobject: {point_mm: [0, 0, 50], pitch_deg: 90}\n")
    with pytest.raises(facets.ConfigError, match=r"steep.yaml:2: object.pitch_deg: .*-80 to 80"):
        facets.load(path)
    path.write_text(path.read_text().replace("pitch", "yaw"))
    assert facets.load(path).object == facets.MeasuredObject((0, 0, 50), (0, 0, np.pi / 2))
