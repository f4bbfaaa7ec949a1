"""`facets range-map`: how far the sensor measures, and what ends its range."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from enum import StrEnum
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .simulate import PlotKind, TableKind

if TYPE_CHECKING:
    from facets.characterization.ranges import Boundary
    from facets.config import Config
    from facets.core.rules import Rules


class Inside(StrEnum):
    condition = "condition"
    tx = "tx"
    ty = "ty"
    tz = "tz"
    roll = "roll"
    pitch = "pitch"
    yaw = "yaw"


def range_map(
    config: Annotated[str, typer.Argument(help="Name of a shipped config, or a YAML file.")],
    axes: Annotated[
        list[str] | None,
        typer.Option(help="Pair of axes, as tx,ty; may be given again.  [default: all 15]"),
    ] = None,
    tracking: Annotated[
        bool, typer.Option("--tracking/--fixed", help="Whether the beam follows in x and y.")
    ] = False,
    at: Annotated[
        str | None, typer.Option(help="Where the other axes stand: tz_mm=1,yaw_mrad=2.")
    ] = None,
    inside: Annotated[
        Inside | None, typer.Option(help="Map this inside: an axis's uncertainty, or condition.")
    ] = None,
    grid: Annotated[
        int, typer.Option(min=0, max=3000, help="Check against a grid of so many points a side.")
    ] = 0,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", help="Folder for the results.  [default: results/CONFIG-range]"
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace older results.")] = False,
    table: Annotated[TableKind, typer.Option(help="Kind of the table.")] = TableKind.csv,
    plot: Annotated[PlotKind, typer.Option(help="Kind of the picture.")] = PlotKind.png,
) -> None:
    """Map measurement ranges and name their limits.

    Prints the range of each axis and the largest box in their proportion, and traces the range over
    pairs of axes to 0.1 um and 0.1 urad. Writes the outlines as a table, and a picture. Ctrl-C
    leaves the outlines that are done.
    """
    import time

    import numpy as np

    from facets import load
    from facets.characterization.ranges import inside_map
    from facets.core.names import POSE
    from facets.files import provenance, tables
    from facets.pictures import ranges, style

    start = time.perf_counter()
    settings = load(config)
    rules = replace(settings.range, tracking=tracking)
    pairs = [pair_of(text) for text in axes] if axes else list(combinations(POSE, 2))
    pose = pose_of(at)
    folder = output or Path("results") / f"{settings.name}-range"
    outlines, picture = folder / f"outlines.{table.value}", folder / f"range.{plot.value}"
    story = folder / "run.yaml"
    tables.refuse_to_overwrite([outlines, picture, story], force)
    report_axes(settings, rules, pose)
    boundaries = trace_all(settings, rules, pairs, pose)
    what = inside.value if inside else None
    drawn = [inside_map(settings.sensor, rules, b, what) for b in boundaries] if what else []
    for boundary in boundaries:
        report(settings, rules, boundary, grid)
    tables.write_table(outlines, outline_columns(boundaries), provenance.about(settings))
    style.save(ranges.ranges_picture(boundaries, drawn), picture)
    calls = sum(boundary.calls for boundary in boundaries)
    saved = np.sum([boundary.grid_calls for boundary in boundaries]) / calls
    seconds = time.perf_counter() - start
    traced = {" ".join(boundary.axes): len(boundary.points) for boundary in boundaries}
    provenance.write_record(
        story, settings, None, seconds, {"tracking": tracking, "points": traced}
    )
    typer.echo(
        f"{calls} calls of the model, {saved:.1g} times fewer than grids of 0.1 um and 0.1 urad; "
        f"{seconds:.1f} s\n{folder}/: {outlines.name}, {picture.name}, {story.name}"
    )


def pair_of(text: str) -> tuple[str, str]:
    from facets.core.errors import InputError
    from facets.core.names import POSE

    names = [name.strip() for name in text.split(",")]
    if len(names) != 2 or len(set(names)) != 2 or not set(names) <= set(POSE):
        raise InputError(f"--axes is {text!r}; allowed: two of {', '.join(POSE)}, as tx,ty")
    return names[0], names[1]


def pose_of(text: str | None) -> Any:
    """'tz_mm=1,yaw_mrad=2' as a pose (6,), mm and rad."""
    import numpy as np

    from facets.core.names import STATE_COLUMNS

    return np.array(numbers_at(text, STATE_COLUMNS[:6]))


def numbers_at(text: str | None, names: Sequence[str]) -> list[float]:
    """NAME=NUMBER,... in the order of the names, mm and rad; zero where a name is left out."""
    from math import isfinite

    from facets.core.errors import InputError
    from facets.core.names import STATE_UNITS

    found = [0.0] * len(names)
    for part in text.split(",") if text else []:
        name, _, value = part.partition("=")
        try:
            number = names.index(name.strip())
            found[number] = float(value) * STATE_UNITS[number]
        except ValueError:
            may = ", ".join(names)
            raise InputError(f"--at has {part.strip()!r}; allowed: NAME=NUMBER, of {may}") from None
        if not isfinite(found[number]):
            raise InputError(f"--at has {part.strip()!r}; allowed: finite numbers")
    return found


def trace_all(settings: Config, rules: Rules, pairs: Any, pose: Any) -> list[Boundary]:
    from rich.console import Console
    from rich.progress import track

    from facets.characterization.ranges import trace

    found = []
    shown = Console(stderr=True)
    try:
        for pair in track(pairs, "tracing", console=shown, transient=True, disable=len(pairs) < 2):
            found.append(trace(settings.sensor, rules, pair, pose))
    except KeyboardInterrupt:
        if not found:
            raise
        shown.print(f"interrupted: {len(found)} of {len(pairs)} outlines are done")
    return found


def report_axes(settings: Config, rules: Rules, pose: Any) -> None:
    """The range of each axis, and the largest box in proportion to them."""
    import numpy as np
    from rich.console import Console
    from rich.table import Table

    from facets.characterization.ranges import CAUSES, axis_ranges, box
    from facets.pictures.style import unit_of

    mode = "beam follows in x and y" if rules.tracking else "beam fixed"
    table = Table(title=f"{settings.name}: range of each axis, {mode}", box=None)
    table.title_justify, table.title_style = "left", "bold"
    for heading in ("axis", "from", "to", "total", "+-", "", "ends where", "box +-"):
        left = heading in ("axis", "", "ends where")
        table.add_column(heading, justify="left" if left else "right", no_wrap=True)
    found = axis_ranges(settings.sensor, rules, pose)
    sizes = np.array([max(axis.symmetric / 2, 1e-12) for axis in found])
    sides, why = box(settings.sensor, rules, pose, sizes)
    for axis, side in zip(found, sides, strict=True):
        unit, factor, _, _ = unit_of(axis.name)
        causes = {CAUSES[c] if c >= 0 else "nowhere" for c in (axis.low_cause, axis.high_cause)}
        numbers = (axis.low, axis.high, axis.total, axis.symmetric / 2)
        shown = [f"{factor * number:.4g}" for number in numbers]
        table.add_row(axis.name, *shown, unit, ", ".join(sorted(causes)), f"{factor * side:.4g}")
    console = Console(highlight=False)
    console.print(table)
    console.print(f"  the box, all six axes at once, ends where: {CAUSES[why]}\n")


def report(settings: Config, rules: Rules, boundary: Boundary, grid: int) -> None:
    """One line about an outline: its size, its causes, and how it stood its checks."""
    import numpy as np

    from facets.characterization import ranges
    from facets.pictures.style import unit_of

    sizes = [
        f"{name} {unit_of(name)[1] * size:.4g} {unit_of(name)[0]}"
        for name, size in zip(boundary.axes, boundary.extent, strict=True)
    ]
    tried, right = ranges.solved(settings.sensor, rules, boundary)
    text = f"{sizes[0]} by {sizes[1]}: {len(boundary.points)} points; "
    text += f"{right} of {tried} poses inside solved from zero"
    if grid:
        x, y, cause = ranges.grid(settings.sensor, rules, boundary, grid)
        points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        differ = int((ranges.inside(boundary, points) != (cause.ravel() < 0)).sum())
        text += f"; {differ} of {grid * grid} grid points differ"
    typer.echo(text)


def outline_columns(boundaries: list[Boundary]) -> dict[str, Any]:
    """The outlines as columns; places in the units of their names' axes."""
    import numpy as np

    from facets.characterization.ranges import CAUSES
    from facets.pictures.style import unit_of

    keys = ("axis_1", "axis_2", "value_1", "value_2", "ends_where")
    rows: dict[str, list[Any]] = {key: [] for key in keys}
    for boundary in boundaries:
        factors = [unit_of(name)[1] for name in boundary.axes]
        names = [f"{name}_{unit_of(name)[0]}" for name in boundary.axes]
        for point, cause in zip(boundary.points * factors, boundary.causes, strict=True):
            values = (*names, *point, CAUSES[cause] if cause >= 0 else "nowhere")
            for key, value in zip(rows, values, strict=True):
                rows[key].append(value)
    return {key: np.array(column) for key, column in rows.items()}
