"""`facets noise`: the noise of a bench from a recording."""

from __future__ import annotations

import math
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import facets
from facets import config as configuration, core, design, files, live, noise_analysis, pictures
from facets.core.names import POSE, STATE_COLUMNS
from facets.core.plain_numbers import count_text

from .console import FINDING, draw_extra, show_progress, show_table, wrap
from .options import (
    ConfigOption,
    Force,
    Look,
    RecordingName,
    Style,
    folder_option,
    require_yaml,
    write_option,
)
from .parts.recordings import solve_recording

if TYPE_CHECKING:
    from facets.config import Config
    from facets.noise_analysis.noise_report import NoiseReport

#: Averaging times of the Allan deviations that are printed, as far as a recording has them.
AVERAGING_TIMES_S = (0.1, 1.0, 10.0, 100.0, 1000.0)


def noise(
    recording: RecordingName,
    config: ConfigOption = None,
    folder: Annotated[Path | None, folder_option("none are written")] = None,
    write: Annotated[Path | None, write_option("the noise of this bench")] = None,
    force: Force = False,
    look: Style = Look.screen,
) -> None:
    """Estimate the noise of a bench from a recording at rest.

        facets noise recordings/rest -d results/noise
        facets noise recordings/rest --write measured.yaml

    Estimates white and flicker noise, mains and other lines, drift and spikes of every reading and
    every pose coordinate, each with its 95 % interval, and compares them with the noise in the
    configuration. --folder writes the report noise.html and the table noise.csv. --write writes a
    configuration that extends the one of the recording by the estimated noise, so that stated
    uncertainties are those of this bench.

    If the mirror moved or drifted, or if detectors were saturated or dark, the recording does not
    show the noise: the command says why, writes nothing and ends with exit status 1.
    """
    chosen = facets.load(config) if config else None
    playback = live.Playback(recording, chosen)
    if write:
        require_yaml(write)
    paths = [folder / "noise.html", folder / "noise.csv"] if folder else []
    sources = configuration.source_files(chosen) if chosen else [recording / "meta.yaml"]
    files.tables.refuse_to_overwrite([*paths, write] if write else paths, force, sources)
    columns, settings = solve_recording(playback), playback.config
    faults = noise_analysis.rest.reading_faults(columns, settings) if columns else []
    if faults:
        refuse(recording, faults, paths, write)
    with show_progress("analysing the noise") as on_progress:
        report = noise_analysis.noise_report.report_of(
            columns, settings, str(recording), on_progress
        )
    show_channels(report)
    if report.faults and write:
        refuse(recording, report.faults, paths, write)
    write_results(report, settings, f"Noise of {recording.name}", paths, write)
    if report.faults:
        refuse(recording, report.faults, [], None)


def write_results(
    report: NoiseReport, settings: Config, title: str, paths: list[Path], write: Path | None
) -> None:
    """Write and name the page with the table, and the configuration with --write."""
    about = files.provenance.provenance_header(settings)
    with files.tables.ResultSet():
        if paths:
            draw_extra(paths[0], pictures.noise.page, report, title, about)
            files.tables.write_table(paths[1], noise_analysis.noise_report.table_of(report), about)
        if write:
            files.whole.write_text(write, measured_configuration(report, settings, write, about))
    if paths:
        print(f"{paths[0].parent}/")
    if write:
        print(f"{write}")


def measured_configuration(
    report: NoiseReport, settings: Config, path: Path, about: dict[str, str]
) -> str:
    """The YAML of a configuration at `path` with the estimated noise.

    It extends the configuration of the recording, if that is at hand, unchanged; otherwise it has
    every key.
    """
    block = noise_analysis.noise_report.noise_block(report)
    for source in (settings.path, path.with_name(f"{settings.name}.yaml"), settings.name):
        with suppress(facets.FacetsError):
            base = facets.load(source)
            if base.sha256 == settings.sha256 and base.path != path.resolve():
                parent = design.results.changes.base_of(base, path.parent)
                return files.provenance.extension(parent, {"sensor": {"noise": block}}, about)
    sensor = settings.resolved["sensor"] | {"noise": block}
    return files.provenance.configuration(settings, sensor, about)


def refuse(recording: Path, faults: list[str], paths: list[Path], write: Path | None) -> None:
    """Print why a recording does not show the noise; exit status 1."""
    print(f"{recording}: {noise_analysis.rest.NOT_NOISE}:")
    for fault in faults:
        print(f"  {fault}")
    places = [*([f"{paths[0].parent}/"] if paths else []), *([str(write)] if write else [])]
    print(noise_analysis.rest.REMEDY)
    if places:
        print(f"Not written: {', '.join(places)}.")
    raise typer.Exit(FINDING)


def show_channels(report: NoiseReport) -> None:
    """Print a line for each channel."""
    print(
        f"{count_text(report.samples, 'sample')}, {report.seconds:.4g} s at {report.rate:.6g} Hz, "
        f"{report.missing} missing"
    )
    for channel in report.channels:
        model = channel.model
        lines = "".join(
            f"  {line.name if line.name != 'unknown' else 'line'} {line.amplitude.value:.3g} at "
            f"{line.frequency:.2f} Hz"
            for line in model.lines[:3]
        )
        print(
            f"  {channel.name:<12} {model.standard_deviation:8.3g} "
            f"{core.units.write_micro(channel.unit):<4} "
            f"(configured {channel.configured:.3g})  white {model.white_deviation:.3g}  drift "
            f"{model.drift.value:.2g}/s  spikes {model.spikes}{lines}"
        )
    show_pose_noise(report)
    if report.noise_pairs:
        first, other, size = report.noise_pairs[0]
        print(wrap(
            f"- The noises of detectors are correlated ({size:.2g} between {first} and {other}, "
            f"{count_text(len(report.noise_pairs), 'pair')} in all), as by a common supply or "
            "reference voltage, or a mirror that vibrates. `solve` treats them as independent, "
            "unless `calibrate` found their common part; the noise of the poses above includes it."
        ))  # fmt: skip
    if not report.faults:
        print(
            f"  sensor.noise: position_um {1e3 * report.position:.4g} at {report.at_power:g} mW, "
            f"power_uw {1e3 * report.power:.4g}; {1e6 * report.common:.3g} ppm are common to the "
            "powers"
        )


def show_pose_noise(report: NoiseReport) -> None:
    """Print the density of each axis by the fitted model, and its Allan deviation.

    Where the rate or gaps leave no average over a time, there is a dash.
    """
    times = [tau for tau in AVERAGING_TIMES_S if tau <= report.seconds / 4]
    rows = []
    for name in POSE:
        column = STATE_COLUMNS[POSE.index(name)]
        channel = report.channel(column)
        white, flicker = channel.model.white.value, channel.model.flicker.value
        density = [1e3 * math.sqrt(white + flicker / f) for f in (1.0, report.rate / 2)]
        deviations = [1e3 * channel.allan.interpolate(tau) for tau in times]
        unit = channel.unit.replace("u", "n", 1)
        cells = ["-" if math.isnan(x) else f"{x:.3g}" for x in (*density, *deviations)]
        rows.append([name, unit, *cells])
    headings = ["axis", "", "at 1 Hz", f"at {report.rate / 2:.4g} Hz"]
    headings += [f"{tau:g} s" for tau in times]
    show_table(
        f"noise of the pose, {1 / report.seconds:.3g} to {report.rate / 2:.4g} Hz: density per "
        "sqrt(Hz) of white and flicker noise; Allan deviation by averaging time",
        headings, rows, left_columns=(0, 1),
    )  # fmt: skip
