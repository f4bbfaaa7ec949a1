"""A layout problem: variables, constraints with names, and what is made small.

The largest of what is asked for over the volume is pushed down by a slack variable (minimax). What
a layout must keep are constraints with names, so that the search can say in words what holds the
best layout back, or what cannot be met.

All of it is the float model on arrays, of many layouts at once (`formula`). A constraint is one
output at one state; the search holds only those that matter (`search`).
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
)
from .volume import span_of, states_of, worst_places

if TYPE_CHECKING:
    from ..core.layout import Layout


#: What the slack of an aim, or the scale of the volume, starts from; for an aim that needs one.
GUESS = {"resolution": 100.0, "condition": 10.0, "size": 100.0, "range": 0.3}
Integers = NDArray[np.int64]
#: By how much a constraint may be broken between the states that are asked.
BROKEN = 1e-8


@dataclass(frozen=True)
class Rows:
    """Constraints, one a row: which output of the formula at which state, in which group, and which
    unknown is added to it, -1 for none; what it must keep above zero, None for nothing."""

    state: Integers
    output: Integers
    group: Integers
    slack: Integers
    spare: Floats | None = None

    def __len__(self) -> int:
        return len(self.state)

    def subset(self, which: Any) -> Rows:
        """Some of them."""
        some: list[Any] = [None if each is None else each[which] for each in vars(self).values()]
        return Rows(*some)

    def join(self, more: Rows) -> Rows:
        """These and others; both have a spare or neither has."""
        pairs = zip(vars(self).values(), vars(more).values(), strict=True)
        every: list[Any] = [None if a is None else np.concatenate([a, b]) for a, b in pairs]
        return Rows(*every)


class QuadraticModel(NamedTuple):
    """Values (r,) at a place, their slopes (r, unknowns), and the Hessian (unknowns, unknowns) of
    their sum with weights (r,)."""

    values: Floats
    slopes: Floats
    curvature: Callable[[Floats], Floats]


@dataclass(frozen=True)
class LayoutProblem:
    """What is to be found; from `problem_of`.

    names: of the variables.  low, high: their bounds, in the units of their names.
    extras: the aims that have an unknown of their own, a slack or the scale of the volume. The
    unknowns are the variables as shares of their bounds, then these.
    formula: of some of the unknowns, those at `places`, and a state.  states (m, ...).
    groups: names of the constraints.  rows: all of them.  averaged: outputs whose mean over the
    states is an aim.  aims: how much each counts; `weighted` where they are added up.
    constant: what the parts' price adds to the objective.
    half: length over which clearances are told, mm.
    span: (8, ...) a state of the volume is the shares of it times this; None where nothing is asked
    over a volume.  inside: outputs that are asked all over it.  stated: how many of the states are
    as stated, over which `averaged` is; others were added by `with_worst_places`.
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
        """Of the unknowns."""
        return len(self.names) + len(self.extras)

    def first_guess(self, start: Floats) -> Floats:
        """The unknowns at a start: each slack just above what it has to be, the scale small."""
        shares = (start - self.low) / (self.high - self.low)
        return self.fill_slacks(np.append(shares, [GUESS[aim] for aim in self.extras]))

    def fill_slacks(self, unknowns: Floats, spare: float = 1.1) -> Floats:
        """The unknowns with slacks that keep what they are for, `spare` times what they have to."""
        found = unknowns.copy()
        values = self.values(unknowns)
        for n, aim in enumerate(self.extras):
            mine = self.rows.slack == len(self.names) + n
            if mine.any():
                short = unknowns[len(self.names) + n] - values[mine].min()
                known = np.isfinite(short)
                found[len(self.names) + n] = (
                    max(short, 0.0) * spare if known else GUESS.get(aim, 1.0)
                )
        return found

    def values_at(self, unknowns: Floats) -> Floats:
        """The variables, in the units of their names."""
        return self.low + (self.high - self.low) * unknowns[: len(self.names)]

    def bounds(self) -> tuple[Floats, Floats]:
        """Of the unknowns."""
        low, high = np.zeros(self.count), np.ones(self.count)
        high[len(self.names) :] = np.inf
        return low, high

    def values(self, unknowns: Floats) -> Floats:
        """What all constraints are; those that are kept are not below zero."""
        found = self.formula.outputs(unknowns[None, self.places], self.states)[
            0, self.rows.state, self.rows.output
        ]
        values: Floats = found + np.where(self.rows.slack >= 0, unknowns[self.rows.slack], 0.0)
        return values if self.rows.spare is None else values - self.rows.spare

    def add_worst_places(self, unknowns: Floats) -> LayoutProblem:
        """The problem asked at more places of the volume: those between its states at which the
        layout breaks a constraint by more than at these. Itself where there are none."""
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
            found = self.formula.outputs(unknowns[None, self.places], some @ span)[0]
            margins: Floats = found[:, self.inside] + eased
            return margins

        places, which = worst_places(values, shares[within], np.asarray(span.any(axis=1)))
        if not len(which):
            return self
        spare = self.spare_near(places, shares, self.inside[which])
        left = values(places)[np.arange(len(places)), which] + most[which] - spare
        broken = left < -BROKEN
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
        """The most that each output that is asked over the volume must keep above zero."""
        if self.rows.spare is None:
            return np.zeros(len(self.inside))
        spare = self.rows.spare
        return np.array([spare[self.rows.output == output].max() for output in self.inside])

    def spare_near(self, places: Floats, shares: Floats, outputs: Integers) -> Floats:
        """What an output must keep above zero at a place: as at the nearest of the states."""
        if self.rows.spare is None:
            return np.zeros(len(places))
        found = np.empty(len(places))
        for n, (place, output) in enumerate(zip(places, outputs, strict=True)):
            mine = np.flatnonzero(self.rows.output == output)
            away = ((shares[self.rows.state[mine]] - place) ** 2).sum(axis=1)
            found[n] = self.rows.spare[mine[away.argmin()]]
        return found

    def expand(self, unknowns: Floats, rows: Rows) -> QuadraticModel:
        """Some rows, with their slopes and curvatures."""
        which, place = np.unique(rows.state, return_inverse=True)
        around = self.formula.expand(unknowns[self.places], self.states[which])
        some = Differences(around.steps, around.values[:, place, rows.output])
        found = self.quadratic_model(some)
        bound = rows.slack >= 0
        values = found.values + np.where(bound, unknowns[rows.slack], 0.0)
        if rows.spare is not None:
            values -= rows.spare
        found.slopes[np.flatnonzero(bound), rows.slack[bound]] = 1.0
        return found._replace(values=values)

    def quadratic_model(self, found: Differences) -> QuadraticModel:
        """Differences by the formula's unknowns as an expansion by all of the unknowns."""
        slopes = np.zeros((found.values.shape[1], self.count))
        slopes[:, self.places] = found.slopes()

        def curvature(weights: Floats) -> Floats:
            hessian = np.zeros((self.count, self.count))
            of_sum = Differences(found.steps, found.values @ weights)
            hessian[np.ix_(self.places, self.places)] = of_sum.hessian()
            return hessian

        return QuadraticModel(found.values[0], slopes, curvature)

    def objective(self, unknowns: Floats) -> float:
        """What is made small."""
        return float(self.expand_objective(unknowns).values[0])

    def expand_objective(self, unknowns: Floats) -> QuadraticModel:
        """What is made small, with its slopes and curvatures."""
        value, slopes = self.constant, np.zeros(self.count)
        hessian = np.zeros((self.count, self.count))
        for aim, weight in self.aims.items():
            cost, slope, curvature = self.cost(aim, unknowns)
            if self.weighted and aim in ("resolution", "mean-resolution"):
                # what is added up is uncertainty, not variance
                cost = np.sqrt(max(cost, 1e-300))
                slope = slope / (2 * cost)
                curvature = (curvature / 2 - np.outer(slope, slope)) / cost
            value += weight * cost
            slopes += weight * slope
            hessian += weight * curvature
        return QuadraticModel(np.array([value]), slopes[None], lambda weights: weights[0] * hessian)

    def cost(self, aim: str, unknowns: Floats) -> tuple[float, Floats, Floats]:
        """What one aim makes small, its slopes and its Hessian."""
        if aim == "mean-resolution":
            around = self.formula.expand(unknowns[self.places], self.states[: self.stated])
            means = around.values[:, :, self.averaged].mean(axis=(1, 2))
            found = self.quadratic_model(Differences(around.steps, means[:, None]))
            return float(found.values[0]), found.slopes[0], found.curvature(np.ones(1))
        place = len(self.names) + self.extras.index(aim)
        sign = -1.0 if aim.startswith("range") else 1.0
        slope = np.zeros(self.count)
        slope[place] = sign
        return sign * float(unknowns[place]), slope, np.zeros((self.count, self.count))


@dataclass(frozen=True)
class RestrictedProblem:
    """A problem with some of its constraints, as IPOPT takes it.

    elastic: whether each group may be broken by an unknown of its own, whose sum is made small
    instead.
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
        found = self.problem.expand(x[:n], self.rows)
        if not self.elastic:
            return found
        own = np.arange(more) == self.rows.group[:, None]
        return QuadraticModel(
            found.values + x[n:][self.rows.group],
            np.hstack([found.slopes, own]),
            lambda weights: np.pad(found.curvature(weights), (0, more)),
        )

    def values(self, x: Floats) -> Floats:
        """Of all constraints of the problem."""
        found = self.problem.values(x[: self.problem.count])
        return found + x[self.problem.count :][self.problem.rows.group] if self.elastic else found


@dataclass
class StartResult:
    """Where a start ended.

    x: the variables, in the units of their names.  objective: see `report.objective_text`.
    active_constraints: the multiplier of each group that holds the result back, over the largest.
    shortfalls: by what share of its limit a group cannot be met, where the requirement is
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


#: A catalogue of no more choices is tried whole.
TRIED = 24


def refuse_unknown_effects(sensor: Sensor, layout: Layout, command: str = "optimize") -> None:
    """Raises `InputError` where the problem would leave out something that the sensor has."""
    opening = sensor.apertures
    unknown = {
        "beam_ratio": np.isfinite(opening.beam),
        "tip_um": opening.tip > 0,
        "gap_um": opening.gap > 0,
    }
    for key, given in unknown.items():
        if given:
            raise InputError(
                f"facets {command} knows no sensor.apertures.{key}: its model is of light that "
                "only the facets' edges part; leave it out to find a layout, then see what it "
                "changes by facets resolution (rim_mm and detectors are known: spots and the "
                "light on the mirror are kept whole)"
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
    if not layout.variables:
        raise InputError(
            "optimize.variables is empty: name what may vary, as radius_mm: [150, 260]"
        )
    require_noise(sensor, layout, command)


def require_unit(layout: Layout) -> None:
    """Raises `InputError` where uncertainties are to be small and no axis has a unit."""
    if (
        layout.aims.keys() & {"resolution", "mean-resolution"}
        and not np.isfinite(layout.unit).any()
    ):
        raise InputError("optimize.unit names no axis, so that there is no uncertainty to minimise")


def require_noise(sensor: Sensor, layout: Layout, command: str) -> None:
    """Raises `InputError` where the noise of electronics does not go with what is asked."""
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
    """The problem that a configuration's block `optimize` states; raises `InputError`.

    constant: what the parts' price adds to the objective.
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
        fixed, state = build_geometry(tuple(parameters)), columns_of_states(states * scale)
        found = outcome_of(sensor, fixed, sizes, state, gain_of(sensor, names, x))
        at, rim = dark_scene(fixed, state), sensor.apertures.rim
        half = half_of(sizes)
        spots = [each / half for each in ellipse_clearances(fixed, at, sizes)]
        rims = rim_clearances(fixed, at, rim) if np.isfinite(rim) else []
        heads = heads_of(parameters)
        constraints = [
            *limits_of(layout, found.powers, spots, np.sqrt(found.variances), rims),
            *headrooms(found),
            *head_limits(layout, heads),
            *objective_constraints(layout, found, heads),
        ]
        means = variances_over_units(layout, found) if "mean-resolution" in layout.aims else {}
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
    """The shares of their bounds at which variables are zero, where they are positive; else NaN."""
    origin: Floats = np.where(low > 0, -low / (high - low), np.nan)
    return origin


def outputs_at(constraints: list[Constraint], state: int) -> Integers:
    """Outputs that are asked at a state."""
    return np.array([
        output for output, each in enumerate(constraints)
        if each.states is None or state in each.states
    ], dtype=np.int64)  # fmt: skip


def formula_places(names: list[str], extras: list[str]) -> Integers:
    """The places of the variables, and of the scale of the volume."""
    scale = [len(names) + n for n, aim in enumerate(extras) if aim == "range"]
    return np.array([*range(len(names)), *scale])


def rows_of(
    constraints: list[Constraint], groups: list[str], extras: list[str], variables: int, states: int
) -> Rows:
    """A row for each output and state; for an output that is the same at every state, one."""
    rows = [
        (state, output, groups.index(each.group),
         variables + extras.index(each.slack) if each.slack else -1)
        for output, each in enumerate(constraints)
        for state in (range(states) if each.states is None else each.states)
    ]  # fmt: skip
    return Rows(*np.array(rows, dtype=np.int64).T)


def head_limits(layout: Layout, heads: list[Any]) -> list[Constraint]:
    """The largest head, of detectors whose radius varies or is too large: a head that keeps its
    size, whatever is sought, holds nothing back."""
    if np.isinf(layout.head):
        return []
    wide = [head for head in heads if not isinstance(head, float) or head > layout.head]
    return [Constraint("size of the head", 1 - head / layout.head, states=(0,)) for head in wide]


def headrooms(found: Outcome) -> list[Constraint]:
    """Of the amplifiers, where the noise follows from electronics."""
    return [
        Constraint(f"full scale of PSD {'ABC'[n // 4]}'s amplifiers", each)
        for n, each in enumerate(found.headrooms)
    ]


def half_of(sizes: list[Any]) -> float:
    """The length over which clearances are told, mm: half of a detector whose size is given."""
    return float(np.mean([size for size in sizes if isinstance(size, float)] or [1.0])) / 2


def objective_constraints(layout: Layout, found: Outcome, heads: list[Any]) -> list[Constraint]:
    """What must stay below the slack of each aim."""
    below = []
    if "resolution" in layout.aims:
        for i, part in variances_over_units(layout, found).items():
            what = f"uncertainty of {POSE[i]} as low as it can be"
            below.append(Constraint(what, -part, "resolution"))
    if "size" in layout.aims:
        what = "size of the head as low as it can be"
        below += [Constraint(what, -head / 100, "size", states=(0,)) for head in heads]
    if "condition" in layout.aims:
        decades = np.log10(found.condition) / 2
        below.append(Constraint("conditioning as good as it can be", -decades, "condition"))
    return below


def variances_over_units(layout: Layout, found: Outcome) -> dict[int, Any]:
    """By axis of the pose, its variance over the square of the unit asked for."""
    axes = [i for i in range(6) if np.isfinite(layout.unit[i])]
    return {i: found.variances[i] / layout.unit[i] ** 2 for i in axes}
