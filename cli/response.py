"""`facets response`: frequency response functions from a recording or a table of poses."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import facets
from facets import characterization, core, files, live, pictures
from facets.core.errors import InputError
from facets.core.names import POSE

from .console import FINDING, load_config, name_files, show_table
from .noise import solve_recording
from .options import (
    ConfigOption,
    Force,
    Look,
    Plot,
    PlotKind,
    Point,
    Style,
    Table,
    TableKind,
    folder_option,
    output_folder,
)
from .places import choose_point

if TYPE_CHECKING:
    from facets.characterization.frequency_response import FrequencyResponse
    from facets.characterization.response_findings import Peak
    from facets.characterization.response_signals import Columns, ResponseSignals
    from facets.config import Config

Measurement = Annotated[
    Path,
    typer.Argument(
        metavar="RECORDING",
        help="Folder written by `facets acquire`, or a table (CSV or Parquet) with time_s, the "
        "pose's columns tx_mm ... yaw_mrad and the input's column; a table needs --config.",
    ),
]
Input = Annotated[
    str,
    typer.Option(
        "--input",
        metavar="COLUMN",
        help="Column of the input, such as force_n for the auxiliary channel `force` in N.",
    ),
]
ResolutionHz = Annotated[
    float | None,
    typer.Option(
        "--resolution-hz",
        min=1e-6,
        metavar="HZ",
        help="Distance of the frequencies; one over it is the length of a segment in seconds.  "
        "[default: for about 32 averages]",
    ),
]
CorrectBandwidth = Annotated[
    bool,
    typer.Option(
        "--correct-bandwidth",
        help="Divide the responses by the transmission of the electronics' low pass of the first "
        "order, `sensor.electronics.bandwidth_hz`.",
    ),
]
UniversalFile = Annotated[
    Path | None,
    typer.Option(
        "--uff",
        metavar="FILE.uff",
        help="Universal file (UFF) for the responses H1 and coherences, as datasets 58, for "
        "programs of modal analysis.",
    ),
]
Node = Annotated[
    int,
    typer.Option(
        "--node",
        min=1,
        max=9_999_999,
        help="Number of the point of interest in the universal file.",
    ),
]
InputDof = Annotated[
    str | None,
    typer.Option(
        "--input-dof",
        metavar="NODE:AXIS",
        help="Where the input acts, for the universal file, such as 2:-tz for node 2 against the "
        "z axis.  [default: not known, node 0]",
    ),
]


def response(
    measurement: Measurement,
    input_column: Input,
    config: ConfigOption = None,
    point: Point = None,
    resolution_hz: ResolutionHz = None,
    correct_bandwidth: CorrectBandwidth = False,
    uff: UniversalFile = None,
    node: Node = 1,
    input_dof: InputDof = None,
    folder: Annotated[Path | None, folder_option("results/RECORDING-response")] = None,
    force: Force = False,
    table: Table = TableKind.csv,
    plot: Plot = PlotKind.png,
    look: Style = Look.screen,
) -> None:
    """Estimate frequency response functions of the six axes.

    Averages the spectra of overlapping segments (Welch, Hann window) and gives for each axis of the
    point of interest the responses H1 and H2 to the input, the coherence and the random error. The
    picture also shows what the sensor's noise alone would give, and its bandwidth. Segments that a
    gap or a missing pose cuts are left out. The command says what limits the result, and why. Exit
    status 1 if no axis answers to the input.
    """
    paths = result_files(output_folder(folder, measurement.stem, "response"), table, plot)
    universal = characterization.universal_file
    dof = universal.read_input_dof(input_dof) if input_dof else ()
    if uff is not None:
        core.extras.require_extra("pyuff", f"--uff {uff}")
        if uff.suffix.lower() not in (".uff", ".unv", ".uf"):
            raise InputError(f"{uff}: a universal file's name ends in .uff, .unv or .uf")
    files.tables.refuse_to_overwrite([*paths, *([uff] if uff else [])], force, [measurement])
    columns, settings = read_columns(measurement, input_column, config)
    settings = choose_point(settings, point)
    body = settings.object or core.rigid_body.MIRROR
    stimulus, place = universal.InputChannel(input_column, *dof), universal.Node(node, body.point)
    signals = characterization.response_signals.build_signals(
        columns, input_column, body, settings, str(measurement)
    )
    bandwidth = settings.electronics.bandwidth
    delay, unit = describe_input(settings, input_column)
    responses = characterization.frequency_response
    channel = responses.OutputChannel(signals.deviation, bandwidth, correct_bandwidth, delay)
    found = responses.estimate_response(
        signals.stimulus, signals.motion, signals.stretches, resolution_hz, channel
    )
    peaks = characterization.response_findings.find_peaks(found)
    about = files.provenance.provenance_header(settings) | {
        "input": input_column,
        "point": body.text,
        "averages": f"{found.averages:.4g}",
    }
    with files.tables.ResultSet():
        rows = responses.response_table(found)
        files.tables.write_table(paths[0], rows, about)
        title = f"Response to {input_column} of {measurement.name}"
        picture = pictures.response.response_picture(found, unit, title, bandwidth)
        pictures.style.save(picture, paths[1])
        if uff is not None:
            universal.write_universal_file(uff, found, stimulus, place, about)
    tell(found, signals, peaks, unit, body.text)
    limits = characterization.response_findings.find_limits(found, signals, peaks, bandwidth)
    typer.echo("\n".join(f"  {text}" for text in limits))
    name_files(paths[0].parent, paths)
    if uff is not None:
        typer.echo(f"{uff}")
    if characterization.response_findings.silent_axes(found).all():
        raise typer.Exit(FINDING)


def result_files(folder: Path, table: TableKind, plot: PlotKind) -> list[Path]:
    return [folder / f"response.{table.value}", folder / f"response.{plot.value}"]


def read_columns(data: Path, column: str, config: str | None) -> tuple[Columns, Config]:
    """Read the columns of a recording or of a table, and the sensor's configuration."""
    if data.is_dir() or not data.name.lower().endswith(files.tables.ENDINGS):
        return solve_columns(data, column, config)
    if config is None:
        raise InputError(
            f"{data}: a table needs --config CONFIG, the configuration of the sensor, whose noise "
            "and bandwidth the picture shows"
        )
    return characterization.response_signals.read_signal_table(data, column), load_config(config)


def solve_columns(recording: Path, column: str, config: str | None) -> tuple[Columns, Config]:
    """Solve a recording, which must have the auxiliary channel of the column."""
    playback = live.Playback(recording, facets.load(config) if config else None)
    names = [one.column for one in playback.config.acquire.channels]
    if column not in names:
        has = ", ".join(names) or "none (acquire.channels names them)"
        raise InputError(
            f"{recording}: has no auxiliary channel with the column {column}; it has: {has}"
        )
    columns = solve_recording(playback)
    if not columns:
        raise InputError(f"{recording}: holds no complete sample")
    return columns, playback.config


def describe_input(settings: Config, column: str) -> tuple[float, str]:
    """The delay of the input's samples, s, and the input's unit; 0 and by its name by default."""
    for channel in settings.acquire.channels:
        if channel.column == column:
            return channel.delay, "" if channel.unit == "1" else channel.unit
    return 0.0, files.tables.unit_of_column(column)


def tell(
    found: FrequencyResponse, signals: ResponseSignals, peaks: list[Peak], unit: str, point: str
) -> None:
    """Print the estimate's frame, and the peaks."""
    lines = found.frequency[found.is_excited]
    typer.echo(
        f"{len(signals.stimulus)} rows at {found.rate:.6g} Hz: {found.segments} segments, "
        f"{found.averages:.3g} independent averages, a line every {found.resolution:.4g} Hz; the "
        f"input has power from {lines.min():.4g} to {lines.max():.4g} Hz"
    )
    typer.echo(f"{point}")
    per = f" per {unit}" if unit else ""
    rows = []
    for one in peaks:
        fine = core.units.unit_of(one.axis)
        error = found.coverage_factor * found.random_error[one.line, POSE.index(one.axis)]
        rows.append([
            f"{one.frequency:.5g}", one.axis, f"{fine.fine_factor * one.size:.4g}",
            f"{fine.fine_unit}{per}", f"{100 * error:.2g} %", f"{one.width:.3g}",
            f"{found.coherence[one.line, POSE.index(one.axis)]:.4f}",
        ])  # fmt: skip
    if rows:
        headings = ("Hz", "axis", "|H1|", "", "random (95 %)", "width, Hz", "coherence")
        show_table("peaks, at lines of the estimate", headings, rows, left=(1, 3))
    else:
        typer.echo("No peak stands out of its surroundings by a factor of 3.")
