"""Numbers of several poses at once that write machine code: each instruction works on all of them.

A `LaneWriter` runs the optics' formulas once, as `machine.MachineWriter` does, but its numbers are
LLVM's vectors with a lane for each pose. There are no branches: both alternatives are computed, and
each lane selects its own. A formula that is valid for most poses only, such as a polynomial on its
interval, records the invalid lanes (`leave`), which other code then computes anew. The result of a
lane depends on no other lane, and on no processor: the code uses only additions, multiplications,
divisions and roots, each rounded by IEEE 754.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from llvmlite import ir

from . import polynomials
from .machine import DOUBLE, INTRINSICS, LONG, MachineWriter, Repetition, do_while, write_loop
from .nesting import Numbers
from .tracing import Condition, Value

SHORT = ir.IntType(32)
BIT = ir.IntType(1)
#: Above an eighth of a half-turn, the arc tangent follows from that of the complement.
TAN_1, TAN_3 = math.sqrt(2) - 1, math.sqrt(2) + 1
#: Number of bits of a double's mantissa, and the least double with a full mantissa.
MANTISSA_BITS, SMALLEST = 52, 2.0**-1022
BITS_OF_ROOT_OF_HALF = int.from_bytes(struct.pack("<d", math.sqrt(0.5)), "little")
#: The logarithm of 2, as a number with 21 zero bits at its end, whose products with exponents are
#: exact, and the remainder.
LN2_HIGH, LN2_LOW = 0.6931471803691238, 1.9082149292705877e-10


class Unfilled:
    """Placeholder for numbers that other code has to compute."""


UNFILLED = Unfilled()


def shuffle(builder: Any, a: Any, b: Any, places: Iterable[int]) -> Any:
    """Select numbers by their places in the concatenation of two vectors."""
    wanted = list(places)
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(SHORT, len(wanted)), wanted))


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


class LaneWriter(MachineWriter):
    """lanes: number of poses.  `left`: the lanes whose numbers are invalid.

    A lane with a number that is not finite gives no valid result: the caller has to leave it.
    """

    drops_zeros = True
    shares_reciprocals = True

    def __init__(self, builder: Any, lanes: int) -> None:
        super().__init__(builder)
        self.lanes = lanes
        self.kind = ir.VectorType(DOUBLE, lanes)
        self.left = self.same(False)
        self._here: list[Condition] = []

    def same(self, truth: Any) -> Condition:
        """Broadcast a truth to all lanes. truth: a bool, or a bit of the generated code."""
        kind = ir.VectorType(BIT, self.lanes)
        if isinstance(truth, bool):
            return Condition(self, ir.Constant(kind, [int(truth)] * self.lanes))
        return Condition(self, self._splat(truth, kind))

    def any(self, condition: Condition) -> Any:
        """Return a bit: whether the condition holds in any lane."""
        return self.builder.icmp_signed("!=", self.bits(condition), ir.Constant(LONG, 0))

    def constant(self, number: float) -> Any:
        return ir.Constant(self.kind, [float(number)] * self.lanes)

    def spread(self, number: Any) -> Value:
        """Broadcast one number to all lanes."""
        return Value(self, self._splat(number, self.kind))

    def _splat(self, one: Any, kind: Any) -> Any:
        empty = ir.Constant(kind, ir.Undefined)
        first = self.builder.insert_element(empty, one, ir.Constant(SHORT, 0))
        return shuffle(self.builder, first, empty, [0] * self.lanes)

    def load(self, pointer: Any, index: int) -> Value:
        """Load a number that all lanes have in common."""
        place = self.builder.gep(pointer, [ir.Constant(LONG, index)])
        return self.spread(self.builder.load(place))

    def store_lanes(self, number: Value | float, pointer: Any, index: int) -> None:
        """Store at place `index` of memory that has a number for each lane at each place."""
        self.builder.store(self.value(number), self._lanes_at(pointer, index), align=8)

    def _lanes_at(self, pointer: Any, index: int) -> Any:
        place = self.builder.gep(pointer, [ir.Constant(LONG, index * self.lanes)])
        return self.builder.bitcast(place, ir.PointerType(self.kind))

    def load_rows(self, pointer: Any, stride: Any, count: int) -> list[Value]:
        """Load `count` numbers of each lane, whose rows are `stride` numbers apart; an integer, or
        a number of the generated code."""
        found: list[Value] = []
        for first, size in self._squares(count):
            rows = [
                self.builder.load(self._row_vector(pointer, stride, lane, first, size), align=8)
                for lane in range(self.lanes)
            ]
            squares = [
                transpose(self.builder, rows[lane : lane + size])
                for lane in range(0, self.lanes, size)
            ]
            for parts in zip(*squares, strict=True):
                found.append(Value(self, join(self.builder, list(parts))))
        return found

    def _squares(self, count: int) -> Iterator[tuple[int, int]]:
        """Divide columns into squares of memory: the first column, and the number of columns."""
        first, size = 0, self.lanes
        while first < count:
            while size > count - first:
                size //= 2
            yield first, size
            first += size

    def store_column(
        self, numbers: Sequence[Value | float], pointer: Any, column: Any, columns: Any
    ) -> None:
        """Store numbers of each lane in a column of its matrix, whose rows have `columns`
        numbers."""
        for row, number in enumerate(numbers):
            vector = self.value(number)
            for lane in range(self.lanes):
                one = self.builder.extract_element(vector, ir.Constant(SHORT, lane))
                first = self.builder.mul(columns, ir.Constant(LONG, lane * len(numbers) + row))
                self.builder.store(
                    one, self.builder.gep(pointer, [self.builder.add(first, column)])
                )

    def _row_vector(self, pointer: Any, stride: Any, lane: int, column: int, size: int) -> Any:
        """Return the pointer to `size` numbers of a lane's row, as a vector."""
        wide = ir.Constant(LONG, stride) if isinstance(stride, int) else stride
        row = self.builder.mul(wide, ir.Constant(LONG, lane))
        place = self.builder.gep(pointer, [self.builder.add(row, ir.Constant(LONG, column))])
        return self.builder.bitcast(place, ir.PointerType(ir.VectorType(DOUBLE, size)))

    def store_rows(self, numbers: Sequence[Value | float], pointer: Any, stride: Any) -> None:
        """Store numbers of each lane in rows that are `stride` numbers apart, as in `load_rows`."""
        vectors = [self.value(number) for number in numbers]
        for first, size in self._squares(len(vectors)):
            some = vectors[first : first + size]
            for lane in range(0, self.lanes, size):
                places = range(lane, lane + size)
                square = [shuffle(self.builder, each, each, places) for each in some]
                for n, row in enumerate(transpose(self.builder, square), lane):
                    self.builder.store(
                        row, self._row_vector(pointer, stride, n, first, size), align=8
                    )

    def bits(self, condition: Condition) -> Any:
        """A 64-bit integer with a bit for each lane in which the condition holds."""
        bits = self.builder.bitcast(condition.ir, ir.IntType(self.lanes))
        return self.builder.zext(bits, LONG)

    def leave(self, condition: Condition) -> None:
        """Add to `left` the lanes in which the condition holds and whose branch is selected."""
        for other in self._here:
            condition = condition & other
        self.left = self.left | condition

    @contextmanager
    def loop(self, count: Any) -> Iterator[Any]:
        """Write a loop as `machine.write_loop` does: values from before it are known within it, and
        values from within it are not known after it."""
        with self._round() as begin, write_loop(self.builder, count) as number, begin():
            yield number

    @contextmanager
    def do_while(self) -> Iterator[Repetition]:
        """Write a loop as `machine.do_while` does, with the same known values as in `loop`."""
        with self._round() as begin, do_while(self.builder) as repetition, begin():
            yield repetition

    @contextmanager
    def _round(self) -> Iterator[Callable[[], Any]]:
        """Enclose a loop; yield a function that encloses its body. Rounds pass on `left`."""
        left = LaneFlag(self, self.left)

        @contextmanager
        def begin() -> Iterator[None]:
            self.left = left.get()
            yield
            left.set(self.left)

        with self.scope():
            yield begin
        self.left = left.get()

    def choose(
        self, condition: Condition, then: Callable[[], Numbers], other: Callable[[], Numbers]
    ) -> Numbers:
        """Select in each lane the result of one of two functions; both are computed."""
        ways = [self._take_way(condition, then), self._take_way(~condition, other)]
        return self._merge_lanes(condition, *ways)

    def _take_way(self, condition: Condition, way: Callable[[], Numbers]) -> Numbers:
        self._here.append(condition)
        try:
            return way()
        finally:
            self._here.pop()

    def _merge_lanes(self, condition: Condition, then: Numbers, other: Numbers) -> Numbers:
        if then is UNFILLED or other is UNFILLED:
            return other if then is UNFILLED else then
        if isinstance(then, tuple):
            pairs = zip(then, other, strict=True)
            return tuple(self._merge_lanes(condition, a, b) for a, b in pairs)
        return self.select(condition, then, other)

    def rarely(self, function: Callable[..., Any], like: Numbers, *arguments: Numbers) -> Numbers:
        """Leave these lanes to other code."""
        self.leave(self.same(True))
        return UNFILLED

    def write_function(self, name: str, *arguments: Value | float) -> Value:
        """Write the function anew, since the lanes that it leaves depend on the place; its parts
        once."""
        if name in INTRINSICS:
            return super().write_function(name, *arguments)
        written: Callable[..., Value] = getattr(self, f"_{name}")
        return written(*arguments)

    def _sin(self, x: Value) -> Value:
        self.leave(~(abs(x) < 1))
        return polynomials.sine(x)  # type: ignore[no-any-return]

    def _cos(self, x: Value) -> Value:
        self.leave(~(abs(x) < 1))
        return polynomials.cosine(x)  # type: ignore[no-any-return]

    def _log(self, x: Value) -> Value:
        """The logarithm of positive numbers to all digits; other lanes are left.

        x = m 2^e with m between the roots of 1/2 and 2.
        """
        self.leave(~((x > SMALLEST) & (x < math.inf)))
        whole = ir.VectorType(LONG, self.lanes)

        def same(number: int) -> Any:
            return ir.Constant(whole, [number] * self.lanes)

        build = self.builder
        bits = build.sub(build.bitcast(x.ir, whole), same(BITS_OF_ROOT_OF_HALF))
        power = build.ashr(bits, same(MANTISSA_BITS))
        part = build.add(
            build.and_(bits, same((1 << MANTISSA_BITS) - 1)), same(BITS_OF_ROOT_OF_HALF)
        )
        m = Value(self, build.bitcast(part, self.kind))
        e = Value(self, build.sitofp(power, self.kind))
        rest = polynomials.logarithm((m - 1) / (m + 1)) + e * LN2_LOW
        return e * LN2_HIGH + rest  # type: ignore[no-any-return]

    def _atan2(self, y: Value, x: Value) -> Value:
        high, wide = abs(y), abs(x)
        steep, middle = high > wide * TAN_3, high > wide * TAN_1
        above = self.select(steep, -wide, self.select(middle, high - wide, high))
        below = self.select(steep, high, self.select(middle, high + wide, wide))
        turn = self.select(steep, math.pi / 2, self.select(middle, math.pi / 4, 0.0))
        angle = turn + polynomials.arc_tangent(above / below)
        angle = self.select(x > 0, angle, math.pi - angle)
        return self.select(y < 0, -angle, angle)  # type: ignore[no-any-return]


class LaneMemory:
    """Numbers of all lanes in the code's own memory, which a loop passes to its next round."""

    def __init__(self, code: LaneWriter, size: int) -> None:
        self.code = code
        with code.builder.goto_entry_block():
            self._place = code.builder.alloca(code.kind, size)

    def __getitem__(self, index: Any) -> Value:
        return Value(self.code, self.code.builder.load(self._address(index)))

    def __setitem__(self, index: Any, number: Value | float) -> None:
        self.code.builder.store(self.code.value(number), self._address(index))

    def _address(self, index: Any) -> Any:
        """index: a number, or a number of the generated code."""
        where = ir.Constant(LONG, index) if isinstance(index, int) else index
        return self.code.builder.gep(self._place, [where])


class LaneFlag:
    """A condition for each lane, in the code's own memory."""

    def __init__(self, code: LaneWriter, first: Condition) -> None:
        self.code = code
        with code.builder.goto_entry_block():
            self._place = code.builder.alloca(first.ir.type)
        self.set(first)

    def get(self) -> Condition:
        return Condition(self.code, self.code.builder.load(self._place))

    def set(self, condition: Condition) -> None:
        self.code.builder.store(condition.ir, self._place)
