"""Processes for commands, forked from one that has already imported what they need.

Importing takes a second or two, the command itself often a tenth of that. A forked process has its
own signals, standard streams, exit status, working folder and environment. A test of the *start* of
Python needs a fresh interpreter instead.

`python nursery.py` is the process that forks, one for all processes of a run of tests. They connect
to its standard input, a socket, and send requests; for each it forks a keeper, which forks the
command and tells its process id and exit status.
"""

from __future__ import annotations

import atexit
import contextlib
import io
import json
import os
import resource
import select
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import IO, Any

#: The variable with the path at which the process that forks takes requests.
PLACE = "FACETS_NURSERY"
#: Slow modules that commands import.
HEAVY = (
    "numpy", "scipy.optimize", "scipy.stats", "scipy.special", "numba", "pandas", "pyarrow.parquet",
    "pyarrow.csv", "matplotlib.pyplot", "pydantic", "ruamel.yaml", "rich.table", "typer.main",
)  # fmt: skip
#: Further modules of a command, imported at the first request for that command.
OF_COMMANDS = {
    "render": ("pyvista", "facets.pictures.render", "facets.pictures.spots"),
    "optimize": ("casadi",),
}
#: Parts of the package that are loaded only if a command needs them.
LATE = (
    "facets.bench",
    "facets.cli",
    "facets.experiments",
    "facets.scalars",
    "facets.pictures.render",
)


def as_status(waited: int) -> int:
    """Exit status in the convention of `subprocess`: negative if a signal ended the process."""
    return os.waitstatus_to_exitcode(waited)


# --- in the process that forks -------------------------------------------------------------------


def prepare() -> None:
    """Import the modules of all commands and load the kernels that most of them call."""
    import gc
    import importlib
    import pkgutil

    from facets.cli import leave

    # as `facets.cli.program` does it: registered first, called last, in each command's process
    atexit.register(leave)
    os.environ.setdefault("MPLBACKEND", "agg")
    for name in HEAVY:
        importlib.import_module(name)
    import facets.cli

    import facets

    for module in facets.cli.COMMANDS.values():
        importlib.import_module(f"facets.cli.{module}")
    for part in pkgutil.walk_packages(facets.__path__, "facets."):
        if not part.name.startswith(LATE):
            importlib.import_module(part.name)
    sensor = facets.load("bench").sensor
    facets.solve(sensor, facets.readings(sensor, [0.0] * 8))
    gc.collect()
    gc.freeze()


def prepare_for(words: list[str]) -> None:
    """Import the modules that only the requested command needs."""
    import importlib

    for name in OF_COMMANDS.get(words[0] if words else "", ()):
        importlib.import_module(name)


def become(asked: dict[str, Any], streams: list[int]) -> None:
    """Turn the forked process into the command's.

    SIGHUP ends the process even if a shell's nohup ignores the signal.
    """
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    devnull = os.open(os.devnull, os.O_RDONLY)
    for number, stream in enumerate((devnull, *streams)):
        os.dup2(stream, number)
    for stream in (devnull, *streams):
        os.close(stream)
    os.chdir(asked["cwd"])
    os.environ.clear()
    os.environ.update(asked["env"])
    sys.argv = ["-c", *asked["words"]]
    if asked["limit"] is not None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (asked["limit"], asked["limit"]))
    sys.path[0] = ""
    for number, name in ((1, "stdout"), (2, "stderr")):
        raw = io.BufferedWriter(io.FileIO(number, "w", closefd=False))
        errors = "backslashreplace" if name == "stderr" else "strict"
        text = io.TextIOWrapper(raw, "utf-8", errors, line_buffering=name == "stderr")
        setattr(sys, name, text)
        setattr(sys, f"__{name}__", text)


def keep(request: dict[str, Any], fds: list[int]) -> bool:
    """Fork the command from the keeper, send its id, wait for it and send its status.

    fds: the command's standard output and error, and the reply pipe. True in the command's process.
    """
    *streams, tell = fds
    child = os.fork()
    if child == 0:
        os.close(tell)
        become(request, streams)
        return True
    for stream in streams:
        os.close(stream)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # ^C is the command's
    with contextlib.suppress(OSError):
        os.write(tell, f"{child}\n".encode())
    _, waited, spent = os.wait4(child, 0)
    with contextlib.suppress(OSError):
        seconds = spent.ru_utime + spent.ru_stime
        os.write(tell, f"{as_status(waited)} {seconds}\n".encode())
    os._exit(0)


def serve(alive: int) -> None:
    """Fork a process for each request until the process that started this one ends.

    alive: a pipe that this process holds open.
    """
    listener = socket.socket(fileno=os.dup(0))
    clients: list[socket.socket] = []
    is_prepared = False
    while True:
        ready = select.select([alive, listener, *clients], [], [])[0]
        if alive in ready:
            return
        for sender in ready:
            if sender is listener:
                clients.append(listener.accept()[0])
                continue
            text, fds, _, _ = socket.recv_fds(sender, 2**20, 3)
            if not text:
                clients.remove(sender)
                sender.close()
                continue
            if not is_prepared:
                prepare()
                is_prepared = True
            if fork_command(json.loads(text), list(fds), [listener, *clients]):
                return


def fork_command(request: dict[str, Any], fds: list[int], sockets: list[socket.socket]) -> bool:
    """Fork a keeper for a request; True in the processes that are forked, once they have ended."""
    with contextlib.suppress(ChildProcessError):
        while os.waitpid(-1, os.WNOHANG)[0]:
            pass
    prepare_for(request["words"])
    if os.fork() == 0:
        for each in sockets:
            each.close()
        if keep(request, fds):
            from facets.cli import main

            main()
        return True
    for fd in fds:
        os.close(fd)
    return False


# --- in the process of the tests -----------------------------------------------------------------


def start_nursery() -> None:
    """Start the process that forks; it imports what commands need at the first request."""
    folder = tempfile.mkdtemp(prefix="facets-")
    os.environ[PLACE] = f"{folder}/requests"
    alive, hold = os.pipe()
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listener:
        listener.bind(os.environ[PLACE])
        listener.listen()
        program = [sys.executable, str(Path(__file__).resolve()), str(alive)]
        process = subprocess.Popen(program, stdin=listener, pass_fds=[alive])
    os.close(alive)

    def end() -> None:
        os.close(hold)
        process.wait()
        shutil.rmtree(folder)

    atexit.register(end)


class Nursery:
    """Request processes for commands."""

    def __init__(self) -> None:
        if PLACE not in os.environ:
            start_nursery()
        self.asks = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.asks.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 2**20)
        self.asks.connect(os.environ[PLACE])

    def start(
        self, words: list[str], cwd: Path, env: dict[str, str], out: int, err: int,
        limit: int | None = None,
    ) -> Forked:  # fmt: skip
        """Start a command; `limit` is the largest size of its files, bytes."""
        told, tell = os.pipe()
        request = {"words": words, "cwd": str(cwd), "env": env, "limit": limit}
        try:
            socket.send_fds(self.asks, [json.dumps(request).encode()], [out, err, tell])
        finally:
            os.close(tell)
        return Forked(os.fdopen(told))


class Forked:
    """A running command with the part of `subprocess.Popen` that tests use."""

    stdout: IO[str]
    stderr: IO[str]

    def __init__(self, told: IO[str]) -> None:
        self.told, self.returncode = told, None
        self.pid = int(told.readline())

    def poll(self) -> int | None:
        return self._await(0.0)

    def wait(self, timeout: float | None = None) -> int:
        status = self._await(timeout)
        if status is None:
            raise subprocess.TimeoutExpired("facets", timeout or 0.0)
        return status

    def send_signal(self, number: int) -> None:
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)

    def _await(self, timeout: float | None) -> int | None:
        if self.returncode is None and select.select([self.told], [], [], timeout)[0]:
            status, seconds = self.told.readline().split()
            self.returncode, self.seconds = int(status), float(seconds)
            global SPENT
            SPENT += self.seconds
            self.told.close()
        return self.returncode


_made: list[Nursery] = []
SPENT = 0.0


def nursery() -> Nursery:
    if not _made:
        _made.append(Nursery())
    return _made[0]


if __name__ == "__main__":
    serve(int(sys.argv[1]))
