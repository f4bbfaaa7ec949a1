"""Polynomials for several poses at once, against mpmath, to the bounds that the module states."""

import math

import mpmath
import numpy as np
import pytest

from facets.optics import CENTRAL_SQUARED, side_central, wedge
from facets.scalars import polynomials

ULP = 2.0**-53


@pytest.mark.parametrize(
    ("function", "exact", "ends", "ulps"),
    [
        (polynomials.exponential, lambda x: mpmath.exp(-x), (0, 2), 20),
        (lambda x: polynomials.error_function(x, x * x),
         lambda x: mpmath.erf(x / mpmath.sqrt(2)), (-2, 2), 8),
        (polynomials.sine, mpmath.sin, (-1, 1), 4),
        (polynomials.cosine, mpmath.cos, (-1, 1), 5),
        (polynomials.arc_tangent, mpmath.atan, (1 - math.sqrt(2), math.sqrt(2) - 1), 4),
    ],
)  # fmt: skip
def test_polynomials_hold_their_digits(function, exact, ends, ulps):
    points = np.concatenate([np.random.default_rng(1).uniform(*ends, 500), ends])
    with mpmath.workdps(30):
        for x in points:
            right = exact(mpmath.mpf(float(x)))
            assert abs(mpmath.mpf(float(function(float(x)))) - right) <= ulps * ULP * abs(right)


def test_a_side_near_the_centre_by_its_definition():
    """Absolute errors, of integrals of order one: 7e-16 of the second moment, 3e-16 of the rest."""
    rng = np.random.default_rng(2)
    for _ in range(60):
        radius, way, turn = (
            math.sqrt(CENTRAL_SQUARED * rng.random()),
            *rng.uniform(0, 2 * math.pi, 2),
        )
        q, u = (radius * math.cos(way), radius * math.sin(way)), (math.cos(turn), math.sin(turn))
        a, h = q[0] * u[0] + q[1] * u[1], q[0] * u[1] - q[1] * u[0]
        with mpmath.workdps(30):
            exact = wedge.side(*(tuple(map(mpmath.mpf, v)) for v in (q, u)))
            away = [abs(x - y) for x, y in zip(side_central(q, a, h), exact, strict=True)]
        assert max(away[0], away[1], away[3]) < 5e-16
        assert away[2] < 1.2e-15
