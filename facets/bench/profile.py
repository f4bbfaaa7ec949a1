"""Time of a pose by stage, and of its special functions evaluated in other ways."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from ..core.units import Floats
from ..estimation.solver import solve
from ..model.arrays import packed_vectors, readings
from ..optics.wedge import swept_mass
from . import rivals, stages
from .clock import Contender, alternate

Row = dict[str, Any]


def profile(quick: bool, seed: int) -> list[Row]:
    """Measure nanoseconds per pose up to each stage of readings and Jacobian, of a warm solve, and
    of the special functions alone, which all of these need."""
    poses = 5_000 if quick else 50_000
    states = rivals.states_in_range(poses, seed)
    vectors, out = packed_vectors(rivals.SENSOR), np.empty(poses)
    contenders = [
        Contender(name, partial(run, stages.stage(name), vectors, out), poses)
        for name in stages.CHAIN
    ]
    xi = readings(rivals.SENSOR, states)
    contenders.append(Contender("a warm solve", partial(warm, xi), poses))
    alone = partial(run, stages.stage(stages.FLOOR), vectors, out)
    contenders.append(Contender(stages.FLOOR, alone, poses))
    timings = alternate(contenders, states, 3 if quick else 15)
    rows, before = [], 0.0
    floor = timings.pop().median
    contenders.pop()
    for contender, timing in zip(contenders, timings, strict=True):
        total = 1e9 * timing.median
        rows.append({"stage": contender.name, "ns_up_to_here": total, "ns": total - before})
        before = total
    rows.append({"stage": stages.FLOOR, "ns_up_to_here": np.nan, "ns": 1e9 * floor})
    return rows


def run(work: Any, vectors: Floats, out: Floats, states: Floats) -> None:
    work(vectors, states, out[: len(states)])


def warm(xi: Floats, states: Floats) -> None:
    solve(rivals.SENSOR, xi[: len(states)], start=states + 1e-6, covariance=False)


def special(quick: bool, seed: int) -> list[Row]:
    """Integrate over a side's sweep in four ways: time, and largest error near the centre and far.

    near: both coordinates within 1.5 sigma, as in the range of the paper's sensor; far: within 6.
    """
    count, checked = (10_000, 50) if quick else (100_000, 500)
    rng = np.random.default_rng(seed)
    near, far = rng.uniform(-1.5, 1.5, (count, 2)), rng.uniform(-6, 6, (count, 2))
    out = np.empty(count)

    def fill(work: Any, points: Floats) -> Floats:
        work(points, out[: len(points)])
        return out[: len(points)].copy()

    ways = {
        "facets: series": stages.evaluate_series,
        "SciPy's Owen's T": stages.evaluate_library,
        "Gauss-Legendre 6": partial(quadrature, 6),
        "Gauss-Legendre 12": partial(quadrature, 12),
        "Gauss-Legendre 24": partial(quadrature, 24),
    }
    contenders = [Contender(name, partial(fill, work), count) for name, work in ways.items()]
    timings = alternate(contenders, near, 3 if quick else 15)
    far_timings = alternate(contenders, far, 3 if quick else 15)
    near_exact, far_exact = reference(near[:checked]), reference(far[:checked])
    return [
        {
            "way": contender.name,
            "ns": 1e9 * timing.median,
            "ns_far": 1e9 * far_timing.median,
            "ratio": timing.median / timings[0].median,
            "error_near": worst(contender.work(near[:checked]), near_exact),
            "error_far": worst(contender.work(far[:checked]), far_exact),
        }
        for contender, timing, far_timing in zip(contenders, timings, far_timings, strict=True)
    ]


def quadrature(nodes: int, points: Floats, out: Floats) -> None:
    places, weights = np.polynomial.legendre.leggauss(nodes)
    stages.evaluate_quadrature(points, (places + 1) / 2, weights / 2, out)


def reference(points: Floats) -> Any:
    """Integrate the definition with 30 digits."""
    import mpmath as mp

    with mp.workdps(30):
        return np.array([swept_mass(mp.mpf(float(a)), mp.mpf(float(h))) for a, h in points])


def worst(values: Floats, exact: Any) -> float:
    return float(np.abs(values - exact).max())
