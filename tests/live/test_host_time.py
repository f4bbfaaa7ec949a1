"""Times of samples by the soonest arrivals, against arrivals that were drawn: nothing sleeps."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import facets
from facets.live import (
    CLOCK_MOVED,
    ELECTRODES,
    MARK,
    MARKED,
    WRAP,
    Block,
    HostTime,
    Live,
    Loop,
    Pipeline,
    Samples,
    encode,
    touching_line,
)
from facets.live.sources import host_time

JITTER, DRIFT, PACKET = 5e-3, 50e-6, 2e-3
CONFIG = facets.load("bench")
LEAST = replace(CONFIG, acquire=replace(CONFIG.acquire, least_delay=0.0))


def polled(true, rng, jitter=JITTER):
    """When packets sent at these times come through a port that is looked at now and then."""
    return np.maximum.accumulate(true + rng.uniform(0, jitter, len(true)))


def crowded(true, rng, jitter=JITTER):
    """The same on a busy machine: some are kept for much longer. None overtakes another."""
    return np.maximum.accumulate(true + rng.exponential(jitter, len(true)))


def errors(seed, seconds, arrivals=polled, jitter=JITTER, drift=DRIFT):
    """Error of the newest time after each packet, what it is said to be known to, and the clock."""
    rng = np.random.default_rng(seed)
    true = np.arange(0, seconds, PACKET)
    device = np.round(1e6 * true / (1 + drift)) / 1e6
    clock, error, said = HostTime(), [], []
    for at, real, arrival in zip(device, true, arrivals(true, rng, jitter), strict=True):
        clock.add(at, arrival + 5000.0)
        error.append(clock.line.host_times(at) - 5000.0 - real)
        said.append(clock.uncertainty)
    return true, np.array(error), np.array(said), clock


@pytest.mark.parametrize(("arrivals", "most"), [(polled, 1e-4), (crowded, 4e-4)])
@pytest.mark.slow
def test_times_are_known_in_ten_seconds_and_as_well_as_is_said(arrivals, most):
    """5 ms of jitter and 50 ppm: the error of 30 clocks, beside their stated uncertainty."""
    over, rates = [], []
    for seed in range(30):
        true, error, said, clock = errors(seed, 12.0, arrivals)
        late = true > 10
        assert np.abs(error[late]).max() < most
        over.append((error / said)[late][::100])
        rates.append((clock.rate - DRIFT) / clock.rate_sigma)
    assert 0.5 < np.sqrt(np.mean(np.square(over))) < 1.4
    assert np.mean(np.abs(over) < 2) > 0.85
    assert 0.4 < np.sqrt(np.mean(np.square(rates))) < 1.8


def test_what_is_said_before_it_is_known_is_no_promise():
    _, error, said, _ = errors(1, 3.0)
    assert np.isinf(said[:100]).all()
    assert np.nanmean(np.abs(error[500:]) < 3 * said[500:]) > 0.95


def test_the_constants_of_the_module_are_those_of_lines_under_exponential_points():
    rng = np.random.default_rng(3)
    count, found = 100, []
    x = np.arange(count) / count
    for _ in range(600):
        offset, slope, free = touching_line(
            x - x.mean(), rng.exponential(size=count), -np.inf, np.inf
        )
        assert free
        found.append((offset, offset + slope * (1 - x.mean()), slope))
    centre, end, slope = count * np.array(found).T
    assert centre.mean() == pytest.approx(host_time.BIAS, abs=0.25)
    assert np.sqrt(np.mean((end - host_time.BIAS) ** 2)) == pytest.approx(host_time.END, rel=0.2)
    assert np.sqrt(np.mean(slope**2)) == pytest.approx(host_time.RISE, rel=0.2)


def life(first, count, begin, rng, flags=None):
    """Packets (bytes, arrival, true times) of 4 samples of a board switched on at `begin`, s."""
    number = first + np.arange(count)
    true = begin + number * PACKET / 4
    clock = np.round(1e6 * (true - begin) / (1 + DRIFT)).astype(np.int64) % WRAP
    none = np.zeros(count, np.uint8)
    light = rng.integers(20_000, 21_000, (count, 12)).astype(np.int32)
    whole = Samples(
        none + np.uint8(ELECTRODES), none if flags is None else flags,
        (number % WRAP).astype(np.uint32), clock.astype(np.uint32), light,
    )  # fmt: skip
    came = polled(true[3::4], rng)
    for n in range(count // 4):
        part = slice(4 * n, 4 * n + 4)
        yield encode("frames", whole.where(part)), came[n], true[part]


@pytest.mark.slow
def test_times_are_right_through_a_wrap_and_a_restart(monkeypatch):
    """The clock of the first life wraps after 12 s; the second begins 0.4 s after its end."""
    nothing = np.zeros((4, 9)), np.zeros(4, np.uint8)
    monkeypatch.setattr(Pipeline, "convert", lambda *_: nothing)  # no light is looked at here
    rng = np.random.default_rng(11)
    first = round((WRAP / 1e6 - 12.0) / (PACKET / 4))
    count = 48_000  # 24 s
    end = (first + count) * PACKET / 4
    pipeline, error, since = Pipeline(LEAST), [], []
    wrapped = 0
    for start, begin in ((first, 0.0), (0, end + 0.4)):
        born = None
        for data, arrival, true in life(start, count, begin, rng):
            (batch,) = pipeline.take(data, arrival)
            born = true[0] if born is None else born
            error.append(batch.host - true)
            since.append(true - born)
            wrapped += int((np.diff(batch.host) < 0).any())
    assert pipeline.sequence.restarts == 1
    assert pipeline.sequence.lost == 0
    assert wrapped == 0
    error, since = np.concatenate(error), np.concatenate(since)
    assert np.abs(error[since > 10]).max() < 1e-4
    assert np.abs(error[since > 2]).max() < 1e-3
    assert pipeline.host_time.ppm == pytest.approx(50, abs=8)
    # by arrival alone the same blocks are wrong by the port's jitter
    old = Pipeline(replace(CONFIG, acquire=replace(CONFIG.acquire, timing="arrival", delay=5e-3)))
    by_arrival = [
        old.take(data, arrival)[0].host - true
        for data, arrival, true in life(0, 8_000, 0.0, np.random.default_rng(11))
    ]
    assert np.concatenate(by_arrival).std() > 20 * error[since > 10].std()


def test_a_clock_that_stood_still_and_one_that_was_set_are_noticed():
    """The host slept for 2 s, which its monotonic clock does not count; the board stood for 0.3."""
    rng = np.random.default_rng(5)
    clock = HostTime()
    true = np.arange(0, 30, PACKET)
    came = polled(true, rng, 1e-3)
    for at, arrival in zip(true, came, strict=True):
        clock.add(at, arrival)
    for at, arrival in zip(true + 30, came + 28, strict=True):
        clock.add(at, arrival)
        assert abs(clock.line.host_times(at) - (at - 2.0)) < 20e-3
    assert clock.restarts == 1
    for at, arrival in zip(true + 60, came + 58.3, strict=True):
        clock.add(at, arrival)
    assert clock.line.host_times(90.0) == pytest.approx(88.3, abs=1e-4)


def test_a_delay_that_the_line_takes_over_is_remembered_until_it_goes():
    """0.3 s for 8 s, and none again; then 1 ms more each second, above what a clock drifts."""
    rng = np.random.default_rng(6)
    clock, true = HostTime(), np.arange(0, 50, PACKET)
    delay = np.where((true > 8) & (true < 16), 0.3, 0.0) + 1e-3 * np.maximum(true - 20, 0)
    late, moves = [], []
    for at, arrival in zip(true / (1 + DRIFT), polled(true + delay, rng), strict=True):
        clock.add(at, arrival)
        late.append(clock.late + clock.over)
        moves.append(clock.moves)
    late, settled = np.array(late), np.abs(true - 16.2) > 0.2
    assert np.abs(late - delay)[settled].max() < 0.02
    assert late[-1] > 0.02
    assert moves[4_000 - 1] == 0
    assert moves[8_000 - 1] == moves[-1] == 1  # the line was moved to the late data


@pytest.mark.parametrize("timing", ["envelope", "arrival"])
def test_a_stage_hears_how_late_data_are_and_that_the_clock_was_moved(timing):
    config = replace(CONFIG, acquire=replace(CONFIG.acquire, timing=timing))
    halts, ages = [], []
    stage = SimpleNamespace(
        halt=halts.append, begun=0.0, feed=lambda *fed: ages.append(arrival - (fed[0] - fed[-2]))
    )
    loop = Loop(Live(Pipeline(config), tracker=stage), SimpleNamespace(port=None))
    for data, came, _ in life(0, 13_200, 100.0, np.random.default_rng(7)):
        arrival = came + 0.3 * (came > 101.2)
        loop.take(Block(data, arrival, None))
        if len(loop.backlog) % 200 == 0:  # of some of them, the age is looked at
            loop.pass_on(loop.live.pipeline.skip(loop.backlog.batches[-1]), arrival)
    assert halts == [CLOCK_MOVED]
    ages = np.concatenate(ages)
    assert ages[:8].max() < 0.02
    assert ages[16:].min() > 0.29


def test_an_input_of_the_board_marks_its_samples():
    flags = np.zeros(40, np.uint8)
    flags[[7, 27]] = MARK
    pipeline = Pipeline(LEAST)
    found = [
        pipeline.take(data, arrival)[0].flags
        for data, arrival, _ in life(0, 40, 0.0, np.random.default_rng(1), flags)
    ]
    assert np.flatnonzero(np.concatenate(found) & MARKED).tolist() == [7, 27]
    assert pipeline.tally.flags["marked by the board's input"] == 2
