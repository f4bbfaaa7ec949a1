"""What an estimate is asked, what it is screened by, and how it can end."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..model.blocks import address_of
from ..model.threads import part_of
from ..optics import limits as outlines

Array = Any

(
    CONVERGED, MAX_STEPS, SINGULAR, OUT_OF_RANGE, NO_LIGHT, NON_FINITE, STALLED, UNCHECKED,
    AMBIGUOUS,
) = range(9)  # fmt: skip

#: Converged when the next step would move the fit by less than this, in sigmas, squared.
SMALL = 1e-12
#: A detector with less light than this, in standard deviations of its power, is left out: the noise
#: of its spot's place, which goes as 1 / power, is then no Gaussian that a weight could stand for.
FAINTEST = 10.0
#: A step to where a detector that reads light would have less than this, in standard deviations of
#: its power, is a step into the dark: there the readings do not tell the way back.
DARK = 1.0
#: An estimate that starts in the dark has so many steps to find the light.
STEPS_IN_THE_DARK = 8
#: After each so many steps the sum of squares must have fallen below this share of what it was
#: before them; else the estimate goes round in circles and is stalled.
PATIENCE, SLOWEST = 10, 0.9
#: A step that the damping has shortened by this much, and that still does not help: stalled.
HEAVIEST = 1e12
#: Rounding of a computed reading, relative to the detector's distance or to the power.
ROUNDING = 4e-15
UNKNOWNS = 9
ROWS = 9 + 3 + UNKNOWNS


class Problem(NamedTuple):
    """What is known beside the readings, and how to go on.

    means: (n or 1, 3) of bx, by (mm) and power (mW).  weight: (3,) 1/sigma of these, 0 where they
    are unknown.  free: (m,) numbers of the unknowns that are asked for, ascending.
    starts: (n or 1, 9), with the values of what is known.
    previous: whether to start where the last converged sample ended.
    damped: whether a step that does not help is shortened (Levenberg-Marquardt), or accepted.
    accept_unchecked: whether to estimate what no number is left to check.
    """

    means: Array
    weight: Array
    free: Array
    starts: Array
    previous: bool
    max_steps: int
    damped: bool
    accept_unchecked: bool


class Limits(NamedTuple):
    """What a reading is screened by.

    noise: (3,) a centroid's sigma (mm) at a power (mW), and a power's sigma (mW).
    half_sizes: (3, 2) of the detectors' sensitive areas, mm.  eight: leave out the last power.
    rounding: (2,) of a computed place, mm, and of a power, mW.
    """

    noise: Array
    half_sizes: Array
    eight: bool
    rounding: Array


#: The layers of a workspace: what the model gives, the weighted Jacobian's columns and residuals,
#: the normal equations here and at the step that is tried, and what is made of them.
FOUND, COLUMNS, HERE, THERE, FACTOR, INVERSE, COVARIANCE, VECTORS, LAYERS = range(9)
#: The rows of the layer VECTORS.
WEIGHTS, TRIAL = range(2)


class Workspace(NamedTuple):
    """Memory that every estimate of a batch uses again.

    layers: (LAYERS, 10, 10).  rows: (ROWS, 10) for the reflections.  outlines: see `model.kernels`.
    """

    layers: Array
    rows: Array
    outlines: Array


class Model(NamedTuple):
    """address: of a model of `model.evaluators`, or a function that does its work.

    packed: the sensor's vectors."""

    address: Any
    packed: Array


class Readings(NamedTuple):
    """values: (n, 9) mm, mW.  sigmas: (n, 9) their standard deviations; empty where those of
    `Limits` hold."""

    values: Array
    sigmas: Array


class Results(NamedTuple):
    """states: (n, 9), with the power.  used: (n, 3) the detectors that took part.
    status, steps: (n,).  residuals: (n,) root of the sum of squares left.
    covariances: (n, 8, 8), or empty.  Where status is not CONVERGED, states, residuals and
    covariances become NaN."""

    states: Array
    used: Array
    status: Array
    steps: Array
    residuals: Array
    covariances: Array


#: What a task's table holds: addresses of arrays, how many rows some of them have, and numbers.
(
    MODEL, PACKED, VALUES, SIGMAS, NOISE, HALF_SIZES, ROUNDINGS, MEANS, WEIGHT, FREE, STARTS,
    STATES, USED, STATUS, STEPS, RESIDUALS, COVARIANCES, LAYERS_AT, ROWS_AT, OUTLINES_AT,
    COUNT, COUNT_OF_SIGMAS, COUNT_OF_MEANS, COUNT_OF_FREE, COUNT_OF_STARTS, COUNT_OF_COVARIANCES,
    EIGHT, PREVIOUS, MOST_STEPS, DAMPED, ACCEPT_UNCHECKED, PLACES,
) = range(32)  # fmt: skip


class Task:
    """What `kernels.solve_rows` works on, arrays by their addresses; `address` is what it takes.

    The arrays are kept for as long as the task is.
    """

    def __init__(
        self,
        model: Model,
        readings: Readings,
        limits: Limits,
        problem: Problem,
        results: Results,
        memory: Workspace,
    ) -> None:
        self.parts = (model, readings, limits, problem, results, memory)
        where = [
            model.packed, readings.values, readings.sigmas,
            limits.noise, limits.half_sizes, limits.rounding,
            problem.means, problem.weight, problem.free, problem.starts,
            results.states, results.used, results.status, results.steps, results.residuals,
            results.covariances, memory.layers, memory.rows, memory.outlines,
        ]  # fmt: skip
        counted = (readings.values, readings.sigmas, problem.means, problem.free, problem.starts)
        self.table = np.array(
            [
                model.address,
                *map(address_of, where),
                *map(len, counted),
                len(results.covariances),
                limits.eight,
                problem.previous,
                problem.max_steps,
                problem.damped,
                problem.accept_unchecked,
            ],
            dtype=np.int64,
        )
        self.address = address_of(self.table)


def empty_results(count: int, covariance: bool) -> Results:
    return Results(
        states=np.empty((count, 9)),
        used=np.empty((count, 3), bool),
        status=np.empty(count, np.int8),
        steps=np.empty(count, np.int32),
        residuals=np.empty(count),
        covariances=np.empty((count if covariance else 0, 8, 8)),
    )


def workspace() -> Workspace:
    """Memory for the estimates of one thread."""
    return Workspace(
        np.empty((LAYERS, 10, 10)),
        np.empty((ROWS, 10)),
        np.empty((3, outlines.MOST, outlines.COLUMNS)),
    )


def some_rows(which: Any, readings: Readings, asked: Problem) -> tuple[Readings, Problem]:
    """Some of the readings, and what is asked of them."""
    n = len(readings.values)
    return (
        Readings(*(part_of(array, which, n) for array in readings)),
        asked._replace(
            means=part_of(asked.means, which, n), starts=part_of(asked.starts, which, n)
        ),
    )


def put_rows(found: Results, which: Array, some: Results) -> None:
    """Puts what was found of some readings in their places."""
    for whole, part in zip(found, some, strict=True):
        if len(whole):
            whole[which] = part
