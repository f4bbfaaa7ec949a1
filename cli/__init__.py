"""The command `facets`. Each subcommand has a file; heavy modules are imported inside it.

Exit status, of every command:

0    The command succeeded.
1    The command wrote its results, but something needs attention: a claim was missed or not
     proved, no row of a table was solved, too many samples were lost, or a picture could not be
     drawn.
2    The command failed: an argument, a file or the place for the results cannot be used, or the
     standard output could not be written. No file is left half-written.
130  The command was interrupted by ^C (143: by SIGTERM, 129: by closing the terminal, SIGHUP).
     Results until then are kept if the help of the command says so. acquire and emulate, which
     run until they are stopped, end with 0 or 1 after ^C.
"""

from __future__ import annotations

import atexit
import gc
import importlib
import os
import sys
from collections.abc import Iterable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Annotated, Any

import typer

from facets import __version__
from facets.core.errors import FacetsError

from . import signals
from .command import Command, Group
from .console import BAD_INPUT, DONE, FINDING, INTERRUPTED, message, undrawn
from .streams import Guarded

#: The commands by subject, in the order of the help.
SUBJECTS = {
    "Simulate and design": "simulate range-map resolution optimize tolerances explore render",
    "Calibrate": "calibrate rezero",
    "Measure live": "acquire replay emulate export-c",
    "Analyse": "solve noise axis response",
    "The paper and proofs": "jacobian reproduce bench",
    "Configurations": "config",
}
#: The subject of each command.
COMMANDS = {name: subject for subject, names in SUBJECTS.items() for name in names.split()}
#: Commands that run until they are stopped; the others end before much memory needs tidying.
LIVE = ("acquire", "emulate")
#: Thresholds of the garbage collector; the usual ones would scan all modules during the imports.
ALLOCATIONS = 10_000
#: Variables by which pictures depend on no settings of the user, such as a notebook's backend.
MATPLOTLIB = {"MPLBACKEND": "agg", "MATPLOTLIBRC": os.devnull}
#: The exit status, once the command has ended.
_ended: list[int] = []


def app_of(names: Iterable[str]) -> typer.Typer:
    """Make the program with these commands alone, to avoid importing and describing the others."""
    made = typer.Typer(
        name="facets",
        cls=Group,
        help="Design, simulate, calibrate and run a three-facet-mirror 6-DOF sensor.",
        no_args_is_help=True,
        rich_markup_mode=None,
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    made.callback()(_root)
    for name in names:
        function, subject = name.replace("-", "_"), COMMANDS[name]
        module = importlib.import_module(f".{function}", __name__)
        if name == "config":
            made.add_typer(module.app, name=name, rich_help_panel=subject)
        else:
            made.command(name, cls=Command, rich_help_panel=subject)(getattr(module, function))
    return made


@cache
def whole_app() -> typer.Typer:
    return app_of(COMMANDS)


def __getattr__(name: str) -> Any:
    """Make `app`, the program with all its commands, at its first use."""
    if name != "app":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return whole_app()


def read_arguments() -> list[str]:
    """Return the command line, or the part of it that a shell asks to complete."""
    if len(sys.argv) == 1 and "_FACETS_COMPLETE" in os.environ:
        typed = os.environ.get("COMP_WORDS") or os.environ.get("_TYPER_COMPLETE_ARGS", "")
        return typed.split()
    return sys.argv


def app_for_arguments() -> typer.Typer:
    """Make the program with the command that the arguments name, or with all if they name none."""
    first = next(iter(read_arguments()[1:]), "")
    alone = first in COMMANDS and not whole_app.cache_info().currsize
    return app_of([first]) if alone else whole_app()


def _version(is_requested: bool) -> None:
    if is_requested:
        print(f"facets {__version__}")
        raise typer.Exit


def _root(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_version, is_eager=True, help="Print the version."),
    ] = False,
) -> None:
    """Options before the command."""


def program() -> None:
    """Entry point of the program: `main`, with little work before and after it.

    A short command would spend a tenth of its time on collecting garbage during the imports, and
    another tenth on deleting modules at the end.
    """
    atexit.register(leave)  # the first to be registered is the last to be called
    if sys.argv[1:2] not in [[name] for name in LIVE]:
        gc.set_threshold(ALLOCATIONS, *gc.get_threshold()[1:])
    main()


def leave() -> None:
    """End the process if `main` has ended; otherwise Python ends it as usual."""
    if _ended:
        for stream in (sys.stdout, sys.stderr):
            with suppress(AttributeError, OSError, ValueError):
                stream.flush()
        os._exit(_ended[-1])


def main() -> None:
    """Run the program and exit; an expected error gives a message on stderr and exit status 2."""
    os.environ.update(MATPLOTLIB)
    undrawn.clear()
    with signals.interrupting(), Guarded() as streams:
        status = signals.status_of(run_app()) or (FINDING if undrawn else DONE)
        if failure := streams.failure():
            print(failure, file=sys.stderr)
            status = status or BAD_INPUT
    _ended.append(status)
    sys.exit(status)


def run_app() -> int:
    """Run the command that the arguments name; return its exit status."""
    try:
        Path.cwd()
    except OSError:
        print("error: the working folder is gone; change to one that exists", file=sys.stderr)
        return BAD_INPUT
    try:
        app_for_arguments()(prog_name="facets")
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else int(end.code is not None)
        if code != INTERRUPTED:  # the status that typer gives an interruption without a message
            return code
    except (FacetsError, OSError, MemoryError) as error:
        print(message(error), file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        pass
    except Exception:
        # worker processes that start when a signal comes can raise other errors
        if signals.caught() is None:
            raise
    print("interrupted", file=sys.stderr)
    return INTERRUPTED
