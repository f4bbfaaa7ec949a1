"""A formula of layouts at states: values of many layouts at once, and slopes by their differences.

The formula is the float model on arrays, with its closed Jacobian. Slopes by what is varied of a
layout are central differences between layouts beside it, which all go through the model in one
call.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..core.units import Floats

#: A step is this share of a variable's bounds, or of a positive variable if that is less. Rounding
#: and what the next order leaves out are then alike, about 1e-8 of an output.
STEP = 1e-4


@dataclass(frozen=True)
class Formula:
    """Outputs of layouts at states.

    compute: from unknowns (k, n) and states (m, w) to the outputs, each as wide as (k, m) or less.
    origin (n,): what an unknown must be to make its variable zero, where that cannot be negative;
    else NaN.
    """

    compute: Callable[[Floats, Floats], list[Any]]
    origin: Floats

    def __call__(self, x: Floats, states: Floats, slopes: bool = False) -> Floats:
        """Outputs of one layout (n,) at states (m, w): (m, outputs, 1), or with the slopes by the
        unknowns (m, outputs, 1 + n)."""
        if not slopes:
            values: Floats = self.outputs(x[None], states)[0, :, :, None]
            return values
        steps = STEP * np.fmin(1.0, np.abs(x - self.origin))
        moves = np.diag(steps)
        found = self.outputs(np.concatenate([x[None], x + moves, x - moves]), states)
        ahead, behind = found[1 : 1 + len(x)], found[1 + len(x) :]
        slope = (ahead - behind) / (2 * steps[:, None, None])
        result: Floats = np.concatenate([found[:1], slope]).transpose(1, 2, 0)
        return result

    def outputs(self, x: Floats, states: Floats) -> Floats:
        """Of layouts (k, n) at states (m, w): (k, m, outputs)."""
        parts = self.compute(x, states)
        found = np.empty((len(parts), len(x), len(states)))
        for n, part in enumerate(parts):
            found[n] = part
        return np.moveaxis(found, 0, -1)
