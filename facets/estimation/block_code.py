"""What writes the machine code of `blocks`: Gauss-Newton steps with a lane for each reading.

Imported only where the code is not kept.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from typing import Any, NamedTuple

from llvmlite import ir

from ..model.block_code import LaneWrite, linearise_exactly, pointers_to, power_derivative
from ..model.packing import row_size, vectors_at, vectors_of
from ..optics import bench_gradient, gradient
from ..optics.forward import replace_power
from ..scalars.lanes import LaneFlag, LaneMemory, LaneWriter
from ..scalars.machine import DOUBLE, LONG, write_loop
from ..scalars.tracing import Condition, Value
from . import straight
from .block_task import SCALES, BlockTask, Form
from .problem import MAX_COST_SHARE, MAX_DAMPING, NEGLIGIBLE_GAIN, PROGRESS_INTERVAL_STEPS, UNKNOWNS

Numbers = list[Any]

#: The first damping of a step that does not help, by how much it changes from step to step, and
#: below which it ends.
FIRST_DAMPING, DAMPING_FACTOR, MIN_DAMPING = 1e-3, 10.0, 1e-6


def write_estimator(form: Form) -> LaneWrite:
    """Writes code that estimates blocks of readings, as a function of a task's address."""

    def write(builder: Any, arguments: Sequence[Any], lanes: int) -> None:
        at = builder.inttoptr(arguments[0], ir.PointerType(LONG))
        numbers = range(len(BlockTask._fields))
        task = BlockTask(*(builder.load(builder.gep(at, [ir.Constant(LONG, n)])) for n in numbers))
        with write_loop(builder, task.blocks) as index:
            write_block(LaneWriter(builder, lanes), form, task, index)

    return write


def write_block(code: LaneWriter, form: Form, task: BlockTask, index: Any) -> None:
    """task: of numbers that the code has read.  index: of the block."""
    rows = BlockRows(code, task, index)
    vectors = rows.vectors(form)
    question = BlockReadings(code, rows)
    fit = DampedSteps(code, form, task) if form.can_damp_steps else PlainSteps(code, form, task)
    fit.begin(rows.read("starts", UNKNOWNS, task.own_starts), question)
    with code.do_while() as repetition:
        fit.write_round(vectors, question)
        repetition.again = code.any(fit.going.get() & (fit.steps[0] < fit.most_steps))
    write_results(code, form, task, fit, rows)
    left = code.left | fit.going.get()
    rows.write_bits("left", index, left)
    rows.write_bits("stalled", index, fit.stalled.get() & ~left)


def write_results(
    code: LaneWriter, form: Form, task: BlockTask, fit: PlainSteps, rows: BlockRows
) -> None:
    """Of the steps' ends; those of lanes that are left mean nothing."""
    rest = fit.cost[0] - fit.gain[0]
    root = code.function("sqrt", code.select(rest > 0, rest, 0.0))
    rows.write("states", [fit.end[c] for c in range(UNKNOWNS)])
    rows.write("residuals", [root])
    rows.write("steps", [fit.steps[0]])
    wanted = code.builder.icmp_signed("!=", task.covariances, ir.Constant(LONG, 0))
    with code.builder.if_then(wanted), code.scope():
        rows.write("covariances", covariance_of(fit.factor, form.free))


class LoadedRows(NamedTuple):
    """Numbers of each lane's own row, as `packing.vectors_at` asks a writer for them."""

    numbers: Numbers

    def load(self, pointer: Any, index: int) -> Any:
        return self.numbers[index]


class BlockRows:
    """A block's rows in the arrays of a task."""

    def __init__(self, code: LaneWriter, task: BlockTask, index: Any) -> None:
        self.code, self.task = code, task
        self.pointers = BlockTask(*pointers_to(code.builder, task))
        self.first = code.builder.mul(index, ir.Constant(LONG, code.lanes))

    def vectors(self, form: Form) -> Any:
        """The sensor's vectors; of a varied form, those of each lane."""
        if not form.varied:
            return vectors_of(self.code, self.pointers.packed, form.kind)
        size = row_size(form.kind)
        first = self.code.builder.mul(self.first, ir.Constant(LONG, size))
        here = self.code.builder.gep(self.pointers.packed, [first])
        return vectors_of(LoadedRows(self.code.load_rows(here, size, size)), None, form.kind)

    def read(self, name: str, width: int, own: Any) -> Numbers:
        """Rows of `width` numbers.  own: 1 where each lane has its own, 0 where all have one."""
        return self.code.load_rows(*self._place(name, width, own), width)

    def write(self, name: str, numbers: Numbers) -> None:
        self.code.store_rows(numbers, *self._place(name, len(numbers), self.task.own_rows))

    def _place(self, name: str, width: int, own: Any) -> tuple[Any, Any]:
        """Where the rows begin, and how far they are apart."""
        build = self.code.builder
        apart = build.mul(own, ir.Constant(LONG, width))
        first = build.mul(self.first, apart)
        return build.gep(getattr(self.pointers, name), [first]), apart

    def write_bits(self, name: str, index: Any, condition: Condition) -> None:
        flags = self.code.builder.bitcast(getattr(self.pointers, name), ir.PointerType(LONG))
        self.code.builder.store(self.code.bits(condition), self.code.builder.gep(flags, [index]))


class BlockReadings:
    """What a block is asked: its readings, and what is known of their errors and beside them.

    Lanes whose readings lack light, or are out of range, are left.
    """

    def __init__(self, code: LaneWriter, rows: BlockRows) -> None:
        task = rows.task
        scales = vectors_at(code, rows.pointers.scales, SCALES)
        self.values = rows.read("values", 9, task.own_rows)
        self.means = rows.read("means", 3, task.own_means)
        self.rounding, self.prior_weights = scales.rounding, scales.weight
        least, self.darkness = scales.light
        for k in range(3):
            psi, zeta, light = self.values[3 * k : 3 * k + 3]
            seen = (light > least[k]) & (light < inf)
            for at, half in zip((psi, zeta), scales.half_sizes[k], strict=True):
                seen = seen & ~(abs(at) > half) & (abs(at) < inf)
            code.leave(~seen)
        self.weights = self._weights(code, rows, scales.noise)

    def _weights(self, code: LaneWriter, rows: BlockRows, noise: Sequence[Value]) -> Numbers:
        """The readings' own, or those of the sensor's noise."""
        place, power = 1 / (noise[0] * noise[1]), 1 / noise[2]
        usual: Numbers = []
        for light in self.values[2::3]:
            usual += [light * place, light * place, power]
        own = rows.read("weights", 9, rows.task.own_rows)
        with_own = code.builder.icmp_signed("!=", rows.task.weighed, ir.Constant(LONG, 0))
        return [
            Value(code, code.builder.select(with_own, a.ir, b.ir))
            for a, b in zip(own, usual, strict=True)
        ]

    def smallest(self) -> Value:
        """The sum of squares that rounding of the readings alone can make."""
        total: Any = NEGLIGIBLE_GAIN
        for k in range(3):
            place = self.rounding[0] * self.weights[3 * k]
            power = self.rounding[1] * self.weights[3 * k + 2]
            total = total + 2 * (place * place) + power * power
        return total  # type: ignore[no-any-return]


class Equations:
    """Normal equations at a state and a power, and the sum of squares there.

    Lanes where a detector would be dark are left.
    """

    def __init__(
        self, code: LaneWriter, vectors: Any, x: Numbers, question: BlockReadings, form: Form
    ) -> None:
        columns, residuals = weigh_equations(code, vectors, x, question, form)
        self.matrix, self.right = straight.normal_equations(columns, residuals)
        self.cost: Any = 0.0
        for residual in residuals:
            self.cost = self.cost + residual * residual
        for j, c in enumerate(form.free):
            if c >= 6:
                weight = question.prior_weights[c - 6]
                residual = weight * (question.means[c - 6] - x[c])
                self.matrix[j][j] = self.matrix[j][j] + weight * weight
                self.right[j] = self.right[j] + weight * residual
                self.cost = self.cost + residual * residual


def weigh_equations(
    code: LaneWriter, vectors: Any, x: Numbers, question: BlockReadings, form: Form
) -> tuple[list[Numbers], Numbers]:
    """The Jacobian's columns of the free unknowns and the residuals, in standard deviations."""
    rows: list[Numbers] = []
    residuals: Numbers = []
    found = linearise(code, replace_power(vectors, x[8]), x, form)
    for (values, derivatives), darkness in zip(found, question.darkness, strict=True):
        code.leave(~(values[2] > darkness))
        for value, row in zip(values, derivatives, strict=True):
            n = len(rows)
            weight = question.weights[n]
            rows.append([weight * each for each in row])
            residuals.append(weight * (question.values[n] - value))
    return [list(column) for column in zip(*rows, strict=True)], residuals


def linearise(
    code: LaneWriter, vectors: Any, x: Numbers, form: Form
) -> list[tuple[Sequence[Any], list[Numbers]]]:
    """Readings, and their derivatives by the free unknowns, for detectors A, B and C.

    The beam's place takes the mirror along, as in `gauss_newton`.
    """
    state, places = tuple(x[:8]), [c for c in form.free if c < 8]
    text: Any
    if form.kind == "plain":
        text = gradient.linearise(vectors, state)
    elif form.exact:
        text = linearise_exactly(code, vectors, state, len(places))
    else:
        text = bench_gradient.linearise_nearly(vectors, state)
    found = []
    for k, (values, derivatives) in enumerate(text):
        rows = [[row[c] + row[c - 6] if c > 5 else row[c] for c in places] for row in derivatives]
        if 8 in form.free:
            for i, row in enumerate(rows):
                row.append(power_derivative(vectors, values, k, i))
        found.append((values, rows))
    return found


class PlainSteps:
    """What the rounds of an estimate hand on, for each lane; the steps are not damped.

    A lane whose sum of squares rises is left.  at: the state and the power of the next round.  end:
    where the last step leads.  cost, gain: the sum of squares, and what the last step lessens it
    by.  small: such a gain is none.  going: which lanes have not arrived.
    """

    def __init__(self, code: LaneWriter, form: Form, task: BlockTask) -> None:
        size = len(form.free)
        self.code, self.form, self.task = code, form, task
        self.at, self.end = LaneMemory(code, UNKNOWNS), LaneMemory(code, UNKNOWNS)
        self.cost, self.gain, self.small = (LaneMemory(code, 1) for _ in range(3))
        self.steps, self.factor = LaneMemory(code, 1), LaneMemory(code, size * (size + 1) // 2)
        self.going, self.stalled = (LaneFlag(code, code.same(False)) for _ in range(2))
        self.most_steps = code.spread(code.builder.sitofp(task.most_steps, DOUBLE))

    def begin(self, start: Numbers, question: BlockReadings) -> None:
        for c, number in enumerate(start):
            self.at[c] = number
        self.cost[0], self.small[0], self.steps[0] = inf, question.smallest(), 0.0
        self.going.set(~self.code.left)
        self.stalled.set(self.code.same(False))

    def write_round(self, vectors: Any, question: BlockReadings) -> None:
        """Another step of the lanes that are going; of the others, the last one again."""
        code = self.code
        going, left = self.going.get(), code.left
        self.steps[0] = self.steps[0] + code.select(going, 1.0, 0.0)
        at = [self.at[c] for c in range(UNKNOWNS)]
        equations = Equations(code, vectors, at, question, self.form)
        self.write_step(at, equations, going)
        code.left = left | (code.left & going)
        self.going.set(self.going.get() & ~code.left)

    def is_better(self, equations: Equations) -> Condition:
        """A step that changes no more than rounding can is no worse."""
        before, small = self.cost[0], self.small[0]
        slack = small + 2 * self.code.function("sqrt", before * small)
        return equations.cost < before + slack  # type: ignore[no-any-return]

    def write_step(self, at: Numbers, equations: Equations, going: Condition) -> None:
        self.code.leave(~self.is_better(equations))
        self.cost[0] = equations.cost
        end, arrived = self.solve(at, equations.matrix, equations.right)
        self.go_on(going & ~arrived, end)

    def solve(
        self, at: Numbers, matrix: list[Numbers], right: Numbers
    ) -> tuple[Numbers, Condition]:
        """Where the step from a state leads, and whether it is the last; lanes whose equations have
        lost too many digits are left."""
        factor, sure = straight.cholesky(self.code, matrix)
        self.code.leave(~sure)
        step, gain = straight.solution(factor, right)
        end = list(at)
        for j, c in enumerate(self.form.free):
            end[c] = end[c] + step[j]
            if c in (6, 7):
                end[c - 6] = end[c - 6] + step[j]
        for c in range(UNKNOWNS):
            self.end[c] = end[c]
        self.gain[0] = gain
        for n, number in enumerate(each for row in factor for each in row):
            self.factor[n] = number
        return end, gain < self.small[0]

    def go_on(self, going: Condition, to: Numbers) -> None:
        self.going.set(going)
        for c in range(UNKNOWNS):
            self.at[c] = self.code.select(going, to[c], self.at[c])


class DampedSteps(PlainSteps):
    """The same with steps that are damped where they do not help, as `gauss_newton.estimate` does.

    Unless the task is `patient`, a lane whose sum of squares rises is left.  here: the best state
    so far.  matrix, right: its normal equations.  earlier: the sum of squares `since` steps ago.
    """

    def __init__(self, code: LaneWriter, form: Form, task: BlockTask) -> None:
        super().__init__(code, form, task)
        size = len(form.free)
        self.here, self.right = LaneMemory(code, UNKNOWNS), LaneMemory(code, size)
        self.matrix = LaneMemory(code, size * (size + 1) // 2)
        self.damping, self.earlier, self.since = (LaneMemory(code, 1) for _ in range(3))

    def begin(self, start: Numbers, question: BlockReadings) -> None:
        super().begin(start, question)
        self.damping[0], self.earlier[0], self.since[0] = 0.0, inf, 0.0

    def write_step(self, at: Numbers, equations: Equations, going: Condition) -> None:
        code = self.code
        better = self.is_better(equations)
        hasty = code.builder.icmp_signed("==", self.task.patient, ir.Constant(LONG, 0))
        code.leave(~better & (code.same(hasty) | ~(self.cost[0] < inf)))
        here, matrix, right = self.keep(going & better, at, equations)
        stalled = going & (self.damp(going, better) | self.is_slow())
        self.stalled.set(self.stalled.get() | stalled)
        damping = self.damping[0]
        for j, row in enumerate(matrix):
            matrix[j] = [*row[:-1], row[-1] * (1 + damping)]
        end, arrived = self.solve(here, matrix, right)
        held = damping > 0  # back by the damping, not arrived
        release = arrived & held
        self.damping[0] = code.select(release & going, 0.0, damping)
        to = [code.select(release, a, b) for a, b in zip(here, end, strict=True)]
        self.go_on(going & ~(arrived & ~held) & ~stalled, to)

    def keep(
        self, accepted: Condition, at: Numbers, equations: Equations
    ) -> tuple[Numbers, list[Numbers], Numbers]:
        """The state from where to step, and its equations: those of this round, or the kept."""

        def choose(memory: LaneMemory, numbers: Numbers) -> Numbers:
            for n, number in enumerate(numbers):
                memory[n] = self.code.select(accepted, number, memory[n])
            return [memory[n] for n in range(len(numbers))]

        self.cost[0] = self.code.select(accepted, equations.cost, self.cost[0])
        self.earlier[0] = self.code.select(self.earlier[0] < inf, self.earlier[0], self.cost[0])
        entries = iter(choose(self.matrix, [each for row in equations.matrix for each in row]))
        matrix = [[next(entries) for _ in row] for row in equations.matrix]
        return choose(self.here, at), matrix, choose(self.right, equations.right)

    def damp(self, going: Condition, better: Condition) -> Condition:
        """Less where a step has helped, more where it has not; returns where no more can be."""
        select, damping = self.code.select, self.damping[0]
        less = select(damping > MIN_DAMPING, damping / DAMPING_FACTOR, 0.0)
        more = select(damping > 0, damping * DAMPING_FACTOR, FIRST_DAMPING)
        self.damping[0] = select(going, select(better, less, more), damping)
        return ~better & (damping > MAX_DAMPING)

    def is_slow(self) -> Condition:
        """After each PROGRESS_INTERVAL_STEPS steps: where the sum of squares has hardly fallen."""
        select, since = self.code.select, self.since[0] + 1
        due = since > PROGRESS_INTERVAL_STEPS - 0.5
        slow = due & (self.cost[0] > MAX_COST_SHARE * self.earlier[0])
        self.since[0] = select(due, 0.0, since)
        self.earlier[0] = select(due, self.cost[0], self.earlier[0])
        return slow  # type: ignore[no-any-return]


def covariance_of(factor: LaneMemory, free: Sequence[int]) -> Numbers:
    """That of the free unknowns at its places in that of the state, (8, 8), row by row."""
    size = len(free)
    numbers = iter([factor[n] for n in range(size * (size + 1) // 2)])
    triangle = [[next(numbers) for _ in range(i + 1)] for i in range(size)]
    steps = straight.inverse(triangle)
    covariance: list[Numbers] = [[0.0] * 8 for _ in range(8)]
    for i, a in enumerate(free):
        for j, b in enumerate(free):
            if max(a, b) < 8:
                covariance[a][b] = steps[i][j]
    take_along(covariance, [c for c in (6, 7) if c in free])
    return [each for row in covariance for each in row]


def take_along(covariance: list[Numbers], places: Sequence[int]) -> None:
    """The mirror's place is that in the beam and the beam's, added."""
    for c in places:
        for b in range(8):
            covariance[c - 6][b] = covariance[c - 6][b] + covariance[c][b]
        for a in range(8):
            covariance[a][c - 6] = covariance[a][c - 6] + covariance[a][c]
