"""A serial line of a stage: whole lines, which may come in pieces and late, from one that answers.

A stage that answers late on a busy machine is slow; one that has not answered for
PATIENCE_S is dead.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from .stage import StageError

#: A stage that has not answered completely within this time is taken for dead, s.
PATIENCE_S = 5.0
#: One read waits up to this time for bytes, s.
POLL_S = 0.02
#: One write waits up to this time for room in the port, or for another thread's write, s.
WRITE_TIMEOUT_S = 1.0
#: A stage's answer that is longer than this is no answer.
MAX_ANSWER_BYTES = 1000


class Line:
    """port: open, as pyserial's, with `read`, `write` and `close`. clock: monotonic, s.

    Writing is safe from every thread, reading belongs to one.
    """

    def __init__(self, port: Any, clock: Callable[[], float]) -> None:
        self.port, self.clock = port, clock
        self.rest = b""
        self.writing = threading.Lock()
        with suppress(Exception):  # a port of another kind keeps its own
            port.timeout, port.write_timeout = POLL_S, WRITE_TIMEOUT_S

    def write(self, data: bytes) -> None:
        """Sends all of it; waits for another thread's writing no longer than a write may take."""
        held = self.writing.acquire(timeout=WRITE_TIMEOUT_S)
        try:
            self.port.write(data)
        finally:
            if held:
                self.writing.release()

    def read_line(self, patience: float = PATIENCE_S) -> str:
        """The next line without its end; raises where the stage is dead, or sends no lines."""
        deadline = self.clock() + patience
        while b"\n" not in self.rest:
            if self.clock() > deadline:
                raise StageError(
                    f"the stage has not answered for {patience:g} s: check that it is on, and its "
                    "port and baud rate"
                )
            self.rest += self.port.read(max(1, getattr(self.port, "in_waiting", 0) or 0))
            if len(self.rest) > MAX_ANSWER_BYTES:
                raise StageError(f"the stage sends data without line ends: {self.rest[:40]!r}")
        line, _, self.rest = self.rest.partition(b"\n")
        return line.decode("ascii", "replace").rstrip("\r")

    def drain(self) -> None:
        """Passes over what a stage sent before anyone asked."""
        self.rest = b""
        deadline = self.clock() + 10 * POLL_S
        while self.clock() < deadline and self.port.read(MAX_ANSWER_BYTES):
            pass

    def close(self) -> None:
        self.port.close()
