"""The Pareto front, point by point, by the epsilon-constraint method.

One objective is minimised while the others have bounds. The bounds step along the front, forward
and back, and the search for each point begins at its neighbour's result. Some points are also
searched from random designs, so that a front of several pieces is found; their results are starts
for the neighbours. The multiplier of a bound at a point is the price of that objective in the first
one, for example urad per mm of the head.

Every point is measured again by `measure_design`, like a sampled design.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.units import Floats
from ..optimisation.problem import Objective
from ..optimisation.search import active_constraints, active_rows, solve
from .space import MEASURES, Space, measure_design
from .trade import Trade, trade_of

#: Number of starts for the minimum of each objective; number of points per random start.
STARTS, RANDOM_START_EVERY = 6, 10
#: Least gain, in units of an objective's scale, with which one result replaces another.
LEAST_GAIN = 1e-7
#: Largest number of sweeps; and of IPOPT's steps, because longer searches seldom find a design.
SWEEPS, STEPS = 6, 60
#: Tolerance of a measured range, in units of `ranges.FARTHEST_MM_RAD`; largest difference between a
#: measure and the search's value, in units of its scale, with which a point is accepted.
RANGE_TOLERANCE, MEASURE_TOLERANCE = 1e-10, 1e-5
OnProgress = Callable[[int, int], None]


@dataclass(frozen=True)
class End:
    """The result of a search: unknowns, costs, multipliers of the costs' bounds, numbers of the
    active constraints, and multipliers of the active groups."""

    unknowns: Floats
    costs: Floats
    multipliers: Floats
    rows: NDArray[np.int64]
    active: dict[str, float]


@dataclass(frozen=True)
class Front:
    """n points on the front, sorted by the first objective, the best first.

    walk, ends: the search and its results, from which it can continue.  designs: (n, variables), in
    the units of the variables' names.  measures: (n, MEASURES).  prices: (n, objectives) the
    improvement of the first objective per unit by which another one's bound is relaxed; NaN for the
    first.  active: multipliers of each point's active constraints, over the largest.  left_out:
    number of points that were excluded, because their measures differ from the search's values.
    """

    walk: Walk
    ends: list[End]
    objectives: list[str]
    designs: Floats
    measures: Floats
    prices: Floats
    active: list[dict[str, float]]
    left_out: int


class Walk:
    """A search along the front of a `Trade`.  first: number of the objective that is minimised."""

    def __init__(self, trade: Trade, first: int, seed: int) -> None:
        self.trade, self.first = trade, first
        self.rng = np.random.default_rng(seed)
        #: Pairs of a point and a start from which it was searched, so that no search is repeated.
        self.searched: set[tuple[int, bytes]] = set()

    def least(self, objective: int, most: Floats, start: Floats | End) -> End | None:
        """Minimise one objective with all costs at most `most` (objectives,); None if no design is
        found."""
        trade = self.trade
        problem = replace(trade.problem, objective=Objective({trade.objectives[objective]: 1.0}))
        guess, rows_before = (
            (start.unknowns, start.rows) if isinstance(start, End) else (start, None)
        )
        problem, rows, result, unknowns = solve(
            problem, guess, trade.bounds(most), known_rows=rows_before, steps=STEPS
        )
        costs = trade.costs(unknowns)
        is_feasible = problem.values(unknowns).min() > -1e-7
        if not result.success or not is_feasible or not (costs <= most + LEAST_GAIN).all():
            return None
        multipliers = np.abs(result.bounds[len(problem.names) :])
        return End(unknowns, costs, multipliers, active_rows(problem, rows, result),
                   active_constraints(problem, problem.rows.subset(rows), result))  # fmt: skip

    def anywhere(self) -> Floats:
        """Return the unknowns (p,) of a random design within the bounds."""
        problem = self.trade.problem
        fractions = self.rng.random(len(problem.names))
        return self.trade.guess(problem.low + fractions * (problem.high - problem.low))

    def end_of(self, objective: int) -> End | None:
        """Minimise one objective and then, at its best value, the others; None if no design is
        found."""
        count = len(self.trade.objectives)
        free = np.full(count, np.inf)
        searched = [self.least(objective, free, self.anywhere()) for _ in range(STARTS)]
        best = best_of(searched, objective)
        if best is None:
            return None
        for other in range(count):
            if other != objective:
                most = free.copy()
                most[objective] = best.costs[objective] + LEAST_GAIN
                best = self.least(other, most, best) or best
        return best

    def follow(self, bounds: Floats, ends: list[End], on_progress: OnProgress) -> list[End | None]:
        """Minimise the first objective for each row of bounds (points, objectives); None for a row
        without a design.

        If a row has no design, tighter bounds are only searched from a neighbour's design.
        """
        ends_of_rows: list[End | None] = [None] * len(bounds)
        empty: list[Floats] = []
        for n, most in enumerate(bounds):
            on_progress(n, 2 * len(bounds))
            near = ends_of_rows[n - 1] if n else None
            if near is None and any((most <= none).all() for none in empty):
                continue
            ends_of_rows[n] = self.improve(None, n, most, ends if near is None else [near])
            if ends_of_rows[n] is None:
                empty.append(most)
        for sweep in range(SWEEPS):
            if not self.sweep(ends_of_rows, bounds, sweep, on_progress) and sweep > 0:
                break
        return ends_of_rows

    def sweep(
        self, ends: list[End | None], bounds: Floats, number: int, on_progress: OnProgress
    ) -> bool:
        """Search each point from its neighbour's result, and return whether a point improved.

        The sweep runs from the last point to the first, or in reverse if its number is odd. Sweep 0
        also searches some points from random designs.
        """
        count, step = len(bounds), -1 if number % 2 else 1
        better = False
        for count_done, n in enumerate(range(count)[::-step]):
            on_progress(min(count + count_done, 2 * count), 2 * count)
            near = ends[n + step] if 0 <= n + step < count else None
            starts: list[Floats | End] = [] if near is None else [near]
            if number == 0 and n % RANDOM_START_EVERY == RANDOM_START_EVERY // 2:
                starts.append(self.anywhere())
            end = self.improve(ends[n], n, bounds[n], starts)
            better, ends[n] = better or end is not ends[n], end
        return better

    def improve(
        self, previous: End | None, n: int, most: Floats, starts: Sequence[Floats | End]
    ) -> End | None:
        """Return the best of point n's previous result and the results from the starts; None if
        there is none."""
        candidates = [previous]
        for start in starts:
            key = n, (start.unknowns if isinstance(start, End) else start).tobytes()
            if key not in self.searched:
                self.searched.add(key)
                candidates.append(self.least(self.first, most, start))
        return best_of(candidates, self.first)


def best_of(ends: list[End | None], objective: int) -> End | None:
    """The result with the least value of an objective; the first of equal ones. None if there is
    none."""
    best = None
    for end in ends:
        if end is not None and (
            best is None or end.costs[objective] < best.costs[objective] - LEAST_GAIN
        ):
            best = end
    return best


def pareto_front(
    space: Space, count: int, seed: int, on_progress: OnProgress = lambda count_done, total: None
) -> Front:
    """Find about `count` points on the front of a space's two or three objectives.

    Raises `InputError` if an objective has no slopes.
    """
    trade = trade_of(space)
    first = trade.objectives.index(space.objectives[0])
    walk = Walk(trade, first, seed)
    ends = [walk.end_of(objective) for objective in range(len(trade.objectives))]
    previous = [end for end in ends if end is not None]
    if len(previous) < len(ends):
        return measure_ends(walk, [])
    bounds = bounds_between(previous, first, count)
    followed = walk.follow(bounds, previous, on_progress)
    return measure_ends(walk, [*(end for end in followed if end is not None), *previous])


def bounds_between(ends: list[End], first: int, count: int) -> Floats:
    """Return rows of bounds (points, objectives), evenly spaced over the front's extent in all
    objectives except the first, whose bound is infinite; consecutive rows are neighbours."""
    costs = np.array([end.costs for end in ends])
    others = [n for n in range(costs.shape[1]) if n != first]
    side = round(count ** (1 / len(others)))
    axes = [np.linspace(costs[:, n].max(), costs[:, n].min(), side) for n in others]
    rows = []
    for turn, outer in enumerate(product(*axes[:-1])):
        line = axes[-1] if turn % 2 == 0 else axes[-1][::-1]
        rows += [(*outer, last) for last in line]
    bounds = np.full((len(rows), costs.shape[1]), np.inf)
    bounds[:, others] = np.array(rows)
    return bounds


def measure_ends(walk: Walk, ends: list[End]) -> Front:
    """Measure the results, and return those that are on the front."""
    trade, first = walk.trade, walk.first
    names = trade.objectives
    designs, measures, prices, ends_kept, left_out = [], [], [], [], 0
    for end in ends:
        x = trade.problem.values_at(end.unknowns)
        why, values = measure_design(trade.space, x, RANGE_TOLERANCE)
        if why or (trade.costs_of_measures(values) > end.costs + MEASURE_TOLERANCE).any():
            left_out += 1
            continue
        price = end.multipliers * trade.scales[first] / trade.scales
        price[first] = np.nan
        designs.append(x)
        measures.append(values)
        prices.append(price)
        ends_kept.append(end)
    best: list[int] = []
    if designs:
        best = np.flatnonzero(distinct(trade, np.array(measures))).tolist()
        best.sort(key=lambda n: float(trade.costs_of_measures(measures[n])[first]))
    return Front(
        walk,
        [ends_kept[n] for n in best],
        names,
        np.array([designs[n] for n in best]).reshape(-1, len(trade.problem.names)),
        np.array([measures[n] for n in best]).reshape(-1, len(MEASURES)),
        np.array([prices[n] for n in best]).reshape(-1, len(names)),
        [ends_kept[n].active for n in best],
        left_out,
    )


def distinct(trade: Trade, measures: Floats) -> NDArray[np.bool_]:
    """Whether no other design is better, and no earlier one is equal: (n,)."""
    costs = trade.costs_of_measures(measures)
    keep = np.ones(len(costs), dtype=bool)
    for n in range(len(costs)):
        others = np.delete(np.arange(len(costs)), n)
        worse = (costs[others] <= costs[n] + 10 * LEAST_GAIN).all(axis=1)
        clear = (costs[others] < costs[n] - 10 * LEAST_GAIN).any(axis=1)
        same = worse & ~clear & (others < n) & keep[others]
        keep[n] = not (same | (worse & clear)).any()
    return keep


def columns(pareto: Front) -> dict[str, NDArray[Any]]:
    """The front as a table: variables, measures, prices and active constraints.

    A price is in units of the first objective per unit of the other one. The column
    u_roll_urad_per_head_mm, for example, is the reduction of the uncertainty of roll, urad, by
    another millimetre of the head's diameter.
    """
    names, first = pareto.objectives, pareto.walk.first
    table: dict[str, NDArray[Any]] = {"point": np.arange(len(pareto.designs))}
    table |= dict(zip(pareto.walk.trade.problem.names, pareto.designs.T, strict=True))
    table |= dict(zip(MEASURES, pareto.measures.T, strict=True))
    for n, name in enumerate(names):
        if n != first:
            table[f"{names[first]}_per_{name}"] = pareto.prices[:, n]
    active = [
        "; ".join(
            f"{group} ({size:.2g})" for group, size in each.items() if not is_objective(group)
        )
        for each in pareto.active
    ]
    return table | {"holds_it_back": np.array(active, dtype=str)}


def is_objective(group: str) -> bool:
    """Whether a group of constraints is the objective itself."""
    return group.endswith("as low as it can be")


#: Number of points of a front in a short table, from one end to the other.
SHOWN_POINTS = 11


def some_rows(pareto: Front) -> tuple[list[str], list[list[str]]]:
    """Headings and rows of some points: variables, measures, prices, and the strongest
    constraint."""
    first = pareto.objectives[pareto.walk.first]
    others = [name for name in pareto.objectives if name != first]
    headings = [*pareto.walk.trade.problem.names, first, *others,
                *(f"{first} per {name}" for name in others), "held back most by"]  # fmt: skip
    rows, last = [], len(pareto.designs) - 1
    for n in sorted({round(k * last / (SHOWN_POINTS - 1)) for k in range(SHOWN_POINTS)}):
        measures = [pareto.measures[n][MEASURES.index(name)] for name in (first, *others)]
        prices = [pareto.prices[n][pareto.objectives.index(name)] for name in others]
        holds = next((group for group in pareto.active[n] if not is_objective(group)), "")
        rows.append([*(f"{value:.4g}" for value in (*pareto.designs[n], *measures)),
                     *(f"{price:.3g}" for price in prices), holds])  # fmt: skip
    return headings, rows
