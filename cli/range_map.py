"""`facets range-map`: how far the sensor measures, and what ends its range."""

from __future__ import annotations

import sys
from enum import StrEnum
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from facets import characterization, pictures
from facets.core.names import POSE

from .console import INTERRUPTED, draw_extra, load_config, track
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
from .options.places import choose_point, displacement_at, object_rules, pair_of
from .results import ResultFolder
from .sentences.ranges import report_axes, report_outline

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

        facets range-map paper
        facets range-map paper --axes tx,ty --inside yaw --track

    Prints the range of each axis and the largest box of poses with the same proportions. Traces the
    outline of the range over pairs of axes to 0.1 µm and 0.1 µrad. Writes a table of the outlines,
    a picture and a record of the run into the folder. Ctrl-C stops the tracing; the outlines traced
    until then are written, with exit status 130. With an object in the configuration or --point,
    the axes are those of the object's displacement from its pose at the mirror's zero.
    """
    settings = choose_point(load_config(config), point)
    rules = object_rules(settings, track)
    pairs = [pair_of(text) for text in axes] if axes else list(combinations(POSE, 2))
    pose = displacement_at(settings, at)
    names = [f"outlines.{table.value}", f"range.{plot.value}", "run.yaml"]
    results = ResultFolder(output_folder(folder, settings.name, "range"), names, force)
    report_axes(settings, rules, pose)
    boundaries = trace_all(settings, rules, pairs, pose)
    for boundary in boundaries:
        report_outline(settings, rules, boundary, grid)
    with results.publish(settings) as (outlines, picture, _):
        results.write_table(outlines, characterization.tables.outline_columns(boundaries))
        maps = [
            characterization.outlines.map_inside(settings.sensor, rules, boundary, inside)
            for boundary in boundaries
            if inside
        ]
        draw_extra(picture, pictures.ranges.ranges_picture, boundaries, maps, inside or "")
        traced = {" ".join(boundary.axes): len(boundary.points) for boundary in boundaries}
        results.write_record({"tracking": rules.tracking, "points": traced})
    results.name()
    if len(boundaries) < len(pairs):
        raise typer.Exit(INTERRUPTED)


def trace_all(settings: Config, rules: Rules, pairs: Any, pose: Floats) -> list[Boundary]:
    outlines = []
    try:
        for pair in track(pairs, "tracing", len(pairs)):
            outlines.append(characterization.outlines.trace(settings.sensor, rules, pair, pose))
    except KeyboardInterrupt:
        if not outlines:
            raise
        print(f"interrupted: {len(outlines)} of {len(pairs)} outlines are done", file=sys.stderr)
    return outlines
