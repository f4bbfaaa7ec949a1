"""A serial line of a stage: whole lines, which may come in pieces and late, from one that answers.

A stage that answers late on a busy machine is slow; one that has not answered for PATIENCE is dead.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from .stage import StageError

#: After so long without the whole of an answer the stage is taken for dead, s.
PATIENCE = 5.0
#: How long one read waits for more bytes, and one write for room, s.
POLL, WRITE = 0.02, 1.0
#: No answer of a stage is as long as this, bytes.
LONGEST = 1000


class Line:
    """port: open, as pyserial's, with `read`, `write` and `close`. clock: monotonic, s.

    Writing is safe from every thread, reading belongs to one.
    """

    def __init__(self, port: Any, clock: Callable[[], float]) -> None:
        self.port, self.clock = port, clock
        self.rest = b""
        self.writing = threading.Lock()
        with suppress(Exception):  # a port of another kind keeps its own
            port.timeout, port.write_timeout = POLL, WRITE

    def write(self, data: bytes) -> None:
        """Sends all of it; waits for another thread's writing no longer than a write may take."""
        held = self.writing.acquire(timeout=WRITE)
        try:
            self.port.write(data)
        finally:
            if held:
                self.writing.release()

    def read_line(self, patience: float = PATIENCE) -> str:
        """The next line without its end; raises where the stage is dead, or sends no lines."""
        deadline = self.clock() + patience
        while b"\n" not in self.rest:
            if self.clock() > deadline:
                raise StageError(
                    f"the stage has not answered for {patience:g} s: is it on, and at the right "
                    "port and baud?"
                )
            self.rest += self.port.read(max(1, getattr(self.port, "in_waiting", 0) or 0))
            if len(self.rest) > LONGEST:
                raise StageError(f"the stage sends what has no lines: {self.rest[:40]!r}")
        line, _, self.rest = self.rest.partition(b"\n")
        return line.decode("ascii", "replace").rstrip("\r")

    def drain(self) -> None:
        """Passes over what a stage sent before anyone asked."""
        self.rest = b""
        deadline = self.clock() + 10 * POLL
        while self.clock() < deadline and self.port.read(LONGEST):
            pass

    def close(self) -> None:
        self.port.close()
