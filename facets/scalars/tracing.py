"""Numbers that record the operations on them, from which writers make LLVM's code, C or JavaScript.

A formula of the optics that runs once with such numbers becomes straight code. `Tracer` has the
functions that all writers share: it omits operations that need no instruction, and writes no
instruction twice. A writer derives from it and writes the individual instructions:

- `lanes.LaneWriter` LLVM's code for several poses at once, without branches;
- `statements.StatementWriter` C, or JavaScript.

Operations come in the order of the formulas, and each rule gives the same bits as the operation
that it replaces, except for two rules:

- 0 x is 0, x + 0 is x, and x - x is 0. For finite x this is exact except for the sign of a zero. A
  NaN or an infinity of x is lost, so that a formula must not rely on it.
- a / b is a times 1 / b, which is written once for all a, if a writer enables this
  (`shares_reciprocals`). It adds an error of half a unit in the last digit.

The rules that are always exact: x 1, x / 1 and x (-1); a negative inside of a sum, a difference or
a product; a division by a power of two; plain numbers among themselves.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Hashable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from .dispatch import real
from .dual import Dual, value_and_slope
from .nesting import Numbers

pi = math.pi


class Value:
    """A number that the generated code will compute.

    writer: of the code.  ir: the writer's form of the number: LLVM's value, or an expression in C
    or JavaScript.  opposite: the number whose negative this is, if any.
    """

    __slots__ = ("ir", "opposite", "writer")
    #: The module with the elementary functions of such numbers, see `dispatch.library`.
    library = sys.modules[__name__]

    def __init__(self, writer: Any, ir: Any) -> None:
        self.writer, self.ir = writer, ir
        self.opposite: Value | None = None

    # a `Dual` computes the operation itself
    def __add__(self, other: Any) -> Any:
        return NotImplemented if isinstance(other, Dual) else self.writer.add(self, other)

    def __radd__(self, other: Any) -> Any:
        return self.writer.add(other, self)

    def __sub__(self, other: Any) -> Any:
        return NotImplemented if isinstance(other, Dual) else self.writer.subtract(self, other)

    def __rsub__(self, other: Any) -> Any:
        return self.writer.subtract(other, self)

    def __mul__(self, other: Any) -> Any:
        return NotImplemented if isinstance(other, Dual) else self.writer.multiply(self, other)

    def __rmul__(self, other: Any) -> Any:
        return self.writer.multiply(other, self)

    def __truediv__(self, other: Any) -> Any:
        return NotImplemented if isinstance(other, Dual) else self.writer.divide(self, other)

    def __rtruediv__(self, other: Any) -> Any:
        return self.writer.divide(other, self)

    def __pow__(self, exponent: int) -> Any:
        return math.prod([self] * exponent)

    def __neg__(self) -> Any:
        return self.writer.negative(self)

    def __abs__(self) -> Any:
        return self.writer.function("fabs", self)

    def __gt__(self, other: Any) -> Condition:
        return self.writer.compare(">", self, other)  # type: ignore[no-any-return]

    def __lt__(self, other: Any) -> Condition:
        return self.writer.compare("<", self, other)  # type: ignore[no-any-return]

    def __ge__(self, other: Any) -> Condition:
        return self.writer.compare(">=", self, other)  # type: ignore[no-any-return]

    def __le__(self, other: Any) -> Condition:
        return self.writer.compare("<=", self, other)  # type: ignore[no-any-return]


class Condition:
    """A condition that the generated code will evaluate; `writer` and `ir` are as in `Value`."""

    __slots__ = ("ir", "writer")

    def __init__(self, writer: Any, ir: Any) -> None:
        self.writer, self.ir = writer, ir

    def __or__(self, other: Condition | bool) -> Any:
        if isinstance(other, bool):
            return other or self
        return self.writer.combine("or", self, other)

    def __and__(self, other: Condition | bool) -> Any:
        if isinstance(other, bool):
            return other and self
        return self.writer.combine("and", self, other)

    __ror__, __rand__ = __or__, __and__

    def __invert__(self) -> Condition:
        return self.writer.combine("not", self)  # type: ignore[no-any-return]

    def __bool__(self) -> bool:
        raise TypeError("a formula asks what only its code will know; use `select`")


class Tracer:
    """Base of the writers of code.  See the module's text for the rules.

    lanes: number of poses on which each instruction works.
    """

    lanes = 1
    shares_reciprocals = False

    def __init__(self) -> None:
        self._known: dict[Hashable, Any] = {}

    # Methods of each writer.

    def write(self, operation: str, *operands: Value | float) -> Value:
        """Write one instruction: "add", "subtract", "multiply", "divide" or "negative"."""
        raise NotImplementedError

    def write_function(self, name: str, *arguments: Value | float) -> Value:
        """Write an elementary function of `math`; with `once` if every use of it is the same."""
        raise NotImplementedError

    def write_comparison(self, how: str, a: Value | float, b: Value | float) -> Condition:
        """how: ">", "<" or "==".  False if one of them is NaN."""
        raise NotImplementedError

    def write_selection(self, condition: Condition, a: Value | float, b: Value | float) -> Value:
        raise NotImplementedError

    def combine(self, how: str, *conditions: Condition) -> Condition:
        """Combine conditions.  how: "and" or "or" of two, or "not" of one."""
        raise NotImplementedError

    def where_any(
        self,
        condition: Condition,
        other: Numbers,
        function: Callable[..., Any],
        *arguments: Numbers,
    ) -> Numbers:
        """See `dispatch.where_any`."""
        raise NotImplementedError

    def sum_over(
        self, function: Callable[..., Any], table: Sequence[Sequence[float]], *arguments: Numbers
    ) -> Numbers:
        """See `dispatch.sum_over`."""
        raise NotImplementedError

    # Methods that all writers share.

    @contextmanager
    def scope(self) -> Iterator[None]:
        """Mark a part of the code that may not run: values from within it are not used after it."""
        known_before = self._known.copy()
        try:
            yield
        finally:
            self._known = known_before

    def once(self, key: Hashable, write: Callable[..., Any], *arguments: Any) -> Any:
        """Return the earlier result of `write` for the same key, or else write now."""
        value = self._known.get(key)
        if value is None:
            value = self._known[key] = write(*arguments)
        return value

    def add(self, a: Value | float, b: Value | float) -> Any:
        if (negative := opposite(b)) is not None:
            return self.subtract(a, negative)
        if (negative := opposite(a)) is not None:
            return self.subtract(b, negative)
        if is_plain(a, 0):
            return b
        if is_plain(b, 0):
            return a
        return self.once(key_of_either_order("add", a, b), self.write, "add", a, b)

    def subtract(self, a: Value | float, b: Value | float) -> Any:
        if (negative := opposite(b)) is not None:
            return self.add(a, negative)
        if a is b:
            return 0.0
        if is_plain(a, 0):
            return -b
        if is_plain(b, 0):
            return a
        return self.once(("subtract", key_of(a), key_of(b)), self.write, "subtract", a, b)

    def multiply(self, a: Value | float, b: Value | float) -> Any:
        for factor, other in ((b, a), (a, b)):
            if (negative := opposite(factor)) is not None:
                return -(other * negative)
        for factor, other in ((a, b), (b, a)):
            if isinstance(factor, Value):
                continue
            if factor == 0:
                return 0.0
            if factor == 1:
                return other
            if factor == -1:
                return -other
        return self.once(key_of_either_order("multiply", a, b), self.write, "multiply", a, b)

    def divide(self, a: Value | float, b: Value | float) -> Any:
        if is_plain(a, 0):
            return 0.0
        if not isinstance(b, Value) and (is_power_of_two(b) or (self.shares_reciprocals and b)):
            return self.multiply(a, 1 / b)
        if self.shares_reciprocals and not is_plain(a, 1):
            return self.multiply(a, self.divide(1.0, b))
        return self.once(("divide", key_of(a), key_of(b)), self.write, "divide", a, b)

    def negative(self, number: Value) -> Value:
        if number.opposite is not None:
            return number.opposite
        negative: Value = self.once(("negative", number), self.write, "negative", number)
        negative.opposite = number
        return negative

    def compare(self, how: str, a: Value | float, b: Value | float) -> Condition:
        key = (how, key_of(a), key_of(b))
        return self.once(key, self.write_comparison, how, a, b)  # type: ignore[no-any-return]

    def select(self, condition: Condition, a: Any, b: Any) -> Any:
        """Return a if the condition holds, else b, with its derivative."""
        if isinstance(a, Dual) or isinstance(b, Dual):
            (value_a, slope_a), (value_b, slope_b) = value_and_slope(a), value_and_slope(b)
            value = self.select(condition, value_a, value_b)
            return Dual(value, self.select(condition, slope_a, slope_b))
        ways = key_of(a), key_of(b)
        if ways[0] == ways[1]:
            return a
        return self.once((condition, *ways), self.write_selection, condition, a, b)

    def turn_together(self, *angles: Value | float) -> None:
        """See `dispatch.turn_together`."""

    def branch_once(
        self, conditions: Sequence[Condition], others: Numbers, compute: Callable[[], Numbers]
    ) -> Numbers:
        """Write what `dispatch.where_each` computes; lanes write it within one branch."""
        return compute()

    def round_product(self, x: Value) -> Value:
        """See `dispatch.round_product`."""
        return x

    def function(self, name: str, *arguments: Value | float) -> Any:
        if not any(isinstance(each, Value) for each in arguments):
            return getattr(math, name)(*arguments)
        return self.write_function(name, *arguments)


def key_of(number: Value | float) -> Hashable:
    """The key of a number: itself, or the digits of a plain number, with a zero's sign."""
    return number if isinstance(number, Value) else float(number).hex()


def key_of_either_order(operation: str, a: Value | float, b: Value | float) -> Hashable:
    return operation, frozenset((key_of(a), key_of(b)))


def opposite(number: Value | float) -> Value | None:
    """The number whose negative `number` is, if any."""
    return number.opposite if isinstance(number, Value) else None


def is_plain(number: Value | float, value: float) -> bool:
    """Whether a number is a plain number of this value."""
    return not isinstance(number, Value) and number == value


def is_power_of_two(number: float) -> bool:
    """Whether 1 / number is exact; the number may be negative."""
    return abs(math.frexp(number)[0]) == 0.5


# The elementary functions, as `dispatch` calls them.


def exp(x: Value) -> Any:
    return x.writer.function("exp", x)


def sqrt(x: Value) -> Any:
    return x.writer.function("sqrt", x)


def sin(x: Value) -> Any:
    return x.writer.function("sin", x)


def cos(x: Value) -> Any:
    return x.writer.function("cos", x)


def log(x: Value) -> Any:
    return x.writer.function("log", x)


def erf(x: Value) -> Any:
    return x.writer.function("erf", x)


def erfc(x: Value) -> Any:
    return x.writer.function("erfc", x)


def atan2(y: Value | float, x: Value | float) -> Any:
    value = x if isinstance(x, Value) else y
    return value.writer.function("atan2", y, x)  # type: ignore[union-attr]


def maximum(a: Any, b: Any) -> Any:
    """The larger of two numbers and its derivative, if at least one is code; b if one is NaN."""
    first, second = real(a), real(b)
    code = first.writer if isinstance(first, Value) else second.writer
    return code.select(code.compare(">", first, second), a, b)


def nan_unless_positive(value: Any, a: Value, b: Value, c: Value) -> Any:
    """Return `value` with its derivative where a, b and c are above zero, else NaN."""
    return a.writer.select((a > 0) & (b > 0) & (c > 0), value, value * math.nan)
