"""A layout that meets its requirements although its heads have manufacturing tolerances.

The search tightens every limit by k standard deviations of its margin over the tolerances, where k
is as large as the required yield needs. Both vary with the layout: the standard deviations with its
geometry, k with the number of limits that are nearly reached at once. Search, expansion and k are
therefore computed in turn until k no longer changes; each search begins at the last one's result.
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
    Draws,
    Expansion,
    draw_heads,
    expand_margins,
    least_margins,
)

#: Largest number of rounds, and the tolerance of the predicted yield.
MAX_ROUNDS, YIELD_TOLERANCE = 8, 0.002
#: Least standard deviation of a margin that is used as its unit.
LEAST_SPREAD = 1e-12


@dataclass(frozen=True)
class Robust:
    """A layout with tightened limits.

    problem: the problem with the tightened limits, which rounding and later steps must meet, too.
    result: the result of its search.  factor: k.  within_limits: the predicted fraction of heads
    that meet all limits on spots, light and uncertainties.  rounds: number of rounds.
    """

    problem: LayoutProblem
    result: StartResult
    factor: float
    within_limits: float
    rounds: int


def robust_layout(problem: LayoutProblem, heads: HeadSettings, best: StartResult) -> Robust:
    """Find the layout whose heads have the yield of `layout.production`, from the best layout.

    Without such a layout the result's `found` is false and its `shortfalls` name the obstacles.
    """
    from scipy.special import ndtri

    if "range" in problem.extras:
        raise InputError(
            "optimize.production.yield_percent does not combine with the aim range: the yield "
            "needs a fixed volume, and this aim maximises the volume; state the volume and choose "
            "another aim"
        )
    heads = replace(heads, layout=replace(heads.layout, accuracy=(np.inf,) * 6))
    target, rounds = heads.layout.production, 1
    robust = Robust(problem, best, float(ndtri(target)), 0.0, rounds)
    while True:
        sensor = sensor_of(problem.sensor, problem.names, robust.result.x)
        built = heads.assembly_of(sensor)
        expansion, draws = expand_margins(built), draw_heads(built)
        within_limits = float((least_margins(expansion, draws.heads) >= 0).mean())
        robust = replace(robust, within_limits=within_limits, rounds=rounds)
        if rounds == MAX_ROUNDS or (rounds > 1 and abs(within_limits - target) < YIELD_TOLERANCE):
            return robust
        if rounds > 1:
            factor = robust.factor + missing_factor(expansion, draws, target)
            robust = replace(robust, factor=factor)
        robust = search_with_margins(robust, spare_of(problem, expansion, robust.factor))
        if not robust.result.found:
            return robust
        rounds += 1


def search_with_margins(robust: Robust, spare: Floats) -> Robust:
    """Search again from the last layout, with other least values (rows,) of the constraints."""
    problem = robust.problem.replace_spare(spare)
    result = solve_from(problem, robust.result.x)
    if not result.found:
        result.shortfalls = shortfalls_of(problem, result.start)
    return replace(robust, problem=problem, result=result)


def missing_factor(expansion: Expansion, draws: Draws, target: float) -> float:
    """The increase of the factor with which the target fraction of the heads meets all limits.

    A head meets all limits if its least margin, in standard deviations, exceeds minus this value.
    """
    unit = np.maximum(expansion.spread, LEAST_SPREAD)
    return -float(np.quantile(least_margins(expansion, draws.heads, unit), 1 - target))


def spare_of(problem: LayoutProblem, expansion: Expansion, factor: float) -> Floats:
    """Return the least value of each constraint of a problem (rows,), in its own unit."""
    built = expansion.built
    names = built.requirement.groups
    spread = factor * expansion.spread.reshape(-1, len(names))
    converted = problem_units(problem, built, spread)
    padded = np.concatenate([converted, np.zeros((len(converted), 1))], axis=1)
    # other outputs than the first are no requirements of heads
    column = np.minimum(problem.rows.output, len(names))
    spare: Floats = padded[problem.rows.state, column]  # the heads' states come first
    return spare


def problem_units(problem: LayoutProblem, built: Assembly, spread: Floats) -> Floats:
    """Convert standard deviations (n, margins) of `requirement.margins_of` to the units of the
    problem's constraints, whose clearances have another unit of length."""
    converted = spread.copy()
    psds = built.sensor.psds
    for k, psd in enumerate(psds):
        halves = np.array([psd.size_y, psd.size_y, psd.size_z, psd.size_z]) / 2
        converted[:, 3 + 4 * k : 7 + 4 * k] *= halves / problem.half
    return converted
