"""Run commands in a separate process and folder, as a person does."""

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from nursery import Forked

#: The program in a fresh interpreter, for tests of its start.
PROGRAM = [sys.executable, "-c", "from facets.cli import program; program()"]


def all_commands() -> Iterator[tuple[Any, Any]]:
    """Yield every command of the program, those of groups among them, with its context."""
    import typer
    from facets.cli import whole_app

    open_groups = [(typer.main.get_command(whole_app()), "facets", None)]
    for group, name, parent in open_groups:
        context = group.context_class(group, info_name=name, parent=parent)
        inner = getattr(group, "commands", {})
        open_groups += [(part, called, context) for called, part in inner.items()]
        if not inner:
            yield context, group


def start(*words: str, cwd: Path, out: int, err: int) -> Forked:
    """Start `facets WORDS` in `cwd` with its output sent to two open files."""
    return Forked(list(words), cwd, dict(os.environ), out, err)


def command(
    *words: str, cwd: Path, env: dict[str, str] | None = None, limit: int | None = None
) -> subprocess.CompletedProcess[str]:
    """Run `facets WORDS` in `cwd` and return its output and exit status.

    env: additions to the environment, except variables that Python reads at its start. The size of
    the tests' own terminal is left out.
    limit: largest size of a file, bytes.
    """
    whole = {name: text for name, text in os.environ.items() if name != "COLUMNS"} | (env or {})
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as err:
        process = Forked(list(words), cwd, whole, out.fileno(), err.fileno(), limit)
        try:
            status = process.wait(600)
        finally:
            process.kill()
        texts = []
        for file in (out, err):
            file.seek(0)
            texts.append(file.read())
    return subprocess.CompletedProcess(list(words), status, *texts)
