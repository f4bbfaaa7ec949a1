"""Derivatives by differences with enough digits to be exact for floats.

A difference to one side with a step of 1e-20 is off by about 1e-20 times the second derivative, and
by 1e-20 for the rounding of 40 digits; a float has 1e-16.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

import mpmath as mp
import numpy as np

from facets.optics import wedge

DIGITS = 40
STEP = mp.mpf(10) ** -20


@contextmanager
def many_digits() -> Iterator[None]:
    """Give numbers of mpmath `DIGITS` digits within this context.

    The integral over a side's sweep is cached for each place of the side, because most varied
    values leave the sides in place and the integral takes most of the time.
    """
    integrated = wedge.swept_mass
    wedge.swept_mass = cache(integrated)
    try:
        with mp.workdps(DIGITS):
            yield
    finally:
        wedge.swept_mass = integrated


def precise(values: Any) -> list[Any]:
    return [mp.mpf(float(x)) for x in values]


def differences(values: list[Any], function: Callable[[list[Any]], np.ndarray]) -> np.ndarray:
    """Derivatives (..., len(values)) of the results of `function` by each of the values."""
    start = function(values)
    columns = []
    for i in range(len(values)):
        moved = list(values)
        moved[i] = moved[i] + STEP
        columns.append((function(moved) - start) / STEP)
    return np.array(columns).T.astype(float)
