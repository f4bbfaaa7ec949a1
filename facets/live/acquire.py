"""A stream recorded and solved as it comes.

One thread reads and records, and does nothing else; this one solves; a third moves the stage. What
the solver has not got to yet waits in a backlog. Where that grows old, the newest samples are
solved first, the others when there is time, and those for which there is none are given up: they
are recorded, and a replay solves them. The run says when it falls behind, and when it has caught
up.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import ExitStack, nullcontext, suppress
from dataclasses import dataclass, field
from functools import partial
from queue import Empty, SimpleQueue
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import FacetsError
from ..detectors.counts import SATURATED
from ..estimation.solution import Status
from ..tracking.priority import urgent
from ..tracking.tracker import Tracker
from .beam_loss import BeamLoss
from .interruption import deferring, resume_by_signal
from .keys import pressing
from .pipeline import BATCH, PERMITTED, Batch, Pipeline, Poses
from .ports import Port, PortError, SerialPort, await_port, open_port
from .recording import Block, Recording

if TYPE_CHECKING:
    from ..core.settings import Config
    from .publication import Publications

#: After so long with bytes but without a sample something is set wrongly, s.
PATIENCE = 2.0
#: Between attempts to open a port again, s.
AGAIN = 0.2
#: What comes in the first moment was sent before, s.
DRAIN = 0.1
#: Batches whose oldest has waited so long are solved the newest first, s.
PROMPT = 0.05
#: A loop whose backlog is so old is behind, and says so, s.
BEHIND = 0.25
#: A batch that has waited so long is given up, s.
TOO_OLD = 10.0
#: So long what is left is solved after the end, s.
FINISH = 2.0
#: A source that waits is asked for no more while so many batches do.
ENOUGH = 50
#: Bytes are passed on to a busy loop after so long, s.
HOLD = 0.015
#: A thread that waits for the interpreter gets it after so long, s: the solver, busy with many
#: small steps, else keeps the reader and the loop of the stage waiting for several milliseconds.
SWITCH = 5e-4
INTERRUPTED = "interrupted"


@dataclass
class Live:
    """What is to be shown of a run, at any time.

    newest: poses of the newest samples that are solved.  latency: s, of what was the newest when it
    was solved, from its last byte to its poses.  backlog: samples that wait, and the most that did.
    age: how long the oldest of them has waited, s.  behind: whether the loop has fallen behind.
    late: samples that were solved after newer ones.  recording: what is written, if anything.
    publications: who else gets the samples, if anybody.  beam_loss: of a beam that is to follow.
    is_urgent: whether the system gave the run a real-time priority.
    """

    pipeline: Pipeline
    begin: float = field(default_factory=time.monotonic)
    newest: Poses | None = None
    latency: list[float] = field(default_factory=list)
    backlog: int = 0
    most: int = 0
    age: float = 0.0
    behind: bool = False
    late: int = 0
    bytes: int = 0
    reconnects: int = 0
    tracker: Tracker | None = None
    recording: Recording | None = None
    publications: Publications | None = None
    is_urgent: bool = False
    beam_loss: BeamLoss = field(default_factory=BeamLoss)
    note: str = ""

    @property
    def loss(self) -> float:
        """Samples that never came, as a share of all."""
        lost = self.pipeline.sequence.lost
        return lost / max(1, lost + self.pipeline.tally.samples)

    @property
    def stage_stop(self) -> str:
        """Why the stage is stopped until somebody resumes; or nothing."""
        return (self.tracker.error or self.tracker.envelope.latched) if self.tracker else ""

    def ninety_nine(self) -> float:
        """The 99th percentile of the latency, s."""
        return float(np.quantile(self.latency[-5000:], 0.99)) if self.latency else float("nan")

    def messages(self) -> list[str]:
        """What a person should know now, in sentences."""
        found = [self.note] if self.note else []
        if self.behind:
            found.append(
                f"the loop is {self.age:.1f} s behind: all is recorded, the newest samples are "
                "solved first"
            )
        if self.recording and self.recording.trouble:
            found.append(
                f"{self.recording.trouble}; {self.recording.lost} bytes that came are not recorded"
            )
        if not self.pipeline.doubts.said and self.pipeline.tally.misfit.mostly:
            found.append("most poses have a residual beyond chance: they can not be believed")
        found += self.pipeline.doubts.said
        for one in self.publications.all if self.publications else ():
            if one.trouble:
                found.append(f"{one.address}: nothing is published any more: {one.trouble}")
            elif one.note:
                found.append(f"{one.address}: {one.note}")
        if self.pipeline.board.trouble():
            found.append(self.pipeline.board.trouble())
        if self.stage_stop:
            found.append(
                f"the stage is stopped, the recording goes on: {self.stage_stop}; resume it by the "
                f"key r, the button on the page, or kill -USR1 {os.getpid()}"
            )
        if self.tracker and self.tracker.note:
            found.append(self.tracker.note)
        return found


class Reader(threading.Thread):
    """Reads and records. Ends by itself at the port's end, or with an error in `error`.

    A block goes on at once where the loop waits for it. Where the loop is busy it grows for up to
    HOLD: each block has a cost of its own, beside that of its samples, so that few large ones let a
    loop catch up on a busy machine.
    """

    def __init__(
        self,
        config: Config,
        name: str,
        recording: Recording | None,
        reconnect: bool,
        live: Live,
        tell: Callable[[str], None] = lambda _: None,
    ) -> None:
        """Waits for the port as long as the configuration has it, and tells so.

        With reconnect it is waited for in the thread, without end.
        """
        super().__init__(name="reader", daemon=True)
        self.settings, self.port_name = config.acquire, name
        self.recording, self.reconnect, self.live = recording, reconnect, live
        self.port: Port | None = None
        if reconnect:
            live.note = f"waiting for {name}"
        else:
            self.port = await_port(name, config.acquire.baud, config.acquire.wait, tell)
        self.queue: SimpleQueue[Block] = SimpleQueue()
        self.held = bytearray()  # bytes that came since the last block
        self.since = self.arrival = 0.0  # when the first and the last of them came
        self.ending = threading.Event()
        self.error: FacetsError | None = None

    def run(self) -> None:
        try:
            with nullcontext() if self.port and self.port.waits else urgent():
                self.drain()
                while not self.ending.is_set() and (self.port is None or not self.port.ended):
                    self.step()
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
        """A port that is gone may refuse even that."""
        port, self.port = self.port, None
        if port is not None:
            with suppress(Exception):
                port.close()

    def drain(self) -> None:
        """Passes over what buffers held from before."""
        begin = time.monotonic()
        while isinstance(self.port, SerialPort) and time.monotonic() - begin < DRAIN:
            self.port.read()

    def step(self) -> None:
        if self.port is None:
            self.open_again()
            return
        if self.port.waits and self.queue.qsize() + self.live.backlog / BATCH > ENOUGH:
            self.ending.wait(0.001)
            return
        try:
            data = self.port.read()
        except PortError as error:
            self.pass_on()
            self.event("unplugged", reason=str(error))
            self.close_port()
            if not self.reconnect:
                raise
            self.live.note = "unplugged; waiting for it to come back"
            return
        if data:
            self.arrival = time.monotonic()
            self.since = self.since if self.held else self.arrival
            self.held += data
        if self.port.waits or self.loop_waits() or time.monotonic() - self.since > HOLD:
            self.pass_on()

    def loop_waits(self) -> bool:
        """Whether the loop has nothing to do but to wait for the next block."""
        return self.queue.empty() and not self.live.backlog

    def pass_on(self) -> None:
        """What came since the last block, as a block: to the recording and to the loop."""
        if not self.held:
            return
        data = bytes(self.held)
        self.held.clear()
        tracker = self.live.tracker
        block = Block(data, self.arrival, tracker.encoder if tracker else None)
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

    def write(self, data: bytes) -> bool:
        """Sends bytes to the board, from any thread; whether there is one that took them."""
        send = getattr(self.port, "write", None)
        return bool(send and send(data))

    def finish(self) -> None:
        """Has the thread end, and waits for it."""
        self.ending.set()
        if self.is_alive():
            self.join(timeout=5.0)
        self.close_port()


class Backlog:
    """Batches that came and are not solved yet, in the order in which they came."""

    def __init__(self) -> None:
        self.batches: deque[Batch] = deque()
        self.samples = 0

    def __len__(self) -> int:
        return len(self.batches)

    def add(self, batches: list[Batch]) -> None:
        self.batches.extend(batches)
        self.samples += sum(map(len, batches))

    def age(self, now: float) -> float:
        """How long the oldest has waited, s."""
        return now - self.batches[0].arrival if self.batches else 0.0

    def pop(self, newest: bool) -> Batch:
        batch = self.batches.pop() if newest else self.batches.popleft()
        self.samples -= len(batch)
        return batch


class Ending:
    """When a run ends by itself: after so many seconds, or samples, or when its check is over."""

    def __init__(
        self,
        seconds: float = np.inf,
        samples: float = np.inf,
        is_over: Callable[[], bool] = lambda: False,
    ) -> None:
        self.seconds, self.samples, self.is_over = seconds, samples, is_over

    def reached(self, live: Live) -> bool:
        if self.is_over():
            return True
        passed = time.monotonic() - live.begin
        return passed >= self.seconds or live.pipeline.tally.samples >= self.samples


class Loop:
    """Solves what the reader brings: the newest first where it can not solve all in time."""

    def __init__(
        self,
        live: Live,
        reader: Reader,
        recording: Recording | None,
        show: Callable[[Live], None] = lambda _: None,
    ) -> None:
        self.live, self.reader, self.recording, self.show = live, reader, recording, show
        self.backlog = Backlog()
        self.patient = reader.port is not None and reader.port.waits

    def run(self, ending: Ending, signals: Sequence[int] = ()) -> None:
        """Until the stream, the time or the samples end, or a signal has come."""
        while not ending.reached(self.live):
            if signals:
                self.live.note = INTERRUPTED
                break
            self.gather(wait=0.0 if self.backlog else 0.05)
            if self.backlog:
                self.work()
            elif not self.reader.is_alive() and self.reader.queue.empty():
                break
            else:
                check_silence(self.live)
            self.tell_backlog()
            self.display()

    def gather(self, wait: float = 0.0) -> None:
        """Takes in all that has come; waits for it no longer than so many seconds."""
        with suppress(Empty):
            self.take(
                self.reader.queue.get(timeout=wait) if wait else self.reader.queue.get_nowait()
            )
            while True:
                self.take(self.reader.queue.get_nowait())

    def take(self, block: Block) -> None:
        self.backlog.add(self.live.pipeline.take(block.data, block.arrival, block.encoder))
        check_silence(self.live)

    def work(self) -> None:
        """Solves one batch, and gives up those that are too old."""
        age = self.backlog.age(time.monotonic())
        batch = self.backlog.pop(newest=age > PROMPT and not self.patient)
        self.keep(self.live.pipeline.solve(batch), batch.arrival)
        while not self.patient and self.backlog.age(time.monotonic()) > TOO_OLD:
            self.give_up()

    def give_up(self) -> None:
        self.record(self.live.pipeline.skip(self.backlog.pop(newest=False)))

    def keep(self, poses: Poses, arrival: float) -> None:
        """Passes poses on: to the view, to the stage, to the recording."""
        live = self.live
        if live.tracker:
            has_pose = poses.solution.status == Status.CONVERGED
            live.beam_loss.add(poses.host, has_pose, live.tracker.begun)
        if live.newest is None or poses.seq[-1] > live.newest.seq[-1]:
            live.newest = poses
            live.latency.append(time.monotonic() - arrival)
            if len(live.latency) > 20_000:
                del live.latency[:10_000]
            if live.tracker:
                is_permitted = bool((poses.flags & PERMITTED).all())
                apexes, beams = apexes_of(poses)
                live.tracker.feed(poses.host, powers_of(poses), apexes, beams, is_permitted)
        else:
            live.late += len(poses)
        self.record(poses)

    def record(self, poses: Poses) -> None:
        """Passes poses on to other programs and to the recording."""
        if self.live.publications:
            self.live.publications.send(poses)
        if self.recording:
            self.recording.poses(poses)

    def tell_backlog(self) -> None:
        """Says, once each, that the loop has fallen behind and that it has caught up."""
        live = self.live
        live.backlog, live.age = self.backlog.samples, self.backlog.age(time.monotonic())
        live.most = max(live.most, live.backlog)
        if not live.behind and live.age > BEHIND and not self.patient:
            live.behind = True
            self.event("behind", seconds=round(live.age, 3), samples=live.backlog)
        elif live.behind and not self.backlog:
            live.behind = False
            self.event("caught up", late=live.late, skipped=live.pipeline.tally.skipped)

    def event(self, name: str, **more: Any) -> None:
        if self.recording:
            self.recording.event(name, **more)

    def display(self) -> None:
        """Shows; a terminal that was closed ends the view, not the record."""
        try:
            self.show(self.live)
        except OSError:
            self.show = lambda _: None

    def finish(self) -> None:
        """Solves what came and was not solved yet, for a while; the rest is given up."""
        self.gather()
        last = time.monotonic() + FINISH
        while self.backlog and time.monotonic() < last:
            self.work()
        while self.backlog:
            self.give_up()
        self.tell_backlog()

    def tell_end(self, status: int, reasons: list[str]) -> None:
        """The last event: what came of the run, its exit status and every reason for it."""
        live = self.live
        tally, sequence = live.pipeline.tally, live.pipeline.sequence
        followed = {"beam_lost": live.beam_loss.share} if live.beam_loss.solved else {}
        self.event(
            "end", samples=tally.samples, lost=sequence.lost, restarts=sequence.restarts,
            late=live.late, statuses=dict(tally.statuses), messages=live.messages(), **followed,
            is_urgent=live.is_urgent, exit_status=status, reasons=reasons,
        )  # fmt: skip


def end_of(
    error: BaseException | None, signals: Sequence[int], complaints: Callable[[], list[str]]
) -> tuple[int, list[str]]:
    """The exit status of a run that an error, a signal or nothing ended, and its reasons."""
    reasons = complaints()
    if error is not None and not isinstance(error, KeyboardInterrupt):
        known = isinstance(error, FacetsError)
        words = str(error) if known else f"{type(error).__name__}: {error}"
        return 2 if known else 1, [words, *reasons]
    if signals and signals[0] != signal.SIGINT:
        name = signal.Signals(signals[0]).name
        return 128 + signals[0], [f"the program was ended by {name}", *reasons]
    return int(bool(reasons)), reasons


def acquire(
    live: Live,
    reader: Reader,
    recording: Recording | None,
    ending: Ending,
    show: Callable[[Live], None] = lambda _: None,
    complaints: Callable[[Live], list[str]] = lambda _: [],
) -> None:
    """Solves what the reader brings until the stream, the time or the samples end, or ^C.

    complaints: why a run that came to its end is not a good one, which the recording keeps.  show:
    called after each batch. Whatever happens, and whatever fails of it: the stage stops, the
    reading ends, what came is solved as far as there is time, and the recording is closed. An error
    of the stage stops the stage and nothing else; see `Live.stage_stop`.
    """
    live.recording = recording
    loop = Loop(live, reader, recording, show)
    with deferring() as signals, ExitStack() as closing:
        closing.callback(sys.setswitchinterval, sys.getswitchinterval())
        sys.setswitchinterval(min(SWITCH, sys.getswitchinterval()))
        if recording:
            closing.callback(recording.close)
        if live.publications:
            closing.callback(live.publications.close)

        def finish(
            kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
        ) -> None:
            try:
                loop.finish()
            finally:
                ended = end_of(error or reader.error, signals, lambda: complaints(live))
                loop.tell_end(*ended)

        closing.push(finish)
        closing.callback(reader.finish)
        if live.tracker:
            if live.tracker.envelope.heartbeat:
                live.tracker.envelope.heartbeat.to_board = reader.write
            closing.enter_context(resume_by_signal(live.tracker))
            closing.enter_context(pressing({"r": partial(live.tracker.resume, "the key r")}))
            closing.enter_context(live.tracker)
        live.begin = time.monotonic()
        reader.start()
        if not loop.patient:
            live.is_urgent = closing.enter_context(urgent())
        try:
            loop.run(ending, signals)
        except KeyboardInterrupt:
            live.note = INTERRUPTED
    if reader.error:
        raise reader.error


def powers_of(poses: Poses) -> NDArray[np.float64]:
    """The detectors' powers (n, 3), mW; infinite where a detector is saturated."""
    powers = poses.readings[:, 2::3]
    full = (poses.flags & SATURATED > 0)[:, None] & np.isnan(powers)
    return np.where(full, np.inf, powers)


def apexes_of(poses: Poses) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where apex and beam were found, (n, 2) each, mm; NaN where they were not."""
    good = (poses.solution.status == Status.CONVERGED)[:, None]
    state = np.where(good, poses.solution.state, np.nan)
    return state[:, :2], state[:, 6:]


def check_silence(live: Live) -> None:
    """Bytes, but no sample: the line is set wrongly."""
    if live.pipeline.tally.samples:
        if live.note.startswith(("bytes come", "nothing comes")):
            live.note = ""
    elif time.monotonic() - live.begin < PATIENCE:
        return
    elif live.bytes:
        live.note = (
            "bytes come, but no sample can be read from them: are acquire.baud and acquire.format "
            "those of the board?"
        )
    elif not live.note:
        live.note = "nothing comes: is the board on, and sending?"
