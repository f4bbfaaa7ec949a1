"""The best layout over a volume, by casadi's IPOPT from several starts, and its active constraints.

Of some thousand constraints only a few are active at the best layout. IPOPT therefore gets those
that are nearest to being violated; at its result all are evaluated, and the violated ones are
added, until none is violated. The result is the same as with all constraints, because no omitted
constraint would be active there.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.arguments import check_arguments
from ...core.layout import Layout
from ...core.notebook import show_shortly
from ...core.sensor import Sensor
from ...core.units import Floats
from ..variables import present_values
from .expansion import RestrictedProblem, expand_objective
from .formulation import problem_of
from .parts import PartsChoice, best_parts, price_term, relax_parts
from .problem import LayoutProblem, Rows, StartResult, add_worst_places

if TYPE_CHECKING:
    from .ipopt import SolverResult


#: A constraint is active if its multiplier exceeds this fraction of the largest one.
ACTIVE = 1e-4
#: Largest violation of a constraint that is met: IPOPT's tolerance with a margin for its scaling.
SLACK = 1e-6
#: Violation above which a constraint is added to IPOPT's problem.
UNNOTICED = 1e-9
#: IPOPT's status if no point meets all constraints.
INFEASIBLE = "infeasible problem detected"
#: Number of constraints of a group that IPOPT gets at first and in each round; number of rounds.
NEAREST, ROUNDS = 1, 40


@show_shortly
@dataclass(frozen=True)
class Optimum:
    """The results of all starts, the best first.

    names: names of the variables.  before: the present sensor's objective, or NaN if it violates
    constraints.  sensor: the sensor with the best parts.  problem: the problem with these parts.
    tried: each choice of parts with its result, the best first; empty without a catalogue.
    choices: number of all choices.
    """

    names: list[str]
    results: list[StartResult]
    before: float
    sensor: Sensor
    problem: LayoutProblem
    tried: list[tuple[PartsChoice, StartResult]] = field(default_factory=list)
    choices: int = 0

    @property
    def best(self) -> StartResult:
        """The best result."""
        return self.results[0]


@check_arguments
def optimize(
    sensor: Sensor,
    layout: Layout,
    on_progress: Callable[[int, int], None] = lambda done, total: None,
) -> Optimum:
    """Search for the best layout from several starts.

    Parameters
    ----------
    sensor
        The present sensor.
    layout
        The variables, the volume, the limits and the aim: the block `optimize` of a configuration,
        `Config.layout`.
    on_progress
        Called after each search with the numbers of completed and of all searches.

    Returns
    -------
    Optimum
        The results of all starts, the best first. With a catalogue, each choice of parts is
        searched from the present sensor, and the best choice from all starts. If no start meets
        all limits, `best.found` is false and `best.shortfalls` names the limits in conflict.

    Raises
    ------
    InputError
        If there are no variables, or the sensor has an effect that the search does not support.

    Examples
    --------
    >>> from dataclasses import replace
    >>> import facets
    >>> config = facets.load("layout")
    >>> layout = replace(config.layout, variables={"radius_mm": (150.0, 250.0)}, starts=1)
    >>> optimum = facets.optimize(config.sensor, layout)
    >>> optimum.best.found, f"{optimum.best.x[0]:.0f} mm"
    (True, '250 mm')
    """
    tried: list[tuple[PartsChoice, StartResult]] = []
    problem = problem_of(sensor, layout)
    now = present_values(sensor)
    before = objective_at(problem, np.array([now[name] for name in problem.names]))
    count_of_choices = 0
    if layout.has_parts:
        tried, count_of_choices = best_parts(sensor, layout, solve_from_present, on_progress)
        best = tried[0][0]
        parted, _ = relax_parts(sensor, layout, best.parts)
        problem = problem_of(parted, layout, price_term(layout, best.price))
    results: list[StartResult] = []
    for start in starts_of(problem, layout.starts, layout.seed):
        on_progress(len(tried) + len(results), len(tried) + layout.starts)
        results.append(solve_from(problem, start))
    results.sort(key=lambda result: (not result.found, result.objective))
    if not results[0].found:
        results[0].shortfalls = shortfalls_of(problem, results[0].start)
    return Optimum(problem.names, results, before, problem.sensor, problem, tried, count_of_choices)


def starts_of(problem: LayoutProblem, count: int, seed: int) -> Floats:
    """Return the starts (count, variables): the present sensor's, and random ones within the
    bounds."""
    now = present_values(problem.sensor)
    first = np.clip([now[name] for name in problem.names], problem.low, problem.high)
    rng = np.random.default_rng(seed)
    fractions = rng.random((count - 1, len(problem.names)))
    return np.concatenate([first[None], problem.low + (problem.high - problem.low) * fractions])


def solve_from_present(sensor: Sensor, layout: Layout) -> StartResult:
    """Solve from the present layout only."""
    problem = problem_of(sensor, layout)
    return solve_from(problem, starts_of(problem, 1, 0)[0])


def nearest(problem: LayoutProblem, values: Floats, most: int) -> NDArray[np.int64]:
    """The numbers (m,) of the `most` rows of each group with the least values, NaN first."""
    sortable = np.where(np.isnan(values), -np.inf, values)
    nearest_rows = []
    for group in range(len(problem.groups)):
        members = np.flatnonzero(problem.rows.group == group)
        nearest_rows.append(members[np.argsort(sortable[members], kind="stable")[:most]])
    return np.concatenate(nearest_rows)


class SolverEnd(NamedTuple):
    """The result of IPOPT.

    problem: the problem with the states that were added.  rows: numbers of the constraints that
    IPOPT got.  unknowns: the unknowns, with slacks as small as possible.
    """

    problem: LayoutProblem
    rows: NDArray[np.int64]
    result: SolverResult
    unknowns: Floats


def solve(
    problem: LayoutProblem,
    guess: Floats,
    bounds: tuple[Floats, Floats],
    elastic: bool = False,
    known_rows: NDArray[np.int64] | None = None,
    steps: int = 300,
) -> SolverEnd:
    """Solve with all constraints from a guess.

    known_rows: numbers of the rows of a neighbour's problem, if the guess is its result.
    steps: IPOPT's largest number of steps in each round.
    """
    from .ipopt import minimise

    n, near = problem.count, known_rows is not None
    rows = nearest(problem, problem.values(guess[:n]), NEAREST)
    if known_rows is not None:
        rows = np.union1d(rows, known_rows[known_rows < len(problem.rows)])
    for turn in range(ROUNDS + 1):
        if turn == ROUNDS:
            rows, near = np.arange(len(problem.rows)), False
        restricted = RestrictedProblem(problem, problem.rows.subset(rows), elastic)
        result = minimise(restricted, guess, bounds, near, steps)
        if near and not result.success and result.status != INFEASIBLE:
            result = minimise(restricted, guess, bounds, steps=steps)
        if not result.success:
            break
        values = restricted.values(result.x)
        broken = np.flatnonzero(~(values > -UNNOTICED))
        new = np.setdiff1d(np.intersect1d(nearest(problem, values, NEAREST), broken), rows)
        if not len(new):  # is any violated between the states?
            wider = add_worst_places(problem, result.x[:n])
            new = np.arange(len(problem.rows), len(wider.rows))
            problem = wider
        if not len(new):
            break
        rows = np.concatenate([rows, new])
        guess, near = result.x.copy(), True
        guess[:n] = problem.fill_slacks(result.x[:n])
    return SolverEnd(problem, rows, result, problem.fill_slacks(result.x[:n], spare=1.0))


def settle(problem: LayoutProblem, unknowns: Floats) -> tuple[LayoutProblem, Floats]:
    """Return the problem with the volume's worst states added, and the unknowns (p,) with slacks
    that hold there."""
    exact = problem.fill_slacks(unknowns, spare=1.0)
    wider = add_worst_places(problem, exact)
    return wider, exact if wider is problem else wider.fill_slacks(exact, spare=1.0)


def active_rows(
    problem: LayoutProblem, rows: NDArray[np.int64], result: SolverResult
) -> NDArray[np.int64]:
    """Return the numbers (m,) of the active constraints among IPOPT's."""
    top = result.limits.max(initial=0.0)
    restricted: NDArray[np.int64] = rows[result.limits > ACTIVE * top]
    return restricted


def solve_from(problem: LayoutProblem, start: Floats) -> StartResult:
    """Search from a start (variables,), in the units of the variables' names."""
    begin = time.perf_counter()
    guess = problem.first_guess(start)
    problem, rows, result, exact = solve(problem, guess, problem.bounds())
    values = problem.values(exact)
    return StartResult(
        start=start,
        x=problem.values_at(exact),
        objective=objective_of(problem, exact),
        found=result.success and bool(values.min() > -SLACK),
        status=result.status,
        seconds=time.perf_counter() - begin,
        active_constraints=active_constraints(problem, problem.rows.subset(rows), result),
    )


def active_constraints(
    problem: LayoutProblem, rows: Rows, result: SolverResult
) -> dict[str, float]:
    """The multipliers of active constraints, over the largest, summed by group and by bound of a
    variable, the largest first."""
    of_groups = np.bincount(rows.group, result.limits, len(problem.groups))
    sums = dict(zip(problem.groups, of_groups.tolist(), strict=True))
    for i, name in enumerate(problem.names):
        end = "least" if result.x[i] < 0.5 else "most"
        sums[f"{name} at its {end}"] = abs(float(result.bounds[i]))
    top = max(sums.values(), default=0.0)
    active = {name: size / top for name, size in sums.items() if top and size > ACTIVE * top}
    return dict(sorted(active.items(), key=lambda item: -item[1]))


def shortfalls_of(problem: LayoutProblem, start: Floats) -> dict[str, float]:
    """The groups that cannot all be met, each with the fraction of its limit by which it is
    violated."""
    low, high = problem.bounds()
    count = len(problem.groups)
    guess = np.append(problem.first_guess(start), np.ones(count))
    result = solve(
        problem,
        guess,
        (np.append(low, np.zeros(count)), np.append(high, np.full(count, np.inf))),
        elastic=True,
    ).result
    fractions = {}
    for group, gap in zip(problem.groups, result.x[-count:].tolist(), strict=True):
        if gap > 1e-4:
            fractions[group] = gap
    return fractions


def objective_at(problem: LayoutProblem, x: Floats, slack: float = SLACK) -> float:
    """The objective at a layout; NaN if it violates a limit by more than `slack`."""
    low, high = problem.bounds()
    guess = problem.first_guess(x)
    low[: len(x)] = high[: len(x)] = guess[: len(x)]
    if "range" in problem.extras:
        guess = solve(problem, guess, (low, high)).result.x
    problem, guess = settle(problem, guess)
    return objective_of(problem, guess) if problem.values(guess).min() > -slack else float("nan")


def objective_of(problem: LayoutProblem, unknowns: Floats) -> float:
    """The objective's value at unknowns (p,)."""
    return float(expand_objective(problem, unknowns).values[0])


def gains(optimum: Optimum, layout: Layout) -> dict[str, float]:
    """Return the best objective with each fixed quantity slightly larger, searched from the
    optimum."""
    sensor, before = optimum.sensor, optimum.problem
    tried: dict[str, tuple[Sensor, Layout]] = {}
    if "size_mm" not in layout.variables and not layout.psds:
        wider = [replace(p, size_y=p.size_y + 1, size_z=p.size_z + 1) for p in sensor.psds]
        larger = replace(sensor, psds=(wider[0], wider[1], wider[2]))
        tried["1 mm more detector"] = (larger, layout)
    if "power_mw" not in layout.variables and not layout.lasers:
        brighter = replace(sensor, beam=replace(sensor.beam, power=1.1 * sensor.beam.power))
        tried["10 % more laser power"] = (brighter, layout)
    if np.isfinite(layout.head):
        tried["10 mm more head"] = (sensor, replace(layout, head=layout.head + 10))
    objectives = {}
    for what, (other, changed_layout) in tried.items():
        problem = problem_of(other, changed_layout, before.objective.price)
        if before.rows.spare.any():
            problem = problem.replace_spare(before.rows.spare)
        result = solve_from(problem, optimum.best.x)
        if result.found:
            objectives[what] = result.objective
    return objectives
