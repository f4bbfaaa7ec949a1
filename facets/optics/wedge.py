"""A standard normal distribution over a wedge: mass, centroid, and their derivatives, closed.

Seen along the beam, a facet is a wedge with its point at the apex. In units of the beam's sigma the
beam is a standard normal distribution f about the origin, and the wedge is the set q + s u(angle)
with its two sides along the unit vectors u1 and u2, counter-clockwise by less than half a turn.

A side is the half-line q + s u, s > 0. With a = q . u and h = q x u, its integrals are

    length  L = int f ds   = exp(-h^2/2) erfc(a/sqrt 2) / (2 sqrt(2 pi))
    first   K = int s f ds = f(q) - a L
    second  J = int s^2 f ds = L - a K

The divergence theorem turns the wedge's moments into these: M1 = -(n1 L1 + n2 L2), with n the
outward normals. The mass is that of a wedge pointed at the beam's centre, angle / 2 pi, plus what
each side sweeps over while the point moves from there to q (`swept_mass`). Where the mass is small
this sum cancels; for floats, `wedge_by_quadrature` then integrates over the angle, where all terms
are positive.

Derivatives follow from the normal distribution being an exponential family: with centroid C and
covariance S of the light in the wedge, dM0/dq = -M0 C and dC/dq = 1 - S; turning a side adds
or removes a sliver with moments K and J.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..scalars.dispatch import Number, atan2, erf, erfc, exp, integral, is_float, pi, sqrt
from .central import CENTRAL_SQUARED, Side, side_central
from .compensated import gauss, gauss_of_point, normalise
from .half_normal import half_normal
from .tail_quadrature import AWAY_SIGMAS, no_light, wedge_by_quadrature
from .vectors import Plane, angle_between, cross2, dot2

Moments = tuple[Any, Plane, tuple[Any, Any, Any], Plane]


def side(q: Plane, u: Plane) -> Side:
    """(length, first, second, swept) of the side from `q` along the unit vector `u`."""
    a, h = dot2(q, u), cross2(q, u)
    if is_float(a):
        return side_float(q, u, a, h)
    if hasattr(a, "writer"):
        return side_code(q, u, a, h)
    root = sqrt(pi(a) + pi(a))
    half_turn = sqrt(a * 0 + 2)
    across = exp(-h * h / 2)
    density = exp(-a * a / 2) * across / (2 * pi(a))
    length = across * erfc(a / half_turn) / (2 * root)
    return length, *moments_along(a, density, length), swept_mass(a, h)


#: Square of the distance, in sigmas, beyond which the rounding of q . u and q x u shows in the
#: Gaussian.
FAR_SQUARED = 30.0


def side_float(q: Plane, u: Plane, a: float, h: float) -> Side:
    """`side` for floats. a, h: q . u and q x u."""
    return side_far(q, u, a) if a * a + h * h > FAR_SQUARED else side_near(a, h)


def side_code(q: Plane, u: Plane, a: Number, h: Number) -> Side:
    """`side_float` for machine code; for several poses at once near the centre only."""
    code, like = a.writer, (a, a, a, a)
    if code.lanes > 1:
        code.leave(~(q[0] * q[0] + q[1] * q[1] < CENTRAL_SQUARED))
        return side_central(q, a, h)
    return code.choose(  # type: ignore[no-any-return]
        a * a + h * h > FAR_SQUARED,
        lambda: code.rarely(side_far, like, q, u, a),
        lambda: code.call(side_near, like, a, h),
    )


def side_near(a: float, h: float) -> Side:
    along, across = exp(-a * a / 2), exp(-h * h / 2)
    return side_of(a, h, along, across, along * across / (2 * pi(a)))


def side_far(q: Plane, u: Plane, a: float) -> Side:
    """`side` far from the beam's centre. a: q . u with its rounding."""
    along = exp(-a * a / 2)
    exact, h, missing = normalise(q, u)
    return side_of(exact, h, along, gauss(h, missing), gauss_of_point(q))


def side_of(a: float, h: float, along: float, across: float, density: float) -> Side:
    """`side` from its Gaussians: exp(-a^2/2), exp(-h^2/2), and f(q)."""
    beyond, within = erfc(a / sqrt(2.0)), erf(h / sqrt(2.0))
    length = across * beyond / (2 * sqrt(2 * pi(a)))
    first, second = moments_along_float(a, density, length)
    return length, first, second, swept_series(a, h, along, across, beyond, within)


def moments_along_float(a: float, density: float, length: float) -> tuple[float, float]:
    """K and J without cancellation where the side points away from the light."""
    if a > AWAY_SIGMAS:
        _, first, second = half_normal(a)
        return density * first, density * second
    return moments_along(a, density, length)


def moments_along(a: Number, density: Number, length: Number) -> tuple[Number, Number]:
    """K and J of a side from its density f(q) at the end and its length L."""
    first = density - a * length
    return first, length - a * first


def swept_mass(a: Number, h: Number) -> Number:
    """The mass that a side sweeps over while its end moves straight from the beam's centre to q;
    `swept_series` is for floats.

    h int_0^1 L(k a, k h) dk, positive where the centre lies to the left of the side.
    """
    root, half_turn = sqrt(8 * pi(a)), sqrt(a * 0 + 2)

    def length(k: Number) -> Number:
        return exp(-k * k * h * h / 2) * erfc(k * a / half_turn) / root

    return h * integral(length, a)


#: 1/j, so that the series does not divide; x up to 40 takes 130 terms.
INVERSE = np.array([0.0, *(1 / j for j in range(1, 400))])


def swept_series(
    a: float, h: float, along: float, across: float, beyond: float, within: float
) -> float:
    """`swept_mass` for floats, to a few parts in 1e17.

    along, across: exp(-a^2/2), exp(-h^2/2); beyond, within: erfc(a/sqrt 2), erf(h/sqrt 2).
    With x = max(a^2, h^2)/2 and t = min(|a|, |h|) / max(|a|, |h|), what is not erf is
    sum_j (-1)^j t^(2j+1) / (2j+1) P(j+1, x), P the regularised incomplete gamma function: the
    Taylor series of Owen's T in its second argument, without the arc tangent that would cancel.
    """
    wide = abs(a) >= abs(h)
    larger, smaller, poisson = (a, h, along) if wide else (h, a, across)
    if larger == 0:
        return 0.0
    x = larger * larger / 2
    t = smaller / larger
    if x > 40:  # P = 1 to 1e-17, so the series is that of the arc tangent.
        total = atan2(t, 1.0)
    else:
        minus_t2 = -t * t
        power = t
        tail = 1 - poisson
        total = t * tail
        j = 0
        while poisson > 1e-17 or j < x:
            j += 1
            poisson *= x * INVERSE[j]
            tail -= poisson
            power *= minus_t2
            total += power * tail * INVERSE[2 * j + 1]
    total /= 2 * pi(a)
    light: float = beyond * within / 4 + total if wide else within / 4 - total
    return light


def wedge(q: Plane, u1: Plane, u2: Plane, side1: Side, side2: Side) -> Moments:
    """(mass, centroid, 1 - covariance, centroid - q) of the light in a wedge.

    The third is a symmetric matrix as xx, xy, yy: the derivative of the centroid by q.

    q: the wedge's point; u1, u2: its sides, unit vectors, u2 counter-clockwise of u1 by less than
    half a turn; side1, side2: what `side` gives for them. Units of the beam's sigma, about the
    beam's centre.
    """
    if is_float(q[0]):
        return wedge_float(q, u1, u2, side1, side2)
    if hasattr(q[0], "writer"):
        return wedge_code(q, u1, u2, side1, side2)
    return closed_wedge(q, u1, u2, side1, side2)


#: Where the mass is less than this, times 1 + |q|, the closed form has lost two digits to
#: cancellation, and `wedge_by_quadrature` is used.
FAINT_MASS = 0.01
#: Above this mass nothing cancels at any distance.
BRIGHT_MASS = 0.3
#: At larger distances, in sigmas, a wedge with less mass is dark; only wrong steps of a solver get
#: there.
DARK_SIGMAS = 1000.0


def wedge_float(q: Plane, u1: Plane, u2: Plane, side1: Side, side2: Side) -> Moments:
    mass = closed_mass(u1, u2, side1, side2)
    if mass > min(FAINT_MASS * (1 + abs(q[0]) + abs(q[1])), BRIGHT_MASS):
        return closed_moments(q, u1, u2, side1, side2, mass)
    return quadrature_or_dark(q, u1, u2)


def wedge_code(q: Plane, u1: Plane, u2: Plane, side1: Side, side2: Side) -> Moments:
    """`wedge_float` for machine code."""
    mass = closed_mass(u1, u2, side1, side2)
    code, like = mass.writer, (mass, (mass, mass), (mass, mass, mass), (mass, mass))
    return code.choose(  # type: ignore[no-any-return]
        (mass > FAINT_MASS * (1 + abs(q[0]) + abs(q[1]))) | (mass > BRIGHT_MASS),
        lambda: closed_moments(q, u1, u2, side1, side2, mass),
        lambda: code.rarely(quadrature_or_dark, like, q, u1, u2),
    )


def quadrature_or_dark(q: Plane, u1: Plane, u2: Plane) -> Moments:
    if q[0] * q[0] + q[1] * q[1] < DARK_SIGMAS * DARK_SIGMAS:
        return wedge_by_quadrature(q, u1, u2)
    return no_light()


def closed_wedge(q: Plane, u1: Plane, u2: Plane, side1: Side, side2: Side) -> Moments:
    """`wedge` by the divergence theorem."""
    return closed_moments(q, u1, u2, side1, side2, closed_mass(u1, u2, side1, side2))


def closed_mass(u1: Plane, u2: Plane, side1: Side, side2: Side) -> Number:
    opening = angle_between(u1, u2)
    return opening / (2 * pi(opening)) + side1[3] - side2[3]


def closed_moments(
    q: Plane, u1: Plane, u2: Plane, side1: Side, side2: Side, mass: Number
) -> Moments:
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
    """The derivatives of mass and centroid by the angle of side `ray`, in the direction that opens
    the wedge, per radian.

    from_point: the centroid less the wedge's point.
    """
    _, first, second, _ = ray
    x = u[0] * second - from_point[0] * first
    y = u[1] * second - from_point[1] * first
    return first, (x / mass, y / mass)
