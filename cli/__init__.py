"""The command `facets`. One file per subcommand; what is heavy is imported inside the command."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from facets import __version__
from facets.core.errors import FacetsError

from . import config, signals
from .acquire import acquire
from .bench import bench
from .calibrate import calibrate
from .console import message
from .emulate import emulate
from .explore import explore
from .jacobian import jacobian
from .optimize import optimize
from .range_map import range_map
from .render import render
from .replay import recover, replay
from .reproduce import reproduce
from .resolution import resolution
from .simulate import simulate
from .solve import solve

app = typer.Typer(
    name="facets",
    help="Three-facet-mirror 6-DOF sensor: a YAML configuration to readings, poses and errors.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"facets {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_version, is_eager=True, help="Print the version."),
    ] = False,
) -> None:
    """Options that stand before the command."""


def main() -> None:
    """Entry point: an expected error becomes a message on stderr and exit status 2.

    A signal ends every command as ^C does, with 128 and its number as exit status.
    """
    with signals.interrupting():
        try:
            app()
        except FacetsError as error:
            print(message(error), file=sys.stderr)
            sys.exit(2)
        except KeyboardInterrupt:
            print("interrupted", file=sys.stderr)
            sys.exit(signals.status())
        except SystemExit as ending:
            sys.exit(signals.status_of(ending.code))


app.command()(simulate)
app.command()(solve)
app.command("range-map")(range_map)
app.command()(resolution)
app.command()(jacobian)
app.command()(calibrate)
app.command()(optimize)
app.command()(explore)
app.command()(acquire)
app.command()(replay)
app.command()(recover)
app.command()(emulate)
app.command()(render)
app.command()(bench)
app.command()(reproduce)
app.add_typer(config.app, name="config")
