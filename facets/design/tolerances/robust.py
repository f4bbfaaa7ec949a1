"""A layout that meets its requirements although its heads have manufacturing tolerances.

Every limit of the search is tightened by k times the spread that the tolerances give to its margin,
and k is as large as the required yield needs. Both change with the layout: the spreads by its
geometry, k by how many limits are near at once. So the search, the expansion and k are computed in
turn until k no longer changes; each search begins where the last one ended.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...core.errors import InputError
from ...core.units import Floats
from ..optimisation.problem import LayoutProblem, StartResult
from ..optimisation.search import shortfalls_of, solve_from
from ..variables import sensor_of
from .heads import Assembly, HeadSettings
from .prediction import (
    SAFE_SPREADS,
    Draws,
    Expansion,
    draw_heads,
    expand_margins,
    least_margins,
)

#: Largest number of rounds, and the tolerance of the predicted yield.
MAX_ROUNDS, YIELD_TOLERANCE = 8, 0.002
#: The least spread in whose units a margin is counted.
LEAST_SPREAD = 1e-12


@dataclass(frozen=True)
class Robust:
    """A layout with margins.

    problem: the problem with the margins, which rounding and later steps must keep as well.
    result: the result of its search.  factor: k.  kept: the predicted share of heads that keep
    spots, light and limits.  rounds: number of rounds.
    """

    problem: LayoutProblem
    result: StartResult
    factor: float
    kept: float
    rounds: int


def robust_layout(problem: LayoutProblem, heads: HeadSettings, best: StartResult) -> Robust:
    """Find the layout whose heads have the yield of `layout.production`, from the best layout.

    If no layout has, the result's `found` is false and its `shortfalls` name the obstacles.
    """
    from scipy.special import ndtri

    if "range" in problem.extras:
        raise InputError(
            "optimize.production.yield_percent with an aim of range: heads are asked over the "
            "volume that is stated, and this aim makes the volume itself as large as can be; "
            "state the volume and take another aim"
        )
    heads = replace(heads, layout=replace(heads.layout, accuracy=(np.inf,) * 6))
    target, rounds = heads.layout.production, 1
    robust = Robust(problem, best, float(ndtri(target)), 0.0, rounds)
    while True:
        made = sensor_of(problem.sensor, problem.names, robust.result.x)
        built = heads.assembly_of(made)
        expansion, draws = expand_margins(built), draw_heads(built)
        kept = float((least_margins(expansion, draws.heads) >= 0).mean())
        robust = replace(robust, kept=kept, rounds=rounds)
        if rounds == MAX_ROUNDS or (rounds > 1 and abs(kept - target) < YIELD_TOLERANCE):
            return robust
        if rounds > 1:
            factor = robust.factor + missing_factor(expansion, draws, target)
            robust = replace(robust, factor=factor)
        robust = search_with_margins(robust, spare_of(problem, expansion, robust.factor))
        if not robust.result.found:
            return robust
        rounds += 1


def search_with_margins(robust: Robust, spare: Floats) -> Robust:
    """Search again, from the last layout, with least values (rows,) of the constraints."""
    problem = robust.problem.replace_spare(spare)
    result = solve_from(problem, robust.result.x)
    if not result.found:
        result.shortfalls = shortfalls_of(problem, result.start)
    return replace(robust, problem=problem, result=result)


def missing_factor(expansion: Expansion, draws: Draws, target: float) -> float:
    """The increase of the factor with which the target share of heads keeps all limits.

    A head keeps all if its worst margin, in spreads, is no more below zero than that.
    """
    spread = np.maximum(expansion.spread, LEAST_SPREAD)
    near = np.flatnonzero(expansion.margins < SAFE_SPREADS * spread)
    worst = np.full(len(draws.heads), np.inf)
    for part in np.array_split(near, max(1, len(near) // 100)):
        if len(part):
            values = expansion.margins[part] + draws.heads @ expansion.slopes[part].T
            values += draws.heads**2 @ expansion.bends[part].T / 2
            worst = np.minimum(worst, (values / spread[part]).min(axis=1))
    return -float(np.quantile(worst, 1 - target))


def spare_of(problem: LayoutProblem, expansion: Expansion, factor: float) -> Floats:
    """Return the least value of each constraint of a problem (rows,), in its own unit."""
    built = expansion.built
    names = built.asked.groups
    spread = factor * expansion.spread.reshape(-1, len(names))
    converted = problem_units(problem, built, spread)
    every = np.concatenate([converted, np.zeros((len(converted), 1))], axis=1)
    column = np.minimum(problem.rows.output, len(names))  # the rest are no requirements of heads
    spare: Floats = every[problem.rows.state, column]  # the first states are those of heads
    return spare


def problem_units(problem: LayoutProblem, built: Assembly, spread: Floats) -> Floats:
    """Convert spreads of `requirement.margins_of` to the units of the problem's constraints, whose
    clearances have another unit of length."""
    converted = spread.copy()
    psds = built.sensor.psds
    for k, psd in enumerate(psds):
        halves = np.array([psd.size_y, psd.size_y, psd.size_z, psd.size_z]) / 2
        converted[:, 3 + 4 * k : 7 + 4 * k] *= halves / problem.half
    return converted
