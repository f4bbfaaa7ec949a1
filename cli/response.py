"""`facets response`: frequency response functions from a recording or a table of poses."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from facets import core, pictures, responses
from facets.core.errors import InputError
from facets.core.plain_numbers import times_text

from .console import FINDING, draw_extra
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
from .parts.response_input import read_columns
from .results import ResultFolder
from .sentences.response import show_response

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

        facets response recordings/run --input force_n
        facets response recordings/run --input force_n --form mobility --uff run.uff

    Averages the spectra of overlapping segments (Welch, Hann window) and gives for each axis of the
    point of interest the responses H1 and H2 to the input, the coherence and the random error. The
    picture also shows what the sensor's noise alone would give, and its bandwidth. Of several
    inputs, gives for each the responses, the partial coherence, with the contributions of the other
    inputs removed, and the multiple coherence with all of them. Segments that a gap or a missing
    pose cuts are excluded. The command reports what limits the result, and why. Exit status 1 if no
    axis responds to an input.
    """
    channels = input_channels(inputs, input_dof or [])
    chosen = responses.forms.FORMS[form.value]
    require_universal(uff, chosen)
    names = result_names(inputs, table, plot)
    place = output_folder(folder, measurement.stem, "response")
    results = ResultFolder(place, names, force, [measurement], [uff] if uff else [])
    columns, settings = read_columns(measurement, inputs, config)
    settings = choose_point(settings, point)
    ordered = [[name, *(other for other in inputs if other != name)] for name in inputs]
    estimates = [
        responses.signals.respond(
            columns, names, settings, str(measurement), resolution_hz, correct_bandwidth
        )
        for names in ordered
    ]
    converted = [receptance.convert(chosen) for _, receptance in estimates]
    units = [responses.signals.describe_input(settings, name)[1] for name in inputs]
    body, bandwidth = settings.object or core.rigid_body.MIRROR, settings.electronics.bandwidth
    origin = {"input": ", ".join(inputs), "form": form.value, "point": body.text}
    origin["averages"] = f"{converted[0].averages:.4g}"
    source = core.names.escape_undecodable(measurement.name)
    with results.publish(settings, more=origin) as paths:
        for n, estimate in enumerate(converted):
            rows, picture = paths[2 * n : 2 * n + 2]
            results.write_table(rows, responses.frequency_response.response_table(estimate))
            title = f"{form.value.replace('-', ' ').capitalize()}, {inputs[n]}, {source}"
            make = pictures.response.response_picture
            draw_extra(picture, make, estimate, units[n], title, bandwidth)
        if uff is not None:
            output_node = responses.universal_file.Node(node, body.point)
            every = list(zip(converted, channels, strict=True))
            responses.universal_file.write_universal_file(uff, every, output_node, results.about)
    for n, (signals, receptance) in enumerate(estimates):
        if signals.others.size:
            print(f"{inputs[n]}, with the other inputs' contributions removed:")
        show_response(signals, receptance, chosen, units[n], body.text, bandwidth)
    results.name()
    if uff is not None:
        print(f"{uff}")
    silent = responses.findings.silent_axes
    if any(silent(receptance).all() for _, receptance in estimates):
        raise typer.Exit(FINDING)


def result_names(inputs: list[str], table: TableKind, plot: PlotKind) -> list[str]:
    """Names of a table and a picture for each input."""
    beginnings = [f"response-{name}" for name in inputs] if len(inputs) > 1 else ["response"]
    return [f"{begin}.{ending}" for begin in beginnings for ending in (table.value, plot.value)]


def input_channels(inputs: list[str], places: list[str]) -> list[InputChannel]:
    """Make the inputs of a universal file, with the places where they act if those are named."""
    universal = responses.universal_file
    if places and len(places) != len(inputs):
        raise InputError(
            f"--input-dof is given {times_text(len(places))} and --input "
            f"{times_text(len(inputs))}; give one "
            "--input-dof for each --input, in the same order, or none"
        )
    dofs = [universal.read_input_dof(place) for place in places] or [(0, 0)] * len(inputs)
    return [universal.InputChannel(name, *dof) for name, dof in zip(inputs, dofs, strict=True)]


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
