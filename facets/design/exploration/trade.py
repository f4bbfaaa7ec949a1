"""The problem of designs that trade one objective of `exploration` against another.

Its unknowns are the variables and the objectives themselves. Within a range the spots stay on their
detectors with enough light; this is required at both ends and at a few positions between.
Uncertainties and the head's size are slacks above their least values.

The p unknowns are the variables, as fractions of their bounds, and then the objectives over their
scales.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...core.errors import InputError
from ...core.extras import require_extra
from ...core.names import FINE_COLUMNS, FINE_UNITS, POSE, RANGE_COLUMNS
from ...core.units import Floats
from ...detectors.noise import power_floor
from ..optimisation.formulation import build_problem, refuse_effects, require_noise
from ..optimisation.problem import LayoutProblem
from ..requirement import EDGES, Constraint, head_limits, headrooms, limits_of
from ..spots import corner_clearances, rim_clearances, tip_clearance
from ..variables import (
    Outcome,
    columns_of_states,
    evaluate_layouts,
    present_values,
    values_between,
)
from ..volume import mirror_states, span_of
from .space import MEASURES, Space, measure_design
from .survey import FAR

#: The measures that can be objectives here, because they have derivatives.
OBJECTIVES = ("head_mm", *FINE_COLUMNS[:6], *RANGE_COLUMNS)
#: Fractions of the distance from rest to a range's end at which its limits are constraints.
RANGE_FRACTIONS = (0.25, 0.5, 0.75, 1.0)
#: Scale of an objective, in its own unit, if the present sensor has no value of it.
USUAL_SCALE = 10.0


@dataclass(frozen=True)
class Trade:
    """The problem, whose last unknowns are the objectives over their `scales`.

    objectives: names, in the order of the unknowns.  signs: -1 for objectives that are maximised.
    """

    space: Space
    problem: LayoutProblem
    objectives: list[str]
    scales: Floats
    signs: Floats

    def costs(self, unknowns: Floats) -> Floats:
        """Return the objectives (objectives,) over their scales, with the sign with which each is
        minimised."""
        costs: Floats = self.signs * unknowns[len(self.problem.names) :]
        return costs

    def costs_of_measures(self, values: Floats) -> Floats:
        """Return the costs (..., objectives) of measures (..., MEASURES), as `costs` does."""
        places = [MEASURES.index(name) for name in self.objectives]
        costs: Floats = self.signs * values[..., places] / self.scales
        return costs

    def bounds(self, most: Floats) -> tuple[Floats, Floats]:
        """Return the bounds, two arrays (p,), of the unknowns with no cost above `most`, which may
        be infinite."""
        low, high = self.problem.bounds()
        n = len(self.problem.names)
        high[n:] = np.where(self.signs > 0, most, np.inf)
        low[n:] = np.where(self.signs < 0, np.maximum(-most, 0.0), 0.0)
        return low, high

    def guess(self, x: Floats) -> Floats:
        """Return the unknowns (p,) at a design (variables,), given in the units of the variables'
        names."""
        _, values = measure_design(self.space, x)
        costs = np.abs(self.costs_of_measures(values))
        shares = (x - self.problem.low) / (self.problem.high - self.problem.low)
        start = np.append(shares, np.where(np.isfinite(costs), costs, 0.1))
        return self.problem.fill_slacks(start)


def require_smooth(space: Space) -> None:
    """Raise `InputError` if an objective has no derivative that a front could follow."""
    unable = [name for name in space.objectives if name not in OBJECTIVES]
    if unable:
        raise InputError(
            f"--front cannot follow {', '.join(unable)}; it supports {', '.join(OBJECTIVES)}"
        )
    if not 2 <= len(set(space.objectives)) <= 3:
        raise InputError("--front takes two or three objectives: give --objective again")
    refuse_effects(space.sensor, "explore --front")
    require_noise(space.sensor, space.layout, "explore --front")
    if not space.rules.whole_spot:
        raise InputError("--front follows ranges of whole spots only: set range.spot to whole")


def trade_of(space: Space) -> Trade:
    """Make the problem of a space's objectives; raises `InputError`."""
    require_extra("casadi", "the search for a front")
    require_smooth(space)
    ranges = [name for name in RANGE_COLUMNS if name in space.objectives]
    objectives = [*ranges, *(name for name in space.objectives if name not in ranges)]
    scales = dict(zip(objectives, scales_of(space, objectives), strict=True))
    states = states_of(space, ranges)

    def constrain(unknowns: Floats, points: Floats) -> list[Constraint]:
        """List the constraints at unknowns (n, p) and points (m, ...) of the volume and of the
        ranges."""
        variables = space.layout.variables
        halves = {
            name: scales[name] * unknowns[:, len(variables) + n, None] / 2
            for n, name in enumerate(ranges)
        }
        x, state = values_between(variables, unknowns), ray_states(space, points, halves)
        return trade_constraints(space, x, state, scales, states)

    problem = build_problem(space.sensor, space.layout.variables, objectives, constrain, states)
    if space.required:
        problem = replace(problem, span=np.pad(span_of(space.layout), ((0, 0), (0, 8))))
    signs = np.array([-1.0 if name in ranges else 1.0 for name in objectives])
    return Trade(space, problem, objectives, np.array(list(scales.values())), signs)


def scales_of(space: Space, objectives: list[str]) -> list[float]:
    """The scale of each objective: its value for the present sensor, moved into the bounds."""
    now = present_values(space.sensor)
    low, high = np.array([space.layout.variables[name] for name in space.names]).T
    x = np.clip([now[name] for name in space.names], low, high)
    values = measure_design(space, x)[1][[MEASURES.index(name) for name in objectives]]
    scales: list[float] = np.where(np.isfinite(values) & (values > 0), values, USUAL_SCALE).tolist()
    return scales


def states_of(space: Space, ranges: list[str]) -> Floats:
    """The states (m, 16) of the constraints: a state of the volume (8), and fractions of the ranges
    (8).

    The first is rest, followed by those towards both ends of each range and, if required, by those
    of the volume.
    """
    rows = [np.zeros(16)]
    for name in ranges:
        axis = RANGE_COLUMNS.index(name)
        for fraction in (*RANGE_FRACTIONS, *(-fraction for fraction in RANGE_FRACTIONS)):
            row = np.zeros(16)
            row[8 + axis] = fraction
            if space.rules.tracking and axis < 2:
                row[14 + axis] = fraction
            rows.append(row)
    if space.required:
        rows += [np.append(state, np.zeros(8)) for state in space.volume]
    return np.array(rows)


def ray_states(space: Space, states: Floats, halves: dict[str, Floats]) -> tuple[Any, ...]:
    """Convert states (m, 16) to the arguments of `outcome_of`.

    halves: half of each range by name, (k, 1), mm and mrad.
    """
    ends: list[Any] = [0.0] * 8
    for name, half in halves.items():
        axis = RANGE_COLUMNS.index(name)
        ends[axis] = half / FAR[axis]
        if axis < 2:
            ends[6 + axis] = ends[axis]
    places = tuple((states[:, i] + states[:, 8 + i] * ends[i]) for i in range(8))
    if space.layout.object is None:
        return places
    on_ray = states[:, 8:].any(axis=1)
    following = np.where(on_ray, space.rules.tracking, space.layout.following)
    volume_states = np.stack(np.broadcast_arrays(*places), axis=-1)
    return columns_of_states(mirror_states(volume_states, space.layout.object, following))


def trade_constraints(
    space: Space, x: list[Any], state: Any, scales: dict[str, float], states: Floats
) -> list[Constraint]:
    """List a design's constraints: its requirements, and the bounds that are the objectives."""
    values = evaluate_layouts(space.sensor, space.names, x, state, space.layout.object)
    fixed, at, outcome, heads = values.fixed, values.at, values.outcome, values.heads
    present_sizes = [(psd.size_y, psd.size_z) for psd in space.sensor.psds]
    sizes = [(d, d) for d in values.sizes] if "size_mm" in space.names else present_sizes
    rim, half = space.sensor.apertures.rim, float(np.mean(present_sizes)) / 2
    rims = rim_clearances(fixed, at, rim) if np.isfinite(rim) else []
    return [
        Constraint("mirror's tip in the beam", tip_clearance(at)),
        *headrooms(outcome),
        *(Constraint("light on a facet, rim", each) for each in rims),
        *(
            Constraint(f"spot on PSD {'ABC'[k]} {EDGES[edge]} edge", each / half)
            for (k, edge), clearances in corner_clearances(fixed, at, sizes).items()
            for each in clearances
        ),
        *reach_limits(space, outcome, states),
        *volume_limits(space, outcome, heads, states),
        *objective_limits(outcome, heads, scales),
    ]


def reach_limits(space: Space, outcome: Outcome, states: Floats) -> list[Constraint]:
    """Constrain powers and uncertainties towards the ends of the ranges, by the rules of ranges."""
    rules, on_ranges = space.rules, np.flatnonzero(~states[:, :8].any(axis=1)).tolist()
    weakest = rules.snr * power_floor(space.sensor)
    coarsest = np.array(rules.coarsest) / FINE_UNITS[:6]
    return [
        *(
            Constraint("power on a detector", power / weakest - 1, states=on_ranges)
            for power in outcome.powers
        ),
        *(
            Constraint(f"range.coarsest of {name}", 1 - variance / limit**2, states=on_ranges)
            for name, variance, limit in zip(POSE, outcome.variances, coarsest, strict=True)
            if np.isfinite(limit)
        ),
    ]


def volume_limits(
    space: Space, outcome: Outcome, heads: list[Any], states: Floats
) -> list[Constraint]:
    """List the requirements over the volume, if required, and those on the powers at rest, which
    every design must meet."""
    constraints = limits_of(
        space.layout.least_power, space.layout.limit, outcome.powers, [], np.sqrt(outcome.variances)
    )
    if not space.required:
        return [each._replace(states=[0]) for each in constraints[: len(outcome.powers)]]
    volume = np.flatnonzero(states[:, :8].any(axis=1)).tolist()
    power, fine = [0, *volume], volume or [0]  # a volume without width is the state at rest
    return [
        *(each._replace(states=power) for each in constraints[: len(outcome.powers)]),
        *(each._replace(states=fine) for each in constraints[len(outcome.powers) :]),
        *head_limits(space.layout.head, heads),
    ]


def objective_limits(
    outcome: Outcome, heads: list[Any], scales: dict[str, float]
) -> list[Constraint]:
    """Require the uncertainties at rest and the head to stay below the objectives."""
    below = []
    for name, scale in scales.items():
        if name in FINE_COLUMNS:
            sigma = np.sqrt(outcome.variances[FINE_COLUMNS.index(name)])
            what = f"{name} as low as it can be"
            below.append(Constraint(what, -sigma / scale, name, (0,)))
        elif name == "head_mm":
            what = "size of the head as low as it can be"
            below += [Constraint(what, -head / scale, name, (0,)) for head in heads]
    return below
