"""The spots' places and their derivatives by the pose, as interval enclosures over a box.

The poses, the sensor's parameters and the light's bounds are all intervals. A facet that may be
turned past the beam, or a sub-beam that may miss its detector, raises `NotFacing`.

Poses, and their ends low and high, are (6,) in mm and rad; Jacobians (6, 6) have a row for each
coordinate of a spot, mm, of detectors A, B and C.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from flint import arb
from numpy.typing import NDArray

from ..core.sensor import Sensor
from ..core.units import Floats
from ..model.arrays import parameters
from ..optics.forward import Geometry, Scene, build_geometry, dark_scene, mirror_edges
from ..optics.rays import flight, gradient_of_normal, gradient_of_shift, reflect, slant
from ..optics.vectors import (
    Matrix,
    Vector,
    combine,
    cross,
    dot,
    rotate,
    rotation_axes,
    scale,
    subtract,
)
from ..scalars.dispatch import real
from ..scalars.dual import Dual
from ..scalars.intervals import Interval, interval, interval_around
from .interval_matrix import MAGNITUDE, Intervals, middles
from .light_sharing import SharingBounds


class NotFacing(Exception):
    """Somewhere in the box a facet may not face the beam, or its sub-beam miss its detector."""


def interval_geometry(sensor: Sensor, tolerances: Sequence[float] | None = None) -> Geometry:
    """Compute the sensor's vectors from its stored parameters, without further rounding.

    tolerances: (30,) the largest error of each, in the order of `facets.PARAMETERS`; mm, rad, mW.
    """
    values = parameters(sensor)
    off = [0.0] * len(values) if tolerances is None else tolerances
    return build_geometry(
        tuple(interval_around(value, by) for value, by in zip(values, off, strict=True))
    )


def intervals_between(low: Any, high: Any) -> Intervals:
    """Intervals from `low` to `high`, element by element."""
    return np.array([interval(float(a), float(b)) for a, b in zip(low, high, strict=True)])


def dark_scene_over(geometry: Geometry, pose: Sequence[Interval] | Intervals) -> Scene:
    """The mirror's places for all poses of a box, without the light."""
    zero = arb(0)
    at = dark_scene(geometry, (*pose, zero, zero))
    a, b, c = mirror_edges(
        geometry.normals
    )  # turned as they are: a cross product of intervals is wider
    return at._replace(edges=(rotate(at.turn, a), rotate(at.turn, b), rotate(at.turn, c)))


class SubBeam(NamedTuple):
    """One ray of a sub-beam over a box, from `start` along `leaving` for a distance `length`, mm.

    lever: from the point of incidence to the apex, mm.
    """

    normal: Vector
    leaving: Vector
    lever: Vector
    start: Vector
    length: Interval


def sub_beam(geometry: Geometry, at: Scene, k: int, from_point: Sequence[Interval]) -> SubBeam:
    """The ray that meets facet k `from_point` (2,) off the apex, in sigmas across the beam. Raises
    `NotFacing` if a facet or a detector may face away."""
    normal, beam = at.normals[k], geometry.direction
    incidence = dot(beam, normal)
    leaving = reflect(beam, normal)
    middle = combine(from_point[0], geometry.spread[0], from_point[1], geometry.spread[1])
    if not real(incidence) < 0:
        raise NotFacing
    lever = scale(-1, combine(1, middle, -dot(normal, middle) / incidence, beam))
    start = subtract(at.apex, lever)
    if not real(dot(leaving, geometry.axes[k][0])) > 0:
        raise NotFacing
    length = flight(start, leaving, geometry.centres[k], geometry.axes[k])
    if not real(length) > 0:
        raise NotFacing
    return SubBeam(normal, leaving, lever, start, length)


def spot_jacobian(
    geometry: Geometry, shares: SharingBounds, pose: Sequence[Interval] | Intervals
) -> Intervals:
    """6 x 6 over a box of poses (6,): psi and zeta of A, B, C by apex and angles; mm and rad.

    shares: the light's bounds at fixed shares.  Raises `NotFacing`.
    """
    at = dark_scene_over(geometry, pose)
    axes = rotation_axes(pose[4], pose[5])
    rays = [sub_beam(geometry, at, k, shares.from_point[k]) for k in range(3)]
    return np.array([
        gradient_of_spot(geometry, rays[k], axis, geometry.axes[k][0], shares.turns[k], axes)
        for k in range(3)
        for axis in geometry.axes[k][1:]
    ])  # fmt: skip


class Centred(NamedTuple):
    """A 6 x 6 Jacobian over a piece: in `middle` + sum of slopes[m] times the change on axis m.

    place: (6,) the pose in the piece's middle.  half: (6,) the distances from there to its ends.
    middle: at that pose, over the light's bounds.  slopes: (6, 6, 6) over the whole piece.
    """

    place: Intervals
    half: Intervals
    middle: Intervals
    slopes: Intervals

    def enclosure(self) -> Intervals:
        """Return an enclosure of the Jacobian (6, 6) over the whole piece."""
        enclosure: Intervals = self.middle + np.tensordot(self.slopes, self.half, (0, 0))
        return enclosure

    def levers(self) -> Floats:
        """The change (6,) of the Jacobian with each axis of the pose, over the Jacobian's own
        size."""
        inverse = np.abs(np.linalg.pinv(middles(self.middle)))
        moved: Floats = (inverse @ MAGNITUDE(self.slopes).astype(float)).sum(axis=-1).max(axis=-1)
        return moved


def centred_jacobian(
    geometry: Geometry, shares: SharingBounds, low: Floats, high: Floats
) -> Centred:
    """Return `spot_jacobian` with its slopes. Raises `NotFacing`.

    The spots are linear in the apex: the first three columns have no slope by the apex, and the
    slope of the others by the apex is that of the first three by the angle.
    """
    pose = intervals_between(low, high)
    place = np.array([arb(float(x)) for x in (low + high) / 2])
    middle = spot_jacobian(geometry, shares, place)
    angles = [Dual(pose[3 + j], unit_slope(j)) for j in range(3)]
    spot_jacobian(geometry, shares, pose)  # is every facet in it facing?
    carried = spot_jacobian(geometry, shares, [*place[:3], *angles])
    by_angles = np.array(
        [[[slope_by_angle(x, j) for x in row] for row in carried] for j in range(3)]
    )
    by_apex = np.full((3, 6, 6), arb(0))
    by_apex[:, :, 3:] = by_angles[:, :, :3].T
    return Centred(place, pose - place, middle, np.concatenate([by_apex, by_angles]))


def unit_slope(axis: int) -> NDArray[Any]:
    """The slope of an angle itself, by the three angles: (3,) intervals."""
    return np.array([arb(int(i == axis)) for i in range(3)], dtype=object)


def slope_by_angle(x: Any, axis: int) -> Interval:
    """The derivative of a number by roll, pitch or yaw (axis 0, 1, 2), per rad; 0 if it is not a
    `Dual`."""
    return x.imag[axis] if isinstance(x, Dual) else arb(0)


def gradient_of_spot(
    geometry: Geometry,
    ray: SubBeam,
    axis: Vector,
    outward: Vector,
    turns: Sequence[Sequence[Interval]],
    axes: Matrix,
) -> list[Interval]:
    """The derivative of the spot's coordinate along `axis`: (6,) by apex, roll, pitch and yaw.

    outward: the detector's x.  turns: (2, 3) derivatives of the light's centroid less the apex by
    the angles.  axes: about which roll, pitch and yaw turn the mirror.
    """
    beam = geometry.direction
    along = slant(axis, ray.leaving, outward)
    by_normal = gradient_of_normal(along, beam, ray.normal, ray.lever, ray.length)
    turn = cross(ray.normal, by_normal)
    shift = gradient_of_shift(along, beam, ray.normal)
    by_light = [dot(shift, spread) for spread in geometry.spread]
    by_turn = [
        dot(turn, axes[j]) + by_light[0] * turns[0][j] + by_light[1] * turns[1][j] for j in range(3)
    ]
    return [*along, *by_turn]
