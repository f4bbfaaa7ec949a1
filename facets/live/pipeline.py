"""From blocks of bytes to poses: the same for a live stream, a replay and a salvage."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..detectors.correction import corrected
from ..detectors.counts import SATURATED, UNEQUAL, readings_of
from ..estimation.solver import Prior, Solution, Status, solve
from ..estimation.table import power_known
from .clock import Drift, Sequence
from .frames import OVERRUN, XY_SUM, Samples, parser
from .tracker import REACH, Encoder

if TYPE_CHECKING:
    from ..core.settings import Config

Floats = NDArray[np.float64]

#: How well a sample's time and a stage's are known to each other, 1 sigma, s.
TIMING = 1e-3
#: Why a sample is doubtful, by the bits of `counts`, and of the board.
FLAGS = {SATURATED: "saturated", UNEQUAL: "unequal sums", 4: "board overrun"}


@dataclass(frozen=True)
class Poses:
    """What became of some samples.

    seq, time: (n,) unwrapped, the board's us.  host: (n,) the host's monotonic clock, s.
    readings: (n, 9) as the detectors gave them.  solution: (n).  flags: (n,) bits of FLAGS.
    """

    seq: NDArray[np.int64]
    time: NDArray[np.int64]
    host: Floats
    readings: Floats
    solution: Solution
    flags: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.seq)


@dataclass
class Tally:
    """What happened so far. overruns: of the board, by its own word."""

    samples: int = 0
    statuses: Counter[str] = field(default_factory=Counter)
    flags: Counter[str] = field(default_factory=Counter)


class Pipeline:
    """Parses, follows the counter, converts and solves."""

    def __init__(self, config: Config) -> None:
        self.config = config
        self.parser = parser(config.acquire.format, config.acquire.content)
        self.sequence = Sequence()
        self.drift = Drift()
        self.tally = Tally()
        self.dark = np.full(12, config.acquire.dark)
        self.state = np.zeros(8)

    def feed(self, block: bytes, arrival: float, encoder: Encoder | None = None) -> Poses | None:
        """The poses of the samples that a block completes. arrival: host's monotonic clock, s."""
        samples, seq, time = self.sequence.follow(self.parser.feed(block))
        if not len(samples):
            return None
        self.drift.add(1e-6 * time[-1], arrival)
        host = arrival - self.config.acquire.delay - 1e-6 * (time[-1] - time)
        readings, flags = self.readings(samples)
        solution = self.solved(corrected(self.config.sensor, readings), host, encoder)
        flags |= np.where(samples.flags & OVERRUN, 4, 0).astype(np.uint8)
        self.count(solution, flags)
        return Poses(seq, time, host, readings, solution, flags)

    def readings(self, samples: Samples) -> tuple[Floats, NDArray[np.uint8]]:
        sensor, electronics = self.config.sensor, self.config.electronics
        xy_sum = samples.kind == XY_SUM
        if xy_sum.all() or not xy_sum.any():
            return readings_of(sensor, electronics, samples.counts, bool(xy_sum[0]), self.dark)
        out, flags = np.empty((len(samples), 9)), np.empty(len(samples), np.uint8)
        for kind in (True, False):
            part = xy_sum == kind
            out[part], flags[part] = readings_of(
                sensor, electronics, samples.counts[part], kind, self.dark
            )
        return out, flags

    def solved(self, readings: Floats, host: Floats, encoder: Encoder | None) -> Solution:
        """Each sample from where the block before ended; what fails so, from rest again."""
        beam = self.beam(host, encoder)
        options: dict[str, Any] = {
            "power": power_known(self.config.sensor, self.config.solve),
            "method": self.config.solve.method,
            "max_steps": self.config.solve.max_steps,
        }
        sensor = self.config.sensor
        found = solve(sensor, readings, beam=beam, start=self.state, **options)
        lost = np.isin(found.status, (Status.MAX_STEPS, Status.SINGULAR, Status.STALLED))
        lost |= (found.status == Status.OUT_OF_RANGE) & found.used.all(axis=1)
        if lost.any():
            part = Prior(beam.mean[lost], beam.sigma) if isinstance(beam, Prior) else beam  # type: ignore[index]
            merge(found, lost, solve(sensor, readings[lost], beam=part, **options))
        good = np.flatnonzero(found.ok)
        if len(good):
            self.state = found.state[good[-1]].copy()
        return found

    def beam(self, host: Floats, encoder: Encoder | None) -> Any:
        """What is known of the beam's place at the samples' times, if anything."""
        options = self.config.solve
        if options.beam == "free" or options.method == "paper":
            return "free"
        electronics = self.config.sensor.electronics
        jitter = electronics.pointing if electronics else 0.0
        if encoder is None:
            sigma = options.beam_sigma if options.beam == "prior" else 0.0
            return Prior(np.zeros((len(host), 2)), float(np.hypot(sigma, jitter)))
        age = max(0.0, float(host[-1]) - encoder.time)
        if age > REACH:
            return "free"
        # a stage may have changed its speed since it was asked: half the way is in doubt
        moving = float(np.hypot(*encoder.speed)) * (TIMING + age / 2)
        sigma = float(np.sqrt(self.config.stage.accuracy**2 + moving**2 + jitter**2))
        return Prior(encoder.at(host), sigma)

    def count(self, solution: Solution, flags: NDArray[np.uint8]) -> None:
        self.tally.samples += len(flags)
        counts = np.bincount(solution.status, minlength=len(Status))
        self.tally.statuses.update({s.label: int(counts[s]) for s in Status if counts[s]})
        if flags.any():
            for bit, name in FLAGS.items():
                self.tally.flags[name] += int((flags & bit > 0).sum())


def merge(found: Solution, part: NDArray[np.bool_], again: Solution) -> None:
    """Puts the second attempt's results in their places."""
    for name in ("state", "status", "power", "used", "iterations", "residual", "covariance"):
        getattr(found, name)[part] = getattr(again, name)
