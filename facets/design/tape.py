"""A formula as a list of operations, from casadi's symbols, for `taylor` to run.

casadi writes the formula down, once; what it would take to differentiate it and to run that, some
hundred times as long, is left to compiled code that knows nothing of the formula.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.units import Floats

(
    CONSTANT, VARIABLE, GIVEN, OUTPUT, ADD, SUBTRACT, MULTIPLY, DIVIDE, NEGATIVE, EXP, SQRT, ERF,
    SIN, COS, LOG, ATAN2, LESS, LESS_OR_EQUAL, AND, OR, NOT, WHERE,
) = range(22)  # fmt: skip
#: casadi's operations and ours; those that are not here are made of others.
KNOWN = {
    "ADD": ADD, "SUB": SUBTRACT, "MUL": MULTIPLY, "DIV": DIVIDE, "NEG": NEGATIVE, "EXP": EXP,
    "SQRT": SQRT, "ERF": ERF, "SIN": SIN, "COS": COS, "LOG": LOG, "ATAN2": ATAN2, "LT": LESS,
    "LE": LESS_OR_EQUAL, "AND": AND, "OR": OR, "NOT": NOT, "IF_ELSE_ZERO": WHERE,
}  # fmt: skip
DISCRETE = (LESS, LESS_OR_EQUAL, AND, OR, NOT)


@dataclass(frozen=True)
class Tape:
    """Operations on numbered places, for a formula of variables and of a state.

    steps (n, 6): see `taylor.run`.  constants (n,).  slots: how many places.  outputs: of the
    formula.
    """

    steps: NDArray[np.int64]
    constants: Floats
    slots: int
    outputs: int

    def __call__(self, x: Floats, states: Floats, order: int = 0) -> Floats:
        """Outputs at states (m, k) and variables x (n,): (m, outputs, coefficients)."""
        from .taylor import evaluate

        return evaluate(self.steps, self.constants, self.slots, x, states, self.outputs, order)


@cache
def operations() -> dict[int, int]:
    """Ours, by casadi's number."""
    import casadi as ca

    return {getattr(ca, f"OP_{name}"): ours for name, ours in KNOWN.items()}


def tape_of(variables: Any, state: Any, outputs: Any) -> Tape:
    """The tape of casadi's symbols `outputs`, which are made of `variables` and `state`."""
    import casadi as ca

    function = ca.Function("tape", [variables, state], [outputs], {"cse": True})
    return Builder(function).tape()


class Builder:
    """Numbers the places anew, so that no result lies where one of its operands does."""

    def __init__(self, function: Any) -> None:
        self.function = function
        self.steps: list[tuple[int, ...]] = []
        self.constants: list[float] = []
        #: Of a place of casadi's: the number of what is in it, in the order of making.
        self.holds: dict[int, int] = {}
        self.varies: list[bool] = []

    def add(self, code: int, a: int = -1, b: int = -1, constant: float = 0.0) -> int:
        """A step whose result gets the next number; a, b: numbers of its operands."""
        of_a, of_b = (n >= 0 and self.varies[n] for n in (a, b))
        if code in (VARIABLE, GIVEN):
            of_a = of_b = False
        new = len(self.varies)
        self.steps.append((code, new, a, b, int(of_a), int(of_b)))
        self.constants.append(constant)
        self.varies.append(code not in DISCRETE and (code == VARIABLE or of_a or of_b))
        return new

    def tape(self) -> Tape:
        import casadi as ca

        f, known = self.function, operations()
        outputs = []
        for k in range(f.n_instructions()):
            code, into, out_of = (
                f.instruction_id(k),
                f.instruction_input(k),
                f.instruction_output(k),
            )
            a, b = (self.holds.get(i, -1) for i in (*into, -1, -1)[:2])
            if code == ca.OP_OUTPUT:
                outputs.append((out_of[1], a))
                continue
            if code == ca.OP_INPUT:
                kind = VARIABLE if into[0] == 0 else GIVEN
                made = self.number(kind, into[1])
            elif code == ca.OP_CONST:
                made = self.add(CONSTANT, constant=float(f.instruction_constant(k)))
            else:
                made = self.operation(code, a, b, known)
            self.holds[out_of[0]] = made
        for place, number in outputs:
            varies = int(self.varies[number])
            self.steps.append((OUTPUT, place, number, -1, varies, 0))
            self.constants.append(0.0)
        return packed(self.steps, self.constants, f.numel_out(0))

    def number(self, kind: int, index: int) -> int:
        """A variable or a part of the state, whose index stands where an operand would."""
        made = self.add(kind)
        code, new = self.steps[-1][:2]
        self.steps[-1] = (code, new, index, -1, 0, 0)
        return made

    def operation(self, code: int, a: int, b: int, known: dict[int, int]) -> int:
        import casadi as ca

        if code == ca.OP_SQ:
            return self.add(MULTIPLY, a, a)
        if code == ca.OP_TWICE:
            return self.add(ADD, a, a)
        if code == ca.OP_INV:
            return self.add(DIVIDE, self.add(CONSTANT, constant=1.0), a)
        if code not in known:
            raise NotImplementedError(f"the tape has no operation like casadi's number {code}")
        return self.add(known[code], a, b)


def packed(steps: list[tuple[int, ...]], constants: list[float], outputs: int) -> Tape:
    """The tape with places used again once what they hold is no longer needed."""
    last: dict[int, int] = {}
    for k, (code, _, a, b, *_) in enumerate(steps):
        for number in (a, b):
            if number >= 0 and code not in (VARIABLE, GIVEN):
                last[number] = k
    free: list[int] = []
    place: dict[int, int] = {}
    rows, slots = [], 0
    for k, (code, new, a, b, of_a, of_b) in enumerate(steps):
        if code in (VARIABLE, GIVEN):
            ends: set[int] = set()
            operands = (a, 0)
        else:
            ends = {n for n in (a, b) if n >= 0 and last[n] == k}
            operands = (place.get(a, 0), place.get(b, 0))
        if code == OUTPUT:
            rows.append((code, new, *operands, of_a, of_b))
        else:
            if not free:
                free.append(slots)
                slots += 1
            place[new] = free.pop()
            rows.append((code, place[new], *operands, of_a, of_b))
            if new not in last:
                ends.add(new)
        free += [place[n] for n in ends]
    return Tape(np.array(rows, dtype=np.int64), np.array(constants), slots, outputs)
