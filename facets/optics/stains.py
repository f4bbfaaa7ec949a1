"""Light that dust, chips and stains take from a facet, as a smooth function of the apex's place.

Let a facet lack the fraction r(p) of its reflectance at the position p relative to the apex. It
then loses the light L(q) = integral f(q + p) r(p). Here f is the beam's standard normal density and
q the apex's position in the beam; all lengths are in sigmas of the beam. As grad f(x) = -x f(x),
the lost light's first moments are -grad L for every r. L is expanded as

    L(q) = exp(-q^2 / 2) sum c_ab h_a(x) h_b(y),

h_n = He_n / sqrt(n!), with x and y along the world's x and y, tilted with the beam. A speck at the
distance p has coefficients that decrease as p^n / sqrt(n!), so that fourth order describes specks
within about a sigma of the apex's path. As d (exp(-x^2 / 2) h_n) = -sqrt(n + 1)
exp(-x^2 / 2) h_(n+1), the moments have a closed form, too.
"""

from __future__ import annotations

from math import sqrt
from typing import Any

from ..scalars.dispatch import Number, exp, holds_anywhere
from .forward import LitFacet
from .vectors import Plane, cross2, dot2

#: The highest order of the polynomials in x and y together.
DEGREE = 4


def normalised_hermite(x: Number) -> tuple[Any, ...]:
    """He_n / sqrt(n!) of the orders n from 0 to DEGREE + 1."""
    values = [x * 0 + 1, x]
    for n in range(1, DEGREE + 1):
        values.append((x * values[n] - sqrt(n) * values[n - 1]) / sqrt(n + 1))
    return tuple(values)


def stained_light(facet: LitFacet) -> tuple[Number, Plane]:
    """The fraction of the beam's power that stains take from a facet, and its first moments in
    sigmas."""
    light, q = facet.geometry.light, facet.at.q
    lost = along = across = q[0] * 0
    if not holds_anywhere(light.options.profiled):
        return lost, (lost, lost)
    u = light.own_axis
    x, y = u[0] * q[0] - u[1] * q[1], u[1] * q[0] + u[0] * q[1]
    of_x, of_y = normalised_hermite(x), normalised_hermite(y)
    amounts = iter(light.stains[facet.k])
    for order in range(DEGREE + 1):
        for a in range(order + 1):
            b, amount = order - a, next(amounts)
            lost = lost + amount * of_x[a] * of_y[b]
            along = along + amount * (sqrt(a + 1) * of_x[a + 1] * of_y[b])
            across = across + amount * (sqrt(b + 1) * of_x[a] * of_y[b + 1])
    density = exp(-(x * x + y * y) / 2)
    moment = density * along, density * across
    return density * lost, (dot2(u, moment), cross2(u, moment))
