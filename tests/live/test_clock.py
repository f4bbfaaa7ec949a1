"""Counters and clocks: wraps, gaps, samples that come again, and boards that begin again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import facets
from facets.live import ELECTRODES, WRAP, Pipeline, Samples, Sequence, encode

PERIOD = 100


def samples(seqs, times=None, seed=1):
    """Samples with these numbers and times (us, PERIOD a number if left out), and any light."""
    raw = np.array(seqs, dtype=np.int64)
    at = PERIOD * raw if times is None else np.array(times, dtype=np.int64)
    counts = light_of(raw % WRAP, seed)
    none = np.zeros(len(raw), np.uint8)
    return Samples(
        none + np.uint8(ELECTRODES), none, (raw % WRAP).astype(np.uint32),
        (at % WRAP).astype(np.uint32), counts,
    )  # fmt: skip


def light_of(numbers, seed):
    """Any light, (n, 12): the same number has the same, as a sample that comes again has."""
    places = np.arange(12, dtype=np.uint64) + np.uint64(12 * seed)
    mixed = numbers.astype(np.uint64)[:, None] * np.uint64(0x9E3779B97F4A7C15)
    mixed = (mixed + places * np.uint64(0xD1B54A32D192ED03)) * np.uint64(0x94D049BB133111EB)
    mixed = (mixed ^ (mixed >> np.uint64(29))) * np.uint64(0xBF58476D1CE4E5B9)
    return ((mixed >> np.uint64(40)) % np.uint64(1000)).astype(np.int32)


def test_counters_wrap_and_gaps_are_counted():
    sequence = Sequence()
    _, seq, time = sequence.follow(samples([WRAP - 2, WRAP - 1, WRAP, WRAP + 1, WRAP + 5]))
    assert np.diff(seq).tolist() == [1, 1, 1, 4]
    assert np.diff(time).tolist() == [100, 100, 100, 400]
    assert sequence.lost == 3
    assert sequence.restarts == 0


@pytest.mark.parametrize("missing", [[], [7000]])
def test_a_clock_may_wrap_several_times_in_a_block(missing):
    """As in a file of a slow board: every 0.9 s a sample, for over two hours."""
    numbers = np.delete(np.arange(10_000), missing)
    sequence = Sequence()
    _, seq, time = sequence.follow(samples(numbers, 900_000 * numbers))
    assert seq.tolist() == numbers.tolist()
    assert (time - time[0]).tolist() == (900_000 * numbers).tolist()
    assert (sequence.lost, sequence.restarts) == (len(missing), 0)


def test_a_board_that_paused_has_not_restarted_where_a_sample_is_lost():
    """A pause makes the mean step of its block fifty times the usual one."""
    sequence = Sequence()
    times = PERIOD * np.arange(200)
    times[50:] += 500_000
    sequence.follow(samples(range(100), times[:100]), 1.0)
    _, seq, time = sequence.follow(samples([*range(100, 120), *range(121, 200)],
                                           np.delete(times[100:], 20)), 1.01)  # fmt: skip
    assert (sequence.restarts, sequence.lost) == (0, 1)
    assert seq[-1] == 199
    assert time[-1] == times[-1]


@pytest.mark.parametrize("first", [100, 0], ids=["goes on", "begins anew"])
def test_a_board_that_took_no_samples_for_a_while_was_silent(first):
    sequence = Sequence()
    sequence.follow(samples(range(100)), arrival=1.0)
    assert sequence.silent == 0
    sequence.follow(samples(range(first, first + 50), np.arange(50) * 100 + 6_000_000), arrival=7.0)
    assert sequence.lost == 0
    assert sequence.silent == pytest.approx(6e6, rel=0.01)


def test_samples_stamped_together_have_the_mean_step():
    sequence = Sequence()
    sequence.follow(samples(range(100), 1000 * (np.arange(100) // 10)), 1.0)
    assert sequence.period == pytest.approx(1000 * 9 / 99)


def test_samples_that_come_again_are_dropped():
    sequence = Sequence()
    _, seq, time = sequence.follow(samples([10, 11, 11, 10, 12]))
    assert seq.tolist() == [10, 11, 12]
    assert np.diff(time).tolist() == [100, 100]
    assert (sequence.doubled, sequence.lost, sequence.restarts) == (2, 0, 0)


def test_a_sample_that_comes_late_is_dropped():
    sequence = Sequence()
    sequence.follow(samples(range(10)), 1.0)
    sequence.follow(samples([10, 12]), 1.001)
    _, seq, _ = sequence.follow(samples([11, 13]), 1.002)
    assert seq.tolist() == [13]
    assert (sequence.doubled, sequence.lost, sequence.restarts) == (1, 1, 0)


@pytest.mark.parametrize("first", [3, 500, 5_000, 1_000_000, 40_000_000])
@pytest.mark.parametrize("gap", [0.05, 1.5, 20.0, 3_000.0])
def test_time_goes_on_by_the_hosts_clock_when_a_board_restarts(first, gap):
    """However long it ran, the board's counters begin at 0; its light is another."""
    sequence = Sequence()
    _, seq, time = sequence.follow(samples(range(first, first + 40)), 100.0)
    _, after, since = sequence.follow(samples(range(20), seed=2), 100.0 + gap)
    assert sequence.restarts == 1
    assert (sequence.lost, sequence.doubled) == (0, 0)
    assert after[0] == seq[-1] + 1
    assert since[0] - time[-1] == pytest.approx(1e6 * gap, abs=PERIOD)
    assert (np.diff(since) == PERIOD).all()
    assert (np.diff(after) == 1).all()


def test_a_restart_in_the_middle_of_a_block_jumps_by_no_hour():
    sequence = Sequence()
    sequence.follow(samples(range(5_000, 5_040)), 7.0)
    times = [*range(504_000, 504_500, 100), *range(0, 500, 100)]
    _, seq, time = sequence.follow(samples([*range(5_040, 5_045), *range(5)], times, 3), 7.01)
    assert (np.diff(seq) == 1).all()
    assert sequence.restarts == 1
    assert (np.diff(time) >= 1).all()
    assert np.diff(time).max() <= 10_000


def test_a_board_that_restarts_while_unplugged_is_told_from_a_gap():
    """Its numbers may be larger again than the last that came: only the host's clock knows."""
    sequence = Sequence()
    _, _, time = sequence.follow(samples(range(100_000, 100_040)), 10.0)
    _, _, since = sequence.follow(samples(range(250_000, 250_040)), 10.0 + 600.0)
    assert sequence.restarts == 1
    assert sequence.lost == 0
    assert since[0] - time[-1] == pytest.approx(600e6)


@pytest.mark.parametrize("hours", [0.5, 1.19, 1.2, 2.5, 30.0])
def test_a_cable_that_was_out_for_hours_costs_samples_and_no_time(hours):
    """Past 71.6 minutes the board's clock has wrapped; its two counters and the host's agree."""
    sequence = Sequence()
    _, seq, time = sequence.follow(samples(range(1_000, 1_040)), 50.0)
    passed = round(hours * 3600e6 / PERIOD)
    _, after, since = sequence.follow(
        samples(range(1_039 + passed, 1_079 + passed)), 50.0 + hours * 3600 * (1 + 30e-6)
    )
    assert sequence.restarts == 0
    assert sequence.lost == passed - 1
    assert after[0] - seq[-1] == passed
    assert since[0] - time[-1] == passed * PERIOD


def test_time_goes_on_past_its_wrap():
    sequence = Sequence()
    first = samples(range(3), [WRAP - 200, WRAP - 100, WRAP])
    _, _, time = sequence.follow(first, 1.0)
    assert np.diff(time).tolist() == [100, 100]
    _, _, again = sequence.follow(samples([3, 4], [WRAP + 100, WRAP + 200]), 1.001)
    assert again[0] - time[-1] == 100
    assert sequence.restarts == 0


def test_a_host_that_reads_late_sees_no_restart():
    """A gap in the samples, then a pause of the reader: what came was only kept waiting."""
    sequence = Sequence()
    sequence.follow(samples(range(1_000)), 5.0)
    _, seq, _ = sequence.follow(samples(range(1_010, 1_020)), 8.0)
    assert sequence.restarts == 0
    assert sequence.lost == 10
    assert seq[0] == 1_010


def test_a_board_that_stands_still_and_loses_samples_has_not_begun_anew():
    """Time that passes without samples, as on a busy controller, and two samples missing."""
    sequence = Sequence()
    sequence.follow(samples(range(100), range(0, 100 * 20, 20)), 10.0)
    stalled = 99 * 20 + 300_000
    _, seq, time = sequence.follow(
        samples(range(102, 110), range(stalled, stalled + 8 * 20, 20)), 10.3
    )
    assert (sequence.restarts, sequence.lost) == (0, 2)
    assert (seq[0], time[0]) == (102, stalled)


def test_samples_that_a_board_kept_for_long_are_followed_by_a_gap_and_no_restart():
    """It was on for 40 s before anyone read, and kept what it had first."""
    sequence = Sequence()
    sequence.follow(samples(range(1_000)), 5.0)
    _, seq, time = sequence.follow(samples(range(400_000, 400_050)), 5.003)
    assert sequence.restarts == 0
    assert sequence.lost == 399_000
    assert (seq[0], time[0]) == (400_000, 400_000 * PERIOD)


def board_life(first, count, begin, ppm=30.0, seed=1):
    """Blocks (bytes, arrival) of a board that was switched on at `begin` (s), from a sample on.

    Its clock is slow by ppm; what it sends arrives 1.5 ms after its last sample.
    """
    for start in range(first, first + count, 50):
        part = samples(range(start, start + 50), seed=seed)
        sent = begin + 1e-6 * PERIOD * (start + 49) * (1 + 1e-6 * ppm)
        yield encode("frames", part), sent + 1.5e-3


@pytest.mark.parametrize("first", [0, 2**32 // PERIOD - 20_000])
@pytest.mark.slow
def test_host_times_and_drift_are_right_through_restarts_and_the_wrap(first):
    """Three lives of one board; the first begins before its clock wraps."""
    config = facets.load("bench")
    least = replace(config.acquire, least_delay=1.5e-3)
    pipeline = Pipeline(replace(config, acquire=least))
    lives = [(first, 40_000, 0.0), (0, 30_000, 9_000.0), (0, 30_000, 9_010.0)]
    host = []
    for n, (start, count, begin) in enumerate(lives):
        for data, arrival in board_life(start, count, begin, seed=n):
            for batch in pipeline.take(data, arrival):
                assert (np.diff(batch.time) > 0).all()
                host.append((batch.host, batch.seq))
    times, seq = (np.concatenate(column) for column in zip(*host, strict=True))
    assert pipeline.sequence.restarts == 2
    assert pipeline.sequence.lost == 0
    assert (np.diff(seq) == 1).all()
    true = np.concatenate(
        [b + 1e-6 * PERIOD * np.arange(s, s + c) * (1 + 30e-6) for s, c, b in lives]
    )
    settled = np.concatenate([np.arange(c) * PERIOD > 2e6 for _, c, _ in lives])
    error = np.abs(times - true)
    assert error[settled].max() < 3e-6
    assert error.max() < 50e-6  # by the drift alone, which is not known at first
    assert pipeline.host_time.ppm == pytest.approx(30, abs=3)
    assert pipeline.host_time.restarts == 2
