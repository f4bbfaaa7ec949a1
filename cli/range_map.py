"""`facets range-map`: how far the sensor measures, and what ends its range."""

from __future__ import annotations

import time
from enum import StrEnum
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from facets import characterization, core, files, pictures

from .console import INTERRUPTED, load_config, name_files, show_table
from .options import (
    At,
    ConfigName,
    Force,
    Look,
    Plot,
    PlotKind,
    Point,
    Style,
    Table,
    TableKind,
    Track,
    folder_option,
    output_folder,
)
from .options.places import choose_point, displacement_at, object_rules, pair_of, report_object

if TYPE_CHECKING:
    from facets.characterization.outlines import Boundary
    from facets.config import Config
    from facets.core.rules import Rules
    from facets.core.units import Floats


class Inside(StrEnum):
    condition = "condition"
    tx = "tx"
    ty = "ty"
    tz = "tz"
    roll = "roll"
    pitch = "pitch"
    yaw = "yaw"


Axes = Annotated[
    list[str] | None,
    typer.Option(
        metavar="AXIS,AXIS",
        help="Pair of axes to trace the range over, such as tx,ty; can be repeated.  "
        "[default: all 15 pairs]",
    ),
]
Within = Annotated[
    Inside | None,
    typer.Option(
        help="Quantity to draw inside the outlines: the standard uncertainty of this axis, or the "
        "condition number of the Jacobian.  [default: none]"
    ),
]
Grid = Annotated[
    int,
    typer.Option(
        min=0,
        max=3000,
        help="Number of grid points per side for checking each outline; 0 skips the check.",
    ),
]


def range_map(
    config: ConfigName,
    axes: Axes = None,
    track: Track = False,
    at: At = None,
    inside: Within = None,
    grid: Grid = 0,
    folder: Annotated[Path | None, folder_option("results/CONFIG-range")] = None,
    force: Force = False,
    table: Table = TableKind.csv,
    plot: Plot = PlotKind.png,
    look: Style = Look.screen,
    point: Point = None,
) -> None:
    """Find the measurement range of each axis and what limits it.

    Prints the range of each axis and the largest box of poses with the same proportions. Traces the
    outline of the range over pairs of axes to 0.1 µm and 0.1 µrad. Writes a table of the outlines,
    a picture and a record of the run into the folder. Ctrl-C stops the tracing; the outlines traced
    until then are written, with exit status 130. With an object in the configuration or --point,
    the axes are those of the object's displacement from its pose at the mirror's zero.
    """
    start = time.perf_counter()
    settings = choose_point(load_config(config), point)
    rules = object_rules(settings, track)
    pairs = [pair_of(text) for text in axes] if axes else list(combinations(POSE_NAMES, 2))
    pose = displacement_at(settings, at)
    place = output_folder(folder, settings.name, "range")
    paths = [place / n for n in (f"outlines.{table.value}", f"range.{plot.value}", "run.yaml")]
    files.tables.refuse_to_overwrite(paths, force)
    report_axes(settings, rules, pose)
    boundaries = trace_all(settings, rules, pairs, pose)
    for boundary in boundaries:
        report(settings, rules, boundary, grid)
    with files.tables.ResultSet():
        write(settings, rules, boundaries, inside, paths, start)
    report_calls(boundaries, time.perf_counter() - start)
    name_files(place, paths)
    if len(boundaries) < len(pairs):
        raise typer.Exit(INTERRUPTED)


POSE_NAMES = tuple(name.value for name in Inside if name is not Inside.condition)


def write(
    settings: Config,
    rules: Rules,
    boundaries: list[Boundary],
    inside: Inside | None,
    paths: list[Path],
    start: float,
) -> None:
    """Write outlines, picture and record, in that order."""
    outlines, picture, record = paths
    files.tables.write_table(
        outlines,
        characterization.tables.outline_columns(boundaries),
        files.provenance.provenance_header(settings),
    )
    maps = (
        [
            characterization.outlines.map_inside(settings.sensor, rules, b, inside)
            for b in boundaries
        ]
        if inside
        else []
    )
    pictures.style.save(pictures.ranges.ranges_picture(boundaries, maps), picture)
    traced = {" ".join(boundary.axes): len(boundary.points) for boundary in boundaries}
    results = {"tracking": rules.tracking, "points": traced}
    seconds = time.perf_counter() - start
    files.provenance.write_record(record, settings, None, seconds, results, paths)


def report_calls(boundaries: list[Boundary], seconds: float) -> None:
    calls = sum(boundary.calls for boundary in boundaries)
    saved = sum(boundary.grid_calls for boundary in boundaries) / calls
    typer.echo(
        f"{calls} calls of the model, {saved:.1g} times fewer than grids of 0.1 µm and 0.1 µrad; "
        f"{seconds:.1f} s"
    )


def trace_all(settings: Config, rules: Rules, pairs: Any, pose: Floats) -> list[Boundary]:
    from rich.console import Console
    from rich.progress import track

    found = []
    shown = Console(stderr=True)
    try:
        for pair in track(pairs, "tracing", console=shown, transient=True, disable=len(pairs) < 2):
            found.append(characterization.outlines.trace(settings.sensor, rules, pair, pose))
    except KeyboardInterrupt:
        if not found:
            raise
        shown.print(f"interrupted: {len(found)} of {len(pairs)} outlines are done")
    return found


def report_axes(settings: Config, rules: Rules, pose: Floats) -> None:
    """Print the range of each axis, and the largest box with these proportions."""
    import numpy as np

    found = characterization.ranges.axis_ranges(settings.sensor, rules, pose)
    sizes = np.array([max(axis.symmetric / 2, 1e-12) for axis in found])
    sides, why = characterization.ranges.largest_box(settings.sensor, rules, pose, sizes)
    rows = []
    for axis, side in zip(found, sides, strict=True):
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


def report(settings: Config, rules: Rules, boundary: Boundary, grid: int) -> None:
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
