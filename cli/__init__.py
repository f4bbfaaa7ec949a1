"""The command `facets`. One file per subcommand; what is heavy is imported inside the command.

Exit status, of every command:

0    done, and nothing to tell beside the result
1    done, and the results are written, but with a finding that must be seen: a claim missed or not
     proved, a table of which nothing could be solved, samples lost beyond what is allowed
2    not done: an argument, a file or a place for the results that can not be used; nothing is
     left half-written. Also where the standard output could not be written
130  interrupted by ^C, 143 ended by SIGTERM, 129 by the end of the terminal (SIGHUP); what was
     done until then is kept where a command says so. The live commands, which run until they are
     told to end, take ^C as that, and end with 0 or 1
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from facets import __version__
from facets.core.errors import FacetsError

from . import config, signals
from .acquire import acquire
from .bench import bench
from .calibrate import calibrate
from .console import BAD_INPUT, INTERRUPTED, Guarded, message
from .emulate import emulate
from .explore import explore
from .jacobian import jacobian
from .noise import noise
from .optimize import optimize
from .range_map import range_map
from .render import render
from .replay import recover, replay
from .reproduce import reproduce
from .resolution import resolution
from .simulate import simulate
from .solve import solve

#: Options as older versions spelt them, and as they are spelt.
OLDER_NAMES = {"tracking": "track"}

app = typer.Typer(
    name="facets",
    help="Three-facet-mirror 6-DOF sensor: a YAML configuration to readings, poses and errors.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={
        "help_option_names": ["-h", "--help"],
        "token_normalize_func": lambda name: OLDER_NAMES.get(name, name),
    },
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
    """Entry point: an expected error becomes a message on stderr and exit status 2."""
    with signals.interrupting(), Guarded() as streams:
        status = signals.status_of(run_app())
        if failure := streams.failure():
            print(failure, file=sys.stderr)
            status = status or BAD_INPUT
    sys.exit(status)


def run_app() -> int:
    """Runs the command that the arguments name; its exit status."""
    try:
        Path.cwd()
    except OSError:
        print("error: the working folder is gone; change to one that exists", file=sys.stderr)
        return BAD_INPUT
    try:
        app()
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else int(end.code is not None)
        if code == INTERRUPTED:  # which typer makes of it without a word
            print("interrupted", file=sys.stderr)
        return code
    except FacetsError as error:
        print(message(error), file=sys.stderr)
    except OSError as error:  # a file that went or filled up in the middle of a command
        about = f"{error.filename}: " if error.filename else ""
        print(f"error: {about}{error.strerror or error}", file=sys.stderr)
    except MemoryError:
        print("error: not enough memory; ask for less at once", file=sys.stderr)
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return INTERRUPTED
    return BAD_INPUT


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
app.command()(noise)
app.command()(emulate)
app.command()(render)
app.command()(bench)
app.command()(reproduce)
app.add_typer(config.app, name="config")
