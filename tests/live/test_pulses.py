"""Times by a pulse per second, against a board whose clock is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from facets.experiments.studies import kills
from streams import subscribe

import facets
from facets.live import (
    MARK,
    FixedFrames,
    Pipeline,
    Publications,
    PulseClock,
    pack,
)

START = 1_800_000_000.3  # UTC of the board's zero


def board(count, drift=50e-6):
    """Times of samples at 1 kHz in UTC, on the board, and which are first after an edge."""
    true = START + (0.4e-3 + np.arange(count) / 1_000)
    device = np.round(1e6 * (true - START) / (1 + drift)).astype(np.int64)
    marked = np.concatenate([[False], np.diff(np.floor(true)) > 0])
    return true, device, marked


def follow(clock, device, marked, utc, lot=37):
    parts = [clock.follow(device[n : n + lot], marked[n : n + lot], utc[n : n + lot])
             for n in range(0, len(device), lot)]  # fmt: skip
    return tuple(np.concatenate(part) for part in zip(*parts, strict=True))


@pytest.mark.parametrize("drift", [50e-6, -200e-6])
def test_times_are_those_of_the_pulses_whatever_the_host_says(drift):
    """And known ever worse once no pulse comes."""
    rng, clock = np.random.default_rng(1), PulseClock()
    true, device, marked = board(90_000, drift)
    marked[80_500:] = False
    times, sigma = follow(clock, device, marked, true + 0.1 + 0.02 * rng.standard_normal(90_000))
    first = int(np.argmax(marked))
    assert np.isnan(times[:first]).all()
    error = (times - true)[first:]
    assert np.abs(error / sigma[first:]).max() < 2.1
    assert np.abs(error[10_000:80_000]).max() < 0.6e-3  # a sample is 1 ms
    assert sigma[80_000] == pytest.approx(1e-3 / 12**0.5, rel=0.2)
    assert (np.diff(sigma[80_500:]) > 0).all()
    assert (clock.refused, clock.used) == (0, marked.sum())


def test_a_clock_that_is_far_off_is_steered_too():
    """By 0.5 %: the marks stay at whole seconds, by the host's clock."""
    clock = PulseClock()
    true, device, marked = board(20_000, 5e-3)
    times, sigma = follow(clock, device, marked, true + 0.01)
    assert (clock.refused, clock.used) == (0, marked.sum())
    assert np.nanmax(np.abs(times - true) / sigma) < 3


def test_an_edge_beside_lost_samples_and_marks_that_are_no_pulses():
    """The one is known as badly as it is, the others are refused."""
    true, device, marked = board(20_000)
    edge = int(np.flatnonzero(marked)[5])
    kept = np.delete(np.arange(10_000), np.arange(edge - 60, edge))
    times, sigma = follow(PulseClock(), device[kept], marked[kept], true[kept])
    assert sigma[kept >= edge].min() > 15e-3
    assert np.nanmax(np.abs(times - true[kept]) / sigma) < 3
    others, clock = marked.copy(), PulseClock()
    others[300::1_370] = True  # triggers of something else
    times, sigma = follow(clock, device, others, true)
    assert clock.refused == (others & ~marked).sum()
    assert np.nanmax(np.abs(times - true) / sigma) < 2.1
    assert "at no whole second" in clock.sentence


@pytest.fixture(scope="module")
def marked_stream():
    """1,000 samples at 10 kHz, the sixth of which is the first after an edge."""
    samples = FixedFrames().feed(kills.stream(1_000))
    flags = samples.flags.copy()
    flags[5] |= MARK
    return pack(replace(samples, flags=flags))


def test_published_times_follow_the_pulses(marked_stream):
    bench = facets.load("bench")
    config = replace(bench, acquire=replace(bench.acquire, mark="pps"))
    poses = Pipeline(config).feed(marked_stream, 100.0)
    offset = 1_800_000_000.0 - poses.host[5] + 0.01  # the host's clock is 10 ms late
    with Publications(["zmq://127.0.0.1:0"], config, True, offset) as publications:
        (subscription,) = subscribe(publications)
        with subscription:
            publications.add_poses(poses)
            utc = next(iter(subscription))["utc_s"]
    assert utc[5] == pytest.approx(1_800_000_000.0 + 50e-6, abs=2e-6)
    assert utc[-1] - utc[5] == pytest.approx(1e-4 * (len(utc) - 6), abs=2e-6)
    assert utc[0] == pytest.approx(poses.host[0] + offset, abs=1e-6)


def test_a_replayed_table_has_the_times(run_in_process, tmp_path, marked_stream):
    (tmp_path / "board.bin").write_bytes(marked_stream)
    (tmp_path / "mine.yaml").write_text("extends: bench\nacquire: {mark: pps}\n")
    run_in_process("acquire", "mine.yaml", "--port", "file:board.bin", "-d", "rec", "--plain")
    status, output, errors = run_in_process("replay", "rec", "-o", "poses.csv")
    assert status == 0, errors
    assert "steer the times in UTC" in output
    assert "u_utc_us" in (tmp_path / "poses.csv").read_text()
