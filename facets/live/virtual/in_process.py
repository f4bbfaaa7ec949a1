"""A virtual bench in the process of a run, which shares its clock: `virtual:MOTION` as a port.

The clock advances only where the run asks the board for bytes, and it asks when it has solved all
that came and moved the stage. So a busy machine makes bench and run slower, but neither the samples
late nor the stage. Nobody else gets this clock: it comes with the board and the stage, or not.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING

from ...config.loading import load
from ...core.errors import InputError
from ...core.plain_numbers import assignments
from ...tracking.line import POLL_S
from ..run.live import Live
from ..run.reader import Reader
from ..sources.ports import VIRTUAL
from ..sources.source import Block
from .bench import PACKET_S, Bench
from .board import BenchSetup
from .faults import Faults
from .wire import Wire

if TYPE_CHECKING:
    from ...core.settings import Config

FORM = "virtual:MOTION,NAME=VALUE,..."
#: The most samples per second.
MOST_RATE = 200_000
#: A clock that is late by up to this time catches up with real time, s.
CATCHING_UP_S = 0.1


class SimulatedClock:
    """A clock, s, that only `advance` moves, but not faster than real time."""

    def __init__(self) -> None:
        self.time, self.due = time.monotonic(), 0.0

    def __call__(self) -> float:
        return self.time

    def advance(self, seconds: float) -> None:
        """Advance by some seconds, and sleep while the clock is ahead of the real one."""
        self.time += seconds
        self.due = max(self.due + seconds, time.monotonic() - CATCHING_UP_S)
        if (ahead := self.due - time.monotonic()) > 0:
            time.sleep(ahead)


class BenchInProcess(Bench):
    """A virtual bench as a source of bytes, by default of the rig that the run measures.

    name: of its port.  table: file of the reference's readings; "" without a reference.  clock: of
    the bench and of the run.
    """

    clock: SimulatedClock
    ended, waits = False, True

    def __init__(self, name: str, config: Config) -> None:
        """Raises `InputError` for a name that is not `FORM`, or has wrong values."""
        motion, comma, more = name.removeprefix(VIRTUAL).partition(",")
        names, option = ["config", "rate", "reference", *Faults.names()], f"the port {name}"
        words = assignments(more, option, names, FORM) if comma else {}
        other, rate = words.pop("config", ""), words.pop("rate", "10000")
        self.table = words.pop("reference", "")
        if not (rate.isdecimal() and 1 <= int(rate) <= MOST_RATE):
            raise InputError(f"{option}: rate is a whole number from 1 to {MOST_RATE}")
        faults = Faults.from_words(words, option)
        rig = load(other) if other else config
        setup = BenchSetup(rig, motion, int(rate), faults, reference=bool(self.table))
        super().__init__(setup, Path(), SimulatedClock())
        self.name, self.begin = name, self.clock()
        self.board.switch_on(self.begin)

    def open_lines(self, has_truth: bool) -> Wire:
        """Make the board's line; the bench has no other one."""
        self.line = Wire()
        return self.line

    def open_stage(self) -> StageLine:
        """Make the line to the bench's stage."""
        return StageLine(self)

    def read(self) -> bytes:
        """Let the clock advance by a packet of samples, and return what the board sends."""
        self.clock.advance(PACKET_S)
        self.round()
        return self.line.take()

    def write(self, data: bytes) -> bool:
        """Send bytes to the board."""
        self.line.received += data
        return True

    def close(self) -> None:
        """Nothing is held."""


class StageLine:
    """The line of a virtual stage, like a port of pyserial.  answers: bytes not read yet."""

    def __init__(self, bench: BenchInProcess) -> None:
        self.bench, self.answers = bench, b""

    def write(self, data: bytes) -> None:
        """Send bytes to the stage, and keep its answers."""
        self.answers += self.bench.receive(data)

    def read(self, size: int) -> bytes:
        """At most `size` bytes of the answers; without any, the clock advances by POLL_S and the
        result is empty."""
        if not self.answers:
            self.bench.clock.advance(POLL_S)
        data, self.answers = self.answers[:size], self.answers[size:]
        return data

    def close(self) -> None:
        """Nothing is held."""


class BenchReader(Reader):
    """Reads a virtual bench, and moves its stage, whenever the loop has nothing else to do."""

    is_stepped = True

    def __init__(self, bench: BenchInProcess, config: Config, live: Live) -> None:
        super().__init__(config, bench.name, True, live)
        self.port, live.note = bench, ""
        self.bench, self.due, self.remaining = bench, 0.0, self.steps()

    def start(self) -> None:
        """Begin without a thread, and discard the bytes that the board has sent until now."""
        self.bench.round()
        self.bench.line.take()

    def is_alive(self) -> bool:
        """Whether the bench neither failed nor ended."""
        return not (self.error or self.ending.is_set())

    def finish(self) -> None:
        """End, and write the readings of the reference if the port names a table for them."""
        super().finish()
        if self.bench.reference:
            self.bench.reference.write(Path(self.bench.table))

    def next_block(self, wait: float = 0.0) -> Block:
        """Return the next block; let stage and board go on first where the loop waits for it."""
        if wait:
            tracker, now = self.live.tracker, self.bench.clock()
            if tracker and now >= self.due:
                self.due = max(self.due + 1 / tracker.settings.rate, now)
                tracker.step()
            next(self.remaining, None)
        return super().next_block()
