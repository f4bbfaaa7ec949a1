"""Writes a formula as statements of a C function. See `scalars.tracing`.

Straight C99 with one constant for each result.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any

from ..scalars.nesting import leaves, nest
from ..scalars.tracing import Condition, Tracer, Value, key_of

#: A number of the formula or a known number, or nested tuples of these.
Numbers = Any

FORMS = {
    "add": "{} + {}",
    "subtract": "{} - {}",
    "multiply": "{} * {}",
    "divide": "{} / {}",
    "negative": "-{}",
}
CONNECTIVES = {"and": "({}) && ({})", "or": "({}) || ({})", "not": "!({})"}


class WideValue(Value):
    """A number of the type `facets_wide`, which has double precision in both builds."""

    __slots__ = ()


def number(value: float, wide: bool = False) -> str:
    """Write a constant in C with all digits."""
    if math.isnan(value):
        return "W(FACETS_NAN)" if wide else "FACETS_NAN"
    return f"{'W' if wide else 'R'}({float(value)!r})"


def is_wide(*parts: Numbers) -> bool:
    return any(isinstance(part, WideValue) for part in parts)


class CWriter(Tracer):
    """Collects the statements of one C function."""

    drops_zeros = True

    def __init__(self) -> None:
        super().__init__()
        self.statements: list[str] = []
        self._count = 0
        self._indent = "    "

    def variable(self, name: str, wide: bool = False) -> Value:
        """A number for a C variable of this name."""
        return (WideValue if wide else Value)(self, name)

    def text(self, part: Numbers, wide: bool = False) -> str:
        """Write a number as an operand of a wide or of a plain operation."""
        if not isinstance(part, Value):
            return number(part, wide)
        return f"(facets_wide){part.ir}" if wide and not is_wide(part) else str(part.ir)

    def narrow(self, part: Numbers) -> Numbers:
        """Convert wide numbers, in nested tuples, to plain ones."""
        return nest(part, (self._narrow(each) for each in leaves(part)))

    def _narrow(self, part: Numbers) -> Numbers:
        if not is_wide(part):
            return part
        return self.once(("narrow", part), self._assign, f"(facets_real){part.ir}", False)

    def write(self, operation: str, *operands: Numbers) -> Value:
        return self._compute(FORMS[operation], *operands)

    def write_function(self, name: str, *arguments: Numbers) -> Value:
        places = ", ".join("{}" for _ in arguments)
        form = f"facets_{'wide_' * is_wide(*arguments)}{name}({places})"
        key = (name, *map(key_of, arguments))
        return self.once(key, self._compute, form, *arguments)  # type: ignore[no-any-return]

    def write_comparison(self, how: str, a: Numbers, b: Numbers) -> Condition:
        wide = is_wide(a, b)
        return Condition(self, f"{self.text(a, wide)} {how} {self.text(b, wide)}")

    def write_selection(self, condition: Condition, a: Numbers, b: Numbers) -> Value:
        return self._compute(f"({condition.ir}) ? {{}} : {{}}", a, b)

    def combine(self, how: str, *conditions: Condition) -> Condition:
        return Condition(self, CONNECTIVES[how].format(*(each.ir for each in conditions)))

    def call(self, function: Callable[..., Any], like: Numbers, *arguments: Numbers) -> Numbers:
        """Call a C function of this name; its results are nested like `like`."""
        wanted = list(leaves(like))
        place = self._new("f")
        given = ", ".join(self.text(each) for each in leaves(arguments))
        self._write(f"facets_real {place}[{len(wanted)}];")
        self._write(f"facets_{function.__name__}({given}, {place});")
        found = iter([Value(self, f"{place}[{n}]") for n in range(len(wanted))])
        return nest(like, found)

    rarely = call

    def choose(
        self, condition: Condition, then: Callable[[], Numbers], other: Callable[[], Numbers]
    ) -> Numbers:
        """Result of one of two functions, between which the C code branches."""
        place = self._new("c")
        first = len(self.statements)
        like, size = None, 0
        for head, way in ((f"if ({condition.ir}) {{", then), ("} else {", other)):
            self._write(head)
            like = self._branch(way, place)
            size = len(list(leaves(like)))
        self._write("}")
        self.statements.insert(first, f"{self._indent}facets_real {place}[{size}];")
        return nest(like, iter([Value(self, f"{place}[{n}]") for n in range(size)]))

    def _branch(self, way: Callable[[], Numbers], place: str) -> Numbers:
        """Write one branch of `choose`."""
        indent = self._indent
        self._indent += "    "
        with self.scope():
            found = way()
        for n, each in enumerate(leaves(found)):
            self._write(f"{place}[{n}] = {self.text(each)};")
        self._indent = indent
        return found

    def put(self, place: str, part: Numbers) -> None:
        """Write one result of the function."""
        self._write(f"{place} = {self.text(part)};")

    def _compute(self, form: str, *operands: Numbers) -> Value:
        """Write a statement; form: the expression, with a place for each operand."""
        wide = is_wide(*operands)
        return self._assign(form.format(*(self.text(each, wide) for each in operands)), wide)

    def _assign(self, expression: str, wide: bool) -> Value:
        name = self._new("t")
        self._write(f"const facets_{'wide' if wide else 'real'} {name} = {expression};")
        return self.variable(name, wide)

    def _new(self, letter: str) -> str:
        self._count += 1
        return f"{letter}{self._count}"

    def _write(self, statement: str) -> None:
        self.statements.append(self._indent + statement)


#: Pattern of a statement that computes one number, with its name.
CONSTANT = re.compile(r"\s*const facets_(?:real|wide) (\w+) = ")


def prune_statements(statements: list[str]) -> list[str]:
    """Remove the statements whose number no later statement uses."""
    asked: set[str] = set()
    kept: list[str] = []
    for statement in reversed(statements):
        constant = CONSTANT.match(statement)
        if constant and constant[1] not in asked:
            continue
        asked.update(re.findall(r"\b[tfc]\d+\b", statement[constant.end() if constant else 0 :]))
        kept.append(statement)
    return kept[::-1]
