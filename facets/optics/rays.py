"""One ray: its reflection at a facet, its landing on a detector, and the derivatives of the landing
point.

Vectors are tuples in the world frame, mm. All functions take any number type.
"""

from __future__ import annotations

from ..scalars.dispatch import Number
from .vectors import Matrix, Vector, add, combine, dot, scale, subtract


def reflect(direction: Vector, normal: Vector) -> Vector:
    """The direction of a ray after a plane mirror with the given unit normal."""
    return combine(1, direction, -2 * dot(direction, normal), normal)


def hit(origin: Vector, direction: Vector, point: Vector, normal: Vector) -> Vector:
    """The point where a ray meets the plane through `point`; undefined for a ray parallel to the
    plane."""
    reach = dot(subtract(point, origin), normal) / dot(direction, normal)
    return add(origin, scale(reach, direction))


def flight(start: Vector, direction: Vector, centre: Vector, axes: Matrix) -> Number:
    """Length along `direction` from `start` to the detector's plane, in units of `direction`."""
    return dot(subtract(centre, start), axes[0]) / dot(direction, axes[0])


def land(
    start: Vector, direction: Vector, length: Number, centre: Vector, axes: Matrix
) -> tuple[Number, Number]:
    """The point where a ray meets a detector: (psi, zeta), mm, in the detector's frame.

    length: from `flight`.  axes: the detector's x (its normal, away from the source), y and z in
    the world. Undefined where direction . x <= 0: the ray never reaches the detector.
    """
    spot = subtract(add(start, scale(length, direction)), centre)
    return dot(spot, axes[1]), dot(spot, axes[2])


def slant(axis: Vector, direction: Vector, normal: Vector) -> Vector:
    """The gradient of the coordinate along `axis` when the ray is shifted as a whole.

    It is the axis projected along the ray, because a shift along the ray itself changes nothing.
    """
    return combine(1, axis, -dot(direction, axis) / dot(direction, normal), normal)


def gradient_of_shift(along: Vector, beam: Vector, normal: Vector) -> Vector:
    """Gradient of a landing coordinate with respect to the incoming ray's origin.

    along: the coordinate's slanted axis; beam, normal: the incoming direction, the facet's normal.
    """
    return combine(1, along, -dot(along, beam) / dot(beam, normal), normal)


def gradient_of_mirror(along: Vector, beam: Vector, normal: Vector) -> Vector:
    """Gradient of a landing coordinate with respect to the apex, which lies on the facet."""
    return scale(dot(along, beam) / dot(beam, normal), normal)


def gradient_of_normal(
    along: Vector, beam: Vector, normal: Vector, lever: Vector, length: Number
) -> Vector:
    """Gradient of a landing coordinate with respect to the facet's normal.

    lever: from the point of incidence to the apex; length: the flight to the detector.
    """
    incidence = dot(beam, normal)
    turn = combine(dot(along, normal), beam, incidence, along)
    return combine(dot(along, beam) / incidence, lever, -2 * length, turn)
