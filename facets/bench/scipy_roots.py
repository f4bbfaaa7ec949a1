"""Poses by SciPy's solvers on the readings of another method: the paper's inversion.

Eight readings, without the third power, determine eight unknowns, from zero, scaled to order one.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..core.units import Floats

SCALE = np.array([1, 1, 1, 1e-2, 1e-2, 1e-2, 1, 1])
#: Step of differences: the root of a float's last bit.
STEP = 1.5e-8
Function = Callable[[Floats], Floats]
Root = Callable[[Function, Function | None], Floats]


def solve_by_roots(
    root: Root, model: Function, readings: Floats, is_vectorised: bool = False
) -> Floats:
    """States (n, 8) of readings (n, 9).

    model: gives the readings (n, 9) of states (n, 8).  is_vectorised: whether many states cost
    little more than one, so that slopes are had from nine at once; SciPy asks for one after the
    other.
    """

    def first_eight(unknowns: Floats) -> Floats:
        return model(unknowns * SCALE)[:, :8]

    def slopes(x: Floats) -> Floats:
        values = first_eight(np.vstack([x, x + STEP * np.eye(8)]))
        differences: Floats = (values[1:] - values[0]).T / STEP
        return differences

    def solve(reading: Floats) -> Floats:
        scaled = root(
            lambda x: first_eight(x[None])[0] - reading[:8], slopes if is_vectorised else None
        )
        state: Floats = scaled * SCALE
        return state

    return np.array([solve(reading) for reading in readings])


def fsolve_root(residual: Function, slopes: Function | None) -> Floats:
    from scipy.optimize import fsolve

    state: Floats = fsolve(residual, np.zeros(8), fprime=slopes)
    return state


def least_squares_root(residual: Function, slopes: Function | None) -> Floats:
    from scipy.optimize import least_squares

    jac = slopes or "2-point"
    result = least_squares(residual, np.zeros(8), jac, xtol=1e-14, ftol=1e-14, gtol=1e-14)
    state: Floats = result.x
    return state
