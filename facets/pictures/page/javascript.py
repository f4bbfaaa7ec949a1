"""The package's own formulas as JavaScript, so that a page computes as Python does.

`javascript` runs a formula once with numbers that record the operations on them
(`scalars.statements`), as for the C code and the machine code. Floats of both languages are the
same IEEE doubles, and operations keep their order. Results therefore differ by no more than the
elementary functions do. Named tuples become objects with the same keys. JavaScript has no erf and
erfc; `numbers.js` defines them.
"""

from __future__ import annotations

import json
import textwrap
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np

from ...scalars.nesting import Numbers
from ...scalars.statements import Language, StatementWriter
from ...scalars.tracing import Value

NOT_FINITE = {"nan": "NaN", "inf": "Infinity", "-inf": "-Infinity"}


def literal(value: Any) -> str:
    """Write numbers, truth values and texts in nested tuples and arrays.

    Named tuples and dictionaries become objects with the same keys.
    """
    if isinstance(value, Value):
        return str(value.ir)
    if isinstance(value, np.ndarray):
        return literal(value.tolist())
    if hasattr(value, "_fields"):
        value = value._asdict()
    if isinstance(value, dict):
        return "{" + ", ".join(f"{name}: {literal(each)}" for name, each in value.items()) + "}"
    if isinstance(value, tuple | list | range):
        return "[" + ", ".join(map(literal, value)) + "]"
    if isinstance(value, float | np.floating):
        text = repr(float(value))
        return NOT_FINITE.get(text, text)
    return json.dumps(value)


JAVASCRIPT = Language(
    number=literal,
    prefix="",
    constant="const {name} = {value};",
    array="const {name} = [];",
    zeros="const {name} = Array({count}).fill(0);",
    counter="let",
    table="const {name} = [\n{rows}\n];",
    row="[{}]",
    parameter="{}",
    head="function {name}({parameters}, found)",
    unused="",
)


def javascript(
    name: str, function: Callable[..., Any], functions: dict[Any, str], *examples: Any
) -> Any:
    """Write a function of the package in JavaScript, and return an example of its results.

    name: of the function in JavaScript.  functions: the texts of a page's functions, to which this
    one and those that it calls are added.  examples: of the arguments, in nested tuples, lists,
    named tuples and dictionaries. Their floats become arguments in JavaScript, and other values
    constants. A callable represents a function of the page, and returns an example of its results.
    """
    writer = StatementWriter(JAVASCRIPT, functions)
    names = [f"a{n}" for n, _ in enumerate(examples)]
    results = function(*map(_argument, [writer] * len(names), names, examples))
    head = f"function {name}({', '.join(names)}) {{"
    writer.put_line(f"return {literal(results)};")
    body = textwrap.dedent("\n".join(writer.needed_statements()))
    functions[name] = f"{head}\n{body}\n}}"
    return _plain(results)


def _argument(writer: StatementWriter, place: str, example: Any) -> Any:
    """Replace the floats of an example by variables for the formula.

    place: the argument in JavaScript.
    """
    if isinstance(example, float):
        return writer.variable(place)
    if isinstance(example, dict):
        keys = example.items()
        return SimpleNamespace(**{k: _argument(writer, f"{place}.{k}", each) for k, each in keys})
    if hasattr(example, "_fields"):
        fields = zip(example._fields, example, strict=True)
        return type(example)(*(_argument(writer, f"{place}.{k}", each) for k, each in fields))
    if isinstance(example, tuple | list):
        return tuple(_argument(writer, f"{place}[{n}]", each) for n, each in enumerate(example))
    if callable(example):

        def call(*arguments: Numbers) -> Numbers:
            value = f"{place}({', '.join(map(literal, arguments))})"
            return _argument(writer, writer.declare(JAVASCRIPT.constant, value=value), example())

        return call
    return example


def _plain(part: Any) -> Any:
    """Replace the variables of results by floats: an example for another function."""
    if isinstance(part, Value):
        return 0.0
    if hasattr(part, "_fields"):
        return type(part)(*map(_plain, part))
    if isinstance(part, tuple | list):
        return tuple(map(_plain, part))
    return part
