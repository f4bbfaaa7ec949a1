"""Write a formula as statements of a C function; see `scalars.statements`."""

from __future__ import annotations

import math
from typing import Any

from ..scalars.nesting import Numbers, leaves, nest
from ..scalars.statements import Language, StatementWriter
from ..scalars.tracing import Condition, Value


class WideValue(Value):
    """A number of the C type `facets_wide`, which has double precision in both builds."""

    __slots__ = ()


def number(value: float, wide: bool = False) -> str:
    """Write a constant in C with all digits.  wide: whether it is of the type `facets_wide`."""
    text = "FACETS_NAN" if math.isnan(value) else repr(float(value))
    return f"{'W' if wide else 'R'}({text.replace('inf', 'FACETS_INFINITY')})"


#: C99.
C = Language(
    number=number,
    prefix="facets_",
    constant="const facets_real {name} = {value};",
    array="facets_real {name}[{count}];",
    zeros="facets_real {name}[{count}] = {{R(0.0)}};",
    counter="int",
    table="static const facets_real {name}[{count}][{width}] = {{\n{rows}\n}};",
    row="{{{}}}",
    parameter="facets_real {}",
    head="static void facets_{name}({parameters}, facets_real *found)",
    unused="    (void){};",
)


def is_wide(*parts: Numbers) -> bool:
    return any(isinstance(part, WideValue) for part in parts)


class CWriter(StatementWriter):
    """Writer of the statements of one C function, which may contain wide numbers."""

    def __init__(self, language: Language = C, functions: dict[Any, str] | None = None) -> None:
        super().__init__(language, functions)

    def wide_array(self, name: str, count: int) -> tuple[Value, ...]:
        """The elements of a C array of wide numbers."""
        return tuple(WideValue(self, f"{name}[{n}]") for n in range(count))

    def narrow(self, part: Numbers) -> Numbers:
        """Convert the wide numbers in nested tuples to plain numbers."""
        return nest(part, (self._narrow(leaf) for leaf in leaves(part)))

    def _narrow(self, part: Numbers) -> Numbers:
        if not is_wide(part):
            return part
        return self.once(("narrow", part), super().compute, f"(facets_real){part.ir}")

    def write_function(self, name: str, *arguments: Numbers) -> Value:
        return super().write_function(f"{'wide_' * is_wide(*arguments)}{name}", *arguments)

    def write_comparison(self, how: str, a: Numbers, b: Numbers) -> Condition:
        if not is_wide(a, b):
            return super().write_comparison(how, a, b)
        return Condition(self, f"{self.wide_text(a)} {how} {self.wide_text(b)}")

    def wide_text(self, part: Numbers) -> str:
        """Write a number as an operand of a wide operation."""
        if not isinstance(part, Value):
            return number(part, wide=True)
        return str(part.ir) if is_wide(part) else f"(facets_wide){part.ir}"

    def compute(self, form: str, *operands: Numbers) -> Value:
        if not is_wide(*operands):
            return super().compute(form, *operands)
        value = form.format(*map(self.wide_text, operands))
        return WideValue(
            self, self.declare("const facets_wide {name} = {value};", "t", value=value)
        )
