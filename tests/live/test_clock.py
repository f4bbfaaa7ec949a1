"""Counters and clocks: wraps, gaps, samples that come again, and boards that begin again."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

import facets
from facets.live import ELECTRODES, WRAP, Pipeline, RawSamples, Sequence, encode

PERIOD = 100


def samples(numbers, times=None, seed=1):
    """Samples with these numbers and times (us, PERIOD a number if left out), and any light."""
    raw = np.array(numbers, dtype=np.int64)
    at = PERIOD * raw if times is None else np.array(times, dtype=np.int64)
    none = np.zeros(len(raw), np.uint8)
    return RawSamples(
        none + np.uint8(ELECTRODES), none, (raw % WRAP).astype(np.uint32),
        (at % WRAP).astype(np.uint32), light_of(raw % WRAP, seed),
    )  # fmt: skip


def light_of(numbers, seed):
    """Any light, (n, 12): the same number has the same, as a sample that comes again has."""
    mixed = (numbers[:, None] * 7_919 + 12 * seed + np.arange(12)) * 104_729
    return (mixed % 1_000_003).astype(np.int32)


def follow(*blocks):
    """Blocks of (numbers, arrival, times, seed), of which the last two may be left out: restarts,
    lost and doubled samples; numbers and times of all samples."""
    sequence, parts = Sequence(), []
    for numbers, arrival, *details in blocks:
        parts.append(sequence.follow(samples(numbers, *details), arrival)[1:])
    seq, time = (np.concatenate(column) for column in zip(*parts, strict=True))
    return (sequence.restarts, sequence.lost, sequence.doubled), seq, time


#: A pause makes the mean step of the second block fifty times the usual one; a sample is missing.
PAUSE_US = PERIOD * np.arange(200) + np.repeat([0, 500_000], [50, 150])
REST = np.delete(np.arange(100, 200), 20)
#: A board that takes a sample every 0.9 s for over two hours, as in a file.
SLOW = np.delete(np.arange(10_000), 7_000)


def skip(first, arrival, count=1_000):
    """Blocks of samples before a gap, at 5 s, and after it."""
    return (np.arange(count), 5.0), (first + np.arange(20), arrival)


def unplug(hours):
    """A cable that is out for a while. Past 71.6 minutes the board's clock has wrapped."""
    return skip(round(hours * 3600e6 / PERIOD), 5.0 + hours * 3600 * (1 + 30e-6), count=40)


@pytest.mark.parametrize(
    "blocks",
    [
        ((WRAP + np.arange(-2, 1), 1.0), (WRAP + np.array([1, 5]), 1.001)),  # both counters wrap
        ((SLOW, np.nan, 900_000 * SLOW),),  # the clock wraps in a block
        ((np.arange(100), 1.0, PAUSE_US[:100]), (REST, 1.01, PAUSE_US[REST])),
        skip(1_010, 8.0),  # a host that reads late
        skip(400_000, 5.003),  # samples that a board kept for 40 s
        # a board that stalls
        (skip(0, 0)[0], (1_002 + np.arange(20), 5.3, PERIOD * (999 + np.arange(20)) + 300_000)),
        *map(unplug, [1.19, 1.2, 30.0]),
    ],
)
def test_a_gap_costs_samples_and_no_time_and_is_no_restart(blocks):
    """A board's two counters and the host's clock agree."""
    numbers = np.concatenate([block[0] for block in blocks])
    times = np.concatenate([block[2] if block[2:] else PERIOD * block[0] for block in blocks])
    counts, seq, time = follow(*blocks)
    assert counts == (0, numbers[-1] - numbers[0] + 1 - len(numbers), 0)
    np.testing.assert_array_equal(seq - seq[0], numbers - numbers[0])
    np.testing.assert_array_equal(time - time[0], times - times[0])


@pytest.mark.parametrize("first", [100, 0])
def test_a_board_that_took_no_samples_for_a_while_was_silent(first):
    sequence = Sequence()
    sequence.follow(samples(range(100)), arrival=1.0)
    assert sequence.silent == 0
    sequence.follow(samples(range(first, first + 50), np.arange(50) * 100 + 6_000_000), arrival=7.0)
    assert sequence.lost == 0
    assert sequence.silent == pytest.approx(6e6, rel=0.01)


def test_samples_that_come_again_or_late_are_dropped():
    counts, seq, time = follow(([10, 11, 11, 10, 12], 1.0))
    assert seq.tolist() == [10, 11, 12]
    assert np.diff(time).tolist() == [100, 100]
    assert counts == (0, 0, 2)
    counts, seq, _ = follow((range(10), 1.0), ([10, 12], 1.001), ([11, 13], 1.002))
    assert seq.tolist() == [*range(11), 12, 13]
    assert counts == (0, 1, 1)


def interleave(others, each=20, count=20_000, period=500, lost=()):
    """Counts of a board at 2 kHz whose blocks come beside those of others.

    others: (delay in samples, seed) of each; those of seed 1 are the board's own, sent again.
    lost: numbers of blocks that are lost.
    """
    sequence, taken = Sequence(), 0
    for n in range(40_000, 40_000 + count, each):
        for delay, seed in [(0, 1), *others]:
            numbers = np.arange(n, n + each) - delay
            if (delay == 0 and n // each in lost) or (seed == 1 and numbers[0] < 40_000):
                continue
            arrival = 1e-6 * period * n + 1e-4 * seed
            used, seq, _ = sequence.follow(samples(numbers, period * numbers, seed), arrival)
            taken += len(used)
            assert len(used) == len(seq)
    return sequence, taken


@pytest.mark.parametrize("lost", [(), (2_100, 2_500, 2_501)])
@pytest.mark.parametrize(
    "delays", [[940], [60_000], [-900], [-7_200_000], [6_000, -900], [35_000, 70_000, 300]]
)
def test_no_sample_is_lost_between_two_boards_on_one_port(delays, lost):
    """The first board is followed; samples of the others are dropped and counted."""
    others = [(delay, seed) for seed, delay in enumerate(delays, 2)]
    sequence, taken = interleave(others, lost=lost)
    assert sequence.lost == 20 * len(lost)
    assert sequence.restarts == 0
    assert taken <= 20_000 - 20 * len(lost) + 20 * len(delays)
    dropped = sequence.foreign + sequence.doubled
    assert taken + dropped == 20_000 * (1 + len(delays)) - 20 * len(lost)
    assert "another board" in sequence.complaint


@pytest.mark.parametrize("delay", [20, 940, 4_000, 15_000])
def test_samples_that_are_sent_again_much_later_are_counted_as_such(delay):
    sequence, taken = interleave([(delay, 1)])
    assert taken == 20_000
    assert (sequence.lost, sequence.restarts, sequence.foreign) == (0, 0, 0)
    assert sequence.doubled == 20_000 - delay


def test_another_board_is_followed_once_the_first_is_silent():
    sequence, _ = interleave([(30_000, 2)], count=200)
    counts = []
    for k in range(200):
        numbers = 10_200 + 20 * k + np.arange(20)
        used, *_ = sequence.follow(samples(numbers, 500 * numbers, 2), 20.1 + 0.01 * k)
        counts.append(len(used))
    assert 90 * 20 < sum(counts) < 110 * 20
    assert sequence.lost == 0


@pytest.mark.parametrize(
    ("first", "second", "gap"),
    [
        *product([3, 500, 5_000, 40_000_000], [0], [0.05, 1.5, 20.0, 3_000.0]),
        (100_000, 250_000, 600.0),  # larger again: only the host's clock knows
    ],
)
def test_time_goes_on_by_the_hosts_clock_when_a_board_restarts(first, second, gap):
    """However long it ran, the board's counters begin anew; its light is another."""
    later = range(second, second + 20)
    counts, seq, time = follow((range(first, first + 40), 100.0), (later, 100.0 + gap, None, 2))
    assert counts == (1, 0, 0)
    assert (np.diff(seq) == 1).all()
    steps = np.diff(time)
    assert steps[39] == pytest.approx(1e6 * gap, abs=PERIOD)
    assert (np.delete(steps, 39) == PERIOD).all()


def test_a_clock_that_leaps_while_the_numbers_go_on_is_no_restart():
    """A counter of 24 bits, and a clock that is set ahead by 2 s, in which no sample is missing."""
    sequence, arrival = Sequence(), 100.0
    for n in range(200):
        numbers = 100 * n + np.arange(100)
        times = (16_000_000 + 100 * numbers + 2_000_000 * (n > 150)) % 2**24
        sequence.follow(samples(numbers, times), arrival + 0.01 * n)
    assert (sequence.lost, sequence.restarts, sequence.silent) == (0, 0, 0)
    assert "leapt once" in sequence.leap_sentence


def test_a_restart_in_the_middle_of_a_block_jumps_by_no_hour():
    counts, seq, time = follow(
        (range(5_000, 5_040), 7.0), ([*range(5_040, 5_045), *range(5)], 7.01)
    )
    assert counts == (1, 0, 0)
    assert (np.diff(seq) == 1).all()
    assert (np.diff(time) >= 1).all()
    assert np.diff(time).max() <= 10_000


def board_life(first, count, begin, seed):
    """Blocks (bytes, arrival) of a board that was switched on at `begin` (s), from a sample on.

    Its clock is slow by 30 ppm; what it sends arrives 1.5 ms after its last sample.
    """
    for start in range(first, first + count, 50):
        part = samples(range(start, start + 50), seed=seed)
        sent = begin + 1e-6 * PERIOD * (start + 49) * (1 + 30e-6)
        yield encode("frames", part), sent + 1.5e-3


def test_host_times_and_drift_are_right_through_restarts_and_the_wrap():
    """Three lives of one board; its clock wraps in the first."""
    config = facets.load("bench")
    least = replace(config.acquire, least_delay=1.5e-3)
    pipeline = Pipeline(replace(config, acquire=least))
    lives = [(WRAP // PERIOD - 20_000, 30_000, 0.0), (0, 25_000, 9_000.0), (0, 25_000, 9_010.0)]
    batches = [
        batch
        for n, (start, count, begin) in enumerate(lives)
        for data, arrival in board_life(start, count, begin, seed=n)
        for batch in pipeline.take(data, arrival)
    ]
    times, board_us, seq = (
        np.concatenate([getattr(batch, name) for batch in batches])
        for name in ("host", "time", "seq")
    )
    assert pipeline.sequence.restarts == pipeline.host_time.restarts == 2
    assert pipeline.sequence.lost == 0
    assert (np.diff(seq) == 1).all()
    assert (np.diff(board_us) > 0).all()
    true = [b + 1e-6 * PERIOD * np.arange(s, s + c) * (1 + 30e-6) for s, c, b in lives]
    is_settled = np.concatenate([np.arange(c) * PERIOD > 2e6 for _, c, _ in lives])
    error = np.abs(times - np.concatenate(true))
    assert error[is_settled].max() < 3e-6
    assert error.max() < 50e-6  # by the drift, which is not known at first
    assert pipeline.host_time.ppm == pytest.approx(30, abs=3)
