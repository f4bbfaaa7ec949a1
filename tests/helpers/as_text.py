"""The model at single states as interpreted Python: to look at, and to compare with."""

from __future__ import annotations

from collections.abc import Sequence
from math import nan
from typing import Any

import numpy as np

from facets.optics import bench_gradient, exact_text, gradient
from facets.optics.forward import Geometry
from facets.scalars.dual import Dual
from facets.scalars.nesting import leaves

State = tuple[Any, ...]


def text_of(geometry: Geometry) -> exact_text.ExactText:
    if geometry.openings.cut:
        return exact_text.CUT
    return exact_text.BENCH if geometry.light.options.on else exact_text.IDEAL


def readings(geometry: Geometry, state: State) -> list[Any]:
    """Return nine readings; geometry and state may hold numbers of any type."""
    text = text_of(geometry)
    return list(leaves(text.readings(geometry, text.scene(geometry, state))))


def slopes(moved: Geometry, geometry: Geometry, state: State) -> list[Any]:
    """Return the derivatives of nine readings by what `moved` or `state` carry derivatives by.

    geometry: the same vectors as `moved`, without derivatives.
    """
    text = text_of(geometry)
    at = text.scene(geometry, tuple(number.real for number in state))
    return [row for rows in text.slopes(moved, state, at) for row in rows]


def derivatives(geometry: Geometry, state: State) -> list[Sequence[float]]:
    """Return the Jacobian at a state; NaN where there is no reading."""
    if text_of(geometry) is exact_text.IDEAL:
        return rows_of(gradient.linearise(geometry, state))
    each = tuple(Dual(number, seed) for number, seed in zip(state, np.eye(8), strict=True))
    found = zip(readings(geometry, state), slopes(geometry, geometry, each), strict=True)
    return [np.broadcast_to(row if value == value else nan, 8) for value, row in found]


def approximate_derivatives(geometry: Geometry, state: State) -> list[Sequence[float]]:
    """Under real light, return what `bench_gradient.linearise_nearly` gives."""
    return rows_of(bench_gradient.linearise_nearly(geometry, state))


def rows_of(detectors: Any) -> list[Any]:
    return [
        row if value == value else [nan] * np.size(row)
        for values, rows in detectors
        for value, row in zip(values, rows, strict=True)
    ]
