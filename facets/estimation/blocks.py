"""Estimate poses by compiled code with one lane per reading, see `step` and `block_code`.

The result of a reading is independent of the other readings in its block.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.knowledge import Knowledge
from ..core.sensor import Sensor
from ..model.blocks import SINGLE, address_of, lane_code, lanes
from ..model.kinds import LIT, kind_of
from ..model.threads import once, part_of
from ..scalars.nesting import leaves
from .plan import count_checks, make_plan
from .problem import (
    CONVERGED,
    COVARIANCE,
    KEPT_ENTRIES,
    RESIDUAL,
    SCALES,
    STALLED,
    STATUS,
    UNKNOWNS,
    BlockTask,
    FitProblem,
    Form,
    Readings,
    Results,
    Scales,
    empty_results,
    put_rows,
    some_rows,
)
from .step import GOING

if TYPE_CHECKING:
    from ..model.block_code import LaneWrite

Array = Any
#: Compiled code that estimates blocks of readings; its argument is the address of a `BlockTask`.
Code = Callable[[int], None]

#: Number of readings in the first run of estimates in turn, and in the run after a reading without
#: a pose; each further run has twice as many.
FIRST_RUN = 8

#: Files on which the compiled code depends, in addition to the files of the model's blocks.
PARTS = (
    "block_code.py",
    "blocks.py",
    "problem.py",
    "step.py",
)


@once
def kernel(form: Form, width: int | None = None) -> Code:
    """Return the compiled code for a form, from a cache if possible.

    width: number of readings in a block; `lanes()` by default.
    """

    def make_writer() -> LaneWrite:
        from . import block_code

        return block_code.write_estimator(form)

    files = (Path(__file__).parent / part for part in PARTS)
    return lane_code(form.name, width or lanes(), 1, make_writer, *files)


def scales_of(readings: Readings, problem: FitProblem) -> Array:
    """Write the numbers of `Scales` into one array."""
    limits = problem.limits
    checks = count_checks(0, problem.free, problem.weight) - limits.eight
    scales = Scales(
        *limits._replace(eight=limits.rounding)[:4],
        problem.weight,
        len(readings.sigmas) > 0,
        limits.eight,
        checks,
        problem.accept_unchecked,
        problem.damped,
        problem.max_steps,
        problem.least_redundancy,
    )
    numbers = np.concatenate([np.ravel(part) for part in scales])
    assert len(numbers) == len(list(leaves(SCALES)))
    return numbers


def estimate_blocks(
    code: Code,
    packed: Array,
    readings: Readings,
    problem: FitProblem,
    results: Results,
    patient: bool = False,
) -> None:
    """Estimate readings in blocks, and write them into `results`.

    Blocks do not wait for readings that need many steps; these are estimated again, together in
    further blocks.

    code: from `kernel`.  packed: the sensor's vectors, or a row of them for each reading.  patient:
    whether blocks wait for all readings.
    """
    n = len(readings.values)
    full, ends = n // lanes() * lanes(), np.empty((n, 5))
    inputs = (readings.values, weights_of(readings), problem.means, problem.starts)
    outputs = (results.states, ends, results.residuals, results.covariances)
    scales = scales_of(readings, problem)

    def run(which: Any, part: Sequence[Array]) -> None:
        sensors = packed[which] if packed.ndim > 1 else packed
        some = (part_of(rows, which, n) for rows in inputs)
        run_blocks(code, (sensors, scales, *some, *part), patient)

    if full:
        run(slice(full), [rows[:full] for rows in outputs])
    if n > full:
        part = [np.empty((lanes(), *rows.shape[1:])) for rows in outputs]
        run(np.minimum(np.arange(full, full + lanes()), n - 1), part)  # repeats the last reading
        for rows, some in zip(outputs, part, strict=True):
            rows[full:] = some[: n - full]
    put_ends(ends, results)
    late = np.flatnonzero(results.status == GOING)
    if len(late):
        repeated = empty_results(len(late), results.covariances.shape[1] > 0)
        sensors = packed[late] if packed.ndim > 1 else packed
        estimate_blocks(code, sensors, *some_rows(late, readings, problem), repeated, patient=True)
        put_rows(results, late, repeated)


def put_ends(ends: Array, results: Results) -> None:
    """Write the `ends` of a `BlockTask` into results."""
    columns = (results.status, results.steps, *results.used.T)
    for column, numbers in zip(columns, ends.T, strict=True):
        column[:] = numbers


def run_blocks(
    code: Code, arrays: Sequence[Array], patient: bool, width: int | None = None
) -> None:
    """Run compiled code on complete blocks.

    arrays: in the order of `BlockTask`.  width: readings in a block; `lanes()` by default.
    """
    _, _, values, _, means, starts, *_ = arrays
    count = len(values)
    has_own_rows = (True, len(means) == count, len(starts) == count)
    blocks = count // (width or lanes())
    task = task_of(arrays, (*has_own_rows, 0, patient), blocks)  # must live while the code runs
    code(address_of(task))


def weights_of(readings: Readings) -> Array:
    """Weights (n, 9) of readings from their standard deviations; without these, an unused array of
    this shape."""
    with np.errstate(all="ignore"):
        return 1 / readings.sigmas if len(readings.sigmas) else readings.values


def task_of(arrays: Sequence[Array], flags: Sequence[int], blocks: int) -> Array:
    """Write a `BlockTask` into memory.  arrays, flags: in its order; covariances may be empty."""
    places = [address_of(array) if array.size else 0 for array in arrays]
    return np.array(BlockTask._make((*places, *flags, blocks)), np.int64)


class KeptBlocks:
    """Memory that is reused for estimates of a few readings at a time.

    `estimate` uses the present contents of `readings` and `problem`: a single reading, which all
    lanes estimate, or as many as fill complete blocks.
    numbers: (n, k) a row of the numbers of a `LazySolution` for each reading; the next estimate
    overwrites it.
    """

    def __init__(
        self,
        packed: Array,
        readings: Readings,
        problem: FitProblem,
        covariance: bool,
    ) -> None:
        self._readings, self._weights = readings, weights_of(readings)
        count, width = len(readings.values), COVARIANCE + (len(KEPT_ENTRIES) if covariance else 0)
        self.numbers = np.zeros((count, width))
        row = self.numbers[0]
        arrays = (
            packed, scales_of(readings, problem), readings.values, self._weights,
            problem.means, problem.starts, row, row[STATUS:], row[RESIDUAL:], row[COVARIANCE:],
        )  # fmt: skip
        flags = (count > 1, False, False, width if count > 1 else 0, True)
        self._arrays, self._task = arrays, task_of(arrays, flags, max(count // lanes(), 1))
        self._address = address_of(self._task)

    def estimate(self, code: Code) -> None:
        """Estimate the readings, and write `numbers`.  code: from `kernel`."""
        if len(self._readings.sigmas):
            self._weights[:] = weights_of(self._readings)
        code(self._address)


def estimate_in_turn(
    code: Code,
    packed: Array,
    readings: Readings,
    problem: FitProblem,
    results: Results,
) -> None:
    """Estimate readings one after the other, and write them into `results`.

    Each reading starts from the solution of the last converged one and, if this leads to no pose,
    again from its own start. Arguments as for `estimate_blocks`; code: for blocks of `SINGLE`
    lanes.
    """
    count, near, n, length = len(readings.values), None, 0, FIRST_RUN
    fixed = np.delete(np.arange(UNKNOWNS), problem.free)
    changes = (np.diff(problem.starts[:, fixed], axis=0) != 0).any(axis=1)
    ends = np.append(np.flatnonzero(changes) + 1, count)

    def follow_from(free: Array | None, first: int, last: int) -> Results:
        some_readings, some_problem = some_rows(slice(first, last), readings, problem)
        begin = some_problem.starts[0].copy()
        if free is not None:
            begin[problem.free] = free
        covariance = results.covariances.shape[1] > 0
        return follow(code, packed, some_readings, some_problem._replace(starts=begin), covariance)

    while n < count:
        steps = 0
        if near is not None:
            last = min(n + length, ends[np.searchsorted(ends, n, side="right")])
            chain = follow_from(near, n, last)
            ok = np.append(chain.status == CONVERGED, False)
            good = int(ok.argmin())
            put_rows(results, slice(n, n + good), Results(*(part[:good] for part in chain)))
            near = chain.states[good - 1, problem.free] if good else near
            n += good
            length = 2 * length if n == last else FIRST_RUN
            if n == last:
                continue
            steps = chain.steps[good]
        chain = follow_from(None, n, n + 1)
        chain.steps[:] += steps
        put_rows(results, slice(n, n + 1), chain)
        if chain.status[0] == CONVERGED:
            near = chain.states[0, problem.free]
        n += 1


def follow(
    code: Code,
    packed: Array,
    readings: Readings,
    problem: FitProblem,
    covariance: bool,
) -> Results:
    """Estimate each reading from the solution of the previous one, the first from the start (9,).

    After a reading without a pose, no further one has a pose. The array of starts is the array of
    states, shifted by one row.
    """
    count = len(readings.values)
    states, ends = np.empty((SINGLE * (count + 1), UNKNOWNS)), np.empty((SINGLE * count, 5))
    states[:SINGLE] = problem.starts
    values, weights, means = (
        np.repeat(rows, SINGLE, axis=0) if len(rows) == count else rows
        for rows in (readings.values, weights_of(readings), problem.means)
    )
    results = empty_results(SINGLE * count, covariance)
    run_blocks(
        code,
        (
            packed, scales_of(readings, problem), values, weights, means,
            states[:-SINGLE], states[SINGLE:], ends, results.residuals, results.covariances,
        ),
        patient=True,
        width=SINGLE,
    )  # fmt: skip
    put_ends(ends, results)
    return Results(states[SINGLE::SINGLE], *(part[::SINGLE] for part in results[1:]))


def estimate(
    kind: str,
    packed: Array,
    readings: Readings,
    request: FitProblem,
    results: Results,
    exact: bool = False,
) -> None:
    """Estimate the states of readings, and write them into `results`.

    Under real light, stalled estimates are repeated with exact derivatives.

    kind, exact: as in `Form`.  packed: the sensor's vectors, or a row of them for each reading.
    """
    is_varied = packed.ndim > 1
    code = find_code(kind, request, exact, SINGLE if request.previous else None, is_varied)
    run = estimate_in_turn if request.previous else estimate_blocks
    run(code, packed, readings, request, results)
    stalled = np.flatnonzero(results.status == STALLED) if kind in LIT and not exact else ()
    if len(stalled):
        repeated = empty_results(len(stalled), results.covariances.shape[1] > 0)
        some, questions = some_rows(stalled, readings, request)
        vectors = packed[stalled] if is_varied else packed
        estimate(kind, vectors, some, questions._replace(previous=False), repeated, exact=True)
        put_rows(results, stalled, repeated)


def find_code(
    kind: str,
    request: FitProblem,
    exact: bool = False,
    width: int | None = None,
    is_varied: bool = False,
) -> Code:
    """Return the code that estimates blocks of readings, from a cache if possible.

    kind, exact, is_varied: as in `Form`.  width: see `kernel`.
    """
    return kernel(Form(tuple(request.free.tolist()), kind, exact, is_varied), width)


def prepare(sensor: Sensor, knowledge: Knowledge) -> None:
    """Compile or load all code that a reading may need, before a live loop needs it."""
    free, kind = tuple(make_plan(sensor, knowledge).free.tolist()), kind_of(sensor)
    for exact in (False, True) if kind in LIT else (False,):
        for width in (None, SINGLE):
            kernel(Form(free, kind, exact), width)
