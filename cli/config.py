"""`facets config`: check, show and describe configurations."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Annotated

import typer

from facets.core.errors import ConfigError

from .completion import configurations

if TYPE_CHECKING:
    from facets.config import Config

app = typer.Typer(
    help="Check, show and describe configurations.",
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)
NAME = typer.Argument(
    metavar="CONFIG",
    help="Name of a shipped configuration, or a YAML file.",
    autocompletion=configurations,
)


@app.command()
def check(
    files: Annotated[
        list[str],
        typer.Argument(
            metavar="CONFIG...", help="Shipped names or YAML files.", autocompletion=configurations
        ),
    ],
) -> None:
    """Check configurations: one line for each that is right, all problems of each that is not."""
    from facets.config import load

    from .console import BAD_INPUT, message

    failed = False
    for file in files:
        try:
            typer.echo(f"ok  {file}: {summary(load(file))}")
        except ConfigError as error:
            failed = True
            typer.echo(message(error), err=True)
    if failed:
        raise typer.Exit(BAD_INPUT)


@app.command()
def show(name: Annotated[str, NAME]) -> None:
    """Print a configuration in full, defaults filled in; the output is a configuration again."""
    from facets.config import to_yaml

    from .console import load_config

    sys.stdout.write(to_yaml(load_config(name)))


@app.command()
def schema() -> None:
    """Print the JSON Schema of configurations, for editors that complete and check YAML."""
    import json

    from facets.config import schema

    typer.echo(json.dumps(schema(), indent=2))


@app.command(name="list")
def list_() -> None:
    """List the configurations that come with facets."""
    from facets.config import load, shipped

    for name in shipped():
        typer.echo(f"{name}: {summary(load(name))}")


def summary(config: Config) -> str:
    """The sensor and its motions in a line."""
    beam, psds = config.sensor.beam, config.sensor.psds
    radii = sorted({psd.radius for psd in psds})
    radius = "/".join(f"{value:g}" for value in radii)
    diameters = sorted({beam.diameter_x, beam.diameter_y})
    diameter = " x ".join(f"{value:g}" for value in diameters)
    motions = ", ".join(config.motions) or "none"
    return (
        f"{beam.power:g} mW, beam {diameter} mm, PSDs at {radius} mm; "
        f"motions: {motions}; sha256 {config.sha256[:12]}"
    )
