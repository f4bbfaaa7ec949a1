"""Numbers of several poses that write machine code, whose instructions work on all poses at once.

A `LaneWriter` runs the optics' formulas once, as `machine.MachineWriter` does, but its numbers are
LLVM's vectors with a lane for each pose. There are no branches: both alternatives are computed, and
each lane selects its own; what few poses need is a function, which is called where any lane needs
it (`where_any`). The result of a lane depends on no other lane, and on no processor: the code
uses only additions, multiplications, divisions and roots, each rounded by IEEE 754.
"""

from __future__ import annotations

import functools
import itertools
import math
import operator
import struct
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from llvmlite import ir

from . import dispatch, polynomials
from .machine import DOUBLE, INTRINSICS, LONG, MachineWriter, Repetition, do_while, write_loop
from .nesting import Numbers, leaves, nest
from .tracing import Condition, Value, key_of

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
#: The series of the exponential function, to all digits for half of ln 2; below the least exponent
#: it is 0.
EXPONENTIAL_SERIES = tuple(1 / math.factorial(n) for n in range(14))
LEAST_EXPONENT = -700.0


#: A quarter turn in three parts, of which the first two end in zero bits: their products with whole
#: numbers are exact.
QUARTERS = (1.5707963267341256, 6.077100506303966e-11, 2.0222662487959506e-21)
#: Added to a number, it leaves the whole number that is nearest in the last bits.
ROUNDING = 1.5 * 2.0**52
#: The functions that code calls where a lane needs them, by the names of their code: each with
#: arguments that are nested like its own, and the number of lanes.
CALLED: dict[str, tuple[Callable[..., Any], Numbers, int]] = {}


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
    """Writes LLVM's code for several poses at once.

    lanes: number of poses.  called_lanes: number of lanes of the functions that are called where a
    lane needs them, `lanes` unless given.
    """

    drops_zeros = True
    shares_reciprocals = True

    def __init__(self, builder: Any, lanes: int, called_lanes: int | None = None) -> None:
        super().__init__(builder)
        self.lanes, self.called_lanes = lanes, called_lanes or lanes
        self.kind = ir.VectorType(DOUBLE, lanes)
        #: The factors of the products.
        self._factors: dict[Value | float, tuple[Value | float, ...]] = {}

    def write(self, operation: str, *operands: Value | float) -> Value:
        """A sum with a product is rounded once, on every processor: decision 13."""
        if operation in ("add", "subtract"):
            for part, other in (operands, operands[::-1]):
                if part in self._factors:
                    a, b = self._factors[part]
                    if operation == "subtract":
                        a, other = (a, -other) if part is operands[0] else (-a, other)
                    return self._write_intrinsic("fma", a, b, other)
        value = super().write(operation, *operands)
        if operation == "multiply":
            self._factors[value] = operands
        return value

    def round_product(self, x: Value) -> Value:
        """See `dispatch.round_product`: a number of which no factors are known."""
        return Value(self, x.ir)

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

    def _splat(self, number: Any, kind: Any) -> Any:
        empty = ir.Constant(kind, ir.Undefined)
        first = self.builder.insert_element(empty, number, ir.Constant(SHORT, 0))
        return shuffle(self.builder, first, empty, [0] * self.lanes)

    def load(self, pointer: Any, index: int) -> Value:
        """Load a number that all lanes have in common."""
        place = self.builder.gep(pointer, [ir.Constant(LONG, index)])
        return self.spread(self.builder.load(place))

    def _lanes_at(self, pointer: Any, index: int) -> Any:
        place = self.builder.gep(pointer, [ir.Constant(LONG, index * self.lanes)])
        return self.builder.bitcast(place, ir.PointerType(self.kind))

    def load_rows(self, pointer: Any, stride: Any, count: int) -> list[Value]:
        """Load `count` numbers of each lane, whose rows are `stride` numbers apart; an integer, or
        a number of the generated code."""
        columns: list[Value] = []
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
                columns.append(Value(self, join(self.builder, list(parts))))
        return columns

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
                number_of_lane = self.builder.extract_element(vector, ir.Constant(SHORT, lane))
                first = self.builder.mul(columns, ir.Constant(LONG, lane * len(numbers) + row))
                place = self.builder.gep(pointer, [self.builder.add(first, column)])
                self.builder.store(number_of_lane, place)

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

    @contextmanager
    def loop(self, count: Any) -> Iterator[Any]:
        """Write a loop as `machine.write_loop` does: values from before it are known within it, and
        values from within it are not known after it."""
        with self.scope(), write_loop(self.builder, count) as number:
            yield number

    @contextmanager
    def do_while(self) -> Iterator[Repetition]:
        """Write a loop as `machine.do_while` does, with the same known values as in `loop`."""
        with self.scope(), do_while(self.builder) as repetition:
            yield repetition

    def where_any(
        self,
        condition: Condition,
        other: Numbers,
        function: Callable[..., Any],
        *arguments: Numbers,
    ) -> Numbers:
        """See `dispatch.where_any`; the function is called if any lane needs it."""
        with self._rare(condition, other) as cells:
            for cell, new in zip(cells, self._call(function, arguments, len(cells)), strict=True):
                cell[0] = self.select(condition, new, cell[0])
        return nest(other, iter([cell[0] for cell in cells]))

    def branch_once(
        self, conditions: Sequence[Condition], others: Numbers, compute: Callable[[], Numbers]
    ) -> Numbers:
        """See `Tracer.branch_once`."""
        with self._rare(functools.reduce(operator.or_, conditions), others) as cells:
            for cell, new in zip(cells, leaves(compute()), strict=True):
                cell[0] = new
        return nest(others, iter([cell[0] for cell in cells]))

    @contextmanager
    def _rare(self, condition: Condition, other: Numbers) -> Iterator[list[LaneMemory]]:
        """Write a part that runs if the condition holds in any lane, with memory of `other`
        numbers for its results."""
        cells = [LaneMemory(self, 1) for _ in leaves(other)]
        for cell, number in zip(cells, leaves(other), strict=True):
            cell[0] = number
        with self.builder.if_then(self.any(condition), likely=False), self.scope():
            yield cells

    def _call(
        self, function: Callable[..., Any], arguments: Numbers, count: int
    ) -> Iterator[Value]:
        """Call a function that has an object of its own, and return its `count` results."""
        file = function.__module__.rpartition(".")[2]
        given = list(leaves(arguments))
        name = f"{file}_{function.__name__}_of_{len(given)}_in_{self.called_lanes}_lanes"
        CALLED[name] = function, nest(arguments, itertools.repeat(0.0)), self.called_lanes
        module = self.builder.module
        kind = ir.FunctionType(ir.VoidType(), [LONG] * 2)
        code = module.globals.get(name) or ir.Function(module, kind, name)
        wide = LaneWriter(self.builder, self.called_lanes)
        inputs, outputs = LaneMemory(wide, len(given)), LaneMemory(wide, count)
        for n, number in enumerate(given):
            inputs[n] = self._fit_lanes(number, wide)
        places = (self.builder.ptrtoint(each.address(0), LONG) for each in (inputs, outputs))
        self.builder.call(code, list(places))
        return (wide._fit_lanes(outputs[n], self) for n in range(count))

    def _fit_lanes(self, number: Value | float, other: LaneWriter) -> Value:
        """Convert numbers to another writer's lanes, repeated if it has more lanes."""
        vector, places = self.value(number), [n % self.lanes for n in range(other.lanes)]
        same = other.lanes == self.lanes
        return Value(other, vector if same else shuffle(self.builder, vector, vector, places))

    def sum_over(
        self, function: Callable[..., Any], table: Sequence[Sequence[float]], *arguments: Numbers
    ) -> Numbers:
        """See `dispatch.sum_over`."""
        width = len(table[0])
        memory = self._table(table)
        with self.builder.goto_entry_block():
            place = self.builder.alloca(LONG)
        self.builder.store(ir.Constant(LONG, 0), place)
        sums: list[LaneMemory] = []
        with self.scope(), do_while(self.builder) as repetition:
            at = self.builder.load(place)
            row = self.builder.gep(memory, [at])
            terms = function(*(self.load(row, n) for n in range(width)), *arguments)
            for number in leaves(terms):
                sums.append(LaneMemory(self, 1))
                sums[-1].begin(0.0)
                sums[-1][0] = sums[-1][0] + number
            at = self.builder.add(at, ir.Constant(LONG, width))
            self.builder.store(at, place)
            end = ir.Constant(LONG, width * len(table))
            repetition.again = self.builder.icmp_signed("<", at, end)
        return nest(terms, iter([each[0] for each in sums]))

    def _table(self, table: Sequence[Sequence[float]]) -> Any:
        """A table's numbers in the module's memory, row by row."""
        numbers = [float(number) for row in table for number in row]
        name, kind = f"table_{id(table)}", ir.ArrayType(DOUBLE, len(numbers))
        known = self.builder.module.globals.get(name)
        if known is None:
            known = ir.GlobalVariable(self.builder.module, kind, name)
            known.linkage, known.global_constant = "internal", True
            known.initializer = ir.Constant(kind, numbers)
        return self.builder.bitcast(known, ir.PointerType(DOUBLE))

    def write_function(self, name: str, *arguments: Value | float) -> Value:
        if name in INTRINSICS:
            return super().write_function(name, *arguments)
        given = (
            each if isinstance(each, Value) else Value(self, self.constant(each))
            for each in arguments
        )
        key = (name, *map(key_of, arguments))
        return self.once(key, getattr(self, f"_{name}"), *given)  # type: ignore[no-any-return]

    def _sin(self, x: Value) -> Value:
        return self._turn(x)[0]  # type: ignore[no-any-return]

    def _cos(self, x: Value) -> Value:
        return self._turn(x)[1]  # type: ignore[no-any-return]

    def _turn(self, x: Value) -> Any:
        self.turn_together(x)
        return self._known["turn", x]

    def turn_together(self, *angles: Value | float) -> None:
        """See `dispatch.turn_together`: an angle of more than a radian takes a function."""
        new = tuple(x for x in angles if isinstance(x, Value) and ("turn", x) not in self._known)
        if not new:
            return
        usual = tuple((polynomials.sine(x), polynomials.cosine(x)) for x in new)
        large = tuple(abs(x) > 1 for x in new)
        turns = dispatch.where_each(large, usual, reduced_turn, tuple((x,) for x in new))
        self._known |= {("turn", x): turn for x, turn in zip(new, turns, strict=True)}

    def nearest_whole(self, x: Value) -> tuple[Value, Any]:
        """The nearest whole number, and an integer vector with its last bits."""
        scaled = x + ROUNDING
        bits = self.builder.bitcast(scaled.ir, ir.VectorType(LONG, self.lanes))
        return scaled - ROUNDING, bits

    def has_bit(self, bits: Any, bit: int, more: int = 0) -> Condition:
        """Whether, in each lane, an integer plus `more` has a bit."""
        added = self.builder.add(bits, self._whole(more))
        masked = self.builder.and_(added, self._whole(bit))
        return Condition(self, self.builder.icmp_signed("!=", masked, self._whole(0)))

    def _whole(self, number: int) -> Any:
        return ir.Constant(ir.VectorType(LONG, self.lanes), [number] * self.lanes)

    def _exp(self, x: Value) -> Value:
        """The exponential function to all digits; 0 where x is below -700."""
        e, bits = self.nearest_whole(x * (1 / math.log(2)))
        rest = (x - e * LN2_HIGH) - e * LN2_LOW
        power = self.builder.shl(bits, self._whole(MANTISSA_BITS))
        part = polynomials.polynomial(rest, EXPONENTIAL_SERIES)
        whole = self.builder.bitcast(part.ir, power.type)
        result = Value(self, self.builder.bitcast(self.builder.add(whole, power), self.kind))
        return self.select(x < LEAST_EXPONENT, 0.0, result)  # type: ignore[no-any-return]

    def _log(self, x: Value) -> Value:
        """The logarithm of positive numbers to all digits; NaN of others.

        x = m 2^e with m between the roots of 1/2 and 2.
        """
        build, same, whole = self.builder, self._whole, ir.VectorType(LONG, self.lanes)
        bits = build.sub(build.bitcast(x.ir, whole), same(BITS_OF_ROOT_OF_HALF))
        power = build.ashr(bits, same(MANTISSA_BITS))
        part = build.add(
            build.and_(bits, same((1 << MANTISSA_BITS) - 1)), same(BITS_OF_ROOT_OF_HALF)
        )
        m = Value(self, build.bitcast(part, self.kind))
        e = Value(self, build.sitofp(power, self.kind))
        rest = polynomials.logarithm((m - 1) / (m + 1)) + e * LN2_LOW
        valid = (x > SMALLEST) & (x < math.inf)
        return self.select(valid, e * LN2_HIGH + rest, math.nan)  # type: ignore[no-any-return]

    def _atan2(self, y: Value, x: Value) -> Value:
        high, wide = abs(y), abs(x)
        steep, middle = high > wide * TAN_3, high > wide * TAN_1
        above = self.select(steep, -wide, self.select(middle, high - wide, high))
        below = self.select(steep, high, self.select(middle, high + wide, wide))
        turn = self.select(steep, math.pi / 2, self.select(middle, math.pi / 4, 0.0))
        angle = turn + polynomials.arc_tangent(above / below)
        angle = self.select(x > 0, angle, math.pi - angle)
        return self.select(y < 0, -angle, angle)  # type: ignore[no-any-return]


def reduced_turn(x: Value) -> Any:
    """Sine and cosine of larger angles, from the rest to whole quarter turns."""
    code = x.writer
    quarters, bits = code.nearest_whole(x * (2 / math.pi))
    rest = x
    for part in QUARTERS:
        rest = rest - quarters * part
    sine, cosine = polynomials.sine(rest), polynomials.cosine(rest)
    odd = code.has_bit(bits, 1)
    sine, cosine = code.select(odd, cosine, sine), code.select(odd, sine, cosine)
    back, left = code.has_bit(bits, 2), code.has_bit(bits, 2, 1)
    return code.select(back, -sine, sine), code.select(left, -cosine, cosine)


def write_callee(name: str, builder: Any, places: Sequence[Any]) -> None:
    """Write one of `CALLED`.  places: the addresses of its arguments and of its results."""
    function, like, lanes = CALLED[name]
    code = LaneWriter(builder, lanes)
    inputs, outputs = (
        LaneMemory(code, place=builder.inttoptr(place, ir.PointerType(code.kind)))
        for place in places
    )
    given = (inputs[n] for n, _ in enumerate(leaves(like)))
    for n, number in enumerate(leaves(function(*nest(like, given)))):
        outputs[n] = number


class LaneMemory:
    """Numbers of all lanes in the code's own memory, which a loop passes to its next round."""

    def __init__(self, code: LaneWriter, size: int = 1, place: Any = None) -> None:
        """size: how many numbers.  place: address of numbers that exist already."""
        self.code, self._place = code, place
        if place is None:
            with code.builder.goto_entry_block():
                self._place = code.builder.alloca(code.kind, size)

    def begin(self, number: float) -> None:
        """Store a plain number at its first place before anything else runs."""
        with self.code.builder.goto_entry_block():
            self[0] = number

    def __getitem__(self, index: Any) -> Value:
        return Value(self.code, self.code.builder.load(self.address(index)))

    def __setitem__(self, index: Any, number: Value | float) -> None:
        self.code.builder.store(self.code.value(number), self.address(index))

    def address(self, index: Any) -> Any:
        """index: a number, or a number of the generated code."""
        where = ir.Constant(LONG, index) if isinstance(index, int) else index
        return self.code.builder.gep(self._place, [where])
