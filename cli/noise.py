"""`facets noise`: what a recording says of the noise of its bench."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .options import Look, Style

if TYPE_CHECKING:
    from facets.characterization.noise_report import NoiseReport


def noise(
    recording: Annotated[Path, typer.Argument(help="Folder of a recording, the mirror at rest.")],
    config: Annotated[
        str | None, typer.Option(help="Solve by this one.  [default: the recording's own]")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Folder for noise.html and noise.csv.")
    ] = None,
    write: Annotated[
        Path | None, typer.Option("--write", help="The configuration with the noise found: YAML.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace older files.")] = False,
    look: Style = Look.screen,
) -> None:
    """Find the noise of a bench in a recording of a mirror at rest.

    White and flicker noise, mains and other lines, drift and spikes of every reading and of the
    poses, each with its 95 % interval, beside what the configuration states. --write makes a
    configuration whose noise is what was found, so that uncertainties say what this bench has.
    """
    from facets import load
    from facets.characterization.noise_report import noise_block, report_of, table_of
    from facets.files import provenance, tables, whole
    from facets.live.pipeline import Pipeline
    from facets.live.pose_table import join_columns, pose_columns
    from facets.live.recording import meta_of
    from facets.live.replay import recorded_config, replay

    meta_of(recording)
    settings = load(config) if config else recorded_config(recording)
    files = [output / "noise.html", output / "noise.csv"] if output else []
    tables.refuse_to_overwrite([*files, *([write] if write else [])], force)
    parts = [pose_columns(poses) for poses in replay(recording, Pipeline(settings))]
    report = report_of(join_columns(parts) if parts else {}, settings, str(recording))
    tell(report)
    about = provenance.about(settings)
    if output:
        from facets.pictures.noise import page

        with whole.Whole(files[0]) as temporary:
            temporary.write_text(page(report, f"Noise of {recording.name}", about), "utf-8")
        tables.write_table(files[1], table_of(report), about)
        typer.echo(f"{output}/")
    if write:
        block = noise_block(report, settings.resolved)
        with whole.Whole(write) as temporary:
            temporary.write_text(provenance.configuration(settings, block, about), "utf-8")
        typer.echo(f"{write}")


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
    typer.echo(
        f"  sensor.noise: position_um {1e3 * report.position:.4g} at {report.at_power:g} mW, "
        f"power_uw {1e3 * report.power:.4g}; {1e6 * report.common:.3g} ppm are common to the powers"
    )
