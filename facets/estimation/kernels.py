"""Compiled loops over readings to solve. Importing this imports Numba; `solver.solve` does so.

Arrays in, arrays out, as in `model.kernels`. Each reading is solved alone, so results do not depend
on the batch.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..model import kernels
from ..model.jit import compilable, compiler
from ..model.kernels import outlines, unpack
from . import gauss_newton, least_squares
from .gauss_newton import (
    CONVERGED,
    ROWS,
    UNKNOWNS,
    Limits,
    Problem,
    Room,
    enough,
    estimate,
    judge,
)

Array = Any

compiled = compiler(__file__, gauss_newton, least_squares, calls=(kernels,))


@compilable
def keep_known(x: Array, free: Array, given: Array) -> None:
    """Sets the unknowns that are not asked for to what is given."""
    asked = 0
    for c in range(UNKNOWNS):
        if asked < len(free) and free[asked] == c:
            asked += 1
        else:
            x[c] = given[c]


@compilable
def room() -> Room:
    return Room(
        np.empty((ROWS, UNKNOWNS + 1)),
        np.empty((ROWS, UNKNOWNS + 1)),
        np.empty((ROWS, UNKNOWNS + 1)),
        np.empty(UNKNOWNS),
        np.empty(UNKNOWNS),
        np.empty((UNKNOWNS, UNKNOWNS)),
        outlines(),
    )


@compilable
def weigh(sigmas: Array, weights: Array) -> None:
    """Weights from standard deviations, for the readings that `judge` took."""
    for i in range(9):
        if weights[i] > 0:
            weights[i] = 1 / sigmas[i]


@compilable
def spread(covariance: Array, free: Array, covariances: Array, n: int) -> None:
    """The covariance of the free unknowns, put at their places in that of the state."""
    if len(covariances) == 0:
        return
    for i in range(len(free)):
        for j in range(len(free)):
            if free[i] < 8 and free[j] < 8:
                covariances[n, free[i], free[j]] = covariance[i, j]


@compiled
def invert(
    packed: Array,
    values: Array,
    sigmas: Array,
    limits: Limits,
    means: Array,
    prior_weight: Array,
    free: Array,
    starts: Array,
    previous: bool,
    max_steps: int,
    damped: bool,
    states: Array,
    used: Array,
    status: Array,
    steps: Array,
    left: Array,
    covariances: Array,
) -> None:
    """Estimates states (n, 9: with power) from readings `values` (n, 9).

    sigmas (n, 9): their standard deviations; empty where those of `limits` hold.
    means (n or 1, 3), prior_weight (3,), free: see `gauss_newton.Problem`. starts (n or 1, 9), with
    the values of what is known. previous: start where the last converged sample ended.
    left (n,): root of the sum of squares left. covariances: (n, 8, 8) zeroed, or empty.
    Where status is not CONVERGED, states, left and covariances are NaN.
    """
    sensor = unpack(packed)
    scratch = room()
    weights = np.empty(9)
    covariance = np.empty((UNKNOWNS if len(covariances) > 0 else 0, UNKNOWNS))
    last = -1
    for n in range(len(values)):
        problem = Problem(means[n % len(means)], prior_weight, free, max_steps, damped)
        start, x = starts[n % len(starts)], states[n]
        status[n], steps[n], left[n] = judge(values[n], limits, weights, used[n]), 0, 0.0
        if len(sigmas) > 0:
            weigh(sigmas[n], weights)
        if status[n] == CONVERGED or enough(used[n], problem, limits.eight):
            warm = previous and last >= 0
            x[:] = states[last] if warm else start
            keep_known(x, free, start)
            status[n], steps[n], left[n] = estimate(
                sensor, x, values[n], weights, problem, scratch, covariance
            )
            if warm and status[n] != CONVERGED:  # the last sample may be far: from the start
                x[:] = start
                status[n], again, left[n] = estimate(
                    sensor, x, values[n], weights, problem, scratch, covariance
                )
                steps[n] += again
        if status[n] == CONVERGED:
            last = n
            left[n] = np.sqrt(left[n])
            spread(covariance, free, covariances, n)
        else:
            x[:] = np.nan
            left[n] = np.nan
            if len(covariances) > 0:
                covariances[n] = np.nan
