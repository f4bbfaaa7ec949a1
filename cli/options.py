"""Arguments and options that several commands have, each declared once."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer
from typer.core import TyperCommand


class Command(TyperCommand):
    """A command whose option `--web` may stand without a value, which typer has no way to say."""

    def parse_args(self, ctx: typer.Context, args: list[str]) -> list[str]:  # type: ignore[override]
        for n in range(len(args) - 1, -1, -1):
            if args[n] == "--web" and (n + 1 == len(args) or args[n + 1].startswith("-")):
                args[n] = f"--web={ANY_PORT}"
        return super().parse_args(ctx, args)


#: Of a page whose port is not given: any that is free.
ANY_PORT = "0"


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


ConfigName = Annotated[str, typer.Argument(help="Name of a shipped config, or a YAML file.")]
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
At = Annotated[str | None, typer.Option(help="Where the other axes stand: tz_mm=1,yaw_mrad=2.")]


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
