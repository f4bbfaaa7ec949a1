"""The state of a run, as views and pages show it."""

from __future__ import annotations

import os
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf, isnan, nan
from queue import SimpleQueue
from typing import Any

import numpy as np

from ...tracking.tracker import Tracker
from .beam_loss import BeamLoss
from .pipeline import Pipeline, RunPoses
from .sink import Sink

#: Without a sample for this long, s, the board is silent: its last pose is no longer the present.
SILENCE_S = 1.0
#: A slow board is silent after this many of its usual times between samples.
SILENT_SAMPLES = 10


@dataclass
class Live:
    """The state of a run, for views and pages.

    clock: of the run, s; the host's, except with a virtual bench.  newest: poses of the newest
    solved samples.  latency: time from the last byte to the poses of each batch that was the newest
    when it was solved, s.  backlog: number of waiting samples.  most: largest backlog so far.  age:
    time for which the oldest of them has waited, s.  behind: whether the loop has fallen behind.
    late: number of samples that were solved after newer ones.  sinks: receivers of the samples.
    events: events that the sinks have not received yet.  beam_loss: counts for a beam that follows
    the mirror.  is_urgent: whether the system gave the run a real-time priority.  note: the event
    that the reader waits for.  port_message: a message of the port about its senders.
    """

    pipeline: Pipeline
    clock: Callable[[], float] = time.monotonic
    begin: float = field(default_factory=time.monotonic)
    newest: RunPoses | None = None
    latency: deque[float] = field(default_factory=lambda: deque(maxlen=5_000))
    backlog: int = 0
    most: int = 0
    age: float = 0.0
    behind: bool = False
    late: int = 0
    bytes: int = 0
    reconnects: int = 0
    tracker: Tracker | None = None
    sinks: list[Sink] = field(default_factory=list)
    events: SimpleQueue[tuple[str, dict[str, Any]] | None] = field(default_factory=SimpleQueue)
    is_urgent: bool = False
    beam_loss: BeamLoss = field(default_factory=BeamLoss)
    note: str = ""
    port_message: str = ""
    first: float = nan
    last: float = nan
    end: float = inf

    @property
    def loss(self) -> float:
        """Fraction of the samples that were lost, by their numbers or by the time without samples.

        The larger of both counts, because a silent board numbers no samples.
        """
        lost = self.pipeline.sequence.lost
        by_number = lost / max(1, lost + self.pipeline.tally.samples)
        without = self.time_without_samples
        return max(by_number, without / (self.now - self.first)) if without else by_number

    @property
    def now(self) -> float:
        """The present time, s; that of the end once the run has ended."""
        return min(self.clock(), self.end)

    @property
    def duration(self) -> float:
        """The time since the run began, s; above 0."""
        return max(self.now - self.begin, 1e-9)

    @property
    def silence(self) -> float:
        """Time for which the board has been silent until now, s; 0 while samples come as usual."""
        has_begun = not isnan(self.last)
        passed = self.now - (self.last if has_begun else self.begin)
        usual = (self.last - self.first) / max(1, self.pipeline.tally.samples) if has_begun else 0.0
        is_late = passed > max(SILENCE_S, SILENT_SAMPLES * usual) and not self.backlog
        return passed if is_late else 0.0

    @property
    def time_without_samples(self) -> float:
        """Total time without samples since the first one, s."""
        return 0.0 if isnan(self.first) else 1e-6 * self.pipeline.sequence.silent + self.silence

    @property
    def current(self) -> RunPoses | None:
        """The newest poses, None before the first ones and when the board has fallen silent."""
        return None if self.silence else self.newest

    def add_arrival(self, arrival: float) -> None:
        """Note the arrival of samples at a time, s."""
        self.first = arrival if isnan(self.first) else self.first
        self.last = arrival

    @property
    def stage_stop(self) -> str:
        """The reason why the stage is stopped until somebody resumes, or ''."""
        return (self.tracker.error or self.tracker.envelope.latched) if self.tracker else ""

    def latency_p99(self) -> float:
        """Return the 99th percentile of the newest latencies, s; NaN if nothing is solved yet."""
        return float(np.quantile(list(self.latency), 0.99)) if self.latency else float("nan")

    def messages(self) -> list[str]:
        """Return the sentences that a person should read now, those on the moving stage first."""
        sentences = []
        if self.tracker and self.stage_stop:
            how = f"; resume it by the key r, the button on the page, or kill -USR1 {os.getpid()}"
            sentences.append(
                f"the stage is stopped, the recording goes on: {self.stage_stop}"
                + how * self.tracker.is_resumable
            )
        if self.tracker and self.tracker.note:
            sentences.append(self.tracker.note)
        sentences += self.line_messages()
        sentences += filter(None, (self.port_message, self.pipeline.sequence.complaint))
        sentences += self.pipeline.times.messages
        if self.behind:
            sentences.append(
                f"the loop is {self.age:.1f} s behind: all bytes are recorded, and the newest "
                "samples are solved first"
            )
        for sink in self.sinks:
            sentences += sink.messages()
        sentences += self.pipeline.measurement.messages()
        if not self.pipeline.doubts.said and self.pipeline.tally.misfit.is_mostly_flagged:
            sentences.append("most poses have a residual beyond chance: do not trust them")
        sentences += self.pipeline.doubts.said
        return [*sentences, *filter(None, [self.pipeline.board.trouble()])]

    def values(self) -> dict[str, Any]:
        """Return the values that the sinks report, by their names, in JSON's types."""
        return {name: value for sink in self.sinks for name, value in sink.values().items()}

    def add_event(self, name: str, **details: Any) -> None:
        """Note something that happened now, from any thread, without waiting for a sink."""
        now = {"monotonic": self.clock(), "utc": time.time()}
        self.events.put((name, now | details))

    def deliver_events(self) -> None:
        """Give the sinks the events as they come, until `end_events` is called."""
        for name, details in iter(self.events.get, None):
            for sink in self.sinks:
                sink.add_event(name, **details)

    def end_events(self) -> None:
        """Let `deliver_events` return once it has delivered what was noted so far."""
        self.events.put(None)

    def line_messages(self) -> list[str]:
        """Return the message on a reader that waits, on missing samples or on frozen readings."""
        if self.note:
            return [self.note]
        if silence := self.silence:
            if not isnan(self.last):
                what = f"no sample has come for {silence:.0f} s"
            elif not self.bytes:
                what = "no bytes arrive"
            else:
                what = "bytes arrive, but no sample can be read from them"
                return [f"{what}: check acquire.baud, acquire.format and acquire.channels"]
            return [f"{what}: check that the board is on and sending"]
        fault = self.pipeline.trust.fault
        return [f"{fault}: check the converter, its connections and the light"] if fault else []
