"""A beam whose profile is not Gaussian: the light on the facets, by Hermite polynomials.

In units of the beam's sigma its irradiance is f(x) (1 + sum c_n He_n(x)), where f is the standard
normal density. n runs over the third and fourth orders (3, 0) to (0, 4) of a Gram-Charlier series.
He_n f is d^n f, with the opposite sign for odd orders. The irradiance is therefore f + D f with the
differential operator D = sum +-c_n d^n. The light in a wedge with its point at q is then
M + D M, where M(q) is the mass of the Gaussian beam and D differentiates by q. The gradient of M is
the sum of +-w L over the two sides, where w is the direction across a side and L(a, h) the integral
of f along it. D M therefore needs derivatives of L alone. With a = q . u, h = q x u = q . w and
f = f(q) they are

    d^j L / dh^j = (-1)^j He_j(h) L
    d^(j+k) L / dh^j da^k = (-1)^(j+k) He_j(h) He_(k-1)(a) f,  k > 0

The symmetric tensors T and S of the coefficients, D = T : dddd - S : ddd, are turned into each
side's axes u and w. The integrals along a side and the first moments,
M1 + D M1 - (4 T : ddd - 3 S : dd) M, are found in the same way. The result is exact for this
irradiance; no term is neglected.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ..scalars.dispatch import Number, holds_anywhere, select, select_each
from .central import Side
from .effects import Light, turn_cubic, turn_tensor
from .forward import Geometry, LitFacet, Scene, Three, replace_light
from .vectors import Plane, cross2, dot2
from .wedge import Moments


def hermite(x: Number) -> Three:
    """The Hermite polynomials He_2, He_3 and He_4."""
    square = x * x
    return square - 1, x * (square - 3), square * (square - 6) + 3


class SideChange(NamedTuple):
    """The effect of the profile on one side of a wedge.

    integrals: along the side, as in `wedge.sides`, with the irradiance at the wedge's point in
    place of the fourth.  mass, moment: terms that are added to mass and first moments of the wedge
    that begins at this side, and subtracted from those of the wedge that ends there.
    """

    integrals: Side
    mass: Number
    moment: Plane


def side_change(light: Light, q: Plane, u: Plane, side: Side) -> SideChange:
    """The effect of the profile on a side.

    q, u: the wedge's point and the side's direction.  side: its integrals, from `wedge.sides`.
    """
    w = (u[1], -u[0])
    a, h = dot2(q, u), cross2(q, u)
    length, first, second, _ = side
    f = first + a * length
    t0, t1, t2, t3, t4 = turn_tensor(light.profile, u, w)
    s0, s1, s2, s3 = turn_cubic(light.asymmetry, u, w)
    a2, a3, a4 = hermite(a)
    h2, h3, h4 = hermite(h)
    even, odd = t4 * h4, s3 * h3
    integrals = (
        length * (1 + even + odd)
        + f * (4 * t3 * h3 + 6 * t2 * a * h2 + 4 * t1 * h * a2 + t0 * a3)
        + f * (3 * s2 * h2 + 3 * s1 * a * h + s0 * a2),
        first * (1 + even + odd)
        + length * (4 * t3 * h3 + 3 * s2 * h2)
        + f * (6 * t2 * h2 + 4 * t1 * a * h + t0 * a2 + 3 * s1 * h + s0 * a),
        second * (1 + even + odd)
        + first * (8 * t3 * h3 + 6 * s2 * h2)
        + length * (12 * t2 * h2 + 6 * s1 * h)
        + f * (8 * t1 * h + 2 * t0 * a + 2 * s0),
        f * (1 + even + odd)
        + f * (4 * t3 * h3 * a + 6 * t2 * h2 * a2 + 4 * t1 * h * a3 + t0 * a4)
        + f * (3 * s2 * h2 * a + 3 * s1 * h * a2 + s0 * a3),
    )
    mass = -length * (t4 * h3 + s3 * h2)
    mass -= f * (3 * t3 * h2 + 3 * t2 * a * h + t1 * a2 + 2 * s2 * h + s1 * a)
    across = length * (t4 * (h4 + 4 * h2) + s3 * (h3 + 3 * h))
    across += f * (t3 * (3 * h3 + 8 * h) + t2 * (3 * a * h2 + 4 * a) + t1 * h * a2)
    across += f * (s2 * (2 * h2 + 3) + s1 * a * h)
    along = length * (4 * t3 * h2 + 3 * s2 * h)
    along += f * (t4 * h3 + 3 * t3 * a * h2 + t2 * (3 * h * a2 + 8 * h) + t1 * (a3 + 4 * a))
    along += f * (s3 * h2 + 2 * s2 * a * h + s1 * (a2 + 3))
    moment = -along * u[0] - across * w[0], -along * u[1] - across * w[1]
    return SideChange(integrals, mass, moment)


def apply_profile(geometry: Geometry, at: Scene) -> Scene:
    """Convert the scene of a Gaussian beam to that of the beam's own profile.

    The third part of the moments remains that of the Gaussian beam; see `moment_slopes`.
    """
    light, profiled = geometry.light, geometry.light.options.profiled
    if not holds_anywhere(profiled):
        return at
    s0 = side_change(light, at.q, at.sides[0], at.integrals[0])
    s1 = side_change(light, at.q, at.sides[1], at.integrals[1])
    s2 = side_change(light, at.q, at.sides[2], at.integrals[2])
    integrals = s0.integrals, s1.integrals, s2.integrals
    moments = (
        change_moments(at.q, at.moments[0], s0, s1),
        change_moments(at.q, at.moments[1], s1, s2),
        change_moments(at.q, at.moments[2], s2, s0),
    )
    usual = at.integrals, at.moments
    return replace_light(at, *select_each(profiled, (integrals, moments), usual))


def change_moments(q: Plane, moments: Moments, begin: SideChange, end: SideChange) -> Moments:
    """The moments of a wedge with the changes that the profile causes along both sides."""
    mass, centroid, shift, _ = moments
    total = mass + (begin.mass - end.mass)
    x = (mass * centroid[0] + (begin.moment[0] - end.moment[0])) / total
    y = (mass * centroid[1] + (begin.moment[1] - end.moment[1])) / total
    return total, (x, y), shift, (x - q[0], y - q[1])


def moment_slopes(facet: LitFacet) -> tuple[Plane, tuple[Any, Any, Any, Any]]:
    """The derivatives by q of the light on a facet: minus the gradient of the logarithm of its
    mass, and the derivatives of its centroid, as xx, xy, yx, yy.

    For a Gaussian beam these are the centroid and one minus the covariance.
    """
    mass, centroid, (pxx, pxy, pyy), (x, y) = facet.moments
    profiled, usual = facet.geometry.light.options.profiled, (centroid, (pxx, pxy, pxy, pyy))
    if not holds_anywhere(profiled):
        return usual
    u1, u2 = facet.sides
    (length1, first1, _, _), (length2, first2, _, _) = facet.integrals
    x1, y1 = (u1[0] * first1 - x * length1) / mass, (u1[1] * first1 - y * length1) / mass
    x2, y2 = (u2[0] * first2 - x * length2) / mass, (u2[1] * first2 - y * length2) / mass
    decline = (u2[1] * length2 - u1[1] * length1) / mass, (u1[0] * length1 - u2[0] * length2) / mass
    slopes = (
        x1 * u1[1] - x2 * u2[1],
        x2 * u2[0] - x1 * u1[0],
        y1 * u1[1] - y2 * u2[1],
        y2 * u2[0] - y1 * u1[0],
    )
    return select_each(profiled, (decline, slopes), usual)  # type: ignore[no-any-return]


def density_at_point(facet: LitFacet) -> Number:
    """The beam's irradiance at the wedges' point, per square sigma."""
    length, first, _, density = facet.integrals[0]
    usual = first + dot2(facet.at.q, facet.sides[0]) * length
    return select(facet.geometry.light.options.profiled, density, usual)
