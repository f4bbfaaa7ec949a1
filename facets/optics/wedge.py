"""A standard normal distribution over a wedge: mass, centroid, and their derivatives, closed.

Seen along the beam, a facet is a wedge with its point at the apex. In units of the beam's sigma,
the beam is a standard normal distribution f about the origin. The wedge is the set of points q + s
u(angle) between its sides along the unit vectors u1 and u2, counter-clockwise by less than half a
turn.

A side is the half-line q + s u, s > 0. With a = q . u and h = q x u, its integrals are

    length  L = int f ds   = exp(-h^2/2) erfc(a/sqrt 2) / (2 sqrt(2 pi))
    first   K = int s f ds = f(q) - a L
    second  J = int s^2 f ds = L - a K

By the divergence theorem the wedge's first moments are sums of these: M1 = -(n1 L1 + n2 L2), where
n are the outward normals. The mass is that of a wedge with its point at the beam's centre, angle /
2 pi, plus the masses that the sides sweep over while the point moves from there to q
(`swept_mass`). Where the mass is small, this sum cancels. `tail.tail_wedge` then integrates over
slices, whose terms are all positive.

The normal distribution is an exponential family. With centroid C and covariance S of the light in
the wedge, the derivatives are therefore dM0/dq = -M0 C and dC/dq = 1 - S. Turning a side adds or
removes a sliver with the moments K and J.
"""

from __future__ import annotations

from typing import Any

from ..scalars.dispatch import (
    Number,
    erfc,
    exp,
    has_more_digits,
    integral,
    pi,
    select,
    sqrt,
    where_each,
)
from .central import CENTRAL_SQUARED, Side, side_central
from .tail import far_side, tail_wedge
from .vectors import Plane, angle_between, cross2, dot2

Moments = tuple[Any, Plane, tuple[Any, Any, Any], Plane]
Planes = tuple[Plane, ...]
Pair = tuple[Plane, Plane, Side, Side]


def sides(q: Plane, directions: Planes) -> tuple[Side, ...]:
    """The integrals (length, first, second, swept) of each side from `q` along a unit vector."""
    if has_more_digits(q[0]):
        return tuple(precise_side(dot2(q, u), cross2(q, u)) for u in directions)
    far = q[0] * q[0] + q[1] * q[1] >= CENTRAL_SQUARED
    usual = tuple(side_central(q, dot2(q, u), cross2(q, u)) for u in directions)
    arguments = tuple((q, u) for u in directions)
    return where_each(tuple(far for _ in arguments), usual, far_side, arguments)


def precise_side(a: Number, h: Number) -> Side:
    """The integrals of one side by their definitions, in any precision.  a, h: q . u and q x u."""
    root = sqrt(pi(a) + pi(a))
    half_turn = sqrt(a * 0 + 2)
    across = exp(-h * h / 2)
    density = exp(-a * a / 2) * across / (2 * pi(a))
    length = across * erfc(a / half_turn) / (2 * root)
    return length, *moments_along(a, density, length), swept_mass(a, h)


def moments_along(a: Number, density: Number, length: Number) -> tuple[Number, Number]:
    """K and J of a side from its density f(q) at the end and its length L."""
    first = density - a * length
    return first, length - a * first


def swept_mass(a: Number, h: Number) -> Number:
    """The mass that a side sweeps over while its end moves in a straight line from the beam's
    centre to q, in any precision.

    It is h int_0^1 L(k a, k h) dk, positive where the centre is on the side's left.
    """
    root, half_turn = sqrt(8 * pi(a)), sqrt(a * 0 + 2)

    def length(k: Number) -> Number:
        """The length L(k a, k h) of the side."""
        return exp(-k * k * h * h / 2) * erfc(k * a / half_turn) / root

    return h * integral(length, a)


def wedges(q: Plane, pairs: tuple[Pair, ...]) -> tuple[Moments, ...]:
    """The moments (mass, centroid, 1 - covariance, centroid - q) of the light in each wedge.

    The third is a symmetric matrix as xx, xy, yy: the derivative of the centroid by q.

    q: the wedges' point, in sigmas from the beam's centre.  pairs: for each wedge the unit vectors
    of its two sides, the second less than half a turn counter-clockwise of the first, and the
    integrals of these sides from `sides`.
    """
    masses = tuple(closed_mass(*pair) for pair in pairs)
    if has_more_digits(q[0]):
        return tuple(
            closed_moments(q, *pair, mass) for pair, mass in zip(pairs, masses, strict=True)
        )
    limit = FAINT_MASS * (1 + abs(q[0]) + abs(q[1]))
    uses_tail = tuple((mass <= limit) & (mass <= BRIGHT_MASS) for mass in masses)
    bright = tuple(
        closed_moments(q, *pair, select(in_tail, 1.0, mass))
        for pair, in_tail, mass in zip(pairs, uses_tail, masses, strict=True)
    )
    arguments = tuple((q, *pair[:2]) for pair in pairs)
    return where_each(uses_tail, bright, tail_wedge, arguments)


#: Mass over 1 + |q| below which the closed form has lost two digits to cancellation, so that
#: `tail_wedge` is used.
FAINT_MASS = 0.01
#: Mass above which the closed form loses no digits at any distance.
BRIGHT_MASS = 0.3


def closed_mass(u1: Plane, u2: Plane, side1: Side, side2: Side) -> Number:
    """The fraction of the light in a wedge, by the closed formula."""
    opening = angle_between(u1, u2)
    return opening / (2 * pi(opening)) + side1[3] - side2[3]


def closed_moments(
    q: Plane, u1: Plane, u2: Plane, side1: Side, side2: Side, mass: Number
) -> Moments:
    """Mass, centroid, one minus the covariance, and the centroid less the point, in sigmas, by the
    closed formula."""
    # int x f over a side is q L + u K; outward normals are (u1y, -u1x) and (-u2y, u2x)
    x1, y1 = q[0] * side1[0] + u1[0] * side1[1], q[1] * side1[0] + u1[1] * side1[1]
    x2, y2 = q[0] * side2[0] + u2[0] * side2[1], q[1] * side2[0] + u2[1] * side2[1]
    cx = (u2[1] * side2[0] - u1[1] * side1[0]) / mass
    cy = (u1[0] * side1[0] - u2[0] * side2[0]) / mass
    pxx = (u1[1] * x1 - u2[1] * x2) / mass + cx * cx
    pxy = (u1[1] * y1 - u2[1] * y2) / mass + cx * cy
    pyy = (u2[0] * y2 - u1[0] * y1) / mass + cy * cy
    return mass, (cx, cy), (pxx, pxy, pyy), (cx - q[0], cy - q[1])


def turn_derivative(u: Plane, ray: Side, mass: Number, from_point: Plane) -> tuple[Number, Plane]:
    """The derivatives of mass and centroid by the angle of a side that opens the wedge, per radian.

    ray: the side's integrals.  from_point: the centroid minus the wedge's point.
    """
    _, first, second, _ = ray
    x = u[0] * second - from_point[0] * first
    y = u[1] * second - from_point[1] * first
    return first, (x / mass, y / mass)
