"""Commands that run during a test, which waits for their effects instead of a fixed time.

Every wait ends in an error after GUARD seconds; this only stops a program that hangs and decides
no other test.
"""

import os
import signal
import subprocess
import threading
import time
from collections.abc import Callable
from pathlib import Path

from commands import PROGRAM, start
from nursery import Forked

GUARD = 1200.0


def await_true(true: Callable[[], object], what: str) -> None:
    """Wait until a condition is true."""
    last = time.monotonic() + GUARD
    while not true():
        assert time.monotonic() < last, f"waited in vain: {what}"
        time.sleep(0.01)


class Program:
    """Run `facets WORDS` in a folder and read its output; the end of a `with` ends the program.

    env: additions to the environment, which require a fresh interpreter.
    """

    def __init__(self, *words: str, cwd: Path, env: dict[str, str] | None = None) -> None:
        (out, to_out), (err, to_err) = os.pipe(), os.pipe()
        try:
            self.process: Forked | subprocess.Popen[bytes]
            if env is None:
                self.process = start(*words, cwd=cwd, out=to_out, err=to_err)
            else:
                self.process = subprocess.Popen(
                    [*PROGRAM, *words], cwd=cwd, stdout=to_out, stderr=to_err,
                    env={**os.environ, **env},
                )  # fmt: skip
        finally:
            os.close(to_out)
            os.close(to_err)
        self.streams = {"stdout": os.fdopen(out), "stderr": os.fdopen(err)}
        self.lines: dict[str, list[str]] = {name: [] for name in self.streams}
        self.threads = [threading.Thread(target=self.read, args=(name,)) for name in self.streams]
        for thread in self.threads:
            thread.start()

    def read(self, name: str) -> None:
        for line in self.streams[name]:
            self.lines[name].append(line)

    @property
    def stdout(self) -> str:
        return "".join(self.lines["stdout"])

    @property
    def stderr(self) -> str:
        return "".join(self.lines["stderr"])

    @property
    def running(self) -> bool:
        return self.process.poll() is None

    def await_output(self, words: str) -> None:
        """Wait until the program has printed `words`; fail if it ends before."""
        await_true(lambda: words in self.stdout + self.stderr or not self.running, words)
        assert words in self.stdout + self.stderr, self.stderr

    def await_true(self, true: Callable[[], object], what: str) -> None:
        """Wait until a condition is true; fail if the program ends before."""
        await_true(lambda: true() or not self.running, what)
        assert true(), f"ended before: {what}\n{self.stdout}{self.stderr}"

    def end(self, number: int | None = signal.SIGINT) -> int:
        """Send a signal, if one is given, wait for the end and return the exit status."""
        if number is not None and self.running:
            self.process.send_signal(number)
        status = self.process.wait(GUARD)
        for thread in self.threads:
            thread.join()
        return status

    def __enter__(self) -> "Program":
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.end(None)
        for stream in self.streams.values():
            stream.close()


def count_lines(path: Path, words: str) -> int:
    """Count words in a file, which may not exist yet."""
    return path.read_text().count(words) if path.exists() else 0


def size_of(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0
