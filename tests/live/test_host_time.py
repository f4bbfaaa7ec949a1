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
    WRAP,
    Block,
    HostTime,
    Live,
    Loop,
    Pipeline,
    Playback,
    Run,
    RunOptions,
    encode,
)
from facets.live.sources import host_time

JITTER, DRIFT, PACKET = 5e-3, 50e-6, 2e-3


def arrive(true, rng, jitter=JITTER, delays="uniform"):
    """When packets sent at these times come through a port that is looked at now and then, or, by
    "exponential" delays, on a busy machine, which keeps some for much longer. None overtakes
    another."""
    kept = rng.uniform(0, 1, len(true)) if delays == "uniform" else rng.exponential(size=len(true))
    return np.maximum.accumulate(true + jitter * kept)


@pytest.mark.parametrize(("delays", "most"), [("uniform", 1e-4), ("exponential", 4e-4)])
@pytest.mark.slow
def test_times_are_known_in_ten_seconds_and_as_well_as_is_said(delays, most):
    """5 ms of jitter and 50 ppm: the error of 30 clocks, beside their stated uncertainty."""
    ratios, rates, true = [], [], np.arange(0, 12, PACKET)
    for seed in range(30):
        clock, error, uncertainty = HostTime(), [], []
        came = arrive(true, np.random.default_rng(seed), delays=delays)
        for real, arrival in zip(true, came, strict=True):
            at = np.round(1e6 * real / (1 + DRIFT)) / 1e6
            clock.add(at, arrival + 5000.0)
            error.append(clock.line.host_times(at) - 5000.0 - real)
            uncertainty.append(clock.uncertainty)
        assert np.isinf(uncertainty[:100]).all()
        error, late = np.array(error), true > 10
        assert np.abs(error[late]).max() < most
        ratios.append((error / uncertainty)[500::100])
        rates.append((clock.rate - DRIFT) / clock.rate_sigma)
    assert 0.5 < np.sqrt(np.mean(np.square(ratios))) < 1.4
    assert np.mean(np.abs(ratios) < 2) > 0.85
    assert 0.4 < np.sqrt(np.mean(np.square(rates))) < 1.8


def test_the_uncertainty_is_that_of_lines_under_exponential_points():
    """For delays of mean 1 s at 100 points: the three numbers of the module, by simulation."""
    rng, count, lines = np.random.default_rng(3), 100, []
    x = np.arange(count) / count
    for _ in range(600):
        lag = rng.exponential(size=count)
        slope = host_time.hull_slope(x - x.mean(), lag, np.nan)
        offset, _ = host_time.touching_line(x - x.mean(), lag, slope)
        lines.append((offset, offset + slope * (1 - x.mean()), slope))
    centre, end, slope = count * np.array(lines).T
    assert centre.mean() == pytest.approx(host_time.BIAS, abs=0.25)
    assert np.sqrt(np.mean((end - host_time.BIAS) ** 2)) == pytest.approx(host_time.END, rel=0.2)
    assert np.sqrt(np.mean(slope**2)) == pytest.approx(host_time.RISE, rel=0.2)


def test_a_clock_that_stood_still_and_one_that_was_set_are_noticed():
    """The host slept for 2 s, which its monotonic clock does not count; the board stood for 0.3."""
    clock, true = HostTime(), np.arange(0, 30, PACKET)
    came = arrive(true, np.random.default_rng(5), 1e-3)
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
    for at, arrival in zip(true / (1 + DRIFT), arrive(true + delay, rng), strict=True):
        clock.add(at, arrival)
        late.append(clock.late + clock.over)
        moves.append(clock.moves)
    late, is_settled = np.array(late), np.abs(true - 16.2) > 0.2
    assert np.abs(late - delay)[is_settled].max() < 0.02
    assert moves[4_000 - 1] == 0
    assert moves[8_000 - 1] == moves[-1] == 1  # the line was moved to the late data


@pytest.mark.parametrize("drift", [1e-3, 5e-3, -0.01])
def test_a_clock_that_is_off_by_more_than_a_quartz_is_told_and_its_times_are_known(drift):
    """In 30 s; the stated uncertainty holds from the beginning, also where it is not told yet."""
    clock, true, ratios = HostTime(), np.arange(0, 30, PACKET), []
    came = arrive(true, np.random.default_rng(8), 1.5e-3, "exponential")
    for real, arrival in zip(true, came, strict=True):
        at = np.round(1e6 * real / (1 + drift)) / 1e6
        clock.add(at, arrival)
        ratios.append((clock.line.host_times(at) - real) / clock.uncertainty)
    assert np.abs(ratios).max() < 6
    assert clock.ppm == pytest.approx(1e6 * drift / (1 + drift), abs=10)
    assert ("slow" if drift > 0 else "fast") in clock.complaint
    assert clock.uncertainty < 2e-5
    assert clock.worst > 4e-3 or drift < 0  # before the clock was believed to be so far off


@pytest.mark.parametrize(
    ("pace", "words"),
    [(10.0, "10 times"), (1.2, "prescaler"), (1e-3, "counts milliseconds"), (1e3, "nanoseconds"),
     (0.0, "does not advance")],
)  # fmt: skip
def test_a_board_whose_times_are_in_another_unit_ends_with_a_complaint(pace, words):
    pipeline = Pipeline(BENCH)
    for data, arrival in packets(40_000, 100.0, pace):
        poses = pipeline.take(data, arrival)
    assert words in pipeline.times.fault
    assert poses[-1].host[-1] == pytest.approx(arrival, abs=2 * JITTER)
    run = Run(BENCH, RunOptions(record=False), Live(Pipeline(BENCH)))
    run.live.pipeline = pipeline
    assert any(words in text for text in run.complaints())
    assert any(words in text for text in run.live.messages())


def test_a_file_has_no_arrivals_and_its_clock_no_fault(tmp_path):
    """However fast it is read; its samples are as far apart as the board says."""
    (tmp_path / "board.bin").write_bytes(b"".join(data for data, _ in packets(40_000, 0.0)))
    options = RunOptions(folder=tmp_path / "rec")
    Run.from_config(BENCH, f"file:{tmp_path / 'board.bin'}", options).acquire()
    playback = Playback(tmp_path / "rec")
    host = np.concatenate([poses.host for poses in playback.poses()])
    assert np.diff(host) == pytest.approx(np.full(39_999, 1e-4), abs=1e-9)
    assert playback.pipeline.times.messages == []


def packets(count, begin, pace=1.0):
    """Packets (bytes, arrival) of 20 samples.  pace: of the board's clock."""
    samples = samples_of(facets.readings(BENCH.sensor, yawing(count)))
    times = np.round(pace * samples.time).astype(np.int64) % WRAP
    samples = replace(samples, time=times.astype(np.uint32))
    true = begin + 1e-4 * np.arange(count)[19::20] * (1 + DRIFT)
    for n, arrival in enumerate(arrive(true, np.random.default_rng(7))):
        yield encode("frames", samples.where(slice(20 * n, 20 * n + 20))), arrival


@pytest.mark.parametrize("timing", ["envelope", "arrival"])
def test_a_stage_hears_how_late_data_are_and_that_the_clock_was_moved(timing):
    config = replace(BENCH, acquire=replace(BENCH.acquire, timing=timing))
    halts, ages = [], []

    def feed(samples, late, doubt):
        ages.append(arrival - (samples.times - late))

    stage = SimpleNamespace(
        halt=halts.append, begun=0.0, feed=feed, take_permit=lambda taken, is_permitted: None
    )
    loop = Loop(Live(Pipeline(config), tracker=stage), SimpleNamespace(port=None, is_stepped=False))
    for data, came in packets(66_000, 100.0):
        arrival = came + 0.3 * (came > 101.2)
        loop.take(Block(data, arrival, None))
        if len(loop.backlog) % 200 == 0:  # of some of them, the age is looked at
            loop.pass_on(loop.live.pipeline.skip(loop.backlog.batches[-1]), arrival)
    assert halts == [CLOCK_MOVED]
    ages = np.concatenate(ages)
    assert ages[:40].max() < 0.02
    assert ages[80:].min() > 0.29
