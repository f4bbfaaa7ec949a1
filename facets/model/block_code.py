"""What writes the machine code of blocks: the plain model with a lane for each pose.

Imported only where the code is not kept.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import nan
from typing import Any

from llvmlite import ir

from ..optics.footprint import footprint, slopes
from ..optics.forward import Geometry, placed
from ..optics.forward import readings as readings_uncut
from ..optics.gradient import linearised as linearised_uncut
from ..scalars.lanes import LaneWriter
from ..scalars.machine import DOUBLE, LONG, Value, counted
from ..scalars.nesting import leaves
from .blocks import LANES
from .object_code import Write
from .packing import PARALLEL, PLAIN, vectors_at

#: Writes what a block of poses needs: with the sensor's vectors, from and to memory by pointers.
Formula = Callable[[LaneWriter, Geometry, Any, Any], None]


def each_block(formula: Formula, given: int, found: int, example: Geometry = PLAIN) -> Write:
    """Writes the code of a formula, block after block, as `blocks.kernel` gives it.

    given, found: how many numbers a pose is asked with, and gives.  example: the arrangement of the
    vectors that the formula takes.
    """

    def write(builder: Any, arguments: Sequence[Any]) -> None:
        packed, asked, results = (
            builder.inttoptr(argument, ir.PointerType(DOUBLE)) for argument in arguments[:3]
        )
        left = builder.inttoptr(arguments[3], ir.PointerType(LONG))
        with counted(builder, arguments[4]) as index:
            code = LaneWriter(builder, LANES)
            here, there = (
                builder.gep(pointer, [builder.mul(index, ir.Constant(LONG, LANES * numbers))])
                for pointer, numbers in ((asked, given), (results, found))
            )
            formula(code, vectors_at(code, packed, example), here, there)
            builder.store(code.bits(code.left), builder.gep(left, [index]))

    return write


def write_readings(code: LaneWriter, vectors: Geometry, states: Any, found: Any) -> None:
    """found: a row of nine readings for each row of eight numbers of a state."""
    state = code.load_rows(states, 8, 8)
    code.store_rows(list(leaves(readings_uncut(vectors, tuple(state)))), found, 9)


def write_derivatives(code: LaneWriter, vectors: Geometry, states: Any, found: Any) -> None:
    """found: nine rows of eight derivatives for each state; NaN where there is no reading."""
    state = code.load_rows(states, 8, 8)
    derivatives: list[Value] = []
    for values, rows in linearised_uncut(vectors, tuple(state)):
        for value, row in zip(values, rows, strict=True):
            lit = code.compare("==", value, value)
            derivatives += [code.select(lit, each, nan) for each in row]
    code.store_rows(derivatives, found, 72)


def write_footprints(code: LaneWriter, vectors: Geometry, states: Any, found: Any) -> None:
    """found: a row of fifteen numbers for each state, of which `footprint` gives five a spot."""
    at = placed(vectors, tuple(code.load_rows(states, 8, 8)))
    ends: list[Any] = []
    for k in range(3):
        *edges, out = footprint(vectors, at, k, slopes(vectors, at, k))
        landed = code.compare("==", edges[0], edges[0])  # lanes take x - x for zero, NaN or not
        ends += [*edges, code.select(landed, out, nan)]
    code.store_rows(ends, found, 15)


LOOPS = {
    "readings": each_block(write_readings, 8, 9),
    "derivatives": each_block(write_derivatives, 8, 72),
    "footprints": each_block(write_footprints, 8, 15, PARALLEL),
}
