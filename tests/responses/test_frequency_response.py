"""Responses of known systems, and their random errors."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy import signal

import facets
from facets import InputError
from facets.core import STATE_COLUMNS, AuxiliaryChannel, Mode, Vibration
from facets.responses import (
    OutputChannel,
    estimate_response,
    find_stretches,
    low_pass,
    noise_spectrum,
)
from facets.simulation import receptance, shake

RATE = 1000.0
BODY = Vibration(
    {
        "bounce": Mode(80.0, 0.03, (0.0, 0.0, 0.02, 0.0, 1e-5, 0.0)),
        "rock": Mode(150.0, 0.02, (0.01, 0.0, 0.0, 0.0, 4e-5, 0.0)),
    },
    low=2.0,
    samples=60_000,
    rate=RATE,
)
AXES = [0, 2, 4]
NOISE = np.array([0.004, 0.004, 4e-6])


def even(count):
    return find_stretches(np.arange(count) / RATE, np.ones(count, bool), "it")


@pytest.fixture(scope="module")
def shaken():
    rng = np.random.default_rng(3)
    force, moved = shake(BODY, rng)
    return force, moved[:, AXES] + NOISE * rng.standard_normal((BODY.samples, 3))


def test_the_receptance_lies_within_its_random_error_in_95_percent_of_the_lines(shaken):
    found = estimate_response(*shaken, even(BODY.samples), 0.5, OutputChannel(NOISE))
    true = receptance(BODY, found.frequency)[:, AXES]
    lines = found.is_excited & (found.coherence.min(axis=1) > 0.05)
    apart = np.abs(np.abs(found.h1) - np.abs(true)) / found.uncertainty
    assert lines.sum() > 500
    assert 0.93 < (apart[lines] < found.coverage_factor).mean() < 0.97
    phase = np.angle(found.h1 / true) / found.random_error
    clear = lines[:, None] & (found.random_error < 0.2)
    assert 0.93 < (np.abs(phase[clear]) < found.coverage_factor).mean() < 0.97
    assert found.h2 * found.coherence == pytest.approx(found.h1)


def test_a_periodic_input_is_averaged_over_its_periods_at_its_lines():
    """Without leakage, however narrow a peak is between the lines."""
    rng, lines, way = np.random.default_rng(9), np.arange(4, 400, 3), signal.iirpeak(80, 50, RATE)
    true = np.abs(signal.freqz(*way, lines, fs=RATE)[1])
    waves = np.outer(np.arange(16_000) / RATE, 2 * np.pi * lines)
    force = np.cos(waves + rng.uniform(0, 2 * np.pi, len(lines))).sum(axis=1)
    moved = signal.lfilter(*way, force)[:, None] + 0.05 * rng.standard_normal((16_000, 20))
    found = estimate_response(force[4000:], moved[4000:], even(12_000))
    assert found.period == 1.0
    np.testing.assert_allclose(found.frequency, lines)
    apart = np.abs(np.abs(found.h1) - true[:, None]) / found.uncertainty
    assert 0.935 < (apart < found.coverage_factor).mean() < 0.965


def test_responses_and_coherences_of_two_inputs_are_those_of_the_matrix_of_spectra():
    """Of two forces with a common part: the whole matrix is that of Welch's method of SciPy."""
    rng, length = np.random.default_rng(5), 500
    forces = rng.standard_normal((20_000, 2))
    forces[:, 1] += 0.7 * signal.lfilter([1], [1, -0.5], forces[:, 0])
    moved = 0.3 * rng.standard_normal((20_000, 1))
    for frequency, force in zip((90, 210), forces.T, strict=True):
        moved[:, 0] += signal.lfilter(*signal.iirpeak(frequency, 3, RATE), force)
    every = np.hstack([forces, moved]).T
    matrix = signal.csd(every[:, None], every, RATE, "hann", length, detrend="linear")[1].T[2:]
    matrix = matrix.swapaxes(1, 2)
    inputs = matrix[:, :2, :2]
    inverse, h1 = np.linalg.inv(matrix), np.linalg.solve(inputs, matrix[:, :2, 2:])[:, :, 0]
    partial = np.abs(inverse[:, :2, 2]) ** 2
    partial /= (inverse[:, [0, 1], [0, 1]] * inverse[:, 2, 2, None]).real
    multiple = 1 - (np.linalg.det(matrix) / np.linalg.det(inputs) / matrix[:, 2, 2]).real
    for n in (0, 1):
        given = forces[:, n], moved, even(len(moved)), RATE / length, OutputChannel()
        found, alone = (estimate_response(*given, others) for others in (forces[:, [1 - n]], None))
        assert found.h1[:, 0] == pytest.approx(h1[:, n], rel=1e-9)
        assert found.coherence[:, 0] == pytest.approx(partial[:, n], rel=1e-9)
        assert found.multiple_coherence[:, 0] == pytest.approx(multiple, rel=1e-9)
        assert found.freedom == pytest.approx(alone.freedom - 2)


def test_the_noise_floor_is_what_noise_alone_gives(shaken):
    noise = NOISE * np.random.default_rng(8).standard_normal((BODY.samples, 3))
    found = estimate_response(shaken[0], noise, even(BODY.samples), 0.5, OutputChannel(NOISE))
    lines = found.is_excited
    ratio = np.abs(found.h1[lines]) / found.noise_floor[lines]
    assert np.sqrt((ratio**2).mean(axis=0)) == pytest.approx([1, 1, 1], rel=0.05)
    assert (found.coherence[lines] > found.significant_coherence).mean() < 0.004
    density = found.output_density[lines] / found.noise_density[lines]
    assert density.mean(axis=0) == pytest.approx([1, 1, 1], rel=0.05)


def test_segments_across_a_gap_are_left_out(shaken):
    """The rest is averaged as from separate records."""
    count, length, row = 20_000, 1000, np.arange(20_000)
    kept = (row < 12_000) | (row >= 12_400)  # lost samples
    x, y = shaken[0][:count][kept], shaken[1][:count, 1][kept]
    stretches = find_stretches(row[kept] / RATE, row[kept] != 7300, "it")  # a row without a pose
    assert stretches.starts.tolist() == [0, 7301, 12_000]
    assert stretches.stops.tolist() == [7300, 12_000, 19_600]
    assert (stretches.span, stretches.unsolved) == (count, 1)
    found = estimate_response(x, y[:, None], stretches, RATE / length)
    pieces = np.array(
        [
            [x[first : first + length], y[first : first + length]]
            for start, stop in zip(stretches.starts, stretches.stops, strict=True)
            for first in range(start, stop - length + 1, length // 2)
        ]
    )
    spectra = signal.csd(pieces[:, :1], pieces, nperseg=length, detrend="linear")[1]
    power, cross = spectra.sum(axis=0)[:, 2:]
    lines = found.is_excited
    assert found.h1[lines, 0] == pytest.approx((cross / power)[lines], rel=1e-9)
    assert (found.segments, found.left_out) == (len(pieces), 39 - len(pieces))


def test_noise_behind_a_low_pass_keeps_its_variance():
    """Noise sampled behind a low pass is an autoregressive process of the first order."""
    frequency = np.linspace(0, RATE / 2, 2001)
    found = noise_spectrum(frequency, np.array([2.0]), RATE, 60.0)[:, 0]
    memory = np.exp(-2 * np.pi * 60.0 / RATE)
    turns = np.exp(-2j * np.pi * frequency / RATE)
    expected = 2 * 4.0 * (1 - memory**2) / RATE / np.abs(1 - memory * turns) ** 2
    assert found[:-1] == pytest.approx(expected[:-1], rel=0.01)


def test_the_low_pass_and_a_late_input_are_corrected(shaken):
    force, _ = shaken
    frequency = np.fft.rfftfreq(len(force), 1 / RATE)
    delay, bandwidth = 0.4e-3, 150.0
    ways = np.exp(2j * np.pi * frequency * delay), low_pass(frequency, bandwidth)
    late, slow = np.fft.irfft(np.fft.rfft(force) * ways, len(force))  # sampled after the motion
    given = late, slow[:, None], even(len(force)), 2.0
    channel = OutputChannel(np.array([1e-3]), bandwidth)
    plain = estimate_response(*given, channel)
    right = estimate_response(*given, channel._replace(is_corrected=True, delay=delay))
    lines = plain.is_excited
    assert right.h1[lines, 0] == pytest.approx(np.ones(lines.sum()), abs=0.03)
    assert np.abs(plain.h1[lines, 0]).min() < 0.5
    gain = np.abs(low_pass(plain.frequency, bandwidth))[:, None]
    for density in (right.noise_floor * gain / plain.noise_floor,
                    right.noise_density * gain**2 / plain.noise_density,
                    right.output_density * gain**2 / plain.output_density):  # fmt: skip
        assert density[lines] == pytest.approx(1)


def test_times_that_have_no_spectrum_are_refused():
    time = np.arange(1000) / RATE
    for times, usable, words in (
        (np.where(time == 0.5, 0.2, time), time >= 0, "the time does not ascend after row 500"),
        (time**2 + time, time >= 0, "not evenly spaced in time"),
        (time, time < 0.05, "has 50 rows with a pose and an input, too few"),
    ):
        with pytest.raises(InputError, match=words):
            find_stretches(times, usable, "it.csv")


def test_what_cannot_be_estimated_is_refused(shaken):
    force, moved = shaken
    rows, other = np.arange(len(force)), np.random.default_rng(2).standard_normal((len(force), 1))
    cut = find_stretches(rows / RATE, rows % 2 > 0, "it.csv")
    for words, given in {
        "Record for longer, or give a larger --resolution-hz": [
            {"resolution": 0.02}, {"resolution": 1e-6},  # the latter without the memory for it
        ],
        "allowed: above 0": [{"resolution": value} for value in (0.0, -5.0, np.nan)],
        "gaps cut the rows into parts of 0 samples at most": [{"stretches": cut}],
        "the input does not change": [{"stimulus": np.ones(len(force))}],
        "cannot be distinguished": [
            {"others": force[:, None] + 1e-3 * other}, {"others": np.hstack([other, 2 * other])},
        ],
    }.items():  # fmt: skip
        for changes in given:
            whole = {"stimulus": force, "outputs": moved, "stretches": even(len(force)), **changes}
            with pytest.raises(InputError, match=words):
                estimate_response(**whole)


def test_a_data_frame_s_input_has_the_delay_of_its_channel():
    """As the command corrects it: by 2 pi f times the delay in the phase."""
    force = np.random.default_rng(1).standard_normal(4000)
    poses = pd.DataFrame(dict.fromkeys(STATE_COLUMNS[:6], 2e-3 * force))
    poses = poses.assign(time_s=1e-3 * poses.index, force_n=force)
    config = facets.load("paper")
    channel = AuxiliaryChannel(name="force", unit="N", delay=1e-3)
    late = replace(config, acquire=replace(config.acquire, channels=(channel,)))
    plain, moved = (
        facets.measure_response(given, poses, "force_n", 10) for given in (config, late)
    )
    turn = np.angle(moved.h1[:, 2] / plain.h1[:, 2] * np.exp(-2j * np.pi * plain.frequency * 1e-3))
    assert turn == pytest.approx(0, abs=1e-9)
