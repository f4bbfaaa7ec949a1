"""`facets response`: frequency response functions from a recording or a table of poses."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from facets import core, pictures, responses
from facets.core.errors import InputError

from .console import FINDING, draw_beside
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
from .parts.response_input import EstimateRequest, InputEstimate, estimate_inputs, read_columns
from .results import ResultFolder
from .sentences.response import show_estimate

if TYPE_CHECKING:
    from facets.responses.forms import ResponseForm
    from facets.responses.universal_file import InputChannel


class FormName(StrEnum):
    receptance = "receptance"
    mobility = "mobility"
    accelerance = "accelerance"
    dynamic_stiffness = "dynamic-stiffness"
    mechanical_impedance = "mechanical-impedance"
    apparent_mass = "apparent-mass"


Measurement = Annotated[
    Path,
    typer.Argument(
        metavar="RECORDING",
        help="Folder written by `facets acquire`, or a table (CSV, Parquet, HDF5 or TDMS) with "
        "time_s, the pose's columns tx_mm ... yaw_mrad and the input's column; a table "
        "needs --config.",
    ),
]
Inputs = Annotated[
    list[str],
    typer.Option(
        "--input",
        metavar="COLUMN",
        help="Column of an input, such as force_n for the auxiliary channel `force` in N. Repeat "
        "the option for several inputs that act at once.",
    ),
]
Form = Annotated[
    FormName,
    typer.Option(
        "--form",
        help="Form of the responses: motion over input as displacement (receptance), velocity "
        "(mobility) or acceleration (accelerance), or one over these.",
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
InputDofs = Annotated[
    list[str] | None,
    typer.Option(
        "--input-dof",
        metavar="NODE:AXIS",
        help="Where the input acts, for the universal file, such as 2:-tz for node 2 against the "
        "z axis. Repeat the option for each --input.  [default: not known, node 0]",
    ),
]


def response(
    measurement: Measurement,
    inputs: Inputs,
    config: ConfigOption = None,
    point: Point = None,
    form: Form = FormName.receptance,
    resolution_hz: ResolutionHz = None,
    correct_bandwidth: CorrectBandwidth = False,
    uff: UniversalFile = None,
    node: Node = 1,
    input_dof: InputDofs = None,
    folder: Annotated[Path | None, folder_option("results/RECORDING-response")] = None,
    force: Force = False,
    table: Table = TableKind.csv,
    plot: Plot = PlotKind.png,
    look: Style = Look.screen,
) -> None:
    """Estimate frequency response functions of the six axes.

    Averages the spectra of overlapping segments (Welch, Hann window) and gives for each axis of the
    point of interest the responses H1 and H2 to the input, the coherence and the random error. The
    picture also shows what the sensor's noise alone would give, and its bandwidth. Of several
    inputs, gives for each the responses, the partial coherence without what goes with the others,
    and the multiple coherence with all of them. Segments that a gap or a missing pose cuts are left
    out. The command says what limits the result, and why. Exit status 1 if no axis answers to an
    input.
    """
    channels = input_channels(inputs, input_dof or [])
    chosen = responses.forms.FORMS[form.value]
    require_universal(uff, chosen)
    names = result_names(inputs, table, plot)
    place = output_folder(folder, measurement.stem, "response")
    results = ResultFolder(place, names, force, [measurement], [uff] if uff else [])
    columns, settings = read_columns(measurement, inputs, config)
    settings = choose_point(settings, point)
    body = settings.object or core.rigid_body.MIRROR
    request = EstimateRequest(settings, str(measurement), resolution_hz, correct_bandwidth, chosen)
    estimates = estimate_inputs(columns, inputs, request)
    origin = {"input": ", ".join(inputs), "form": form.value, "point": body.text}
    origin["averages"] = f"{estimates[0].response.averages:.4g}"
    bandwidth = settings.electronics.bandwidth
    source = core.names.escape_undecodable(measurement.name)
    with results.publish(settings, more=origin) as paths:
        for each, rows, picture in zip(estimates, paths[::2], paths[1::2], strict=True):
            frequency_response = responses.frequency_response
            results.write_table(rows, frequency_response.response_table(each.response))
            title = f"{form.value.replace('-', ' ').capitalize()}, {each.name}, {source}"
            make = pictures.response.response_picture
            draw_beside(picture, make, each.response, each.unit, title, bandwidth)
        if uff is not None:
            output_node = responses.universal_file.Node(node, body.point)
            every = [(each.response, at) for each, at in zip(estimates, channels, strict=True)]
            responses.universal_file.write_universal_file(uff, every, output_node, results.about)
    for each in estimates:
        show_response(each, bandwidth, body.text)
    results.name()
    if uff is not None:
        typer.echo(f"{uff}")
    if has_silent_input(estimates):
        raise typer.Exit(FINDING)


def has_silent_input(estimates: list[InputEstimate]) -> bool:
    """Whether no axis answers to some input."""
    silent = responses.findings.silent_axes
    return any(silent(each.receptance).all() for each in estimates)


def result_names(inputs: list[str], table: TableKind, plot: PlotKind) -> list[str]:
    """Names of a table and a picture for each input."""
    beginnings = [f"response-{name}" for name in inputs] if len(inputs) > 1 else ["response"]
    return [f"{begin}.{ending}" for begin in beginnings for ending in (table.value, plot.value)]


def input_channels(inputs: list[str], places: list[str]) -> list[InputChannel]:
    """Make the inputs of a universal file, with the places where they act if those are named."""
    universal = responses.universal_file
    if places and len(places) != len(inputs):
        raise InputError(
            f"--input-dof is given {len(places)} times and --input {len(inputs)} times; give one "
            "--input-dof for each --input, in the same order, or none"
        )
    dofs = [universal.read_input_dof(place) for place in places] or [(0, 0)] * len(inputs)
    return [universal.InputChannel(name, *dof) for name, dof in zip(inputs, dofs, strict=True)]


def show_response(each: InputEstimate, bandwidth: float, point: str) -> None:
    """Print a response to an input, and what limits it."""
    findings = responses.findings
    if each.signals.others.size:
        typer.echo(f"{each.name}, without what goes with the other inputs:")
    peaks = findings.find_peaks(each.receptance)
    show_estimate(each.response, each.signals, peaks, each.unit, point)
    limits = findings.find_limits(each.receptance, each.signals, peaks, bandwidth)
    typer.echo("\n".join(f"  {text}" for text in limits))


def require_universal(uff: Path | None, form: ResponseForm) -> None:
    """Refuse a universal file that cannot be written, before any work."""
    if uff is None:
        return
    core.extras.require_extra("pyuff", f"--uff {uff}")
    if uff.suffix.lower() not in (".uff", ".unv", ".uf"):
        raise InputError(f"{uff}: a universal file's name ends in .uff, .unv or .uf")
    if form.is_inverse:
        raise InputError(
            f"--uff {uff}: programs of modal analysis read motions over inputs; give --form "
            "receptance, mobility or accelerance"
        )
