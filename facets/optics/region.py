"""Closed moments of a standard normal distribution over a convex region inside a disc.

Where a wedge is cut by straight edges and by a disc about the beam's centre, the divergence theorem
still converts mass and moments to integrals over the sides. Each side is on a line d n + s u. Here
n is the side's outward normal, d its distance from the beam's centre (negative where the centre is
outside), and u is n turned by a quarter turn to the left. The other sides and the disc, of radius
rho, limit the side to a span s0..s1. The arcs of the disc need no list of their own: along them the
density is constant, and the normals and turns of a closed outline add up to zero and to a full
turn. With c = exp(-rho^2/2),

    M1 = -sum n (L - c (s1 - s0) / 2 pi)
    M0 = sum (G(s0, d) - G(s1, d)) + (1 - c) arcs

where G is `wedge.swept_mass`, and arcs the fraction of a full turn that the arcs subtend from the
centre: 1 or 0, if the centre is inside or outside, minus the fractions that the spans subtend.

A region always has the same number of sides; a side that bounds nothing is FAR away. Errors are
some 1e-16 of the beam's light, not of the light in the region, so that a region with less than
`DIM` has no centroid.
"""

from __future__ import annotations

from math import nan, pi
from typing import Any, NamedTuple

from ..scalars.dispatch import Number, atan2, exp, select, sqrt, where_any
from .half_normal import tail_integrals
from .tail import WHOLE, swept_mass
from .vectors import Plane

Three = tuple[Any, Any, Any]

#: Distance of a side from the beam's centre, and radius of a disc, in sigmas. At this or a larger
#: value they bound nothing.
FAR = 1000.0
#: End of an unlimited side, in sigmas.
ENDLESS = 1e100
#: Fraction of the beam's light below which a cut region has no centroid, because nine of its digits
#: are lost.
DIM = 1e-7


class SideLine(NamedTuple):
    """A side's line: the distance of the beam's centre inside it, and its outward unit normal."""

    distance: Any
    x: Any
    y: Any


#: The moments of order 0, 1 and 2 of f along each of eight sides that bound nothing, see `region`.
NO_SPANS: tuple[Three, ...] = ((0.0, 0.0, 0.0),) * 8


def region(sides: tuple[SideLine, ...], radius: Number) -> tuple[Any, Plane, tuple[Three, ...]]:
    """Mass and centroid of the light inside the sides and the disc, and the moments of f of order
    0, 1 and 2 along each side. The centroid is NaN where the mass is below DIM."""
    bounded = radius < FAR
    rim = select(bounded, exp(-radius * radius / 2), 0.0)
    lows, highs = spans(sides, radius)
    mass, x, y, arcs, inside = 0.0, 0.0, 0.0, 0.0, 1.0
    moments = []
    for side, low, high in zip(sides, lows, highs, strict=True):
        inside = select(side.distance < 0, 0.0, inside)
        nothing = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        alive = (low < high) & (side.distance < FAR)
        swept, excess, arc, length, first, second = where_any(
            alive, nothing, span, low, high, side.distance, rim
        )
        mass, arcs = mass + swept, arcs + arc
        x, y = x - side.x * excess, y - side.y * excess
        moments.append((length, first, second))
    mass = mass + (1 - rim) * (inside - arcs)
    has_place = mass > DIM
    inverse = select(has_place, 1 / select(has_place, mass, 1.0), nan)
    return select(mass > 0, mass, 0.0), (x * inverse, y * inverse), tuple(moments)


def spans(sides: tuple[SideLine, ...], radius: Number) -> tuple[list[Any], list[Any]]:
    """The ends, low and high, of each side's span inside the other sides and the disc; where the
    span is empty, low is not below high."""
    lows, highs = [], []
    for side in sides:
        square = (radius - side.distance) * (radius + side.distance)
        meets = square > 0
        half = select(radius < FAR, sqrt(select(meets, square, 0.0)), ENDLESS)
        lows.append(-half)
        highs.append(half)
    for j, side in enumerate(sides):
        for i, other in enumerate(sides[:j]):
            cosine = side.x * other.x + side.y * other.y
            turn = other.y * side.x - other.x * side.y
            lows[j], highs[j] = cut_span(
                lows[j], highs[j], other.distance - side.distance * cosine, turn, other
            )
            lows[i], highs[i] = cut_span(
                lows[i], highs[i], side.distance - other.distance * cosine, -turn, side
            )
    return lows, highs


def cut_span(low: Number, high: Number, rest: Number, rate: Number, other: SideLine) -> Plane:
    """The part of a span inside another side, where rest - rate s > 0."""
    counts = other.distance < FAR
    crosses = abs(rate) > 0
    end = rest / select(crosses, rate, 1.0)
    upper = select(rate > 0, end, select((rest < 0) & (rate <= 0) & (rate >= 0), low, high))
    lower = select(rate < 0, end, low)
    high = select(counts & (upper < high), upper, high)
    low = select(counts & (lower > low), lower, low)
    return low, high


def span(low: Number, high: Number, d: Number, rim: Number) -> tuple[Any, Any, Any, Any, Any, Any]:
    """The integrals along a side from low to high.

    These are the mass that it sweeps over, the excess of f along it over the density on the disc's
    rim, and the fraction of a turn that it subtends. The last three are the moments of f of order
    0, 1 and 2.

    d: the side's distance.  rim: exp(-radius^2 / 2).
    """
    across = exp(-d * d / 2)
    to_low, to_high = exp(-low * low / 2), exp(-high * high / 2)
    tail_low, tail_high = (
        to_low * tail_integrals(abs(low))[0],
        to_high * tail_integrals(abs(high))[0],
    )
    both = select(
        low > 0,
        tail_low - tail_high,
        select(high < 0, tail_high - tail_low, WHOLE - tail_low - tail_high),
    )
    length = across * both / (2 * pi)
    at_low, at_high = across * to_low / (2 * pi), across * to_high / (2 * pi)
    excess = length - select(rim > 0, rim * (high - low) / (2 * pi), 0.0)
    swept = swept_mass(low, d, to_low, across, tail_low)
    swept = swept - swept_mass(high, d, to_high, across, tail_high)
    arc = atan2(d * (high - low), d * d + low * high) / (2 * pi)
    return swept, excess, arc, length, at_low - at_high, length + low * at_low - high * at_high


def slopes_of_region(
    lines: tuple[Any, ...], moments: tuple[Three, ...], mass: Number, centroid: Plane
) -> Three:
    """The derivatives of the mass and the centroid of a region.

    lines: d, x, y, the derivative of d, and the rate at which it turns, of each side.  moments: of
    f along the sides, from `region`.
    """
    m, x, y = 0.0, 0.0, 0.0
    for (d, nx, ny, of_d, turn), (length, first, second) in zip(lines, moments, strict=True):
        zeroth, rise = of_d * length - turn * first, of_d * first - turn * second
        m = m + zeroth
        x, y = x + (nx * d * zeroth - ny * rise), y + (ny * d * zeroth + nx * rise)
    return m, (x - centroid[0] * m) / mass, (y - centroid[1] * m) / mass
