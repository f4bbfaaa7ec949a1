"""Numbers of one pose that write machine code with branches.

A `RowWriter` runs the optics' formulas as `lanes.LaneWriter` does, with branches in place of left
lanes: it computes the poses that a block leaves. Elementary functions are those of the C library,
so that the results are those of the formulas in floats, to the last bit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from llvmlite import ir

from .machine import DOUBLE, INTRINSICS, LONG, MachineWriter
from .nesting import Numbers, leaves, nest
from .tracing import Value, key_of

POINTER = ir.PointerType(DOUBLE)


class RowWriter(MachineWriter):
    """functions: pointer to the addresses of the called functions that are not straight code, in
    the order of `names`: functions of two pointers, to the arguments and to the results."""

    def __init__(self, builder: Any, functions: Any, names: Sequence[str]) -> None:
        super().__init__(builder)
        self._functions, self._names = functions, names

    def write_function(self, name: str, *arguments: Value | float) -> Value:
        if name in INTRINSICS:
            return super().write_function(name, *arguments)
        key = (name, *map(key_of, arguments))
        return self.once(key, self._call, name, *arguments)  # type: ignore[no-any-return]

    def _call(self, name: str, *arguments: Value | float) -> Value:
        module = self.builder.module
        kind = ir.FunctionType(DOUBLE, [DOUBLE] * len(arguments))
        code = module.globals.get(name) or ir.Function(module, kind, name)
        return Value(self, self.builder.call(code, [self.value(each) for each in arguments]))

    def call(self, function: Callable[..., Any], like: Numbers, *arguments: Numbers) -> Numbers:
        given, wanted = list(leaves(arguments)), list(leaves(like))
        memory = self._memory(len(given) + len(wanted))
        for n, number in enumerate(given):
            self.store(number, memory, n)
        results = self.builder.gep(memory, [ir.Constant(LONG, len(given))])
        number = self._names.index(function.__name__)
        place = self.builder.gep(self._functions, [ir.Constant(LONG, number)])
        kind = ir.FunctionType(ir.VoidType(), [POINTER] * 2)
        code = self.builder.inttoptr(self.builder.load(place), kind.as_pointer())
        self.builder.call(code, [memory, results])
        return nest(like, iter([self.load(results, n) for n in range(len(wanted))]))

    rarely = call

    def _memory(self, numbers: int) -> Any:
        """Reserve memory on the stack at the beginning of the function."""
        with self.builder.goto_entry_block():
            return self.builder.alloca(DOUBLE, numbers)
