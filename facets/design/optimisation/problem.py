"""A layout problem: unknowns, named constraints, and an objective to minimise.

A slack variable bounds the largest value of a quantity over the volume, and the search minimises it
(minimax). The requirements on a layout are named constraints, so that the search can report which
of them limit the best layout, or which cannot be met. A constraint is one output of the formula at
one state; the search passes only the relevant ones to IPOPT (`search`).

Unknowns are arrays (p,): the variables as fractions of their bounds, then the extras; constraints
are rows (r,).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ...core.sensor import Sensor
from ...core.units import Floats, Integers
from ..volume import worst_places

#: Starting values of the aims' slacks, and of the volume's scale for `range`.
GUESS = {"resolution": 100.0, "condition": 10.0, "size": 100.0, "range": 0.3}
#: Violation of a constraint between the states above which the state is added.
BROKEN = 1e-8
#: Step of a difference, as a fraction of the distance between a variable's bounds, or of a positive
#: variable's value if that is less. The errors of rounding and of truncation are then equally
#: large, about 1e-8 of an output.
STEP = 1e-4


@dataclass(frozen=True)
class Differences:
    """Values at a point and at its neighbours, for derivatives by differences.

    steps: (n,) of the unknowns.  values: (1 + 2 n + n (n - 1) / 2, ...) at `neighbours_of`.
    """

    steps: Floats
    values: Floats

    @staticmethod
    def neighbours_of(x: Floats, steps: Floats) -> Floats:
        """The point x (n,), the points one step forward and one step backward in each unknown, and
        one step forward in each pair of unknowns."""
        moves = np.diag(steps)
        first, second = np.triu_indices(len(x), 1)
        return np.concatenate([x[None], x + moves, x - moves, x + moves[first] + moves[second]])

    def slopes(self) -> Floats:
        """Return the first derivatives, (..., n)."""
        n = len(self.steps)
        rise = np.moveaxis(self.values[1 : n + 1] - self.values[n + 1 : 2 * n + 1], 0, -1)
        slopes: Floats = rise / (2 * self.steps)
        return slopes

    def hessian(self) -> Floats:
        """Return the second derivatives (n, n) of values that are single numbers."""
        n, middle = len(self.steps), self.values[0]
        ahead, behind, both = np.split(self.values[1:], [n, 2 * n])
        change = np.diag(ahead + behind - 2 * middle)
        first, second = np.triu_indices(n, 1)
        change[first, second] = change[second, first] = both - ahead[first] - ahead[second] + middle
        hessian: Floats = change / np.outer(self.steps, self.steps)
        return hessian


@dataclass(frozen=True)
class Formula:
    """Outputs of layouts at states.

    compute: function from unknowns (k, n) and states (m, w) to the outputs, which broadcast to
    (k, m).  origin: (n,) value of each unknown at which its variable is zero; NaN if the variable
    may be negative.
    """

    compute: Callable[[Floats, Floats], list[Any]]
    origin: Floats

    def expand(self, x: Floats, states: Floats) -> Differences:
        """Compute outputs at a layout (n,) and its neighbours at states (m, w): (..., m,
        outputs)."""
        steps = STEP * np.fmin(1.0, np.abs(x - self.origin))
        return Differences(steps, self.outputs(Differences.neighbours_of(x, steps), states))

    def outputs(self, x: Floats, states: Floats) -> Floats:
        """Compute outputs of layouts (k, n) at states (m, w): (k, m, outputs)."""
        parts = self.compute(x, states)
        outputs = np.empty((len(parts), len(x), len(states)))
        for n, part in enumerate(parts):
            outputs[n] = part
        return np.moveaxis(outputs, 0, -1)


@dataclass(frozen=True)
class Rows:
    """Constraints, one per row: numbers of the state, the output and the group, number of the
    unknown that is added (-1 for none), and the least value that is allowed."""

    state: Integers
    output: Integers
    group: Integers
    slack: Integers
    spare: Floats

    def __len__(self) -> int:
        return len(self.state)

    def subset(self, which: Any) -> Rows:
        """Return some of the rows."""
        return Rows(*(each[which] for each in vars(self).values()))

    def join(self, more: Rows) -> Rows:
        """Return these rows followed by others."""
        pairs = zip(vars(self).values(), vars(more).values(), strict=True)
        return Rows(*map(np.concatenate, pairs))


@dataclass(frozen=True)
class Objective:
    """The sum of the weighted aims and of the parts' price term.

    aims: the weight of each aim.  weighted: whether several aims are added up.  averaged: number of
    the formula's first output whose mean over the first `state_count` states is an aim.
    """

    aims: dict[str, float]
    weighted: bool = False
    price: float = 0.0
    averaged: int = 0
    state_count: int = 0


@dataclass(frozen=True)
class LayoutProblem:
    """A layout problem.

    names: names of the variables.  low, high: their bounds, in the units of their names.
    extras: the aims that have an unknown of their own, a slack or the scale of the volume. The
    unknowns are the variables, 0 and 1 at their bounds, followed by these.
    formula: the outputs as a function of the unknowns at `places` and of a state.
    states: (m, ...).
    groups: names of the constraints.  rows: all constraints.
    span: (8, ...) converts a position in the volume to a state; None if nothing is required over a
    volume.
    inside: numbers of the outputs that are required all over the volume.  half: unit of length of
    the clearances, mm.
    """

    sensor: Sensor
    names: list[str]
    low: Floats
    high: Floats
    extras: list[str]
    formula: Formula
    places: Integers
    states: Floats
    groups: list[str]
    rows: Rows
    objective: Objective
    span: Floats | None
    inside: Integers
    half: float = 1.0

    @property
    def count(self) -> int:
        """The number of unknowns."""
        return len(self.names) + len(self.extras)

    def first_guess(self, start: Floats) -> Floats:
        """Return the unknowns (p,) at a start (variables,), with slacks just above their least
        values and a small scale."""
        fractions = (start - self.low) / (self.high - self.low)
        return self.fill_slacks(np.append(fractions, [GUESS[aim] for aim in self.extras]))

    def fill_slacks(self, unknowns: Floats, spare: float = 1.1) -> Floats:
        """Return the unknowns with slacks that are `spare` times their least values."""
        filled = unknowns.copy()
        values = self.values(unknowns)
        for n, aim in enumerate(self.extras):
            rows_of_aim = self.rows.slack == len(self.names) + n
            if rows_of_aim.any():
                short = unknowns[len(self.names) + n] - values[rows_of_aim].min()
                is_finite = np.isfinite(short)
                filled[len(self.names) + n] = (
                    max(short, 0.0) * spare if is_finite else GUESS.get(aim, 1.0)
                )
        return filled

    def values_at(self, unknowns: Floats) -> Floats:
        """Return the variables (variables,), in the units of their names."""
        return self.low + (self.high - self.low) * unknowns[: len(self.names)]

    def bounds(self) -> tuple[Floats, Floats]:
        """The least and the largest value of each unknown, two arrays (unknowns,): 0 and 1 for
        variables, 0 and infinity for extras."""
        low, high = np.zeros(self.count), np.ones(self.count)
        high[len(self.names) :] = np.inf
        return low, high

    def replace_spare(self, spare: Floats) -> LayoutProblem:
        """Return the problem with other least values (rows,) of its constraints."""
        return replace(self, rows=replace(self.rows, spare=spare))

    def values(self, unknowns: Floats) -> Floats:
        """Return the values (r,) of all constraints; negative values are violations."""
        outputs = self.formula.outputs(unknowns[None, self.places], self.states)[
            0, self.rows.state, self.rows.output
        ]
        slacks = np.where(self.rows.slack >= 0, unknowns[self.rows.slack], 0.0)
        values: Floats = outputs + slacks - self.rows.spare
        return values


def add_worst_places(problem: LayoutProblem, unknowns: Floats) -> LayoutProblem:
    """Add the states between the problem's states at which the layout violates a constraint by more
    than at these. Returns the problem itself if there are none."""
    span = problem.span
    if span is None or not span.any():
        return problem
    first = np.array([int(np.argmax(problem.rows.output == output)) for output in problem.inside])
    slack = problem.rows.slack[first]
    most = most_spare(problem)
    slacks_less_spare = np.where(slack >= 0, unknowns[slack], 0.0) - most
    fractions = problem.states @ np.linalg.pinv(span)
    within = np.isclose(fractions @ span, problem.states).all(axis=1)

    def values(points: Floats) -> Floats:
        """The margins (n, outputs) at places (n, d) in the volume."""
        outputs = problem.formula.outputs(unknowns[None, problem.places], points @ span)[0]
        margins: Floats = outputs[:, problem.inside] + slacks_less_spare
        return margins

    places, which = worst_places(values, fractions[within], np.asarray(span.any(axis=1)))
    if not len(which):
        return problem
    spare = spare_near(problem, places, fractions, problem.inside[which])
    remaining = values(places)[np.arange(len(places)), which] + most[which] - spare
    broken = remaining < -BROKEN
    if not broken.any():
        return problem
    rows = problem.rows.subset(first[which[broken]])
    states = np.arange(len(problem.states), len(problem.states) + len(rows))
    more = replace(rows, state=states, spare=spare[broken])
    return replace(
        problem,
        states=np.concatenate([problem.states, places[broken] @ span]),
        rows=problem.rows.join(more),
    )


def most_spare(problem: LayoutProblem) -> Floats:
    """The largest spare (outputs,) of each output that is required over the volume."""
    rows = problem.rows
    return np.array([rows.spare[rows.output == output].max() for output in problem.inside])


def spare_near(
    problem: LayoutProblem, places: Floats, fractions: Floats, outputs: Integers
) -> Floats:
    """Return the spare (n,) of each output at each place: that of the nearest state."""
    spares = np.empty(len(places))
    for n, (place, output) in enumerate(zip(places, outputs, strict=True)):
        rows = np.flatnonzero(problem.rows.output == output)
        distances = ((fractions[problem.rows.state[rows]] - place) ** 2).sum(axis=1)
        spares[n] = problem.rows.spare[rows[distances.argmin()]]
    return spares


@dataclass
class StartResult:
    """The result of the search from one start.

    x: the variables, in the units of their names.  objective: see `tables.objective_text`.  found:
    whether the layout meets all requirements.  active_constraints: the multiplier of each active
    group, over the largest.  shortfalls: if the requirements are infeasible, the fraction of its
    limit by which each group is violated.
    """

    start: Floats
    x: Floats
    objective: float
    found: bool
    status: str
    seconds: float
    active_constraints: dict[str, float] = field(default_factory=dict)
    shortfalls: dict[str, float] = field(default_factory=dict)
