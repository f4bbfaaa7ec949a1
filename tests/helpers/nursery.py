"""Commands in processes that are forked from a server, which has imported what they need.

Importing takes a second or two, the command itself often a tenth of that. A forked process has its
own signals, standard streams, exit status, working folder and environment. A test of the *start* of
Python needs a fresh interpreter instead.
"""

from __future__ import annotations

import atexit
import io
import multiprocessing
import os
import resource
import signal
import subprocess
import sys
import threading
from multiprocessing import forkserver, reduction
from pathlib import Path
from typing import Any
from unittest.mock import patch

FORKS = multiprocessing.get_context("forkserver")
FORKS.set_forkserver_preload(["prepared"])


#: Two threads that exchange the environment at once would leave one's behind.
BEGINNING = threading.Lock()


class Stream(int):
    """The number of an open file that a process hands to the one it starts."""

    def __reduce__(self) -> tuple[object, ...]:
        return take, (reduction.DupFd(int(self)),)


def take(handed: Any) -> int:
    return handed.detach()


class Forked(FORKS.Process):  # type: ignore[name-defined, misc]
    """A running command, with the part of `subprocess.Popen` that tests use."""

    def __init__(
        self, words: list[str], cwd: Path, env: dict[str, str], out: int, err: int,
        limit: int | None = None,
    ) -> None:  # fmt: skip
        """Start a command; `limit` is the largest size of its files, bytes."""
        super().__init__()
        self.words, self.cwd, self.env, self.limit = words, cwd, env, limit
        self.streams = Stream(out), Stream(err)
        # or it would find neither `prepared` nor, in a copy of the sources, the copy
        with BEGINNING, patch.dict(os.environ, PYTHONPATH=os.pathsep.join(filter(None, sys.path))):
            forkserver.ensure_running()
        self.start()

    def run(self) -> None:
        """What the forked process does; SIGHUP ends it even where a shell's nohup ignores that."""
        from facets.cli import main

        signal.signal(signal.SIGHUP, signal.SIG_DFL)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        for number, stream in enumerate((os.open(os.devnull, os.O_RDONLY), *self.streams)):
            os.dup2(stream, number)
            os.close(stream)
        os.chdir(self.cwd)
        os.environ.clear()
        os.environ.update(self.env)
        sys.argv = ["-c", *self.words]
        if self.limit is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (self.limit, self.limit))
        sys.path[0] = ""
        for number, name in ((1, "stdout"), (2, "stderr")):
            raw = io.BufferedWriter(io.FileIO(number, "w", closefd=False))
            errors = "backslashreplace" if name == "stderr" else "strict"
            text = io.TextIOWrapper(raw, "utf-8", errors, line_buffering=name == "stderr")
            setattr(sys, name, text)
            setattr(sys, f"__{name}__", text)
        try:
            main()
        finally:
            atexit._run_exitfuncs()

    def poll(self) -> int | None:
        """The exit status, negative if a signal ended the process; None while it runs."""
        return self.exitcode

    def wait(self, timeout: float | None = None) -> int:
        self.join(timeout)
        if self.exitcode is None:
            raise subprocess.TimeoutExpired("facets", timeout or 0.0)
        return self.exitcode

    def send_signal(self, number: int) -> None:
        if self.exitcode is None:
            os.kill(self.pid, number)
