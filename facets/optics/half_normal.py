"""Integrals of a normal distribution along a half-line that points away from its centre.

The half-line starts at the distance a >= 0 beyond the foot of the distribution's centre:

    I_n(a) = int_0^inf s^n exp(-s^2/2 - a s) ds,  n = 0, 1, 2.

I_0 is the Mills ratio. The recurrence I_1 = 1 - a I_0 and I_2 = I_0 - a I_1 loses digits to
cancellation for large a. The recurrence from I_2, I_0 = (I_2 + a) / (1 + a^2) and
I_1 = (1 - a I_2) / (1 + a^2), does not. Therefore only I_2 is a polynomial, whose coefficients come
from tests/optics/references/make_half_normal.py.
"""

from __future__ import annotations

from typing import Any

from ..scalars.dispatch import Number
from ..scalars.polynomials import polynomial

Three = tuple[Any, Any, Any]

#: I_2 / z^3 with z = 4 / (4 + a), as a polynomial in 2 z - 1, lowest power first.
SECOND = (
    0.18472407624425122,
    0.36863727970814447,
    0.3856656080956597,
    0.24663279327609486,
    0.08459548535499144,
    -0.0017272469477186058,
    -0.014493291717146153,
    -0.003195109442933432,
    0.0020924993140803557,
    0.000827763118298977,
    -0.0003695508111121784,
    -0.00016979898050083453,
    8.502021158252008e-05,
    2.9921092742278064e-05,
    -2.2568327390544665e-05,
    -3.4087099088969634e-06,
    5.947394490681113e-06,
    -4.523688657272809e-07,
    -1.372982811468784e-06,
    4.7585102528909343e-07,
    2.372426389760481e-07,
    -1.9096863990859084e-07,
    -1.9628742659935976e-08,
    5.119192284999415e-08,
    -2.378762746478945e-09,
    -8.939963636672767e-09,
    6.460209784565951e-10,
    7.780524337606033e-10,
)


def tail_integrals(a: Number) -> Three:
    """The integrals (I_0, I_1, I_2) for a >= 0, each to a few parts in 1e16."""
    z = 4 / (4 + a)
    second = polynomial(2 * z - 1, SECOND) * (z * z * z)
    inverse = 1 / (1 + a * a)
    return (second + a) * inverse, (1 - a * second) * inverse, second
