"""Compiled loops over readings to solve. Importing this imports Numba; `solver.solve` does so.

Arrays in, arrays out, as in `model.kernels`. Each reading is solved alone, so results do not depend
on the batch.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import carray  # type: ignore[attr-defined]  # noqa: TID253

from ..model.jit import bytes_at, compilable, doubles_at, integers_at, longs_at
from ..model.jit import task as task_kernel
from ..model.threads import once
from . import gauss_newton, least_squares, normal_equations
from . import problem as problems
from .gauss_newton import count_checks, estimate, screen_reading
from .normal_equations import covariance_of
from .problem import (
    ACCEPT_UNCHECKED,
    CONVERGED,
    COUNT,
    COUNT_OF_COVARIANCES,
    COUNT_OF_FREE,
    COUNT_OF_MEANS,
    COUNT_OF_SIGMAS,
    COUNT_OF_STARTS,
    COVARIANCE,
    COVARIANCES,
    DAMPED,
    EIGHT,
    FACTOR,
    FREE,
    HALF_SIZES,
    INVERSE,
    LAYERS,
    LAYERS_AT,
    MEANS,
    MODEL,
    MOST_STEPS,
    NOISE,
    OUTLINES_AT,
    PACKED,
    PREVIOUS,
    RESIDUALS,
    ROUNDINGS,
    ROWS,
    ROWS_AT,
    SIGMAS,
    STARTS,
    STATES,
    STATUS,
    STEPS,
    UNCHECKED,
    UNKNOWNS,
    USED,
    VALUES,
    VECTORS,
    WEIGHT,
    WEIGHTS,
    Limits,
    Model,
    Problem,
    Readings,
    Results,
    Workspace,
)

Array = Any


@compilable
def begin(x: Array, near: Array, free: Array, given: Array) -> None:
    """Starts x (9,) from `near`, the unknowns that are not asked for from what is given."""
    asked = 0
    for c in range(UNKNOWNS):
        if asked < len(free) and free[asked] == c:
            x[c] = near[c]
            asked += 1
        else:
            x[c] = given[c]


@compilable
def void(results: Results, n: int) -> None:
    """No numbers where an estimate has failed."""
    results.residuals[n] = np.nan
    for c in range(UNKNOWNS):
        results.states[n, c] = np.nan
    if len(results.covariances) > 0:
        for i in range(8):
            for j in range(8):
                results.covariances[n, i, j] = np.nan


@compilable
def weigh(sigmas: Array, weights: Array) -> None:
    """Weights from standard deviations, for the readings that `screen_reading` took."""
    for i in range(9):
        if weights[i] > 0:
            weights[i] = 1 / sigmas[i]


@compilable
def put_covariance(layers: Array, free: Array, covariances: Array, n: int) -> None:
    """The covariance of the free unknowns, put at their places in that of the state; the rest of
    it is zero."""
    covariance_of(layers, FACTOR, INVERSE, COVARIANCE, len(free))
    for i in range(8):
        for j in range(8):
            covariances[n, i, j] = 0.0
    for i in range(len(free)):
        for j in range(len(free)):
            if free[i] < 8 and free[j] < 8:
                covariances[n, free[i], free[j]] = layers[COVARIANCE, i, j]


@compilable
def estimate_each(
    model: Model,
    readings: Readings,
    limits: Limits,
    problem: Problem,
    results: Results,
    memory: Workspace,
) -> None:
    """Estimates the states of `results` from `readings`; see the types in `problem`."""
    free, means, starts = problem.free, problem.means, problem.starts
    weights = memory.layers[VECTORS, WEIGHTS]
    last = -1
    for n in range(len(readings.values)):
        values, x, mean = readings.values[n], results.states[n], means[n % len(means)]
        start = starts[n % len(starts)]
        status = screen_reading(values, limits, weights, results.used[n])
        steps, cost = 0, 0.0
        if len(readings.sigmas) > 0:
            weigh(readings.sigmas[n], weights)
        checks = count_checks(results.used[n], problem, limits.eight)
        if checks == 0 and not problem.accept_unchecked:
            status = UNCHECKED
        elif status == CONVERGED or checks >= 0:
            warm = problem.previous and last >= 0
            for again in range(2 if warm else 1):  # the last sample may be far: from the start
                begin(x, results.states[last] if warm and again == 0 else start, free, start)
                status, more, cost = estimate(model, x, values, limits, problem, mean, memory)
                steps += more
                if status == CONVERGED:
                    break
        results.status[n], results.steps[n] = status, steps
        if status == CONVERGED:
            last = n
            results.residuals[n] = np.sqrt(cost)
            if len(results.covariances) > 0:
                put_covariance(memory.layers, free, results.covariances, n)
        else:
            void(results, n)


def solve_rows(task: Any) -> None:
    """Estimates the states of `Results` from `Readings`.

    task: the addresses and counts of `problem.Task`.
    """
    n, rows, starts = task[COUNT], task[COUNT_OF_SIGMAS], task[COUNT_OF_STARTS]
    means, asked, kept = task[COUNT_OF_MEANS], task[COUNT_OF_FREE], task[COUNT_OF_COVARIANCES]
    estimate_each(
        Model(task[MODEL], carray(doubles_at(task[PACKED]), (1,))),
        Readings(
            carray(doubles_at(task[VALUES]), (n, 9)), carray(doubles_at(task[SIGMAS]), (rows, 9))
        ),
        Limits(
            carray(doubles_at(task[NOISE]), (3,)),
            carray(doubles_at(task[HALF_SIZES]), (3, 2)),
            task[EIGHT] != 0,
            carray(doubles_at(task[ROUNDINGS]), (2,)),
        ),
        Problem(
            carray(doubles_at(task[MEANS]), (means, 3)),
            carray(doubles_at(task[WEIGHT]), (3,)),
            carray(longs_at(task[FREE]), (asked,)),
            carray(doubles_at(task[STARTS]), (starts, 9)),
            task[PREVIOUS] != 0,
            task[MOST_STEPS],
            task[DAMPED] != 0,
            task[ACCEPT_UNCHECKED] != 0,
        ),
        Results(
            carray(doubles_at(task[STATES]), (n, 9)),
            carray(bytes_at(task[USED]), (n, 3)),
            carray(bytes_at(task[STATUS]), (n,)),
            carray(integers_at(task[STEPS]), (n,)),
            carray(doubles_at(task[RESIDUALS]), (n,)),
            carray(doubles_at(task[COVARIANCES]), (kept, 8, 8)),
        ),
        Workspace(
            carray(doubles_at(task[LAYERS_AT]), (LAYERS, 10, 10)),
            carray(doubles_at(task[ROWS_AT]), (ROWS, 10)),
            carray(doubles_at(task[OUTLINES_AT]), (1,)),
        ),
    )


@once
def kernel() -> Callable[[int], None]:
    """The compiled `solve_rows`, to be called with the address of a task's table."""
    modules = (gauss_newton, least_squares, normal_equations)
    return task_kernel(__file__, solve_rows, *modules, problems)
