"""Straight machine code from the optics' text, inside functions that Numba compiles.

`straight` makes of a function over numbers one that compiled code calls with three pointers: where
a sensor's vectors are, the numbers it is asked with, and where its results go. What the text calls
and can not be straight (a series, a table) Numba compiles; what is seldom needed, when it is first
needed. Importing this imports Numba.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any

from llvmlite import ir
from numba import types  # noqa: TID253
from numba.extending import intrinsic  # noqa: TID253

from ..scalars.machine import DOUBLE, LONG, Value, Writer
from ..scalars.nesting import Numbers, leaves, nested
from . import rare
from .packing import vectors_at

NUMBER: Any = types.float64
POINTER = ir.PointerType(DOUBLE)

#: A function of vectors and numbers that gives places and what belongs there.
Formula = Callable[[Any, list[Value]], Iterable[tuple[int, Any]]]


def type_of(part: Numbers) -> Any:
    """Numba's type of numbers in nested tuples."""
    if not isinstance(part, tuple):
        return NUMBER
    inner = [type_of(each) for each in part]
    alike = all(each == inner[0] for each in inner)
    made: Any = types
    return made.UniTuple(inner[0], len(inner)) if alike else made.Tuple(inner)


class NumbaWriter(Writer):
    """Writes into a function that Numba compiles.

    context, builder: Numba's.  table: pointer to the addresses of `rare`.
    """

    def __init__(self, context: Any, builder: Any, table: Any) -> None:
        super().__init__(builder)
        self.context, self.table = context, table

    def function(self, name: str, *arguments: Value | float) -> Value:
        signature = NUMBER(*[NUMBER] * len(arguments))
        code = self.context.get_function(getattr(math, name), signature)
        return Value(self, code(self.builder, [self.value(each) for each in arguments]))

    def called(self, function: Callable[..., Any], like: Numbers, *arguments: Numbers) -> Numbers:
        kind = type_of(like)
        signature = kind(*map(type_of, arguments))
        given = [self._bundle(each) for each in arguments]
        found = self.context.compile_internal(self.builder, function, signature, given)
        return self._numbers(found, kind)

    def _bundle(self, part: Numbers) -> Any:
        if not isinstance(part, tuple):
            return self.value(part)
        return self.context.make_tuple(
            self.builder, type_of(part), [self._bundle(each) for each in part]
        )

    def _numbers(self, value: Any, kind: Any) -> Numbers:
        if not isinstance(kind, types.BaseTuple):
            return Value(self, value)
        return tuple(
            self._numbers(self.builder.extract_value(value, n), each)
            for n, each in enumerate(kind.types)  # type: ignore[attr-defined]
        )

    def rarely(self, function: Callable[..., Any], like: Numbers, *arguments: Numbers) -> Numbers:
        given, wanted = list(leaves(arguments)), list(leaves(like))
        memory = self._memory(len(given) + len(wanted))
        for n, number in enumerate(given):
            self.store(number, memory, n)
        results = self.builder.gep(memory, [ir.Constant(LONG, len(given))])
        place = self.builder.gep(
            self.table, [ir.Constant(LONG, rare.NAMES.index(function.__name__))]
        )
        kind = ir.FunctionType(ir.VoidType(), [POINTER] * 4)
        code = self.builder.inttoptr(self.builder.load(place), kind.as_pointer())
        self.builder.call(code, [memory, results, memory, memory])
        found = iter([self.load(results, n) for n in range(len(wanted))])
        return nested(like, found)

    def _memory(self, numbers: int) -> Any:
        """Room on the stack, made once where the function begins."""
        with self.builder.goto_entry_block():
            return self.builder.alloca(DOUBLE, numbers)


def straight(formula: Formula, example: Any, size: int, numbers: int) -> Any:
    """Machine code for `formula`, as a function of three pointers for compiled code.

    example: the vectors' arrangement; None stands for what is not wanted.  size: how many numbers
    `packing.pack` makes of a sensor, after which the address of the rare functions' addresses
    comes.  numbers: how many the formula is asked with.
    """

    def write(_: Any, packed: Any, given: Any, found: Any) -> tuple[Any, Any]:
        def code(context: Any, builder: Any, signature: Any, pointers: Any) -> Any:
            at = builder.gep(pointers[0], [ir.Constant(LONG, size)])
            address = builder.load(builder.bitcast(at, ir.PointerType(LONG)))
            writer = NumbaWriter(context, builder, builder.inttoptr(address, ir.PointerType(LONG)))
            asked = [writer.load(pointers[1], n) for n in range(numbers)]
            for place, number in formula(vectors_at(writer, pointers[0], example), asked):
                writer.store(number, pointers[2], place)
            return context.get_dummy_value()

        return types.void(packed, given, found), code

    return intrinsic(write)
