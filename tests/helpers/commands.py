"""Commands as a person runs them: a process of its own, in a folder of its own."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

from nursery import Forked, nursery

#: The program in a fresh interpreter, for what is said about that.
PROGRAM = [sys.executable, "-c", "from facets.cli import program; program()"]


def start(*words: str, cwd: Path, out: int, err: int) -> Forked:
    """`facets WORDS`, started in `cwd` with its output sent to two open files."""
    return nursery().start(list(words), cwd, dict(os.environ), out, err)


def command(
    *words: str, cwd: Path, env: dict[str, str] | None = None, limit: int | None = None
) -> subprocess.CompletedProcess[str]:
    """`facets WORDS`, run in `cwd`, with what it printed and its exit status.

    env: what is to be added to the environment, but for what Python looks at when it starts.
    limit: the bytes that no file may pass.
    """
    whole = {**os.environ, **(env or {})}
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as err:
        process = nursery().start(list(words), cwd, whole, out.fileno(), err.fileno(), limit)
        try:
            status = process.wait(600)
        finally:
            process.kill()
        texts = []
        for file in (out, err):
            file.seek(0)
            texts.append(file.read())
    return subprocess.CompletedProcess(list(words), status, *texts)
