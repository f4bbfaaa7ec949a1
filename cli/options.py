"""Arguments and options that several commands have, each declared once."""

from __future__ import annotations

from enum import StrEnum
from math import isfinite
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

from facets.core.plain_numbers import plain_number

from . import completion

#: Of a page whose port is not given: any that is free.
ANY_PORT = "0"


class Command(TyperCommand):
    """A command that refuses, of every option, what cannot be meant: nothing at all, the same value
    twice, and numbers that are infinite or have underscores.

    Its option `--web` may stand without a value, which typer has no way to say.
    """

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        for n in range(len(args) - 1, -1, -1):
            if args[n] == "--web" and (n + 1 == len(args) or args[n + 1].startswith("-")):
                args[n] = f"--web={ANY_PORT}"
        typed, _, _ = self.make_parser(ctx).parse_args(args=list(args))
        rest: list[str] = super().parse_args(ctx, args)
        params: list[Any] = self.get_params(ctx)
        for param in params:
            value = typed.get(param.name)
            texts = value if isinstance(value, list | tuple) else [value]
            counts = isinstance(ctx.params.get(param.name), int | float)
            if reason := why_meaningless([t for t in texts if isinstance(t, str)], counts):
                raise typer.BadParameter(reason, ctx=ctx, param=param)
        return rest


def why_meaningless(texts: list[str], is_number: bool) -> str:
    """Why values of an option, as they were typed, mean nothing; "" where they do."""
    for n, text in enumerate(texts):
        if not text.strip():
            return "it is empty; give a value, or leave the option out"
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
    """Every picture that the command makes from here on is in this style."""
    from facets.core.hues import choose_style

    choose_style(look.value)
    return look


ConfigName = Annotated[
    str,
    typer.Argument(
        help="Name of a shipped config, or a YAML file.", autocompletion=completion.configurations
    ),
]
Force = Annotated[bool, typer.Option("--force", help="Replace older results.")]
Plot = Annotated[PlotKind, typer.Option(help="Kind of the picture.")]
Style = Annotated[
    Look,
    typer.Option(
        "--style",
        callback=choose_look,
        help="Look of the pictures: paper for print, screen, or dark for slides.",
    ),
]
Table = Annotated[TableKind, typer.Option(help="Kind of the table.")]
At = Annotated[
    str | None,
    typer.Option(
        help="Where the other axes stand: tz_mm=1,yaw_mrad=2.",
        autocompletion=completion.assignments(completion.state_names),
    ),
]


Web = Annotated[
    str | None,
    typer.Option(
        metavar="[[HOST:]PORT]",
        help="Show the samples on a page in browsers and print its address. Without a port: any "
        "that is free. Without a host: for browsers on this machine only (127.0.0.1).",
    ),
]


def folder_option(default: str) -> typer.models.OptionInfo:
    """`-o FOLDER`, with its default in words."""
    option: typer.models.OptionInfo = typer.Option(
        "-o", "--output", help=f"Folder for the results.  [default: {default}]"
    )
    return option


Track = Annotated[
    bool, typer.Option("--track/--fixed", help="Whether the beam follows in x and y.")
]


def output_folder(given: Path | None, name: str, ending: str = "") -> Path:
    """The folder asked for, else results/NAME-ENDING."""
    return given or Path("results") / (f"{name}-{ending}" if ending else name)
