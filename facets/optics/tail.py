"""Light far off the beam's centre: along a side, and in a wedge that contains little of it.

The divergence theorem of `wedge` loses digits where its result is a small difference. Here all
terms are positive, and all sums have the same length. There are two methods, each with one
Gauss-Legendre rule:

- `slices` cuts the wedge parallel to its brighter side. The integrals along a slice are closed
  (`half_normal`), and the rule runs over the slices up to the end of the light.
- `rays` runs over the angle of rays from the wedge's point, along which the integrals are closed,
  too. It is for wedges narrower than NARROW that pass the beam's centre, where slices end too
  steeply. A mirror has such wedges only when it is turned by more than a radian.

Along a ray q + s u, with a = q . u and h = q x u, the coordinate v = s + a counts from the ray's
foot, the point nearest to the beam's centre. Places are measured from the brighter side's foot, or
from q where that side does not pass the centre, and light in units of the density there. Then
nothing underflows before the light itself does, and no large terms cancel.
"""

from __future__ import annotations

from math import cos as cosine_of, nan, pi, sqrt as root_of
from typing import Any, NamedTuple

from ..scalars.dispatch import (
    Number,
    atan2,
    cos,
    exp,
    round_product,
    select,
    sin,
    sqrt,
    sum_over,
    where_any,
)
from .central import Side
from .half_normal import tail_integrals
from .vectors import Plane, dot2

#: Integrals over the light in a wedge of 1, x, y, x^2, x y and y^2.
Sums = tuple[Any, Any, Any, Any, Any, Any]
#: (mass, centroid, 1 - covariance, centroid - q), see `wedge.wedges`.
Moments = tuple[Any, Plane, tuple[Any, Any, Any], Plane]

#: Gauss-Legendre, 24 nodes on (0, 1): nodes and weights.
NODES = (
    (0.00240639000148932, 0.0061706148999936),
    (0.012635722014345251, 0.014265694314466832),
    (0.030862723998633622, 0.022138719408709904),
    (0.056792236497799485, 0.02964929245771839),
    (0.08999900701304854, 0.03667324070554015),
    (0.12993790421072282, 0.04309508076597664),
    (0.17595317403151223, 0.04880932605205694),
    (0.22728926430558022, 0.05372213505798282),
    (0.2831032461869774, 0.0577528340268628),
    (0.3424786601519183, 0.060835236463901696),
    (0.40444056626319186, 0.06291872817341415),
    (0.4679715535686972, 0.06396909767337608),
    (0.5320284464313028, 0.06396909767337608),
    (0.5955594337368082, 0.06291872817341415),
    (0.6575213398480817, 0.060835236463901696),
    (0.7168967538130225, 0.0577528340268628),
    (0.7727107356944197, 0.05372213505798282),
    (0.8240468259684878, 0.04880932605205694),
    (0.8700620957892772, 0.04309508076597664),
    (0.9100009929869515, 0.03667324070554015),
    (0.9432077635022005, 0.02964929245771839),
    (0.9691372760013663, 0.022138719408709904),
    (0.9873642779856547, 0.014265694314466832),
    (0.9975936099985107, 0.0061706148999936),
)
#: Light below exp(-NEGLIGIBLE) = 3e-17 of the brightest is neglected.
NEGLIGIBLE = 38.0
#: Cosine of the opening, 2.3 rad, above which a wedge is halved first.
WIDE = cosine_of(2.3)
#: Cosine of the opening, 0.65 rad, below which a wedge is narrow, if its darker side also passes
#: the beam's centre, at an angle whose tangent is above PASSES.
NARROW, PASSES = cosine_of(0.65), 0.07
#: Upper bound of exponents: exp of it is larger than any number with an effect.
LARGE = 700.0
#: The integral of exp(-x^2/2).
WHOLE = root_of(2 * pi)
NOTHING = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


# Sums of products and Gaussians without the rounding errors of large numbers.


def product(a: float, b: float) -> tuple[float, float]:
    """The product a b exactly: the rounded product and its error (Dekker)."""
    rounded = round_product(a * b)
    # 2^27 + 1 splits a float in two halves.
    big_a, big_b = round_product(134217729.0 * a), round_product(134217729.0 * b)
    high_a, high_b = big_a - (big_a - a), big_b - (big_b - b)
    low_a, low_b = a - high_a, b - high_b
    missing = ((high_a * high_b - rounded) + high_a * low_b + low_a * high_b) + low_a * low_b
    return rounded, missing


def sum_of_products(a: float, b: float, c: float, d: float) -> tuple[float, float]:
    """The sum a b + c d to twice a float's precision: a float and its error."""
    first, first_missing = product(a, b)
    second, second_missing = product(c, d)
    total = first + second
    part = total - first
    missing = (first - (total - part)) + (second - part) + first_missing + second_missing
    rounded = total + missing
    return rounded, missing - (rounded - total)


def normalise(q: Plane, u: Plane) -> tuple[float, float, float]:
    """Return (q . u, q x u, the error of the latter), where u is normalised to twice its digits."""
    square, missing = sum_of_products(u[0], u[0], u[1], u[1])
    excess = ((square - 1) + missing) / 2
    a, _ = sum_of_products(q[0], u[0], q[1], u[1])
    h, h_missing = sum_of_products(q[0], u[1], -q[1], u[0])
    return a - a * excess, h, h_missing - h * excess


def gauss(x: float, missing: float) -> float:
    """exp(-(x + missing)^2 / 2), however large x."""
    square, square_missing = product(x, x)
    return exp(-square / 2) * (1 - square_missing / 2 - x * missing)  # type: ignore[no-any-return]


def gauss_of_point(q: Plane) -> float:
    """exp(-|q|^2 / 2) / 2 pi, however far the point."""
    square, missing = sum_of_products(q[0], q[0], q[1], q[1])
    return exp(-square / 2) * (1 - missing / 2) / (2 * pi)  # type: ignore[no-any-return]


def far_side(q: Plane, u: Plane) -> Side:
    """The integrals of one of `wedge.sides`, at any distance of its point from the beam's
    centre."""
    a, h, missing = normalise(q, u)
    along, across, density = exp(-a * a / 2), gauss(h, missing), gauss_of_point(q)
    zeroth, first, second = tail_integrals(abs(a))
    towards = a < 0
    length = select(towards, across / WHOLE - density * zeroth, density * zeroth)
    to_first = select(towards, density - a * length, density * first)
    to_second = select(towards, length - a * to_first, density * second)
    swept = swept_mass(a, h, along, across, along * zeroth)
    return length, to_first, to_second, swept


def swept_mass(a: Number, h: Number, along: Number, across: Number, tail: Number) -> Number:
    """The mass that a side sweeps over, see `wedge.swept_mass`, at any distance.

    along, across: exp(-a^2/2), exp(-h^2/2).  tail: the integral of exp(-x^2/2) beyond |a|.

    It is a term with erf, and (arctan t) / 2 pi minus Owen's T(x, t), where x is the larger of a
    and h, and t the smaller over the larger. The integrand of T is smooth, and negligible beyond
    8.6 / x.
    """
    tail = tail * (2 / WHOLE)
    beyond = select(a < 0, 2 - tail, tail)
    within = 1 - across * tail_integrals(abs(h))[0] * (2 / WHOLE)
    within = select(h < 0, -within, within)
    wide = abs(a) > abs(h)
    larger, smaller = select(wide, a, h), select(wide, h, a)
    larger = select(abs(larger) > 0, larger, 1.0)
    t = smaller / larger
    size, end = abs(t), 43 / (5 * abs(larger))
    end = select(size < end, size, end)
    owen = sum_over(owen_term, NODES, end, larger * larger / 2)[0]
    owen = owen * end * select(wide, along, across)
    rest = (atan2(t, 1.0) - select(t < 0, -owen, owen)) / (2 * pi)
    return select(wide, beyond * within / 4 + rest, within / 4 - rest)


def owen_term(node: Number, weight: Number, end: Number, half_square: Number) -> tuple[Any]:
    """One term of the quadrature of Owen's T function."""
    square = (end * node) * (end * node)
    return (exp(-half_square * square) * (weight / (1 + square)),)


class BrighterSide(NamedTuple):
    """The brighter side of a wedge, from which places in the wedge are measured.

    a, h: q . u and q x u.  u: its direction.  sense: 1 where the wedge opens counter-clockwise from
    it, else -1.  near: whether it passes the beam's centre. Moments are then about its foot, else
    about q.  scale: 2 pi times the density f at that point.
    """

    a: Any
    h: Any
    u: Plane
    sense: Any
    near: Any
    scale: Any


class Cut(NamedTuple):
    """A wedge in the frame of one of its sides, for `slices` and `rays`.

    a: q . u of the side.  beyond: distance of the side from the beam's centre, positive where the
    centre is outside the wedge, in sigmas.  c, s: cosine and sine of the wedge's opening.  near: 1
    where moments are about the side's foot, 0 where they are about q.  light: f at q over f at the
    foot.
    """

    a: Any
    beyond: Any
    c: Any
    s: Any
    near: Any
    light: Any


def tail_wedge(q: Plane, u1: Plane, u2: Plane) -> Moments:
    """The moments of one of `wedge.wedges` without cancellation; no light beyond some 37 sigmas."""
    (a1, h1, error1), (a2, h2, error2) = normalise(q, u1), normalise(q, u2)
    square, missing = sum_of_products(q[0], q[0], q[1], q[1])
    sine = sum_of_products(u1[0], u2[1], -u1[1], u2[0])[0]
    swap = a2 < a1
    a, h, error = select(swap, a2, a1), select(swap, h2, h1), select(swap, error2, error1)
    near, sense = a < -1, select(swap, -1.0, 1.0)
    scale = select(near, gauss(h, error), exp(-square / 2) * (1 - missing / 2))
    side = BrighterSide(a, h, select_both(swap, u2, u1), sense, near, scale)
    faces_light = sine > 0  # else the light comes from behind
    flag, light = select(near, 1.0, 0.0), exp(-a * a / 2)
    brighter = Cut(a, -sense * h, dot2(u1, u2), select(faces_light, sine, 1.0), flag, light)
    darker = brighter._replace(a=select(swap, a1, a2), beyond=select(swap, -h1, h2), near=0.0)
    sums = sums_over(side, brighter, darker, select_both(swap, u1, u2))
    mass = select(faces_light, scale * sums[0], 0.0)
    return moments_of(side, q, sums, select(mass > 0, mass, 0.0))


def select_both(condition: Any, a: Plane, b: Plane) -> Plane:
    """Apply `select` to both components of two vectors."""
    return select(condition, a[0], b[0]), select(condition, a[1], b[1])


def sums_over(side: BrighterSide, brighter: Cut, darker: Cut, v: Plane) -> Sums:
    """The sums over a wedge about the side's foot, or about q.

    brighter, darker: the wedge in the frames of its two sides.  v: direction of the darker side.
    """
    u, near, wide = side.u, side.near, brighter.c < WIDE
    # Each half is measured from its own side, because an angle near pi has a large rounding error.
    c = select(wide, sqrt((1 + brighter.c) / 2), brighter.c)
    s = select(wide, sqrt((1 - brighter.c) / 2), brighter.s)
    sums = slices(brighter._replace(c=c, s=s), u, side.sense)
    rest = where_any(wide, NOTHING, slices, darker._replace(c=c, s=s), v, -side.sense)
    rest = shift_sums(
        rest,
        select(near, brighter.light, 1.0),
        select(near, brighter.a * u[0], 0.0),
        select(near, brighter.a * u[1], 0.0),
    )
    passes = darker.a < -PASSES * abs(brighter.beyond)
    narrow = near & passes & (brighter.c > NARROW)
    return where_any(narrow, add_sums(sums, rest), rays, brighter, u, side.sense)  # type: ignore[no-any-return]


def add_sums(a: Sums, b: Sums) -> Sums:
    """The sums of the six components of a and b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5]


def shift_sums(sums: Sums, factor: Number, x: Number, y: Number) -> Sums:
    """The sums times a factor, about another point.  x, y: the old point relative to the new."""
    mass, px, py = factor * sums[0], factor * sums[1], factor * sums[2]
    return (
        mass,
        px + mass * x,
        py + mass * y,
        factor * sums[3] + 2 * px * x + mass * x * x,
        factor * sums[4] + px * y + py * x + mass * x * y,
        factor * sums[5] + 2 * py * y + mass * y * y,
    )


def turn_sums(sums: Sums, u: Plane, w: Plane) -> Sums:
    """The sums for places t u + r w, from the sums of 1, t, r, t^2, t r and r^2."""
    mass, t, r, tt, tr, rr = sums
    return (
        mass,
        t * u[0] + r * w[0],
        t * u[1] + r * w[1],
        tt * u[0] * u[0] + 2 * tr * u[0] * w[0] + rr * w[0] * w[0],
        tt * u[0] * u[1] + tr * (u[0] * w[1] + u[1] * w[0]) + rr * w[0] * w[1],
        tt * u[1] * u[1] + 2 * tr * u[1] * w[1] + rr * w[1] * w[1],
    )


def moments_of(side: BrighterSide, q: Plane, sums: Sums, mass: Number) -> Moments:
    """The moments of a wedge from its sums; NaN without light."""
    lit, near, u = mass > 0, side.near, side.u
    inverse = select(lit, 1 / select(lit, sums[0], 1.0), nan)
    x, y = sums[1] * inverse, sums[2] * inverse
    spread = (
        1 - sums[3] * inverse + x * x,
        x * y - sums[4] * inverse,
        1 - sums[5] * inverse + y * y,
    )
    foot = select(near, side.h * u[1], q[0]), select(near, -side.h * u[0], q[1])
    ahead = select(near, side.a, 0.0)
    return mass, (foot[0] + x, foot[1] + y), spread, (x - ahead * u[0], y - ahead * u[1])


def slices(cut: Cut, u: Plane, sense: Number) -> Sums:
    """The sums over a wedge by slices parallel to a side.  u, sense: see `BrighterSide`."""
    end = last_slice(cut)
    sums = sum_over(slice_term, NODES, end, cut)
    size, base = end * cut.s / (2 * pi), select(cut.near > 0, 0.0, cut.c)
    across = base * u[0] - sense * cut.s * u[1], base * u[1] + sense * cut.s * u[0]
    return turn_sums(shift_sums(sums, size, 0.0, 0.0), u, across)


def last_slice(cut: Cut) -> Number:
    """The end of the slices' light, along the darker side, in sigmas."""
    a, beyond, c, s, near, _ = cut
    a2, largest = a * c + beyond * s, root_of(2 * NEGLIGIBLE)
    end = 2 * NEGLIGIBLE / (sqrt(a2 * a2 + 2 * NEGLIGIBLE) + a2)
    # The light of slices that start past the centre decreases with `beyond` alone.
    past_centre = (sqrt(beyond * beyond + 2 * NEGLIGIBLE + a * a) - beyond) / s
    past = select(c < 0, -a / select(c < 0, c, 1.0), end)
    start = select(past < end, past, end)
    far = select(a + end * c < 0, select(past_centre > start, past_centre, start), end)
    depth = 2 * NEGLIGIBLE / ((sqrt(beyond * beyond + 2 * NEGLIGIBLE) + beyond) * s)
    short = select(c > 0, (largest - a) / select(c > 0, c, 1.0), depth)
    return select(near > 0, select(short < depth, short, depth), far)


def slice_term(node: Number, weight: Number, end: Number, cut: Cut) -> Sums:
    """The sums of 1, t, r, t^2, t r and r^2 over one slice: t is the place along the slice, r the
    distance of the slice."""
    a, beyond, c, s, _, _ = cut
    near, r = cut.near > 0, end * node
    start, rise = a + r * c, r * s
    towards, square = start < 0, start * start / 2
    light = exp_at_most(select(near, -square, select(towards, square, 0.0)))
    m0, m1, m2 = tail_integrals(abs(start))
    tail = select(near, light * m0, m0)
    zeroth = select(towards, select(near, WHOLE, WHOLE * light) - tail, tail)
    away = select(towards, 1 - start * zeroth, m1)
    first = select(near, light, away)
    second = select(near, zeroth + start * light, select(towards, zeroth - start * away, m2))
    fall = select(near, rise * (beyond + rise / 2), r * (a * c + beyond * s + r / 2))
    factor = weight * exp_at_most(-fall)
    zeroth, first = factor * zeroth, factor * first
    return zeroth, first, r * zeroth, factor * second, r * first, r * r * zeroth


def exp_at_most(x: Number) -> Number:
    """The smaller of exp(x) and exp(LARGE); x is larger where light meets a facet from behind."""
    return exp(select(x < LARGE, x, LARGE))


def rays(cut: Cut, u: Plane, sense: Number) -> Sums:
    """The sums over a narrow wedge that passes the beam's centre, by the angle of its rays."""
    square = cut.a * cut.a + cut.beyond * cut.beyond
    centre = -atan2(cut.beyond, -cut.a)  # the ray's angle through the beam's centre
    ahead = cut.beyond > 0
    depth = select(ahead, cut.beyond, 0.0)
    end = ray_angle(depth * depth + 2 * NEGLIGIBLE, square) + centre
    opening = atan2(cut.s, cut.c)
    end = select(opening < end, opening, end)
    begin = centre - ray_angle(2 * NEGLIGIBLE, square)
    begin = select(begin > 0, begin, 0.0)
    middle = select(ahead, 0.0, centre)
    before = where_any(cut.beyond < 0, NOTHING, rays_between, begin, middle, cut)
    sums = add_sums(rays_between(middle, end, cut), before)
    return turn_sums(sums, u, (-sense * u[1], sense * u[0]))


def rays_between(begin: Number, end: Number, cut: Cut) -> Sums:
    """The sums over rays between two angles."""
    return sum_over(ray_term, NODES, begin, end, cut)  # type: ignore[no-any-return]


def ray_angle(height: Number, square: Number) -> Number:
    """The angle between the ray through the beam's centre and a ray that passes the centre at a
    certain distance; a quarter turn if no ray passes at this distance.

    height, square: squares of this distance and of the distance of q, in sigmas squared.
    """
    rest = square - height
    return atan2(sqrt(height), sqrt(select(rest > 0, rest, 0.0)))


def ray_term(node: Number, weight: Number, begin: Number, end: Number, cut: Cut) -> Sums:
    """The sums of `slice_term` over the rays about one angle; r is the distance from the brighter
    side."""
    a, beyond, _, _, _, light = cut
    angle = begin + (end - begin) * node
    c, s, half = cos(angle), sin(angle), sin(angle / 2)
    along, rise = a * c + beyond * s, -a * s - 2 * beyond * half * half
    towards = along < 0
    m0, m1, m2 = tail_integrals(abs(along))
    length = WHOLE * exp(-rise * (rise + 2 * beyond) / 2) - light * m0
    zeroth = select(towards, light - along * length, light * m1)
    first = select(towards, length, light * m2)
    second = select(towards, zeroth + light, 2 * light * m1 - along * light * m2)
    # from the ray's foot, or from q, to the brighter side's foot
    x, y = select(towards, s * (a * s - beyond * c), a), select(towards, -s * along, 0.0)
    sums = turn_sums((zeroth, first, 0.0, second, 0.0, 0.0), (c, s), (0.0, 0.0))
    return shift_sums(sums, weight * (end - begin) / (2 * pi), x, y)
