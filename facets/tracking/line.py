"""A serial line of a stage, read as whole lines, which may arrive late and in pieces.

A late answer on a busy machine is accepted; a stage that has not answered for PATIENCE_S is dead.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from .stage import StageError

#: A stage that has not answered completely within this time counts as dead, s.
PATIENCE_S = 5.0
#: Longest time for which one read waits for bytes, s.
POLL_S = 0.02
#: Longest time for which one write waits for space in the port, or for another thread's write, s.
WRITE_TIMEOUT_S = 1.0
#: Largest number of bytes without a line end; more are refused.
MAX_ANSWER_BYTES = 1000


class Line:
    """A serial line.  port: open, with `read`, `write` and `close` like pyserial's.  clock: s.

    Every thread may write; only one may read.
    """

    def __init__(self, port: Any, clock: Callable[[], float]) -> None:
        self.port, self.clock = port, clock
        self.rest = b""
        self.writing = threading.Lock()
        with suppress(Exception):  # a port of another kind keeps its own timeouts
            port.timeout, port.write_timeout = POLL_S, WRITE_TIMEOUT_S

    def write(self, data: bytes) -> None:
        """Send all data, after waiting at most WRITE_TIMEOUT_S for another thread's write."""
        held = self.writing.acquire(timeout=WRITE_TIMEOUT_S)
        try:
            self.port.write(data)
        finally:
            if held:
                self.writing.release()

    def read_line(self, patience: float = PATIENCE_S) -> str:
        """The next line without its end; raises `StageError` if none comes within `patience`, s, or
        the stage sends no lines."""
        deadline = self.clock() + patience
        while b"\n" not in self.rest:
            if self.clock() > deadline:
                raise StageError(
                    f"the stage has not answered for {patience:g} s: check that it is on, and its "
                    "port and baud rate"
                )
            self.rest += self.port.read(max(1, getattr(self.port, "in_waiting", 0) or 0))
            if len(self.rest.rpartition(b"\n")[2]) > MAX_ANSWER_BYTES:
                raise StageError(f"the stage sends data without line ends: {self.rest[:40]!r}")
        line, _, self.rest = self.rest.partition(b"\n")
        return line.decode("ascii", "replace").rstrip("\r")

    def drain(self) -> None:
        """Discard the data that a stage sent before the first command."""
        self.rest = b""
        deadline = self.clock() + 10 * POLL_S
        while self.clock() < deadline and self.port.read(MAX_ANSWER_BYTES):
            pass

    def close(self) -> None:
        self.port.close()
