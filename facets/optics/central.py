"""The light along a side near the beam's centre, as polynomials without branches or loops.

The integrals of `wedge.sides` are computed by a series of fixed length, without library functions.
With A = a^2, H = h^2 and r^2 = A + H = |q|^2, the mass that a side sweeps over is

    erf(h / sqrt 2) / 4 - a h / 4 pi  int_0^1 D((H + A u^2) / 2) du,   D(z) = (1 - exp(-z)) / z,

where D is a polynomial. Integration by parts relates the moments of its powers,
M_j = int_0^1 (H + A u^2)^j du, to each other: (2 j + 1) M_j = r^2j + 2 j H M_(j-1). The integral is
therefore a sum of powers of H and of r^2.
"""

from __future__ import annotations

from math import pi, sqrt
from typing import Any

from ..scalars.dispatch import Number
from ..scalars.polynomials import DECAY, error_function, exponential
from .vectors import Plane

Side = tuple[Any, Any, Any, Any]

#: Square of the largest distance of the point from the beam's centre, in sigmas. At a larger
#: distance, one of the facets of a mirror like the paper's is faint.
CENTRAL_SQUARED = 4.0


def tables() -> tuple[tuple[float, ...], tuple[float, ...]]:
    """The factors of H^j and of r^2j in the integral of D: DECAY_j g_j / 2^j and
    1 / (g_j (2 j + 1)), with g_j = prod 2 i / (2 i + 1)."""
    across, around, product = [], [], 1.0
    for j, coefficient in enumerate(DECAY):
        product *= 2 * j / (2 * j + 1) if j else 1.0
        across.append(coefficient * product / 2**j)
        around.append(1 / (product * (2 * j + 1)))
    return tuple(across), tuple(around)


ACROSS, AROUND = tables()


def side_central(q: Plane, a: Number, h: Number) -> Side:
    """The integrals of one of `wedge.sides` whose point is within sqrt(CENTRAL_SQUARED) of the
    beam's centre.

    a, h: q . u and q x u.
    """
    along, across, radius = a * a, h * h, q[0] * q[0] + q[1] * q[1]
    beyond = 1 - error_function(a, along)
    length = exponential(across * 0.5) * beyond * (1 / (2 * sqrt(2 * pi)))
    density = exponential(radius * 0.5) * (1 / (2 * pi))
    first = density - a * length
    within = error_function(h, across) * 0.25
    return length, first, length - a * first, within - triangle_mass(a * h, across, radius)


def triangle_mass(product: Number, across: Number, radius: Number) -> Number:
    """The mass of the triangle between the beam's centre, the foot of the side and its point q.

    product, across, radius: a h, h^2, |q|^2.
    """
    inner, power, powers = ACROSS[-1], radius, [1.0]
    for factor in AROUND[1:]:
        powers.append(power * factor)
        power = power * radius
    total = inner * powers[-1]
    for coefficient, each in zip(ACROSS[-2::-1], powers[-2::-1], strict=True):
        inner = inner * across + coefficient
        total = total + inner * each
    return product * (1 / (4 * pi)) * total
