"""`facets simulate`: a configured sensor put through its motions."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from rich.console import Console

    from facets.simulation.run import Segment


class TableKind(StrEnum):
    csv = "csv"
    parquet = "parquet"


class PlotKind(StrEnum):
    png = "png"
    svg = "svg"
    pdf = "pdf"


def simulate(
    config: Annotated[str, typer.Argument(help="Name of a shipped config, or a YAML file.")],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="Folder for the results.  [default: results/CONFIG]"),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace older results.")] = False,
    motion: Annotated[
        list[str] | None, typer.Option(help="Run this motion only; may be given again.")
    ] = None,
    seed: Annotated[
        int | None, typer.Option(min=0, help="Of the noise.  [default: the config's]")
    ] = None,
    noise: Annotated[
        bool | None, typer.Option("--noise/--no-noise", help="[default: the config's]")
    ] = None,
    track: Annotated[
        bool, typer.Option("--track", help="The config's stage carries the beam after the mirror.")
    ] = False,
    reference: Annotated[
        bool,
        typer.Option("--reference", help="Beside the readings, what a reference says."),
    ] = False,
    table: Annotated[TableKind, typer.Option(help="Kind of the tables.")] = TableKind.csv,
    plot: Annotated[PlotKind, typer.Option(help="Kind of the picture.")] = PlotKind.png,
) -> None:
    """Simulate a config's motions and report the errors.

    Moves the mirror, reads the detectors with noise, and solves the readings. Writes readings,
    poses, a picture and a record of the run. The readings are what `facets solve` takes.
    """
    import time

    from facets import load
    from facets.files import provenance, tables
    from facets.pictures import style
    from facets.simulation import run as study

    start = time.perf_counter()
    settings = load(config)
    folder = output or Path("results") / settings.name
    readings, poses = folder / f"readings.{table.value}", folder / f"poses.{table.value}"
    picture, story = folder / f"motion.{plot.value}", folder / "run.yaml"
    tables.refuse_to_overwrite([readings, poses, picture, story], force)
    segments = study.simulate(settings, motion or [], noise, seed, track)
    drawn = settings.seed if seed is None else seed
    about = provenance.about(settings, drawn)
    columns = study.reading_table(segments)
    if reference:
        columns |= study.reference_columns(segments, settings.calibrate.reference, drawn)
    tables.write_table(readings, columns, about)
    tables.write_table(poses, study.pose_table(segments), about)
    style.save(style.motion_picture(segments), picture)
    seconds = time.perf_counter() - start
    results = {segment.name: study.statuses(segment) for segment in segments}
    provenance.write_record(story, settings, drawn, seconds, results)
    report(segments)
    typer.echo(f"{folder}/: {readings.name}, {poses.name}, {picture.name}, {story.name}")


def report(segments: list[Segment]) -> None:
    from rich.console import Console

    console = Console(highlight=False)
    for segment in segments:
        print_segment(console, segment)


def print_segment(console: Console, segment: Segment) -> None:
    """Errors of one motion by axis, then what became of its samples."""
    from rich.table import Table

    from facets.pictures.style import unit_of
    from facets.simulation.run import axes

    table = Table(title=segment.name, title_justify="left", title_style="bold", box=None)
    for heading in ("axis", "moved from", "to", "", "max error", "RMS error", "u (1 sigma)", ""):
        table.add_column(heading, justify="left" if heading in ("axis", "") else "right")
    for axis in axes(segment):
        unit, factor, fine_unit, fine = unit_of(axis.name)
        moved = (f"{factor * axis.low:.4g}", f"{factor * axis.high:.4g}", unit)
        errors = [f"{fine * e:.3g}" for e in (axis.largest, axis.rms, axis.uncertainty)]
        table.add_row(axis.name, *(moved if axis.moved else ("", "", "")), *errors, fine_unit)
    console.print(table)
    console.print(outcome(segment) + "\n")


def outcome(segment: Segment) -> str:
    """Samples by status, spots that missed their detector, and the largest cross-axis error."""
    from facets.pictures.style import unit_of
    from facets.simulation.run import axes, statuses

    counts = ", ".join(f"{count} {label}" for label, count in statuses(segment).items())
    text = f"  {len(segment.time)} samples: {counts}"
    beside = (~segment.reached).sum(axis=0)
    for letter, count in zip("ABC", beside, strict=True):
        if count:
            text += f"\n  {count} samples without PSD {letter}: the spot fell beside it"
    still = [axis for axis in axes(segment) if not axis.moved and axis.largest == axis.largest]
    for kind in ("µm", "µrad"):
        group = [axis for axis in still if unit_of(axis.name)[2] == kind]
        if group and len(still) < 6:
            worst = max(group, key=lambda axis: axis.largest)
            error = worst.largest * unit_of(worst.name)[3]
            text += f"\n  largest cross-axis error: {error:.3g} {kind} in {worst.name}"
    return text
