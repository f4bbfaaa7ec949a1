"""Polynomials for several poses at once, against mpmath, to the bounds that the module states."""

import math

import mpmath
import numpy as np
import pytest

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
