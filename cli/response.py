"""`facets response`: frequency response functions from a recording or a table of poses."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from facets import characterization, core, pictures
from facets.core.errors import InputError

from .console import FINDING
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
from .options.places import choose_point
from .parts.response_input import describe_input, read_columns
from .results import ResultFolder
from .sentences.response import show_estimate

if TYPE_CHECKING:
    pass

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
    universal = characterization.universal_file
    dof = universal.read_input_dof(input_dof) if input_dof else ()
    channel = universal.InputChannel(input_column, *dof)
    require_universal(uff)
    names = [f"response.{table.value}", f"response.{plot.value}"]
    place = output_folder(folder, measurement.stem, "response")
    results = ResultFolder(place, names, force, [measurement], [uff] if uff else [])
    columns, settings = read_columns(measurement, input_column, config)
    settings = choose_point(settings, point)
    body = settings.object or core.rigid_body.MIRROR
    signals = characterization.response_signals.build_signals(
        columns, input_column, body, settings, str(measurement)
    )
    bandwidth = settings.electronics.bandwidth
    delay, unit = describe_input(settings, input_column)
    responses = characterization.frequency_response
    output = responses.OutputChannel(signals.deviation, bandwidth, correct_bandwidth, delay)
    estimate = responses.estimate_response(
        signals.stimulus, signals.motion, signals.stretches, resolution_hz, output
    )
    peaks = characterization.response_findings.find_peaks(estimate)
    averages = f"{estimate.averages:.4g}"
    origin = {"input": input_column, "point": body.text, "averages": averages}
    with results.publish(settings, more=origin) as (rows, picture):
        results.write_table(rows, responses.response_table(estimate))
        title = f"Response to {input_column} of {measurement.name}"
        pictures.style.save(
            pictures.response.response_picture(estimate, unit, title, bandwidth), picture
        )
        if uff is not None:
            output_node = universal.Node(node, body.point)
            universal.write_universal_file(uff, estimate, channel, output_node, results.about)
    show_estimate(estimate, signals, peaks, unit, body.text)
    limits = characterization.response_findings.find_limits(estimate, signals, peaks, bandwidth)
    typer.echo("\n".join(f"  {text}" for text in limits))
    results.name()
    if uff is not None:
        typer.echo(f"{uff}")
    if characterization.response_findings.silent_axes(estimate).all():
        raise typer.Exit(FINDING)


def require_universal(uff: Path | None) -> None:
    """Refuse a universal file that cannot be written, before any work."""
    if uff is None:
        return
    core.extras.require_extra("pyuff", f"--uff {uff}")
    if uff.suffix.lower() not in (".uff", ".unv", ".uf"):
        raise InputError(f"{uff}: a universal file's name ends in .uff, .unv or .uf")
