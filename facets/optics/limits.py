"""Limits of the light: a facet's edges, tip and rim and a detector's edges, as sides in the beam.

Each limit is a length that is positive where light passes, and that is linear over the beam's
cross-section, because facets and detectors are flat and the rays of a sub-beam parallel. On a facet
it counts from the edge, tip or rim to the ray's point of incidence, on a detector from its edge to
where the ray lands. So it is zero on a line, a side of `region`. For floats.
"""

from __future__ import annotations

from math import inf, log
from typing import NamedTuple

from ..scalars.dispatch import nan_unless_positive, sqrt
from .forward import Geometry, Scene
from .rays import (
    flight,
    gradient_of_mirror,
    gradient_of_normal,
    gradient_of_shift,
    hit,
    land,
    reflect,
    slant,
)
from .region import DISTANCE, NORMAL, Array
from .vectors import Plane, Vector, add, combine, cross, dot, rotate, scale, subtract

#: The column that holds the limit's kind; `region` has the other columns.
KIND, COLUMNS = 10, 11
#: The limits: a facet's first and second edge, tip and rim, and its detector's edges.
FIRST_EDGE, SECOND_EDGE, TIP, RIM, AT_MINUS_Y, AT_PLUS_Y, AT_MINUS_Z, AT_PLUS_Z = range(8)
MOST_SIDES = 8

#: A side beyond which the beam has less than exp(-FAR) of the facet's light cuts nothing: 4e-18.
NEGLIGIBLE_EXPONENT = 40.0
SMALLEST_FLOAT = 5e-324
HAIR = 1e-300


def relevant_depth(mass: float) -> float:
    """The squared distance from the beam's centre, in sigmas, beyond which light is invisible
    beside a facet's own `mass`."""
    return 2 * (NEGLIGIBLE_EXPONENT - log(max(mass, SMALLEST_FLOAT)))


def gradient_per_sigma(geometry: Geometry, origin: Vector) -> Plane:
    """A gradient with respect to a ray's origin as one over the cross-section, per sigma."""
    return dot(origin, geometry.spread[0]), dot(origin, geometry.spread[1])


def add_side(
    sides: Array, count: int, kind: int, value: float, slope: Plane, sense: float, depth: float
) -> int:
    """Write the side where value + sense slope . x = 0 if it is nearer than `depth`, and return the
    number of sides.

    value: of the limit at the beam's centre, mm.
    """
    square = slope[0] * slope[0] + slope[1] * slope[1]
    if value > 0 and value * value > depth * square:
        return count
    size = sqrt(square)
    distance = value / size
    # The centre counts as slightly inside, so that on a corner it does so for both sides.
    sides[count, DISTANCE] = distance if distance != 0 else HAIR
    sides[count, NORMAL] = -sense * slope[0] / size
    sides[count, NORMAL + 1] = -sense * slope[1] / size
    sides[count, KIND] = kind
    return count + 1


def gather_mirror(
    geometry: Geometry, at: Scene, k: int, depth: float, sides: Array, count: int
) -> int:
    """Add tip and rim if they cut."""
    tip, rim = geometry.openings.tip, geometry.openings.rim
    if tip == 0 and rim == inf:
        return count
    along = slant(outward_direction(geometry, at, k), geometry.direction, at.normals[k])
    value = dot(subtract(at.place, at.apex), along)
    slope = gradient_per_sigma(geometry, along)
    if tip > 0:
        count = add_side(sides, count, TIP, value - tip, slope, 1.0, depth)
    if rim < inf:
        count = add_side(sides, count, RIM, rim - value, slope, -1.0, depth)
    return count


def central_landing(geometry: Geometry, at: Scene, k: int) -> tuple[Vector, Plane]:
    """The direction of the beam's central ray after an unbounded facet k, and its landing point on
    detector k, mm; NaN if it never gets there."""
    beam, normal, centre, axes = (
        geometry.direction,
        at.normals[k],
        geometry.centres[k],
        geometry.axes[k],
    )
    leaving = reflect(beam, normal)
    start = hit(at.place, beam, at.apex, normal)
    length = flight(start, leaving, centre, axes)
    psi, zeta = land(start, leaving, length, centre, axes)
    clear = -dot(beam, normal), dot(leaving, axes[0]), length
    return leaving, (nan_unless_positive(psi, *clear), nan_unless_positive(zeta, *clear))


def gather_detector(
    geometry: Geometry, at: Scene, k: int, depth: float, sides: Array, count: int
) -> int:
    """Add the edges of detector k if they cut."""
    half_y, half_z = geometry.openings.halves[k]
    if half_y == inf:
        return count
    beam, normal, axes = geometry.direction, at.normals[k], geometry.axes[k]
    leaving, (psi, zeta) = central_landing(geometry, at, k)
    slope = gradient_per_sigma(
        geometry, gradient_of_shift(slant(axes[1], leaving, axes[0]), beam, normal)
    )
    count = add_side(sides, count, AT_MINUS_Y, half_y + psi, slope, 1.0, depth)
    count = add_side(sides, count, AT_PLUS_Y, half_y - psi, slope, -1.0, depth)
    slope = gradient_per_sigma(
        geometry, gradient_of_shift(slant(axes[2], leaving, axes[0]), beam, normal)
    )
    count = add_side(sides, count, AT_MINUS_Z, half_z + zeta, slope, 1.0, depth)
    return add_side(sides, count, AT_PLUS_Z, half_z - zeta, slope, -1.0, depth)


def gather_edges(geometry: Geometry, at: Scene, k: int, sides: Array, count: int) -> int:
    """Add the facet's two edges, reduced by half the gap."""
    gap = geometry.openings.gap / 2
    for kind in (FIRST_EDGE, SECOND_EDGE):
        edge, sense = (k, 1.0) if kind == FIRST_EDGE else ((k + 1) % 3, -1.0)
        ux, uy = at.sides[edge]
        distance = sense * (at.q[0] * uy - at.q[1] * ux)
        if gap > 0:
            slope = gradient_per_sigma(
                geometry,
                slant(limit_direction(geometry, at, k, kind), geometry.direction, at.normals[k]),
            )
            distance -= gap / sqrt(slope[0] * slope[0] + slope[1] * slope[1])
        sides[count, DISTANCE] = distance if distance != 0 else HAIR
        sides[count, NORMAL], sides[count, NORMAL + 1] = sense * uy, -sense * ux
        sides[count, KIND] = kind
        count += 1
    return count


def outward_direction(geometry: Geometry, at: Scene, k: int) -> Vector:
    """The direction perpendicular to the mirror's axis in which facet k faces."""
    x, y, z = geometry.normals[k]
    size = sqrt(x * x + y * y)
    return rotate(at.turn, (x / size, y / size, z * 0))


def limit_direction(geometry: Geometry, at: Scene, k: int, kind: int) -> Vector:
    """The direction along which a limit on facet k is measured; a unit vector that turns with the
    facet."""
    if kind == FIRST_EDGE:
        edge = at.edges[k]
        return scale(1 / sqrt(dot(edge, edge)), cross(at.normals[k], edge))
    if kind == SECOND_EDGE:
        edge = at.edges[(k + 1) % 3]
        return scale(1 / sqrt(dot(edge, edge)), cross(edge, at.normals[k]))
    return scale(1.0 if kind == TIP else -1.0, outward_direction(geometry, at, k))


class Limit(NamedTuple):
    """The gradients of one limit.

    along: its gradient with respect to the point on the facet, or to the spot, slanted along the
    ray.  origin: with respect to the ray's origin.  apex: with respect to the apex.
    size: its gradient in the beam's cross-section, mm a sigma.
    on_facet: whether it lies on the mirror, else on a detector.
    """

    along: Vector
    origin: Vector
    apex: Vector
    size: float
    on_facet: bool


def limit(geometry: Geometry, at: Scene, k: int, kind: int) -> Limit:
    beam, normal, axes = geometry.direction, at.normals[k], geometry.axes[k]
    on_facet = kind <= RIM
    if on_facet:
        along = slant(limit_direction(geometry, at, k, kind), beam, normal)
        origin, apex = along, scale(-1.0, along)
    else:
        axis = axes[1] if kind <= AT_PLUS_Y else axes[2]
        sense = 1.0 if kind in (AT_MINUS_Y, AT_MINUS_Z) else -1.0
        along = scale(sense, slant(axis, reflect(beam, normal), axes[0]))
        origin = gradient_of_shift(along, beam, normal)
        apex = gradient_of_mirror(along, beam, normal)
    slope = gradient_per_sigma(geometry, origin)
    size = sqrt(slope[0] * slope[0] + slope[1] * slope[1])
    return Limit(along, origin, apex, size, on_facet)


def limit_turn_gradient(geometry: Geometry, at: Scene, k: int, of: Limit, x: Plane) -> Vector:
    """The gradient of a limit with respect to a turn of the mirror, at the ray through x."""
    beam, normal = geometry.direction, at.normals[k]
    offset = combine(x[0], geometry.spread[0], x[1], geometry.spread[1])
    start = hit(add(at.place, offset), beam, at.apex, normal)
    if of.on_facet:
        return cross(of.along, subtract(start, at.apex))
    length = flight(start, reflect(beam, normal), geometry.centres[k], geometry.axes[k])
    lever = subtract(at.apex, start)
    return cross(normal, gradient_of_normal(of.along, beam, normal, lever, length))
