"""The state of a run, as views and pages show it."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...tracking.tracker import Tracker
from .beam_loss import BeamLoss
from .pipeline import Pipeline, Poses
from .sink import Sink

#: Without a sample for this long, s, the line is taken to be set wrongly.
SILENCE_S = 2.0


@dataclass
class Live:
    """The state of a run, for those who show it.

    newest: poses of the newest samples that are solved.  latency: of each batch that was the newest
    when it was solved, from its last byte to its poses, s.  backlog: number of samples that wait.
    most: largest backlog so far.  age: how long the oldest of them has waited, s.  behind: whether
    the loop has fallen behind.  late: number of samples that were solved after newer ones.
    sinks: where samples go.  beam_loss: counts for a beam that follows the mirror.  is_urgent:
    whether the system gave the run a real-time priority.  note: what the reader waits for.
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
    sinks: list[Sink] = field(default_factory=list)
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

    def latency_p99(self) -> float:
        """The 99th percentile of the newest latencies, s; NaN where nothing is solved yet."""
        return float(np.quantile(self.latency[-5000:], 0.99)) if self.latency else float("nan")

    def messages(self) -> list[str]:
        """What a person should know now, in sentences."""
        found = [self.note] if self.note else []
        if self.behind:
            found.append(
                f"the loop is {self.age:.1f} s behind: all bytes are recorded, and the newest "
                "samples are solved first"
            )
        for sink in self.sinks:
            found += sink.messages()
        found += self.pipeline.object_poses.messages()
        if not self.pipeline.doubts.said and self.pipeline.tally.misfit.is_mostly_flagged:
            found.append("most poses have a residual beyond chance: do not trust them")
        found += self.pipeline.doubts.said
        if self.pipeline.board.trouble():
            found.append(self.pipeline.board.trouble())
        if self.tracker and self.stage_stop:
            how = f"; resume it by the key r, the button on the page, or kill -USR1 {os.getpid()}"
            found.append(
                f"the stage is stopped, the recording goes on: {self.stage_stop}"
                + how * self.tracker.is_resumable
            )
        if self.tracker and self.tracker.note:
            found.append(self.tracker.note)
        return found

    def values(self) -> dict[str, Any]:
        """What the sinks say of themselves, in JSON's types."""
        return {name: value for sink in self.sinks for name, value in sink.values().items()}

    def add_event(self, name: str, **details: Any) -> None:
        """Tell all sinks of something that happened now."""
        for sink in self.sinks:
            sink.add_event(name, **details)

    def check_silence(self) -> None:
        """Note that the line seems to be set wrongly where no sample has come for a while."""
        if self.pipeline.tally.samples:
            if self.note.startswith(("bytes come", "nothing comes")):
                self.note = ""
        elif time.monotonic() - self.begin < SILENCE_S:
            return
        elif self.bytes:
            self.note = (
                "bytes arrive, but no sample can be read from them: check acquire.baud and "
                "acquire.format"
            )
        elif not self.note:
            self.note = "no bytes arrive: check that the board is on and sending"
