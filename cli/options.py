"""Arguments and options that several commands have, each declared once, and their old spellings.

An option has one name, one type and one meaning in all commands. What a command adds to the meaning
stands after a colon in its help text, and a default in words stands in brackets at the end.
"""

from __future__ import annotations

import re
from enum import StrEnum
from math import isfinite
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

from facets.core.plain_numbers import plain_number

from . import completion

#: Options that may stand without a value: what they mean then, and what a value looks like.
OPTIONAL_VALUES = {"--web": ("0", r"[^-].*"), "--certify": ("20000", r"-?[\d.+e_]+")}

#: Commands whose result is a folder; until version 0.2 they had -o for it, as others for a file.
FOLDER_COMMANDS = (
    "simulate", "range-map", "resolution", "jacobian", "tolerances", "acquire", "noise", "export-c",
    "bench", "reproduce",
)  # fmt: skip
#: Options of version 0.2 that are spelt otherwise now, by command: the first part is the new one.
RENAMED = {
    **{(name, option): "--folder" for name in FOLDER_COMMANDS for option in ("-o", "--output")},
    ("explore", "--from"): "--folder",
    ("range-map", "--tracking"): "--track",
    ("resolution", "--tracking"): "--track",
    ("range-map", "--fixed"): "the default without --track",
    ("resolution", "--fixed"): "the default without --track",
    ("simulate", "--tracking"): "--track",
    ("render", "--tracking"): "--track",
    ("acquire", "--tracking"): "--track",
    ("simulate", "--reference"): "--with-reference",
    ("emulate", "--reference"): "--with-reference",
    ("optimize", "--yield"): "--heads",
    ("jacobian", "--search"): "--search-worst",
    ("jacobian", "--no-search"): "--no-search-worst",
    ("jacobian", "--sampling"): "--uniform for uniform random states, the default for Sobol' ones",
    ("jacobian", "--table"): "--state-table",
    ("acquire", "--search"): "--search-mirror",
    ("acquire", "--no-search"): "--no-search-mirror",
    ("acquire", "--compare"): "--compare-board",
    ("acquire", "--rate"): "--display-rate",
    ("render", "--rate"): "--frame-rate",
    ("replay", "--smooth-by"): "--smooth MODEL",
}


class Command(TyperCommand):
    """A command that refuses option values without a meaning, and names new spellings for old ones.

    Without a meaning are an empty value, the same value twice, another option's name, and a number
    that is infinite or has underscores. OPTIONAL_VALUES may be left out, which typer cannot say.
    """

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        add_optional_values(args)
        if reason := name_new_spelling(ctx.info_name, args):
            raise typer.BadParameter(reason, ctx=ctx)
        typed, _, _ = self.make_parser(ctx).parse_args(args=list(args))
        rest: list[str] = super().parse_args(ctx, args)
        params: list[Any] = self.get_params(ctx)
        names = [name for param in params for name in (*param.opts, *param.secondary_opts)]
        options = {name for name in names if name.startswith("-")}  # not those of arguments
        for param in params:
            value = typed.get(param.name)
            texts = value if isinstance(value, list | tuple) else [value]
            is_number = isinstance(ctx.params.get(param.name), int | float)
            if reason := why_meaningless(
                [t for t in texts if isinstance(t, str)], is_number, options
            ):
                raise typer.BadParameter(reason, ctx=ctx, param=param)
        return rest


def add_optional_values(args: list[str]) -> None:
    """Write the value after each option of OPTIONAL_VALUES that stands without one."""
    for n, text in enumerate(args):
        if text in OPTIONAL_VALUES:
            default, form = OPTIONAL_VALUES[text]
            if not re.fullmatch(form, "".join(args[n + 1 : n + 2])):
                args[n] = f"{text}={default}"


def name_new_spelling(command: str, args: list[str]) -> str:
    """The message about the first option with an old spelling; "" if there is none."""
    for text in args:
        option = text.partition("=")[0]
        new = RENAMED.get((command, option))
        if new is not None:
            return f"{option} is now {new}; see `facets {command} --help`"
    return ""


def why_meaningless(texts: list[str], is_number: bool, options: set[str]) -> str:
    """Why values of an option, as they were typed, mean nothing; "" where they mean something."""
    for n, text in enumerate(texts):
        if not text.strip():
            return "it is empty; give a value, or leave the option out"
        if text in options:
            return f"a value must stand before the option {text}"
        if text in texts[:n]:
            return f"{text} is given twice"
        if is_number and is_odd_number(text):
            return f"{text!r} is not a plain finite number"
    return ""


def is_odd_number(text: str) -> bool:
    """Whether Python takes it for a number, and a person would not have typed it as one."""
    try:
        float(text)
    except ValueError:
        return False
    try:
        return not isfinite(plain_number(text))
    except ValueError:
        return True


class TableKind(StrEnum):
    csv = "csv"
    parquet = "parquet"


class PlotKind(StrEnum):
    png = "png"
    svg = "svg"
    pdf = "pdf"


class Look(StrEnum):
    paper = "paper"
    screen = "screen"
    dark = "dark"


def choose_look(look: Look) -> Look:
    """Set the style of every picture that the command draws from here on."""
    from facets.core.hues import choose_style

    choose_style(look.value)
    return look


def describe_default(default: str) -> str:
    """The end of a help text: a default that typer cannot print."""
    return f"  [default: {default}]" if default else ""


def output_option(formats: str, default: str = "") -> typer.models.OptionInfo:
    """`-o FILE`, of commands whose result is one file."""
    option: typer.models.OptionInfo = typer.Option(
        "-o",
        "--output",
        metavar="FILE",
        help=f"File for the result: {formats}.{describe_default(default)}",
    )
    return option


def folder_option(default: str) -> typer.models.OptionInfo:
    """`-d FOLDER`, of commands whose results are several files."""
    option: typer.models.OptionInfo = typer.Option(
        "-d",
        "--folder",
        metavar="FOLDER",
        help=f"Folder for the results.{describe_default(default)}",
    )
    return option


def report_option(content: str) -> typer.models.OptionInfo:
    """`--report FILE.html`."""
    option: typer.models.OptionInfo = typer.Option(
        "--report", metavar="FILE.html", help=f"HTML file for a page on the results: {content}."
    )
    return option


def write_option(content: str) -> typer.models.OptionInfo:
    """`--write FILE.yaml`."""
    option: typer.models.OptionInfo = typer.Option(
        "--write",
        metavar="FILE.yaml",
        help=f"YAML file for the configuration with the findings: {content}.",
    )
    return option


def motion_option(use: str, default: str = "") -> typer.models.OptionInfo:
    """`--motion NAME`."""
    option: typer.models.OptionInfo = typer.Option(
        "--motion",
        metavar="NAME",
        help=f"Name of a motion in the configuration: {use}.{describe_default(default)}",
        autocompletion=completion.motions,
    )
    return option


def heads_option(least: str, default: str = "") -> typer.models.OptionInfo:
    """`--heads N`."""
    option: typer.models.OptionInfo = typer.Option(
        "--heads",
        min=0,
        max=10**6,
        help="Number of sensor heads to simulate for the yield, with the tolerances in "
        f"`calibrate.before`: {least}.{describe_default(default)}",
    )
    return option


def seed_option(default: str = "") -> typer.models.OptionInfo:
    """`--seed N`."""
    option: typer.models.OptionInfo = typer.Option(
        "--seed", min=0, help=f"Seed of the random numbers.{describe_default(default)}"
    )
    return option


def filter_option(places: str) -> typer.models.OptionInfo:
    """`--filter MODEL`."""
    option: typer.models.OptionInfo = typer.Option(
        "--filter",
        metavar="MODEL",
        help="Also give poses filtered by a motion whose acceleration, speed or place (one of "
        f"these words) is nearly constant: {places}.",
    )
    return option


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
    typer.Option(
        "--config",
        metavar="CONFIG",
        help="Configuration to solve the recording with.  [default: the recording's own]",
        autocompletion=completion.configurations,
    ),
]
RecordingName = Annotated[
    Path, typer.Argument(metavar="RECORDING", help="Folder written by `facets acquire`.")
]
Force = Annotated[bool, typer.Option("--force", help="Replace existing results.")]
Plot = Annotated[PlotKind, typer.Option("--plot", help="Format of the picture.")]
Style = Annotated[
    Look,
    typer.Option(
        "--style",
        callback=choose_look,
        help="Style of the pictures: paper for print, screen for documents, dark for slides.",
    ),
]
Table = Annotated[TableKind, typer.Option("--table", help="Format of the tables.")]
At = Annotated[
    str | None,
    typer.Option(
        "--at",
        metavar="NAME=NUMBER,...",
        help="Pose of the mirror, such as tz_mm=1,yaw_mrad=2 (mm and mrad); coordinates left out "
        "are zero.",
        autocompletion=completion.assignments(completion.state_names),
    ),
]
Certify = Annotated[
    int,
    typer.Option(
        "--certify",
        min=0,
        metavar="[BOXES]",
        help="Maximum number of boxes for proving that the readings determine the pose (takes some "
        "seconds); 0 skips the proof. Without a number: 20,000.",
    ),
]
Quick = Annotated[bool, typer.Option("--quick", help="Run a shorter version with fewer samples.")]
Seconds = Annotated[
    float | None,
    typer.Option("--seconds", min=0, help="Stop after this many seconds.  [default: never]"),
]
Track = Annotated[
    bool,
    typer.Option(
        "--track",
        help="Make the beam follow the mirror in x and y (`facets acquire` moves the stage for "
        "this). By default the beam stands still.",
    ),
]
WithReference = Annotated[
    bool,
    typer.Option(
        "--with-reference",
        help="Also write the poses that a simulated reference instrument measures, as `facets "
        "calibrate` needs them.",
    ),
]
Publish = Annotated[
    list[str] | None,
    typer.Option(
        "--publish",
        metavar="ADDRESS",
        help="Send every sample to other programs at zmq://HOST:PORT (ZeroMQ), "
        "udp://HOST:PORT (JSON) or lsl:NAME; can be repeated.",
    ),
]
Web = Annotated[
    str | None,
    typer.Option(
        "--web",
        metavar="[[HOST:]PORT]",
        help="Show the samples on a web page and print its address. Without a port any free port "
        "is used; without a host only browsers on this machine (127.0.0.1) can open the page.",
    ),
]


def output_folder(folder: Path | None, name: str, ending: str = "") -> Path:
    """The folder of the command line, or by default results/NAME-ENDING."""
    return folder or Path("results") / (f"{name}-{ending}" if ending else name)
