"""The sequence numbers and the clock of a board, which wrap, skip, and begin again.

A board's two counters, of samples and of microseconds, are 32 bits each: the second wraps every
71.6 minutes. A counter that is suddenly small has wrapped, or the board was switched off and on.
Only together do the two counters and the host's clock tell which: after a wrap all three agree on
how much time has passed; after a restart they do not.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from math import isfinite, isnan, nan

import numpy as np
from numpy.typing import NDArray

from .frames import RawSamples

WRAP = 2**32
#: Longest time between two samples between which none is missing, us.
CLOSE_US = 1_000_000
#: Largest difference between the board's clock and the arrival of its bytes, s: a busy host reads
#: late, and a board sends late the samples that it has kept.
CREDIBLE_S = 5.0
#: Largest ratio between the time of the missing samples and the time that has passed.
FACTOR = 4.0

#: A sample's time on the board, us, and its counts.
Frame = tuple[int, bytes]


class Remembered:
    """The newest samples by their number, sorted when the first is asked for."""

    def __init__(self, parts: Iterable[RawSamples]) -> None:
        self.parts = list(parts)
        self.frames: dict[int, Frame] = {}

    def add(self, samples: RawSamples) -> None:
        self.parts.append(samples)

    def get(self, number: int) -> Frame | None:
        """Return the newest sample of a number, if there is any."""
        for part in self.parts:
            self.frames |= {
                int(seq): (int(at), counts.tobytes())
                for seq, at, counts in zip(part.seq, part.time, part.counts, strict=True)
            }
        self.parts = []
        return self.frames.get(number)

    def clear(self) -> None:
        self.parts, self.frames = [], {}


class Sequence:
    """Unwraps seq and t_us, and counts samples that are missing or come twice.

    lost: samples that never came.  doubled: samples that came again, or too late, and were dropped.
    restarts: of the board, whose counters then begin anew; the samples lost meanwhile are not
    known.  leaps: of the board's clock alone, while the numbers go on.  silent: time for which the
    board took no samples, though none is missing by its number, us.  period: between samples, us, 0
    while it is not known.  fresh: position of the first sample after a restart or a leap among the
    samples that were followed last; 0 without one.
    """

    #: Largest step back of a sample that comes again or late.
    LATE = 1000
    #: A step ahead by more than this is a restart unless it agrees with both clocks.
    AHEAD = 10_000_000

    def __init__(self) -> None:
        self.lost = self.doubled = self.restarts = self.leaps = self.fresh = self.silent = 0
        self.seq = self.time = -1
        self.raw_seq = self.raw_time = 0
        self.period = 0.0
        self.host = nan
        self.recent: deque[RawSamples] = deque()
        self.kept = 0

    def follow(
        self, samples: RawSamples, arrival: float = nan
    ) -> tuple[RawSamples, NDArray[np.int64], NDArray[np.int64]]:
        """Return the samples to be used, and their seq and time (us), which only grow.

        arrival: of the bytes at the host, s, on a clock that is never set; NaN if it is not known.
        After a restart the time continues by the host's clock.
        """
        self.fresh = 0
        if not len(samples):
            return samples, np.zeros(0, np.int64), np.zeros(0, np.int64)
        if self.seq < 0:
            self.raw_seq, self.raw_time = int(samples.seq[0]) - 1, int(samples.time[0])
            self.seq, self.time = self.raw_seq, self.raw_time
        gap = 1e6 * (arrival - self.host)
        step = (int(samples.seq[0]) - self.raw_seq) % WRAP
        passed = (int(samples.time[0]) - self.raw_time) % WRAP
        ends = run_ends(samples)
        if step == 1 and passed < CLOSE_US and len(ends) == 1:
            seq = self.seq + 1 + np.arange(len(samples))
            time = self.time + passed + elapsed_counts(samples.time)
            if len(samples) > 1:
                self.period = usual_step(time)
        else:
            samples, seq, time = self.sort_out(samples, ends, gap)
        if not isnan(arrival):
            self.host = arrival
        if not len(samples):
            return samples, seq, time
        self.raw_seq, self.raw_time = int(samples.seq[-1]), int(samples.time[-1])
        self.seq, self.time = int(seq[-1]), int(time[-1])
        self.remember(samples)
        return samples, seq, time

    @property
    def beginnings(self) -> int:
        """How often the board's time began anew."""
        return self.restarts + self.leaps

    @property
    def restart_sentence(self) -> str:
        """The sentence on restarts of the board; empty without any."""
        text = f"the board restarted {self.restarts} times; what it lost is not known"
        return text if self.restarts else ""

    @property
    def leap_sentence(self) -> str:
        """The sentence on leaps of the board's clock; empty without any."""
        text = (
            f"the detector board's clock (t_us) leapt {self.leaps} times while the numbers of the "
            "samples went on: check that it wraps at 32 bits, and that nothing sets it"
        )
        return text if self.leaps else ""

    def remember(self, samples: RawSamples) -> None:
        """Keep the newest samples, at least LATE of them."""
        self.recent.append(samples)
        self.kept += len(samples)
        while self.kept - len(self.recent[0]) >= self.LATE:
            self.kept -= len(self.recent.popleft())

    def sort_out(
        self, samples: RawSamples, ends: list[int], gap: float
    ) -> tuple[RawSamples, NDArray[np.int64], NDArray[np.int64]]:
        """Follow samples run by run, if a counter does not simply go on.

        ends: of the runs.  gap: host's time since the last samples, us.
        """
        keep = np.zeros(len(samples), dtype=bool)
        seqs: list[NDArray[np.int64]] = []
        times: list[NDArray[np.int64]] = []
        oldest = int(self.recent[0].seq[0]) if self.recent else self.raw_seq
        raw_seq, raw_time, seq, time = self.raw_seq, self.raw_time, self.seq, self.time
        known = Remembered(self.recent)
        n = 0
        for end in ends:
            while n < end:  # The rest of a run continues from its first sample that is kept.
                number, at = int(samples.seq[n]), int(samples.time[n])
                step, passed = (number - raw_seq) % WRAP, (at - raw_time) % WRAP
                frame = (at, samples.counts[n].tobytes())
                reach = (raw_seq - oldest) % WRAP
                if self.is_again(step, passed, reach, number, frame, known):
                    self.doubled += 1
                    n += 1
                    continue
                whole = self.elapsed_time(step, passed, gap, first=not seqs)
                if whole is None:
                    self.restarts += step != 1
                    self.leaps += step == 1
                    self.fresh = int(keep.sum())
                    known.clear()
                    oldest = number
                    waited = gap if isfinite(gap) and not seqs else 0.0
                    step, whole = 1, int(max(waited, self.period, 1.0))
                self.lost += step - 1
                pause = int(min(whole, gap))  # a clock that was set ahead is no silence
                if step == 1 and self.period and pause > max(CLOSE_US, 10 * self.period):
                    self.silent += pause
                run = slice(n, end)
                seqs.append(seq + step + np.arange(end - n))
                times.append(time + whole + elapsed_counts(samples.time[run]))
                raw_seq, raw_time = int(samples.seq[end - 1]), int(samples.time[end - 1])
                seq, time = int(seqs[-1][-1]), int(times[-1][-1])
                known.add(samples.where(run))
                keep[run] = True
                n = end
        nothing = np.zeros(0, np.int64)
        return (
            samples.where(keep),
            np.concatenate([nothing, *seqs]),
            np.concatenate([nothing, *times]),
        )

    def is_again(
        self,
        step: int,
        passed: int,
        reach: int,
        number: int,
        frame: Frame,
        known: Remembered,
    ) -> bool:
        """Whether a sample has come before, or comes after its turn.

        step, passed: of the raw counters, modulo 2^32.  reach: number of samples back that are
        remembered.  number, frame: of this sample.  known: the samples that came before.
        """
        if 0 < step < WRAP - self.LATE:
            return False
        same = known.get(number)
        if same is not None:
            return same == frame  # a board that counts anew has the number, not the light
        back, earlier = (-step) % WRAP, (-passed) % WRAP
        return self.period > 0 and 0 < back <= reach and self.agrees(earlier, back)

    def agrees(self, passed: float, steps: int) -> bool:
        """Whether a time `passed`, us, is about that of `steps` samples."""
        late = passed > FACTOR * steps * self.period + CLOSE_US / 100
        return self.fits_samples(passed, steps) and not late

    def fits_samples(self, passed: float, steps: int) -> bool:
        """Whether `steps` samples can have been taken in a time `passed`, us."""
        return 0 < steps * self.period <= FACTOR * passed

    def elapsed_time(self, step: int, passed: int, gap: float, first: bool) -> int | None:
        """The time that passed on the board's clock, us, with its wraps; None for a restart.

        step, passed: of the raw counters, modulo 2^32.  gap: of the host's clock, us.  first:
        whether this is the first of the samples that came together, because only the first can be
        known to be late.
        """
        if step == 1 and passed < CLOSE_US:
            return passed
        has_host = isfinite(gap)
        goal = gap if has_host else step * self.period
        whole = passed + WRAP * max(0, round((goal - passed) / WRAP))
        were_kept = self.explains_samples(step, whole)
        if has_host and not self.agrees_with_host(whole, gap, first, were_kept):
            return None
        goes_on = has_host if step == 1 else self.may_miss(step, were_kept, has_host and first)
        return whole if goes_on else None

    def may_miss(self, step: int, were_kept: bool, late: bool) -> bool:
        """Whether the samples before this one, step - 1, may be missing, and nothing else is wrong.

        were_kept: see `explains_samples`.  late: whether all are late by the host's clock.
        """
        is_plausible = were_kept or self.period == 0
        is_near = step <= self.AHEAD or (self.period > 0 and late)
        return is_plausible and is_near

    def explains_samples(self, step: int, whole: float) -> bool:
        """Whether the missing samples can have been taken in a time `whole`, us."""
        if step == 1 or self.period == 0:
            return False
        # a board that stood still for a while and lost samples has not begun anew
        stood = whole < CLOSE_US and self.fits_samples(whole, step)
        return stood or self.agrees(whole, step)

    def agrees_with_host(self, whole: float, gap: float, first: bool, were_kept: bool) -> bool:
        """Whether the board's clock went on by about as much, `whole` us, as the host's, `gap` us.

        Only samples after those that the board kept for long may be ahead of the host.
        """
        slack = 1e6 * CREDIBLE_S + 1e-3 * abs(gap)
        is_behind = first and whole < gap - slack
        is_ahead = whole > gap + slack and not were_kept
        return not (is_behind or is_ahead)


def run_ends(samples: RawSamples) -> list[int]:
    """The ends of runs, whose samples simply follow each other in both counters."""
    steps, passed = np.diff(samples.seq), np.diff(samples.time)  # unsigned, and wrap
    breaks = np.flatnonzero((steps != 1) | (passed >= CLOSE_US)) + 1
    return [*breaks.tolist(), len(samples)]


def usual_step(time: NDArray[np.int64]) -> float:
    """The median step of growing times (n,), because a board may have paused among them; the mean
    step if most steps are zero, because the board stamps several samples at once."""
    steps = np.sort(np.diff(time))
    return float(steps[len(steps) // 2] or steps.mean())


def elapsed_counts(values: NDArray[np.uint32]) -> NDArray[np.int64]:
    """The steps of a counter that wraps at 2^32, since the first of its values (n,)."""
    gone = np.zeros(len(values), np.int64)
    np.cumsum(np.diff(values), out=gone[1:])  # unsigned differences wrap as the counter does
    return gone
