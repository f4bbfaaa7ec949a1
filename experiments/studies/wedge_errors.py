"""Errors of the light in a wedge over the whole domain, compared with ball arithmetic.

    python -m facets.experiments.studies.wedge_errors [--points 10000] [--seed 1]

The wedges are random: the point up to 35 sigma from the beam's centre, openings from 0.01 to 179.99
degrees, the beam's centre on an edge, close to one or anywhere. For each wedge the float code
computes mass, centroid, covariance, and the derivatives of mass and centroid by the angles of the
sides. They are compared with the definition by integrals: radial ones in closed form, and that over
the angle enclosed by python-flint at 192 bits. The study prints the errors, and the places of the
worst ones. 10,000 points take some minutes on two cores.
"""

from __future__ import annotations

import math
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from typing import Any

import numpy as np

from facets.model.threads import cores
from facets.optics.vectors import Plane
from facets.optics.wedge import sides, turn_derivative, wedges

from .options import parse_options

BITS, TOLERANCE, BATCH = 192, 1e-20, 250
OPENINGS = (0.01, 0.1, 1, 10, 60, 90, 120, 170, 179, 179.99)
OFFSETS = (0.0, 1e-300, 1e-8, 0.3, 1, 2, 3, 4, 6, 8, 15, 25, 35)
KINDS = ("mass", "centroid", "covariance", "mass_by_angle", "centroid_by_angle")
Wedge = tuple[Plane, Plane, Plane]


def draw_wedge(rng: np.random.Generator) -> Wedge:
    """A random wedge: its point, in sigmas, and the directions of its sides."""
    r, opening = rng.choice(OFFSETS), math.radians(rng.choice(OPENINGS))
    if rng.random() < 0.7:
        r, opening = 35 * rng.random() ** 2, math.radians(rng.uniform(0.01, 179.99))
    first, towards = rng.uniform(0, 2 * math.pi, 2)
    if rng.random() < 0.5:
        towards = first + math.pi + opening * rng.choice([0, 0.5, 1, -0.5, 1.5])
    second = first + opening
    q = (r * math.cos(towards), r * math.sin(towards))
    return q, (math.cos(first), math.sin(first)), (math.cos(second), math.sin(second))


def radial(a: Any) -> tuple[Any, Any, Any]:
    """Integrals of s^n exp(-s^2/2 - a s) from 0 to infinity for n = 1, 2, 3."""
    from flint import acb

    i0 = (acb.pi() / 2).sqrt() * (a * a / 2).exp() * (a / acb(2).sqrt()).erfc()
    i1 = 1 - a * i0
    i2 = i0 - a * i1
    return i1, i2, 2 * i1 - a * i2


def polar_moments(q: tuple[Any, Any], low: Any, high: Any, tolerance: float) -> list[Any]:
    """The six polar moments about q, in sigmas, over a range of angles, by rigorous integration."""
    from flint import acb, arb

    def integrand(n: int, angle: Any, _: bool) -> Any:
        """The integrand of the moment n at an angle, rad."""
        sine, cosine = angle.sin_cos()
        i1, i2, i3 = radial(q[0] * cosine + q[1] * sine)
        x, y = i3 * cosine, i3 * sine
        return (i1, i2 * cosine, i2 * sine, x * cosine, x * sine, y * sine)[n]

    parts = (partial(integrand, n) for n in range(6))
    return [acb.integral(part, low, high, rel_tol=arb(tolerance)).real for part in parts]


def exact_wedge(
    q: Plane, u1: Plane, u2: Plane, tolerance: float = TOLERANCE
) -> dict[str, list[Any]]:
    """Exact results of `facets.optics.wedge` for the same floats; a list for each of KINDS.

    tolerance: of the moments about the point, relative.
    """
    from flint import acb, arb, ctx

    ctx.prec = BITS
    qx, qy = arb(q[0]), arb(q[1])
    start = arb.atan2(arb(u1[1]), arb(u1[0])).mid()
    turn = arb.atan2(
        arb(u1[0]) * u2[1] - arb(u1[1]) * u2[0], arb(u1[0]) * u2[0] + arb(u1[1]) * u2[1]
    ).mid()
    about, x, y, xx, xy, yy = polar_moments((qx, qy), start, start + turn, tolerance)
    light = (-(qx * qx + qy * qy) / 2).exp() / (2 * arb.pi())
    cx, cy = x / about, y / about
    result = {
        "mass": [about * light],
        "centroid": [qx + cx, qy + cy],
        "covariance": [1 - xx / about + cx * cx, cx * cy - xy / about, 1 - yy / about + cy * cy],
        "mass_by_angle": [],
        "centroid_by_angle": [],
    }
    for angle in (start, start + turn):
        sine, cosine = angle.sin_cos()
        first, second, _ = (part.real for part in radial(acb(qx * cosine + qy * sine)))
        result["mass_by_angle"].append(first * light)
        result["centroid_by_angle"] += [
            (second * cosine - cx * first) / about,
            (second * sine - cy * first) / about,
        ]
    return result


def computed_wedge(q: Plane, u1: Plane, u2: Plane) -> dict[str, list[float]]:
    """The light in a wedge by the formulas that are tested, by the kind of result."""
    side1, side2 = rays = sides(q, (u1, u2))
    ((mass, centroid, shift, from_point),) = wedges(q, ((u1, u2, side1, side2),))
    turns = [
        turn_derivative(u, ray, mass, from_point) for u, ray in zip((u1, u2), rays, strict=True)
    ]
    return {
        "mass": [mass],
        "centroid": [*centroid],
        "covariance": [*shift],
        "mass_by_angle": [turn[0] for turn in turns],
        "centroid_by_angle": [value for turn in turns for value in turn[1]],
    }


def error(ours: list[float], theirs: list[Any], kind: str) -> float:
    """Relative error of mass and derivatives, each by its own size; in sigmas for the centroid."""
    away = [abs(float(a - b)) for a, b in zip(ours, theirs, strict=True)]
    if kind in ("centroid", "covariance"):
        return max(away)
    sizes = [abs(float(b)) for b in theirs]
    if kind == "centroid_by_angle":  # two vectors
        sizes = [math.hypot(*sizes[i : i + 2]) for i in (0, 0, 2, 2)]
    return max(a / s if s > 1e-290 else 0.0 for a, s in zip(away, sizes, strict=True))


def search(count: int, seed: int) -> list[tuple[Wedge, float, list[float]]]:
    """Return (wedge, mass, errors in the order of KINDS) of random wedges that hold any light."""
    rng = np.random.default_rng(seed)
    wedges: list[tuple[Wedge, float, list[float]]] = []
    while len(wedges) < count:
        point = draw_wedge(rng)
        theirs = exact_wedge(*point)
        mass = float(theirs["mass"][0])
        if mass < 1e-290:
            continue
        ours = computed_wedge(*point)
        wedges.append((point, mass, [error(ours[kind], theirs[kind], kind) for kind in KINDS]))
    return wedges


def describe(point: Wedge, mass: float) -> str:
    """The wedge in words: distance, width and mass."""
    q, u1, u2 = point
    opening = math.degrees(math.atan2(u1[0] * u2[1] - u1[1] * u2[0], u1[0] * u2[0] + u1[1] * u2[1]))
    return f"{math.hypot(*q):.4g} sigma off, {opening:.4g} degrees wide, mass {mass:.2g}"


def main() -> None:
    options = parse_options(__doc__, points=10_000, seed=1)
    count = -(-options.points // BATCH)
    seeds = np.random.SeedSequence(options.seed).generate_state(count).tolist()
    with ProcessPoolExecutor(cores()) as pool:
        wedges = [row for part in pool.map(search, [BATCH] * count, seeds) for row in part]
    errors = np.array([row[2] for row in wedges])
    print(f"{len(wedges)} wedges; errors of 99 % of them, and the worst")
    for kind, column in zip(KINDS, errors.T, strict=True):
        point, mass, _ = wedges[column.argmax()]
        print(f"{kind:20}{np.quantile(column, 0.99):8.1e} {column.max():8.1e}  "
              f"{describe(point, mass)}")  # fmt: skip


if __name__ == "__main__":
    main()
