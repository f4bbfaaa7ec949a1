"""A standard normal distribution over a convex region with straight sides, inside a disc; closed.

Where a wedge is cut by straight edges and by a disc about the beam's centre, the divergence theorem
still turns mass and moments into integrals over the sides. Each side lies on a line d n + s u, with
n its outward normal, d its distance from the beam's centre (negative where the centre lies beyond
it) and u = n turned by a quarter to the left; the other sides and the disc, of radius rho, leave a
span s0..s1 of it. The arcs need no list of their own: along them the density is constant, and the
normals and turns of a closed outline add up to zero and to a whole turn. With c = exp(-rho^2/2),

    M1 = -sum n (L - c (s1 - s0) / 2 pi)
    M0 = sum (G(s0, d) - G(s1, d)) + (1 - c) arcs

where G is `wedge.swept_mass` and arcs the share of a whole turn that the arcs subtend from the
centre: 1 or 0, as the centre lies inside or outside, less what the spans subtend.

A region always has the same number of sides; one that bounds nothing lies FAR away. Good to some
1e-16 of the whole beam, not of the light in the region: one with less than `DIM` has no place.
"""

from __future__ import annotations

from math import nan, pi
from typing import Any, NamedTuple

from ..scalars.dispatch import Number, atan2, exp, select, sqrt, where_any
from .half_normal import tail_integrals
from .tail import WHOLE, swept_mass
from .vectors import Plane

Three = tuple[Any, Any, Any]

#: A side this far from the beam's centre, in sigmas, bounds nothing, nor does a disc so wide.
FAR = 1000.0
#: Beyond all places on a side.
ENDLESS = 1e100
#: The share of the beam below which a cut region has no place, because nine digits of it are lost.
DIM = 1e-7


class SideLine(NamedTuple):
    """A side's line: the distance of the beam's centre inside it, and its outward unit normal."""

    distance: Any
    x: Any
    y: Any


#: The moments of order 0, 1 and 2 of f along each of eight sides that bound nothing, see `region`.
NO_SPANS: tuple[Three, ...] = ((0.0, 0.0, 0.0),) * 8


def region(sides: tuple[SideLine, ...], radius: Number) -> tuple[Any, Plane, tuple[Three, ...]]:
    """Mass and centroid of the light inside the sides and the disc, NaN where it has no place; and
    the moments of f of order 0, 1 and 2 along each side."""
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
    seen = mass > DIM
    share = select(seen, 1 / select(seen, mass, 1.0), nan)
    return select(mass > 0, mass, 0.0), (x * share, y * share), tuple(moments)


def spans(sides: tuple[SideLine, ...], radius: Number) -> tuple[list[Any], list[Any]]:
    """The ends, low and high, of the span of each side that the other sides and the disc leave; low
    is not below high where they leave none."""
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
    """The part of a span that another side leaves, where rest - rate s > 0."""
    counts = other.distance < FAR
    crosses = abs(rate) > 0
    end = rest / select(crosses, rate, 1.0)
    upper = select(rate > 0, end, select((rest < 0) & (rate <= 0) & (rate >= 0), low, high))
    lower = select(rate < 0, end, low)
    high = select(counts & (upper < high), upper, high)
    low = select(counts & (lower > low), lower, low)
    return low, high


def span(low: Number, high: Number, d: Number, rim: Number) -> tuple[Any, Any, Any, Any, Any, Any]:
    """The integrals of a side from low to high: the mass that it sweeps over, the excess of f along
    it over the density on the disc's rim, the share of a turn that it subtends, and the moments of
    f of order 0, 1 and 2.

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
