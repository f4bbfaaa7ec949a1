"""The model at single states as Python runs its text, where they are too few to load Numba for.

That takes a second, and several where nothing is kept; a state takes a millisecond. The bits are
those of compiled code, which has the same operations and the same C library.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from math import nan
from typing import Any

import numpy as np

from ..core.units import Floats
from ..optics import bench_gradient, bench_light, forward, gradient
from ..optics.footprint import footprint, slopes
from ..optics.forward import Geometry, placed
from ..scalars.nesting import leaves
from .blocks import task_of

State = tuple[float, ...]

#: For so long, s, a process runs the text before it loads compiled code, and for so many states at
#: a time.
SELDOM, FEW = 1.0, 300
_spent = 0.0


def readings(geometry: Geometry, state: State) -> list[float]:
    text = bench_light if geometry.light.options.on else forward
    return list(leaves(text.readings(geometry, state)))


def derivatives(geometry: Geometry, state: State) -> list[Sequence[float]]:
    """NaN where there is no reading."""
    text = bench_gradient if geometry.light.options.on else gradient
    return rows_of(text.linearised(geometry, state))


def near_derivatives(geometry: Geometry, state: State) -> list[Sequence[float]]:
    """Under the light of a bench, what `bench_gradient.nearly_linearised` gives."""
    return rows_of(bench_gradient.nearly_linearised(geometry, state))


def rows_of(detectors: Any) -> list[Sequence[float]]:
    return [
        row if value == value else [nan] * 8
        for values, rows in detectors
        for value, row in zip(values, rows, strict=True)
    ]


def footprints(geometry: Geometry, state: State) -> list[Sequence[float]]:
    at = placed(geometry, state)
    return [footprint(geometry, at, k, slopes(geometry, at, k)) for k in range(3)]


FORMULAS: dict[str, Callable[[Geometry, State], Any]] = {
    function.__name__: function
    for function in (readings, derivatives, near_derivatives, footprints)
}


def fill(name: str, geometry: Geometry, states: Floats, found: Floats, which: Any) -> Any:
    """Fills some rows of `found` for states (n, 8); returns the numbers of those that are left.

    name: of a block's kernel.  which: the rows' numbers.  They are left once compiled code is
    loaded, or the time is over; so are states at which the text divides by zero or a function of
    the C library has no result, which Python refuses.
    """
    global _spent
    left, formula = [], FORMULAS[task_of(name)]
    few = len(which) <= FEW
    for n in which.tolist():
        begin = time.thread_time()
        if not few or _spent >= SELDOM or f"{__package__}.jit" in sys.modules:
            left.append(n)
            continue
        try:
            with np.errstate(all="raise", under="ignore"):  # of the text's tables
                found[n] = formula(geometry, tuple(states[n].tolist()))
        except (ArithmeticError, ValueError):
            left.append(n)
        _spent += time.thread_time() - begin
    return np.array(left, int)
