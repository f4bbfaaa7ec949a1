"""How the three facets share the beam, in intervals: what moves when the shares are held.

Seen along the beam, the mirror's edges are a fan of three half-lines from the apex q, along unit
vectors u_e with angles theta_e; units of the beam's sigma. A small change sweeps over edge e the
light s_e = L_e (u_e x dq) + K_e dtheta_e, and facet k gains s_(k+1) - s_k. So the shares are held
exactly when s_0 = s_1 = s_2 = s. With rho = K / L, and weights alpha_e > 0 such that
sum alpha_e u_e = 0,

    s = sum alpha_e rho_e dtheta_e / sum (alpha_e / L_e),    u_e x dq = s / L_e - rho_e dtheta_e.

The light's centroid c on a facet moves by dc = (1 - S) dq + turning of the edges, where S, the
covariance of a normal distribution cut to a convex set, lies between 0 and 1 (Brascamp & Lieb). All
of this takes but exp and erfc of each edge. docs/uniqueness.md has the theorem it serves.
"""

from __future__ import annotations

from itertools import product
from typing import Any, NamedTuple

from flint import arb

from ..optics.forward import Geometry, Scene, in_sigmas
from ..optics.gradient import turns_of_edges
from ..optics.vectors import Vector, dot
from ..scalars.intervals import Ball, between, ends, hull, magnitude, monotone, positive, square

Plane = tuple[Ball, Ball]

#: Into how many slices each facet's angle is cut, and more for each square sigma that the apex is
#: off, since the light on them then differs more.
SLICES, MORE = 6, 5
#: A box of offsets is quartered until the lower bounds of its shares are this part of the upper
#: ones, at most so many times.
SHARP, DEPTH = 0.25, 8
#: How far off the apex is looked for, sigmas: beyond, one facet has next to no light.
FARTHEST = 8.0


class NotAFan(Exception):
    """The facets, as seen somewhere in the box, are not three wedges of less than half a turn."""


class Shares(NamedTuple):
    """What holds over a box of rotations, wherever each facet has its least share of the light.

    from_point: of each facet, the centroid of its light less the apex (3, 2), sigmas.
    turns: of each facet, how that changes with roll, pitch and yaw (3, 2, 3), sigmas per rad, the
    shares being held.  offset: of the apex from the beam's centre (2,), sigmas.
    slope: the determinant of two shares by the offset, per square sigma.
    """

    from_point: list[list[Ball]]
    turns: list[list[list[Ball]]]
    offset: list[Ball]
    slope: Ball


class Edge(NamedTuple):
    """One edge of the fan over a small box: u, and of its light L, rho = K / L, eta = J / K."""

    u: Plane
    light: Ball
    mean: Ball
    reach: Ball


class Light(NamedTuple):
    """Of a facet: its share of the beam, and its centroid less the apex, sigmas."""

    mass: Ball
    from_point: Plane


def times(u: Plane, v: Plane) -> Ball:
    """The cross product of two vectors of the plane."""
    return u[0] * v[1] - u[1] * v[0]


def mean_along(a: Ball) -> Ball:
    """rho: the mean distance from the apex of the light on a half-line; falls with a."""
    two = arb(2)
    return (two / arb.pi()).sqrt() * (-a * a / 2).exp() / (a / two.sqrt()).erfc() - a


def edge_of(q: Plane, u: Plane) -> Edge:
    """Both means fall with a: a larger a weighs the light by a factor that falls with distance."""
    a, h = q[0] * u[0] + q[1] * u[1], q[0] * u[1] - q[1] * u[0]
    across = (-square(h) / 2).exp()
    beyond = monotone(lambda x: (x / arb(2).sqrt()).erfc(), a)
    light = positive(across, beyond) / (8 * arb.pi()).sqrt()
    reach = monotone(lambda x: 1 / mean_along(x) - x, a)
    return Edge(u, light, monotone(mean_along, a), reach)


class Fan(NamedTuple):
    """The edges over a box of rotations: their angles, what lies between them, and how each turns
    with roll, pitch and yaw."""

    angles: list[Ball]
    openings: list[Ball]
    turns: list[list[Ball]]


def fan_of(sensor: Geometry, at: Scene, axes: Any) -> Fan:
    """at, axes: the mirror and its axes of rotation, over the box. Raises `NotAFan`."""
    angles = [angle_of(sensor, edge) for edge in at.edges]
    openings = [opening(angles[k], angles[(k + 1) % 3]) for k in range(3)]
    if not all(0 < part < arb.pi() for part in openings):
        raise NotAFan
    turns = [[dot(turn, axis) for axis in axes] for turn in turns_of_edges(sensor, at)]
    return Fan(angles, openings, turns)


def lights_of(fan: Fan, q: Plane) -> list[Light]:
    return [light_between(q, fan.angles[k], fan.openings[k]) for k in range(3)]


def shares_held(fan: Fan, least: float) -> Shares:
    """Bounds for all offsets at which each facet has at least the share `least`."""
    if not beyond_reach(fan) < least:
        raise NotAFan
    far = between(-FARTHEST, FARTHEST)
    pieces: list[Shares] = []
    todo = [((far, far), 0)]
    while todo:
        q, depth = todo.pop()
        lights = lights_of(fan, q)
        if any(light.mass.upper() < least for light in lights):
            continue
        lower = [max(ends(light.mass)[0], least) for light in lights]
        sharp = all(light.mass.lower() > SHARP * light.mass.upper() for light in lights)
        if sharp or depth == DEPTH:
            lit = [
                Light(between(low, light.mass.upper()), light.from_point)
                for low, light in zip(lower, lights, strict=True)
            ]
            pieces.append(shares_near(fan, lit, q))
        else:
            todo += [(part, depth + 1) for part in product(halves(q[0]), halves(q[1]))]
    return together(pieces)


def beyond_reach(fan: Fan) -> float:
    """A bound of the least share where the apex is further off than `FARTHEST`.

    The direction in which it is off lies in some facet; that facet is a convex set no nearer to
    the beam's centre than FARTHEST times the sine of its opening: it has no more light than a
    half-plane that far off.
    """
    right = arb.pi() / 2
    distances = [FARTHEST * (part.sin() if part > right else arb(1)) for part in fan.openings]
    return max(ends((distance / arb(2).sqrt()).erfc() / 2)[1] for distance in distances)


def least_share(fan: Fan, q: Plane, depth: int = 0) -> float:
    """A lower bound of the three shares over a box of offsets."""
    lights = lights_of(fan, q)
    if all(light.mass.lower() > SHARP * light.mass.upper() for light in lights):
        return min(ends(light.mass)[0] for light in lights)
    if depth == DEPTH:
        return 0.0
    parts = product(halves(q[0]), halves(q[1]))
    return min(least_share(fan, part, depth + 1) for part in parts)


def together(pieces: list[Shares]) -> Shares:
    """What holds over all of some boxes."""
    if not pieces:
        raise NotAFan
    return Shares(
        [[hull(p.from_point[k][i] for p in pieces) for i in range(2)] for k in range(3)],
        [
            [[hull(p.turns[k][i][j] for p in pieces) for j in range(3)] for i in range(2)]
            for k in range(3)
        ],
        [hull(p.offset[i] for p in pieces) for i in range(2)],
        hull(p.slope for p in pieces),
    )


def angle_of(sensor: Geometry, edge: Vector) -> Ball:
    """Of an edge as seen along the beam, counted from its middle: never near half a turn off."""
    x, y = in_sigmas(sensor, edge)
    c, s = x.mid(), y.mid()
    return arb.atan2(s, c) + arb.atan2(c * y - s * x, c * x + s * y)


def along(angle: Ball) -> Plane:
    return angle.cos(), angle.sin()


def halves(whole: Ball) -> list[Ball]:
    low, high = ends(whole)
    middle = (low + high) / 2
    return [between(low, middle), between(middle, high)]


def opening(first: Ball, second: Ball) -> Ball:
    """From one angle on to the next, counter-clockwise."""
    turns = ((second - first) / (2 * arb.pi())).mid().floor()
    return second - first - 2 * arb.pi() * turns


def shares_near(fan: Fan, lights: list[Light], q: Plane) -> Shares:
    """`shares_held` for a small box of q."""
    u = [along(angle) for angle in fan.angles]
    edges = [edge_of(q, side) for side in u]
    alpha = [times(u[(e + 1) % 3], u[(e + 2) % 3]) for e in range(3)]
    resistance = sum(alpha[e] / edges[e].light for e in range(3))
    dq = [[arb(0)] * 3, [arb(0)] * 3]
    for j in range(3):
        swept = sum(alpha[e] * edges[e].mean * fan.turns[e][j] for e in range(3)) / resistance
        w = [swept / edges[e].light - edges[e].mean * fan.turns[e][j] for e in range(2)]
        for i in range(2):
            dq[i][j] = (w[0] * u[1][i] - w[1] * u[0][i]) / times(u[0], u[1])
    moved = [centroid_moves(dq, edges, lights[k], fan.turns, k) for k in range(3)]
    on = [edge.light for edge in edges]
    slope = sum(on[e] * on[e - 1] * times(u[e - 1], u[e]) for e in range(3))
    return Shares([list(light.from_point) for light in lights], moved, list(q), slope)


def light_between(q: Plane, start: Ball, opening: Ball) -> Light:
    """Of a facet, by slices of its angle: light per angle is K, its mean distance J / K."""
    mass, x, y = arb(0), arb(0), arb(0)
    slices = SLICES + int(MORE * (magnitude(q[0]) ** 2 + magnitude(q[1]) ** 2))
    for n in range(slices):
        u = along(start + opening * between(arb(n) / slices, arb(n + 1) / slices))
        ray = edge_of(q, u)
        light = positive(ray.light, ray.mean)
        mass += light
        x += light * ray.reach * u[0]
        y += light * ray.reach * u[1]
    return Light(mass * opening / slices, (x / mass, y / mass))


def centroid_moves(
    dq: list[list[Ball]], edges: list[Edge], light: Light, turns: list[list[Ball]], k: int
) -> list[list[Ball]]:
    """How the centroid of facet k less the apex changes with the three angles: (2, 3)."""
    first, second = edges[k], edges[(k + 1) % 3]
    moved = [[arb(0)] * 3, [arb(0)] * 3]
    for j in range(3):
        length = (arb(magnitude(dq[0][j])) ** 2 + arb(magnitude(dq[1][j])) ** 2).sqrt()
        within = between(-length, length) / 2
        for i in range(2):
            by_first = first.light * first.mean * (first.reach * first.u[i] - light.from_point[i])
            by_second = (
                second.light * second.mean * (second.reach * second.u[i] - light.from_point[i])
            )
            turned = by_second * turns[(k + 1) % 3][j] - by_first * turns[k][j]
            moved[i][j] = turned / light.mass - dq[i][j] / 2 + within
    return moved
