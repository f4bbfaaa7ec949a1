"""Writers of the machine code of the model at one state after the other, without apertures.

Imported only if no compiled code is stored.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

from llvmlite import ir

from ..optics import bench_gradient, bench_light, gradient, parameters
from ..optics.curved_light import apparent_scene
from ..optics.footprint import collimated_slopes, curved_slopes, footprint
from ..optics.forward import Geometry, dark_scene, replace_power
from ..optics.forward import readings as readings_uncut
from ..scalars.dual import Dual
from ..scalars.machine import DOUBLE, LONG, write_loop
from ..scalars.nesting import leaves
from ..scalars.rows import RowWriter
from ..scalars.tracing import Value
from . import rare
from .block_code import lit_rows, pointers_to, power_derivative
from .kinds import LIT
from .object_code import Write
from .packing import (
    AXES,
    EXAMPLE,
    PACKED,
    PARALLEL,
    STATE,
    WITH_POWER,
    carry_slopes,
    is_ideal,
    vectors_at,
    vectors_of,
)

#: Writes the computation at a state: from the sensor's vectors, with pointers to the input and the
#: output.
Formula = Callable[[RowWriter, Geometry, Any, Any], None]


#: Loads a sensor's vectors.
Load = Callable[[RowWriter, Any], Geometry]


def writer_of(builder: Any, packed: Any) -> RowWriter:
    """Make a writer. packed: pointer to a sensor's vectors, followed by the address of
    `rare.TABLE`."""
    at = builder.gep(packed, [ir.Constant(LONG, PACKED)])
    address = builder.load(builder.bitcast(at, ir.PointerType(LONG)))
    return RowWriter(builder, builder.inttoptr(address, ir.PointerType(LONG)), rare.NAMES)


def row_at(builder: Any, pointer: Any, index: Any, numbers: Any) -> Any:
    """The address of a row of `numbers` numbers."""
    return builder.gep(pointer, [builder.mul(index, numbers)])


def each_row(formula: Formula, load: Load, inputs: int, found: int) -> Write:
    """Write the loop over rows for a formula, as `evaluators` needs it.

    load: loads the vectors that the formula takes.  inputs, found: how many numbers a row has.
    """

    def write(builder: Any, arguments: Sequence[Any]) -> None:
        packed, asked, results = pointers_to(builder, arguments[:3])
        with write_loop(builder, arguments[4]) as index:
            code = writer_of(builder, packed)
            here = row_at(builder, asked, index, ir.Constant(LONG, inputs))
            there = row_at(builder, results, index, ir.Constant(LONG, found))
            formula(code, load(code, packed), here, there)

    return write


def numbers_at(code: RowWriter, pointer: Any, count: int) -> list[Value]:
    return [code.load(pointer, n) for n in range(count)]


def store(code: RowWriter, numbers: Iterable[Any], pointer: Any, first: int = 0) -> None:
    for n, number in enumerate(numbers, first):
        code.store(number, pointer, n)


def write_readings(code: RowWriter, vectors: Geometry, inputs: Any, found: Any) -> None:
    text = readings_uncut if is_ideal(vectors) else bench_light.readings
    store(code, leaves(text(vectors, tuple(numbers_at(code, inputs, STATE)))), found)


def write_linearisation(code: RowWriter, vectors: Geometry, inputs: Any, found: Any) -> None:
    """Write readings and derivatives at a state and the beam's power; found (10, 10): the readings,
    then their derivatives by each of these, one reading per row; the last column is not used.

    Under real light the derivatives are those of `bench_gradient.linearise_nearly`.
    """
    x = numbers_at(code, inputs, WITH_POWER)
    powered, state = replace_power(vectors, x[8]), tuple(x[:8])
    ideal = is_ideal(vectors)
    text = gradient.linearise if ideal else bench_gradient.linearise_nearly
    for k, (values, rows) in enumerate(text(powered, state)):
        store(code, values, found, 3 * k)
        for i in range(3):
            row = 10 * (1 + 3 * k + i)
            store(code, rows[i], found, row)
            code.store(power_derivative(powered, values, k, i), found, row + 8)


def write_exact_linearisation(code: RowWriter, vectors: Geometry, inputs: Any, found: Any) -> None:
    """Write the same under real light without approximations."""
    x = numbers_at(code, inputs, WITH_POWER)
    powered, state = replace_power(vectors, x[8]), tuple(x[:8])
    at = bench_light.scene(powered, state)
    detectors = bench_light.scene_readings(powered, at)
    for k, values in enumerate(detectors):
        store(code, values, found, 3 * k)
        for i in range(3):
            code.store(power_derivative(powered, values, k, i), found, 10 * (1 + 3 * k + i) + 8)
    build = code.builder
    with code.loop(ir.Constant(LONG, 8)) as component:
        moved = []
        for c, number in enumerate(state):
            own = build.icmp_signed("==", component, ir.Constant(LONG, c))
            moved.append(Dual(number, Value(code, build.uitofp(own, DOUBLE))))
        derivatives = leaves(bench_gradient.reading_slopes(powered, tuple(moved), at))
        for n, number in enumerate(derivatives):
            place = build.add(ir.Constant(LONG, 10 * (1 + n)), component)
            code.store(number, build.gep(found, [place]), 0)


def write_footprints(code: RowWriter, vectors: Geometry, inputs: Any, found: Any) -> None:
    """Write the footprints of the spots to found (3, 5)."""
    at, spread = (
        dark_scene(vectors, tuple(numbers_at(code, inputs, STATE))),
        collimated_slopes,
    )
    if not is_ideal(vectors):
        at, spread = apparent_scene(vectors, at), curved_slopes
    for k in range(3):
        store(code, footprint(vectors, at, k, spread(vectors, at, k)), found, 5 * k)


#: Writes derivatives: from the sensor's vectors, a state, pointers to the varied vectors and to the
#: results, and the number of copies.
SlopesFormula = Callable[[RowWriter, Geometry, tuple[Value, ...], Any, Any, Any], None]


def each_row_of_slopes(formula: SlopesFormula, kind: str) -> Write:
    """Write the code of `evaluators.slopes`: a function of the addresses of a sensor's vectors, of
    states, results and varied vectors, and of the numbers of states and copies."""

    def write(builder: Any, arguments: Sequence[Any]) -> None:
        packed, states, results, varied = pointers_to(builder, arguments[:4])
        copies = arguments[5]
        size = builder.mul(copies, ir.Constant(LONG, 9))
        with write_loop(builder, arguments[4]) as index:
            code = writer_of(builder, packed)
            here = row_at(builder, states, index, ir.Constant(LONG, STATE))
            found = row_at(builder, results, index, size)
            state = tuple(numbers_at(code, here, STATE))
            formula(code, vectors_of(code, packed, kind), state, varied, found, copies)

    return write


def slopes_by_copies(kind: str) -> Write:
    """Write derivatives by differences of complex copies of a sensor, under real light."""

    def formula(
        code: RowWriter, vectors: Geometry, state: Any, varied: Any, found: Any, copies: Any
    ) -> None:
        build = code.builder
        at = bench_light.scene(vectors, state)
        with code.loop(copies) as copy:
            row = row_at(build, varied, copy, ir.Constant(LONG, PACKED))
            moved = carry_slopes(vectors, vectors_of(code, row, kind))
            for n, number in enumerate(leaves(bench_gradient.reading_slopes(moved, state, at))):
                first = build.mul(copies, ir.Constant(LONG, n))
                code.store(number, build.gep(found, [build.add(first, copy)]), 0)

    return each_row_of_slopes(formula, kind)


def write_slopes_by_parameters(
    code: RowWriter, vectors: Geometry, state: Any, axes: Any, found: Any, _: Any
) -> None:
    """Write derivatives by the thirty parameters, of ideal light.  axes: pointer to
    `parameters.Axes`."""
    own = vectors_at(code, axes, AXES)
    store(code, lit_rows(code, parameters.linearise(vectors, own, state)), found)


def loops_of(kind: str) -> dict[str, Write]:
    """The code for a kind of light, by the names that `evaluators.model` takes."""

    def load(code: RowWriter, pointer: Any) -> Geometry:
        return vectors_of(code, pointer, kind)

    loops = {
        f"readings_of_{kind}": each_row(write_readings, load, STATE, 9),
        f"approximate_linearisation_of_{kind}": each_row(
            write_linearisation, load, WITH_POWER, 100
        ),
    }
    if kind == "plain":
        loops["slopes_by_parameters"] = each_row_of_slopes(write_slopes_by_parameters, kind)
    else:
        exact = each_row(write_exact_linearisation, load, WITH_POWER, 100)
        loops[f"linearisation_of_{kind}"] = exact
        loops[f"slopes_of_{kind}"] = slopes_by_copies(kind)
    return loops


def footprints_of(example: Geometry) -> Write:
    """example: the arrangement of the vectors, of parallel rays or of any."""
    return each_row(
        write_footprints, lambda code, pointer: vectors_at(code, pointer, example), STATE, 15
    )


LOOPS: dict[str, Write] = {
    "footprints_of_plain": footprints_of(PARALLEL),
    "footprints_of_light": footprints_of(EXAMPLE),
}
for _kind in ("plain", *LIT):
    LOOPS.update(loops_of(_kind))
