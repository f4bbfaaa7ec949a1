"""Numbers that write machine code: a formula run with them appends its instructions.

The optics' text, run once with such numbers, becomes straight code for LLVM. Nothing of it is
parsed, given types or inlined, which take a compiler for Python ten times as long. Operations come
in the order of the text, so that the results are those of floats to the last bit.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from llvmlite import ir

from .dispatch import real
from .dual import Dual, parts
from .nesting import Numbers

pi = math.pi

DOUBLE = ir.DoubleType()
LONG = ir.IntType(64)


class Value:
    """A number that the code being written will compute. writer: of the code."""

    __slots__ = ("ir", "writer")

    def __init__(self, writer: Writer, value: Any) -> None:
        self.writer, self.ir = writer, value

    def with_number(self, operation: str, other: Any) -> Value:
        """What an operation on this and another number gives; a `Dual` knows itself."""
        if isinstance(other, Dual):
            return NotImplemented
        return self.writer.two(operation, self, other)

    def __add__(self, other: Any) -> Value:
        return self.with_number("fadd", other)

    def __radd__(self, other: Any) -> Value:
        return self.writer.two("fadd", other, self)

    def __sub__(self, other: Any) -> Value:
        return self.with_number("fsub", other)

    def __rsub__(self, other: Any) -> Value:
        return self.writer.two("fsub", other, self)

    def __mul__(self, other: Any) -> Value:
        return self.with_number("fmul", other)

    def __rmul__(self, other: Any) -> Value:
        return self.writer.two("fmul", other, self)

    def __truediv__(self, other: Any) -> Value:
        return self.with_number("fdiv", other)

    def __rtruediv__(self, other: Any) -> Value:
        return self.writer.two("fdiv", other, self)

    def __neg__(self) -> Value:
        return self.writer.negative(self)

    def __abs__(self) -> Value:
        return self.writer.function("fabs", self)

    def __gt__(self, other: Any) -> Condition:
        return self.writer.compare(">", self, other)

    def __lt__(self, other: Any) -> Condition:
        return self.writer.compare("<", self, other)


class Condition:
    """Whether something is so, which the code being written will find out."""

    __slots__ = ("ir", "writer")

    def __init__(self, writer: Writer, value: Any) -> None:
        self.writer, self.ir = writer, value

    def __or__(self, other: Condition) -> Condition:
        return Condition(self.writer, self.writer.builder.or_(self.ir, other.ir))

    def __and__(self, other: Condition) -> Condition:
        return Condition(self.writer, self.writer.builder.and_(self.ir, other.ir))

    def __invert__(self) -> Condition:
        return Condition(self.writer, self.writer.builder.not_(self.ir))

    def __bool__(self) -> bool:
        raise TypeError("a formula asks what only its machine code will know; use Writer.choose")


class Writer:
    """Where instructions are written: with an `llvmlite` builder.

    lanes: how many numbers each instruction works on; see `lanes.LaneWriter`.
    """

    lanes = 1

    def __init__(self, builder: Any) -> None:
        self.builder = builder

    def value(self, number: Value | float) -> Any:
        """A number as LLVM has it."""
        return number.ir if isinstance(number, Value) else self.constant(number)

    def constant(self, number: float) -> Any:
        return ir.Constant(DOUBLE, float(number))

    def two(self, operation: str, a: Value | float, b: Value | float) -> Value:
        return Value(self, getattr(self.builder, operation)(self.value(a), self.value(b)))

    def negative(self, number: Value) -> Value:
        return Value(self, self.builder.fneg(number.ir))

    def compare(self, how: str, a: Value | float, b: Value | float) -> Condition:
        """False where one of them is NaN."""
        return Condition(self, self.builder.fcmp_ordered(how, self.value(a), self.value(b)))

    def select(self, condition: Condition, a: Value | float, b: Value | float) -> Value:
        return Value(self, self.builder.select(condition.ir, self.value(a), self.value(b)))

    def load(self, pointer: Any, index: int) -> Value:
        return Value(self, self.builder.load(self.builder.gep(pointer, [ir.Constant(LONG, index)])))

    def store(self, number: Value | float, pointer: Any, index: int) -> None:
        place = self.builder.gep(pointer, [ir.Constant(LONG, index)])
        self.builder.store(self.value(number), place)

    def choose(
        self, condition: Condition, then: Callable[[], Numbers], other: Callable[[], Numbers]
    ) -> Numbers:
        """What one of two functions gives, of which the code takes the way that it needs."""
        ways, ends = [], []
        with self.builder.if_else(condition.ir) as blocks:
            for block, way in zip(blocks, (then, other), strict=True):
                with block:
                    ways.append(way())
                    ends.append(self.builder.block)
        return self._merge(ways, ends)

    def _merge(self, ways: list[Numbers], ends: list[Any]) -> Numbers:
        if isinstance(ways[0], tuple):
            return tuple(self._merge(list(parts), ends) for parts in zip(*ways, strict=True))
        phi = self.builder.phi(DOUBLE)
        for way, end in zip(ways, ends, strict=True):
            phi.add_incoming(self.value(way), end)
        return Value(self, phi)

    def function(self, name: str, *arguments: Value | float) -> Value:
        """An elementary function of `math`."""
        raise NotImplementedError

    def called(self, function: Callable[..., Any], like: Numbers, *arguments: Numbers) -> Numbers:
        """What a compiled function gives, in tuples nested like `like`."""
        raise NotImplementedError

    def rarely(self, function: Callable[..., Any], like: Numbers, *arguments: Numbers) -> Numbers:
        """The same of a function that is compiled when it is first needed."""
        raise NotImplementedError


def is_code(x: Any) -> bool:
    return isinstance(x, Value)


def exp(x: Value) -> Value:
    return x.writer.function("exp", x)


def sqrt(x: Value) -> Value:
    return x.writer.function("sqrt", x)


def sin(x: Value) -> Value:
    return x.writer.function("sin", x)


def cos(x: Value) -> Value:
    return x.writer.function("cos", x)


def log(x: Value) -> Value:
    return x.writer.function("log", x)


def erf(x: Value) -> Value:
    return x.writer.function("erf", x)


def erfc(x: Value) -> Value:
    return x.writer.function("erfc", x)


def atan2(y: Value, x: Value) -> Value:
    return x.writer.function("atan2", y, x)


def larger(a: Any, b: Any) -> Any:
    """The larger of two numbers, of which one at least is code, with what it carries along; b where
    one is NaN."""
    first, second = real(a), real(b)
    code = first.writer if isinstance(first, Value) else second.writer
    return chosen(code, code.compare(">", first, second), a, b)


def chosen(code: Writer, condition: Condition, a: Any, b: Any) -> Any:
    """a where something is so, else b, with what these carry along."""
    if isinstance(a, Dual) or isinstance(b, Dual):
        (one, first), (other, second) = parts(a), parts(b)
        return Dual(code.select(condition, one, other), code.select(condition, first, second))
    return code.select(condition, a, b)


def defined(value: Any, a: Value, b: Value, c: Value) -> Any:
    """`value`, with what it carries along, where a, b and c are above zero, else NaN."""
    return chosen(a.writer, (a > 0) & (b > 0) & (c > 0), value, value * math.nan)


@contextmanager
def counted(builder: Any, count: Any) -> Iterator[Any]:
    """A loop: what is written within it is done for each 64-bit number below `count`, which it
    gives."""
    with builder.goto_entry_block():
        place = builder.alloca(LONG)
    builder.store(ir.Constant(LONG, 0), place)
    test, body, after = (builder.append_basic_block(name) for name in ("test", "body", "after"))
    builder.branch(test)
    builder.position_at_end(test)
    number = builder.load(place)
    builder.cbranch(builder.icmp_signed("<", number, count), body, after)
    builder.position_at_end(body)
    yield number
    builder.store(builder.add(number, ir.Constant(LONG, 1)), place)
    builder.branch(test)
    builder.position_at_end(after)


class Repetition:
    """again: a bit, set within a loop: whether it is done once more."""

    again: Any = None


@contextmanager
def do_while(builder: Any) -> Iterator[Repetition]:
    """A loop: what is written within it is done once, and again while `again` is so."""
    body, after = builder.append_basic_block("body"), builder.append_basic_block("after")
    builder.branch(body)
    builder.position_at_end(body)
    repetition = Repetition()
    yield repetition
    builder.cbranch(repetition.again, body, after)
    builder.position_at_end(after)
