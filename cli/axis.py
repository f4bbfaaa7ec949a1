"""`facets axis`: error motions of a linear or rotary axis."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import facets
from facets import axis_tests, core, files, live, pictures
from facets.core.errors import InputError

from .console import FINDING, draw_extra
from .options import ConfigOption, Force, Look, Plot, PlotKind, Point, Style, folder_option
from .options.places import choose_point
from .parts.recordings import solve_recording
from .results import ResultFolder
from .sentences.axis import show

if TYPE_CHECKING:
    from facets.axis_tests.report import AxisReport
    from facets.axis_tests.visits import PoseSeries
    from facets.config import Config


class AxisName(StrEnum):
    X = "X"
    Y = "Y"
    Z = "Z"
    A = "A"
    B = "B"
    C = "C"


class ReferenceChoice(StrEnum):
    least_squares = "least-squares"
    end_points = "end-points"
    nominal = "nominal"


Source = Annotated[
    Path,
    typer.Argument(
        metavar="POSES",
        help="Recording (a folder written by `facets acquire`), or a table of poses with the "
        "columns time_s, tx_mm ... yaw_mrad, CSV, Parquet or HDF5, such as `facets solve` writes.",
    ),
]
Axis = Annotated[
    AxisName,
    typer.Option(
        "--axis",
        help="Name of the axis under test: X, Y or Z if it moves along this axis of the object, "
        "A, B or C if it rotates about X, Y or Z.",
    ),
]
CommandTable = Annotated[
    Path | None,
    typer.Option(
        "--commands",
        metavar="FILE",
        help="Table of the commanded positions in their order, one row for each dwell: the column "
        "position_mm or position_um (position_deg, position_mrad or position_urad), and optionally "
        "direction (1 or -1).  [default: equally spaced positions are found]",
    ),
]
LineOption = Annotated[
    ReferenceChoice,
    typer.Option(
        "--line",
        help="Line from which straightness, or the tilt of a rotary axis, is measured: by least "
        "squares, through the means at the first and the last position, or the object's axis "
        "(nominal). Positioning is always measured along the axis itself.",
    ),
]
Dwell = Annotated[
    float,
    typer.Option(
        "--dwell",
        min=1e-3,
        max=1e5,
        help="Shortest dwell of the axis at a position, s.",
    ),
]


def axis(
    poses: Source,
    axis: Axis,
    commands: CommandTable = None,
    config: ConfigOption = None,
    folder: Annotated[Path | None, folder_option("results/axis-NAME")] = None,
    point: Point = None,
    line: LineOption = ReferenceChoice.least_squares,
    dwell: Dwell = 0.2,
    force: Force = False,
    plot: Plot = PlotKind.png,
    look: Style = Look.screen,
) -> None:
    """Measure the error motions of a linear or rotary axis.

        facets axis recordings/run --axis X --commands commands.csv

    Finds the dwells of the axis, assigns them to the commanded positions, and
    computes positioning, straightness and angular errors (ISO 230-1: EXX, EYX ... ECX) at each
    position. Repeated runs in both directions give the reversal error B, the repeatability R, the
    systematic error E and the accuracy A of ISO 230-2, each with its expanded uncertainty by the
    sensor. Writes a page, a picture, tables by position and of all quantities, a compensation table
    for controllers, and a record of the run into the folder. Outlying dwells and drift are
    reported, with the quantities without them, and excluded from the compensation. A table of poses
    needs --config. Exit status 1, and no compensation table, if the axis was not found at some
    commanded positions.
    """
    tables = ("positions.csv", "quantities.csv", "compensation.csv")
    names = ["axis.html", f"axis.{plot.value}", *tables, "run.yaml"]
    place = folder or Path("results") / f"axis-{axis.value}"
    results = ResultFolder(place, names, force, [poses, commands])
    commanded = (
        axis_tests.visits.read_commands(commands, axis.value) if commands is not None else None
    )
    settings, series = read_poses(poses, config, point)
    report = axis_tests.report.evaluate_axis(
        settings.sensor,
        settings.solve.knowledge(settings.sensor),
        series,
        axis_tests.error_motions.AxisTest(
            axis.value,
            commanded,
            settings.object or core.rigid_body.MIRROR,
            line.value,
            dwell,
        ),
    )
    with results.publish(settings):
        write(report, results, f"Axis {axis.value} of {poses.name}")
    show(report)
    results.name()
    if report.counts.missing:
        raise typer.Exit(FINDING)


def read_poses(source: Path, config: str | None, point: str | None) -> tuple[Config, PoseSeries]:
    """Solve a recording, or read a table of poses; the configuration has the point."""
    if source.is_dir():
        playback = live.Playback(source, facets.load(config) if config else None)
        settings = choose_point(playback.config, point)
        columns = solve_recording(playback)
        if not columns:
            raise InputError(f"{source}: no samples")
        return settings, axis_tests.visits.series_of_columns(columns)
    files.tables.require_table(source)
    if config is None:
        raise InputError(
            f"{source}: a table of poses needs --config, the configuration of the sensor that "
            "measured them, from which their uncertainties follow"
        )
    settings = choose_point(facets.load(config), point)
    return settings, axis_tests.visits.read_series(source)


def write(report: AxisReport, results: ResultFolder, title: str) -> None:
    page, picture, positions, quantities, compensation, _ = results.paths
    results.write_table(positions, report.table())
    results.write_table(quantities, report.summary())
    draw_extra(picture, pictures.axis.axis_picture, report)
    draw_extra(page, pictures.axis.axis_page, report, title, results.about)
    if report.counts.missing:
        files.whole.remove_older(compensation)
    else:
        files.whole.write_text(compensation, report.compensation())
    results.write_record(report.record())
