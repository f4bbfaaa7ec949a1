"""Samples of a virtual detector board, and rows of a page, made without a port or a clock."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
from programs import await_true

import facets
from facets.detectors import readings_to_counts
from facets.live import ELECTRODES, SAMPLE, RawSamples, Subscription

BENCH = facets.load("bench")
CALIBRATION = facets.Calibration(("psd_a.height",), ((1e-6,),))
#: The bench with a calibrated sensor, whose uncertainties have parts.
CALIBRATED = replace(BENCH, sensor=replace(BENCH.sensor, calibration=CALIBRATION))


class Clock:
    """A clock that stands until a test moves it."""

    now = 1_000.0

    def __call__(self):
        return self.now


def samples_of(readings, rng=None, channels=None, electronics=BENCH.electronics):
    """Samples at 10 kHz of readings (n, 9), with noise if a generator is given.

    channels: numbers (n, m) of the auxiliary channels.
    """
    counts = readings_to_counts(BENCH.sensor, electronics, readings, rng)
    number = np.arange(len(counts), dtype=np.uint32)
    kind = np.full(len(counts), ELECTRODES, np.uint8)
    values = np.zeros((len(counts), 0)) if channels is None else channels
    return RawSamples(kind, 0 * kind, number, 100 * number, counts, values.astype(np.float32))


def yawing(count, samples_per_radian=100):
    """States (count, 8) of a mirror that yaws by 1 mrad."""
    states = np.zeros((count, 8))
    states[:, 5] = 1e-3 * np.sin(np.arange(count) / samples_per_radian)
    return states


def page_rows(count, first=0, rate_hz=1_000.0):
    """Rows (count,) of samples with light and with poses that tell the sample's number."""
    rows = np.zeros(count, SAMPLE)
    for name in SAMPLE.names[6:]:
        rows[name] = 0.1 if name.startswith("power") else 0.001
    rows["seq"] = first + np.arange(count)
    rows["host_s"] = 1_000.0 + rows["seq"] / rate_hz
    rows["utc_s"] = 1.7e9 + rows["seq"] / rate_hz
    rows["tx_mm"] = rows["seq"] * 1e-3
    return rows


def subscribe(publications, count=1):
    """Subscriptions of publications by ZeroMQ, which hear meanwhile who comes, as a run's loop has
    it done when it comes round."""
    outlet = publications.outlet
    (address,) = outlet.places
    wanted = outlet.receivers + count
    with ThreadPoolExecutor(count) as pool:
        opening = [pool.submit(Subscription, address) for _ in range(count)]
        await_true(lambda: outlet.hear() or outlet.receivers == wanted, "the subscribers")
    return [one.result() for one in opening]
