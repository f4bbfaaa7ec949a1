"""Writes a formula as LLVM's instructions. See `tracing`.

The formulas are not parsed, typed or inlined, which takes a compiler for Python ten times as long.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from llvmlite import ir

from .tracing import Condition, Tracer, Value, key_of

DOUBLE = ir.DoubleType()
LONG = ir.IntType(64)

#: The names that LLVM's builder has for the operations.
INSTRUCTIONS = {
    "add": "fadd",
    "subtract": "fsub",
    "multiply": "fmul",
    "divide": "fdiv",
    "negative": "fneg",
}
INTRINSICS = ("sqrt", "fabs")
CONNECTIVES = {"and": "and_", "or": "or_", "not": "not_"}


class MachineWriter(Tracer):
    """Base of the writers of LLVM's code.

    builder: an `llvmlite` builder at the place of the next instruction.  kind: LLVM's type of a
    number.
    """

    kind: Any = DOUBLE

    def __init__(self, builder: Any) -> None:
        super().__init__()
        self.builder = builder

    def value(self, number: Value | float) -> Any:
        """Convert a number to LLVM's value."""
        return number.ir if isinstance(number, Value) else self.constant(number)

    def constant(self, number: float) -> Any:
        return ir.Constant(DOUBLE, float(number))

    def write(self, operation: str, *operands: Value | float) -> Value:
        instruction = getattr(self.builder, INSTRUCTIONS[operation])
        return Value(self, instruction(*map(self.value, operands)))

    def write_function(self, name: str, *arguments: Value | float) -> Value:
        """Write one of the functions that processors have."""
        if name not in INTRINSICS:
            raise NotImplementedError(f"no code is written for {name}")
        key = (name, *map(key_of, arguments))
        return self.once(key, self._write_intrinsic, name, *arguments)  # type: ignore[no-any-return]

    def _write_intrinsic(self, name: str, *arguments: Value | float) -> Value:
        full = f"llvm.{name}.{'f64' if self.lanes == 1 else f'v{self.lanes}f64'}"
        module, given = self.builder.module, list(map(self.value, arguments))
        kind = ir.FunctionType(self.kind, [self.kind] * len(given))
        known = module.globals.get(full) or ir.Function(module, kind, full)
        return Value(self, self.builder.call(known, given))

    def write_comparison(self, how: str, a: Value | float, b: Value | float) -> Condition:
        return Condition(self, self.builder.fcmp_ordered(how, self.value(a), self.value(b)))

    def write_selection(self, condition: Condition, a: Value | float, b: Value | float) -> Value:
        return Value(self, self.builder.select(condition.ir, self.value(a), self.value(b)))

    def combine(self, how: str, *conditions: Condition) -> Condition:
        connective = getattr(self.builder, CONNECTIVES[how])
        return Condition(self, connective(*(each.ir for each in conditions)))

    def load(self, pointer: Any, index: int) -> Value:
        return Value(self, self.builder.load(self.builder.gep(pointer, [ir.Constant(LONG, index)])))

    def store(self, number: Value | float, pointer: Any, index: int) -> None:
        place = self.builder.gep(pointer, [ir.Constant(LONG, index)])
        self.builder.store(self.value(number), place)


@contextmanager
def write_loop(builder: Any, count: Any) -> Iterator[Any]:
    """Write a loop whose body runs for each 64-bit number below `count`, which the context
    yields."""
    with builder.goto_entry_block():
        place = builder.alloca(LONG)
    builder.store(ir.Constant(LONG, 0), place)
    test, body, after = (builder.append_basic_block(name) for name in ("loop", "body", "after"))
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
    """A loop of `do_while`.  again: a bit, set within the loop, that repeats it."""

    again: Any = None


@contextmanager
def do_while(builder: Any) -> Iterator[Repetition]:
    """Write a loop whose body runs once, and again while `again` is true."""
    body, after = builder.append_basic_block("body"), builder.append_basic_block("after")
    builder.branch(body)
    builder.position_at_end(body)
    repetition = Repetition()
    yield repetition
    builder.cbranch(repetition.again, body, after)
    builder.position_at_end(after)
