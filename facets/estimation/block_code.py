"""What writes the machine code of `blocks`: Gauss-Newton steps with a lane for each reading.

Imported only where the code is not kept.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from typing import Any

from llvmlite import ir

from ..model.blocks import LANES
from ..model.object_code import Write
from ..model.packing import vectors_of
from ..optics import bench_gradient, gradient
from ..optics.forward import by_power, with_power
from ..scalars.lanes import LaneWriter
from ..scalars.machine import DOUBLE, LONG, Condition, Value, counted
from . import straight
from .blocks import (
    BLOCKS,
    COVARIANCES,
    HALF_SIZES,
    LEFT,
    MEANS,
    MEANS_ROWS,
    MOST_STEPS,
    NOISE,
    PACKED,
    PLACES,
    RESIDUALS,
    ROUNDING,
    ROWS,
    STARTS,
    STARTS_ROWS,
    STATES,
    STEPS,
    TABLE,
    VALUES,
    WEIGHED,
    WEIGHT,
    WEIGHTS,
)
from .problem import DARK, FAINTEST, SMALL, UNKNOWNS

Numbers = list[Any]


class Memory:
    """Numbers of all lanes that a loop hands to its next round."""

    def __init__(self, code: LaneWriter, size: int) -> None:
        self.code = code
        with code.builder.goto_entry_block():
            self.place = code.builder.alloca(code.kind, size)

    def __getitem__(self, index: int) -> Value:
        return Value(self.code, self.code.builder.load(self._at(index)))

    def __setitem__(self, index: int, number: Any) -> None:
        self.code.builder.store(self.code.value(number), self._at(index))

    def _at(self, index: int) -> Any:
        return self.code.builder.gep(self.place, [ir.Constant(LONG, index)])


class Question:
    """What a block is asked: its readings, and what is known of their errors and beside them.

    Lanes whose readings lack light, or are out of range, are left.
    """

    def __init__(self, code: LaneWriter, table: Any, values: Numbers, means: Numbers) -> None:
        self.values, self.means = values, means
        noise = [code.load(table, NOISE + i) for i in range(3)]
        self.weight = [code.load(table, WEIGHT + i) for i in range(3)]
        self.darkness = noise[2] * DARK
        place, power = 1 / (noise[0] * noise[1]), 1 / noise[2]
        self.weights: Numbers = []
        for k in range(3):
            psi, zeta, light = values[3 * k : 3 * k + 3]
            halves = [code.load(table, HALF_SIZES + 2 * k + i) for i in range(2)]
            seen = (light > noise[2] * FAINTEST) & (light < inf)
            for at, half in zip((psi, zeta), halves, strict=True):
                seen = seen & ~(abs(at) > half) & (abs(at) < inf)
            code.leave(~seen)
            self.weights += [light * place, light * place, power]
        self.rounding = [code.load(table, ROUNDING + i) for i in range(2)]

    def smallest(self) -> Value:
        """The sum of squares that rounding of the readings alone can make."""
        total: Any = SMALL
        for k in range(3):
            place = self.rounding[0] * self.weights[3 * k]
            power = self.rounding[1] * self.weights[3 * k + 2]
            total = total + 2 * (place * place) + power * power
        return total  # type: ignore[no-any-return]


def weighted(
    code: LaneWriter, vectors: Any, x: Numbers, asked: Question, free: Sequence[int]
) -> tuple[list[Numbers], Numbers]:
    """The Jacobian's columns and the residuals, in standard deviations, at a state and a power.

    Lanes where a detector would be dark are left.
    """
    rows: list[Numbers] = []
    residuals: Numbers = []
    powered, state = with_power(vectors, x[8]), tuple(x[:8])
    ideal = vectors.light is None
    text = gradient.linearised if ideal else bench_gradient.nearly_linearised
    for k, (values, derivatives) in enumerate(text(powered, state)):
        code.leave(~(values[2] > asked.darkness))
        for i in range(3):
            n = len(rows)
            weight = asked.weights[n]
            if ideal:
                of_power = values[2] / x[8] if i == 2 else 0.0
            else:
                of_power = by_power(powered, values, k, i)
            row = [*derivatives[i], of_power]
            rows.append([weight * row[c] for c in free])
            residuals.append(weight * (asked.values[n] - values[i]))
    return [list(column) for column in zip(*rows, strict=True)], residuals


def write_step(
    code: LaneWriter, vectors: Any, asked: Question, free: Sequence[int], memory: dict[str, Memory]
) -> Any:
    """One step from where each lane is. Returns in which lanes it is the last.

    Fills memory: the step's end, the sum of squares here, and the factor.
    """
    x = [memory["here"][c] for c in range(UNKNOWNS)]
    small, before = memory["small"][0], memory["cost"][0]
    columns, residuals = weighted(code, vectors, x, asked, free)
    matrix, right = straight.normal_equations(columns, residuals)
    total: Any = 0.0
    for residual in residuals:
        total = total + residual * residual
    for j, c in enumerate(free):
        if c >= 6:
            weight = asked.weight[c - 6]
            residual = weight * (asked.means[c - 6] - x[c])
            matrix[j][j] = matrix[j][j] + weight * weight
            right[j] = right[j] + weight * residual
            total = total + residual * residual
    slack = small + 2 * code.function("sqrt", before * small)
    code.leave(~(total < before + slack))
    factor, worst = straight.cholesky(code, matrix)
    code.leave(~worst)
    step, gain = straight.solution(factor, right)
    end = list(x)
    for j, c in enumerate(free):
        end[c] = x[c] + step[j]
    for c in range(UNKNOWNS):
        memory["end"][c] = end[c]
    memory["cost"][0] = total
    memory["gain"][0] = gain
    for n, number in enumerate(each for row in factor for each in row):
        memory["factor"][n] = number
    return gain < small


def covariance_of(factor: Memory, free: Sequence[int]) -> Numbers:
    """That of the free unknowns at its places in that of the state, (8, 8), row by row."""
    size = len(free)
    numbers = iter([factor[n] for n in range(size * (size + 1) // 2)])
    triangle = [[next(numbers) for _ in range(i + 1)] for i in range(size)]
    covariance = straight.inverse(triangle)
    places = {c: j for j, c in enumerate(free)}
    rows: Numbers = []
    for a in range(8):
        for b in range(8):
            known = a in places and b in places
            rows.append(covariance[places[a]][places[b]] if known else 0.0)
    return rows


def estimating(free: tuple[int, ...], kind: str) -> Write:
    """Writes code that estimates blocks of readings, as a function of the address of a task's
    table.

    kind: of the light, see `kinds.block_kind`.
    """

    def write(builder: Any, arguments: Sequence[Any]) -> None:
        at = builder.inttoptr(arguments[0], ir.PointerType(LONG))
        places = [builder.gep(at, [ir.Constant(LONG, n)]) for n in range(PLACES)]
        task = [builder.load(place) for place in places]
        with counted(builder, task[BLOCKS]) as index:
            write_block(builder, free, kind, task, index)

    return write


def write_block(
    builder: Any, free: tuple[int, ...], kind: str, task: list[Any], index: Any
) -> None:
    """task: the numbers of a task's table.  index: of the block."""
    code = LaneWriter(builder, LANES)
    addresses = task[PACKED:WEIGHED]
    pointers = [builder.inttoptr(address, ir.PointerType(DOUBLE)) for address in addresses]
    vectors = vectors_of(code, pointers[PACKED], kind)
    first = builder.mul(index, ir.Constant(LONG, LANES))

    def apart(width: int, rows: int = ROWS) -> Any:
        """How far the rows of the lanes are apart."""
        return builder.mul(task[rows], ir.Constant(LONG, width))

    def here(array: int, width: int, rows: int = ROWS) -> Any:
        """Where the block's rows of an array begin; width: numbers a row."""
        return builder.gep(pointers[array], [builder.mul(first, apart(width, rows))])

    def read(array: int, width: int, rows: int = ROWS) -> Numbers:
        return code.load_rows(here(array, width, rows), apart(width, rows), width)

    asked = Question(code, pointers[TABLE], read(VALUES, 9), read(MEANS, 3, MEANS_ROWS))
    own = read(WEIGHTS, 9)
    with_own = builder.icmp_signed("!=", task[WEIGHED], ir.Constant(LONG, 0))
    asked.weights = [
        Value(code, builder.select(with_own, a.ir, b.ir))
        for a, b in zip(own, asked.weights, strict=True)
    ]
    size = len(free)
    sizes = {"here": 9, "end": 9, "cost": 1, "gain": 1, "small": 1, "steps": 1}
    memory = {name: Memory(code, each) for name, each in sizes.items()}
    memory["factor"] = Memory(code, size * (size + 1) // 2)
    for c, number in enumerate(read(STARTS, UNKNOWNS, STARTS_ROWS)):
        memory["here"][c] = number
    memory["cost"][0], memory["small"][0], memory["steps"][0] = inf, asked.smallest(), 0.0
    with builder.goto_entry_block():
        kind = code.left.ir.type
        gone, active, round_ = builder.alloca(kind), builder.alloca(kind), builder.alloca(LONG)
    builder.store(code.left.ir, gone)
    builder.store((~code.left).ir, active)
    builder.store(ir.Constant(LONG, 0), round_)
    body, after = builder.append_basic_block("step"), builder.append_basic_block("end")
    builder.branch(body)
    builder.position_at_end(body)
    code.left = Condition(code, builder.load(gone))
    going = Condition(code, builder.load(active))
    memory["steps"][0] = memory["steps"][0] + code.select(going, 1.0, 0.0)
    last = write_step(code, vectors, asked, free, memory)
    going = going & ~last & ~code.left
    for c in range(UNKNOWNS):
        memory["here"][c] = code.select(going, memory["end"][c], memory["here"][c])
    builder.store(code.left.ir, gone)
    builder.store(going.ir, active)
    done = builder.add(builder.load(round_), ir.Constant(LONG, 1))
    builder.store(done, round_)
    some = builder.icmp_signed("!=", code.bits(going), ir.Constant(LONG, 0))
    again = builder.and_(some, builder.icmp_signed("<", done, task[MOST_STEPS]))
    builder.cbranch(again, body, after)
    builder.position_at_end(after)
    ends = [memory["end"][c] for c in range(UNKNOWNS)]
    code.store_rows(ends, here(STATES, UNKNOWNS), apart(UNKNOWNS))
    rest = memory["cost"][0] - memory["gain"][0]
    root = code.function("sqrt", code.select(rest > 0, rest, 0.0))
    code.store_lanes(root, here(RESIDUALS, 1), 0)
    code.store_lanes(memory["steps"][0], here(STEPS, 1), 0)
    bits = code.bits(Condition(code, builder.load(gone)) | Condition(code, builder.load(active)))
    flags = builder.bitcast(pointers[LEFT], ir.PointerType(LONG))
    builder.store(bits, builder.gep(flags, [index]))
    with builder.if_then(builder.icmp_signed("!=", task[COVARIANCES], ir.Constant(LONG, 0))):
        covariance = covariance_of(memory["factor"], free)
        code.store_rows(covariance, here(COVARIANCES, 64), apart(64))
