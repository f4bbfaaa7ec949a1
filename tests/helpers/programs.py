"""Commands that go on while a test looks at them; a test waits for what they do, not for seconds.

Every wait ends in an error after GUARD seconds, on any machine: it is there for a program that
hangs, and no test passes or fails by it.
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
    """Waits until something is so."""
    last = time.monotonic() + GUARD
    while not true():
        assert time.monotonic() < last, f"waited in vain: {what}"
        time.sleep(0.01)


class Program:
    """`facets WORDS` in a folder; its output is read as it comes. Ended at the end of a `with`.

    env: what is to be added to the environment; it then begins in a fresh interpreter.
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
        """Waits until it has said so, which it must do before it ends."""
        await_true(lambda: words in self.stdout + self.stderr or not self.running, words)
        assert words in self.stdout + self.stderr, self.stderr

    def await_true(self, true: Callable[[], object], what: str) -> None:
        """Waits until something is so, which must be before it ends."""
        await_true(lambda: true() or not self.running, what)
        assert true(), f"ended before: {what}\n{self.stdout}{self.stderr}"

    def end(self, number: int | None = signal.SIGINT) -> int:
        """Sends a signal, if one is given, and waits for the end; the exit status."""
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
    """How often words are in a file, which may not be there yet."""
    return path.read_text().count(words) if path.exists() else 0


def size_of(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0
