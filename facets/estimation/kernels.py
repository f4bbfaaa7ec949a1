"""Compiled loops over readings to solve. Importing this imports Numba; `solver.solve` does so.

Arrays in, arrays out, as in `model.kernels`. Each reading is solved alone, so results do not depend
on the batch.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..model import kernels
from ..model.jit import compilable, compiler
from . import gauss_newton, least_squares, normal_equations
from . import problem as problems
from .gauss_newton import enough, estimate, screen_reading
from .normal_equations import covariance_of
from .problem import (
    CONVERGED,
    COVARIANCE,
    FACTOR,
    INVERSE,
    UNKNOWNS,
    VECTORS,
    WEIGHTS,
    Limits,
    Model,
    Problem,
    Readings,
    Results,
    Workspace,
)

Array = Any

compiled = compiler(
    __file__, gauss_newton, least_squares, normal_equations, calls=(kernels, problems)
)


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
    """The covariance of the free unknowns, put at their places in that of the state."""
    covariance_of(layers, FACTOR, INVERSE, COVARIANCE, len(free))
    for i in range(len(free)):
        for j in range(len(free)):
            if free[i] < 8 and free[j] < 8:
                covariances[n, free[i], free[j]] = layers[COVARIANCE, i, j]


def invert(
    model: Model,
    readings: Readings,
    limits: Limits,
    problem: Problem,
    results: Results,
    memory: Workspace,
) -> None:
    """Estimates the states of `results` from `readings`; see the types in `problem`.

    They are handed over array by array: arrays are what compiled code takes from Python.
    """
    invert_arrays(*model, *readings, *limits, *problem, *results, *memory)


@compilable
def estimate_each(
    model: Model,
    readings: Readings,
    limits: Limits,
    problem: Problem,
    results: Results,
    memory: Workspace,
) -> None:
    """`invert`, for compiled code."""
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
        if status == CONVERGED or enough(results.used[n], problem, limits.eight):
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


@compiled
def invert_arrays(
    address: int, packed: Array,
    values: Array, sigmas: Array,
    noise: Array, half_sizes: Array, eight: bool, rounding: Array,
    means: Array, weight: Array, free: Array, starts: Array,
    previous: bool, max_steps: int, damped: bool,
    states: Array, used: Array, status: Array, steps: Array, residuals: Array, covariances: Array,
    layers: Array, rows: Array, outlines: Array,
) -> None:  # fmt: skip
    """`invert`, its bundles made again from what they hold, in their order."""
    estimate_each(
        Model(address, packed),
        Readings(values, sigmas),
        Limits(noise, half_sizes, eight, rounding),
        Problem(means, weight, free, starts, previous, max_steps, damped),
        Results(states, used, status, steps, residuals, covariances),
        Workspace(layers, rows, outlines),
    )
