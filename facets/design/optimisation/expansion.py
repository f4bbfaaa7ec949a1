"""The values, slopes and curvatures of a layout problem, as IPOPT needs them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...core.units import Floats
from .problem import Differences, LayoutProblem, Rows


class QuadraticModel(NamedTuple):
    """Values (r,) at a point, their slopes (r, unknowns), and a function from weights (r,) to the
    Hessian (unknowns, unknowns) of the weighted sum."""

    values: Floats
    slopes: Floats
    curvature: Callable[[Floats], Floats]


def expand_rows(problem: LayoutProblem, unknowns: Floats, rows: Rows) -> QuadraticModel:
    """Return values, slopes and curvatures of rows of constraints."""
    which, place = np.unique(rows.state, return_inverse=True)
    around = problem.formula.expand(unknowns[problem.places], problem.states[which])
    differences_of_rows = Differences(around.steps, around.values[:, place, rows.output])
    model = quadratic_model(problem, differences_of_rows)
    bound = rows.slack >= 0
    values = model.values + np.where(bound, unknowns[rows.slack], 0.0) - rows.spare
    model.slopes[np.flatnonzero(bound), rows.slack[bound]] = 1.0
    return model._replace(values=values)


def quadratic_model(problem: LayoutProblem, differences: Differences) -> QuadraticModel:
    """Expand the formula's differences in all unknowns."""
    slopes = np.zeros((differences.values.shape[1], problem.count))
    slopes[:, problem.places] = differences.slopes()

    def curvature(weights: Floats) -> Floats:
        """The Hessian (unknowns, unknowns) of the sum of the rows with weights (r,)."""
        hessian = np.zeros((problem.count, problem.count))
        of_sum = Differences(differences.steps, differences.values @ weights)
        hessian[np.ix_(problem.places, problem.places)] = of_sum.hessian()
        return hessian

    return QuadraticModel(differences.values[0], slopes, curvature)


def expand_objective(problem: LayoutProblem, unknowns: Floats) -> QuadraticModel:
    """Return the objective with its slopes and curvatures."""
    aims = problem.objective
    value, slopes = aims.price, np.zeros(problem.count)
    hessian = np.zeros((problem.count, problem.count))
    for aim, weight in aims.aims.items():
        size, slope, curvature = cost(problem, aim, unknowns)
        if aims.weighted and aim in ("resolution", "mean-resolution"):
            # the sum is over uncertainties, not variances
            size = np.sqrt(max(size, 1e-300))
            slope = slope / (2 * size)
            curvature = (curvature / 2 - np.outer(slope, slope)) / size
        value += weight * size
        slopes += weight * slope
        hessian += weight * curvature
    return QuadraticModel(np.array([value]), slopes[None], lambda weights: weights[0] * hessian)


def cost(problem: LayoutProblem, aim: str, unknowns: Floats) -> tuple[float, Floats, Floats]:
    """Return the value of one aim, its slopes (unknowns,) and its Hessian (unknowns, unknowns)."""
    if aim == "mean-resolution":
        states = problem.states[: problem.objective.state_count]
        around = problem.formula.expand(unknowns[problem.places], states)
        means = around.values[:, :, problem.objective.averaged :].mean(axis=(1, 2))
        model = quadratic_model(problem, Differences(around.steps, means[:, None]))
        return float(model.values[0]), model.slopes[0], model.curvature(np.ones(1))
    place = len(problem.names) + problem.extras.index(aim)
    sign = -1.0 if aim.startswith("range") else 1.0
    slope = np.zeros(problem.count)
    slope[place] = sign
    return sign * float(unknowns[place]), slope, np.zeros((problem.count, problem.count))


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
        """The number of unknowns, with those by which an elastic problem relaxes its groups."""
        return self.problem.count + self.elastic * len(self.problem.groups)

    @property
    def constraints(self) -> int:
        """The number of constraints."""
        return len(self.rows)

    def objective(self, x: Floats) -> QuadraticModel:
        """The objective at unknowns x; for an elastic problem the sum of the relaxations."""
        n, size = self.problem.count, len(x)
        if not self.elastic:
            return expand_objective(self.problem, x)
        slopes = np.append(np.zeros(n), np.ones(size - n))
        return QuadraticModel(x[n:].sum()[None], slopes[None], lambda _: np.zeros((size, size)))

    def limits(self, x: Floats) -> QuadraticModel:
        """The constraints at unknowns x, which must not be negative."""
        n, more = self.problem.count, len(x) - self.problem.count
        model = expand_rows(self.problem, x[:n], self.rows)
        if not self.elastic:
            return model
        by_group = np.arange(more) == self.rows.group[:, None]
        return QuadraticModel(
            model.values + x[n:][self.rows.group],
            np.hstack([model.slopes, by_group]),
            lambda weights: np.pad(model.curvature(weights), (0, more)),
        )

    def values(self, x: Floats) -> Floats:
        """Return the values of all constraints of the problem at unknowns x, also those not among
        the rows."""
        values = self.problem.values(x[: self.problem.count])
        return values + x[self.problem.count :][self.problem.rows.group] if self.elastic else values
