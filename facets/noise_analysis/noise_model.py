"""Model the noise of a steady signal: white and flicker noise, lines and drift, with intervals.

Between lines, the one-sided power spectral density is modelled as S(f) = white + flicker / f. It
is fitted to the periodogram by Whittle's likelihood, in which the periodogram's values are
independent and exponentially distributed with the mean S. The lines' amplitudes and the drift's
slope are least-squares estimates; their variances follow from S.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..core.units import Floats

#: Half width of a 95 % interval, in standard deviations.
SIGMAS_OF_95_PERCENT = 1.959964
#: Largest number of bands of the fit, evenly spaced in the logarithm of the frequency.
BANDS = 400
#: Number of lowest frequencies that the fit skips, because the removal of the drift changes them.
SKIPPED_FREQUENCIES = 2
#: Largest probability that noise at any of the frequencies is taken for a line.
CHANCE = 1e-4
#: Frequencies of the mains, and the largest relative difference of a line from one of them.
MAINS_HZ, MAINS_TOLERANCE = (50.0, 60.0), 0.005
#: Largest number of lines.
MAX_LINES = 20
#: Number of sums that replace a signal while a line's frequency is refined. At a distance of one
#: frequency of the periodogram, they reduce an amplitude by 10^-6 of itself.
PEAK_SUMS = 2048
#: Least number of samples for an estimate.
MIN_SAMPLES = 64


@dataclass(frozen=True)
class Estimate:
    """A number and its standard uncertainty."""

    value: float
    sigma: float

    @property
    def interval(self) -> tuple[float, float]:
        """The interval of 95 %."""
        half = SIGMAS_OF_95_PERCENT * self.sigma
        return self.value - half, self.value + half


@dataclass(frozen=True)
class SpectralLine:
    """A sinusoid.  frequency: Hz.  amplitude: in the signal's unit.  name: the probable cause."""

    frequency: float
    amplitude: Estimate
    name: str


@dataclass(frozen=True)
class NoiseModel:
    """The noise of one signal in a unit u.

    rate: of sampling, Hz.  length: s.  mean: u.  white: density, u^2/Hz.  flicker: density at 1 Hz
    times 1 Hz, u^2.  drift: slope, u/s.  spikes: number of samples beyond noise.  filled: fraction
    of missing samples, which were interpolated.
    """

    rate: float
    length: float
    mean: float
    white: Estimate
    flicker: Estimate
    lines: tuple[SpectralLine, ...]
    drift: Estimate
    spikes: int
    filled: float

    def density(self, frequency: Floats) -> Floats:
        """The density without the lines, u^2/Hz, at frequencies in Hz."""
        return density(frequency, self.white, self.flicker)

    @property
    def standard_deviation(self) -> float:
        """Standard deviation, u, of a sample from the recording's mean, without the drift."""
        low, high = 1 / self.length, self.rate / 2
        steady = self.white.value * (high - low) + self.flicker.value * np.log(high / low)
        return float(np.sqrt(steady + sum(line.amplitude.value**2 / 2 for line in self.lines)))

    @property
    def white_deviation(self) -> float:
        """Standard deviation of a sample, u, that the white noise alone causes."""
        return float(np.sqrt(max(self.white.value, 0.0) * self.rate / 2))


def fit_noise(signal: Floats, rate: float) -> NoiseModel:
    """Fit the noise of a signal (n,), evenly spaced, with NaN for missing samples.

    rate: of sampling, Hz. Raises `ValueError` if fewer than MIN_SAMPLES samples are finite.
    """
    is_present = np.isfinite(signal)
    if is_present.sum() < MIN_SAMPLES:
        raise ValueError(f"{int(is_present.sum())} samples are too few to estimate their noise")
    filled = fill(signal)
    is_spike = find_spikes(filled)
    clean = fill(np.where(is_spike, np.nan, filled))
    time = np.arange(len(clean)) / rate
    lines: list[float] = []
    coefficients, rest = fit_lines(clean, time, lines)
    for _ in range(3):  # Lines bias the estimated noise, and noise hides weak lines.
        frequency, power = periodogram(rest, rate)
        white, flicker = fit_spectrum(frequency, power)
        expected = density(frequency, white, flicker)
        additional = find_lines(rest, rate, frequency, power, expected, MAX_LINES - len(lines))
        if not additional:
            break
        lines += additional
        coefficients, rest = fit_lines(clean, time, lines)
    frequency, power = periodogram(rest, rate)
    white, flicker = fit_spectrum(frequency, power)
    length = len(clean) / rate
    sigma = slope_sigma(time, rate, white.value, flicker.value)
    amplitudes = np.hypot(coefficients[:-1:2], coefficients[1:-1:2]).tolist()
    named = tuple(
        SpectralLine(
            f, Estimate(a, float(np.sqrt(density(f, white, flicker) / length))), probable_cause(f)
        )
        for f, a in sorted(zip(lines, amplitudes, strict=True))
    )
    return NoiseModel(
        rate, length, float(clean.mean()), white, flicker, named,
        Estimate(float(coefficients[-1]), sigma),
        int((is_spike & is_present).sum()), 1 - float(is_present.mean()),
    )  # fmt: skip


def density(frequency: float | Floats, white: Estimate, flicker: Estimate) -> Floats:
    """Spectral density of white and flicker noise at frequencies in Hz."""
    return np.asarray(white.value + flicker.value / frequency)


def fill(signal: Floats) -> Floats:
    """Interpolate the missing samples (NaN) of a signal (n,)."""
    is_present = np.isfinite(signal)
    if is_present.all():
        return signal
    place = np.arange(len(signal))
    return np.interp(place, place[is_present], signal[is_present])


def find_spikes(signal: Floats) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Mark samples (n,) far from their neighbours' median: dust, a cable, a damaged frame."""
    middle = np.median(np.stack([np.roll(signal, n) for n in (-2, -1, 1, 2)]), axis=0)
    distance = np.abs(signal - middle)
    distance[:2] = distance[-2:] = 0.0
    scale = 1.4826 * float(np.median(distance))
    return distance > 8 * scale if scale > 0 else np.zeros(len(signal), bool)


def slope_sigma(time: Floats, rate: float, white: float, flicker: float) -> float:
    """Standard uncertainty of a straight line's slope by least squares, per s.

    white, flicker: the noise, as in `NoiseModel`. The variance is the integral of S(f) |W(f)|^2,
    with W the transform of the weights.
    """
    from scipy.fft import next_fast_len

    centred = time - time.mean()
    weights = centred / (centred @ centred)
    size = int(next_fast_len(8 * len(time), real=True))
    answer = np.abs(np.fft.rfft(weights, size)[1:]) ** 2
    frequency = np.fft.rfftfreq(size, 1 / rate)[1:]
    return float(np.sqrt(((white + flicker / frequency) * answer).sum() * rate / size))


def periodogram(signal: Floats, rate: float) -> tuple[Floats, Floats]:
    """Frequencies, Hz, above the skipped ones and below half the rate, and the one-sided densities
    there, u^2/Hz, of a signal (n,)."""
    power: Floats = 2 * np.abs(np.fft.rfft(signal)[1:]) ** 2 / rate / len(signal)
    frequency: Floats = np.arange(1.0, len(power) + 1.0) * (rate / len(signal))
    end = (len(signal) - 1) // 2
    return frequency[SKIPPED_FREQUENCIES:end], power[SKIPPED_FREQUENCIES:end]


def fit_spectrum(frequency: Floats, power: Floats) -> tuple[Estimate, Estimate]:
    """Estimate white and flicker noise by the likelihood of a periodogram's band means.

    Fisher scoring, with bounds that keep both noises positive. The standard uncertainties follow
    from Fisher's information; that of a noise too small to be detected shows how large it may be.
    """
    edges = np.unique(np.geomspace(1, len(frequency), BANDS).astype(int))
    starts = np.append(0, edges[:-1])
    count = np.diff(np.append(starts, len(frequency)))
    mean = np.add.reduceat(power, starts) / count
    parts = np.stack([np.ones(len(mean)), np.add.reduceat(1 / frequency, starts) / count], axis=1)
    high = float(np.median(power[len(power) // 2 :])) / np.log(2)
    value: Floats = np.array(
        [high, max(1e-3 * high * frequency[0], float(mean[0]) * frequency[0] / 2)]
    )
    floor = np.array([1e-9 * high, 1e-9 * high * frequency[0]])
    for _ in range(60):
        model = parts @ value
        weighted = parts / model[:, None]
        information = (weighted * count[:, None]).T @ weighted
        step = np.linalg.solve(information, weighted.T @ (count * (mean / model - 1)))
        new: Floats = np.maximum(value + step, np.maximum(value / 4, floor))
        done = np.allclose(new, value, rtol=1e-9)
        value = new
        if done:
            break
    weighted = parts / (parts @ value)[:, None]
    covariance = np.linalg.inv((weighted * count[:, None]).T @ weighted)
    sigma = np.sqrt(np.diagonal(covariance))
    return Estimate(float(value[0]), float(sigma[0])), Estimate(float(value[1]), float(sigma[1]))


def find_lines(
    rest: Floats, rate: float, frequency: Floats, power: Floats, expected: Floats, max_lines: int
) -> list[float]:
    """Frequencies of lines above the noise, Hz, the strongest first; at most `max_lines`.

    rest: (n,) signal without drift and known lines.  frequency, power: its periodogram.  expected:
    the noise's density at these frequencies.
    """
    ratio = power / expected
    limit = np.log(len(ratio) / CHANCE)
    lines: list[float] = []
    step = frequency[1] - frequency[0]
    for n in np.argsort(ratio)[::-1][: 8 * max_lines]:
        if ratio[n] < limit or len(lines) == max_lines:
            break
        if all(abs(frequency[n] - other) > 4 * step for other in lines):
            lines.append(find_peak(rest, rate, float(frequency[n]), step))
    return lines


def find_peak(signal: Floats, rate: float, first_value: float, step: float) -> float:
    """Find the frequency, Hz, at which a sinusoid fits the signal (n,) best, near a first value.

    first_value: Hz.  step: distance of the periodogram's frequencies, Hz, and largest change. The
    signal is shifted to frequency zero once, and summed over pieces that are short compared with a
    period of the shifted signal, so that each step of the search needs few numbers.
    """
    from scipy.optimize import minimize_scalar

    shifted = signal * np.exp(-2j * np.pi * first_value / rate * np.arange(len(signal)))
    starts = np.unique(np.linspace(0, len(signal), PEAK_SUMS, endpoint=False).astype(int))
    sums = np.add.reduceat(shifted, starts)
    middles = (starts + np.append(starts[1:], len(signal)) - 1) / 2
    turns = 2j * np.pi * middles / rate

    def negative_amplitude(shift: float) -> float:
        return -float(np.abs(np.exp(-turns * shift) @ sums))

    return first_value + float(
        minimize_scalar(negative_amplitude, bounds=(-step, step), method="bounded").x
    )


def fit_lines(
    signals: Floats, time: Floats, frequencies: Sequence[float] = ()
) -> tuple[Floats, Floats]:
    """Fit k sinusoids and a drift to signals (n,) or (n, m) by least squares.

    Returns the coefficients (2 k + 1,) or (2 k + 1, m), namely cosine and sine of each frequency
    and the slope, and the residuals of the signals, with their means removed.
    """
    matrix = line_matrix(time, frequencies)
    centred = signals - signals.mean(axis=0)
    coefficients = np.linalg.solve(matrix.T @ matrix, matrix.T @ centred)
    return coefficients, centred - matrix @ coefficients


def line_matrix(time: Floats, frequencies: Sequence[float]) -> Floats:
    """Regressors (n, 2 k + 1) of sinusoids at k frequencies, Hz, and of a slope."""
    angle = 2 * np.pi * np.outer(time - time.mean(), frequencies)
    waves = np.stack([np.cos(angle), np.sin(angle)], axis=-1).reshape(len(time), -1)
    return np.column_stack([waves, time - time.mean()])


def probable_cause(frequency: float) -> str:
    """The probable cause of a line, by its frequency."""
    for mains in MAINS_HZ:
        order = round(frequency / mains)
        if order >= 1 and abs(frequency - order * mains) < MAINS_TOLERANCE * order * mains:
            return f"mains, {mains:.0f} Hz" if order == 1 else f"mains, {order} x {mains:.0f} Hz"
    return "unknown"
