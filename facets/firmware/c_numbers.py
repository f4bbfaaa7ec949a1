"""Writes a formula as statements of a C function. See `scalars.tracing`.

Straight C99 with one constant for each result.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
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
    text = "FACETS_NAN" if math.isnan(value) else repr(float(value))
    return f"{'W' if wide else 'R'}({text.replace('inf', 'FACETS_INFINITY')})"


def is_wide(*parts: Numbers) -> bool:
    return any(isinstance(part, WideValue) for part in parts)


class CWriter(Tracer):
    """Collects the statements of one C function.

    functions: the texts of the functions that it calls, and of their tables, by the function or the
    table from which each is made; in an order in which they can stand in a file.
    """

    def __init__(self, functions: dict[Any, tuple[str, Numbers]] | None = None) -> None:
        super().__init__()
        self.statements: list[str] = []
        self.functions = {} if functions is None else functions
        self._count = 0
        self._indent = "    "

    def variable(self, name: str, wide: bool = False) -> Value:
        """A number for a C variable of this name."""
        return (WideValue if wide else Value)(self, name)

    def array(self, name: str, count: int, wide: bool = False) -> tuple[Value, ...]:
        """The numbers of a C array."""
        return tuple(self.variable(f"{name}[{n}]", wide) for n in range(count))

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

    def where_any(
        self,
        condition: Condition,
        other: Numbers,
        function: Callable[..., Any],
        *arguments: Numbers,
    ) -> Numbers:
        """See `dispatch.where_any`; the function is a C function."""
        count = len(list(leaves(other)))
        if function not in self.functions:
            self.functions[function] = write_function(function, arguments, self.functions), other
        place = self._new("c")
        self._write(f"facets_real {place}[{count}];")
        called = ", ".join([*map(self.text, leaves(arguments)), place])
        self._write(f"if ({condition.ir}) {{")
        self._write(f"    facets_{function.__name__}({called});")
        self._write("} else {")
        for n, number in enumerate(leaves(other)):
            self._write(f"    {place}[{n}] = {self.text(number)};")
        self._write("}")
        return nest(other, iter([Value(self, f"{place}[{n}]") for n in range(count)]))

    def sum_over(
        self, function: Callable[..., Any], table: Sequence[Sequence[float]], *arguments: Numbers
    ) -> Numbers:
        """See `dispatch.sum_over`; a loop in C."""
        name, place = self._table(table), self._new("c")
        first, indent = len(self.statements), self._indent
        with self.loop(len(table)) as row:
            numbers = (Value(self, f"{name}[{row}][{n}]") for n, _ in enumerate(table[0]))
            terms = function(*numbers, *arguments)
            for n, number in enumerate(leaves(terms)):
                self._write(f"{place}[{n}] += {self.text(number)};")
        count = len(list(leaves(terms)))
        self.statements.insert(first, f"{indent}facets_real {place}[{count}] = {{R(0.0)}};")
        return nest(terms, iter([Value(self, f"{place}[{n}]") for n in range(count)]))

    @contextmanager
    def loop(self, count: int) -> Iterator[str]:
        """Write a loop, whose counter has the name that the context yields."""
        counter, indent = self._new("n"), self._indent
        self._write(f"for (int {counter} = 0; {counter} < {count}; {counter}++) {{")
        self._indent += "    "
        with self.scope():
            yield counter
        self._indent = indent
        self._write("}")

    def _table(self, table: Sequence[Sequence[float]]) -> str:
        names = [key for key in self.functions if isinstance(key, tuple)]
        key = "table", id(table)
        name = f"TABLE_{names.index(key) if key in names else len(names)}"
        rows = ",\n".join("    {" + ", ".join(map(number, row)) + "}" for row in table)
        size = f"[{len(table)}][{len(table[0])}]"
        text = f"static const facets_real {name}{size} = {{\n{rows}\n}};"
        self.functions.setdefault(key, (text, None))
        return name

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


def write_function(
    function: Callable[..., Any], arguments: Numbers, functions: dict[Any, tuple[str, Numbers]]
) -> str:
    """A C function of plain numbers, nested like `arguments`, that fills an array."""
    writer = CWriter(functions)
    names = [f"p{n}" for n, _ in enumerate(leaves(arguments))]
    results = function(*nest(arguments, map(writer.variable, names)))
    for n, each in enumerate(leaves(results)):
        writer.put(f"found[{n}]", each)
    given = ", ".join(f"facets_real {name}" for name in names)
    head = f"static void facets_{function.__name__}({given}, facets_real *found)"
    kept = prune_statements(writer.statements)
    used = set(re.findall(r"\bp\d+\b", "\n".join(kept)))
    unused = [f"    (void){name};" for name in names if name not in used]
    return "\n".join([head, "{", *unused, *kept, "}"])


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
