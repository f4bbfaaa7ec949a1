"""The output of `facets range-map`: the range of each axis, and a line for each outline."""

from __future__ import annotations

from typing import TYPE_CHECKING

from facets import characterization, core
from facets.core.plain_numbers import count_text

from ..console import show_table
from ..options.places import report_object

if TYPE_CHECKING:
    from facets.characterization.outlines import Boundary
    from facets.config import Config
    from facets.core.rules import Rules
    from facets.core.units import Floats


def report_axes(settings: Config, rules: Rules, pose: Floats) -> None:
    """Print the range of each axis, and the largest box with these proportions."""
    import numpy as np

    ranges = characterization.ranges.axis_ranges(settings.sensor, rules, pose)
    sizes = np.array([max(axis.symmetric / 2, 1e-12) for axis in ranges])
    sides, why = characterization.ranges.largest_box(settings.sensor, rules, pose, sizes)
    rows, cause_of = [], characterization.tables.cause_of
    for axis, side in zip(ranges, sides, strict=True):
        unit = core.units.unit_of(axis.name)
        causes = sorted({cause_of(axis.low_cause), cause_of(axis.high_cause)})
        numbers = (axis.low, axis.high, axis.total, axis.symmetric / 2)
        cells = [f"{unit.factor * number:.4g}" for number in numbers]
        rows.append([axis.name, *cells, unit.unit, ", ".join(causes), f"{unit.factor * side:.4g}"])
    mode = "beam follows in x and y" if rules.tracking else "beam fixed"
    headings = ("axis", "from", "to", "total", "+-", "", "ends where", "box +-")
    report_object(settings)
    show_table(
        f"{settings.name}: range of each axis, {mode}", headings, rows, left_columns=(0, 5, 6)
    )
    print(f"  the box, all six axes at once, ends where: {cause_of(why)}\n")


def report_outline(settings: Config, rules: Rules, boundary: Boundary, grid: int) -> None:
    """Print one line about an outline: its size, its causes, and the result of its checks."""
    units = [core.units.unit_of(name) for name in boundary.axes]
    sizes = [
        f"{name} {unit.factor * size:.4g} {unit.unit}"
        for name, unit, size in zip(boundary.axes, units, boundary.extent, strict=True)
    ]
    outlines, sensor = characterization.outlines, settings.sensor
    states = outlines.states_inside(rules, boundary)
    right = outlines.count_correct_solutions(sensor, states)
    text = f"{' by '.join(sizes)}: {count_text(len(boundary.points), 'point')}; "
    text += f"{right} of {len(states)} poses inside solved from zero"
    if grid:
        differ = outlines.count_grid_differences(sensor, rules, boundary, grid)
        text += f"; {differ} of {grid * grid} grid points differ"
    print(text)
