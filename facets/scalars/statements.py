"""Writes a formula as statements of C or JavaScript. See `tracing`.

Straight code with one constant for each result; a `Language` holds the words of each language.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

from .nesting import Numbers, leaves, nest
from .tracing import Condition, Tracer, Value, key_of

FORMS = {
    "add": "{} + {}",
    "subtract": "{} - {}",
    "multiply": "{} * {}",
    "divide": "{} / {}",
    "negative": "-{}",
}
CONNECTIVES = {"and": "({}) && ({})", "or": "({}) || ({})", "not": "!({})"}


class Language(NamedTuple):
    """The words of a language.

    number: writes a constant.  prefix: of the names of functions.  constant: a definition by name
    and value.  array, zeros: a declaration of an array by name and number of elements, without
    values and with zeros.  counter: the type of a loop's counter.  table: a definition by name,
    number of rows and of columns, and rows.  row: one row of a table.  parameter: a number that a
    function takes, by name.  head: the first line of a function that fills the array `found`, by
    name and parameters.  unused: a statement for a parameter that a function does not use.
    """

    number: Callable[[float], str]
    prefix: str
    constant: str
    array: str
    zeros: str
    counter: str
    table: str
    row: str
    parameter: str
    head: str
    unused: str


class StatementWriter(Tracer):
    """Collects the statements of one function.

    functions: the texts of the functions that it calls, and of their tables, by the function or the
    table from which each is made; a file may have them in this order.
    """

    def __init__(self, language: Language, functions: dict[Any, str] | None = None) -> None:
        super().__init__()
        self.language = language
        self.statements: list[str] = []
        self.functions = {} if functions is None else functions
        self._count = 0
        self._indent = "    "

    def variable(self, name: str) -> Value:
        """A number for a variable of this name."""
        return Value(self, name)

    def array(self, name: str, count: int) -> tuple[Value, ...]:
        """The numbers of an array."""
        return tuple(self.variable(f"{name}[{n}]") for n in range(count))

    def text(self, part: Numbers) -> str:
        """Write a number as an operand."""
        return str(part.ir) if isinstance(part, Value) else self.language.number(part)

    def write(self, operation: str, *operands: Numbers) -> Value:
        return self.compute(FORMS[operation], *operands)

    def write_function(self, name: str, *arguments: Numbers) -> Value:
        places = ", ".join("{}" for _ in arguments)
        key = (name, *map(key_of, arguments))
        form = f"{self.language.prefix}{name}({places})"
        return self.once(key, self.compute, form, *arguments)  # type: ignore[no-any-return]

    def write_comparison(self, how: str, a: Numbers, b: Numbers) -> Condition:
        return Condition(self, f"{self.text(a)} {how} {self.text(b)}")

    def write_selection(self, condition: Condition, a: Numbers, b: Numbers) -> Value:
        return self.compute(f"({condition.ir}) ? {{}} : {{}}", a, b)

    def combine(self, how: str, *conditions: Condition) -> Condition:
        return Condition(self, CONNECTIVES[how].format(*(each.ir for each in conditions)))

    def where_any(
        self,
        condition: Condition,
        other: Numbers,
        function: Callable[..., Any],
        *arguments: Numbers,
    ) -> Numbers:
        """See `dispatch.where_any`; the function is a function of the code."""
        if function not in self.functions:
            self.functions[function] = self._function(function, arguments)
        count = len(list(leaves(other)))
        place = self.declare(self.language.array, count=count)
        called = ", ".join([*map(self.text, leaves(arguments)), place])
        self.put_line(f"if ({condition.ir}) {{")
        self.put_line(f"    {self.language.prefix}{function.__name__}({called});")
        self.put_line("} else {")
        for n, number in enumerate(leaves(other)):
            self.put_line(f"    {place}[{n}] = {self.text(number)};")
        self.put_line("}")
        return nest(other, iter(self.array(place, count)))

    def sum_over(
        self, function: Callable[..., Any], table: Sequence[Sequence[float]], *arguments: Numbers
    ) -> Numbers:
        """See `dispatch.sum_over`; a loop of the code."""
        name, place = self._table(table), self._new("c")
        first, indent = len(self.statements), self._indent
        with self.loop(len(table)) as row:
            terms = function(*self.array(f"{name}[{row}]", len(table[0])), *arguments)
            for n, number in enumerate(leaves(terms)):
                self.put_line(f"{place}[{n}] += {self.text(number)};")
        count = len(list(leaves(terms)))
        zeros = self.language.zeros.format(name=place, count=count)
        self.statements.insert(first, f"{indent}{zeros}")
        return nest(terms, iter(self.array(place, count)))

    @contextmanager
    def loop(self, count: int) -> Iterator[str]:
        """Write a loop, whose counter has the name that the context yields."""
        counter, indent = self._new("n"), self._indent
        kind = self.language.counter
        self.put_line(f"for ({kind} {counter} = 0; {counter} < {count}; {counter}++) {{")
        self._indent += "    "
        with self.scope():
            yield counter
        self._indent = indent
        self.put_line("}")

    def _table(self, table: Sequence[Sequence[float]]) -> str:
        """Emit a table of numbers, once for each table object, and return the name of its array in
        the code."""
        names = [key for key in self.functions if isinstance(key, tuple)]
        key, words = ("table", id(table)), self.language
        name = f"TABLE_{names.index(key) if key in names else len(names)}"
        rows = ",\n".join(f"    {words.row.format(', '.join(map(words.number, r)))}" for r in table)
        text = words.table.format(name=name, count=len(table), width=len(table[0]), rows=rows)
        self.functions.setdefault(key, text)
        return name

    def _function(self, function: Callable[..., Any], arguments: Numbers) -> str:
        """Write a function of numbers nested like `arguments`, which fills an array."""
        words, writer = self.language, type(self)(self.language, self.functions)
        names = [f"p{n}" for n, _ in enumerate(leaves(arguments))]
        results = function(*nest(arguments, map(writer.variable, names)))
        for n, each in enumerate(leaves(results)):
            writer.put(f"found[{n}]", each)
        statements = writer.needed_statements()
        used = set(re.findall(r"\bp\d+\b", "\n".join(statements)))
        unused = [words.unused.format(name) for name in names if name not in used]
        parameters = ", ".join(map(words.parameter.format, names))
        head = words.head.format(name=function.__name__, parameters=parameters)
        return "\n".join([head, "{", *filter(None, unused), *statements, "}"])

    def put(self, place: str, part: Numbers) -> None:
        """Write one result of the function."""
        self.put_line(f"{place} = {self.text(part)};")

    def put_line(self, statement: str) -> None:
        self.statements.append(self._indent + statement)

    def compute(self, form: str, *operands: Numbers) -> Value:
        """Write a statement; form: the expression, with a place for each operand."""
        value = form.format(*map(self.text, operands))
        return self.variable(self.declare(self.language.constant, "t", value=value))

    def declare(self, form: str, letter: str = "c", **words: Any) -> str:
        """Write a definition, and return the new name."""
        name = self._new(letter)
        self.put_line(form.format(name=name, **words))
        return name

    def _new(self, letter: str) -> str:
        self._count += 1
        return f"{letter}{self._count}"

    def needed_statements(self) -> list[str]:
        """The statements without those whose number no later statement uses."""
        used: set[str] = set()
        needed: list[str] = []
        for statement in reversed(self.statements):
            constant = CONSTANT.match(statement)
            if constant and constant[1] not in used:
                continue
            used.update(re.findall(r"\b[tfc]\d+\b", statement[constant.end() if constant else 0 :]))
            needed.append(statement)
        return needed[::-1]


#: Pattern of a statement that computes one number, with its name.
CONSTANT = re.compile(r"\s*const (?:\w+ )?(t\d+) = ")
