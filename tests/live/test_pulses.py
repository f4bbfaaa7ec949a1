"""Times by a pulse per second, against a board whose clock is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from commands import command
from facets.experiments import kills

import facets
from facets.live import (
    FRAME,
    MARK,
    SIZE,
    FixedFrames,
    Pipeline,
    Publications,
    PulseClock,
    Subscription,
    pack,
)

START = 1_800_000_000.3  # UTC of the board's zero


def board(count, rate=1_000.0, drift=50e-6, phase=0.4e-3):
    """Times of samples in UTC, the board's words for them, and which are first after an edge."""
    true = START + (phase + np.arange(count) / rate)
    device = np.round(1e6 * (true - START) / (1 + drift)).astype(np.int64)
    marked = np.concatenate([[False], np.diff(np.floor(true)) > 0])
    return true, device, marked


def followed(clock, device, marked, utc, lot=37):
    parts = [clock.follow(device[n : n + lot], marked[n : n + lot], utc[n : n + lot])
             for n in range(0, len(device), lot)]  # fmt: skip
    return tuple(np.concatenate(part) for part in zip(*parts, strict=True))


@pytest.mark.parametrize("drift", [0.0, 50e-6, -200e-6])
def test_times_are_those_of_the_pulses_whatever_the_host_says(drift):
    rng = np.random.default_rng(1)
    true, device, marked = board(90_000, drift=drift)
    clock = PulseClock()
    found, sigma = followed(clock, device, marked, true + 0.1 + 0.02 * rng.standard_normal(90_000))
    first = int(np.argmax(marked))
    assert np.isnan(found[:first]).all()
    error = (found - true)[first:]
    assert np.abs(error / sigma[first:]).max() < 2.1
    late = slice(10_000, None)
    assert np.abs(error[late]).max() < 0.6e-3  # a sample is 1 ms
    assert sigma[late][-1] == pytest.approx(1e-3 / 12**0.5, rel=0.2)
    assert clock.refused == 0
    assert clock.used == 90


def test_an_edge_beside_lost_samples_is_known_as_badly_as_it_is():
    true, device, marked = board(10_000)
    keep = np.ones(10_000, bool)
    edge = int(np.flatnonzero(marked)[5])
    keep[edge - 60 : edge] = False
    clock = PulseClock()
    found, sigma = followed(clock, device[keep], marked[keep], true[keep])
    after = np.flatnonzero(keep) >= edge
    assert sigma[after].min() > 15e-3
    assert np.nanmax(np.abs(found - true[keep]) / sigma) < 3


def test_marks_that_are_no_pulses_are_refused():
    true, device, marked = board(20_000)
    other = marked.copy()
    other[np.arange(300, 20_000, 1_370)] = True  # triggers of something else
    clock = PulseClock()
    found, sigma = followed(clock, device, other, true)
    first = int(np.argmax(marked))
    assert clock.refused == (other & ~marked).sum()
    assert np.abs((found - true) / sigma)[first:].max() < 2.1
    assert "at no whole second" in clock.sentence


def test_a_clock_that_stops_is_known_ever_worse():
    true, device, marked = board(30_000)
    marked[10_000:] = False
    _, sigma = followed(PulseClock(), device, marked, true)
    assert (np.diff(sigma[10_000:]) > 0).all()


def marked_stream(count, every):
    """Frames at 10 kHz of which every so many, from the fifth, are marked."""
    samples = FixedFrames().feed(kills.stream(count))
    flags = samples.flags.copy()
    flags[5::every] |= MARK
    return pack(replace(samples, flags=flags))


def test_published_and_replayed_times_follow_the_pulses(tmp_path):
    """10 kHz of file, a mark each second: two of them in 15,000 samples."""
    assert FRAME.itemsize == SIZE
    config = facets.load("bench")
    pps = replace(config, acquire=replace(config.acquire, mark="pps"))
    pipeline = Pipeline(pps)
    parts = [pipeline.solve(b) for b in pipeline.take(marked_stream(1_000, 10_000), 100.0)]
    assert sum((part.flags & 8 > 0).sum() for part in parts) == 1
    at = parts[0].host[5]
    offset = 1_800_000_000.0 - at + 0.01  # the host's clock is 10 ms late
    came = []
    with (
        Publications(["zmq://127.0.0.1:0"], pps, True, offset) as publications,
        Subscription(publications.places()[0]) as samples,
    ):
        for part in parts:
            publications.add_poses(part)
        for some in samples:
            came.append(some)
            if sum(map(len, came)) == 1_000:
                break
    rows = np.concatenate(came)
    assert rows["utc_s"][5] == pytest.approx(1_800_000_000.0 + 50e-6, abs=2e-6)
    assert rows["utc_s"][999] - rows["utc_s"][5] == pytest.approx(994e-4, abs=2e-6)
    assert rows["utc_s"][0] == pytest.approx(parts[0].host[0] + offset, abs=1e-6)
    assert any("1 pulses per second" in text for text in publications.sentences())


@pytest.mark.slow
def test_a_replayed_table_has_the_times(tmp_path):
    (tmp_path / "board.bin").write_bytes(marked_stream(300, 10_000))
    (tmp_path / "mine.yaml").write_text("extends: bench\nacquire: {mark: pps}\n")
    command("acquire", "mine.yaml", "--port", "file:board.bin", "-d", "rec", cwd=tmp_path)
    result = command("replay", "rec", "-o", "poses.csv", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "steer the times in UTC" in result.stdout
    assert "u_utc_us" in (tmp_path / "poses.csv").read_text()
