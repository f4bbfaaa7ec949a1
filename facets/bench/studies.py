"""Run time against error and against batch size, as rows of tables."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

from ..core.units import Floats
from ..estimation.solver import solve
from ..model.arrays import jacobian, parameters, readings
from ..model.threads import cores
from ..optics.forward import build_geometry
from ..optics.forward import readings as text
from . import rivals
from .clock import Contender, Timing, alternate

Row = dict[str, Any]
SENSOR = rivals.SENSOR


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


def timing_row(row: Row, timing: Timing, ours: float) -> Row:
    return {
        **row,
        "us_per_pose": 1e6 * timing.median,
        "low_us": 1e6 * timing.low,
        "high_us": 1e6 * timing.high,
        "ratio": timing.median / ours,
    }


def one_by_one(function: Callable[[Floats], Any]) -> Callable[[Floats], Floats]:
    return lambda inputs: np.array([function(one) for one in inputs])


def forward_contenders(quick: bool, poses: int, seed: int) -> list[Contender]:
    few = 200 if quick else 1000
    random, sobol = rivals.random_points, rivals.sobol_points
    count = 2**14 if quick else 2**20
    made = [
        Contender("facets: batch", lambda s: readings(SENSOR, s), poses),
        Contender("facets: with Jacobian", lambda s: jacobian(SENSOR, s), poses),
        Contender(f"facets: {cores()} threads", lambda s: readings(SENSOR, s, threads=0), poses),
        Contender("facets: one call each", one_by_one(lambda s: readings(SENSOR, s)), few),
    ]
    for nodes in (6, 12, 24):
        batch = partial(rivals.legendre_batch, nodes=nodes)
        made.append(Contender(f"Gauss-Legendre {nodes} (NumPy batch)", batch, few))
    made += [
        Contender(
            "Gauss-Legendre 12 (plain Python)",
            lambda s: rivals.moment_readings(s, rivals.legendre_moments(12)),
            20,
        ),
        Contender("dblquad (as the paper)", rivals.dblquad, 2),
        Contender(f"{count} random rays", lambda s: rivals.rays(s, random(count, seed)), 2),
        Contender(f"{count} Sobol rays", lambda s: rivals.rays(s, sobol(count, seed)), 2),
    ]
    return made


def forward(quick: bool, seed: int) -> list[Row]:
    """Measure time per pose against error, for readings."""
    poses = 5_000 if quick else 200_000
    states = rivals.states_in_range(poses, seed)
    contenders = forward_contenders(quick, poses, seed)
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
        rows.append(timing_row(row, timing, timings[0].median))
    return rows


def solve_by(root: Callable[..., Floats], moments: rivals.Moments) -> Callable[[Floats], Floats]:
    """Solve by the paper's inversion: eight readings, eight unknowns, scaled to order one."""
    scale = np.array([1, 1, 1, 1e-2, 1e-2, 1e-2, 1, 1])

    def solve_readings(xi: Floats) -> Floats:
        def residual(x: Floats) -> Floats:
            rest: Floats = (rivals.moment_readings((x * scale)[None], moments)[0] - xi)[:8]
            return rest

        state: Floats = root(residual) * scale
        return state

    return one_by_one(solve_readings)


def fsolve_root(residual: Callable[[Floats], Floats]) -> Floats:
    from scipy.optimize import fsolve

    found: Floats = fsolve(residual, np.zeros(8))
    return found


def least_squares_root(residual: Callable[[Floats], Floats]) -> Floats:
    from scipy.optimize import least_squares

    found: Floats = least_squares(residual, np.zeros(8), xtol=1e-14, ftol=1e-14, gtol=1e-14).x
    return found


def inverse_contenders(quick: bool, poses: int) -> list[Contender]:
    """Ways from readings to poses; inputs are readings, then true states to start from: (n, 17)."""
    twelve = rivals.legendre_moments(12)

    def warm(rows: Floats, threads: int = 1) -> Floats:
        given, near = rows[:, :9], rows[:, 9:] + 1e-6
        return solve(SENSOR, given, start=near, covariance=False, threads=threads).state

    def cold(rows: Floats, threads: int = 1) -> Floats:
        return solve(SENSOR, rows[:, :9], threads=threads).state

    contenders = [
        Contender("facets: batch from zero", cold, poses),
        Contender("facets: batch warm without covariance", warm, poses),
        Contender(f"facets: the same on {cores()} threads", lambda r: warm(r, 0), poses),
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
            "fsolve on Gauss-Legendre 12", lambda r: solve_by(fsolve_root, twelve)(r[:, :9]), 10
        ),
        Contender(
            "least_squares on Gauss-Legendre 12",
            lambda r: solve_by(least_squares_root, twelve)(r[:, :9]),
            5,
        ),
    ]
    if not quick:
        contenders.append(
            Contender(
                "fsolve on dblquad",
                lambda r: solve_by(fsolve_root, rivals.dblquad_moments)(r[:, :9]),
                1,
            )
        )
    return contenders


def inverse(quick: bool, seed: int) -> list[Row]:
    """Measure time per pose against error, for poses with eight unknowns."""
    poses = 5_000 if quick else 100_000
    states = rivals.states_in_range(poses, seed)
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
        rows.append(timing_row(row, timing, timings[0].median))
    return rows


def chunk_sizes(total: int, size: int) -> Iterator[int]:
    for start in range(0, total, size):
        yield min(size, total - start)


def scaling(quick: bool, seed: int) -> list[Row]:
    """Measure time per pose by batch size and threads; batches over a million go in chunks."""
    largest = 10**4 if quick else 10**7
    states = rivals.states_in_range(min(largest, 10**6), seed)
    rows = []
    for threads in sorted({1, cores()}):
        size = 1
        while size <= largest:
            rows.append(scaling_row(states, size, threads, 1 if size >= 10**6 else 5))
            size *= 10
    return rows


def scaling_row(states: Floats, size: int, threads: int, rounds: int) -> Row:
    xi = readings(SENSOR, states[: min(size, len(states))])

    def read(batch: range) -> None:
        for count in chunk_sizes(len(batch), len(states)):
            readings(SENSOR, states[:count], threads=threads)

    def invert(batch: range) -> None:
        for count in chunk_sizes(len(batch), len(states)):
            solve(SENSOR, xi[:count], covariance=False, threads=threads)

    contenders = [Contender("readings", read, size), Contender("solve", invert, size)]
    read_time, solve_time = alternate(contenders, range(size), rounds)
    return {
        "poses": size,
        "threads": threads,
        "readings_us": 1e6 * read_time.median,
        "solve_us": 1e6 * solve_time.median,
    }
