"""Light and derivatives of one sub-beam that is cut by its `limits` or the beam's aperture.

The derivatives of a cut spot's power and centroid follow from the speeds of the outline's sides: a
side that moves outward at v sweeps v f ds of light over itself, and v is linear along the side. For
floats.
"""

from __future__ import annotations

from math import inf, nan
from typing import Any, NamedTuple

from .forward import Geometry, Path, Scene, Three, path, reading
from .limits import (
    KIND,
    NEGLIGIBLE_EXPONENT,
    Limit,
    gather_detector,
    gather_edges,
    gather_mirror,
    gradient_per_sigma,
    limit,
    limit_turn_gradient,
    relevant_depth,
)
from .rays import gradient_of_mirror, gradient_of_normal, gradient_of_shift, slant
from .region import DIM, DISTANCE, FIRST, LENGTH, NORMAL, SECOND, Array, measure_sides, region_light
from .vectors import Matrix, Vector, add, combine, cross, dot, scale, subtract


def is_always_cut(geometry: Geometry) -> bool:
    """Whether every sub-beam is cut at every state, so that the uncut light is not needed."""
    openings = geometry.openings
    return openings.gap > 0 or openings.radius * openings.radius < 2 * NEGLIGIBLE_EXPONENT


def passing_light(geometry: Geometry, at: Scene, k: int, sides: Array) -> tuple[int, Any]:
    """The light from facet k that reaches its detector: the number of `sides` that cut it, and its
    moments.

    at: with the uncut light, unless `is_always_cut`. sides: (limits.MOST, limits.COLUMNS), filled.
    If no visible light is cut, the number is 0 and the moments are those of the scene; otherwise
    only mass and centroid are computed.
    """
    openings = geometry.openings
    depth = relevant_depth(DIM if is_always_cut(geometry) else at.moments[k][0])
    radius = openings.radius if openings.radius * openings.radius < depth else inf
    count = gather_mirror(geometry, at, k, depth, sides, 0)
    count = gather_detector(geometry, at, k, depth, sides, count)
    if count == 0 and radius == inf and openings.gap == 0:
        return 0, at.moments[k]
    count = gather_edges(geometry, at, k, sides, count)
    measure_sides(sides, count, radius)
    mass, centroid = region_light(sides, count, radius)
    return count, (mass, centroid, (nan, nan, nan), (nan, nan))


class Response(NamedTuple):
    """The derivatives of a reading by a motion of the apex, a rotation of the mirror, and a motion
    of the beam."""

    apex: Vector
    turn: Vector
    place: Vector


def response_of_landing(
    geometry: Geometry, at: Scene, k: int, ray: Path, along: Vector
) -> Response:
    """The response of the landing coordinate with the slanted axis `along`, at a constant centroid
    in the beam."""
    beam, normal = geometry.direction, at.normals[k]
    lever = subtract(at.apex, ray.start)
    of_normal = gradient_of_normal(along, beam, normal, lever, ray.length)
    return Response(
        gradient_of_mirror(along, beam, normal),
        cross(normal, of_normal),
        gradient_of_shift(along, beam, normal),
    )


def add_side_response(
    answer: Response, of: Limit, turns: tuple[Vector, Vector], zeroth: float, first: float
) -> Response:
    """`answer` and what the advance of one side adds.

    turns: the limit's answer to a turn at s = 0, and how much more at s = 1.
    zeroth, first: integrals of w f and w s f along the side, w being what the light there counts.
    """
    return Response(
        add(answer.apex, scale(zeroth / of.size, of.apex)),
        add(answer.turn, combine(zeroth / of.size, turns[0], first / of.size, turns[1])),
        add(answer.place, scale(zeroth / of.size, of.origin)),
    )


def state_row(answer: Response, axes: Matrix) -> tuple[Any, ...]:
    apex, turn, place = answer
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


def linearise_cut(
    geometry: Geometry, at: Scene, k: int, sides: Array, count: int, axes: Matrix
) -> tuple[Three, Three]:
    """(psi, zeta, power) of detector k, and the eight derivatives of each.

    at: with the light as cut.  sides, count: from `passing_light`.
    axes: the world axes of roll, pitch and yaw.
    """
    ray = path(geometry, at, k)
    mass, centroid, _, _ = at.moments[k]
    x, y, z = geometry.axes[k]
    nothing = (0.0, 0.0, 0.0)
    psi = response_of_landing(geometry, at, k, ray, slant(y, ray.leaving, x))
    zeta = response_of_landing(geometry, at, k, ray, slant(z, ray.leaving, x))
    power = Response(nothing, nothing, nothing)
    to_psi, to_zeta = (
        gradient_per_sigma(geometry, psi.place),
        gradient_per_sigma(geometry, zeta.place),
    )
    for j in range(count):
        length, first, second = sides[j, LENGTH], sides[j, FIRST], sides[j, SECOND]
        if length == 0:
            continue
        of = limit(geometry, at, k, int(sides[j, KIND]))
        nx, ny, distance = sides[j, NORMAL], sides[j, NORMAL + 1], sides[j, DISTANCE]
        foot = limit_turn_gradient(geometry, at, k, of, (distance * nx, distance * ny))
        on = limit_turn_gradient(geometry, at, k, of, (distance * nx - ny, distance * ny + nx))
        turns = foot, subtract(on, foot)
        dx, dy = distance * nx - centroid[0], distance * ny - centroid[1]
        # The weight of light at s in the centroid is even + rise s.
        even = (to_psi[0] * dx + to_psi[1] * dy) / mass
        rise = (to_psi[1] * nx - to_psi[0] * ny) / mass
        psi = add_side_response(
            psi, of, turns, even * length + rise * first, even * first + rise * second
        )
        even = (to_zeta[0] * dx + to_zeta[1] * dy) / mass
        rise = (to_zeta[1] * nx - to_zeta[0] * ny) / mass
        zeta = add_side_response(
            zeta, of, turns, even * length + rise * first, even * first + rise * second
        )
        power = add_side_response(power, of, turns, geometry.power * length, geometry.power * first)
    return reading(geometry, at, k, ray), (
        state_row(psi, axes),
        state_row(zeta, axes),
        state_row(power, axes),
    )
