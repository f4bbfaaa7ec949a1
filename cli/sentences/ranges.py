"""What `facets range-map` prints: the range of each axis, and a line for each outline."""

from __future__ import annotations

from typing import TYPE_CHECKING

import typer

from facets import characterization, core
from facets.core.plain_numbers import short_number

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
    rows = []
    for axis, side in zip(ranges, sides, strict=True):
        unit = core.units.unit_of(axis.name)
        causes = sorted(
            {
                characterization.tables.cause_of(axis.low_cause),
                characterization.tables.cause_of(axis.high_cause),
            }
        )
        numbers = (axis.low, axis.high, axis.total, axis.symmetric / 2)
        cells = [f"{unit.factor * number:.4g}" for number in numbers]
        rows.append([axis.name, *cells, unit.unit, ", ".join(causes), f"{unit.factor * side:.4g}"])
    mode = "beam follows in x and y" if rules.tracking else "beam fixed"
    headings = ("axis", "from", "to", "total", "+-", "", "ends where", "box +-")
    report_object(settings)
    show_table(f"{settings.name}: range of each axis, {mode}", headings, rows, left=(0, 5, 6))
    typer.echo(
        f"  the box, all six axes at once, ends where: {characterization.tables.cause_of(why)}\n"
    )


def report_outline(settings: Config, rules: Rules, boundary: Boundary, grid: int) -> None:
    """Print one line about an outline: its size, its causes, and the result of its checks."""
    import numpy as np

    sizes = [
        f"{name} {core.units.unit_of(name).factor * size:.4g} {core.units.unit_of(name).unit}"
        for name, size in zip(boundary.axes, boundary.extent, strict=True)
    ]
    tried, right = characterization.outlines.count_correct_solutions(
        settings.sensor, rules, boundary
    )
    text = f"{sizes[0]} by {sizes[1]}: {len(boundary.points)} points; "
    text += f"{right} of {tried} poses inside solved from zero"
    if grid:
        x, y, cause = characterization.outlines.cause_grid(settings.sensor, rules, boundary, grid)
        points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        differ = int(
            (characterization.outlines.encloses(boundary, points) != (cause.ravel() < 0)).sum()
        )
        text += f"; {differ} of {grid * grid} grid points differ"
    typer.echo(text)


def report_calls(boundaries: list[Boundary], seconds: float) -> None:
    calls = sum(boundary.calls for boundary in boundaries)
    saved = sum(boundary.grid_calls for boundary in boundaries) / calls
    typer.echo(
        f"{calls} calls of the model, {short_number(saved, 1)} times fewer than grids of 0.1 µm "
        f"and 0.1 µrad; {seconds:.1f} s"
    )
