"""A stream recorded and solved as it comes.

One thread reads and records, and does nothing else; this one solves; a third moves the stage. What
the solver has not got to yet waits in a queue whose length is told.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..estimation.solver import Status
from ..tracking.tracker import Tracker
from .pipeline import Pipeline, Poses
from .ports import Port, PortError, SerialPort, open_port
from .recording import Block, DiskError, Recording

if TYPE_CHECKING:
    from ..core.errors import FacetsError
    from ..core.settings import Config

#: After so long with bytes but without a sample something is set wrongly, s.
PATIENCE = 2.0
#: Between attempts to open a port again, s.
AGAIN = 0.2
#: What comes in the first moment was sent before, s.
DRAIN = 0.1
#: A queue this long is told of, blocks.
BACKLOG = 100


@dataclass
class Live:
    """What is to be shown of a run, at any time. latency: s, of the newest blocks, from their last
    byte to their poses.  backlog: blocks that wait, and the most that did."""

    pipeline: Pipeline
    begin: float = field(default_factory=time.monotonic)
    newest: Poses | None = None
    latency: list[float] = field(default_factory=list)
    backlog: int = 0
    most: int = 0
    bytes: int = 0
    reconnects: int = 0
    tracker: Tracker | None = None
    note: str = ""

    @property
    def loss(self) -> float:
        """Samples that never came, as a share of all."""
        lost = self.pipeline.sequence.lost
        return lost / max(1, lost + self.pipeline.tally.samples)

    def ninety_nine(self) -> float:
        """The 99th percentile of the latency, s."""
        return float(np.quantile(self.latency[-5000:], 0.99)) if self.latency else float("nan")


class Reader(threading.Thread):
    """Reads and records. Ends by itself at the port's end, or with an error in `error`."""

    def __init__(
        self, config: Config, name: str, recording: Recording | None, reconnect: bool, live: Live
    ) -> None:
        super().__init__(name="reader", daemon=True)
        self.settings, self.port_name = config.acquire, name
        self.recording, self.reconnect, self.live = recording, reconnect, live
        self.port: Port | None = None
        if reconnect:
            live.note = f"waiting for {name}"
        else:
            self.port = open_port(name, config.acquire.baud)
        self.queue: SimpleQueue[Block] = SimpleQueue()
        self.ending = threading.Event()
        self.error: FacetsError | None = None

    def run(self) -> None:
        try:
            self.drain()
            while not self.ending.is_set() and (self.port is None or not self.port.ended):
                self.step()
        except (PortError, DiskError) as error:
            self.error = error
        finally:
            if self.port is not None:
                self.port.close()

    def drain(self) -> None:
        """Passes over what buffers held from before."""
        begin = time.monotonic()
        while isinstance(self.port, SerialPort) and time.monotonic() - begin < DRAIN:
            self.port.read()

    def step(self) -> None:
        if self.port is None:
            self.open_again()
            return
        try:
            data = self.port.read()
        except PortError as error:
            self.event("unplugged", reason=str(error))
            self.port.close()
            self.port = None
            if not self.reconnect:
                raise
            self.live.note = "unplugged; waiting for it to come back"
            return
        if data:
            self.take(data)

    def take(self, data: bytes) -> None:
        tracker = self.live.tracker
        block = Block(data, time.monotonic(), tracker.encoder if tracker else None)
        if self.recording:
            self.recording.block(block)
        self.live.bytes += len(data)
        self.queue.put(block)

    def open_again(self) -> None:
        try:
            self.port = open_port(self.port_name, self.settings.baud)
        except PortError:
            self.ending.wait(AGAIN)
            return
        self.live.reconnects += self.live.bytes > 0
        self.live.note = ""
        self.event("connected again" if self.live.bytes else "connected")

    def event(self, name: str, **more: str) -> None:
        if self.recording:
            self.recording.event(name, **more)


@dataclass
class Ending:
    """When a run ends by itself: after so many seconds, or samples."""

    seconds: float = np.inf
    samples: float = np.inf


def acquire(
    live: Live,
    reader: Reader,
    recording: Recording | None,
    ending: Ending,
    show: Callable[[Live], None] = lambda _: None,
) -> None:
    """Solves what the reader brings until the stream, the time or the samples end, or ^C.

    show: called after each block. Whatever happens, the stage stops and the recording is closed.
    """
    tracker = live.tracker
    live.begin = time.monotonic()
    reader.start()
    if tracker:
        tracker.__enter__()
    try:
        while not finished(live, ending):
            try:
                block = reader.queue.get(timeout=0.05)
            except Empty:
                if not reader.is_alive():
                    break
                show(live)
                check_silence(live)
                continue
            step(live, block, recording)
            live.backlog = reader.queue.qsize()
            told_backlog(live, recording)
            show(live)
    except KeyboardInterrupt:
        live.note = "interrupted"
    finally:
        if tracker:
            tracker.close()
        reader.ending.set()
        reader.join(timeout=2.0)
        with suppress(Empty):  # what came, but was not solved yet
            while recording is not None:
                step(live, reader.queue.get_nowait(), recording)
        if recording:
            recording.close()
    if reader.error:
        raise reader.error


def finished(live: Live, ending: Ending) -> bool:
    passed = time.monotonic() - live.begin
    return passed >= ending.seconds or live.pipeline.tally.samples >= ending.samples


def step(live: Live, block: Block, recording: Recording | None) -> None:
    poses = live.pipeline.feed(block.data, block.arrival, block.encoder)
    if poses is None:
        check_silence(live)
        return
    live.newest = poses
    live.latency.append(time.monotonic() - block.arrival)
    if len(live.latency) > 20_000:
        del live.latency[:10_000]
    if recording:
        recording.poses(poses)
    if live.tracker:
        live.tracker.feed(poses.host, poses.readings[:, 2::3], apexes(poses))
    if live.note.startswith("bytes come"):
        live.note = ""


def apexes(poses: Poses) -> NDArray[np.float64]:
    """Where the apex was found (n, 2), mm; NaN where it was not."""
    good = poses.solution.status == Status.CONVERGED
    return np.where(good[:, None], poses.solution.state[:, :2], np.nan)


def check_silence(live: Live) -> None:
    """Bytes, but no sample: the line is set wrongly."""
    if live.pipeline.tally.samples or time.monotonic() - live.begin < PATIENCE:
        return
    if live.bytes:
        live.note = (
            "bytes come, but no sample can be read from them: are acquire.baud and acquire.format "
            "those of the board?"
        )
    else:
        live.note = "nothing comes: is the board on, and sending?"


def told_backlog(live: Live, recording: Recording | None) -> None:
    if live.backlog > max(BACKLOG, 2 * live.most) and recording:
        recording.event("backlog", blocks=live.backlog)
    live.most = max(live.most, live.backlog)
