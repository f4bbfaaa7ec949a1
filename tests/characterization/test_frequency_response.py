"""Responses of known systems, and their random errors."""

import numpy as np
import pytest

from facets import InputError
from facets.characterization import (
    count_averages,
    estimate_response,
    find_stretches,
    low_pass,
    noise_spectrum,
    response_table,
    segment_starts,
)
from facets.core import Mode, Vibration
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


def even(count, usable=None):
    every = np.ones(count, bool) if usable is None else usable
    return find_stretches(np.arange(count) / RATE, every, "it")


@pytest.fixture(scope="module")
def shaken():
    rng = np.random.default_rng(3)
    force, moved = shake(BODY, rng)
    return force, moved[:, AXES] + NOISE * rng.standard_normal((BODY.samples, 3))


def test_the_receptance_lies_within_its_random_error_in_95_percent_of_the_lines(shaken):
    found = estimate_response(*shaken, even(BODY.samples), 0.5, NOISE)
    true = receptance(BODY, found.frequency)[:, AXES]
    lines = found.is_excited & (found.coherence.min(axis=1) > 0.05)
    apart = np.abs(np.abs(found.h1) - np.abs(true)) / found.uncertainty
    share = (apart[lines] < found.coverage_factor).mean()
    assert lines.sum() > 500
    assert 0.93 < share < 0.97
    phase = np.angle(found.h1 / true) / found.random_error
    clear = lines[:, None] & (found.random_error < 0.2)
    assert 0.93 < (np.abs(phase[clear]) < found.coverage_factor).mean() < 0.97


def test_a_periodic_input_is_averaged_over_its_periods_at_its_lines():
    """Without leakage, however narrow a peak is between the lines."""
    from scipy import signal

    rng = np.random.default_rng(9)
    lines, held, total = np.arange(4, 400, 3), 0, 0
    b, a, _ = signal.cont2discrete(([1.0], [1 / 500**2, 2 * 0.01 / 500, 1]), 1 / RATE, "zoh")
    true = np.abs(signal.freqz(b.ravel(), a, lines, fs=RATE)[1])
    for _ in range(20):
        phases = rng.uniform(0, 2 * np.pi, len(lines))
        one = np.cos(np.outer(np.arange(1000) / RATE, 2 * np.pi * lines) + phases).sum(axis=1)
        force = np.tile(one, 16)
        moved = signal.lfilter(b.ravel(), a, force) + 0.05 * rng.standard_normal(len(force))
        found = estimate_response(force[4000:], moved[4000:, None], even(12_000))
        assert found.period == 1.0
        np.testing.assert_allclose(found.frequency, lines)
        apart = np.abs(np.abs(found.h1[:, 0]) - true) / found.uncertainty[:, 0]
        held, total = held + (apart < found.coverage_factor).sum(), total + len(lines)
    assert 0.935 < held / total < 0.965


def test_noise_of_the_output_leaves_h1_and_raises_h2(shaken):
    found = estimate_response(*shaken, even(BODY.samples), 2.0, NOISE)
    true = receptance(BODY, found.frequency)[:, AXES]
    lines = found.is_excited & (np.abs(found.frequency - 300) < 90)
    ratio = (found.h1 / true)[lines].mean(axis=0)
    assert np.abs(ratio - 1).max() < 0.05
    assert found.h2 * found.coherence == pytest.approx(found.h1)
    noisy = found.noise_density / found.output_density
    assert found.coherence[lines].mean() == pytest.approx(1 - noisy[lines].mean(), abs=0.02)


def test_noise_of_the_input_lowers_h1_by_its_share(shaken):
    force, moved = shaken
    rng = np.random.default_rng(5)
    spoilt = force + 0.5 * rng.standard_normal(len(force))
    found = estimate_response(spoilt, moved, even(len(force)), 2.0)
    true = receptance(BODY, found.frequency)[:, AXES]
    lines = (found.frequency > 20) & (found.frequency < 60)
    expected = 1 / (1 + 2 * 0.5**2 / RATE * (0.4 * RATE - 2.0))
    ratio = (found.h1[:, 1:] / true[:, 1:])[lines].mean()
    assert ratio.real == pytest.approx(expected, rel=0.02)


def test_the_noise_floor_is_what_noise_alone_gives(shaken):
    rng = np.random.default_rng(8)
    noise = NOISE * rng.standard_normal((BODY.samples, 3))
    found = estimate_response(shaken[0], noise, even(BODY.samples), 0.5, NOISE)
    lines = found.is_excited
    ratio = np.abs(found.h1[lines]) / found.noise_floor[lines]
    assert np.sqrt((ratio**2).mean(axis=0)) == pytest.approx([1, 1, 1], rel=0.05)
    assert (found.coherence[lines] > found.significant_coherence).mean() < 0.004


def test_segments_across_a_gap_are_left_out(shaken):
    """The rest is averaged as from separate records."""
    from scipy import signal

    force, moved = shaken
    count, length = 20_000, 1000
    usable = np.arange(count) != 7300  # a row without a pose
    row = np.arange(count)
    kept = (row < 12_000) | (row >= 12_400)  # lost samples
    x, y = force[:count][kept], moved[:count, 1][kept]
    stretches = find_stretches(row[kept] / RATE, usable[kept], "it")
    assert stretches.starts.tolist() == [0, 7301, 12_000]
    assert stretches.stops.tolist() == [7300, 12_000, 19_600]
    assert (stretches.span, stretches.unsolved) == (count, 1)
    found = estimate_response(x, y[:, None], stretches, RATE / length)
    cross = own = segments = 0
    for start, stop in zip(stretches.starts, stretches.stops, strict=True):
        options = {"nperseg": length, "detrend": "linear", "window": "hann"}
        weight = (stop - start - length) // (length // 2) + 1
        cross += weight * signal.csd(x[start:stop], y[start:stop], RATE, **options)[1]
        own += weight * signal.welch(x[start:stop], RATE, **options)[1]
        segments += weight
    assert found.h1[:, 0] == pytest.approx((cross / own)[2:], rel=1e-9)
    assert (found.segments, found.left_out) == (segments, 39 - segments)


def test_overlapping_segments_count_as_independent_ones_of_the_same_variance():
    from scipy import signal

    rng = np.random.default_rng(4)
    length, count = 64, 64 * 12
    window = signal.get_window("hann", length)
    starts = segment_starts(even(count), length)
    noise = rng.standard_normal((3000, count))
    power = signal.welch(noise, window="hann", nperseg=length, detrend=False)[1][:, 10]
    independent = (power.mean() / power.std()) ** 2
    assert count_averages(starts, window) == pytest.approx(independent, rel=0.06)


def test_noise_behind_a_low_pass_keeps_its_variance():
    """Noise sampled behind a low pass is an autoregressive process of the first order."""
    frequency = np.linspace(0, RATE / 2, 2001)
    found = noise_spectrum(frequency, np.array([2.0]), RATE, 60.0)[:, 0]
    assert np.trapezoid(found, frequency) == pytest.approx(4.0, rel=1e-3)
    memory = np.exp(-2 * np.pi * 60.0 / RATE)
    turns = np.exp(-2j * np.pi * frequency / RATE)
    expected = 2 * 4.0 * (1 - memory**2) / RATE / np.abs(1 - memory * turns) ** 2
    assert found[:-1] == pytest.approx(expected[:-1], rel=0.01)


def test_the_low_pass_and_a_late_input_are_corrected(shaken):
    force, _ = shaken
    frequency = np.fft.rfftfreq(len(force), 1 / RATE)
    delay, bandwidth = 0.4e-3, 150.0

    def filtered(factors):
        return np.fft.irfft(np.fft.rfft(force) * factors, len(force))

    late = filtered(np.exp(2j * np.pi * frequency * delay))  # sampled later than the motion
    slow = filtered(low_pass(frequency, bandwidth))
    given = late, slow[:, None], even(len(force)), 2.0, np.array([1e-3]), bandwidth
    plain, right = estimate_response(*given), estimate_response(*given, True, delay)
    lines = plain.is_excited
    assert right.h1[lines, 0] == pytest.approx(np.ones(lines.sum()), abs=0.03)
    assert np.abs(plain.h1[lines, 0]).min() < 0.5
    gain = np.abs(low_pass(plain.frequency, bandwidth))[lines, None]
    assert right.noise_floor[lines] == pytest.approx(plain.noise_floor[lines] / gain)
    shares = [one.output_density[lines] / one.noise_density[lines] for one in (plain, right)]
    assert shares[1] == pytest.approx(shares[0])  # the correction changes both alike


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t, u: (np.where(t == 0.5, 0.2, t), u), "the time does not ascend after row 500"),
        (lambda t, u: (t**2 + t, u), "not evenly spaced in time"),
        (lambda t, u: (t, u & (t < 0.05)), "has 50 rows with a pose and an input, too few"),
    ],
)
def test_times_that_have_no_spectrum_are_refused(change, words):
    time = np.arange(1000) / RATE
    with pytest.raises(InputError, match=words):
        find_stretches(*change(time, np.ones(1000, bool)), "it.csv")


def test_what_cannot_be_estimated_is_refused(shaken):
    force, moved = shaken
    stretches = even(len(force))
    for resolution, words in (
        (0.02, "Record for longer, or give a larger --resolution-hz"),
        (1e-6, "Record for longer, or give a larger --resolution-hz"),  # without the memory for it
        (100.0, "allowed: up to 15.62 Hz at 1000 samples per second"),
    ):
        with pytest.raises(InputError, match=words):
            estimate_response(force, moved, stretches, resolution)
    with pytest.raises(InputError, match="the input does not change"):
        estimate_response(np.ones(len(force)), moved, stretches)


def test_the_table_has_a_row_for_each_line(shaken):
    force, moved = shaken
    found = estimate_response(force, np.repeat(moved[:, :1], 6, axis=1), even(len(force)))
    table = response_table(found)
    assert 28 < found.averages < 36
    assert {len(column) for column in table.values()} == {len(found.frequency)}
    assert table["h1_tx_real_um"] == pytest.approx(1e3 * found.h1[:, 0].real)
    assert table["u_h1_yaw_urad"] == pytest.approx(1e6 * found.uncertainty[:, 5])
