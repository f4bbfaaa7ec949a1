"""The derivatives of the readings, closed, beside the readings themselves.

Each reading has a few raw gradients (`Gradient`): by the ray, the facet, the apex seen along the
beam, and the angles of the facet's two edges. The derivatives with respect to the state
(`linearise`) and to the parameters (`parameters.linearise`) are dot products with these. A small
turn of a vector v about an axis w is w x v, so a gradient g with respect to v contributes (v x g) .
w.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ..scalars.dispatch import Number
from .forward import Geometry, Path, Scene, Three, path, project_to_sigmas, reading, scene
from .rays import gradient_of_mirror, gradient_of_normal, gradient_of_shift, slant
from .vectors import Matrix, Plane, Vector, add, combine, cross, dot, rotation_axes, subtract
from .wedge import turn_derivative


class Gradient(NamedTuple):
    """The gradients of one reading.

    mirror, normal: with respect to the apex and the facet's normal, at a constant ray.  origin:
    with respect to the ray's origin.  centroid: with respect to the centroid in the beam, in
    sigmas.  q: with respect to the apex seen along the beam, in sigmas, the ray following the
    centroid.  first, second: with respect to the angles of the edges where the facet begins and
    ends, the ray following the centroid.
    """

    mirror: Vector
    normal: Vector
    origin: Vector
    centroid: Plane
    q: Plane
    first: Number
    second: Number


def landing_gradient(
    geometry: Geometry, at: Scene, k: int, ray: Path, along: Vector, first: Plane, second: Plane
) -> Gradient:
    """The gradient of the landing coordinate of detector k with the slanted axis `along`.

    first, second: the centroid's derivatives with respect to the angles of the facet's edges.
    """
    beam, normal = geometry.direction, at.normals[k]
    lever = subtract(at.apex, ray.start)
    shift = at.moments[k][2]
    origin = gradient_of_shift(along, beam, normal)
    x, y = dot(origin, geometry.spread[0]), dot(origin, geometry.spread[1])
    return Gradient(
        mirror=gradient_of_mirror(along, beam, normal),
        normal=gradient_of_normal(along, beam, normal, lever, ray.length),
        origin=origin,
        centroid=(x, y),
        q=(shift[0] * x + shift[1] * y, shift[1] * x + shift[2] * y),
        first=first[0] * x + first[1] * y,
        second=second[0] * x + second[1] * y,
    )


def power_gradient(
    geometry: Geometry, at: Scene, k: int, first: Number, second: Number
) -> Gradient:
    """The gradient of the power of detector k. first, second: the mass's derivatives, as above."""
    mass, centroid, _, _ = at.moments[k]
    zero = mass * 0
    nothing = (zero, zero, zero)
    power = geometry.power
    return Gradient(
        mirror=nothing,
        normal=nothing,
        origin=nothing,
        centroid=(zero, zero),
        q=(-power * mass * centroid[0], -power * mass * centroid[1]),
        first=power * first,
        second=power * second,
    )


def gradients(
    geometry: Geometry, at: Scene, k: int, ray: Path
) -> tuple[Gradient, Gradient, Gradient]:
    """The gradients of psi, zeta and power of detector k."""
    following = (k + 1) % 3
    mass, _, _, from_point = at.moments[k]
    mass1, (x1, y1) = turn_derivative(at.sides[k], at.integrals[k], mass, from_point)
    mass2, second = turn_derivative(at.sides[following], at.integrals[following], mass, from_point)
    first = (-x1, -y1)  # Turning the first edge counter-clockwise narrows the facet.
    x, y, z = geometry.axes[k]
    along_y, along_z = slant(y, ray.leaving, x), slant(z, ray.leaving, x)
    return (
        landing_gradient(geometry, at, k, ray, along_y, first, second),
        landing_gradient(geometry, at, k, ray, along_z, first, second),
        power_gradient(geometry, at, k, -mass1, mass2),
    )


def gradient_of_angle(geometry: Geometry, edge: Vector) -> Vector:
    """Convert a gradient with respect to an edge's angle, seen along the beam in sigmas, to one
    with respect to the edge."""
    x, y = project_to_sigmas(geometry, edge)
    square = x * x + y * y
    return combine(x / square, geometry.whitening[1], -y / square, geometry.whitening[0])


def gradient_in_world(geometry: Geometry, gradient: Plane) -> Vector:
    """Convert a gradient with respect to a place in sigmas to one with respect to the place in
    mm."""
    return combine(gradient[0], geometry.whitening[0], gradient[1], geometry.whitening[1])


def state_row(
    geometry: Geometry,
    gradient: Gradient,
    normal: Vector,
    turns: tuple[Vector, Vector],
    axes: Matrix,
) -> tuple[Any, ...]:
    """One reading's derivatives with respect to the eight components of the state.

    turns: derivatives of the angles of the facet's two edges by a rotation of the mirror. axes: the
    world axes of roll, pitch and yaw.
    """
    seen = gradient_in_world(geometry, gradient.q)
    apex = add(gradient.mirror, seen)
    place = subtract(gradient.origin, seen)
    of_edges = combine(gradient.first, turns[0], gradient.second, turns[1])
    turn = add(cross(normal, gradient.normal), of_edges)
    return (
        apex[0],
        apex[1],
        apex[2],
        dot(turn, axes[0]),
        dot(turn, axes[1]),
        dot(turn, axes[2]),
        place[0],
        place[1],
    )


def edge_turns(geometry: Geometry, at: Scene) -> tuple[Vector, Vector, Vector]:
    """The derivative of the angle of each edge, seen along the beam, by a rotation of the
    mirror."""
    return (
        cross(at.edges[0], gradient_of_angle(geometry, at.edges[0])),
        cross(at.edges[1], gradient_of_angle(geometry, at.edges[1])),
        cross(at.edges[2], gradient_of_angle(geometry, at.edges[2])),
    )


def linearise_detector(
    geometry: Geometry, at: Scene, k: int, turns: tuple[Vector, Vector, Vector], axes: Matrix
) -> tuple[Three, Three]:
    """Return (psi, zeta, power) of detector k and the eight derivatives of each.

    turns: from `edge_turns`.  axes: the world axes of roll, pitch and yaw.
    """
    ray = path(geometry, at, k)
    of_psi, of_zeta, of_power = gradients(geometry, at, k, ray)
    normal, own = at.normals[k], (turns[k], turns[(k + 1) % 3])
    return reading(geometry, at, k, ray), (
        state_row(geometry, of_psi, normal, own, axes),
        state_row(geometry, of_zeta, normal, own, axes),
        state_row(geometry, of_power, normal, own, axes),
    )


def linearise(
    geometry: Geometry, state: tuple[Any, ...]
) -> tuple[tuple[Three, Three], tuple[Three, Three], tuple[Three, Three]]:
    """Readings and Jacobian at a state, for detectors A, B and C, nothing cut.

    Each is ((psi, zeta, power), (eight derivatives of each)); mm, mW, rad. NaN as in `reading`.
    """
    at = scene(geometry, state)
    axes = rotation_axes(state[4], state[5])
    turns = edge_turns(geometry, at)
    return (
        linearise_detector(geometry, at, 0, turns, axes),
        linearise_detector(geometry, at, 1, turns, axes),
        linearise_detector(geometry, at, 2, turns, axes),
    )
