"""The sequence numbers and the clock of a board, which wrap, skip, and begin again.

A board's two counters, of samples and of microseconds, are 32 bits each: the second wraps every
71.6 minutes. A counter that is suddenly small has wrapped, or the board was switched off and on.
The two counters and the host's clock together distinguish the two cases: after a wrap all three
agree on how much time has passed; after a restart they do not.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import isfinite, isnan, nan

import numpy as np
from numpy.typing import NDArray

from ...core.plain_numbers import times_text
from .frames import RawSamples

WRAP = 2**32
#: Longest time between two samples between which none is missing, us.
CLOSE_US = 1_000_000
#: Largest difference between the board's clock and the arrival of its bytes, s: a busy host reads
#: late, and a board sends late the samples that it has kept.
CREDIBLE_S = 5.0
#: Largest ratio between the time of the missing samples and the time that has passed.
FACTOR = 4.0

#: Number of newest samples that are remembered to recognise those that come again: 13 s at 10 kHz.
MEMORY = 2**17
#: Samples that are ahead of the host's clock by more than this may be of another board, us.
EARLY_US = 100_000
#: Number of earlier counts whose numbers may continue.
MAX_COUNTS = 8
#: A remembered sample: the key of its count, its number, its time and its counts.
REMEMBERED = np.dtype([("key", "<u4"), ("seq", "<u4"), ("time", "<u4"), ("counts", "<i4", 12)])


@dataclass
class CounterState:
    """The two counters of a board since it was switched on, at its newest sample.

    key: a number that no other count has.  first: number of the first sample.  seq, time: counters
    as sent.  host: time of arrival, s.  restarts, lost: restarts of the board and lost samples that
    were counted when this count began; they are taken back if an earlier count continues.
    """

    key: int
    first: int
    seq: int
    time: int
    host: float = nan
    restarts: int = 0
    lost: int = 0

    @property
    def is_sure(self) -> bool:
        """Whether this count is certain, so that no earlier count can continue instead."""
        return not (self.restarts or self.lost)

    def take(self, samples: RawSamples, arrival: float) -> None:
        """Take samples as the newest."""
        self.seq, self.time = int(samples.seq[-1]), int(samples.time[-1])
        self.host = self.host if isnan(arrival) else arrival


class Sequence:
    """Unwraps seq and t_us, and counts samples that are missing or come twice.

    lost: samples that never came.  doubled: samples that came again, or too late, and were dropped.
    foreign: samples of another count than the one followed, which were dropped.  restarts: number
    of restarts of the board, whose counters then begin anew; samples lost meanwhile are not known.
    leaps: number of leaps of the board's clock alone, while the numbers continue.  breaks: how
    often the board's time began anew, at a leap or with another count, and was continued by the
    host's clock.  silent: time for which the board took no samples, though none is missing by its
    number, us.  period: between samples, us, 0 while it is not known.  fresh: position of the first
    sample after a break among the samples that were followed last; 0 without one.

    If the numbers continue those before a supposed restart or loss, there was none: another board
    sends to the same port, or old frames come again. The earlier count is then followed, and
    another one once it is silent.
    """

    #: A step ahead by more than this is a restart unless it agrees with both clocks.
    AHEAD = 10_000_000

    def __init__(self) -> None:
        self.lost = self.doubled = self.foreign = self.silent = 0
        self.restarts = self.leaps = self.breaks = self.fresh = self.counts = 0
        self.seq = self.time = -1
        self.period = 0.0
        self.board = CounterState(0, 0, 0, 0)
        self.others: list[CounterState] = []
        self.repeating = nan  # arrival of the first of the repeated samples that came last, s
        self.memory = np.zeros(MEMORY, REMEMBERED)
        self.memory["seq"][0] = 1  # no row has a number that belongs there

    def follow(
        self, samples: RawSamples, arrival: float = nan, counts: list[int] | None = None
    ) -> tuple[RawSamples, NDArray[np.int64], NDArray[np.int64]]:
        """Return the samples to be used, and their seq and time (us), which only grow.

        arrival: of the bytes at the host, s, on a clock that is never set; NaN if it is not known.
        counts: number of samples of each block; those of several blocks must be consecutive (see
        `continues`). After a restart the time continues by the host's clock.
        """
        self.fresh = 0
        if not len(samples):
            return samples, np.zeros(0, np.int64), np.zeros(0, np.int64)
        if self.seq < 0:
            self.start_count(int(samples.seq[0]))
            self.seq, self.time = int(samples.seq[0]) - 1, int(samples.time[0])
            self.board.seq, self.board.time = self.seq, self.time
        if self.continues(samples):
            seq = self.seq + 1 + np.arange(len(samples))
            passed = (int(samples.time[0]) - self.board.time) % WRAP
            time = self.time + passed + elapsed_counts(samples.time)
            self.period = self.newest_period(time, counts or [len(time)])
            self.remember(samples, arrival)
        else:
            samples, seq, time = self.sort_out(samples, arrival)
        if len(samples):
            self.seq, self.time = int(seq[-1]), int(time[-1])
        return samples, seq, time

    def continues(self, samples: RawSamples) -> bool:
        """Whether the samples follow the newest one and each other in both counters."""
        step = (int(samples.seq[0]) - self.board.seq) % WRAP
        passed = (int(samples.time[0]) - self.board.time) % WRAP
        is_next = self.counts > 0 and step == 1 and passed < CLOSE_US
        return is_next and len(run_ends(samples)) == 1

    def newest_period(self, time: NDArray[np.int64], counts: list[int]) -> float:
        """Return the period of samples, us, by the last block with several samples.

        If there is none, the period stays as it was.  time: (n,) us.  counts: number of samples in
        each block.
        """
        end = len(time)
        for count in reversed(counts):
            if count > 1:
                return usual_step(time[end - count : end])
            end -= count
        steps = np.diff(time, prepend=self.time)
        return self.period or next(filter(None, map(float, steps)), 0.0)

    @property
    def leap_sentence(self) -> str:
        """The sentence on leaps of the board's clock; empty without any."""
        text = (
            f"the detector board's clock (t_us) leapt {times_text(self.leaps)} while the numbers "
            "of the samples went on: check that it wraps at 32 bits, and that nothing sets it"
        )
        return text if self.leaps else ""

    def remember(self, samples: RawSamples, arrival: float) -> None:
        """Take samples as the newest of the board."""
        rows = samples.seq % MEMORY
        self.memory["key"][rows] = self.board.key
        for name in ("seq", "time", "counts"):
            self.memory[name][rows] = getattr(samples, name)
        self.board.take(samples, arrival)
        self.repeating = nan

    def sort_out(
        self, samples: RawSamples, arrival: float
    ) -> tuple[RawSamples, NDArray[np.int64], NDArray[np.int64]]:
        """Follow samples run by run, if a counter does not simply continue. Returns the samples
        that are kept, and their numbers and times, us, (n,)."""
        keep = np.zeros(len(samples), dtype=bool)
        seqs: list[NDArray[np.int64]] = []
        times: list[NDArray[np.int64]] = []
        seq, time = self.seq, self.time
        gap = 1e6 * (arrival - self.board.host)  # host's time since the last samples, us
        n = 0
        for end in run_ends(samples):
            while n < end and self.is_again(samples, n, arrival):
                self.doubled += 1
                n += 1
            run, breaks = slice(n, end), self.breaks
            part = samples.where(run)
            steps = self.join_run(part, arrival, gap, not seqs) if n < end else None
            n = end
            if steps is None:
                continue
            if self.breaks > breaks:
                self.fresh = int(keep.sum())
            step, elapsed = steps
            pause = int(min(elapsed, gap))  # a clock that was set ahead is no silence
            if step == 1 and self.period and pause > max(CLOSE_US, 10 * self.period):
                self.silent += pause
            seqs.append(seq + step + np.arange(run.stop - run.start))
            times.append(time + elapsed + elapsed_counts(samples.time[run]))
            seq, time = int(seqs[-1][-1]), int(times[-1][-1])
            keep[run] = True
        nothing = np.zeros(0, np.int64)
        return (
            samples.where(keep),
            np.concatenate([nothing, *seqs]),
            np.concatenate([nothing, *times]),
        )

    def join_run(
        self, run: RawSamples, arrival: float, gap: float, first: bool
    ) -> tuple[int, int] | None:
        """Return the steps of number and time, us, to consecutive samples; None to drop them.

        gap: host's time since the last samples, us.  first: see `elapsed_time`.
        """
        number, at, board = int(run.seq[0]), int(run.time[0]), self.board
        step, passed = (number - board.seq) % WRAP, (at - board.time) % WRAP
        elapsed = self.elapsed_time(step, passed, gap, first)
        other = self.find_count(number, at, arrival, WRAP if elapsed is None else step)
        if other and board.is_sure and arrival - board.host < 1e-6 * CLOSE_US:
            self.foreign += len(run)
            other.take(run, arrival)
            return None
        if other or elapsed is None:
            self.break_count(other, number, is_leap=step == 1)
            waited = gap if isfinite(gap) and first else 0.0
            step, elapsed = 1, int(max(waited, self.period, 1.0))
        elif step > 1 and not elapsed <= gap + EARLY_US:
            self.start_count(number, lost=step - 1)
        self.lost += step - 1
        self.remember(run, arrival)
        return step, elapsed

    def break_count(self, other: CounterState | None, number: int, is_leap: bool) -> None:
        """Follow another count, or a new one of a board that restarted, from a sample on.

        is_leap: whether the numbers continue, so that without another count only the clock leapt.
        """
        self.breaks += 1
        if other:
            self.resume_count(other)
        elif is_leap:
            self.leaps += 1
        else:
            self.start_count(number, restarts=1)

    def is_again(self, samples: RawSamples, n: int, arrival: float) -> bool:
        """Whether a sample has come before, or comes after its turn.

        Where nothing else comes for longer than `CLOSE_US`, the board counts anew and sends the
        same as before.
        """
        board, number, at = self.board, int(samples.seq[n]), int(samples.time[n])
        back, earlier = (board.seq - number) % WRAP, (board.time - at) % WRAP
        if back >= MEMORY or arrival - self.repeating > 1e-6 * CLOSE_US:
            return False
        remembered = self.memory[number % MEMORY]
        is_known = remembered["seq"] == number
        if (
            is_known
            and remembered["time"] == at
            and (remembered["counts"] == samples.counts[n]).all()
        ):
            self.repeating = arrival if isnan(self.repeating) else self.repeating
            return True
        if is_known and remembered["key"] == board.key:
            return False  # a board that counts anew has the number, not the light
        is_past = 0 < back <= (board.seq - board.first) % WRAP
        return self.period > 0 and is_past and self.agrees(earlier, back)

    def find_count(self, number: int, at: int, arrival: float, limit: int) -> CounterState | None:
        """The earlier count that a sample continues with the fewest missing before it, None if
        there is none.

        limit: the step to the sample must be below this one.
        """
        for other in sorted(self.others, key=lambda other: (number - other.seq) % WRAP):
            step = (number - other.seq) % WRAP
            gap, passed = 1e6 * (arrival - other.host), (at - other.time) % WRAP
            elapsed = self.elapsed_time(step, passed, gap, first=True)
            if 0 < step < limit and elapsed is not None and not elapsed > gap + EARLY_US:
                return other
        return None

    def start_count(self, number: int, restarts: int = 0, lost: int = 0) -> None:
        """Follow a new count from a sample on; it comes with restarts and lost samples."""
        self.others = [*self.others, self.board][-MAX_COUNTS:] if self.counts else []
        self.counts += 1
        self.restarts += restarts
        self.board = CounterState(self.counts, number, number, 0, self.board.host, restarts, lost)

    def resume_count(self, other: CounterState) -> None:
        """Follow an earlier count again: the later counts began with no restart and no loss."""
        self.others = [*(count for count in self.others if count is not other), self.board]
        self.board = other
        for count in self.others:
            if count.key > other.key:
                self.restarts -= count.restarts
                self.lost -= count.lost
                count.restarts = count.lost = 0
        other.restarts = other.lost = 0

    @property
    def complaint(self) -> str:
        """The sentence on samples of other counts; empty if none came."""
        if not self.foreign:
            return ""
        return (
            f"{self.foreign} samples of another board, or from long ago, were dropped: let one "
            "board alone send to this port, each sample once"
        )

    def sentences(self) -> Iterator[str]:
        """Yield the sentences on restarts and dropped samples of the whole stream."""
        if self.restarts:
            restarts = times_text(self.restarts)
            yield f"the board restarted {restarts}; what it lost meanwhile is not known"
        if self.doubled:
            yield f"{self.doubled} samples came again, or too late, and were dropped"
        if self.complaint:
            yield self.complaint

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
        elapsed = passed + WRAP * max(0, round((goal - passed) / WRAP))
        were_kept = self.explains_samples(step, elapsed)
        if has_host and not self.agrees_with_host(elapsed, gap, first, were_kept):
            return None
        goes_on = has_host if step == 1 else self.may_miss(step, were_kept, has_host and first)
        return elapsed if goes_on else None

    def may_miss(self, step: int, were_kept: bool, late: bool) -> bool:
        """Whether the samples before this one, step - 1, may be missing, and nothing else is wrong.

        were_kept: see `explains_samples`.  late: whether all are late by the host's clock.
        """
        is_plausible = were_kept or self.period == 0
        is_near = step <= self.AHEAD or (self.period > 0 and late)
        return is_plausible and is_near

    def explains_samples(self, step: int, elapsed: float) -> bool:
        """Whether the missing samples can have been taken in a time `elapsed`, us."""
        if step == 1 or self.period == 0:
            return False
        # a board that paused for a while and lost samples has not begun anew
        stood = elapsed < CLOSE_US and self.fits_samples(elapsed, step)
        return stood or self.agrees(elapsed, step)

    def agrees_with_host(self, elapsed: float, gap: float, first: bool, were_kept: bool) -> bool:
        """Whether the board's clock advanced by about as much (`elapsed`, us) as the host's.

        gap: time that passed on the host's clock, us. Only samples after those that the board kept
        for long may be ahead of the host.
        """
        slack = 1e6 * CREDIBLE_S + 1e-3 * abs(gap)
        is_behind = first and elapsed < gap - slack
        is_ahead = elapsed > gap + slack and not were_kept
        return not (is_behind or is_ahead)


def run_ends(samples: RawSamples) -> list[int]:
    """The ends of runs, whose samples simply follow each other in both counters."""
    seq, time = samples.seq, samples.time
    steps, passed = seq[1:] - seq[:-1], time[1:] - time[:-1]  # unsigned, and wrap
    breaks = np.flatnonzero((steps != 1) | (passed >= CLOSE_US)) + 1
    return [*breaks.tolist(), len(samples)]


def usual_step(time: NDArray[np.int64]) -> float:
    """The median step of growing times (n,), because a board may have paused among them; the mean
    step if most steps are zero, because the board stamps several samples at once."""
    steps = np.sort(time[1:] - time[:-1])
    return float(steps[len(steps) // 2] or steps.mean())


def elapsed_counts(values: NDArray[np.uint32]) -> NDArray[np.int64]:
    """The steps of a counter that wraps at 2^32, since the first of its values (n,)."""
    elapsed = np.zeros(len(values), np.int64)
    np.cumsum(values[1:] - values[:-1], out=elapsed[1:])  # unsigned: they wrap as the counter does
    return elapsed
