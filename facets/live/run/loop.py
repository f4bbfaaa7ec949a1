"""The loop that solves a stream while it is recorded.

One thread reads and records, and does nothing else (`reader`); this one solves; a third moves the
stage. Samples that are not solved yet wait in a backlog. Where the backlog grows old, the newest
samples are solved first and the others when there is time; those for which there is none are given
up: they are recorded, and a replay solves them. The run reports when it falls behind, and when it
has caught up.
"""

from __future__ import annotations

import signal
import sys
import threading
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from functools import partial
from queue import Empty
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from ...core.errors import FacetsError
from ...detectors.counts import SATURATED
from ...estimation.solution import Status
from ...tracking.priority import urgent
from ...tracking.tracker import SolvedSamples
from ..sources.source import Block
from .interruption import deferring, resume_by_signal
from .keys import watch_keys
from .live import Live
from .pipeline import PERMITTED, Batch, RunPoses
from .reader import Reader

#: Batches whose oldest has waited this long, s, are solved the newest first.
NEWEST_FIRST_AFTER_S = 0.05
#: A loop whose backlog is this old, s, is behind, and says so.
BACKLOG_WARNING_S = 0.25
#: A batch that has waited this long, s, is given up.
GIVE_UP_AFTER_S = 10.0
#: Samples that wait at the end of a run are solved for up to this time, s.
FINISH_S = 2.0
#: A thread that waits for the interpreter gets it after this time, s: the solver, busy with many
#: small steps, else keeps the reader and the loop of the stage waiting for several milliseconds.
THREAD_SWITCH_INTERVAL_S = 5e-4
INTERRUPTED = "interrupted"
CLOCK_MOVED = "the detector board's clock has moved against the host's, or its data come later"


class Backlog:
    """Batches that are not solved yet, in the order in which they came."""

    def __init__(self) -> None:
        self.batches: deque[Batch] = deque()
        self.samples = 0

    def __len__(self) -> int:
        return len(self.batches)

    def add(self, batches: list[Batch]) -> None:
        """Append batches that wait to be solved."""
        self.batches.extend(batches)
        self.samples += sum(map(len, batches))

    def age(self, now: float) -> float:
        """How long the oldest batch has waited at the time `now`, s."""
        return now - self.batches[0].arrival if self.batches else 0.0

    def pop(self, newest: bool) -> Batch:
        """Remove and return the newest or the oldest batch."""
        batch = self.batches.pop() if newest else self.batches.popleft()
        self.samples -= len(batch)
        return batch


class Ending:
    """When a run ends by itself: after a time, s, or a number of samples, or when `is_over()`."""

    def __init__(
        self,
        seconds: float = np.inf,
        samples: float = np.inf,
        is_over: Callable[[], bool] = lambda: False,
    ) -> None:
        self.seconds, self.samples, self.is_over = seconds, samples, is_over

    def is_reached(self, live: Live) -> bool:
        """Whether the time, the number of samples or the caller ends the run."""
        if self.is_over():
            return True
        passed = live.now - live.begin
        return passed >= self.seconds or live.pipeline.tally.samples >= self.samples


class Loop:
    """Solves the reader's samples, the newest first if not all can be solved in time."""

    def __init__(
        self,
        live: Live,
        reader: Reader,
        show: Callable[[Live], None] = lambda _: None,
    ) -> None:
        self.live, self.reader, self.show = live, reader, show
        self.backlog = Backlog()
        self.patient = reader.port is not None and reader.port.waits

    def run(self, ending: Ending, signals: Sequence[int] = ()) -> None:
        """Solve until the stream, the time or the samples end, or a signal has come."""
        while not ending.is_reached(self.live):
            if signals:
                self.live.note = INTERRUPTED
                break
            self.gather(wait=0.0 if self.backlog else 0.05)
            if self.backlog:
                self.solve_batch()
            elif not self.reader.is_alive() and self.reader.queue.empty():
                break
            self.report_backlog()
            self.display()

    def gather(self, wait: float = 0.0) -> None:
        """Take in all blocks that have come; wait up to `wait` seconds for the first."""
        with suppress(Empty):
            self.take(self.reader.next_block(wait))
            while True:
                self.take(self.reader.next_block())

    def take(self, block: Block) -> None:
        """Parse a block, queue its samples, and report a permit or a clock that changed."""
        clock, tally = self.live.pipeline.host_time, self.live.pipeline.tally
        moves, samples = clock.moves, tally.samples
        batches = self.live.pipeline.take(block.data, block.arrival, block.encoder)
        self.backlog.add(batches)
        if tracker := self.live.tracker:
            for batch in batches:
                is_permitted = bool((batch.flags & PERMITTED).all())
                tracker.take_permit(batch.host[-1] - self.live.pipeline.times.late, is_permitted)
        if clock.moves > moves:
            if tracker:
                tracker.halt(CLOCK_MOVED)
            self.live.add_event("clock moved", late_ms=round(1e3 * clock.late, 3))
        if tally.samples > samples:
            self.live.add_arrival(self.live.clock() if self.patient else block.arrival)

    def solve_batch(self) -> None:
        """Solve one batch, and give up those that are too old."""
        age = self.backlog.age(self.live.clock())
        batch = self.backlog.pop(newest=age > NEWEST_FIRST_AFTER_S and not self.patient)
        self.pass_on(self.live.pipeline.solve(batch), batch.arrival)
        while not self.patient and self.backlog.age(self.live.clock()) > GIVE_UP_AFTER_S:
            self.give_up()

    def give_up(self) -> None:
        """Skip the oldest batch, and give the sinks its samples unsolved."""
        self.give_to_sinks(self.live.pipeline.skip(self.backlog.pop(newest=False)))

    def pass_on(self, poses: RunPoses, arrival: float) -> None:
        """Pass poses on to the view, to the stage and to the sinks."""
        live = self.live
        if live.tracker:
            has_pose = poses.solution.status == Status.CONVERGED
            live.beam_loss.add(poses.host, has_pose, live.tracker.begun)
        if live.newest is None or poses.seq[-1] > live.newest.seq[-1]:
            live.newest = poses
            if not self.reader.is_stepped and not self.patient:  # else it is no time of waiting
                live.latency.append(live.clock() - arrival)
            if live.tracker:
                apexes, beams = apexes_of(poses)
                pipeline = live.pipeline
                samples = SolvedSamples(poses.host, powers_of(poses), apexes, beams)
                live.tracker.feed(samples, pipeline.times.late, pipeline.trust.doubt)
        else:
            live.late += len(poses)
        self.give_to_sinks(poses)

    def give_to_sinks(self, poses: RunPoses) -> None:
        """Pass poses to the sinks, and report the news about the zero of displacements."""
        for sink in self.live.sinks:
            sink.add_poses(poses)
        for text in self.live.pipeline.measurement.take_news():
            self.live.add_event("zero", text=text)

    def report_backlog(self) -> None:
        """Report once when the loop has fallen behind, and once when it has caught up."""
        live = self.live
        live.backlog, live.age = self.backlog.samples, self.backlog.age(live.clock())
        live.most = max(live.most, live.backlog)
        if not live.behind and live.age > BACKLOG_WARNING_S and not self.patient:
            live.behind = True
            live.add_event("behind", seconds=round(live.age, 3), samples=live.backlog)
        elif live.behind and not self.backlog:
            live.behind = False
            live.add_event("caught up", late=live.late, skipped=live.pipeline.tally.skipped_count)

    def display(self) -> None:
        """Refresh the sinks and show the run; a closed terminal ends only the view."""
        for sink in self.live.sinks:
            sink.refresh()
        try:
            self.show(self.live)
        except OSError:
            self.show = lambda _: None

    def finish(self) -> None:
        """Solve the backlog for up to `FINISH_S`, and give up the rest."""
        self.gather()
        self.backlog.add(self.live.pipeline.release())
        last = self.live.clock() + FINISH_S
        while self.backlog and self.live.clock() < last:
            self.solve_batch()
        while self.backlog:
            self.give_up()
        self.report_backlog()

    def report_end(self, status: int, reasons: list[str]) -> None:
        """Add the last event: the run's counts, its exit status and every reason for it."""
        live = self.live
        tally, sequence = live.pipeline.tally, live.pipeline.sequence
        followed = {"beam_lost": live.beam_loss.share} if live.beam_loss.solved else {}
        live.add_event(
            "end", samples=tally.samples, lost=sequence.lost, restarts=sequence.restarts,
            late=live.late, statuses=dict(tally.statuses), messages=live.messages(), **followed,
            silent_s=round(live.time_without_samples, 3), is_urgent=live.is_urgent,
            exit_status=status, reasons=reasons,
        )  # fmt: skip


def end_of(
    error: BaseException | None, signals: Sequence[int], complaints: Callable[[], list[str]]
) -> tuple[int, list[str]]:
    """Exit status (0, 1, 2 or 128 plus the signal) of a run that an error, a signal or nothing
    ended, and the reasons for it."""
    reasons = complaints()
    if error is not None and not isinstance(error, KeyboardInterrupt):
        is_expected = isinstance(error, FacetsError)
        words = str(error) if is_expected else f"{type(error).__name__}: {error}"
        return 2 if is_expected else 1, [words, *reasons]
    if signals and signals[0] != signal.SIGINT:
        name = signal.Signals(signals[0]).name
        return 128 + signals[0], [f"the program was ended by {name}", *reasons]
    return int(bool(reasons)), reasons


def acquire(
    live: Live,
    reader: Reader,
    ending: Ending,
    show: Callable[[Live], None] = lambda _: None,
    complaints: Callable[[], list[str]] = list,
) -> None:
    """Solve the reader's samples until the stream, the time or the samples end, or ^C.

    show: called after each batch.  complaints: returns the faults of the finished run, which are
    recorded. In every case the stage stops, the reading ends, and the received samples are solved
    as far as there is time. Then the sinks are closed, the first one last, even if a step before
    fails. An error of the stage stops the stage and nothing else; see `Live.stage_stop`. An error
    of the reader is raised at the end.
    """
    loop = Loop(live, reader, show)
    with deferring() as signals, ExitStack() as closing:
        closing.callback(sys.setswitchinterval, sys.getswitchinterval())
        sys.setswitchinterval(min(THREAD_SWITCH_INTERVAL_S, sys.getswitchinterval()))
        for sink in live.sinks:
            closing.callback(sink.close)
        deliverer = threading.Thread(target=live.deliver_events, name="events", daemon=True)
        deliverer.start()
        closing.callback(deliverer.join)
        closing.callback(live.end_events)

        def finish(
            kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
        ) -> None:
            try:
                loop.finish()
            finally:
                ended = end_of(error or reader.error, signals, complaints)
                loop.report_end(*ended)

        closing.push(finish)
        closing.callback(reader.finish)
        if live.tracker:
            if live.tracker.envelope.heartbeat:
                live.tracker.envelope.heartbeat.to_board = reader.write
            closing.enter_context(resume_by_signal(live.tracker))
            closing.enter_context(watch_keys({"r": partial(live.tracker.resume, "the key r")}))
            if reader.is_stepped:
                closing.callback(live.tracker.close)
            else:
                closing.enter_context(live.tracker)
        live.begin = live.clock()
        reader.start()
        if not loop.patient:
            live.is_urgent = closing.enter_context(urgent())
        try:
            loop.run(ending, signals)
        except KeyboardInterrupt:
            live.note = INTERRUPTED
        finally:
            live.end = live.clock()
    if reader.error:
        raise reader.error


def powers_of(poses: RunPoses) -> NDArray[np.float64]:
    """The detectors' powers (n, 3), mW; infinite where a detector is saturated."""
    powers = poses.readings[:, 2::3]
    full = (poses.flags & SATURATED > 0)[:, None] & np.isnan(powers)
    return np.where(full, np.inf, powers)


def apexes_of(poses: RunPoses) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Solved places of apex and beam, (n, 2) each, mm; NaN where there is no pose."""
    good = (poses.solution.status == Status.CONVERGED)[:, None]
    state = np.where(good, poses.solution.state, np.nan)
    return state[:, :2], state[:, 6:]
