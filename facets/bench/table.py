"""The table of `facets bench`: each method's processor time per pose, and its error.

Rows (n, 17) are readings (9) in mm and mW, and their states (8) in mm and rad.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..config.loading import load
from ..core.sensor import Apertures, Sensor
from ..core.units import Floats
from ..estimation.solver import Solver, solve
from ..files.tables import read_chunks, read_words
from ..model.arrays import jacobian, parameters, readings
from ..optics import forward
from .clock import Contender, cpu_seconds
from .rivals import (
    SENSOR,
    has_compiler,
    poses_by_c,
    readings_by_c,
    readings_by_dblquad,
    readings_by_legendre,
    solve_by_scipy,
    states_in_range,
)
from .runs import first_use_ways, run_ways

Row = dict[str, Any]

#: Sensors by their light; the first has the light that all methods can compute.
LIGHTS = {
    "ideal": SENSOR,
    "that of a bench": replace(SENSOR, light=load("bench-light").sensor.light),
    "cut by the detectors": replace(SENSOR, apertures=Apertures(detectors=True)),
}
#: Number of rows whose errors are measured: of readings, and of poses.
CHECKED_READINGS, CHECKED_POSES = 50, 2000
#: Number of rows of a table, and of samples of a recording.
FILE_ROWS = 50_000
GAUSS_LEGENDRE = "Gauss-Legendre of 12 nodes (NumPy)"
EXPORTED_C = "the exported C (gcc -O3 -march=native)"
#: The rivals to whose times all others are ratios: readings, and poses.
RIVALS = {
    "readings": {"to_c": EXPORTED_C, "to_numpy": GAUSS_LEGENDRE},
    "poses": {"to_c": EXPORTED_C, "to_numpy": f"fsolve on {GAUSS_LEGENDRE}"},
}
#: Tasks whose times are compared with the rivals' readings; all others are compared with poses.
READING_TASKS = ("readings", "light: readings", "light: Jacobians")
#: The table of a full run.
STORED = Path(__file__).with_name("stored.csv")
#: Fraction by which ratios differ between processors.
PROCESSOR_SPREAD = 0.25


def measure(quick: bool, seed: int) -> list[Row]:
    """Measure each method: us per pose, the spread of the rounds, the ratios to the rivals, and the
    largest errors.

    Column error_mm is that of places, or of a pose's lengths; error_rad that of a pose's angles.
    """
    poses, few, rounds = (5_000, 200, 3) if quick else (50_000, 2_000, 15)
    states = states_in_range(poses, seed)
    rows = np.hstack([readings(SENSOR, states), states])
    table = [
        *time_ways("readings", reading_ways(poses, few), rows, rounds, reading_errors),
        *time_ways("poses", pose_ways(poses, few), rows, rounds, pose_errors),
    ]
    for task, ways in light_tasks(rows[: poses // 4], seed).items():
        table += time_ways(task, ways, rows, rounds)
    with tempfile.TemporaryDirectory() as folder:
        ways = run_ways(Path(folder), np.resize(rows, (FILE_ROWS, rows.shape[1])))
        table += time_ways("files", ways, rows, 3)
    if not quick:
        table += time_ways("nothing compiled", first_use_ways(), rows, 2)
    return [row | ratios_to_rivals(row, table) for row in table]


def ratios_to_rivals(row: Row, table: list[Row]) -> Row:
    """Ratios of the row's time to those of the rivals; NaN without the exported C."""
    times = {(each["task"], each["way"]): each["us"] for each in table}
    task = "readings" if row["task"] in READING_TASKS else "poses"
    return {key: row["us"] / times.get((task, way), np.nan) for key, way in RIVALS[task].items()}


def slower_rows(table: list[Row]) -> Iterator[str]:
    """Report rows that are slower than stored, relative to the rivals, by more than the error
    bars."""
    rival = "to_c" if has_compiler() else "to_numpy"
    (stored,) = read_chunks(STORED, [rival, "spread"])
    ways = zip(*(read_words(STORED, name) or [] for name in ("task", "way")), strict=True)
    stored_ratios = dict(zip(ways, zip(*stored.columns.values(), strict=True), strict=True))
    for row in table:
        ratio, spread = stored_ratios.get((row["task"], row["way"]), (np.nan, np.nan))
        times, bars = row[rival] / ratio, row["spread"] + spread + PROCESSOR_SPREAD
        if times > 1 + bars:
            yield (
                f"{row['task']}, {row['way']}: takes {times:.2g} times as long as stored, relative "
                f"to the same rival (error bars {100 * bars:.0f} %)"
            )


def reading_errors(way: Contender, rows: Floats) -> Row:
    """The largest error of a place, mm, as columns of the table."""
    some = rows[: min(CHECKED_READINGS, way.poses)]
    off = np.abs(way.work(some) - exact_readings(some[:, 9:])).reshape(-1, 3, 3)
    return {"error_mm": float(off[:, :, :2].max()), "error_rad": np.nan}


def pose_errors(way: Contender, rows: Floats) -> Row:
    """The largest errors of a length, mm, and of an angle, rad, as columns of the table."""
    some = rows[: min(CHECKED_POSES, way.poses)]
    off = np.abs(way.work(some) - some[:, 9:]).max(axis=0)
    return {"error_mm": off[[0, 1, 2, 6, 7]].max(), "error_rad": off[3:6].max()}


def time_ways(
    task: str, ways: list[Contender], rows: Floats, rounds: int,
    errors: Callable[[Contender, Floats], Row] = lambda *_: {},
) -> Iterator[Row]:  # fmt: skip
    """Yield the row of each method of a task, without ratios; errors: measures a method's
    errors."""
    for way, (seconds, spread) in zip(ways, cpu_seconds(ways, rows, rounds), strict=True):
        row = {"task": task, "way": way.name, "us": 1e6 * seconds, "spread": spread}
        unknown = dict.fromkeys(("to_c", "to_numpy", "error_mm", "error_rad"), np.nan)
        yield row | unknown | errors(way, rows)


def exact_readings(states: Floats) -> Any:
    """Readings (n, 9) by the optics in mpmath, as an array of high-precision numbers."""
    import mpmath as mp

    with mp.workdps(40):
        sensor = forward.build_geometry(tuple(mp.mpf(x) for x in parameters(SENSOR)))
        exact = [
            forward.readings(sensor, tuple(mp.mpf(float(x)) for x in state)) for state in states
        ]
    return np.array(exact, dtype=object).reshape(len(states), 9)


def one_by_one(function: Callable[[Floats], Any]) -> Callable[[Floats], Floats]:
    """Make a function of rows from a function of one row."""
    return lambda rows: np.array([function(row) for row in rows])


def reading_ways(poses: int, few: int) -> list[Contender]:
    """Methods that compute readings from states."""
    by_c = Contender(EXPORTED_C, lambda rows: readings_by_c(rows[:, 9:]), poses)
    return [
        Contender("facets: a batch", lambda rows: readings(SENSOR, rows[:, 9:]), poses),
        Contender("facets: one call each", one_by_one(lambda r: readings(SENSOR, r[9:])), few),
        *([by_c] if has_compiler() else []),
        Contender(GAUSS_LEGENDRE, lambda rows: readings_by_legendre(rows[:, 9:]), few),
        Contender("dblquad (as the paper)", lambda rows: readings_by_dblquad(rows[:, 9:]), 2),
    ]


def pose_ways(poses: int, few: int) -> list[Contender]:
    """Methods that compute states from exact readings, with eight unknowns."""

    def solve_near(rows: Floats) -> Floats:
        """Poses from a start next to the solution."""
        return solve(SENSOR, rows[:, :9], start=rows[:, 9:] + 1e-6, covariance=False).state

    def invert_as_paper(rows: Floats) -> Floats:
        """Poses by the paper's method."""
        return solve(SENSOR, rows[:, :9], method="paper").state

    def fsolve(model: Callable[[Floats], Floats]) -> Callable[[Floats], Floats]:
        """Make a function that solves with SciPy and a model of the readings."""
        return lambda rows: solve_by_scipy(model, rows[:, :9])

    prepared = Solver(SENSOR)
    by_c = Contender(EXPORTED_C, lambda rows: poses_by_c(rows[:, :9]), poses)
    return [
        Contender("facets: a batch", lambda rows: solve(SENSOR, rows[:, :9]).state, poses),
        Contender("facets: a batch from near without covariance", solve_near, poses),
        Contender("facets: the paper's inversion", invert_as_paper, poses),
        Contender("facets: one call each", one_by_one(lambda r: solve(SENSOR, r[:9]).state), few),
        Contender(
            "facets.Solver: one call each", one_by_one(lambda r: prepared.solve(r[:9]).state), few
        ),
        *([by_c] if has_compiler() else []),
        Contender(f"fsolve on {GAUSS_LEGENDRE}", fsolve(readings_by_legendre), 10),
        Contender("fsolve on dblquad (as the paper)", fsolve(readings_by_dblquad), 1),
    ]


def light_tasks(rows: Floats, seed: int) -> dict[str, list[Contender]]:
    """Tasks that are measured with each kind of light. Poses are those of noisy readings in the
    inner half of the range."""
    states = 0.5 * rows[:, 9:]
    noise = SENSOR.noise.position * np.random.default_rng(seed).standard_normal((len(rows), 9))
    noise *= np.tile([1.0, 1.0, 0.0], 3)

    def noisy_solve(sensor: Sensor) -> Callable[[Floats], Any]:
        """Make a function that solves the noisy readings of a sensor."""
        noisy = readings(sensor, states) + noise
        return lambda some: solve(sensor, noisy[: len(some)])

    works: dict[str, Callable[[Sensor], Callable[[Floats], Any]]] = {
        "readings": lambda sensor: lambda some: readings(sensor, some[:, 9:]),
        "Jacobians": lambda sensor: lambda some: jacobian(sensor, some[:, 9:]),
        "poses of noisy readings": noisy_solve,
    }
    return {
        f"light: {task}": [
            Contender(words, work(sensor), len(rows)) for words, sensor in LIGHTS.items()
        ]
        for task, work in works.items()
    }
