"""Numbers of several poses in rows of memory, one row for each lane.

Rows are read and written as vectors, and transposed in registers.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from llvmlite import ir

from .lanes import DOUBLE, LONG, SHORT, LaneWriter, shuffle
from .tracing import Value


def transpose(builder: Any, rows: list[Any]) -> list[Any]:
    """Transpose vectors whose number and length are the same power of two.

    In each pair of rows whose numbers differ in one bit, the off-diagonal blocks are exchanged, bit
    by bit.
    """
    rows, size, width = list(rows), len(rows), 1
    while width < size:
        low = [n if not n & width else size + n - width for n in range(size)]
        high = [n + width if not n & width else size + n for n in range(size)]
        for i in range(size):
            if not i & width:
                pair = rows[i], rows[i + width]
                rows[i], rows[i + width] = (shuffle(builder, *pair, each) for each in (low, high))
        width *= 2
    return rows


def join(builder: Any, vectors: list[Any]) -> Any:
    """Concatenate vectors of equal lengths, whose number is a power of two."""
    while len(vectors) > 1:
        size = 2 * vectors[0].type.count
        pairs = zip(vectors[::2], vectors[1::2], strict=True)
        vectors = [shuffle(builder, a, b, range(size)) for a, b in pairs]
    return vectors[0]


def load_rows(code: LaneWriter, pointer: Any, stride: Any, count: int) -> list[Value]:
    """Load `count` numbers of each lane.

    stride: distance of the lanes' rows, in numbers; an integer, or one of the generated code.
    """
    columns: list[Value] = []
    for first, size in squares(code.lanes, count):
        rows = [
            code.builder.load(row_vector(code.builder, pointer, stride, lane, first, size), align=8)
            for lane in range(code.lanes)
        ]
        blocks = [
            transpose(code.builder, rows[lane : lane + size]) for lane in range(0, code.lanes, size)
        ]
        for parts in zip(*blocks, strict=True):
            columns.append(Value(code, join(code.builder, list(parts))))
    return columns


def squares(lanes: int, count: int) -> Iterator[tuple[int, int]]:
    """Divide columns into square blocks; yields the first column and the number of columns."""
    first, size = 0, lanes
    while first < count:
        while size > count - first:
            size //= 2
        yield first, size
        first += size


def store_column(
    code: LaneWriter, numbers: Sequence[Value | float], pointer: Any, column: Any, columns: Any
) -> None:
    """Store numbers of each lane in a column of its matrix, whose rows have `columns`
    numbers."""
    for row, number in enumerate(numbers):
        vector = code.value(number)
        for lane in range(code.lanes):
            number_of_lane = code.builder.extract_element(vector, ir.Constant(SHORT, lane))
            first = code.builder.mul(columns, ir.Constant(LONG, lane * len(numbers) + row))
            place = code.builder.gep(pointer, [code.builder.add(first, column)])
            code.builder.store(number_of_lane, place)


def row_vector(builder: Any, pointer: Any, stride: Any, lane: int, column: int, size: int) -> Any:
    """Return the pointer to `size` numbers of a lane's row, as a vector."""
    wide = ir.Constant(LONG, stride) if isinstance(stride, int) else stride
    row = builder.mul(wide, ir.Constant(LONG, lane))
    place = builder.gep(pointer, [builder.add(row, ir.Constant(LONG, column))])
    return builder.bitcast(place, ir.PointerType(ir.VectorType(DOUBLE, size)))


def store_rows(
    code: LaneWriter, numbers: Sequence[Value | float], pointer: Any, stride: Any
) -> None:
    """Store numbers of each lane in a row of its own.  stride: as in `load_rows`."""
    vectors = [code.value(number) for number in numbers]
    for first, size in squares(code.lanes, len(vectors)):
        some = vectors[first : first + size]
        for lane in range(0, code.lanes, size):
            places = range(lane, lane + size)
            square = [shuffle(code.builder, each, each, places) for each in some]
            for n, row in enumerate(transpose(code.builder, square), lane):
                code.builder.store(
                    row, row_vector(code.builder, pointer, stride, n, first, size), align=8
                )
