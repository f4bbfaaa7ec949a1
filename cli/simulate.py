"""`facets simulate`: a configured sensor put through its motions."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from facets import config as configuration, estimation, pictures, simulation

from .console import FINDING, draw_extra, load_config, report_lines
from .options import (
    ConfigName,
    Covariance,
    Force,
    Look,
    Plot,
    PlotKind,
    Point,
    Style,
    Table,
    TableKind,
    Track,
    WithReference,
    Zero,
    folder_option,
    motion_option,
    output_folder,
    seed_option,
)
from .options.places import choose_point, zero_of
from .results import ResultFolder
from .sentences.simulation import print_segment

if TYPE_CHECKING:
    from facets.simulation.run import Segment


Motions = Annotated[
    list[str] | None,
    motion_option("only this one is simulated; can be repeated", "all motions"),
]
Seed = Annotated[int | None, seed_option("the configuration's")]
Noise = Annotated[
    bool | None,
    typer.Option(
        "--noise/--no-noise",
        help="Simulate readings with or without noise.  [default: as each motion says]",
    ),
]


def simulate(
    config: ConfigName,
    folder: Annotated[Path | None, folder_option("results/CONFIG")] = None,
    force: Force = False,
    motion: Motions = None,
    seed: Seed = None,
    noise: Noise = None,
    track: Track = False,
    with_reference: WithReference = False,
    table: Table = TableKind.csv,
    plot: Plot = PlotKind.png,
    look: Style = Look.screen,
    point: Point = None,
    zero: Zero = None,
    covariance: Covariance = False,
) -> None:
    """Simulate a configuration's motions and report pose errors.

        facets simulate paper
        facets simulate rig --motion calibration --with-reference -d run

    Simulates the readings along each motion, with noise, and solves them for poses. Writes a table
    of readings (the input of `facets solve`), a table of poses, a picture and a record of the run
    into the folder. With --track the stage of the configuration moves the beam. With an object in
    the configuration or --point, the errors of its pose are reported, too; with --zero the table of
    poses has the displacements from the zero of each motion. Exit status 1 if no sample of a motion
    could be solved.
    """
    settings, request = choose_point(load_config(config), point), zero_of(zero)
    names = [f"readings.{table.value}", f"poses.{table.value}", f"motion.{plot.value}", "run.yaml"]
    sources = [*configuration.source_files(settings), request.file if request else None]
    results = ResultFolder(output_folder(folder, settings.name), names, force, sources)
    columns = estimation.PoseColumns(request, covariance)
    segments = simulation.run.simulate(settings, motion or [], noise, seed, track, columns)
    drawn = settings.seed if seed is None else seed
    with results.publish(settings, drawn, zero_entry(segments)):
        write(results, segments, with_reference)
    for segment in segments:
        print_segment(segment, settings.object)
        for sentence in segment.measurement.zero_sentences():
            report_lines(sentence)
        print()
    for sentence in segments[0].measurement.tally.sentences(settings):
        report_lines(sentence)
    results.name()
    if not all(segment.solution.converged.any() for segment in segments):
        raise typer.Exit(FINDING)


def write(results: ResultFolder, segments: list[Segment], with_reference: bool) -> None:
    settings, about = results.settings, results.about
    columns = simulation.run.reading_table(segments)
    if with_reference:
        columns |= simulation.run.reference_table(
            segments, settings.calibrate.reference, int(about["seed"])
        )
    readings, poses, picture, _ = results.paths
    results.write_table(readings, columns)
    results.write_table(poses, simulation.run.pose_table(segments))
    draw_extra(picture, pictures.motion.motion_picture, segments)
    for segment in segments:
        commands = results.folder / f"commands-{segment.name}.csv"
        simulation.axis_runs.write_commands(commands, settings.motions[segment.name], about)
    entries: dict[str, Any] = {key: about[key] for key in ("zero",) if key in about}
    entries |= {segment.name: simulation.run.statuses(segment) for segment in segments}
    results.write_record(entries)


def zero_entry(segments: list[Segment]) -> dict[str, str]:
    """The zeros of the motions for the head of the tables."""
    texts = dict.fromkeys(segment.measurement.zero_text for segment in segments)
    return {"zero": "; ".join(texts)} if any(texts) else {}
