"""The model at single states as interpreted Python: to look at, and to compare with."""

from __future__ import annotations

from collections.abc import Sequence
from math import nan
from typing import Any

import numpy as np

from facets.optics import bench_gradient, bench_light, cut, forward, gradient
from facets.optics.forward import Geometry
from facets.scalars.dual import Dual
from facets.scalars.nesting import leaves

State = tuple[float, ...]


def readings(geometry: Geometry, state: State) -> list[float]:
    if geometry.openings.cut:
        return list(leaves(cut.readings(geometry, state)))
    text = bench_light if geometry.light.options.on else forward
    return list(leaves(text.readings(geometry, state)))


def derivatives(geometry: Geometry, state: State) -> list[Sequence[float]]:
    """Return the Jacobian at a state; NaN where there is no reading."""
    if geometry.openings.cut:
        return rows_of(linearise_cut(geometry, state))
    text = bench_gradient if geometry.light.options.on else gradient
    return rows_of(text.linearise(geometry, state))


def linearise_cut(geometry: Geometry, state: State) -> Any:
    """Readings and Jacobian of light that apertures cut, as `gradient.linearise` gives them."""
    found = cut.cut_scene(geometry, state)
    each = tuple(Dual(number, seed) for number, seed in zip(state, np.eye(len(state)), strict=True))
    slopes = [
        [np.broadcast_to(row, 8) for row in rows]
        for rows in cut.reading_slopes(geometry, each, found)
    ]
    return tuple(zip(cut.scene_readings(geometry, found), slopes, strict=True))


def approximate_derivatives(geometry: Geometry, state: State) -> list[Sequence[float]]:
    """Under real light, return what `bench_gradient.linearise_nearly` gives."""
    return rows_of(bench_gradient.linearise_nearly(geometry, state))


def rows_of(detectors: Any) -> list[Any]:
    return [
        row if value == value else [nan] * np.size(row)
        for values, rows in detectors
        for value, row in zip(values, rows, strict=True)
    ]
