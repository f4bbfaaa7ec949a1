"""`facets noise`: what a recording says of the noise of its bench."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .console import FINDING, with_progress
from .options import ConfigOption, Force, Look, RecordingName, Style, folder_option, write_option

if TYPE_CHECKING:
    from collections.abc import Callable

    from facets.characterization.noise_report import NoiseReport
    from facets.characterization.rest import Columns
    from facets.config import Config


def noise(
    recording: RecordingName,
    config: ConfigOption = None,
    folder: Annotated[Path | None, folder_option("none are written")] = None,
    write: Annotated[Path | None, write_option("the noise of this bench")] = None,
    force: Force = False,
    look: Style = Look.screen,
) -> None:
    """Estimate the noise of a bench from a recording of a mirror at rest.

    Estimates white and flicker noise, mains and other lines, drift and spikes of every reading and
    every pose coordinate, each with its 95 % interval, and compares them with the noise in the
    configuration. --folder writes the report noise.html and the table noise.csv. --write writes the
    configuration with the estimated noise, so that stated uncertainties are those of this bench.

    If the mirror moved or drifted, or if detectors were saturated or dark, the recording does not
    show the noise: the command says why, writes nothing and ends with exit status 1.
    """
    from facets import load
    from facets.characterization.noise_report import noise_block, report_of, table_of
    from facets.characterization.rest import reading_faults
    from facets.core.errors import InputError
    from facets.files import provenance, tables, whole
    from facets.live.recording.reader import meta_of
    from facets.live.recording.replay import recorded_config

    from .replay import tell as tell_replay

    meta_of(recording, own=config is None)
    if write and write.suffix.lower() not in (".yaml", ".yml"):
        raise InputError(f"{write}: a configuration's name ends in .yaml or .yml")
    settings = load(config) if config else recorded_config(recording)
    files = [folder / "noise.html", folder / "noise.csv"] if folder else []
    tables.refuse_to_overwrite([*files, *([write] if write else [])], force)
    columns = solved(recording, settings, tell_replay)
    faults = reading_faults(columns, settings) if columns else []
    if faults:
        refuse(recording, faults, files, write)
    reports: list[NoiseReport] = []
    with_progress(
        lambda done: reports.append(report_of(columns, settings, str(recording), done)),
        "analysing the noise",
    )
    report = reports[0]
    tell(report)
    if report.faults and write:
        refuse(recording, report.faults, files, write)
    about = provenance.about(settings)
    with tables.ResultSet():
        if folder:
            from facets.pictures.noise import page

            text = page(report, f"Noise of {recording.name}", about)
            with whole.Whole(files[0]) as temporary:
                temporary.write_text(text, "utf-8")
            tables.write_table(files[1], table_of(report), about)
        if write:
            block = noise_block(report, settings.resolved)
            with whole.Whole(write) as temporary:
                temporary.write_text(provenance.configuration(settings, block, about), "utf-8")
    if folder:
        typer.echo(f"{folder}/")
    if report.faults:
        refuse(recording, report.faults, [], None)
    if write:
        typer.echo(f"{write}")


def solved(recording: Path, settings: Config, tell_replay: Callable[..., None]) -> Columns:
    """The poses of a recording as columns, with a bar; says what of it is damaged."""
    from facets.live.recording.index import Damage
    from facets.live.recording.pose_table import join_columns, pose_columns
    from facets.live.recording.replay import replay
    from facets.live.run.pipeline import Pipeline

    pipeline, damage, parts = Pipeline(settings), Damage(), []

    def run(done: Callable[[int, int], None]) -> None:
        for poses in replay(recording, pipeline, damage=damage, tell=done):
            parts.append(pose_columns(poses))

    with_progress(run, "solving the recording")
    if damage.words or pipeline.parser.corrupt or pipeline.sequence.lost:
        tell_replay(pipeline, recording, damage)
    return join_columns(parts) if parts else {}


def refuse(recording: Path, faults: list[str], files: list[Path], write: Path | None) -> None:
    """Says why a recording is none of noise, and that nothing was written; exit status 1."""
    from facets.characterization.rest import NOT_NOISE, REMEDY

    typer.echo(f"{recording}: {NOT_NOISE}:")
    for fault in faults:
        typer.echo(f"  {fault}")
    places = [*([f"{files[0].parent}/"] if files else []), *([str(write)] if write else [])]
    typer.echo(REMEDY)
    if places:
        typer.echo(f"Not written: {', '.join(places)}.")
    raise typer.Exit(FINDING)


def tell(report: NoiseReport) -> None:
    """A line for each channel."""
    typer.echo(
        f"{report.samples} samples, {report.seconds:.4g} s at {report.rate:.6g} Hz, "
        f"{report.missing} missing"
    )
    for one in report.channels:
        model = one.model
        lines = "".join(
            f"  {line.name if line.name != 'unknown' else 'line'} {line.amplitude.value:.3g} at "
            f"{line.frequency:.2f} Hz"
            for line in model.lines[:3]
        )
        typer.echo(
            f"  {one.name:<12} {model.standard_deviation:8.3g} {one.unit:<4} (configured "
            f"{one.configured:.3g})  white {model.white_deviation:.3g}  drift "
            f"{model.drift.value:.2g}/s  spikes {model.spikes}{lines}"
        )
    if not report.faults:
        typer.echo(
            f"  sensor.noise: position_um {1e3 * report.position:.4g} at {report.at_power:g} mW, "
            f"power_uw {1e3 * report.power:.4g}; {1e6 * report.common:.3g} ppm are common to the "
            "powers"
        )
