"""The thread that reads a source and does nothing else that takes time."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import nullcontext, suppress
from math import nan
from queue import SimpleQueue

from ...core.errors import FacetsError
from ...core.settings import Config
from ...tracking.priority import urgent
from ..sources.ports import ConnectionPort, SerialPort, await_port, open_port
from ..sources.source import Block, PortError, Source
from .live import Live
from .pipeline import BATCH

#: Time between attempts to open a port again, s.
REOPEN_INTERVAL_S = 0.2
#: A second connection is opened if the first has received nothing for this time, s.
HALF_OPEN_S = 5.0
#: Bytes that a line gives within this time after its opening were sent before, s.
DISCARD_S = 0.1
#: A source that loses nothing is not read while this many batches wait to be solved.
MAX_WAITING_BATCHES = 50
#: Bytes are passed on to a busy loop after this time, s.
MAX_BLOCK_S = 0.015


class Reader(threading.Thread):
    """Reads a source, gives its blocks to the sinks, and queues them for the loop.

    The thread ends at the source's end, or with an error in `error`. A block is passed on at once
    where the loop waits for it. Where the loop is busy, the block grows for up to `MAX_BLOCK_S`:
    each block has a fixed cost, and a few large blocks let the loop catch up.

    is_stepped: whether the loop reads the source and moves the stage itself, in one thread, while
    it waits for a block, because the run's clock is that of a virtual bench.
    """

    is_stepped = False

    def __init__(
        self,
        config: Config,
        name: str,
        reconnect: bool,
        live: Live,
        on_progress: Callable[[str], None] = lambda _: None,
    ) -> None:
        """Open the port, waiting for it for up to `acquire.wait_s` of the configuration.

        reconnect: wait for the port in the thread instead, without end, and again whenever it
        disappears.  on_progress: receives a sentence if there is something to wait for.
        """
        super().__init__(name="reader", daemon=True)
        self.settings, self.port_name = config.acquire, name
        self.reconnect, self.live = reconnect, live
        self.port: Source | None = None
        self.spare: ConnectionPort | None = None  # a second connection while the first is silent
        self.heard = time.monotonic()
        if reconnect:
            live.note = f"waiting for {name}"
        else:
            self.port = await_port(name, config.acquire.baud, config.acquire.wait, on_progress)
        self.queue: SimpleQueue[Block] = SimpleQueue()
        self.pending = bytearray()  # bytes that came since the last block
        self.since = self.arrival = 0.0  # when the first and the last of them came
        self.ending = threading.Event()
        self.error: FacetsError | None = None

    def run(self) -> None:
        """Read the port until the source or the run ends."""
        for _ in self.steps():
            pass

    def steps(self) -> Iterator[None]:
        """Read until the end of the source or of the run, step by step; close the port then."""
        try:
            with nullcontext() if self.port and self.port.waits else urgent():
                self.discard_old_bytes()
                while not self.ending.is_set() and (self.port is None or not self.port.ended):
                    self.step()
                    yield
        except FacetsError as error:
            self.error = error
        except Exception as error:
            self.error = FacetsError(
                f"{self.port_name}: reading ended: {type(error).__name__}: {error}"
            )
        finally:
            self.pass_on()
            self.close_port()

    def close_port(self) -> None:
        """Close the port and a second connection; a port that disappeared may refuse even that."""
        self.close_spare()
        port, self.port = self.port, None
        if port is not None:
            with suppress(Exception):
                port.close()

    def close_spare(self) -> None:
        """Close the port that was opened in advance, if any."""
        if self.spare is not None:
            self.spare.close()
            self.spare = None

    def discard_old_bytes(self) -> None:
        """Discard the bytes in a line's buffers that were sent before the run."""
        begin = time.monotonic()
        while (
            isinstance(self.port, SerialPort | ConnectionPort)
            and time.monotonic() - begin < DISCARD_S
        ):
            self.port.read()

    def step(self) -> None:
        """Read once, or open the port again if it disappeared. Raises the error of the port unless
        it shall be opened again."""
        if self.port is None:
            self.reopen()
            return
        if self.port.waits and self.queue.qsize() + self.live.backlog / BATCH > MAX_WAITING_BATCHES:
            self.ending.wait(0.001)
            return
        try:
            data = self.read()
        except PortError as error:
            self.pass_on()
            self.live.add_event("unplugged", reason=str(error))
            self.close_port()
            if not self.reconnect:
                raise
            self.live.note = "unplugged; waiting for it to come back"
            return
        self.live.port_message = getattr(self.port, "message", "")
        if data:
            self.close_spare()
            self.heard = time.monotonic()
            self.arrival = self.live.clock()
            self.since = self.since if self.pending else self.arrival
            self.pending += data
        if self.port.waits or self.loop_is_idle() or self.live.clock() - self.since > MAX_BLOCK_S:
            self.pass_on()

    def read(self) -> bytes:
        """Return the bytes that came, from a second connection if the first one is silent.

        A board that lost its power, or a network that forgot the connection, closes nothing: the
        connection looks open for ever. The silent one stays open meanwhile, since a board may be
        silent on purpose.
        """
        data, now = self.port.read() if self.port else b"", time.monotonic()
        if data or not (self.reconnect and isinstance(self.port, ConnectionPort)):
            return data
        try:
            if self.spare is None and now - self.heard > HALF_OPEN_S:
                self.heard = now
                self.spare = ConnectionPort(self.port_name)
            data = self.spare.read() if self.spare else b""
        except PortError:
            self.close_spare()
            return b""
        if self.spare and data:
            self.live.add_event("unplugged", reason="a second connection brings bytes")
            spare, self.spare = self.spare, None
            self.close_port()
            self.use_port(spare)
        return data

    def loop_is_idle(self) -> bool:
        """Whether the loop has nothing to do but to wait for the next block."""
        return self.queue.empty() and not self.live.backlog

    def pass_on(self) -> None:
        """Pass the bytes since the last block on to the sinks and the loop, as a block."""
        if not self.pending:
            return
        data = bytes(self.pending)
        self.pending.clear()
        tracker = self.live.tracker
        # the bytes of a file came at unknown times; the time of the first ones is the origin
        waits = self.port is not None and self.port.waits and not self.is_stepped
        arrival = nan if waits and self.live.bytes else self.arrival
        block = Block(data, arrival, tracker.encoder if tracker else None)
        for sink in self.live.sinks:
            sink.add_block(block)
        self.live.bytes += len(data)
        self.queue.put(block)

    def reopen(self) -> None:
        """Try to open the port; wait for REOPEN_INTERVAL_S if it cannot be opened."""
        try:
            self.use_port(open_port(self.port_name, self.settings.baud))
        except PortError:
            self.ending.wait(REOPEN_INTERVAL_S)

    def use_port(self, port: Source) -> None:
        """Read another port from now on."""
        self.port, self.heard = port, time.monotonic()
        self.live.reconnects += self.live.bytes > 0
        self.live.note = ""
        self.live.add_event("connected again" if self.live.bytes else "connected")

    def next_block(self, wait: float = 0.0) -> Block:
        """Return the next block; raise `Empty` if none comes within `wait` seconds."""
        return self.queue.get(timeout=wait) if wait else self.queue.get_nowait()

    def write(self, data: bytes) -> bool:
        """Send bytes to the board, from any thread; return whether the line took them."""
        send = getattr(self.port, "write", None)
        return bool(send and send(data))

    def finish(self) -> None:
        """End the thread, and wait for it."""
        self.ending.set()
        if self.is_alive():
            self.join(timeout=5.0)
        self.close_port()
