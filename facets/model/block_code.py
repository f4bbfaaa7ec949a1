"""Writers of the machine code of blocks: the model with one lane for each pose.

Imported only if no compiled code is stored.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import nan
from typing import Any

from llvmlite import ir

from ..optics import bench_gradient, gradient
from ..optics.exact_text import BENCH, CUT as CUT_TEXT, IDEAL, ExactText
from ..optics.footprint import footprints
from ..optics.forward import Geometry
from ..scalars.dual import Dual
from ..scalars.lane_rows import load_rows, store_column, store_rows
from ..scalars.lanes import DOUBLE, LONG, LaneMemory, LaneWriter
from ..scalars.nesting import leaves
from ..scalars.tracing import Value
from .kinds import ANY_LIGHT, CUT, LIT
from .packing import (
    EXAMPLE,
    PACKED,
    PARALLEL,
    carry_slopes,
    complete_light,
    is_cut,
    is_ideal,
    vectors_at,
    vectors_of,
)

#: Writes the computation of a block of poses, from the sensor's vectors and pointers to the input
#: and the output.
Formula = Callable[[LaneWriter, Geometry, Any, Any], None]


#: Writes a function's instructions with an `llvmlite` builder, from the function's arguments. The
#: last argument makes a `LaneWriter` for the builder.
LaneWrite = Callable[[Any, Sequence[Any], Callable[[Any], LaneWriter]], None]

#: Loads a sensor's vectors.
Load = Callable[[LaneWriter, Any], Geometry]


def each_block(formula: Formula, load: Load, size: int) -> LaneWrite:
    """Write the loop over blocks for a formula of states, as `blocks.kernel` needs it.

    load: loads the vectors that the formula takes.  size: number of results at a state.
    """

    def write(builder: Any, arguments: Sequence[Any], begin_code: Any) -> None:
        """Write the loop that applies the formula to each block of states."""
        packed, states, results = pointers_to(builder, arguments[:3])
        code = begin_code(builder)
        vectors = load(code, packed)
        with code.loop(arguments[3]) as index:
            states_at, results_at = (
                builder.gep(pointer, [builder.mul(index, ir.Constant(LONG, code.lanes * numbers))])
                for pointer, numbers in ((states, 8), (results, size))
            )
            formula(code, vectors, states_at, results_at)

    return write


def pointers_to(builder: Any, addresses: Sequence[Any]) -> list[Any]:
    """Pointers to doubles at integer addresses."""
    return [builder.inttoptr(address, ir.PointerType(DOUBLE)) for address in addresses]


def write_readings(code: LaneWriter, vectors: Geometry, states: Any, results: Any) -> None:
    """Write nine readings to a row of `results` for each row of eight numbers of a state."""
    text = text_of(vectors)
    at = text.scene(vectors, tuple(load_rows(code, states, 8, 8)))
    store_rows(code, list(leaves(text.readings(vectors, at))), results, 9)


def write_derivatives(code: LaneWriter, vectors: Geometry, states: Any, results: Any) -> None:
    """Write nine rows of eight derivatives to `results` for each state; NaN where there is no
    reading.

    Under real light they are those of `bench_gradient.linearise_nearly`.
    """
    text = gradient.linearise if is_ideal(vectors) else bench_gradient.linearise_nearly
    detectors = text(vectors, tuple(load_rows(code, states, 8, 8)))
    store_rows(code, lit_rows(code, detectors), results, 72)


def write_exact_derivatives(code: LaneWriter, vectors: Geometry, states: Any, results: Any) -> None:
    """Write the results of `write_derivatives`, exact under any light."""
    detectors = linearise_exactly(code, vectors, load_rows(code, states, 8, 8), 8)
    store_rows(code, lit_rows(code, detectors), results, 72)


def lit_rows(code: LaneWriter, detectors: Any) -> list[Value]:
    """The derivatives of the readings in order; NaN where there is no reading."""
    derivatives: list[Value] = []
    for values, rows in detectors:
        for value, row in zip(values, rows, strict=True):
            lit = code.compare("==", value, value)
            derivatives += [code.select(lit, each, nan) for each in row]
    return derivatives


def write_footprints(code: LaneWriter, vectors: Geometry, states: Any, results: Any) -> None:
    """Write fifteen numbers to a row of `results` for each state, five of `footprint` for each
    spot."""
    ends: list[Any] = []
    for *edges, out in footprints(complete_light(vectors), tuple(load_rows(code, states, 8, 8))):
        landed = code.compare("==", edges[0], edges[0])  # in lanes, x - x is zero also for NaN
        ends += [*edges, code.select(landed, out, nan)]
    store_rows(code, ends, results, 15)


def text_of(vectors: Geometry) -> ExactText:
    """The functions for readings and exact derivatives under the light of these vectors."""
    if is_cut(vectors):
        return CUT_TEXT
    return IDEAL if is_ideal(vectors) else BENCH


def linearise_exactly(
    code: LaneWriter, vectors: Geometry, state: Sequence[Value], count: int
) -> list[tuple[Any, list[list[Value]]]]:
    """Readings and their exact derivatives by the first `count` components of the state, arranged
    as by `gradient.linearise`; a loop writes the derivatives by one component at a time."""
    text = text_of(vectors)
    at = text.scene(vectors, tuple(state))
    values = text.readings(vectors, at)
    memory = LaneMemory(code, 9 * count)
    with code.loop(ir.Constant(LONG, count)) as component:
        moved = []
        for c, number in enumerate(state):
            is_c = code.builder.icmp_signed("==", component, ir.Constant(LONG, c))
            slope = code.spread(code.builder.uitofp(is_c, DOUBLE)) if c < count else 0.0
            moved.append(Dual(number, slope))
        for row, slope in enumerate(leaves(text.slopes(vectors, tuple(moved), at))):
            memory[code.builder.add(component, ir.Constant(LONG, row * count))] = slope
    rows = [[memory[row * count + c] for c in range(count)] for row in range(9)]
    return [(values[k], rows[3 * k : 3 * k + 3]) for k in range(3)]


def write_slopes(kind: str) -> LaneWrite:
    """Write the code of `blocks.slopes` for a kind of light.

    Its arguments are the addresses of a sensor's vectors, of their derivatives by each variable, of
    states and of results, the number of variables, and the number of blocks.
    """

    def write(builder: Any, arguments: Sequence[Any], begin_code: Any) -> None:
        """Write the loop over blocks that computes derivatives by each varied number."""
        packed, varied, states, results = pointers_to(builder, arguments[:4])
        copies = arguments[4]
        code = begin_code(builder)
        vectors = vectors_of(code, packed, kind)
        with code.loop(arguments[5]) as index:
            rows = builder.mul(index, ir.Constant(LONG, code.lanes))
            states_at = builder.gep(states, [builder.mul(rows, ir.Constant(LONG, 8))])
            numbers = builder.mul(copies, ir.Constant(LONG, 9))
            results_at = builder.gep(results, [builder.mul(rows, numbers)])
            state = tuple(load_rows(code, states_at, 8, 8))
            text = text_of(vectors)
            at = text.scene(vectors, state)
            text.readings(vectors, at)  # writes numbers that the derivatives use, too
            with code.loop(copies) as copy:
                row = builder.gep(varied, [builder.mul(copy, ir.Constant(LONG, PACKED + 8))])
                moved = carry_slopes(vectors, vectors_of(code, row, kind))
                turns = tuple(code.load(row, PACKED + n) for n in range(8))
                turned = carry_slopes(state, turns) if kind == ANY_LIGHT else state
                slopes = leaves(text.slopes(moved, turned, at))
                store_column(code, list(slopes), results_at, copy, copies)

    return write


def loops_of(kind: str) -> dict[str, LaneWrite]:
    """The code for a kind of light, by the names that `blocks.kernel` takes."""

    def load(code: LaneWriter, pointer: Any) -> Geometry:
        """The sensor's vectors, read from memory."""
        return vectors_of(code, pointer, kind)

    readings = each_block(write_readings, load, 9)
    derivatives = each_block(write_derivatives, load, 72)
    if kind == "plain":
        return {"readings": readings, "derivatives": derivatives}
    loops = {
        f"readings_of_{kind}": readings,
        f"derivatives_of_{kind}": each_block(write_exact_derivatives, load, 72),
    }
    return loops if kind in CUT else {**loops, f"approximate_derivatives_of_{kind}": derivatives}


def footprints_of(example: Geometry) -> LaneWrite:
    """The code of `write_footprints`.  example: the vectors' arrangement, PARALLEL or EXAMPLE."""
    return each_block(
        write_footprints, lambda code, pointer: vectors_at(code, pointer, example), 15
    )


LOOPS: dict[str, LaneWrite] = {
    "footprints": footprints_of(PARALLEL),
    "footprints_of_light": footprints_of(EXAMPLE),
    **{f"slopes_of_{kind}": write_slopes(kind) for kind in ("plain", "cut", ANY_LIGHT)},
}
for _kind in ("plain", *LIT, *CUT):
    LOOPS.update(loops_of(_kind))
