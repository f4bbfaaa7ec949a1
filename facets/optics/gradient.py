"""The readings with their derivatives by the state, in closed form.

Each reading has a few raw gradients (`Gradient`): with respect to the ray, the facet, the apex as
seen along the beam, and the angles of the facet's two edges. The derivatives with respect to the
state (`linearise`) are dot products with these. A small turn of a vector v about an axis w changes
v by w x v, so that a gradient g with respect to v contributes (v x g) . w.

Readings and states are in the units of `forward`: derivatives are in mm and mW per mm and rad.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ..scalars.dispatch import Number
from .forward import (
    Geometry,
    LitFacet,
    Path,
    Scene,
    Three,
    mirror_facets,
    path,
    project_to_sigmas,
    reading,
    scene,
)
from .rays import gradient_of_mirror, gradient_of_normal, gradient_of_shift, slant
from .vectors import Matrix, Plane, Vector, add, combine, cross, dot, rotation_axes, subtract
from .wedge import turn_derivative


class Gradient(NamedTuple):
    """The gradients of one reading.

    mirror, normal: with respect to the apex and the facet's normal, at a constant ray.  origin:
    with respect to the ray's origin.  centroid: with respect to the centroid in the beam, per
    sigma.  q: with respect to the apex seen along the beam, per sigma, where the ray follows the
    centroid.  first, second: with respect to the angles of the edges at which the facet begins and
    ends, where the ray follows the centroid.
    """

    mirror: Vector
    normal: Vector
    origin: Vector
    centroid: Plane
    q: Plane
    first: Number
    second: Number


def landing_gradient(
    facet: LitFacet, ray: Path, along: Vector, first: Plane, second: Plane
) -> Gradient:
    """The gradient of the landing coordinate with the slanted axis `along`.

    first, second: the centroid's derivatives with respect to the angles of the facet's edges.
    """
    beam, normal, spread = facet.geometry.direction, facet.normal, facet.geometry.spread
    lever = subtract(facet.at.apex, ray.start)
    shift = facet.moments[2]
    origin = gradient_of_shift(along, beam, normal)
    x, y = dot(origin, spread[0]), dot(origin, spread[1])
    return Gradient(
        mirror=gradient_of_mirror(along, beam, normal),
        normal=gradient_of_normal(along, beam, normal, lever, ray.length),
        origin=origin,
        centroid=(x, y),
        q=(shift[0] * x + shift[1] * y, shift[1] * x + shift[2] * y),
        first=first[0] * x + first[1] * y,
        second=second[0] * x + second[1] * y,
    )


def power_gradient(facet: LitFacet, first: Number, second: Number) -> Gradient:
    """The gradient of a detector's power.

    first, second: the mass's derivatives with respect to the angles of the facet's edges.
    """
    mass, centroid, _, _ = facet.moments
    zero = mass * 0
    nothing = (zero, zero, zero)
    power = facet.geometry.power
    return Gradient(
        mirror=nothing,
        normal=nothing,
        origin=nothing,
        centroid=(zero, zero),
        q=(-power * mass * centroid[0], -power * mass * centroid[1]),
        first=power * first,
        second=power * second,
    )


def gradients(facet: LitFacet, ray: Path) -> tuple[Gradient, Gradient, Gradient]:
    """The gradients of psi, zeta and power of a facet's detector."""
    mass, _, _, from_point = facet.moments
    mass1, (x1, y1) = turn_derivative(facet.sides[0], facet.integrals[0], mass, from_point)
    mass2, second = turn_derivative(facet.sides[1], facet.integrals[1], mass, from_point)
    first = (-x1, -y1)  # Turning the first edge counter-clockwise narrows the facet.
    x, y, z = facet.axes
    along_y, along_z = slant(y, ray.leaving, x), slant(z, ray.leaving, x)
    return (
        landing_gradient(facet, ray, along_y, first, second),
        landing_gradient(facet, ray, along_z, first, second),
        power_gradient(facet, -mass1, mass2),
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


def state_row(facet: LitFacet, gradient: Gradient, turns: Three, axes: Matrix) -> tuple[Any, ...]:
    """One reading's derivatives with respect to the eight components of the state of Eq. (3).

    turns: from `edge_turns`.  axes: the world axes of roll, pitch and yaw.
    """
    begin, end = turns[facet.k], turns[(facet.k + 1) % 3]
    of_q = gradient_in_world(facet.geometry, gradient.q)
    apex = add(gradient.mirror, of_q)
    place = subtract(gradient.origin, of_q)
    of_edges = combine(gradient.first, begin, gradient.second, end)
    turn = add(cross(facet.normal, gradient.normal), of_edges)
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


def edge_turns(geometry: Geometry, at: Scene) -> Three:
    """The derivative of the angle of each edge, as seen along the beam, by a rotation of the
    mirror."""
    return (
        cross(at.edges[0], gradient_of_angle(geometry, at.edges[0])),
        cross(at.edges[1], gradient_of_angle(geometry, at.edges[1])),
        cross(at.edges[2], gradient_of_angle(geometry, at.edges[2])),
    )


def linearise_detector(facet: LitFacet, turns: Three, axes: Matrix) -> tuple[Three, Three]:
    """Return (psi, zeta, power) of a facet's detector and the eight derivatives of each.

    turns: from `edge_turns`.  axes: the world axes of roll, pitch and yaw.
    """
    ray = path(facet)
    of_psi, of_zeta, of_power = gradients(facet, ray)
    return reading(facet, ray), (
        state_row(facet, of_psi, turns, axes),
        state_row(facet, of_zeta, turns, axes),
        state_row(facet, of_power, turns, axes),
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
    a, b, c = mirror_facets(geometry, at)
    return (
        linearise_detector(a, turns, axes),
        linearise_detector(b, turns, axes),
        linearise_detector(c, turns, axes),
    )
