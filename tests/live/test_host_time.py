"""Times of samples by the soonest arrivals, against arrivals that were drawn: nothing sleeps."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from streams import BENCH, samples_of, yawing

import facets
from facets.live import (
    CLOCK_MOVED,
    MARK,
    MARKED,
    Block,
    HostTime,
    Live,
    Loop,
    Pipeline,
    encode,
    touching_line,
)

JITTER, DRIFT, PACKET = 5e-3, 50e-6, 2e-3


def polled(true, rng, jitter=JITTER):
    """When packets sent at these times come through a port that is looked at now and then."""
    return np.maximum.accumulate(true + rng.uniform(0, jitter, len(true)))


def crowded(true, rng, jitter=JITTER):
    """The same on a busy machine: some are kept for much longer. None overtakes another."""
    return np.maximum.accumulate(true + rng.exponential(jitter, len(true)))


def errors(seed, seconds, arrivals=polled):
    """Error of the newest time after each packet, what it is said to be known to, and the clock."""
    rng = np.random.default_rng(seed)
    true = np.arange(0, seconds, PACKET)
    device = np.round(1e6 * true / (1 + DRIFT)) / 1e6
    clock, error, uncertainty = HostTime(), [], []
    for at, real, arrival in zip(device, true, arrivals(true, rng), strict=True):
        clock.add(at, arrival + 5000.0)
        error.append(clock.line.host_times(at) - 5000.0 - real)
        uncertainty.append(clock.uncertainty)
    return true, np.array(error), np.array(uncertainty), clock


@pytest.mark.parametrize(("arrivals", "most"), [(polled, 1e-4), (crowded, 4e-4)])
@pytest.mark.slow
def test_times_are_known_in_ten_seconds_and_as_well_as_is_said(arrivals, most):
    """5 ms of jitter and 50 ppm: the error of 30 clocks, beside their stated uncertainty."""
    ratios, rates = [], []
    for seed in range(30):
        true, error, uncertainty, clock = errors(seed, 12.0, arrivals)
        late = true > 10
        assert np.abs(error[late]).max() < most
        ratios.append((error / uncertainty)[late][::100])
        rates.append((clock.rate - DRIFT) / clock.rate_sigma)
    assert 0.5 < np.sqrt(np.mean(np.square(ratios))) < 1.4
    assert np.mean(np.abs(ratios) < 2) > 0.85
    assert 0.4 < np.sqrt(np.mean(np.square(rates))) < 1.8


def test_what_is_said_before_it_is_known_is_no_promise():
    _, error, uncertainty, _ = errors(1, 3.0)
    assert np.isinf(uncertainty[:100]).all()
    assert np.mean(np.abs(error[500:]) < 3 * uncertainty[500:]) > 0.95


def test_the_uncertainty_is_that_of_lines_under_exponential_points():
    """For delays of mean 1 s at 100 points: the three numbers of the module, by simulation."""
    rng, count, lines = np.random.default_rng(3), 100, []
    x = np.arange(count) / count
    for _ in range(600):
        offset, slope, is_free = touching_line(
            x - x.mean(), rng.exponential(size=count), -np.inf, np.inf
        )
        assert is_free
        lines.append((offset, offset + slope * (1 - x.mean()), slope))
    centre, end, slope = count * np.array(lines).T
    assert centre.mean() == pytest.approx(1.8, abs=0.25)
    assert np.sqrt(np.mean((end - 1.8) ** 2)) == pytest.approx(4.0, rel=0.2)
    assert np.sqrt(np.mean(slope**2)) == pytest.approx(7.0, rel=0.2)
    module = facets.live.sources.host_time
    assert (module.BIAS, module.END, module.RISE) == (1.8, 4.0, 7.0)


def test_a_clock_that_stood_still_and_one_that_was_set_are_noticed():
    """The host slept for 2 s, which its monotonic clock does not count; the board stood for 0.3."""
    clock, true = HostTime(), np.arange(0, 30, PACKET)
    came = polled(true, np.random.default_rng(5), 1e-3)
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
    late, is_settled = np.array(late), np.abs(true - 16.2) > 0.2
    assert np.abs(late - delay)[is_settled].max() < 0.02
    assert late[-1] > 0.02
    assert moves[4_000 - 1] == 0
    assert moves[8_000 - 1] == moves[-1] == 1  # the line was moved to the late data


def packets(count, begin=0.0):
    """Packets (bytes, arrival) of 20 samples; the samples 7 and 27 are marked by the board."""
    samples = samples_of(facets.readings(BENCH.sensor, yawing(count)))
    samples.flags[[7, 27]] = MARK
    true = begin + 1e-4 * np.arange(count)[19::20] * (1 + DRIFT)
    for n, arrival in enumerate(polled(true, np.random.default_rng(7))):
        yield encode("frames", samples.where(slice(20 * n, 20 * n + 20))), arrival


@pytest.mark.parametrize("timing", ["envelope", "arrival"])
def test_a_stage_hears_how_late_data_are_and_that_the_clock_was_moved(timing):
    config = replace(BENCH, acquire=replace(BENCH.acquire, timing=timing))
    halts, ages = [], []
    stage = SimpleNamespace(
        halt=halts.append, begun=0.0, feed=lambda *fed: ages.append(arrival - (fed[0] - fed[-2]))
    )
    loop = Loop(Live(Pipeline(config), tracker=stage), SimpleNamespace(port=None))
    for data, came in packets(66_000, 100.0):
        arrival = came + 0.3 * (came > 101.2)
        loop.take(Block(data, arrival, None))
        if len(loop.backlog) % 200 == 0:  # of some of them, the age is looked at
            loop.pass_on(loop.live.pipeline.skip(loop.backlog.batches[-1]), arrival)
    assert halts == [CLOCK_MOVED]
    ages = np.concatenate(ages)
    assert ages[:40].max() < 0.02
    assert ages[80:].min() > 0.29


def test_an_input_of_the_board_marks_its_samples():
    pipeline = Pipeline(BENCH)
    flags = [pipeline.take(data, arrival)[0].flags for data, arrival in packets(40)]
    assert np.flatnonzero(np.concatenate(flags) & MARKED).tolist() == [7, 27]
    assert pipeline.tally.flags["marked by the board's input"] == 2
