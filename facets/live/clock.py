"""Sequence numbers and a board's clock, which wrap, skip and drift."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .frames import Samples

WRAP = 2**32


class Sequence:
    """Unwraps seq and t_us, and counts what is missing or comes twice.

    lost: samples that never came.  doubled: that came again, or too late, and were dropped.
    restarts: of the board, whose counter then begins anew.
    """

    #: A step back by no more than this is a sample that comes again or late.
    LATE = 1000
    #: A step ahead by more than this, and any other step back, is a restart.
    AHEAD = 10_000_000

    def __init__(self) -> None:
        self.lost = self.doubled = self.restarts = 0
        self.seq = self.time = -1
        self.raw_seq = self.raw_time = 0

    def follow(self, samples: Samples) -> tuple[Samples, NDArray[np.int64], NDArray[np.int64]]:
        """The samples to be used, with seq and time (us) that only grow."""
        if not len(samples):
            return samples, np.zeros(0, np.int64), np.zeros(0, np.int64)
        if self.seq < 0:
            self.raw_seq, self.raw_time = int(samples.seq[0]) - 1, int(samples.time[0])
            self.seq = self.raw_seq
            self.time = self.raw_time
        steps = stepped(self.raw_seq, samples.seq)
        if (steps == 1).all():
            seq = self.seq + np.arange(1, len(samples) + 1)
        else:
            samples, seq = self.sorted_out(samples)
            if not len(samples):
                return samples, seq, seq
        time = self.time + np.cumsum(stepped(self.raw_time, samples.time))
        self.raw_seq, self.raw_time = int(samples.seq[-1]), int(samples.time[-1])
        self.seq, self.time = int(seq[-1]), int(time[-1])
        return samples, seq, time

    def sorted_out(self, samples: Samples) -> tuple[Samples, NDArray[np.int64]]:
        """One by one, where the counter does not go up by ones."""
        keep = np.zeros(len(samples), dtype=bool)
        seqs, last, now = [], self.raw_seq, self.seq
        for n, raw in enumerate(samples.seq.tolist()):
            step = (raw - last) % WRAP
            if step == 0 or step >= WRAP - self.LATE:
                self.doubled += 1
                continue
            if step > self.AHEAD:
                self.restarts += 1
                step = 1
            self.lost += step - 1
            last, now = raw, now + step
            keep[n] = True
            seqs.append(now)
        return samples.where(keep), np.array(seqs, dtype=np.int64)


def stepped(last: int, values: NDArray[np.uint32]) -> NDArray[np.int64]:
    """Steps of a counter that wraps at 2^32, the first from `last`."""
    whole = np.concatenate([[last], values.astype(np.int64)])
    steps: NDArray[np.int64] = np.diff(whole) % WRAP
    return steps


class Drift:
    """How fast the board's clock runs against the host's, by least squares over all blocks."""

    def __init__(self) -> None:
        self.sums = np.zeros(5)  # n, x, y, xx, xy
        self.origin: tuple[float, float] | None = None

    def add(self, device: float, host: float) -> None:
        """One block: times of its last sample, s."""
        if self.origin is None:
            self.origin = device, host
        x, y = device - self.origin[0], host - self.origin[1] - (device - self.origin[0])
        self.sums += (1, x, y, x * x, x * y)

    @property
    def ppm(self) -> float:
        """By how much the host's clock runs faster, 1e-6; NaN until there is something to say."""
        n, x, y, xx, xy = self.sums
        square = n * xx - x * x
        return float(1e6 * (n * xy - x * y) / square) if n > 10 and square > 0 else float("nan")
