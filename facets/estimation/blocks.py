"""Estimate several poses at once: Gauss-Newton steps on blocks of readings.

Straight code (`block_code`) does the usual case of `gauss_newton.estimate` with one lane for each
reading: all detectors lit, normal equations that hold their digits, an end within a few steps, each
better than the one before. A lane where it does not go well is left, and estimated anew by
`kernels`; under the light of a bench first in blocks of what was left, with steps that are damped
where they do not help. What a reading gives does not depend on the others in its block.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..model.blocks import address_of, lane_code, lanes, lanes_of
from ..model.threads import once
from ..scalars.nesting import leaves
from .block_task import QUESTIONS, SCALES, BlockTask, Form, Scales
from .chance import Chance, count_checks
from .problem import (
    CONVERGED,
    PROGRESS_INTERVAL_STEPS,
    STALLED,
    UNKNOWNS,
    FitProblem,
    Readings,
    Results,
    ScreeningLimits,
    empty_results,
    put_rows,
    some_rows,
)
from .solution import CHECKS, COVARIANCE, RESIDUAL

if TYPE_CHECKING:
    from ..model.block_code import LaneWrite

Array = Any
#: Estimates blocks of readings, of the address of a task.
Code = Callable[[int], None]

#: Steps after which a lane is left unless the task is patient: before the slowness of a fit is
#: looked at.
MOST = PROGRESS_INTERVAL_STEPS - 1
#: The files that this is made of, beside those of the model's blocks.
PARTS = (
    "block_code.py",
    "block_task.py",
    "blocks.py",
    "problem.py",
    "straight.py",
    "normal_equations.py",
)


@once
def kernel(form: Form, width: int | None = None) -> Code:
    """The compiled function for a form, in blocks of a width, `lanes()` unless given; compiled now
    if need be."""

    def make_writer() -> LaneWrite:
        from . import block_code

        return block_code.write_estimator(form)

    files = (Path(__file__).parent / part for part in PARTS)
    return lane_code(form.name, width or lanes(), 1, make_writer, *files)


def is_supported(problem: FitProblem) -> bool:
    """Whether blocks support the request: damped steps, independent readings, and checked poses."""
    return (
        problem.damped
        and not problem.previous
        and tuple(problem.free.tolist()) in QUESTIONS
        and (problem.accept_unchecked or count_checks(3, problem.free, problem.weight) > 0)
    )


def scales_of(limits: ScreeningLimits, problem: FitProblem) -> Array:
    parts = Scales(limits.noise, limits.light, limits.half_sizes, limits.rounding, problem.weight)
    scales = np.concatenate([np.ravel(part) for part in parts])
    assert len(scales) == len(list(leaves(SCALES)))
    return scales


def estimate(
    code: Code,
    packed: Array,
    readings: Readings,
    limits: ScreeningLimits,
    problem: FitProblem,
    results: Results,
    patient: bool = False,
) -> Array:
    """Fills `results`; returns the numbers of the readings that are left, whose results mean
    nothing.

    code: from `kernel`.  The arrays are those of `kernels.solve_rows`.  patient: see `BlockTask`.
    """
    n = len(readings.values)
    whole = n // lanes() * lanes()
    weights = inverse_of(readings.sigmas)
    ends = np.zeros((2, n // lanes() + 1), np.int64)
    steps, arguments = np.empty(n), (readings.values, weights, problem.means, problem.starts)
    found = (results.states, steps, results.residuals, results.covariances)

    def run(arguments: Any, found: Any, ends: Array) -> None:
        arrays = (packed, scales_of(limits, problem), *arguments, *found, *ends)
        count = len(found[0])
        own = (True, *(len(rows) == count > 1 for rows in arguments[2:]))
        task = task_of(arrays, len(weights) > 0, own, problem, patient, count // lanes())
        code(address_of(task))

    if whole:
        run(
            [first_rows(rows, whole, n) for rows in arguments],
            [rows[:whole] for rows in found],
            ends,
        )
    if n > whole:
        rest = [np.empty((lanes() if len(rows) else 0, *rows.shape[1:])) for rows in found]
        run([pad_rows(rows, whole, n) for rows in arguments], rest, ends[:, -1:])
        for rows, part in zip(found, rest, strict=True):
            rows[whole:] = part[: len(rows[whole:])]
    results.steps[:], results.status[:], results.used[:] = steps, CONVERGED, True
    left, stalled = (lanes_of(bits, n) for bits in ends)
    give_up(results, stalled)
    return left


def give_up(results: Results, which: Array) -> None:
    """Gives some readings the status STALLED, and NaN for what was found."""
    if not len(which):
        return
    results.status[which] = STALLED
    for rows in (results.states, results.residuals, results.covariances):
        if len(rows):
            rows[which] = np.nan


def estimate_some(
    code: Code,
    which: Array,
    packed: Array,
    readings: Readings,
    limits: ScreeningLimits,
    problem: FitProblem,
    results: Results,
) -> Array:
    """Estimates some readings anew, side by side, with steps that are damped where they do not
    help; returns the numbers of those that are left."""
    again = empty_results(len(which), len(results.covariances) > 0)
    some, questions = some_rows(which, readings, problem)
    left = estimate(code, packed, some, limits, questions, again, patient=True)
    put_rows(results, which, again)
    return which[left]


def inverse_of(sigmas: Array) -> Array:
    """Weights from standard deviations; those of a spoilt reading can be any number."""
    with np.errstate(all="ignore"):
        return 1 / sigmas


def first_rows(rows: Array, count: int, n: int) -> Array:
    """The first rows; an array that all readings share stays as it is."""
    return rows[:count] if len(rows) == n else rows


def pad_rows(rows: Array, first: int, n: int) -> Array:
    """A block of the rows from the first on; what all readings share as it is."""
    if len(rows) != n:
        return rows
    return rows[np.minimum(np.arange(first, first + lanes()), n - 1)]


def task_of(
    arrays: Sequence[Array], weighed: bool, own: Sequence[bool], problem: FitProblem, patient: bool,
    blocks: int,
) -> Array:  # fmt: skip
    """A `BlockTask` in memory.  arrays: in its order; weights and covariances may be empty."""
    places = [address_of(array) if array.size else 0 for array in arrays]
    addresses = BlockTask(*places, *[0] * (len(BlockTask._fields) - len(places)))
    most = problem.max_steps if patient else min(problem.max_steps, MOST)
    task = addresses._replace(
        weights=addresses.weights if weighed else addresses.values,
        weighed=weighed,
        own_rows=own[0],
        own_means=own[1],
        own_starts=own[2],
        patient=patient,
        most_steps=most,
        blocks=blocks,
    )
    return np.array(task, np.int64)


class SingleBlock:
    """A block for one reading at a time, whose memory is kept; all lanes have the same reading.

    It reads what `readings` and `problem` have in their memory when it is asked.
    numbers: what is found, at the places of `SolutionOfOne`; overwritten by the next reading.
    state: (9,) of them.
    """

    def __init__(
        self,
        packed: Array,
        readings: Readings,
        limits: ScreeningLimits,
        problem: FitProblem,
        chance: Chance,
        covariance: bool,
    ) -> None:
        self._sigmas = readings.sigmas
        self.numbers = np.empty(COVARIANCE + (64 if covariance else 0))
        self.state = self.numbers[:UNKNOWNS]
        self._weights, ends = np.empty_like(readings.sigmas), np.empty((2, 1), np.int64)
        state, steps, residual, checks, covariances = np.split(
            self.numbers, (UNKNOWNS, RESIDUAL, CHECKS, COVARIANCE)
        )
        checks[:] = chance.checks(np.ones(3, bool)), chance.limit
        arrays = (
            packed, scales_of(limits, problem), readings.values, self._weights, problem.means,
            problem.starts, state, steps, residual, covariances, *ends,
        )  # fmt: skip
        self._kept, self._left, self._stalled = arrays, ends[0].data, ends[1].data
        shared = (False, False, False)
        self._task = task_of(arrays, len(readings.sigmas) > 0, shared, problem, True, 1)
        self._address = address_of(self._task)

    def estimate(self, code: Code) -> int | None:
        """Fills `numbers` where the estimate converges.

        Returns whether it is CONVERGED or STALLED; None where other code has to find out.  code:
        from `kernel`.
        """
        if len(self._sigmas):
            self._weights[:] = inverse_of(self._sigmas)
        code(self._address)
        if self._left[0]:
            return None
        return STALLED if self._stalled[0] else CONVERGED
