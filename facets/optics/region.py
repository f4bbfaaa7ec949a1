"""A standard normal distribution over a convex region with straight sides, inside a disc; closed.

Where a wedge is cut by straight edges and by a disc about the beam's centre, the divergence theorem
still turns mass and moments into integrals over the sides. Each side lies on a line d n + s u, with
n its outward normal, d its distance from the beam's centre (negative where the centre lies beyond
it) and u = n turned by a quarter to the left; the other sides and the disc, of radius rho, leave a
span s0..s1 of it. The arcs need no list of their own: along them the density is constant, and the
normals and turns of a closed outline add up to zero and to a whole turn. With c = exp(-rho^2/2),

    M1 = -sum n (L - c (s1 - s0) / 2 pi)
    M0 = sum (G(s0, d) - G(s1, d)) + (1 - c) arcs

where G is `wedge.swept_mass` and arcs (`arc_share`) the share of a whole turn that the arcs subtend
from the centre: 1 or 0, as the centre lies inside or outside, less what the spans subtend.

A region is an array with a row for each side; the columns are named below. Good to some 1e-16 of
the whole beam, not of the light in the region: one with less than `DIM` has no place. For floats.
"""

from __future__ import annotations

from math import atan2, erf, erfc, exp, inf, isfinite, nan, pi, sqrt
from typing import Any

from .vectors import Plane
from .wedge import swept_series

Array = Any

#: A side's line: its outward unit normal (two columns), and the distance of the beam's centre
#: inside it.
NORMAL, DISTANCE = 0, 2
#: Contributions of a side's span: the moments of f along it of order 0, 1 and 2, ...
LENGTH, FIRST, SECOND = 3, 4, 5
#: ... the excess of f over its value on the disc's rim, the swept mass, and the ends of the span.
EXCESS, SWEPT, LOW, HIGH = 6, 7, 8, 9

#: The share of the beam below which a cut region has no place, because nine digits of it are lost.
DIM = 1e-7


def span_ends(sides: Array, count: int, j: int, radius: float) -> tuple[float, float]:
    """The ends of the span on which side j bounds the region; equal if it does not."""
    x, y, distance = sides[j, NORMAL], sides[j, NORMAL + 1], sides[j, DISTANCE]
    low, high = -inf, inf
    if radius < inf:
        if abs(distance) >= radius:
            return 0.0, 0.0
        high = sqrt((radius - distance) * (radius + distance))
        low = -high
    for i in range(count):
        if i == j:
            continue
        ox, oy = sides[i, NORMAL], sides[i, NORMAL + 1]
        rate = oy * x - ox * y
        rest = sides[i, DISTANCE] - distance * (ox * x + oy * y)
        if rate > 0:
            high = min(high, rest / rate)
        elif rate < 0:
            low = max(low, rest / rate)
        # The line lies beyond a parallel side, or the same side occurs twice.
        elif rest < 0 or (rest == 0 and i < j):
            return 0.0, 0.0
    return (low, high) if low < high else (0.0, 0.0)


def erf_between(low: float, high: float) -> float:
    """erf(high / sqrt 2) - erf(low / sqrt 2) without cancellation in the tails."""
    root = sqrt(2.0)
    if low > 0:
        return erfc(low / root) - erfc(high / root)
    if high < 0:
        return erfc(-high / root) - erfc(-low / root)
    return erf(high / root) - erf(low / root)


def measure_sides(sides: Array, count: int, radius: float) -> None:
    """Fill the columns from LENGTH on for the first `count` sides."""
    for j in range(count):
        low, high = span_ends(sides, count, j, radius)
        if low == high:
            for column in range(LENGTH, HIGH + 1):
                sides[j, column] = 0.0
        else:
            measure_span(sides, j, low, high, radius)


def measure_span(sides: Array, j: int, low: float, high: float, radius: float) -> None:
    distance, root = sides[j, DISTANCE], sqrt(2.0)
    across, within = exp(-distance * distance / 2), erf(distance / root)
    to_low, to_high = exp(-low * low / 2), exp(-high * high / 2)
    at_low, at_high = across * to_low / (2 * pi), across * to_high / (2 * pi)
    length = across * erf_between(low, high) / (2 * sqrt(2 * pi))
    sides[j, LENGTH], sides[j, FIRST], sides[j, SECOND] = length, at_low - at_high, length
    if isfinite(low):
        sides[j, SECOND] += low * at_low
    if isfinite(high):
        sides[j, SECOND] -= high * at_high
    sides[j, EXCESS] = length
    if radius < inf:
        sides[j, EXCESS] -= exp(-radius * radius / 2) * (high - low) / (2 * pi)
    sides[j, LOW], sides[j, HIGH] = low, high
    sides[j, SWEPT] = swept_series(low, distance, to_low, across, erfc(low / root), within)
    sides[j, SWEPT] -= swept_series(high, distance, to_high, across, erfc(high / root), within)


def arc_share(sides: Array, count: int) -> float:
    """The share of a whole turn that the outline's arcs subtend from the beam's centre."""
    share = 1.0
    for j in range(count):
        if sides[j, DISTANCE] < 0:
            share = 0.0
    for j in range(count):
        low, high, distance = sides[j, LOW], sides[j, HIGH], sides[j, DISTANCE]
        if low == high:
            continue
        if high == inf:
            share -= atan2(distance, low) / (2 * pi)
        elif low == -inf:
            share -= atan2(distance, -high) / (2 * pi)
        else:
            share -= atan2(distance * (high - low), distance * distance + low * high) / (2 * pi)
    return share


def region_light(sides: Array, count: int, radius: float) -> tuple[float, Plane]:
    """Mass and centroid of the light inside the sides and the disc; NaN where it has no place."""
    mass = x = y = 0.0
    closed = radius == inf
    for j in range(count):
        mass += sides[j, SWEPT]
        x -= sides[j, NORMAL] * sides[j, EXCESS]
        y -= sides[j, NORMAL + 1] * sides[j, EXCESS]
        closed = closed and isfinite(sides[j, LOW]) and isfinite(sides[j, HIGH])
    if not closed:
        mass += (1 - exp(-radius * radius / 2)) * arc_share(sides, count)
    if not mass > DIM:
        return max(mass, 0.0), (nan, nan)
    return mass, (x / mass, y / mass)
