"""Arguments and options that several commands have, each declared once.

An option has one name, one type and one meaning in all commands. In its help text the meaning in a
command follows a colon, and a default in words is in brackets at the end.
"""

from __future__ import annotations

from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from facets.core.errors import InputError
from facets.core.hues import choose_style

from ..command import COMMON
from . import completion

#: An option that several commands have, in a section of its own, since few runs need it.
option = partial(typer.Option, rich_help_panel=COMMON)


class TableKind(StrEnum):
    csv = "csv"
    parquet = "parquet"
    h5 = "h5"


class PlotKind(StrEnum):
    png = "png"
    svg = "svg"
    pdf = "pdf"


class Look(StrEnum):
    paper = "paper"
    screen = "screen"
    dark = "dark"


def choose_look(look: Look) -> Look:
    """Set the style of all pictures that the command draws."""
    choose_style(look.value)
    return look


def describe_default(default: str) -> str:
    """The end of a help text: a default that typer cannot print."""
    return f"  [default: {default}]" if default else ""


def output_option(formats: str, default: str = "") -> Any:
    """`-o FILE`, of commands whose result is one file."""
    return typer.Option(
        "-o",
        "--output",
        metavar="FILE",
        help=f"File for the result: {formats}.{describe_default(default)}",
    )


def folder_option(default: str) -> Any:
    """`-d FOLDER`, of commands whose results are several files."""
    return typer.Option(
        "-d",
        "--folder",
        metavar="FOLDER",
        help=f"Folder for the results.{describe_default(default)}",
    )


def report_option(content: str) -> Any:
    """`--report FILE.html`."""
    return option(
        "--report", metavar="FILE.html", help=f"HTML file for a page on the results: {content}."
    )


def write_option(content: str) -> Any:
    """`--write FILE.yaml`."""
    return option(
        "--write",
        metavar="FILE.yaml",
        help=f"YAML file to write: the configuration with {content}.",
    )


def motion_option(use: str, default: str = "") -> Any:
    """`--motion NAME`."""
    return typer.Option(
        "--motion",
        metavar="NAME",
        help=f"Name of a motion in the configuration: {use}.{describe_default(default)}",
        autocompletion=completion.motions,
    )


def heads_option(use: str, default: str = "") -> Any:
    """`--heads N`."""
    return option(
        "--heads",
        min=0,
        max=10**6,
        help="Number of sensor heads to simulate for the yield, with the tolerances in "
        f"`calibrate.before`: {use}.{describe_default(default)}",
    )


def seed_option(default: str = "") -> Any:
    """`--seed N`."""
    return option("--seed", min=0, help=f"Seed of the random numbers.{describe_default(default)}")


ConfigName = Annotated[
    str,
    typer.Argument(
        metavar="CONFIG",
        help="Name of a shipped configuration (see `facets config list`), or a YAML file.",
        autocompletion=completion.configurations,
    ),
]
ConfigOption = Annotated[
    str | None,
    option(
        "--config",
        metavar="CONFIG",
        help="Configuration to solve the recording with.  [default: the recording's own]",
        autocompletion=completion.configurations,
    ),
]
RecordingName = Annotated[
    Path, typer.Argument(metavar="RECORDING", help="Folder written by `facets acquire`.")
]
Coverage = Annotated[
    float | None,
    option(
        "--coverage",
        metavar="PROBABILITY",
        help="Also state expanded uncertainties, which hold with this coverage probability, such "
        "as 0.95, and their coverage factors k.",
    ),
]
Force = Annotated[bool, option("--force", help="Replace existing results.")]
Plot = Annotated[PlotKind, option("--plot", help="Format of the picture.")]
Style = Annotated[
    Look,
    option(
        "--style",
        callback=choose_look,
        help="Style of the pictures: paper for print, screen for documents, dark for slides.",
    ),
]
Table = Annotated[TableKind, option("--table", help="Format of the tables.")]
At = Annotated[
    str | None,
    option(
        "--at",
        metavar="NAME=NUMBER,...",
        help="Pose of the mirror, such as tz_mm=1,yaw_mrad=2 (mm and mrad); omitted "
        "coordinates are zero.",
        autocompletion=completion.assignments(completion.state_names),
    ),
]
Point = Annotated[
    str | None,
    option(
        "--point",
        metavar="X,Y,Z",
        help="Point of interest whose pose is computed: x, y and z relative to the apex in the "
        "mirror's frame, in mm, such as 0,0,50.  [default: the configuration's, `object.point_mm`]",
    ),
]
Zero = Annotated[
    str | None,
    option(
        "--zero",
        metavar="TIME|row:N|FILE",
        help="Reference pose: also give displacements from the mean of the first seconds (such as "
        "2s), from a row (row:1 is the first), or from the mean pose of a table of poses (CSV, "
        "Parquet or HDF5).",
    ),
]
Covariance = Annotated[
    bool,
    option(
        "--covariance",
        help="Also write the covariance of each pose, as the 21 columns cov_tx_tx_mm2 and so on.",
    ),
]
Certify = Annotated[
    int,
    option(
        "--certify",
        min=0,
        metavar="[BOXES]",
        help="Maximum number of boxes for proving that the readings determine the pose (takes some "
        "seconds); 0 skips the proof. Without a number: 20,000.",
    ),
]
Quick = Annotated[bool, option("--quick", help="Run a shorter version with fewer samples.")]
Seconds = Annotated[
    float | None,
    typer.Option("--seconds", min=0, help="Stop after this many seconds.  [default: never]"),
]
Track = Annotated[
    bool,
    typer.Option(
        "--track",
        help="Make the beam follow the mirror in x and y (`facets acquire` moves the stage for "
        "this). By default the beam is at rest.",
    ),
]
WithReference = Annotated[
    bool,
    option(
        "--with-reference",
        help="Also write the poses that a simulated reference instrument measures, as `facets "
        "calibrate` needs them.",
    ),
]
Publish = Annotated[
    list[str] | None,
    option(
        "--publish",
        metavar="ADDRESS",
        help="Send every sample to other programs at zmq://HOST:PORT (ZeroMQ), "
        "udp://HOST:PORT (JSON) or lsl:NAME; can be repeated.",
    ),
]
Web = Annotated[
    str | None,
    option(
        "--web",
        metavar="[[HOST:]PORT]",
        help="Show the samples on a web page and print its address. Without a port any free port "
        "is used; without a host only browsers on this machine (127.0.0.1) can open the page.",
    ),
]


def output_folder(folder: Path | None, name: str, ending: str = "") -> Path:
    """The folder or file of the command line, or by default results/NAME-ENDING."""
    return folder or Path("results") / (f"{name}-{ending}" if ending else name)


def require_yaml(path: Path) -> None:
    """Raise `InputError` if the name of a configuration's file has another suffix."""
    if path.suffix.lower() not in (".yaml", ".yml"):
        raise InputError(f"{path}: a configuration's name ends in .yaml or .yml")


def require_html(path: Path) -> None:
    """Raise `InputError` if the name of a page has another suffix."""
    if path.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"{path}: a page's name ends in .html")
