"""A formula of layouts at states: values of many layouts at once, and derivatives by differences.

The formula is the float model on arrays, with its closed Jacobian. Derivatives by a layout's
variables are differences between neighbouring layouts, all of which are computed in one call.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..core.units import Floats

#: A step is this share of a variable's bounds, or of a positive variable if that is less. Errors of
#: rounding and of truncation are then alike, about 1e-8 of an output.
STEP = 1e-4


@dataclass(frozen=True)
class Differences:
    """Values at a place and at its neighbours, from which the derivatives follow.

    steps (n,): of the unknowns.  values (1 + 2 n + n (n - 1) / 2, ...): at `neighbours_of`.
    """

    steps: Floats
    values: Floats

    @staticmethod
    def neighbours_of(x: Floats, steps: Floats) -> Floats:
        """The place (n,), one step of each unknown forward and backward, and steps of two at
        once."""
        moves = np.diag(steps)
        first, second = np.triu_indices(len(x), 1)
        return np.concatenate([x[None], x + moves, x - moves, x + moves[first] + moves[second]])

    def slopes(self) -> Floats:
        """Return the first derivatives, (..., n)."""
        n = len(self.steps)
        rise = np.moveaxis(self.values[1 : n + 1] - self.values[n + 1 : 2 * n + 1], 0, -1)
        slopes: Floats = rise / (2 * self.steps)
        return slopes

    def hessian(self) -> Floats:
        """Return the second derivatives (n, n) of values that are single numbers."""
        n, middle = len(self.steps), self.values[0]
        ahead, behind, both = np.split(self.values[1:], [n, 2 * n])
        change = np.diag(ahead + behind - 2 * middle)
        first, second = np.triu_indices(n, 1)
        change[first, second] = change[second, first] = both - ahead[first] - ahead[second] + middle
        hessian: Floats = change / np.outer(self.steps, self.steps)
        return hessian


@dataclass(frozen=True)
class Formula:
    """Outputs of layouts at states.

    compute: from unknowns (k, n) and states (m, w) to the outputs, each as wide as (k, m) or less.
    origin (n,): the value at which an unknown's variable is zero, if the variable cannot be
    negative; else NaN.
    """

    compute: Callable[[Floats, Floats], list[Any]]
    origin: Floats

    def expand(self, x: Floats, states: Floats) -> Differences:
        """Compute outputs at a layout (n,) and its neighbours at states (m, w): (..., m,
        outputs)."""
        steps = STEP * np.fmin(1.0, np.abs(x - self.origin))
        return Differences(steps, self.outputs(Differences.neighbours_of(x, steps), states))

    def outputs(self, x: Floats, states: Floats) -> Floats:
        """Compute outputs of layouts (k, n) at states (m, w): (k, m, outputs)."""
        parts = self.compute(x, states)
        outputs = np.empty((len(parts), len(x), len(states)))
        for n, part in enumerate(parts):
            outputs[n] = part
        return np.moveaxis(outputs, 0, -1)
