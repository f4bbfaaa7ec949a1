"""A design in manufacturable values that still meets its requirements.

The variables are rounded to the nearest step one after the other, each time followed by a search
over the others. If no layout then meets the requirements, the other neighbour is tried, then a
finer step.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.units import Floats
from .problem import LayoutProblem
from .search import SLACK, objective_at, settle, solve

#: Steps that are easy to set or make, by the unit of a variable's name or by the complete name.
STEPS = {"mm": 0.1, "mrad": 1.0, "deg": 0.05, "mw": 0.01, "kohm": 1.0}
STEP_OF_NAME = {"diameter_mm": 0.01}
#: Number of steps that are tried, each ten times finer, before a variable stays unrounded.
MAX_REFINEMENTS = 3


@dataclass(frozen=True)
class Rounded:
    """A design in manufacturable values.

    x: the variables.  steps: the step of each, 0 if it was not rounded.  costs: percentage by which
    an error of half a step makes the objective worse; infinite if the layout then violates a
    requirement by more than a thousandth.
    """

    x: Floats
    objective: float
    steps: Floats
    costs: Floats


def step_of(name: str) -> float:
    """The rounding step of a variable, in the unit of its name."""
    return STEP_OF_NAME.get(name, STEPS[name.rpartition("_")[2]])


def round_design(problem: LayoutProblem, x: Floats) -> Rounded | None:
    """Round the design; None if the unrounded design does not meet its requirements."""
    low, high = problem.bounds()
    values, steps = x.copy(), np.zeros(len(x))
    guess = problem.first_guess(x)
    for n in range(len(x)):
        result = round_variable(problem, guess, low, high, n, values[n])
        if result is not None:
            guess, value, steps[n] = result
            values = problem.values_at(guess)
            values[n] = round(value, 9)
        low[n] = high[n] = guess[n]
    x = np.array(
        [v if s == 0 else round(round(v / s) * s, 9) for v, s in zip(values, steps, strict=True)]
    )
    objective = objective_at(problem, x)
    if not np.isfinite(objective):
        return None
    return Rounded(x, objective, steps, costs_of(problem, x, steps, objective))


def round_variable(
    problem: LayoutProblem, guess: Floats, low: Floats, high: Floats, n: int, exact: float
) -> tuple[Floats, float, float] | None:
    """Search with one variable rounded; return the unknowns, the variable's value and its step.
    None if no value nearby meets the requirements."""
    width = problem.high[n] - problem.low[n]
    for refinement in range(MAX_REFINEMENTS):
        step = step_of(problem.names[n]) / 10**refinement
        neighbours = np.floor(exact / step) * step, np.ceil(exact / step) * step
        for value in sorted(neighbours, key=lambda v: abs(v - exact)):
            fraction = (value - problem.low[n]) / width
            if -1e-9 <= fraction <= 1 + 1e-9:
                fraction = float(np.clip(fraction, 0, 1))
                solved = solve_with_value(problem, guess, low, high, n, fraction)
                if solved is not None:
                    return solved, value, step
    return None


def nearest_steps(names: list[str], x: Floats, low: Floats, high: Floats) -> Floats:
    """The nearest multiples (names,) of the steps within the bounds; variables without a step are
    unchanged."""
    rounded = x.copy()
    for n, name in enumerate(names):
        step = step_of(name)
        near = round(round(float(np.clip(x[n], low[n], high[n])) / step) * step, 9)
        if low[n] <= near <= high[n]:
            rounded[n] = near
    return rounded


def solve_with_value(
    problem: LayoutProblem, guess: Floats, low: Floats, high: Floats, n: int, fraction: float
) -> Floats | None:
    """Search with one variable fixed; None if no layout meets the requirements."""
    low, high, guess = low.copy(), high.copy(), guess.copy()
    low[n] = high[n] = guess[n] = fraction
    free = low[: len(problem.names)] < high[: len(problem.names)]
    if free.any() or "range" in problem.extras:
        problem, _, result, _ = solve(problem, problem.fill_slacks(guess), (low, high))
        guess = np.clip(result.x, low, high)
    problem, guess = settle(problem, guess)
    return guess if problem.values(guess).min() > -SLACK else None


def costs_of(problem: LayoutProblem, x: Floats, steps: Floats, objective: float) -> Floats:
    """The rise of the objective, %, by an error of half a step in each variable (variables,);
    infinite if it breaks a requirement."""
    costs = np.zeros(len(x))
    for n, step in enumerate(steps):
        for side in (-0.5, 0.5):
            shifted = x.copy()
            shifted[n] += side * step
            value = objective_at(problem, shifted, slack=1e-3)
            worse = 100 * (value - objective) / max(abs(objective), 1e-300)
            costs[n] = max(costs[n], np.inf if np.isnan(worse) else worse)
    return costs
