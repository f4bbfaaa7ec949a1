"""A design in manufacturable values that still meets its requirements.

One variable after the other is rounded to the nearest step, and the others are searched again; if
no layout then meets the requirements, the other neighbour is tried, then a finer step.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.units import Floats
from .problem import LayoutProblem
from .search import SLACK, objective_at, settle, solve

#: Steps that are easy to set or make, by the ending of a variable's name or by the whole name.
STEPS = {"mm": 0.1, "mrad": 1.0, "deg": 0.05, "mw": 0.01, "kohm": 1.0}
STEP_OF_NAME = {"diameter_mm": 0.01}
#: How many times a step is made ten times finer before a variable stays unrounded.
MAX_REFINEMENTS = 3


@dataclass(frozen=True)
class Rounded:
    """A design in manufacturable values.

    x: the variables.  steps: the step of each, 0 where it was not rounded.  costs: by what
    percentage the objective gets worse for an error of half a step, or infinite where the layout
    then breaks a requirement by more than a thousandth.
    """

    x: Floats
    objective: float
    steps: Floats
    costs: Floats


def step_of(name: str) -> float:
    return STEP_OF_NAME.get(name, STEPS[name.rpartition("_")[2]])


def round_design(problem: LayoutProblem, x: Floats) -> Rounded | None:
    """Round the design; None if the unrounded design does not meet its requirements."""
    low, high = problem.bounds()
    here, steps = x.copy(), np.zeros(len(x))
    guess = problem.first_guess(x)
    for n in range(len(x)):
        result = round_variable(problem, guess, low, high, n, here[n])
        if result is not None:
            guess, value, steps[n] = result
            here = problem.values_at(guess)
            here[n] = round(value, 9)
        low[n] = high[n] = guess[n]
    x = np.array(
        [v if s == 0 else round(round(v / s) * s, 9) for v, s in zip(here, steps, strict=True)]
    )
    objective = objective_at(problem, x)
    if not np.isfinite(objective):
        return None
    return Rounded(x, objective, steps, costs_of(problem, x, steps, objective))


def round_variable(
    problem: LayoutProblem, guess: Floats, low: Floats, high: Floats, n: int, exact: float
) -> tuple[Floats, float, float] | None:
    """Search with one variable rounded; return the unknowns, its value and its step. None if no
    value nearby meets the requirements."""
    width = problem.high[n] - problem.low[n]
    for finer in range(MAX_REFINEMENTS):
        step = step_of(problem.names[n]) / 10**finer
        neighbours = np.floor(exact / step) * step, np.ceil(exact / step) * step
        for value in sorted(neighbours, key=lambda v: abs(v - exact)):
            share = (value - problem.low[n]) / width
            if -1e-9 <= share <= 1 + 1e-9:
                share = float(np.clip(share, 0, 1))
                solved = solve_with_value(problem, guess, low, high, n, share)
                if solved is not None:
                    return solved, value, step
    return None


def nearest_steps(names: list[str], x: Floats, low: Floats, high: Floats) -> Floats:
    """The nearest multiples of the steps within the bounds; variables without a step are
    unchanged."""
    rounded = x.copy()
    for n, name in enumerate(names):
        step = step_of(name)
        near = round(round(float(np.clip(x[n], low[n], high[n])) / step) * step, 9)
        if low[n] <= near <= high[n]:
            rounded[n] = near
    return rounded


def solve_with_value(
    problem: LayoutProblem, guess: Floats, low: Floats, high: Floats, n: int, share: float
) -> Floats | None:
    """Search with one variable held; None if no layout meets the requirements."""
    low, high, guess = low.copy(), high.copy(), guess.copy()
    low[n] = high[n] = guess[n] = share
    free = low[: len(problem.names)] < high[: len(problem.names)]
    if free.any() or "range" in problem.extras:
        problem, _, result, _ = solve(problem, problem.fill_slacks(guess), (low, high))
        guess = np.clip(result.x, low, high)
    problem, guess = settle(problem, guess)
    return guess if problem.values(guess).min() > -SLACK else None


def costs_of(problem: LayoutProblem, x: Floats, steps: Floats, objective: float) -> Floats:
    costs = np.zeros(len(x))
    for n, step in enumerate(steps):
        for side in (-0.5, 0.5):
            moved = x.copy()
            moved[n] += side * step
            value = objective_at(problem, moved, slack=1e-3)
            worse = 100 * (value - objective) / max(abs(objective), 1e-300)
            costs[n] = max(costs[n], np.inf if np.isnan(worse) else worse)
    return costs
