"""What limits a response is said, with its cause, and only then."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import signal

import facets
from facets.core import STATE_COLUMNS, STATE_UNITS, MeasuredObject, Mode, Vibration
from facets.detectors import SATURATED
from facets.responses import (
    OutputChannel,
    build_signals,
    estimate_response,
    find_limits,
    find_peaks,
    find_stretches,
)
from facets.simulation import shake

COUNT, RATE = 40_000, 1000.0
NOISE = np.array([6e-5, 6e-5, 4e-5, 1e-7, 1e-7, 2e-7])
SHAPES = np.array([[0, 0, 0.02, 0, 0, 0], [0.003, 0.001, 0, 2e-5, 4e-5, 1e-5]])
BODY = Vibration(
    {
        "bounce": Mode(60.0, 0.06, tuple(SHAPES[0])),
        "rock": Mode(130.0, 0.05, tuple(SHAPES[1])),
    },
    low=2.0,
    high=400.0,
    samples=COUNT,
    rate=RATE,
)


def look(change=None, resolution=0.5, saturated=0, misfits=0, body=BODY):
    """The response that `change` has spoilt, its peaks, and its limits."""
    rng = np.random.default_rng(2)
    force, moved = shake(body, rng)
    moved = moved + NOISE * rng.standard_normal((COUNT, 6))
    if change is not None:
        change(force, moved)
    every = np.ones(COUNT, bool)
    stretches = find_stretches(np.arange(COUNT) / RATE, every, "it")
    found = estimate_response(force, moved, stretches, resolution, OutputChannel(NOISE, 5000.0))
    signals = SimpleNamespace(
        stimulus=force, motion=moved, usable=every, stretches=stretches, saturated=saturated,
        misfits=misfits,
    )  # fmt: skip
    peaks = find_peaks(found)
    return found, peaks, find_limits(found, signals, peaks, 5000.0)


def test_a_good_record_has_no_limits_but_the_band_and_the_bandwidth():
    peaks, limits = look(misfits=8)[1:]  # twice as many as by chance
    assert [one.frequency for one in peaks] == pytest.approx([60, 130], abs=2)
    assert [one.axis for one in peaks] == ["tz", "pitch"]
    assert peaks[0].width == pytest.approx(2 * 0.06 * 60, rel=0.15)
    assert peaks[0].size == pytest.approx(0.02 / 0.12, rel=0.1)
    assert [text.split(" ")[1] for text in limits] == ["input", "electronics'"]
    assert "from 401.5" in limits[0]
    assert "-0.32 % and the phase by -4.6 degrees" in limits[1]


def drift(force, motion):
    motion[:, 0] += np.linspace(0, 0.1, COUNT)


def slip(force, motion):
    motion[COUNT // 3 :, 4] -= 1e-3


def clip(force, motion):
    np.minimum(force, 0.8 * force.std(), out=force)


def add_force(force, motion):
    motion[:, 2] += 2 * shake(BODY, np.random.default_rng(9))[1][:, 2]


def silence(force, motion):
    motion[:, 5] = NOISE[5] * np.random.default_rng(3).standard_normal(COUNT)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (drift, "zero moved from the beginning to the end, tx by 90 µm."),
        (slip, "zero moved from the beginning to the end, pitch by -1,000 µrad."),
        (clip, "clipped by its amplifier or converter"),
        (add_force, "The coherence of tz is below 0.75 in 100 % of the excited lines; the cause is"
                    " unknown (another force"),
        (silence, "No response beyond chance: yaw. What is drawn is an upper limit; the motion "
                  "there is the sensor's noise."),
    ],
)  # fmt: skip
@pytest.mark.slow
def test_what_spoils_a_record_is_said(change, words):
    *_, limits = look(change)
    assert any(words in text for text in limits)
    assert len(limits) <= (9 if change is clip else 4)


@pytest.mark.slow
def test_slow_sweeps_narrow_peaks_few_averages_and_doubtful_rows_are_said():
    *_, limits = look(body=replace(BODY, drive="sweep"))
    assert any(
        "only 1 of the 39 segments have input: the input passes through" in text for text in limits
    )
    sharp = replace(BODY, modes={"bounce": Mode(60.0, 0.004, tuple(SHAPES.sum(axis=0)))})
    _, (peak,), limits = look(body=sharp)
    assert peak.width < 2
    assert any("The lines are too far apart for the peaks at 60 Hz (" in text for text in limits)
    said = " ".join(look(resolution=0.1, saturated=4, misfits=400)[-1])
    assert said.startswith("There are only 6.")
    assert "Detectors were saturated in 4 of 40000 rows" in said
    assert "In 400 of 40000 rows the residual" in said


def test_a_stepped_sine_has_its_peaks_no_random_error_and_is_not_clipped():
    """Steps of one second, each of whole periods whose largest samples are all the same number."""
    rows = np.arange(COUNT)
    frequency = 50.0 + rows // 1000

    def drive(force, motion):
        force[:] = np.sin(2 * np.pi * np.round(frequency * rows) / RATE)
        motion[:] = NOISE * np.random.default_rng(4).standard_normal((COUNT, 6))
        motion[:, 2] += signal.lfilter(*signal.iirpeak(62, 40, fs=RATE), force)

    response, peaks, limits = look(drive)
    assert [peak.frequency for peak in peaks] == pytest.approx([62], abs=1)
    assert np.isnan(response.uncertainty).all()
    said = " ".join(limits)
    assert "Random errors are therefore not stated" in said
    assert "clipped" not in said


def test_the_noise_of_the_signals_is_that_at_the_point():
    config, rows = facets.load("bench"), np.arange(4000)
    state = np.array([0.02, -0.01, 0.3, 1e-3, -2e-3, 3e-3, 0.0, 0.0])
    columns = dict(zip(STATE_COLUMNS, np.outer(state / STATE_UNITS, np.ones(4000)), strict=True))
    columns["tz_mm"][7] = np.nan
    columns |= {"time_s": rows / 1000, "force_n": rows}
    columns |= {"misfit": rows < 5, "flags": np.where(rows < 3, SATURATED, 0)}
    body = MeasuredObject(point=(0.0, 0.0, 40.0))
    signals = build_signals(columns, ["force_n"], replace(config, object=body), "it")
    known = config.solve.knowledge(config.sensor)
    expected = facets.uncertainties(config.sensor, state, known, body)
    assert signals.deviation == pytest.approx(expected, rel=1e-3)  # turned by some mrad
    assert (signals.saturated, signals.misfits, int((~signals.usable).sum())) == (3, 5, 1)
