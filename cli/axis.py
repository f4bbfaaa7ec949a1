"""`facets axis`: error motions of a linear or rotary axis."""

from __future__ import annotations

import time
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import facets
from facets import characterization, core, files, live, pictures
from facets.core.errors import InputError

from .console import FINDING, name_files, show_table
from .options import ConfigOption, Force, Look, Plot, PlotKind, Point, Style, folder_option
from .options.places import choose_point
from .parts.recordings import solve_recording
from .sentences.calibration import wrap

if TYPE_CHECKING:
    from facets.characterization.axis_report import AxisReport
    from facets.characterization.axis_visits import PoseSeries
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
        "columns time_s, tx_mm ... yaw_mrad, CSV or Parquet, such as `facets solve` writes.",
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
        help="Table of the commanded positions in their order, one row for each stand: the column "
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
        help="Shortest time for which the axis stands still at a position, s.",
    ),
]


@dataclass(frozen=True)
class AxisFiles:
    """Paths of the results."""

    folder: Path
    positions: Path
    quantities: Path
    compensation: Path
    picture: Path
    page: Path
    record: Path

    @property
    def all(self) -> list[Path]:
        return [
            self.page, self.picture, self.positions, self.quantities, self.compensation,
            self.record,
        ]  # fmt: skip


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

    Finds the times at which the axis stood still, assigns them to the commanded positions, and
    computes positioning, straightness and angular errors (ISO 230-1: EXX, EYX ... ECX) at each
    position. Repeated runs in both directions give the reversal error B, the repeatability R, the
    systematic error E and the accuracy A of ISO 230-2, each with its expanded uncertainty by the
    sensor. Writes a page, a picture, tables by position and of all quantities, a compensation table
    for controllers, and a record of the run into the folder. Stands that are far off and drift are
    named, with the quantities without them; the compensation leaves both out. A table of poses
    needs --config. Exit status 1, and no compensation table, if the axis was not found at some
    commanded positions.
    """
    start = time.perf_counter()
    paths = files_of(folder or Path("results") / f"axis-{axis.value}", plot)
    files.tables.refuse_to_overwrite(paths.all, force, [poses, commands])
    told = (
        characterization.axis_visits.read_commands(commands, axis.value)
        if commands is not None
        else None
    )
    settings, series = read_poses(poses, config, point)
    report = characterization.axis_report.evaluate_axis(
        settings.sensor,
        settings.solve.knowledge(settings.sensor),
        series,
        axis.value,
        told,
        settings.object,
        line.value,
        dwell,
    )
    with files.tables.ResultSet():
        write(report, settings, paths, f"Axis {axis.value} of {poses.name}", start)
    show(report)
    name_files(paths.folder, paths.all)
    if report.counts.missing:
        raise typer.Exit(FINDING)


def files_of(folder: Path, plot: PlotKind) -> AxisFiles:
    names = ("positions.csv", "quantities.csv", "compensation.csv", f"axis.{plot.value}")
    return AxisFiles(folder, *(folder / name for name in (*names, "axis.html", "run.yaml")))


def read_poses(source: Path, config: str | None, point: str | None) -> tuple[Config, PoseSeries]:
    """Solve a recording, or read a table of poses; the configuration has the point."""
    if source.is_dir():
        playback = live.Playback(source, facets.load(config) if config else None)
        settings = choose_point(playback.config, point)
        columns = solve_recording(playback)
        if not columns:
            raise InputError(f"{source}: no samples")
        return settings, characterization.axis_visits.recorded_series(columns)
    if config is None:
        raise InputError(
            f"{source}: is a table of poses; give the configuration of the sensor that measured "
            "them with --config, from which their uncertainties follow"
        )
    settings = choose_point(facets.load(config), point)
    return settings, characterization.axis_visits.read_series(source)


def write(report: AxisReport, settings: Config, paths: AxisFiles, title: str, start: float) -> None:
    """Write the results; the record comes last, because it states the duration."""
    about = files.provenance.provenance_header(settings)
    files.tables.write_table(paths.positions, report.table(), about)
    files.tables.write_table(paths.quantities, report.summary(), about)
    pictures.style.save(pictures.axis.axis_picture(report), paths.picture)
    texts = {paths.page: pictures.axis.axis_page(report, title, about)}
    if report.counts.missing:
        files.whole.remove_older(paths.compensation)
    else:
        texts[paths.compensation] = report.compensation()
    for path, text in texts.items():
        with files.whole.Whole(path) as temporary:
            temporary.write_text(text, "utf-8")
    seconds = time.perf_counter() - start
    files.provenance.write_record(paths.record, settings, None, seconds, report.record(), paths.all)


def show(report: AxisReport) -> None:
    """Print the quantities of the axis, the range of each error motion, and the notes."""
    motions = report.motions
    unit, scale = report.units(motions.main)
    rows = [
        (
            q.name,
            q.symbol,
            *pictures.axis.value_cells(scale * q.value, scale * q.expanded),
            core.units.write_micro(unit),
        )
        for q in report.quantities[motions.main]
    ]
    title = (
        f"{motions.names[motions.main]}: {len(report.visits.target)} stands at "
        f"{len(motions.targets)} positions; U: expanded uncertainty by the sensor (k = 2)"
    )
    show_table(title, ("quantity", "", "value", "U", ""), rows, left=(0, 1, 4))
    heads = ("error", "", "range", "U", "reversal", "U")
    show_table("", heads, pictures.axis.other_rows(report), left=(0, 1))
    for note in filter(None, (report.alignment(), *report.notes())):
        typer.echo(wrap(f"- {note}"))
