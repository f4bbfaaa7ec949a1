"""A layout problem: variables, named constraints, and an objective to minimise.

The largest of the limited quantities over the volume is pushed down by a slack variable (minimax).
The requirements on a layout are named constraints, so that the search can report which of them
limit the best layout, or which cannot be met.

All of it is the float model on arrays, of many layouts at once (`formula`). A constraint is one
output at one state; the search only holds those that matter (`search`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.extras import require_extra
from ..core.names import POSE
from ..core.sensor import Sensor
from ..core.units import Floats
from ..optics.forward import build_geometry, dark_scene
from .formula import Differences, Formula
from .requirement import Constraint, limits_of
from .spots import ellipse_clearances, rim_clearances
from .variables import (
    GAIN,
    Outcome,
    columns_of_states,
    gain_of,
    heads_of,
    layout_parameters,
    outcome_of,
    require_variables,
)
from .volume import mirror_states, span_of, states_of, worst_places

if TYPE_CHECKING:
    from ..core.layout import Layout


#: Starting values of an aim's slack and of the volume's scale, for aims that need one.
GUESS = {"resolution": 100.0, "condition": 10.0, "size": 100.0, "range": 0.3}
Integers = NDArray[np.int64]
#: Largest violation of a constraint between the problem's states.
BROKEN = 1e-8


@dataclass(frozen=True)
class Rows:
    """Constraints, one a row: the number of the output, of the state and of the group, the unknown
    that is added (-1 for none), and the least value (None for zero)."""

    state: Integers
    output: Integers
    group: Integers
    slack: Integers
    spare: Floats | None = None

    def __len__(self) -> int:
        return len(self.state)

    def subset(self, which: Any) -> Rows:
        """Return some of the rows."""
        some: list[Any] = [None if each is None else each[which] for each in vars(self).values()]
        return Rows(*some)

    def join(self, more: Rows) -> Rows:
        """Return these rows followed by others; both have a spare or neither has."""
        pairs = zip(vars(self).values(), vars(more).values(), strict=True)
        every: list[Any] = [None if a is None else np.concatenate([a, b]) for a, b in pairs]
        return Rows(*every)


class UnknownBounds(NamedTuple):
    """The least and the largest value of each unknown of a search."""

    low: Floats
    high: Floats


class QuadraticModel(NamedTuple):
    """Values (r,) at a place, their slopes (r, unknowns), and the Hessian (unknowns, unknowns) of
    their sum with weights (r,)."""

    values: Floats
    slopes: Floats
    curvature: Callable[[Floats], Floats]


@dataclass(frozen=True)
class LayoutProblem:
    """A layout problem, made by `problem_of`.

    names: names of the variables.  low, high: their bounds, in the units of their names.
    extras: the aims that have an unknown of their own, a slack or the scale of the volume. The
    unknowns are the variables as shares of their bounds, then these.
    formula: outputs by some of the unknowns, those at `places`, and a state.  states (m, ...).
    groups: names of the constraints.  rows: all constraints.  averaged: outputs whose mean over the
    states is an aim.  aims: the weight of each aim; `weighted` if they are added up.
    constant: the term of the parts' price in the objective.
    half: unit of length of the clearances, mm.
    span: (8, ...) turns shares of the volume into a state; None if nothing is required over a
    volume.
    inside: outputs that are required all over the volume.  stated: number of the stated states,
    over which `averaged` is the mean; `add_worst_places` added the others.
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
    averaged: Integers
    aims: dict[str, float]
    weighted: bool
    constant: float = 0.0
    half: float = 1.0
    span: Floats | None = None
    inside: Integers = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    stated: int = 0

    @property
    def count(self) -> int:
        """The number of unknowns."""
        return len(self.names) + len(self.extras)

    def replace_spare(self, spare: Floats | None) -> LayoutProblem:
        """Return the problem with other least values (rows,) of its constraints."""
        return replace(self, rows=replace(self.rows, spare=spare))

    def first_guess(self, start: Floats) -> Floats:
        """Return the unknowns at a start: slacks just above their least values, a small scale."""
        shares = (start - self.low) / (self.high - self.low)
        return self.fill_slacks(np.append(shares, [GUESS[aim] for aim in self.extras]))

    def fill_slacks(self, unknowns: Floats, spare: float = 1.1) -> Floats:
        """Return the unknowns with slacks that are `spare` times their least values."""
        filled = unknowns.copy()
        values = self.values(unknowns)
        for n, aim in enumerate(self.extras):
            mine = self.rows.slack == len(self.names) + n
            if mine.any():
                short = unknowns[len(self.names) + n] - values[mine].min()
                known = np.isfinite(short)
                filled[len(self.names) + n] = (
                    max(short, 0.0) * spare if known else GUESS.get(aim, 1.0)
                )
        return filled

    def values_at(self, unknowns: Floats) -> Floats:
        """Return the variables, in the units of their names."""
        return self.low + (self.high - self.low) * unknowns[: len(self.names)]

    def bounds(self) -> UnknownBounds:
        low, high = np.zeros(self.count), np.ones(self.count)
        high[len(self.names) :] = np.inf
        return UnknownBounds(low, high)

    def values(self, unknowns: Floats) -> Floats:
        """Return the values of all constraints, which are met if not negative."""
        outputs = self.formula.outputs(unknowns[None, self.places], self.states)[
            0, self.rows.state, self.rows.output
        ]
        values: Floats = outputs + np.where(self.rows.slack >= 0, unknowns[self.rows.slack], 0.0)
        return values if self.rows.spare is None else values - self.rows.spare

    def add_worst_places(self, unknowns: Floats) -> LayoutProblem:
        """Add the places between the states at which the layout violates a constraint by more than
        at the states. Returns the problem itself if there are none."""
        span = self.span
        if span is None or not span.any():
            return self
        first = np.array([int(np.argmax(self.rows.output == output)) for output in self.inside])
        slack = self.rows.slack[first]
        most = self.most_spare()
        eased = np.where(slack >= 0, unknowns[slack], 0.0) - most
        shares = self.states @ np.linalg.pinv(span)
        within = np.isclose(shares @ span, self.states).all(axis=1)

        def values(some: Floats) -> Floats:
            outputs = self.formula.outputs(unknowns[None, self.places], some @ span)[0]
            margins: Floats = outputs[:, self.inside] + eased
            return margins

        places, which = worst_places(values, shares[within], np.asarray(span.any(axis=1)))
        if not len(which):
            return self
        spare = self.spare_near(places, shares, self.inside[which])
        remaining = values(places)[np.arange(len(places)), which] + most[which] - spare
        broken = remaining < -BROKEN
        if not broken.any():
            return self
        rows = self.rows.subset(first[which[broken]])
        states = np.arange(len(self.states), len(self.states) + len(rows))
        more = replace(rows, state=states, spare=None if rows.spare is None else spare[broken])
        return replace(
            self,
            states=np.concatenate([self.states, places[broken] @ span]),
            rows=self.rows.join(more),
        )

    def most_spare(self) -> Floats:
        """The largest spare of each output that is required over the volume."""
        if self.rows.spare is None:
            return np.zeros(len(self.inside))
        spare = self.rows.spare
        return np.array([spare[self.rows.output == output].max() for output in self.inside])

    def spare_near(self, places: Floats, shares: Floats, outputs: Integers) -> Floats:
        """Return an output's spare at each place: the spare of the nearest state."""
        if self.rows.spare is None:
            return np.zeros(len(places))
        spares = np.empty(len(places))
        for n, (place, output) in enumerate(zip(places, outputs, strict=True)):
            mine = np.flatnonzero(self.rows.output == output)
            away = ((shares[self.rows.state[mine]] - place) ** 2).sum(axis=1)
            spares[n] = self.rows.spare[mine[away.argmin()]]
        return spares

    def expand(self, unknowns: Floats, rows: Rows) -> QuadraticModel:
        """Return values, slopes and curvatures of some rows."""
        which, place = np.unique(rows.state, return_inverse=True)
        around = self.formula.expand(unknowns[self.places], self.states[which])
        some = Differences(around.steps, around.values[:, place, rows.output])
        model = self.quadratic_model(some)
        bound = rows.slack >= 0
        values = model.values + np.where(bound, unknowns[rows.slack], 0.0)
        if rows.spare is not None:
            values -= rows.spare
        model.slopes[np.flatnonzero(bound), rows.slack[bound]] = 1.0
        return model._replace(values=values)

    def quadratic_model(self, differences: Differences) -> QuadraticModel:
        """Expand the formula's differences by all of the unknowns."""
        slopes = np.zeros((differences.values.shape[1], self.count))
        slopes[:, self.places] = differences.slopes()

        def curvature(weights: Floats) -> Floats:
            hessian = np.zeros((self.count, self.count))
            of_sum = Differences(differences.steps, differences.values @ weights)
            hessian[np.ix_(self.places, self.places)] = of_sum.hessian()
            return hessian

        return QuadraticModel(differences.values[0], slopes, curvature)

    def objective(self, unknowns: Floats) -> float:
        return float(self.expand_objective(unknowns).values[0])

    def expand_objective(self, unknowns: Floats) -> QuadraticModel:
        """Return the objective with its slopes and curvatures."""
        value, slopes = self.constant, np.zeros(self.count)
        hessian = np.zeros((self.count, self.count))
        for aim, weight in self.aims.items():
            cost, slope, curvature = self.cost(aim, unknowns)
            if self.weighted and aim in ("resolution", "mean-resolution"):
                # the sum is over uncertainties, not variances
                cost = np.sqrt(max(cost, 1e-300))
                slope = slope / (2 * cost)
                curvature = (curvature / 2 - np.outer(slope, slope)) / cost
            value += weight * cost
            slopes += weight * slope
            hessian += weight * curvature
        return QuadraticModel(np.array([value]), slopes[None], lambda weights: weights[0] * hessian)

    def cost(self, aim: str, unknowns: Floats) -> tuple[float, Floats, Floats]:
        """Return the value of one aim, its slopes and its Hessian."""
        if aim == "mean-resolution":
            around = self.formula.expand(unknowns[self.places], self.states[: self.stated])
            means = around.values[:, :, self.averaged].mean(axis=(1, 2))
            model = self.quadratic_model(Differences(around.steps, means[:, None]))
            return float(model.values[0]), model.slopes[0], model.curvature(np.ones(1))
        place = len(self.names) + self.extras.index(aim)
        sign = -1.0 if aim.startswith("range") else 1.0
        slope = np.zeros(self.count)
        slope[place] = sign
        return sign * float(unknowns[place]), slope, np.zeros((self.count, self.count))


@dataclass(frozen=True)
class RestrictedProblem:
    """A problem with some of its constraints, in IPOPT's form.

    elastic: whether each group may be violated by an unknown of its own, and the sum of these
    unknowns is minimised instead.
    """

    problem: LayoutProblem
    rows: Rows
    elastic: bool = False

    @property
    def unknowns(self) -> int:
        return self.problem.count + self.elastic * len(self.problem.groups)

    @property
    def constraints(self) -> int:
        return len(self.rows)

    def objective(self, x: Floats) -> QuadraticModel:
        n, size = self.problem.count, len(x)
        if not self.elastic:
            return self.problem.expand_objective(x)
        slopes = np.append(np.zeros(n), np.ones(size - n))
        return QuadraticModel(x[n:].sum()[None], slopes[None], lambda _: np.zeros((size, size)))

    def limits(self, x: Floats) -> QuadraticModel:
        n, more = self.problem.count, len(x) - self.problem.count
        model = self.problem.expand(x[:n], self.rows)
        if not self.elastic:
            return model
        by_group = np.arange(more) == self.rows.group[:, None]
        return QuadraticModel(
            model.values + x[n:][self.rows.group],
            np.hstack([model.slopes, by_group]),
            lambda weights: np.pad(model.curvature(weights), (0, more)),
        )

    def values(self, x: Floats) -> Floats:
        """Return the values of all constraints of the problem."""
        values = self.problem.values(x[: self.problem.count])
        return values + x[self.problem.count :][self.problem.rows.group] if self.elastic else values


@dataclass
class StartResult:
    """The result of one start.

    x: the variables, in the units of their names.  objective: see `report.objective_text`.
    active_constraints: the multiplier of each active group, over the largest.
    shortfalls: the share of its limit by which each group is violated, if the requirements are
    infeasible.
    """

    start: Floats
    x: Floats
    objective: float
    found: bool
    status: str
    seconds: float
    active_constraints: dict[str, float] = field(default_factory=dict)
    shortfalls: dict[str, float] = field(default_factory=dict)


#: Largest number of choices of a catalogue that is tried in full.
TRIED = 24


def refuse_unknown_effects(sensor: Sensor, layout: Layout, command: str = "optimize") -> None:
    """Raise `InputError` if the sensor has an effect that the problem would leave out."""
    opening = sensor.apertures
    unknown = {
        "beam_ratio": np.isfinite(opening.beam),
        "tip_um": opening.tip > 0,
        "gap_um": opening.gap > 0,
    }
    for key, given in unknown.items():
        if given:
            raise InputError(
                f"facets {command} does not support sensor.apertures.{key}, because its model is "
                "of light that only the facets' edges part; leave it out to find a layout, then "
                "see what it changes by facets resolution (rim_mm and detectors are supported: "
                "spots and the light on the mirror are kept whole)"
            )
    if sensor.light.on:
        raise InputError(
            f"facets {command} does not support sensor.light, because its model is that of ideal "
            "light; leave it out to find a layout, then see what it changes by facets resolution"
        )
    if sensor.calibration is not None:
        raise InputError(
            "sensor.calibration belongs to a rig that stands, not to a layout to be found; "
            "leave it out"
        )
    require_variables(layout)
    require_noise(sensor, layout, command)


def require_unit(layout: Layout) -> None:
    """Raise `InputError` if uncertainties are to be minimised and no axis has a unit."""
    if (
        layout.aims.keys() & {"resolution", "mean-resolution"}
        and not np.isfinite(layout.unit).any()
    ):
        raise InputError("optimize.unit names no axis, so that there is no uncertainty to minimise")


def require_noise(sensor: Sensor, layout: Layout, command: str) -> None:
    """Raise `InputError` if the noise of the electronics does not go with the requirements."""
    if sensor.electronics is None:
        if GAIN in layout.variables:
            raise InputError(
                f"optimize.variables.{GAIN}: needs sensor.noise.model: electronics, from which the "
                "noise follows"
            )
        return
    if sensor.electronics.kind == "tetra-lateral":
        raise InputError(
            f"facets {command} knows the noise of duo-lateral and pincushion detectors; that of a "
            "tetra-lateral is a series, too slow for a search: search with "
            "`noise.model: simple`, then see by facets resolution what the electronics change"
        )
    if GAIN in layout.variables and command != "optimize":
        raise InputError(
            f"facets {command} cannot vary {GAIN}: the least light of a range follows from it; "
            "leave it out of optimize.variables"
        )
    stated = [name for name, part in layout.psds.items() if part.position is not None]
    if layout.amplifiers or stated:
        raise InputError(
            "optimize.parts: amplifiers and position_um of detectors state the noise of "
            "`noise.model: simple`, and here it follows from sensor.electronics; leave them out, "
            "or take the simple model"
        )
    if len(layout.psds) * max(1, len(layout.lasers)) > TRIED:
        raise InputError(
            f"optimize.parts has more than {TRIED} choices: by electronics a larger detector is "
            "noisier, so that none is as good as any of several, which leaving choices out rests "
            "on; name fewer parts, or take `noise.model: simple`"
        )


def problem_of(sensor: Sensor, layout: Layout, constant: float = 0.0) -> LayoutProblem:
    """Make the problem of a configuration's block `optimize`; raises `InputError`.

    constant: the term of the parts' price in the objective.
    """
    require_extra("casadi", "the search for a layout")
    refuse_unknown_effects(sensor, layout)
    require_unit(layout)
    names = list(layout.variables)
    low, high = np.array([layout.variables[name] for name in names]).T
    extras = [aim for aim in GUESS if aim in layout.aims]

    def outputs(unknowns: Floats, states: Floats) -> tuple[list[Constraint], list[Any]]:
        x = list((low + (high - low) * unknowns[:, : len(names)]).T[:, :, None])
        scale = unknowns[:, len(names), None, None] if "range" in extras else 1.0
        parameters, sizes = layout_parameters(sensor, names, x)
        fixed = build_geometry(tuple(parameters))
        state = columns_of_states(mirror_states(states * scale, layout.object, layout.following))
        outcome = outcome_of(sensor, fixed, sizes, state, gain_of(sensor, names, x), layout.object)
        at, rim = dark_scene(fixed, state), sensor.apertures.rim
        half = half_of(sizes)
        spots = [each / half for each in ellipse_clearances(fixed, at, sizes)]
        rims = rim_clearances(fixed, at, rim) if np.isfinite(rim) else []
        heads = heads_of(parameters)
        constraints = [
            *limits_of(layout, outcome.powers, spots, np.sqrt(outcome.variances), rims),
            *headrooms(outcome),
            *head_limits(layout, heads),
            *objective_constraints(layout, outcome, heads),
        ]
        means = variances_over_units(layout, outcome) if "mean-resolution" in layout.aims else {}
        return constraints, list(means.values())

    def compute(unknowns: Floats, states: Floats) -> list[Any]:
        constraints, means = outputs(unknowns, states)
        return [*(each.value for each in constraints), *means]

    places = formula_places(names, extras)
    constraints, means = outputs(np.full((1, len(places)), 0.5), np.zeros((1, 8)))
    states = np.array(states_of(layout, 1.0), dtype=float)
    groups = list(dict.fromkeys(each.group for each in constraints))
    origin = np.pad(origin_of(low, high), (0, len(places) - len(names)), constant_values=np.nan)
    sizes = layout_parameters(sensor, names, low.tolist())[1] if "size_mm" not in names else []
    return LayoutProblem(
        sensor, names, low, high, extras, Formula(compute, origin), places, states, groups,
        rows_of(constraints, groups, extras, len(names), len(states)),
        np.arange(len(constraints), len(constraints) + len(means)),
        {aim: weight for aim, weight in layout.aims.items() if aim != "price"},
        layout.aim == "weighted", constant, half_of(sizes),
        span_of(layout), outputs_at(constraints, len(states) - 1), len(states),
    )  # fmt: skip


def origin_of(low: Floats, high: Floats) -> Floats:
    """The shares of their bounds at which positive variables are zero; NaN for the others."""
    origin: Floats = np.where(low > 0, -low / (high - low), np.nan)
    return origin


def outputs_at(constraints: list[Constraint], state: int) -> Integers:
    """List the outputs that are constrained at a state."""
    return np.array([
        output for output, each in enumerate(constraints)
        if each.states is None or state in each.states
    ], dtype=np.int64)  # fmt: skip


def formula_places(names: list[str], extras: list[str]) -> Integers:
    """Return the places of the variables and of the volume's scale among the unknowns."""
    scale = [len(names) + n for n, aim in enumerate(extras) if aim == "range"]
    return np.array([*range(len(names)), *scale])


def rows_of(
    constraints: list[Constraint], groups: list[str], extras: list[str], variables: int, states: int
) -> Rows:
    """Make a row for each output and state; an output that is the same at all states has one
    row."""
    rows = [
        (state, output, groups.index(each.group),
         variables + extras.index(each.slack) if each.slack else -1)
        for output, each in enumerate(constraints)
        for state in (range(states) if each.states is None else each.states)
    ]  # fmt: skip
    return Rows(*np.array(rows, dtype=np.int64).T)


def head_limits(layout: Layout, heads: list[Any]) -> list[Constraint]:
    """Limit the head's size, for detectors whose radius varies or is too large. A head of constant
    size cannot limit the search."""
    if np.isinf(layout.head):
        return []
    wide = [head for head in heads if not isinstance(head, float) or head > layout.head]
    return [Constraint("size of the head", 1 - head / layout.head, states=(0,)) for head in wide]


def headrooms(outcome: Outcome) -> list[Constraint]:
    """Constrain the amplifiers' headrooms, if the noise follows from electronics."""
    return [
        Constraint(f"full scale of PSD {'ABC'[n // 4]}'s amplifiers", each)
        for n, each in enumerate(outcome.headrooms)
    ]


def half_of(sizes: list[Any]) -> float:
    """The unit of length of the clearances, mm: half of a detector whose size is given."""
    return float(np.mean([size for size in sizes if isinstance(size, float)] or [1.0])) / 2


def objective_constraints(layout: Layout, outcome: Outcome, heads: list[Any]) -> list[Constraint]:
    """Constrain the quantities that must stay below the slack of each aim."""
    below = []
    if "resolution" in layout.aims:
        for i, part in variances_over_units(layout, outcome).items():
            what = f"uncertainty of {POSE[i]} as low as it can be"
            below.append(Constraint(what, -part, "resolution"))
    if "size" in layout.aims:
        what = "size of the head as low as it can be"
        below += [Constraint(what, -head / 100, "size", states=(0,)) for head in heads]
    if "condition" in layout.aims:
        decades = np.log10(outcome.condition) / 2
        below.append(Constraint("conditioning as good as it can be", -decades, "condition"))
    return below


def variances_over_units(layout: Layout, outcome: Outcome) -> dict[int, Any]:
    """The variances over the squares of the axes' units, by the axis of the pose."""
    axes = [i for i in range(6) if np.isfinite(layout.unit[i])]
    return {i: outcome.variances[i] / layout.unit[i] ** 2 for i in axes}
