"""Enclosures of the facets' shares in the beam, and of the light's motion at fixed shares.

Seen along the beam, the mirror's edges are three half-lines from the apex q, along unit vectors u_e
with angles theta_e; lengths are in units of the beam's sigma. In a small change, edge e sweeps over
the light s_e = L_e (u_e x dq) + K_e dtheta_e, and facet k gains s_(k+1) - s_k. So the shares are
constant if and only if s_0 = s_1 = s_2 = s. With rho = K / L, and weights alpha_e > 0 such that sum
alpha_e u_e = 0,

    s = sum alpha_e rho_e dtheta_e / sum (alpha_e / L_e),    u_e x dq = s / L_e - rho_e dtheta_e.

The centroid c of a facet's light moves by dc = (1 - S) dq plus the effect of the turning edges.
Here S, the covariance of a normal distribution restricted to a convex set, lies between 0 and 1
(Brascamp & Lieb). All of this needs only exp and erfc for each edge. docs/uniqueness.md has the
theorem that uses it.

Offsets q and unit vectors u are intervals (2,), angles are in rad, and the light on a facet or
along an edge is a fraction of the beam's.
"""

from __future__ import annotations

from itertools import product
from typing import Any, NamedTuple

import numpy as np
from flint import arb

from ..optics.forward import Geometry, Scene, project_to_sigmas
from ..optics.gradient import edge_turns
from ..optics.vectors import Vector, dot
from ..scalars.intervals import Interval, ends, interval, magnitude, nonnegative_product, square
from .interval_matrix import UNION, Intervals, hull_of_arrays

#: Number of slices of each facet's angle, and the further slices for each square sigma of the
#: apex's offset, since the light on the slices then differs more.
SLICES, SLICES_PER_SQUARE_SIGMA = 6, 5
#: A box of offsets is quartered until the lower bound of each share is at least this fraction of
#: the upper one, but at most this many times.
SHARP_FRACTION, MAX_QUARTERINGS = 0.25, 6
#: The largest distance of the apex that is searched, sigmas: beyond, one facet has almost no light.
FARTHEST_SIGMAS = 8.0


class LightNotShared(Exception):
    """Raised if a facet may span half a turn or more, or have no light, somewhere in the box."""


class SharingBounds(NamedTuple):
    """Bounds over a box of rotations, for all offsets at which each facet has enough light.

    from_point: (3, 2) the centroid of each facet's light less the apex, sigmas.  turns: (3, 2, 3)
    the derivative of `from_point` by roll, pitch and yaw at fixed shares, sigmas per rad.  slope:
    the determinant of the derivatives of two shares by the apex's offset, per square sigma.
    """

    from_point: Intervals
    turns: Intervals
    slope: Interval


class HalfLine(NamedTuple):
    """A half-line over a small box: its direction u, its light L, rho = K / L, eta = J / K."""

    u: Intervals
    light: Interval
    mean: Interval
    reach: Interval


class FacetLight(NamedTuple):
    """Fraction of the beam on a facet, and the centroid (2,) of its light less the apex, sigmas."""

    mass: Interval
    from_point: Intervals


def cross_product(u: Intervals, v: Intervals) -> Interval:
    """The cross product of two vectors (2,) of the plane."""
    return u[0] * v[1] - u[1] * v[0]


#: Intervals that contain sqrt(2), sqrt(2 / pi) and sqrt(8 pi).
ROOT_2, ROOT_2_OVER_PI, ROOT_8_PI = arb(2).sqrt(), (2 / arb.pi()).sqrt(), (8 * arb.pi()).sqrt()


def means_along(a: Interval) -> tuple[Interval, Interval, Interval]:
    """erfc(a / sqrt 2), and rho = K / L and eta = J / K on a half-line; all decrease with a."""
    beyond = (a / ROOT_2).erfc()
    mean = ROOT_2_OVER_PI * (-a * a / 2).exp() / beyond - a
    return beyond, mean, 1 / mean - a


def half_line(q: Intervals, u: Intervals) -> HalfLine:
    """The half-line from q along u.

    Both means decrease with a: a larger a weighs light by a factor that falls with distance.
    """
    a: Interval = q @ u
    beyond, mean, reach = UNION(means_along(a.upper()), means_along(a.lower()))
    light = nonnegative_product((-square(cross_product(q, u)) / 2).exp(), beyond) / ROOT_8_PI
    return HalfLine(u, light, mean, reach)


class FacetEdges(NamedTuple):
    """The edges over a box of rotations: their angles, the openings between them, and the
    derivatives of the angles by roll, pitch and yaw."""

    angles: list[Interval]
    openings: list[Interval]
    turns: Intervals


def facet_edges(geometry: Geometry, at: Scene, axes: Any) -> FacetEdges:
    """Return the edges.  at, axes: mirror and axes of rotation in the box. Raises
    `LightNotShared`."""
    angles = [edge_angle(geometry, edge) for edge in at.edges]
    openings = [opening(angles[k], angles[(k + 1) % 3]) for k in range(3)]
    if not all(0 < part < arb.pi() for part in openings):
        raise LightNotShared
    turns = [[dot(turn, axis) for axis in axes] for turn in edge_turns(geometry, at)]
    return FacetEdges(angles, openings, np.array(turns))


def bounds_at_fixed_shares(edges: FacetEdges, least_share: float) -> SharingBounds:
    """Bounds for all offsets at which each facet has at least this fraction of the light."""
    distance = farthest_offset(edges, least_share)
    pieces: list[SharingBounds] = []
    todo = [(np.array([interval(-distance, distance)] * 2), 0)]
    while todo:
        q, depth = todo.pop()
        lights = light_on_facets(edges, q, least_share)
        if len(lights) < 3:
            continue
        if depth == MAX_QUARTERINGS or are_sharp(lights):
            pieces.append(
                bounds_near(edges, [limit_light(light, least_share) for light in lights], q)
            )
        else:
            todo += [(part, depth + 1) for part in quarters(q)]
    return hull_of_bounds(pieces)


def light_on_facets(edges: FacetEdges, q: Intervals, least_share: float = 0.0) -> list[FacetLight]:
    """The light on the facets over a box of offsets, up to the first facet that has less than the
    least fraction."""
    lights = []
    for angle, opening in zip(edges.angles, edges.openings, strict=True):
        light = light_between(q, angle, opening)
        if light.mass.upper() < least_share:
            break
        lights.append(light)
    return lights


def are_sharp(lights: list[FacetLight]) -> bool:
    """Whether the bounds of all shares are so close that a box needs no quartering."""
    return all(light.mass.lower() > SHARP_FRACTION * light.mass.upper() for light in lights)


def limit_light(light: FacetLight, least_share: float) -> FacetLight:
    """Narrow the bounds of a facet's light by the fact that it has at least this fraction."""
    low = max(light.mass.lower(), arb(least_share))
    return FacetLight(low.union(light.mass.upper()), light.from_point)


def farthest_offset(edges: FacetEdges, least_share: float) -> float:
    """A distance of the apex from the beam's centre, in sigmas, beyond which some facet has less
    than this fraction of the light.

    Raises `LightNotShared` if that distance exceeds `FARTHEST_SIGMAS`.
    """
    if not share_beyond(edges, FARTHEST_SIGMAS) < least_share:
        raise LightNotShared
    near, far = 0.0, FARTHEST_SIGMAS
    while far - near > 0.01:
        middle = (near + far) / 2
        near, far = (near, middle) if share_beyond(edges, middle) < least_share else (middle, far)
    return far


def share_beyond(edges: FacetEdges, distance: float) -> Interval:
    """An upper bound of the least share if the apex is further away than `distance`, in sigmas.

    The direction of the offset lies in some facet. That facet is a convex set. Its distance from
    the beam's centre is at least the offset times the sine of its opening. So it has no more light
    than a half-plane at that distance.
    """
    sines = [least_sine(part) for part in edges.openings]
    shares = [(distance * sine / ROOT_2).erfc() / 2 for sine in sines]
    return max(bound.upper() for bound in shares)


def least_sine(opening: Interval) -> Interval:
    """A bound of the least sine between a right angle and the opening; 1 for an acute opening."""
    right = arb.pi() / 2
    return arb(1) if opening <= right else opening.upper().sin()


def least_share_over(edges: FacetEdges, q: Intervals, depth: int = 0) -> float:
    """A lower bound, 0 if none is found, of the three shares over a box of offsets."""
    lights = light_on_facets(edges, q)
    if are_sharp(lights):
        return min(ends(light.mass)[0] for light in lights)
    if depth == MAX_QUARTERINGS:
        return 0.0
    return min(least_share_over(edges, part, depth + 1) for part in quarters(q))


def hull_of_bounds(pieces: list[SharingBounds]) -> SharingBounds:
    """Return the hull of the bounds of several boxes. Raises `LightNotShared` if there are none."""
    if not pieces:
        raise LightNotShared
    return SharingBounds(*map(hull_of_arrays, zip(*pieces, strict=True)))


def edge_angle(geometry: Geometry, edge: Vector) -> Interval:
    """The angle of an edge, seen along the beam, from its middle, rad: never near half a turn."""
    x, y = project_to_sigmas(geometry, edge)
    c, s = x.mid(), y.mid()
    return arb.atan2(s, c) + arb.atan2(c * y - s * x, c * x + s * y)


def direction_at(angle: Interval) -> Intervals:
    """The unit vector (2,) at an angle, rad."""
    return np.array([angle.cos(), angle.sin()])


def halve_interval(side: Interval) -> list[Interval]:
    """The halves of an interval, which share its midpoint."""
    low, high = ends(side)
    middle = (low + high) / 2
    return [interval(low, middle), interval(middle, high)]


def quarters(q: Intervals) -> list[Intervals]:
    """The four quarters, each (2,), of a box (2,) of offsets in sigmas."""
    return [np.array(part) for part in product(*map(halve_interval, q))]


def opening(first: Interval, second: Interval) -> Interval:
    """The angle from the first edge to the second, rad, counter-clockwise, between 0 and one
    turn."""
    turns = ((second - first) / (2 * arb.pi())).mid().floor()
    return second - first - 2 * arb.pi() * turns


def offset_moves(edges: FacetEdges, sides: list[HalfLine], alpha: list[Interval]) -> Intervals:
    """The change dq (2, 3) with the three angles at fixed shares.  alpha: weights of the edges."""
    resistance = sum(alpha[e] / sides[e].light for e in range(3))
    swept = sum(alpha[e] * sides[e].mean * edges.turns[e] for e in range(3)) / resistance
    first, second = (swept / sides[e].light - sides[e].mean * edges.turns[e] for e in range(2))
    u, v = sides[0].u, sides[1].u
    moves: Intervals = (np.outer(first, v) - np.outer(second, u)).T / cross_product(u, v)
    return moves


def bounds_near(edges: FacetEdges, lights: list[FacetLight], q: Intervals) -> SharingBounds:
    """The bounds of `bounds_at_fixed_shares` for a small box of q."""
    u = [direction_at(angle) for angle in edges.angles]
    sides = [half_line(q, side) for side in u]
    alpha = [cross_product(u[e - 2], u[e - 1]) for e in range(3)]
    dq = offset_moves(edges, sides, alpha)
    moved = [centroid_moves(dq, sides, lights[k], edges.turns, k) for k in range(3)]
    on = [side.light for side in sides]
    slope = sum(
        nonnegative_product(nonnegative_product(on[e], on[e - 1]), cross_product(u[e - 1], u[e]))
        for e in range(3)
    )
    return SharingBounds(np.array([light.from_point for light in lights]), np.array(moved), slope)


def light_between(q: Intervals, start: Interval, opening: Interval) -> FacetLight:
    """The light of a facet, by slices of its angle: light per angle is K, mean distance J / K."""
    mass, moment = arb(0), np.array([arb(0), arb(0)])
    slices = SLICES + int(SLICES_PER_SQUARE_SIGMA * (magnitude(q[0]) ** 2 + magnitude(q[1]) ** 2))
    for n in range(slices):
        ray = half_line(
            q, direction_at(start + opening * interval(arb(n) / slices, arb(n + 1) / slices))
        )
        light = nonnegative_product(ray.light, ray.mean)
        mass += light
        moment = moment + light * ray.reach * ray.u
    return FacetLight(mass * opening / slices, moment / mass)


def centroid_moves(
    dq: Intervals, sides: list[HalfLine], light: FacetLight, turns: Intervals, k: int
) -> Intervals:
    """The derivative of the centroid of facet k less the apex by the three angles: (2, 3)."""
    next_ = (k + 1) % 3
    by_first, by_second = (
        side.light * side.mean * (side.reach * side.u - light.from_point)
        for side in (sides[k], sides[next_])
    )
    turned = np.outer(by_second, turns[next_]) - np.outer(by_first, turns[k])
    lengths = [(arb(magnitude(x)) ** 2 + arb(magnitude(y)) ** 2).sqrt() for x, y in dq.T]
    within = np.array([interval(-length, length) for length in lengths]) / 2
    moves: Intervals = turned / light.mass - dq / 2 + within
    return moves
