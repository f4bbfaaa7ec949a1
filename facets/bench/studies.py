"""Run time against error, as rows of tables."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..core.units import Floats
from ..estimation.solver import solve
from ..model.arrays import jacobian, parameters, readings
from ..model.threads import cores
from ..optics.forward import build_geometry
from ..optics.forward import readings as text
from .clock import Contender, alternate
from .dblquad import readings_by_dblquad
from .gauss_legendre import readings_by_legendre
from .head import SENSOR, states_in_range
from .scipy_roots import fsolve_root, least_squares_root, solve_by_roots

Row = dict[str, Any]


def reference(states: Floats, digits: int = 40) -> Any:
    """Readings (n, 9) by the optics' text in mpmath, as an array of high-precision numbers."""
    import mpmath as mp

    with mp.workdps(digits):
        sensor = build_geometry(tuple(mp.mpf(x) for x in parameters(SENSOR)))
        exact = [text(sensor, tuple(mp.mpf(float(x)) for x in state)) for state in states]
    return np.array(exact, dtype=object).reshape(len(states), 9)


def errors(values: Floats, exact: Any) -> tuple[float, float]:
    """Largest errors of a position, mm, and of a power, relative."""
    away = np.abs(np.array(values - exact)).reshape(-1, 3, 3)
    power = away[:, :, 2] / np.asarray(exact).reshape(-1, 3, 3)[:, :, 2]
    return float(away[:, :, :2].max()), float(power.max())


def timing_row(row: Row, seconds: float, ours: float) -> Row:
    return {**row, "us_per_pose": 1e6 * seconds, "ratio": seconds / ours}


def one_by_one(function: Callable[[Floats], Any]) -> Callable[[Floats], Floats]:
    return lambda inputs: np.array([function(row) for row in inputs])


def forward_contenders(quick: bool, poses: int) -> list[Contender]:
    few = 200 if quick else 1000
    return [
        Contender("facets: batch", lambda s: readings(SENSOR, s), poses),
        Contender("facets: with Jacobian", lambda s: jacobian(SENSOR, s), poses),
        Contender(f"facets: {cores()} threads", lambda s: readings(SENSOR, s, threads=0), poses),
        Contender("facets: one call each", one_by_one(lambda s: readings(SENSOR, s)), few),
        Contender("Gauss-Legendre 12 (NumPy batch)", readings_by_legendre, few),
        Contender("dblquad (as the paper)", readings_by_dblquad, 2),
    ]


def forward(quick: bool, seed: int) -> list[Row]:
    """Measure time per pose against error, for readings."""
    poses = 5_000 if quick else 200_000
    states = states_in_range(poses, seed)
    contenders = forward_contenders(quick, poses)
    checked = 5 if quick else 50
    exact = reference(states[:checked])
    timings = alternate(contenders, states, 3 if quick else 9)
    rows = []
    for contender, timing in zip(contenders, timings, strict=True):
        row: Row = {"way": contender.name, "place_error_mm": np.nan, "power_error": np.nan}
        n = min(checked, contender.poses)
        values = contender.work(states[:n])
        if values.ndim == 2:
            row["place_error_mm"], row["power_error"] = errors(values, exact[:n])
        rows.append(timing_row(row, timing, timings[0]))
    return rows


def inverse_contenders(quick: bool, poses: int) -> list[Contender]:
    """Ways from readings to poses; inputs are readings, then true states to start from: (n, 17)."""

    def warm(rows: Floats) -> Floats:
        return solve(SENSOR, rows[:, :9], start=rows[:, 9:] + 1e-6, covariance=False).state

    def cold(rows: Floats) -> Floats:
        return solve(SENSOR, rows[:, :9]).state

    def use_threads(rows: Floats) -> Floats:
        return solve(SENSOR, rows[:, :9], covariance=False, threads=0).state

    contenders = [
        Contender("facets: batch from zero", cold, poses),
        Contender("facets: batch warm without covariance", warm, poses),
        Contender(f"facets: from zero on {cores()} threads", use_threads, poses),
        Contender(
            "facets: one warm call each",
            one_by_one(lambda r: solve(SENSOR, r[:9], start=r[9:] + 1e-6).state),
            200 if quick else 2000,
        ),
        Contender(
            "facets: the paper's inversion",
            lambda r: solve(SENSOR, r[:, :9], method="paper").state,
            poses,
        ),
        Contender(
            "fsolve on Gauss-Legendre 12",
            lambda r: solve_by_roots(fsolve_root, readings_by_legendre, r[:, :9], True),
            10,
        ),
        Contender(
            "least_squares on Gauss-Legendre 12",
            lambda r: solve_by_roots(least_squares_root, readings_by_legendre, r[:, :9], True),
            5,
        ),
    ]
    if not quick:
        contenders.append(
            Contender(
                "fsolve on dblquad (as the paper)",
                lambda r: solve_by_roots(fsolve_root, readings_by_dblquad, r[:, :9]),
                1,
            )
        )
    return contenders


def inverse(quick: bool, seed: int) -> list[Row]:
    """Measure time per pose against error, for poses with eight unknowns."""
    poses = 5_000 if quick else 100_000
    states = states_in_range(poses, seed)
    index = np.column_stack([readings(SENSOR, states), states])
    contenders = inverse_contenders(quick, poses)
    timings = alternate(contenders, index, 3 if quick else 7)
    rows = []
    for contender, timing in zip(contenders, timings, strict=True):
        n = min(contender.poses, 2000)
        away = np.abs(contender.work(index[:n]) - states[:n]).max(axis=0)
        row = {
            "way": contender.name,
            "length_error_mm": away[[0, 1, 2, 6, 7]].max(),
            "angle_error_rad": away[3:6].max(),
        }
        rows.append(timing_row(row, timing, timings[0]))
    return rows
