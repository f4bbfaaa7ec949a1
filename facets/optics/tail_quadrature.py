"""A normal distribution over a wedge that holds little of it, without cancellation, for floats.

It is slower than the divergence theorem and used only where that has lost digits: in the tail of
the beam and for narrow wedges. There are two methods, both sums of positive terms.

`slices`, for wedges as a mirror has them: the wedge is cut parallel to its brighter side, the
integrals along a slice are closed (`half_normal`), and one Gauss-Legendre rule of fixed length runs
over the slices, as far as there is light.

`integrate`, for narrow wedges: in polar coordinates about the wedge's point q, mass and moments are
integrals over the angle of radial integrals that are closed; adaptive in the angle, and a hundred
times slower.

Along a ray q + s u, with a = q . u and h = q x u, let v = s + a count from the ray's foot, the
point nearest to the beam's centre. With L = int f ds, the integrals of s f, s v f and s v^2 f are
I = f(q) - a L, L and I + f(q). All is measured from the brighter side's foot and in units of the
light there, so that nothing underflows before the light itself does and nothing large cancels.
"""

from __future__ import annotations

from math import atan2, cos, erfc, exp, pi, sin, sqrt
from typing import NamedTuple

import numpy as np

from .compensated import gauss, normalise, sum_of_products
from .half_normal import half_normal

Plane = tuple[float, float]
Sums = tuple[float, float, float, float, float, float]

# Gauss-Legendre, 12 nodes on (-1, 1): positive half
NODES = (
    0.12523340851146892,
    0.3678314989981802,
    0.5873179542866175,
    0.7699026741943047,
    0.9041172563704749,
    0.9815606342467192,
)
WEIGHTS = (
    0.24914704581340277,
    0.2334925365383548,
    0.20316742672306592,
    0.16007832854334622,
    0.10693932599531843,
    0.04717533638651183,
)
# Gauss-Legendre, 24 nodes on (0, 1): nodes and weights
SLICES = np.array(
    [
        [0.00240639000148932, 0.0061706148999936],
        [0.012635722014345251, 0.014265694314466832],
        [0.030862723998633622, 0.022138719408709904],
        [0.056792236497799485, 0.02964929245771839],
        [0.08999900701304854, 0.03667324070554015],
        [0.12993790421072282, 0.04309508076597664],
        [0.17595317403151223, 0.04880932605205694],
        [0.22728926430558022, 0.05372213505798282],
        [0.2831032461869774, 0.0577528340268628],
        [0.3424786601519183, 0.060835236463901696],
        [0.40444056626319186, 0.06291872817341415],
        [0.4679715535686972, 0.06396909767337608],
        [0.5320284464313028, 0.06396909767337608],
        [0.5955594337368082, 0.06291872817341415],
        [0.6575213398480817, 0.060835236463901696],
        [0.7168967538130225, 0.0577528340268628],
        [0.7727107356944197, 0.05372213505798282],
        [0.8240468259684878, 0.04880932605205694],
        [0.8700620957892772, 0.04309508076597664],
        [0.9100009929869515, 0.03667324070554015],
        [0.9432077635022005, 0.02964929245771839],
        [0.9691372760013663, 0.022138719408709904],
        [0.9873642779856547, 0.014265694314466832],
        [0.9975936099985107, 0.0061706148999936],
    ]
)
#: Slices with less than exp(-ENOUGH) of the brightest one's light are left out: 3e-17.
ENOUGH = 38.0
#: Openings of `slices`, rad, lie between these; a wider wedge is halved first.
NARROW_RAD, WIDE_RAD = 1.0, 2.3
#: A ray that points away from the light by more than this takes the continued fraction.
AWAY_SIGMAS = 1.5
#: Upper bound of the number of pieces, so that no input can hang the loop.
PIECES = 5000


class BrighterSide(NamedTuple):
    """The wedge's brighter side, from which angles and moments are counted.

    a, h: q . u and q x u.  u: its direction.  sense: 1 where the wedge opens counter-clockwise.
    near: whether it runs well towards the beam's centre first: moments then count from its foot,
    else from q.  light: f(q), in units of `scale`.
    """

    a: float
    h: float
    u: Plane
    sense: float
    near: bool
    light: float
    scale: float


def brighter_side(q: Plane, u1: Plane, u2: Plane) -> BrighterSide:
    a1, h1, h1_error = normalise(q, u1)
    a2, h2, h2_error = normalise(q, u2)
    a, h, error, u, sense = a1, h1, h1_error, u1, 1.0
    if a2 < a1:
        a, h, error, u, sense = a2, h2, h2_error, u2, -1.0
    if a < -1:
        return BrighterSide(a, h, u, sense, True, exp(-a * a / 2) / (2 * pi), gauss(h, error))
    square, square_error = sum_of_products(q[0], q[0], q[1], q[1])
    scale = exp(-square / 2) * (1 - square_error / 2)
    return BrighterSide(a, h, u, sense, False, 1 / (2 * pi), scale)


def other_side(q: Plane, side: BrighterSide, u1: Plane, u2: Plane) -> BrighterSide:
    """The darker side in the units of the brighter one, with moments about q."""
    u = u2 if side.sense > 0 else u1
    a, h, _ = normalise(q, u)
    return BrighterSide(a, h, u, -side.sense, False, side.light, side.scale)


def tail_integrals(a: float) -> tuple[float, float, float]:
    """int s^n exp(-s^2/2 - a s) ds from 0 up, for n = 1, 2, 3 and a > 0.

    I_n / I_n-1 = n / (a + I_n+1 / I_n), a continued fraction of positive terms, where the
    recurrence I_n+1 = n I_n-1 - a I_n would cancel; and I1 + a I0 = 1.
    """
    last = int(30 + 260 / (a * a))
    ratio = (sqrt(a * a + 4 * last) - a) / 2  # This is its value for large n.
    for n in range(last, 3, -1):
        ratio = n / (a + ratio)
    ratio3 = 3 / (a + ratio)
    ratio2 = 2 / (a + ratio3)
    ratio1 = 1 / (a + ratio2)
    i1 = ratio1 / (a + ratio1)
    return i1, i1 * ratio2, i1 * ratio2 * ratio3


def moments(i1: float, i2: float, i3: float, u: Plane, w: Plane) -> Sums:
    """Of x = v u + w, from the integrals I1, I2, I3 of 1, v and v^2: 1, x, y, xx, xy, yy."""
    return (
        i1,
        i2 * u[0] + i1 * w[0],
        i2 * u[1] + i1 * w[1],
        i3 * u[0] * u[0] + 2 * i2 * u[0] * w[0] + i1 * w[0] * w[0],
        i3 * u[0] * u[1] + i2 * (u[0] * w[1] + u[1] * w[0]) + i1 * w[0] * w[1],
        i3 * u[1] * u[1] + 2 * i2 * u[1] * w[1] + i1 * w[1] * w[1],
    )


def ray_integrals(side: BrighterSide, angle: float) -> Sums:
    """The radial integrals along the ray at an angle from the brighter side."""
    c, s, s_half = cos(angle), sin(angle), sin(angle / 2)
    a, h, u = side.a, side.h, side.u
    ux, uy = u[0] * c - u[1] * s, u[1] * c + u[0] * s
    along = a * c - h * s
    if along > AWAY_SIGMAS:
        i1, i2, i3 = tail_integrals(along)
        w = (a * u[0], a * u[1]) if side.near else (0.0, 0.0)
        return moments(side.light * i1, side.light * i2, side.light * i3, (ux, uy), w)
    if side.near:
        # These are differences from the side itself, each small where the light is.
        rise, tip = a * s - 2 * h * s_half * s_half, 2 * s_half * s_half
        across = exp(-rise * (rise + 2 * h) / 2)
        dx, dy = -tip * u[0] - s * u[1], -tip * u[1] + s * u[0]
        w = (rise * uy + h * dy, -rise * ux - h * dx)
    else:
        across = exp(along * along / 2)
        w = (-along * ux, -along * uy)
    length = across * erfc(along / sqrt(2)) / (2 * sqrt(2 * pi))
    i1 = side.light - along * length
    return moments(i1, length, i1 + side.light, (ux, uy), w)


def add_sums(a: Sums, b: Sums, weight: float) -> Sums:
    return (
        a[0] + weight * b[0],
        a[1] + weight * b[1],
        a[2] + weight * b[2],
        a[3] + weight * b[3],
        a[4] + weight * b[4],
        a[5] + weight * b[5],
    )


def panel_sums(side: BrighterSide, start: float, stop: float) -> Sums:
    """The six sums over a range of angles by one Gauss-Legendre rule."""
    middle, half = (start + stop) / 2, (stop - start) / 2
    total = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for k in range(12):
        node = NODES[k // 2] if k % 2 else -NODES[k // 2]
        angle = side.sense * (middle + half * node)
        total = add_sums(total, ray_integrals(side, angle), half * WEIGHTS[k // 2])
    return total


def sums_agree(coarse: Sums, fine: Sums, total: Sums) -> bool:
    """Whether a piece and its halves agree in mass and spread, relative to the sum so far.

    Agreement to 2e-14 leaves an error 2^-24 times smaller; a finer limit would test rounding.
    """
    spread, known = fine[3] + fine[5], total[3] + total[5]
    return abs(fine[0] - coarse[0]) <= 2e-14 * (fine[0] + total[0]) and abs(
        spread - coarse[3] - coarse[5]
    ) <= 2e-14 * (spread + known)


def integrate(side: BrighterSide, opening: float) -> Sums:
    """The six sums over the wedge; each piece is halved until it agrees with its two halves."""
    total = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    width = opening
    depth = index = 0  # The current piece is number `index` of the 2^depth equal pieces.
    coarse = panel_sums(side, 0.0, opening)
    for _ in range(PIECES):
        start = index * width
        left = panel_sums(side, start, start + width / 2)
        fine = add_sums(left, panel_sums(side, start + width / 2, start + width), 1.0)
        if not sums_agree(coarse, fine, total):
            coarse = left
            width /= 2
            depth += 1
            index *= 2
            continue
        total = add_sums(total, fine, 1.0)
        index += 1
        while depth > 0 and index % 2 == 0:
            index //= 2
            depth -= 1
            width *= 2
        if depth == 0:
            return total
        coarse = panel_sums(side, index * width, (index + 1) * width)
    return (float("nan"), 0.0, 0.0, 0.0, 0.0, 0.0)


def far_end(a: float, h: float, a2: float, c: float, s: float) -> float:
    """The end of the light of the slices along the darker side, in sigmas; for `slices_from_point`.

    a, a2: of the brighter and the darker side.  h: distance of the brighter side's line from the
    beam's centre, positive where the wedge lies beyond it.  c, s: cosine and sine of the opening.
    """
    end = 2 * ENOUGH / (sqrt(a2 * a2 + 2 * ENOUGH) + a2)
    if a + end * c >= 0:
        return end
    # Past the start of the slices beside the centre, the light falls with h alone.
    beside = (sqrt(h * h + 2 * ENOUGH + a * a) - h) / s
    return max(beside, min(end, -a / c))


def slices_from_point(a: float, h: float, c: float, s: float) -> Sums:
    """Sums of 1, t, r, t^2, t r and r^2 over a wedge, in units of the light at its point.

    A point of the wedge is q + t u1 + r u2, u1 the brighter side.  Arguments as in `far_end`.
    """
    a2 = a * c + h * s
    end = far_end(a, h, a2, c, s)
    total = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for k in range(24):
        r = end * SLICES[k, 0]
        start = a + r * c
        i0, i1, i2 = half_normal(abs(start))
        if start < 0:
            i0 = sqrt(2 * pi) * exp(start * start / 2) - i0
            i1 = 1 - start * i0
            i2 = i0 - start * i1
        weight = SLICES[k, 1] * exp(-r * (a2 + r / 2))
        total = add_sums(total, (i0, i1, r * i0, i2, r * i1, r * r * i0), weight)
    return scale_sums(total, end * s)


def slices_from_foot(a: float, h: float, c: float, s: float) -> Sums:
    """The same where the brighter side passes the beam's centre: sums of 1, v, r, v^2, v r, r^2.

    A point of the wedge is at v along that side from the centre's foot, and r from the side. In
    units of the light at the foot.
    """
    end = 2 * ENOUGH / (sqrt(h * h + 2 * ENOUGH) + h)
    slope = c / s
    total = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for k in range(24):
        r = end * SLICES[k, 0]
        start = a + r * slope
        across = exp(-start * start / 2)
        i0 = across * half_normal(abs(start))[0]
        if start < 0:
            i0 = sqrt(2 * pi) - i0
        i2 = i0 + start * across
        weight = SLICES[k, 1] * exp(-r * (h + r / 2))
        total = add_sums(total, (i0, across, r * i0, i2, r * across, r * r * i0), weight)
    return scale_sums(total, end / (2 * pi))


def scale_sums(sums: Sums, by: float) -> Sums:
    return (sums[0] * by, sums[1] * by, sums[2] * by, sums[3] * by, sums[4] * by, sums[5] * by)


def slices(side: BrighterSide, c: float, s: float) -> Sums:
    """The six sums over a wedge, as `integrate` gives them.  c, s: of its opening."""
    x1, y1 = side.u
    h = -side.sense * side.h
    if side.near:
        mass, p, r, pp, pr, rr = slices_from_foot(side.a, h, c, s)
        x2, y2 = -side.sense * y1, side.sense * x1
    else:
        sums = slices_from_point(side.a, h, c, s)
        mass, p, r, pp, pr, rr = scale_sums(sums, side.light)
        x2, y2 = c * x1 - side.sense * s * y1, c * y1 + side.sense * s * x1
    return (
        mass,
        p * x1 + r * x2,
        p * y1 + r * y2,
        pp * x1 * x1 + 2 * pr * x1 * x2 + rr * x2 * x2,
        pp * x1 * y1 + pr * (x1 * y2 + y1 * x2) + rr * x2 * y2,
        pp * y1 * y1 + 2 * pr * y1 * y2 + rr * y2 * y2,
    )


def shift_sums(sums: Sums, x: float, y: float) -> Sums:
    """The sums about another point: x, y are the old point relative to the new one."""
    mass, px, py, xx, xy, yy = sums
    return (
        mass,
        px + mass * x,
        py + mass * y,
        xx + 2 * px * x + mass * x * x,
        xy + px * y + py * x + mass * x * y,
        yy + 2 * py * y + mass * y * y,
    )


def wedge_sums(q: Plane, side: BrighterSide, u1: Plane, u2: Plane, opening: float) -> Sums:
    """The six sums over a wedge by the method that suits its opening, about the origin of
    `side`."""
    if opening < NARROW_RAD or (side.near and side.sense * side.h > 0):
        return integrate(side, opening)
    if opening <= WIDE_RAD:
        return slices(side, cos(opening), sin(opening))
    # Each half counts from its own side, because rounding of an angle near pi would show.
    c, s = cos(opening / 2), sin(opening / 2)
    rest = slices(other_side(q, side, u1, u2), c, s)
    if side.near:
        rest = shift_sums(rest, side.a * side.u[0], side.a * side.u[1])
    return add_sums(slices(side, c, s), rest, 1.0)


def no_light() -> tuple[float, Plane, tuple[float, float, float], Plane]:
    nan = float("nan")
    return 0.0, (nan, nan), (nan, nan, nan), (nan, nan)


def wedge_by_quadrature(
    q: Plane, u1: Plane, u2: Plane
) -> tuple[float, Plane, tuple[float, float, float], Plane]:
    """The result of `wedge` for a wedge of small mass; NaN centroid if no light is left."""
    cross, _ = sum_of_products(u1[0], u2[1], -u1[1], u2[0])
    opening = atan2(cross, u1[0] * u2[0] + u1[1] * u2[1])
    side = brighter_side(q, u1, u2)
    # The point is too far, or the facet is seen from behind.
    if not (side.scale > 0 and opening > 0):
        return no_light()
    light, x, y, xx, xy, yy = wedge_sums(q, side, u1, u2, opening)
    mass = side.scale * light
    if not mass > 0:
        return no_light()
    cx, cy = x / light, y / light
    shift = (1 - xx / light + cx * cx, cx * cy - xy / light, 1 - yy / light + cy * cy)
    if side.near:
        foot = (side.h * side.u[1], -side.h * side.u[0])
        from_point = (cx - side.a * side.u[0], cy - side.a * side.u[1])
        return mass, (foot[0] + cx, foot[1] + cy), shift, from_point
    return mass, (q[0] + cx, q[1] + cy), shift, (cx, cy)
