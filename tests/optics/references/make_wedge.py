"""High-precision moments of a normal distribution over wedges, stored in wedge.json.

    python tests/optics/references/make_wedge.py

From the definition: int over angle and radius, in polar coordinates about the wedge's point, at 50
digits. The radial integrals are written with erfc. The angle is cut where the light is and towards
both ends, and each piece integrated by a 48-node Gauss-Legendre rule; with a rule of 30 nodes,
halving the pieces changed 20 of the rows by 5e-29 at most.

The points are a grid over the domain, and those at which the float code did worst in a search.
"""

from __future__ import annotations

import json
import math
from itertools import pairwise
from pathlib import Path

import mpmath as mp
import numpy as np

from facets.optics import sides
from facets.optics.wedge import wedges

mp.mp.dps = 50
Plane = tuple[float, float]
OPENINGS = (0.01, 0.1, 1, 10, 60, 120, 170, 179, 179.99)
NAMES = ("q", "u1", "u2")
OFFSETS = (0.0, 1e-300, 1e-8, 0.3, 1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 15.0, 25.0, 35.0)


#: 48 nodes and weights on the interval from -1 to 1.
RULE = mp.calculus.quadrature.GaussLegendre(mp.mp).calc_nodes(degree=5, prec=180)


def radial(a: mp.mpf) -> tuple[mp.mpf, mp.mpf, mp.mpf]:
    """int s^n exp(-s^2/2 - a s) ds from 0 up, for n = 1, 2, 3."""
    with mp.workdps(90):  # the differences cancel
        i0 = mp.sqrt(mp.pi / 2) * mp.exp(a * a / 2) * mp.erfc(a / mp.sqrt(2))
        i1 = 1 - a * i0
        i2 = i0 - a * i1
        return i1, i2, 2 * i1 - a * i2


def cuts(q: list[mp.mpf], start: mp.mpf, opening: mp.mpf) -> list[mp.mpf]:
    points = {mp.mpf(0), opening}
    for k in range(1, 16):
        points |= {opening / 2**k, opening - opening / 2**k}
    r = mp.hypot(*q)
    if r > 0:
        towards = mp.atan2(-q[1], -q[0]) - start
        offsets = [0, mp.pi / 2, -mp.pi / 2, *(s * k / r for k in (1, 2, 4, 8) for s in (1, -1))]
        around = {towards + 2 * mp.pi * n + d for n in (-1, 0, 1, 2) for d in offsets}
        points |= {x for x in around if 0 < x < opening}
    return sorted(points)


def moments(q: Plane, u1: Plane, u2: Plane) -> list[mp.mpf]:
    """Mass, centroid x, y, and 1 - covariance xx, xy, yy, of the exact floats given."""
    qx, qy = (mp.mpf(x) for x in q)
    start = mp.atan2(u1[1], u1[0])
    opening = mp.atan2(
        mp.mpf(u1[0]) * u2[1] - mp.mpf(u1[1]) * u2[0], mp.mpf(u1[0]) * u2[0] + mp.mpf(u1[1]) * u2[1]
    )
    total = [mp.mpf(0)] * 6
    points = cuts([qx, qy], start, opening)
    for low, high in pairwise(points):
        for node, weight in RULE:
            angle = start + (low + high + (high - low) * node) / 2
            ux, uy = mp.cos(angle), mp.sin(angle)
            i1, i2, i3 = radial(qx * ux + qy * uy)
            share = weight * (high - low) / 2
            terms = (i1, i2 * ux, i2 * uy, i3 * ux * ux, i3 * ux * uy, i3 * uy * uy)
            total = [old + share * term for old, term in zip(total, terms, strict=True)]
    mass, x, y, xx, xy, yy = total
    cx, cy = x / mass, y / mass
    light = mass * mp.exp(-(qx * qx + qy * qy) / 2) / (2 * mp.pi)
    return [
        light,
        qx + cx,
        qy + cy,
        1 - xx / mass + cx**2,
        cx * cy - xy / mass,
        1 - yy / mass + cy**2,
    ]


def draw(rng: np.random.Generator) -> tuple[Plane, Plane, Plane]:
    """A wedge of the domain; half of them have the beam's centre on an edge or near it."""
    r, opening = rng.choice(OFFSETS), math.radians(rng.choice(OPENINGS))
    if rng.random() < 0.5:
        r, opening = 35 * rng.random() ** 2, math.radians(180 * rng.random())
    first = rng.uniform(0, 2 * math.pi)
    towards = rng.uniform(0, 2 * math.pi)
    if rng.random() < 0.5:
        towards = first + math.pi + opening * rng.choice([0, 0.5, 1, -0.5, 1.5])
    q = (r * math.cos(towards), r * math.sin(towards))
    second = first + opening
    return q, (math.cos(first), math.sin(first)), (math.cos(second), math.sin(second))


def error(q: Plane, u1: Plane, u2: Plane) -> tuple[float, list[mp.mpf]]:
    exact = moments(q, u1, u2)
    ((mass, centroid, shift, _),) = wedges(q, ((u1, u2, *sides(q, (u1, u2))),))
    ours = [mass, *centroid, *shift]
    differences = [abs(a - b) for a, b in zip(ours, exact, strict=True)]
    return float(max(differences[0] / exact[0], *differences[1:])), exact


def main() -> None:
    rng = np.random.default_rng(7)
    tried = []
    for _ in range(600):
        point = draw(rng)
        tried.append((*error(*point), point))
    tried.sort(key=lambda each: -each[0] if each[0] == each[0] else -math.inf)
    rows = [
        {
            **{name: [x.hex() for x in pair] for name, pair in zip(NAMES, point, strict=True)},
            "exact": [mp.nstr(value, 30) for value in exact],
        }
        for _, exact, point in tried[:60] + tried[60:600:4]
    ]
    Path(__file__).with_name("wedge.json").write_text(json.dumps(rows, indent=0) + "\n")


if __name__ == "__main__":
    main()
