"""Tables and figures of the outlines of measurement ranges, for Fig. 6 and Fig. 10."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

import facets
from facets.characterization.outlines import Boundary, trace
from facets.characterization.ranges import CAUSES
from facets.core.names import POSE
from facets.pictures.plots.ranges import ranges_picture
from facets.pictures.style import unit_of

from .experiment import Table, columns_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PAIRS = tuple(combinations(POSE, 2))


def trace_table(config_name: str, pairs: tuple[tuple[str, str], ...], tracking: bool) -> Table:
    """Trace the points of each outline in order; mm and mrad."""
    config = facets.load(config_name)
    rules = replace(config.range, tracking=tracking)
    rows = []
    for axes in pairs:
        outline = trace(config.sensor, rules, axes)
        factors = [unit_of(name)[1] for name in axes]
        points = outline.points * factors
        causes = [CAUSES[cause] if cause >= 0 else "" for cause in outline.causes]
        rows += [(*axes, *point, cause) for point, cause in zip(points, causes, strict=True)]
    return columns_of("first second first_place second_place cause", rows)


def outlines_figure(table: Table) -> Figure:
    """Draw the outlines of all pairs of axes in a table."""
    return ranges_picture([outline(table, *axes) for axes in pairs_of(table)])


def pairs_of(table: Table) -> list[tuple[str, str]]:
    """The pairs of axes in a table, in their order."""
    pairs = zip(table["first"].tolist(), table["second"].tolist(), strict=True)
    return list(dict.fromkeys(pairs))


def outline(table: Table, first: str, second: str) -> Boundary:
    """The outline over two axes, in mm and rad, from a table in mm and mrad."""
    rows = (table["first"] == first) & (table["second"] == second)
    units = np.array([unit_of(first)[1], unit_of(second)[1]])
    points = np.stack([table["first_place"][rows], table["second_place"][rows]], axis=1) / units
    causes = [CAUSES.index(cause) for cause in table["cause"][rows]]
    return Boundary((first, second), np.zeros(6), points, np.array(causes))


def symmetric_range(table: Table, first: str, second: str, axis: int) -> float:
    """Twice the nearer end of a map along one axis, with the other at zero; mm or mrad."""
    points = outline(table, first, second).points
    factor = unit_of((first, second)[axis])[1]
    other, along = points[:, 1 - axis], points[:, axis]
    near, far = (other, along), (np.roll(other, -1), np.roll(along, -1))
    crosses = (near[0] <= 0) != (far[0] <= 0)
    fraction = near[0][crosses] / (near[0] - far[0])[crosses]
    ends = near[1][crosses] + fraction * (far[1] - near[1])[crosses]
    return float(2 * factor * np.abs(ends).min())
