"""A layout problem as casadi takes it: variables, constraints with names, and what is made small.

The largest of what is asked for over the volume is pushed down by a slack variable (minimax). What
a layout must keep are constraints with names, so that the search can say in words what holds the
best layout back, or what can not be met.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.errors import InputError
from ..core.names import POSE
from ..core.sensor import Sensor
from ..core.units import Floats
from .variables import Outcome, heads_of, outcome, with_values
from .volume import states_of

if TYPE_CHECKING:
    from ..core.settings import Layout


#: IPOPT's own tolerance.
TOLERANCE = 1e-8
EDGES = ("-y", "+y", "-z", "+z")
#: What the slack of an aim, or the scale of the volume, starts from; for an aim that needs one.
GUESS = {"resolution": 100.0, "condition": 10.0, "size": 100.0, "range": 0.3}


@dataclass(frozen=True)
class Limit:
    """One group of constraints: what it is about, and values that must not fall below zero."""

    group: str
    value: Any


@dataclass(frozen=True)
class Problem:
    """What is to be found, in casadi's symbols; from `problem_of`.

    names: of the variables.  low, high: their bounds, in the units of their names.
    extras: the aims that have an unknown of their own, a slack or the scale of the volume.
    unknown: the variables as shares of their bounds, then the extras.
    limits: what must be kept.  objective: what is made small.
    """

    sensor: Sensor
    names: list[str]
    low: Floats
    high: Floats
    extras: list[str]
    unknown: Any
    limits: list[Limit]
    objective: Any

    def first_guess(self, start: Floats) -> Floats:
        """The unknowns at a start: the slack above what it has to be above, the scale small."""
        shares = (start - self.low) / (self.high - self.low)
        return np.append(shares, [GUESS[aim] for aim in self.extras])

    def values_at(self, unknowns: Floats) -> Floats:
        """The variables, in the units of their names."""
        return self.low + (self.high - self.low) * unknowns[: len(self.names)]

    def bounds(self) -> tuple[Floats, Floats]:
        """Of the unknowns."""
        low, high = np.zeros(self.unknown.numel()), np.ones(self.unknown.numel())
        high[len(self.names) :] = np.inf
        return low, high

    def solver(self) -> Any:
        """IPOPT for the problem."""
        import casadi as ca

        options: dict[str, Any] = {
            "ipopt.print_level": 0, "print_time": False, "ipopt.sb": "yes", "ipopt.tol": TOLERANCE,
            "ipopt.max_iter": 300, "ipopt.bound_relax_factor": 0.0,
            "ipopt.hessian_approximation": "exact", "error_on_fail": False,
        }  # fmt: skip
        constraints = ca.vertcat(*[limit.value for limit in self.limits])
        problem = {"x": self.unknown, "f": self.objective, "g": constraints}
        return ca.nlpsol("layout", "ipopt", problem, options)

    def elastic_solver(self) -> Any:
        """IPOPT for how far each group has to give way: the least sum of shortfalls."""
        import casadi as ca

        shortfall = ca.MX.sym("e", len(self.limits))
        parts = [limit.value + shortfall[n] for n, limit in enumerate(self.limits)]
        problem = {
            "x": ca.vertcat(self.unknown, shortfall),
            "f": ca.sum1(shortfall),
            "g": ca.vertcat(*parts),
        }
        options: dict[str, Any] = {"ipopt.print_level": 0, "print_time": False, "ipopt.sb": "yes"}
        return ca.nlpsol("elastic", "ipopt", problem, options)


def require_supported(sensor: Sensor, layout: Layout) -> None:
    """Raises `InputError` where the problem would leave out something that the sensor has."""
    if sensor.electronics is not None or sensor.apertures.cut or sensor.light.on:
        raise InputError(
            "facets optimize knows no sensor.apertures, no sensor.light and no `noise.model: "
            "electronics`; "
            "leave them out to find a layout, then see what they change by facets resolution"
        )
    if sensor.calibration is not None:
        raise InputError(
            "sensor.calibration belongs to a rig that stands, not to a layout to be found; "
            "leave it out"
        )
    if not layout.variables:
        raise InputError("optimize.variables is empty: nothing may change")


def problem_of(sensor: Sensor, layout: Layout) -> Problem:
    """The problem that a configuration's block `optimize` states; raises `InputError`."""
    import casadi as ca

    require_supported(sensor, layout)
    names = list(layout.variables)
    low, high = np.array([layout.variables[name] for name in names]).T
    extras = [aim for aim in GUESS if aim in layout.aims]
    unknown = ca.MX.sym("x", len(names) + len(extras))
    x = [low[i] + (high[i] - low[i]) * unknown[i] for i in range(len(names))]
    extra = {aim: unknown[len(names) + n] for n, aim in enumerate(extras)}
    parameters, sizes = with_values(sensor, names, x)
    states = states_of(layout, extra.get("range", 1.0))
    results = outcome(sensor).map(len(states))(
        ca.repmat(ca.vertcat(*parameters), 1, len(states)),
        ca.repmat(ca.vertcat(*sizes), 1, len(states)),
        ca.horzcat(*[ca.vertcat(*state) for state in states]),
        0.0,
    )
    heads = heads_of(parameters)
    limits = requirements(layout, results, heads, sizes)
    costs, below = costs_of(layout, results, heads, extra)
    objective = weighted(layout, costs)
    return Problem(sensor, names, low, high, extras, unknown, [*limits, *below], objective)


def requirements(layout: Layout, results: Any, heads: list[Any], sizes: Any) -> list[Limit]:
    """What every layout must keep: each value at least zero, all of order one."""
    import casadi as ca

    power = results[Outcome.POWERS, :].T / layout.least_power - 1
    kept = [Limit("power on a detector", ca.reshape(power, power.numel(), 1))]
    half = np.mean([size for size in sizes if isinstance(size, float)] or [1.0]) / 2
    for k, letter in enumerate("ABC"):
        for e, edge in enumerate(EDGES):
            clearance = results[Outcome.CLEARANCES.start + 4 * k + e, :].T / half
            kept.append(Limit(f"spot on PSD {letter}, {edge} edge", clearance))
    for i, name in enumerate(POSE):
        limit = layout.limit[i]
        if np.isfinite(limit):
            fine = 1 - results[i, :].T / limit**2
            kept.append(Limit(f"uncertainty of {name}", fine))
    if np.isfinite(layout.head):
        kept.append(Limit("size of the head", 1 - ca.vertcat(*heads) / layout.head))
    return kept


def costs_of(
    layout: Layout, results: Any, heads: list[Any], extra: dict[str, Any]
) -> tuple[dict[str, Any], list[Limit]]:
    """What each aim makes small, by its name; and what must stay below the slacks for that."""
    import casadi as ca

    costs, below = {}, []
    if layout.aims.keys() & {"resolution", "mean-resolution"}:
        parts = variances_over_units(layout, results)
    if "resolution" in layout.aims:
        for i, part in parts.items():
            what = f"uncertainty of {POSE[i]} as low as it can be"
            below.append(Limit(what, extra["resolution"] - part))
        costs["resolution"] = extra["resolution"]
    if "mean-resolution" in layout.aims:
        every = ca.vertcat(*parts.values())
        costs["mean-resolution"] = ca.sum1(every) / every.numel()
    if "size" in layout.aims:
        for head in heads:
            what = "size of the head as low as it can be"
            below.append(Limit(what, extra["size"] - head / 100))
        costs["size"] = extra["size"]
    if "condition" in layout.aims:
        decades = ca.log(results[Outcome.CONDITION, :].T) / np.log(10) / 2
        what = "conditioning as good as it can be"
        below.append(Limit(what, extra["condition"] - decades))
        costs["condition"] = extra["condition"]
    if "range" in layout.aims:
        costs["range"] = -extra["range"]
    return costs, below


def variances_over_units(layout: Layout, results: Any) -> dict[int, Any]:
    """By axis of the pose, its variance at each state over the square of the unit asked for."""
    axes = [i for i in range(6) if np.isfinite(layout.unit[i])]
    if not axes:
        raise InputError("optimize.unit names no axis: there is nothing to be made fine")
    return {i: results[i, :].T / layout.unit[i] ** 2 for i in axes}


def weighted(layout: Layout, costs: dict[str, Any]) -> Any:
    """The one cost, or the sum of several by their weights."""
    if layout.aim != "weighted":
        return costs[layout.aim]
    for squared in costs.keys() & {"resolution", "mean-resolution"}:
        costs[squared] = costs[squared] ** 0.5  # what is added up is uncertainty, not variance
    return sum(layout.aims[aim] * cost for aim, cost in costs.items())
