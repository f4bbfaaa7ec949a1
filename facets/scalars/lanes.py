"""Numbers of several poses that write machine code, whose instructions work on all poses at once.

A `LaneWriter` runs the optics' formulas once (`tracing`). They are not parsed, typed or inlined,
which takes a compiler for Python ten times as long. Its numbers are LLVM's vectors with a lane for
each pose. There are no branches: both alternatives are computed, and each lane selects one of them.
Formulas that few poses need are functions, which are called if any lane needs them (`where_any`).
The result of a lane does not depend on other lanes or on the processor, because the code uses only
additions, multiplications, divisions and roots, each rounded by IEEE 754.
"""

from __future__ import annotations

import functools
import itertools
import math
import operator
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from llvmlite import ir

from .lane_functions import FUNCTIONS, turns
from .nesting import Numbers, leaves, nest
from .tracing import Condition, Tracer, Value, key_of

DOUBLE = ir.DoubleType()
LONG = ir.IntType(64)
SHORT = ir.IntType(32)
BIT = ir.IntType(1)
#: The names of the operations in LLVM's builder.
INSTRUCTIONS = {
    "add": "fadd",
    "subtract": "fsub",
    "multiply": "fmul",
    "divide": "fdiv",
    "negative": "fneg",
}
#: The functions for which processors have instructions.
INTRINSICS = ("sqrt", "fabs")
CONNECTIVES = {"and": "and_", "or": "or_", "not": "not_"}
#: The functions that code calls if a lane needs them, by the names of their code: each with an
#: example of its arguments and the number of lanes.
CALLED: dict[str, tuple[Callable[..., Any], Numbers, int]] = {}


class Repetition:
    """A loop of `do_while`.

    first: a bit that is 1 in the first round.  repeats: a bit that the loop's body sets to repeat
    the loop.
    """

    first: Any = None
    repeats: Any = None


def shuffle(builder: Any, a: Any, b: Any, places: Iterable[int]) -> Any:
    """Select numbers by their places in the concatenation of two vectors."""
    indices = list(places)
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(SHORT, len(indices)), indices))


def splat(builder: Any, number: Any, kind: Any) -> Any:
    """A vector of this kind whose lanes all hold a number."""
    empty = ir.Constant(kind, ir.Undefined)
    first = builder.insert_element(empty, number, ir.Constant(SHORT, 0))
    return shuffle(builder, first, empty, [0] * kind.count)


def place_table(builder: Any, table: Sequence[Sequence[float]]) -> Any:
    """A table's numbers in the module's memory, row by row."""
    numbers = [float(number) for row in table for number in row]
    name, kind = f"table_{id(table)}", ir.ArrayType(DOUBLE, len(numbers))
    variable = builder.module.globals.get(name)
    if variable is None:
        variable = ir.GlobalVariable(builder.module, kind, name)
        variable.linkage, variable.global_constant = "internal", True
        variable.initializer = ir.Constant(kind, numbers)
    return builder.bitcast(variable, ir.PointerType(DOUBLE))


class LaneWriter(Tracer):
    """Writes LLVM's code for several poses at once.

    lanes: number of poses.  called_lanes: number of lanes of the called functions; `lanes` by
    default.
    """

    shares_reciprocals = True

    def __init__(self, builder: Any, lanes: int, called_lanes: int | None = None) -> None:
        super().__init__()
        self.builder = builder
        self.lanes, self.called_lanes = lanes, called_lanes or lanes
        self.kind = ir.VectorType(DOUBLE, lanes)
        #: The factors of the products.
        self._factors: dict[Value | float, tuple[Value | float, ...]] = {}

    def value(self, number: Value | float) -> Any:
        """Convert a number to LLVM's value."""
        if isinstance(number, Value):
            return number.ir
        return ir.Constant(self.kind, [float(number)] * self.lanes)

    def write(self, operation: str, *operands: Value | float) -> Value:
        """Write an operation; a sum with a product is rounded once, on every processor: decision
        13."""
        if operation in ("add", "subtract"):
            for part, other in (operands, operands[::-1]):
                if part in self._factors:
                    a, b = self._factors[part]
                    if operation == "subtract":
                        a, other = (a, -other) if part is operands[0] else (-a, other)
                    return self._write_intrinsic("fma", a, b, other)
        instruction = getattr(self.builder, INSTRUCTIONS[operation])
        value = Value(self, instruction(*map(self.value, operands)))
        if operation == "multiply":
            self._factors[value] = operands
        return value

    def round_product(self, x: Value) -> Value:
        """See `dispatch.round_product`: the same number without its factors."""
        return Value(self, x.ir)

    def same(self, truth: Any) -> Condition:
        """Broadcast a truth to all lanes. truth: a bool, or a bit of the generated code."""
        kind = ir.VectorType(BIT, self.lanes)
        if isinstance(truth, bool):
            return Condition(self, ir.Constant(kind, [int(truth)] * self.lanes))
        return Condition(self, splat(self.builder, truth, kind))

    def any(self, condition: Condition) -> Any:
        """Return a bit: whether the condition holds in any lane."""
        return self.builder.icmp_signed("!=", self.bits(condition), ir.Constant(LONG, 0))

    def spread(self, number: Any) -> Value:
        """Broadcast one number to all lanes."""
        return Value(self, splat(self.builder, number, self.kind))

    def load(self, pointer: Any, index: int) -> Value:
        """Load a number that all lanes have in common."""
        place = self.builder.gep(pointer, [ir.Constant(LONG, index)])
        return self.spread(self.builder.load(place))

    def bits(self, condition: Condition) -> Any:
        """A 64-bit integer with a bit for each lane in which the condition holds."""
        bits = self.builder.bitcast(condition.ir, ir.IntType(self.lanes))
        return self.builder.zext(bits, LONG)

    @contextmanager
    def loop(self, count: Any) -> Iterator[Any]:
        """Write a loop whose body runs for each 64-bit number below `count`, which the context
        yields.

        Values from before the loop may be used within it; values from within it, not after it.
        """
        build = self.builder
        with build.goto_entry_block():
            place = build.alloca(LONG)
        build.store(ir.Constant(LONG, 0), place)
        test, body, after = (build.append_basic_block(name) for name in ("loop", "body", "after"))
        build.branch(test)
        build.position_at_end(test)
        number = build.load(place)
        build.cbranch(build.icmp_signed("<", number, count), body, after)
        build.position_at_end(body)
        with self.scope():
            yield number
        build.store(build.add(number, ir.Constant(LONG, 1)), place)
        build.branch(test)
        build.position_at_end(after)

    @contextmanager
    def do_while(self) -> Iterator[Repetition]:
        """Write a loop whose body runs once, and again while `repeats` is 1; see `loop` for
        values."""
        build, repetition = self.builder, Repetition()
        before, body = build.block, build.append_basic_block("body")
        build.branch(body)
        build.position_at_end(body)
        repetition.first = build.phi(BIT)
        repetition.first.add_incoming(BIT(1), before)
        with self.scope():
            yield repetition
        repetition.first.add_incoming(BIT(0), build.block)
        after = build.append_basic_block("after")
        build.cbranch(repetition.repeats, body, after)
        build.position_at_end(after)

    def compute_unless(
        self, is_known: Any, compute: Callable[[], Numbers], side: Any, most: int
    ) -> Numbers:
        """Write the code of `compute` so that it runs unless a bit is set.

        If the bit is set, the numbers of the last run are loaded from memory. Products remain
        products, which sums fuse.

        is_known: the bit.  side: a bit that selects one of two memories of `most` numbers.
        """
        build, memory = self.builder, LaneMemory(self, 2 * most)
        place = build.select(side, ir.Constant(LONG, most), ir.Constant(LONG, 0))
        with build.if_then(build.not_(is_known), likely=True), self.scope():
            results = compute()
            parts = [self._factors.get(number, (number,)) for number in leaves(results)]
            numbers = [each for part in parts for each in part if isinstance(each, Value)]
            assert len(numbers) <= most
            for n, number in enumerate(numbers):
                memory[build.add(place, ir.Constant(LONG, n))] = number
        loaded = (memory[build.add(place, ir.Constant(LONG, n))] for n in range(len(numbers)))
        restored = (
            [next(loaded) if isinstance(each, Value) else each for each in part] for part in parts
        )
        return nest(results, map(math.prod, restored))

    def where_any(
        self,
        condition: Condition,
        other: Numbers,
        function: Callable[..., Any],
        *arguments: Numbers,
    ) -> Numbers:
        """See `dispatch.where_any`; the function is called if any lane needs it."""
        with self._rare(condition, other) as cells:
            for cell, new in zip(
                cells, call_function(self, function, arguments, len(cells)), strict=True
            ):
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
        """Write a branch that runs if the condition holds in any lane.

        Yields memory for its results, in which the numbers of `other` are stored before.
        """
        cells = [LaneMemory(self) for _ in leaves(other)]
        for cell, number in zip(cells, leaves(other), strict=True):
            cell[0] = number
        with self.builder.if_then(self.any(condition), likely=False), self.scope():
            yield cells

    def sum_over(
        self, function: Callable[..., Any], table: Sequence[Sequence[float]], *arguments: Numbers
    ) -> Numbers:
        """See `dispatch.sum_over`."""
        width = len(table[0])
        memory = place_table(self.builder, table)
        sums: list[LaneMemory] = []
        with self.loop(ir.Constant(LONG, len(table))) as number:
            at = self.builder.mul(number, ir.Constant(LONG, width))
            row = self.builder.gep(memory, [at])
            terms = function(*(self.load(row, n) for n in range(width)), *arguments)
            for term in leaves(terms):
                sums.append(LaneMemory(self))
                sums[-1].begin(0.0)
                sums[-1][0] = sums[-1][0] + term
        return nest(terms, iter([each[0] for each in sums]))

    def write_function(self, name: str, *arguments: Value | float) -> Value:
        key = (name, *map(key_of, arguments))
        if name in INTRINSICS:
            return self.once(key, self._write_intrinsic, name, *arguments)  # type: ignore[no-any-return]
        inputs = (
            each if isinstance(each, Value) else Value(self, self.value(each)) for each in arguments
        )
        return self.once(key, FUNCTIONS[name], *inputs)  # type: ignore[no-any-return]

    def _write_intrinsic(self, name: str, *arguments: Value | float) -> Value:
        full = f"llvm.{name}.v{self.lanes}f64"
        module, inputs = self.builder.module, list(map(self.value, arguments))
        kind = ir.FunctionType(self.kind, [self.kind] * len(inputs))
        callee = module.globals.get(full) or ir.Function(module, kind, full)
        return Value(self, self.builder.call(callee, inputs))

    def write_comparison(self, how: str, a: Value | float, b: Value | float) -> Condition:
        return Condition(self, self.builder.fcmp_ordered(how, self.value(a), self.value(b)))

    def write_selection(self, condition: Condition, a: Value | float, b: Value | float) -> Value:
        return Value(self, self.builder.select(condition.ir, self.value(a), self.value(b)))

    def combine(self, how: str, *conditions: Condition) -> Condition:
        connective = getattr(self.builder, CONNECTIVES[how])
        return Condition(self, connective(*(each.ir for each in conditions)))

    def turn_together(self, *angles: Value | float) -> None:
        """See `dispatch.turn_together`."""
        new = tuple(x for x in angles if isinstance(x, Value) and ("turn", x) not in self._known)
        if new:
            self._known |= {("turn", x): turn for x, turn in zip(new, turns(new), strict=True)}


def call_function(
    code: LaneWriter, function: Callable[..., Any], arguments: Numbers, count: int
) -> Iterator[Value]:
    """Call a function that is compiled to an object of its own, and return its `count` results."""
    file = function.__module__.rpartition(".")[2]
    numbers = list(leaves(arguments))
    name = f"{file}_{function.__name__}_of_{len(numbers)}_in_{code.called_lanes}_lanes"
    CALLED[name] = function, nest(arguments, itertools.repeat(0.0)), code.called_lanes
    module = code.builder.module
    kind = ir.FunctionType(ir.VoidType(), [LONG] * 2)
    callee = module.globals.get(name) or ir.Function(module, kind, name)
    wide = LaneWriter(code.builder, code.called_lanes)
    memory, outputs = LaneMemory(wide, len(numbers)), LaneMemory(wide, count)
    for n, number in enumerate(numbers):
        memory[n] = fit_lanes(code, number, wide)
    places = (code.builder.ptrtoint(each.address(0), LONG) for each in (memory, outputs))
    code.builder.call(callee, list(places))
    return (fit_lanes(wide, outputs[n], code) for n in range(count))


def fit_lanes(code: LaneWriter, number: Value | float, other: LaneWriter) -> Value:
    """Convert numbers to another writer's lanes, repeated if it has more lanes."""
    vector, places = code.value(number), [n % code.lanes for n in range(other.lanes)]
    same = other.lanes == code.lanes
    return Value(other, vector if same else shuffle(code.builder, vector, vector, places))


def write_callee(name: str, builder: Any, places: Sequence[Any]) -> None:
    """Write the function of `CALLED` with a name.

    places: the addresses of its arguments and of its results.
    """
    function, like, lanes = CALLED[name]
    code = LaneWriter(builder, lanes)
    inputs, outputs = (
        LaneMemory(code, place=builder.inttoptr(place, ir.PointerType(code.kind)))
        for place in places
    )
    numbers = (inputs[n] for n, _ in enumerate(leaves(like)))
    for n, number in enumerate(leaves(function(*nest(like, numbers)))):
        outputs[n] = number


class LaneMemory:
    """Numbers of all lanes in the code's own memory, which a loop passes to its next round."""

    def __init__(self, code: LaneWriter, size: int = 1, place: Any = None) -> None:
        """size: number of numbers.  place: address of existing memory; None to reserve memory."""
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
        """The address of a number.  index: an integer, or an integer of the generated code."""
        where = ir.Constant(LONG, index) if isinstance(index, int) else index
        return self.code.builder.gep(self._place, [where])
