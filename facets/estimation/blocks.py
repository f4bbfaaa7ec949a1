"""Estimates of several poses at once: undamped Gauss-Newton steps on blocks of readings.

What `gauss_newton.estimate` does where all goes well, as straight code (`block_code`) with a lane
for each reading: all detectors lit, each step better than the one before, normal equations that
hold their digits, an end within a few steps. A lane where it does not go well is left, and
estimated anew by `kernels`. What a reading gives does not depend on the others in its block.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ..model.blocks import CODE, LANES, address_of, lanes_of
from .chance import Chance, count_checks
from .problem import CONVERGED, PATIENCE, UNKNOWNS, Limits, Problem, Readings, Results
from .solution import CHECKS, COVARIANCE, RESIDUAL

Array = Any
#: Estimates blocks of readings, of the address of a task's table.
Code = Callable[[int], None]

#: Steps after which a lane is left: before the slowness of a fit is looked at.
MOST = PATIENCE - 1
#: Which unknowns can be asked for: the beam free or known, its power known or not.
QUESTIONS = ((0, 1, 2, 3, 4, 5, 6, 7), (0, 1, 2, 3, 4, 5), tuple(range(9)), (0, 1, 2, 3, 4, 5, 8))
#: Where the numbers of a question are in its table.
NOISE, HALF_SIZES, ROUNDING, WEIGHT, NUMBERS = 0, 3, 9, 11, 14


#: What a task's table holds: addresses of the sensor's vectors, of the numbers of `table_of`, of
#: arrays of `Readings`, `Problem` and `Results` (0 where no covariances are asked for), and of bits
#: for each block that tell which lanes are left. Whether the readings have weights of their own;
#: else that address is any of such rows. Whether each lane has rows of its own in the readings,
#: weights and results, in the means, and in the starts. The most steps, and the number of blocks.
(
    PACKED, TABLE, VALUES, WEIGHTS, MEANS, STARTS, STATES, STEPS, RESIDUALS, COVARIANCES, LEFT,
    WEIGHED, ROWS, MEANS_ROWS, STARTS_ROWS, MOST_STEPS, BLOCKS, PLACES,
) = range(18)  # fmt: skip


#: The files that this is made of, beside those of the model's blocks.
PARTS = ("block_code.py", "blocks.py", "problem.py", "straight.py", "normal_equations.py")


@cache
def kernel(free: tuple[int, ...], kind: str) -> Code:
    """The compiled function for one of QUESTIONS and a kind of light, see `kinds.block_kind`;
    compiled now if need be."""
    from ..model.object_code import Write, function

    def written() -> Write:
        from . import block_code

        return block_code.estimating(free, kind)

    files = (Path(__file__).parent / part for part in PARTS)
    return function(f"estimate_{len(free)}_of_{kind}", 1, written, *CODE, *files)


def fits(problem: Problem) -> bool:
    """Whether blocks know what is asked: damped steps, each reading by itself, and checked."""
    return (
        problem.damped
        and not problem.previous
        and tuple(problem.free.tolist()) in QUESTIONS
        and (problem.accept_unchecked or count_checks(3, problem.free, problem.weight) > 0)
    )


def table_of(limits: Limits, problem: Problem) -> Array:
    table = np.empty(NUMBERS)
    table[NOISE:HALF_SIZES], table[HALF_SIZES:ROUNDING] = limits.noise, limits.half_sizes.ravel()
    table[ROUNDING:WEIGHT], table[WEIGHT:] = limits.rounding, problem.weight
    return table


def estimate(
    code: Code,
    packed: Array,
    readings: Readings,
    limits: Limits,
    problem: Problem,
    results: Results,
) -> Array:
    """Fills `results`; returns the numbers of the readings that are left, whose results mean
    nothing.

    code: from `kernel`.  The arrays are those of `kernels.solve_rows`.
    """
    n = len(readings.values)
    whole = n // LANES * LANES
    weights = inverse_of(readings.sigmas)
    table, left = table_of(limits, problem), np.zeros(n // LANES + 1, np.int64)
    steps, given = np.empty(n), (readings.values, weights, problem.means, problem.starts)
    found = (results.states, steps, results.residuals, results.covariances)
    if whole:
        run(code, packed, table, problem, whole, given, found, left)
    if n > whole:
        parts = tuple(padded(array, whole, n) for array in given)
        rest = tuple(np.empty((LANES if len(a) else 0, *a.shape[1:])) for a in found)
        run(code, packed, table, problem, LANES, parts, rest, left[-1:])
        for array, part in zip(found, rest, strict=True):
            array[whole:] = part[: len(array[whole:])]
    results.steps[:], results.status[:], results.used[:] = steps, CONVERGED, True
    return lanes_of(left, n) if left.any() else ()


def inverse_of(sigmas: Array) -> Array:
    """Weights from standard deviations; of a spoilt reading these can be anything."""
    with np.errstate(all="ignore"):
        return 1 / sigmas


def padded(rows: Array, first: int, n: int) -> Array:
    """A block of the rows from the first on; what all readings share as it is."""
    if len(rows) != n:
        return rows
    return rows[np.minimum(np.arange(first, first + LANES), n - 1)]


def run(
    code: Code, packed: Array, table: Array, problem: Problem, count: int, given: Any, found: Any,
    left: Array,
) -> None:  # fmt: skip
    """Blocks of `count` readings; given, found: arrays as in `estimate`."""
    values, weights, means, starts = given
    arrays = (packed, table, values, weights, means, starts, *found, left)
    rows = (1, len(means) >= count > 1, len(starts) >= count > 1)
    task = task_of(arrays, len(weights) > 0, rows, problem, count // LANES)
    code(address_of(task))


def task_of(
    arrays: Sequence[Array], weighed: bool, rows: Sequence[int], problem: Problem, blocks: int
) -> Array:
    """A task's table.  arrays: in its order, the weights and the covariances maybe empty."""
    places = [address_of(array) if array.size else 0 for array in arrays]
    if not weighed:
        places[WEIGHTS] = places[VALUES]
    most = min(problem.max_steps, MOST)
    return np.array([*places, weighed, *rows, most, blocks], np.int64)


class One:
    """A block for one reading at a time, whose memory is kept; all lanes have the same reading.

    It reads what `given` and `problem` have in their memory when it is asked.
    numbers: what is found, at the places of `SolutionOfOne`; overwritten by the next reading.
    state: (9,) of them.
    """

    def __init__(
        self,
        code: Code,
        packed: Array,
        given: Readings,
        limits: Limits,
        problem: Problem,
        chance: Chance,
        covariance: bool,
    ) -> None:
        self._kernel, self._sigmas = code, given.sigmas
        self.numbers = np.empty(COVARIANCE + (64 if covariance else 0))
        self.state = self.numbers[:UNKNOWNS]
        self._weights, left = np.empty_like(given.sigmas), np.empty(1, np.int64)
        state, steps, residual, checks, covariances = np.split(
            self.numbers, (UNKNOWNS, RESIDUAL, CHECKS, COVARIANCE)
        )
        checks[:] = chance.checks(np.ones(3, bool)), chance.limit
        arrays = (
            packed, table_of(limits, problem), given.values, self._weights, problem.means,
            problem.starts, state, steps, residual, covariances, left,
        )  # fmt: skip
        self._kept, self._left = arrays, left.data
        self._task = task_of(arrays, len(given.sigmas) > 0, (0, 0, 0), problem, 1)
        self._address = address_of(self._task)

    def estimate(self) -> bool:
        """Fills `numbers`; whether it could."""
        if len(self._sigmas):
            self._weights[:] = inverse_of(self._sigmas)
        self._kernel(self._address)
        return not self._left[0]
