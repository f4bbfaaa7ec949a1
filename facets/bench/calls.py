"""Cost of a call, relative to a loop: a batch, one pose at a time, and the first result.

Times are processor times, so that other work of the machine matters little; they still depend on
the processor. Each row also has its ratio to a reference loop,
timed in turn with it, of a thousand additions, multiplications and divisions that depend on each
other, and the stored ratio of the last measurement, so that a run shows what has become slower.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from ..core.units import Floats
from ..estimation.prepared import Solver
from ..estimation.solver import solve
from ..model.arrays import jacobian, readings
from ..model.blocks import address_of
from .clock import Contender
from .head import SENSOR, states_in_range

#: Ratios to the reference loop on an AMD EPYC, whose loop takes 7.9 us.
STORED = {
    "reference loop: 1000 steps": 1.0,
    "readings: batch": 0.0054,
    "Jacobians: batch": 0.0170,
    "poses from zero: batch": 0.073,
    "poses from near: batch": 0.031,
    "readings: one call": 0.43,
    "facets.solve: one call": 0.83,
    "Solver.solve: one call": 0.66,
    "Solver.solve: one call in a motion": 0.61,
    "Solver.solve: one call at rest": 0.49,
    "first reading: nothing compiled": 7.5e4,
    "first pose: nothing compiled": 1.43e5,
}
#: Rows that a quick run leaves out, because they compile everything again.
FIRST = {
    "first reading: nothing compiled": "facets.readings(sensor, [0.0] * 8)",
    "first pose: nothing compiled": "facets.solve(sensor, facets.readings(sensor, [0.0] * 8))",
}


@cache
def loop() -> Callable[[int], None]:
    """Make the reference loop: `loop()(n)` takes a thousand steps n times."""
    from llvmlite import ir

    from ..model.object_code import function
    from ..scalars.lanes import DOUBLE, LONG, write_loop

    def write(builder: Any, arguments: Any) -> None:
        x = builder.inttoptr(arguments[0], ir.PointerType(DOUBLE))
        share, one = ir.Constant(DOUBLE, 0.999), ir.Constant(DOUBLE, 1.0)
        with write_loop(builder, builder.mul(arguments[1], ir.Constant(LONG, 1000))):
            number = builder.load(x)
            rest = builder.fdiv(one, builder.fadd(number, one))
            builder.store(builder.fadd(builder.fmul(number, share), rest), x)

    code, x = function("reference_loop", 2, lambda: write, __file__), np.ones(1)
    return lambda times: code(address_of(x), times)


def one_by_one(function: Callable[[Floats], Any]) -> Callable[[Floats], None]:
    def each(inputs: Floats) -> None:
        for row in inputs:
            function(row)

    return each


def contenders(poses: int, few: int) -> list[Contender]:
    """Ways to call; their inputs are readings, then states: (n, 17)."""
    zero, near = Solver(SENSOR), Solver(SENSOR, start="previous")
    steps = np.arange(few)[:, None] * [1e-4, 0, 2e-4, 0, 0, 2e-6, 0, 0]
    motion = readings(SENSOR, steps - steps.mean(axis=0))

    def solve_in_motion(rows: Floats) -> None:
        for reading in motion[: len(rows)]:
            near.solve(reading)

    def solve_at_rest(rows: Floats) -> None:
        for _ in rows:
            near.solve(motion[0])

    return [
        Contender("reference loop: 1000 steps", lambda rows: loop()(len(rows)), few),
        Contender("readings: batch", lambda rows: readings(SENSOR, rows[:, 9:]), poses),
        Contender("Jacobians: batch", lambda rows: jacobian(SENSOR, rows[:, 9:]), poses),
        Contender("poses from zero: batch", lambda rows: solve(SENSOR, rows[:, :9]), poses),
        Contender("poses from near: batch", solve_from_near, poses),
        Contender("readings: one call", one_by_one(lambda r: readings(SENSOR, r[9:])), few),
        Contender("facets.solve: one call", one_by_one(lambda r: solve(SENSOR, r[:9])), few),
        Contender("Solver.solve: one call", one_by_one(lambda r: zero.solve(r[:9])), few),
        Contender("Solver.solve: one call in a motion", solve_in_motion, few),
        Contender("Solver.solve: one call at rest", solve_at_rest, few),
    ]


def solve_from_near(rows: Floats) -> None:
    solve(SENSOR, rows[:, :9], start=rows[:, 9:] + 1e-6, covariance=False)


def least(contenders: list[Contender], rows: Floats, rounds: int) -> list[float]:
    """CPU seconds per pose of each contender: the least over rounds in turn."""
    for contender in contenders:
        contender.work(rows[: contender.poses])
    best = [np.inf] * len(contenders)
    for _ in range(rounds):
        for n, contender in enumerate(contenders):
            start = time.process_time()
            contender.work(rows[: contender.poses])
            best[n] = min(best[n], (time.process_time() - start) / contender.poses)
    return best


def first(expression: str) -> float:
    """CPU seconds of a new process with empty caches, imports included."""
    code = f"import facets; sensor = facets.Sensor(); {expression}"
    with tempfile.TemporaryDirectory() as empty:
        before = child_cpu_seconds()
        subprocess.run(
            [sys.executable, "-c", code], env={**os.environ, "FACETS_CACHE_DIR": empty},
            stderr=subprocess.DEVNULL, check=True,
        )  # fmt: skip
        return child_cpu_seconds() - before


def child_cpu_seconds() -> float:
    """CPU time of the processes that have ended, s."""
    spent = resource.getrusage(resource.RUSAGE_CHILDREN)
    return spent.ru_utime + spent.ru_stime


def calls(quick: bool, seed: int) -> list[dict[str, Any]]:
    """Measure each way to call: us, the ratio to the reference loop, and the stored ratio."""
    poses, few = (5_000, 200) if quick else (50_000, 2_000)
    states = states_in_range(poses, seed)
    rows = np.hstack([readings(SENSOR, states), states])
    timed = contenders(poses, few)
    times = least(timed, rows, 5 if quick else 15)
    seconds = {each.name: took for each, took in zip(timed, times, strict=True)}
    if not quick:
        seconds |= {name: first(expression) for name, expression in FIRST.items()}
    unit = times[0]
    return [
        {"call": name, "us": 1e6 * took, "ratio": took / unit, "stored": STORED.get(name, np.nan)}
        for name, took in seconds.items()
    ]
