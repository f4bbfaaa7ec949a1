"""Numbers that write C: a formula run with them becomes statements of a C function.

The optics' text, run once with such numbers, becomes straight C99 with one constant for each
result. What is known when it is written is computed then: products with zero and one, which a
symmetric sensor has many of, and whatever was computed before.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any

from ..scalars.nesting import leaves, nested

#: A number of the formula, or one that is known already; or tuples of such.
Numbers = Any


class Value:
    """A number that the C function will compute, by its name there.

    wide: whether it is of the type `facets_wide`, which has double precision in either build.
    """

    __slots__ = ("name", "wide", "writer")

    def __init__(self, writer: Writer, name: str, wide: bool = False) -> None:
        self.writer, self.name, self.wide = writer, name, wide

    def __add__(self, other: Any) -> Numbers:
        return self.writer.sum(self, other)

    def __radd__(self, other: Any) -> Numbers:
        return self.writer.sum(other, self)

    def __sub__(self, other: Any) -> Numbers:
        return self.writer.difference(self, other)

    def __rsub__(self, other: Any) -> Numbers:
        return self.writer.difference(other, self)

    def __mul__(self, other: Any) -> Numbers:
        return self.writer.product(self, other)

    def __rmul__(self, other: Any) -> Numbers:
        return self.writer.product(other, self)

    def __truediv__(self, other: Any) -> Numbers:
        return self.writer.quotient(self, other)

    def __rtruediv__(self, other: Any) -> Numbers:
        return self.writer.quotient(other, self)

    def __neg__(self) -> Numbers:
        return self.writer.negative(self)

    def __abs__(self) -> Numbers:
        return self.writer.function("fabs", self)

    def __gt__(self, other: Any) -> Condition:
        wide = is_wide(self, other)
        return Condition(
            self.writer, f"{self.writer.text(self, wide)} > {self.writer.text(other, wide)}"
        )


class Condition:
    """Whether something is so, as C asks it."""

    __slots__ = ("text", "writer")

    def __init__(self, writer: Writer, text: str) -> None:
        self.writer, self.text = writer, text

    def __or__(self, other: Condition) -> Condition:
        return Condition(self.writer, f"({self.text}) || ({other.text})")

    def __and__(self, other: Condition) -> Condition:
        return Condition(self.writer, f"({self.text}) && ({other.text})")

    def __bool__(self) -> bool:
        raise TypeError("a formula asks what only its C code will know; use Writer.choose")


def number(value: float, wide: bool = False) -> str:
    """A constant in C, to its last digit."""
    if math.isnan(value):
        return "W(FACETS_NAN)" if wide else "FACETS_NAN"
    return f"{'W' if wide else 'R'}({float(value)!r})"


def is_wide(*parts: Numbers) -> bool:
    return any(isinstance(part, Value) and part.wide for part in parts)


class Writer:
    """Collects the statements of one C function."""

    #: How many states are computed at once; see `scalars.machine.Writer`.
    lanes = 1

    def __init__(self) -> None:
        self.statements: list[str] = []
        self._known: dict[str, str] = {}
        self._count = 0
        self._indent = "    "

    def value(self, name: str, wide: bool = False) -> Value:
        """An argument of the function."""
        return Value(self, name, wide)

    def text(self, part: Numbers, wide: bool = False) -> str:
        """A number as an operand among wide ones, or among others."""
        if not isinstance(part, Value):
            return number(part, wide)
        return f"(facets_wide){part.name}" if wide and not part.wide else part.name

    def narrow(self, part: Numbers) -> Numbers:
        """Wide numbers, in nested tuples, as others."""
        return nested(part, (self._narrow(each) for each in leaves(part)))

    def _narrow(self, part: Numbers) -> Numbers:
        return self._compute("(facets_real){}", False, part) if is_wide(part) else part

    def sum(self, a: Numbers, b: Numbers) -> Numbers:
        if is_known(a, 0):
            return b
        if is_known(b, 0):
            return a
        return self._compute("{} + {}", is_wide(a, b), a, b)

    def difference(self, a: Numbers, b: Numbers) -> Numbers:
        if is_known(b, 0):
            return a
        if is_known(a, 0):
            return -b
        return self._compute("{} - {}", is_wide(a, b), a, b)

    def product(self, a: Numbers, b: Numbers) -> Numbers:
        """Zero times what is finite is zero, and the function is asked with finite numbers."""
        for one, other in ((a, b), (b, a)):
            if is_known(one, 0):
                return 0.0
            if is_known(one, 1):
                return other
            if is_known(one, -1):
                return -other
        return self._compute("{} * {}", is_wide(a, b), a, b)

    def quotient(self, a: Numbers, b: Numbers) -> Numbers:
        if is_known(a, 0):
            return 0.0
        if is_known(b, 1):
            return a
        if isinstance(b, float | int) and math.frexp(b)[0] == 0.5:  # a power of two, exactly
            return self.product(a, 1 / b)
        return self._compute("{} / {}", is_wide(a, b), a, b)

    def negative(self, a: Value) -> Value:
        return self._compute("-{}", a.wide, a)

    def function(self, name: str, *arguments: Numbers) -> Numbers:
        """An elementary function of `math`."""
        if all(isinstance(each, float | int) for each in arguments):
            return getattr(math, name)(*arguments)
        wide = is_wide(*arguments)
        call = f"facets_{'wide_' * wide}{name}({', '.join('{}' for _ in arguments)})"
        return self._compute(call, wide, *arguments)

    def select(self, condition: Condition, a: Numbers, b: Numbers) -> Value:
        return self._compute(f"({condition.text}) ? {{}} : {{}}", is_wide(a, b), a, b)

    def called(self, function: Callable[..., Any], like: Numbers, *arguments: Numbers) -> Numbers:
        """What a C function of the same name gives, in tuples nested like `like`."""
        wanted = list(leaves(like))
        place = self._new("f")
        given = ", ".join(self.text(each) for each in leaves(arguments))
        self._write(f"facets_real {place}[{len(wanted)}];")
        self._write(f"facets_{function.__name__}({given}, {place});")
        found = iter([Value(self, f"{place}[{n}]") for n in range(len(wanted))])
        return nested(like, found)

    rarely = called

    def choose(
        self, condition: Condition, then: Callable[[], Numbers], other: Callable[[], Numbers]
    ) -> Numbers:
        """What one of two functions gives, of which the code takes the way that it needs."""
        place = self._new("c")
        first = len(self.statements)
        like, size = None, 0
        for head, way in ((f"if ({condition.text}) {{", then), ("} else {", other)):
            self._write(head)
            like = self._branch(way, place)
            size = len(list(leaves(like)))
        self._write("}")
        self.statements.insert(first, f"{self._indent}facets_real {place}[{size}];")
        return nested(like, iter([Value(self, f"{place}[{n}]") for n in range(size)]))

    def _branch(self, way: Callable[[], Numbers], place: str) -> Numbers:
        """Writes one way of `choose`; what is computed in it is known in it alone."""
        known, indent = dict(self._known), self._indent
        self._indent += "    "
        found = way()
        for n, each in enumerate(leaves(found)):
            self._write(f"{place}[{n}] = {self.text(each)};")
        self._known, self._indent = known, indent
        return found

    def put(self, place: str, part: Numbers) -> None:
        """A result of the function."""
        self._write(f"{place} = {self.text(part)};")

    def _compute(self, form: str, wide: bool, *operands: Numbers) -> Value:
        """form: the expression, with a place for each operand."""
        expression = form.format(*(self.text(each, wide) for each in operands))
        name = self._known.get(expression)
        if name is None:
            name = self._known[expression] = self._new("t")
            self._write(f"const facets_{'wide' if wide else 'real'} {name} = {expression};")
        return Value(self, name, wide)

    def _new(self, letter: str) -> str:
        self._count += 1
        return f"{letter}{self._count}"

    def _write(self, statement: str) -> None:
        self.statements.append(self._indent + statement)


#: A statement that computes one number, and its name.
CONSTANT = re.compile(r"\s*const facets_(?:real|wide) (\w+) = ")


def needed(statements: list[str]) -> list[str]:
    """The statements without those whose number no later one asks for."""
    asked: set[str] = set()
    kept: list[str] = []
    for statement in reversed(statements):
        constant = CONSTANT.match(statement)
        if constant and constant[1] not in asked:
            continue
        asked.update(re.findall(r"\b[tfc]\d+\b", statement[constant.end() if constant else 0 :]))
        kept.append(statement)
    return kept[::-1]


def is_known(part: Numbers, value: float) -> bool:
    return isinstance(part, float | int) and part == value
