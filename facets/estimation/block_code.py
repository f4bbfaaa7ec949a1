"""Write the machine code of `blocks`: Gauss-Newton steps with one lane per reading.

This module is imported only if the code is not cached.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import nan
from typing import Any, NamedTuple

from llvmlite import ir

from ..model.block_code import LaneWrite, linearise_exactly, pointers_to
from ..model.kinds import CUT
from ..model.packing import complete_light, row_size, vectors_at, vectors_of
from ..optics import bench_gradient, gradient
from ..optics.forward import replace_power
from ..scalars.lane_rows import load_rows, store_rows
from ..scalars.lanes import LONG, LaneMemory, LaneWriter
from ..scalars.nesting import leaves, nest
from .problem import (
    CONVERGED,
    KEPT_ENTRIES,
    PROGRESS_INTERVAL_STEPS,
    SCALES,
    UNKNOWNS,
    BlockTask,
    Form,
)
from .step import (
    MIN_DAMPING,
    State,
    covariance_of,
    final_status,
    first_state,
    residual_of,
    screen_reading,
    step,
    unknown_slopes,
)

Numbers = list[Any]


def write_estimator(form: Form) -> LaneWrite:
    """Return the writer of a machine-code function that estimates the readings of a `BlockTask`,
    whose address is its argument."""

    def write(builder: Any, arguments: Sequence[Any], begin_code: Any) -> None:
        at = builder.inttoptr(arguments[0], ir.PointerType(LONG))
        numbers = range(len(BlockTask._fields))
        task = BlockTask(*(builder.load(builder.gep(at, [ir.Constant(LONG, n)])) for n in numbers))
        code = begin_code(builder)
        rows = BlockRows(code, task, form)
        with code.loop(task.blocks) as index:
            rows.begin(index)
            write_block(rows)

    return write


def write_block(rows: BlockRows) -> None:
    """Write the code that estimates the readings of one block."""
    code, task, form = rows.code, rows.task, rows.form
    reading, status, used = screen_reading(
        form, rows.read("values", 9, task.own_rows), rows.read("weights", 9, task.own_rows),
        rows.read("means", 3, task.own_means), rows.scales,
    )  # fmt: skip
    first = first_state(rows.read("starts", UNKNOWNS, task.own_starts), form, status)

    def advance(state: State, begins: Any) -> State:
        def optics(x: Sequence[Any]) -> Any:
            return reuse_start(rows, begins, lambda: linearise(code, rows.vectors, x, form))

        return step(state, reading, optics)

    end = iterate(code, first, advance, task.patient)
    status = final_status(end, reading, used)
    write_results(rows, end._replace(status=status), used, form.free)


def iterate(
    code: LaneWriter, first: State, advance: Callable[[State, Any], State], patient: Any
) -> State:
    """Write the loop over steps, which ends when all lanes have, and return the last state.

    advance: writes one step from a state; its second argument is a bit that is set in the first
    step.  patient: 0 if the loop does not wait for lanes that need many steps.
    """
    # Separate cells, so that the compiler can replace them by registers.
    memory = [LaneMemory(code) for _ in leaves(first)]

    def keep(state: State) -> None:
        for cell, number in zip(memory, leaves(state), strict=True):
            cell[0] = number

    def load() -> State:
        return nest(first, (cell[0] for cell in memory))  # type: ignore[no-any-return]

    keep(first)
    waits = code.same(code.builder.icmp_signed("!=", patient, ir.Constant(LONG, 0)))
    with code.do_while() as repetition:
        new = advance(load(), repetition.first)
        keep(new)
        going = new.status < CONVERGED
        usual = (new.damping < MIN_DAMPING) & (new.steps < PROGRESS_INTERVAL_STEPS - 1.5)
        repetition.repeats = code.any(going & (usual | waits))
    return load()


def reuse_start(rows: BlockRows, begins: Any, compute: Callable[[], Any]) -> Any:
    """Write the code of `compute`; with the same start for all readings, later blocks load the
    first block's results instead.

    begins: a bit that is set at the start.
    """
    if rows.form.varied:
        return compute()
    code, build = rows.code, rows.code.builder
    shares = build.icmp_signed("==", rows.task.own_starts, ir.Constant(LONG, 0))
    begins = build.and_(begins, shares)
    later = build.icmp_signed(">", rows.first, ir.Constant(LONG, 0))
    # The readings and their derivatives; some are products of two numbers each.
    most = 9 * (3 + len(rows.form.free))
    return code.compute_unless(build.and_(begins, later), compute, begins, most)


def write_results(rows: BlockRows, end: State, used: Numbers, free: Sequence[int]) -> None:
    """Write code that stores the results of the last state; NaN without a pose."""
    code, converged = rows.code, end.status < 0.5

    def write(name: str, numbers: Sequence[Any]) -> None:
        rows.write(name, [code.select(converged, number, nan) for number in numbers])

    write("states", end.trial)
    write("residuals", [residual_of(end)])
    rows.write("ends", [end.status, end.steps, *used])
    has_covariances = code.builder.icmp_signed("!=", rows.task.covariances, ir.Constant(LONG, 0))
    with code.builder.if_then(has_covariances), code.scope():
        covariance = covariance_of(end.factor, free)
        write("covariances", [covariance[i][j] for i, j in KEPT_ENTRIES])


class LoadedRows(NamedTuple):
    """Numbers of each lane's own row, in the form that `packing.vectors_at` loads."""

    numbers: Numbers

    def load(self, pointer: Any, index: int) -> Any:
        return self.numbers[index]


class BlockRows:
    """A block's rows in the arrays of a task.

    scales: the numbers that all readings have in common, as `Scales`.  vectors: of the sensor; in a
    varied form, of each lane's sensor.  first: number of the block's first row.
    """

    def __init__(self, code: LaneWriter, task: BlockTask, form: Form) -> None:
        """task: its numbers, loaded by the code."""
        self.code, self.task, self.form = code, task, form
        self.pointers = BlockTask(*pointers_to(code.builder, task))
        if not form.varied:
            self.vectors = vectors_of(code, self.pointers.packed, form.kind)

    def begin(self, index: Any) -> None:
        """Begin the block with the number `index`."""
        code, kind = self.code, self.form.kind
        self.first = code.builder.mul(index, ir.Constant(LONG, code.lanes))
        self.scales = vectors_at(code, self.pointers.scales, SCALES)
        if self.form.varied:
            size = row_size(kind)
            first = code.builder.mul(self.first, ir.Constant(LONG, size))
            start = code.builder.gep(self.pointers.packed, [first])
            self.vectors = vectors_of(LoadedRows(load_rows(code, start, size, size)), None, kind)

    def read(self, name: str, width: int, has_own_rows: Any) -> Numbers:
        """Read rows of `width` numbers.

        has_own_rows: 1 if each lane has a row, 0 if all lanes have the same row.
        """
        stride = self.code.builder.mul(has_own_rows, ir.Constant(LONG, width))
        return load_rows(self.code, self._first_row(name, stride), stride, width)

    def write(self, name: str, numbers: Numbers) -> None:
        build, result_stride = self.code.builder, self.task.result_stride
        close = build.mul(self.task.own_rows, ir.Constant(LONG, len(numbers)))
        has_stride = build.icmp_signed("!=", result_stride, ir.Constant(LONG, 0))
        stride = build.select(has_stride, result_stride, close)
        store_rows(self.code, numbers, self._first_row(name, stride), stride)

    def _first_row(self, name: str, stride: Any) -> Any:
        build = self.code.builder
        return build.gep(getattr(self.pointers, name), [build.mul(self.first, stride)])


def linearise(code: Any, vectors: Any, x: Sequence[Any], form: Form) -> Any:
    """The readings of detectors A, B and C, and their derivatives by the free unknowns.

    code: the writer, which only exact derivatives use.
    """
    state, places = tuple(x[:8]), [c for c in form.free if c < 8]
    vectors = replace_power(vectors, x[8])
    text: Any
    if form.kind == "plain":
        text = gradient.linearise(vectors, state)
    elif form.exact or form.kind in CUT:
        text = linearise_exactly(code, vectors, state, len(places))
    else:
        text = bench_gradient.linearise_nearly(vectors, state)
    detectors = unknown_slopes(complete_light(vectors), text, form.free)
    return tuple((tuple(values), tuple(map(tuple, rows))) for values, rows in detectors)
