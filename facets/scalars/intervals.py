"""Rigorous intervals of python-flint (Arb), for the optics' formulas and for proofs.

Every result contains the true value, also with rounding errors. A sum or a product of wide
intervals is wider than necessary if a quantity occurs twice. The result is then less sharp, but
still true.
"""

from __future__ import annotations

from math import inf, isfinite
from typing import Any

from flint import arb

Interval = Any


def interval(low: float | Interval, high: float | Interval) -> Interval:
    """The interval from the lower end of `low` to the upper end of `high`."""
    return arb(low).union(arb(high))


def interval_around(value: float, off: float) -> Interval:
    """All values that are at most `off` from `value`."""
    if off == 0:
        return arb(value)
    return interval((arb(value) - arb(off)).lower(), (arb(value) + arb(off)).upper())


def ends(x: Interval) -> tuple[float, float]:
    """The ends (low, high) of an interval as floats, rounded outwards by a little."""
    low, high = float(x.lower()), float(x.upper())
    slack = 1e-15 * (abs(low) + abs(high)) + 1e-300
    return low - slack, high + slack


def magnitude(x: Interval) -> float:
    """The largest absolute value in an interval, rounded up; infinite if the interval is not."""
    low, high = ends(x)
    return max(abs(low), abs(high)) if isfinite(low) and isfinite(high) else inf


def square(x: Interval) -> Interval:
    """x^2, which is never negative."""
    low, high = x.lower() ** 2, x.upper() ** 2
    return low.union(high).union(arb(0)) if x.contains(arb(0)) else low.union(high)


def nonnegative_product(x: Interval, y: Interval) -> Interval:
    """The product of two quantities that are not negative, although their intervals may be."""
    low = [max(side.lower(), arb(0)) for side in (x, y)]
    return (low[0] * low[1]).lower().union((x.upper() * y.upper()).upper())


def exp(x: Interval) -> Interval:
    return x.exp()


def sqrt(x: Interval) -> Interval:
    return x.sqrt()


def sin(x: Interval) -> Interval:
    return x.sin()


def cos(x: Interval) -> Interval:
    return x.cos()


def erf(x: Interval) -> Interval:
    return x.erf()


def erfc(x: Interval) -> Interval:
    return x.erfc()


def atan2(y: Interval, x: Interval) -> Interval:
    return arb.atan2(y, x)
