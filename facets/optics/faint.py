"""A normal distribution over a wedge that holds little of it: no term cancels, for floats.

In polar coordinates about the wedge's point q, mass, first and second moments are integrals over
the angle of I1, I2 u and I3 u u', where I_n(a, h) = int_0^inf s^n f(q + s u) ds > 0 is closed.
The angle is integrated by adaptive Gauss-Legendre quadrature. Slower than the divergence theorem,
and asked only where that has lost digits: in the tail of the beam and for narrow wedges.
"""

from __future__ import annotations

from math import atan2, cos, erfc, exp, pi, sin, sqrt

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
#: More pieces than this have never been needed: a bound, so that no input can hang the loop.
PIECES = 5000


def radial(a: float, h: float, density: float) -> tuple[float, float, float]:
    """I1, I2, I3 = int_0^inf s^n f ds along a ray with a = q . u, h = q x u, each to rounding.

    density: f(q). Where the ray points away from the light (a > 1.5) the recurrence
    I_n+1 = n I_n-1 - a I_n cancels; its continued fraction I_n / I_n-1 = n / (a + I_n+1 / I_n) has
    positive terms only.
    """
    if a < 1.5:
        # exp(-h^2/2), by whichever of the two squares is smaller: its rounding is amplified less
        across = exp(-h * h / 2) if -a > abs(h) else 2 * pi * density * exp(a * a / 2)
        i0 = across * erfc(a / sqrt(2)) / (2 * sqrt(2 * pi))
        i1 = density - a * i0
        i2 = i0 - a * i1
        return i1, i2, 2 * i1 - a * i2
    ratio = 0.0
    for n in range(int(20 + 200 / (a * a)), 3, -1):
        ratio = n / (a + ratio)
    ratio3 = 3 / (a + ratio)
    ratio2 = 2 / (a + ratio3)
    ratio1 = 1 / (a + ratio2)
    i1 = density * ratio1 / (a + ratio1)  # f(q) = I1 + a I0
    return i1, i1 * ratio2, i1 * ratio2 * ratio3


def piece(q: Plane, u: Plane, density: float, start: float, stop: float) -> Sums:
    """One Gauss-Legendre panel, angles counted from u: I1, I2 x, I2 y, I3 xx, I3 xy, I3 yy."""
    middle, half = (start + stop) / 2, (stop - start) / 2
    mass = x = y = xx = xy = yy = 0.0
    for k in range(12):
        node = NODES[k // 2] if k % 2 else -NODES[k // 2]
        c, s = cos(middle + half * node), sin(middle + half * node)
        ux, uy = u[0] * c - u[1] * s, u[1] * c + u[0] * s
        i1, i2, i3 = radial(q[0] * ux + q[1] * uy, q[0] * uy - q[1] * ux, density)
        weight = half * WEIGHTS[k // 2]
        mass += weight * i1
        x += weight * i2 * ux
        y += weight * i2 * uy
        xx += weight * i3 * ux * ux
        xy += weight * i3 * ux * uy
        yy += weight * i3 * uy * uy
    return mass, x, y, xx, xy, yy


def added(a: Sums, b: Sums) -> Sums:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5]


def agree(coarse: Sums, fine: Sums, total: Sums, tolerance: float) -> bool:
    """Whether a piece and its halves agree in mass and spread, within what is summed so far."""
    spread, known = fine[3] + fine[5], total[3] + total[5]
    return abs(fine[0] - coarse[0]) <= tolerance * (fine[0] + total[0]) and abs(
        spread - coarse[3] - coarse[5]
    ) <= tolerance * (spread + known)


def sums(q: Plane, u: Plane, opening: float) -> Sums:
    """The six sums over the angle from u, halved until each piece agrees with its two halves."""
    q2 = q[0] * q[0] + q[1] * q[1]
    density = exp(-q2 / 2) / (2 * pi)
    # agreement of halves leaves an error 2^-24 times smaller; finer than rounding is never asked
    tolerance = 2e-14 * (1 + q2 / 40)
    total = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    width = opening
    depth = index = 0  # the piece in hand: number `index` of the 2^depth equal pieces
    coarse = piece(q, u, density, 0.0, opening)
    for _ in range(PIECES):
        start = index * width
        left = piece(q, u, density, start, start + width / 2)
        right = piece(q, u, density, start + width / 2, start + width)
        fine = added(left, right)
        if not agree(coarse, fine, total, tolerance):
            coarse = left
            width /= 2
            depth += 1
            index *= 2
            continue
        total = added(total, fine)
        index += 1
        while depth > 0 and index % 2 == 0:
            index //= 2
            depth -= 1
            width *= 2
        if depth == 0:
            return total
        coarse = piece(q, u, density, index * width, (index + 1) * width)
    nan = float("nan")
    return nan, nan, nan, nan, nan, nan


def faint(q: Plane, u1: Plane, u2: Plane) -> tuple[float, Plane, tuple[float, float, float]]:
    """What `wedge` gives, for a wedge of small mass; NaN where no light is left at all."""
    opening = atan2(u1[0] * u2[1] - u1[1] * u2[0], u1[0] * u2[0] + u1[1] * u2[1])
    mass, x, y, xx, xy, yy = sums(q, u1, opening)
    if not mass > 0:
        nan = float("nan")
        return mass, (nan, nan), (nan, nan, nan)
    cx, cy = x / mass, y / mass
    return (
        mass,
        (q[0] + cx, q[1] + cy),
        (1 - xx / mass + cx * cx, cx * cy - xy / mass, 1 - yy / mass + cy * cy),
    )
