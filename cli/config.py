"""`facets config`: check, show and describe configurations."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Annotated

import typer

from facets import config as configuration
from facets.core.errors import ConfigError

from .command import Group, PlainCommand
from .console import BAD_INPUT, load_config, message
from .options import ConfigName
from .options.completion import configurations

if TYPE_CHECKING:
    from facets.config import Config

app = typer.Typer(
    cls=Group,
    help="Check, show and describe configurations.",
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)


@app.command(cls=PlainCommand)
def check(
    files: Annotated[
        list[str],
        typer.Argument(
            metavar="CONFIG...",
            help="Names of shipped configurations (see `facets config list`), or YAML files.",
            autocompletion=configurations,
        ),
    ],
) -> None:
    """Check configurations.

        facets config check rig mine.yaml

    Prints a summary of each valid configuration and all problems of the others.
    """
    failed = False
    for file in files:
        try:
            print(f"ok  {file}: {summary(configuration.load(file))}")
        except ConfigError as error:
            failed = True
            print(message(error), file=sys.stderr)
    if failed:
        raise typer.Exit(BAD_INPUT)


@app.command(cls=PlainCommand)
def show(config: ConfigName) -> None:
    """Print a configuration as YAML with all defaults filled in.

        facets config show paper

    The output is a valid configuration file.
    """
    sys.stdout.write(configuration.to_yaml(load_config(config)))


@app.command(cls=PlainCommand)
def schema() -> None:
    """Print the JSON Schema of configurations.

        facets config schema > facets.schema.json

    Editors use it to check and complete YAML.
    """
    import json

    print(json.dumps(configuration.schema(), indent=2))


@app.command("list", cls=PlainCommand)
def list_() -> None:
    """List the configurations that come with facets.

        facets config list

    Prints the name of each configuration and what it is for.
    """
    for name in configuration.shipped():
        print(f"{name}: {configuration.purpose(name)}")


def summary(config: Config) -> str:
    """The sensor and its motions in a line."""
    motions = ", ".join(config.motions) or "none"
    return f"{config.sensor.summary}; motions: {motions}; sha256 {config.sha256[:12]}"
