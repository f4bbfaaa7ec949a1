"""Check that a recording shows a mirror at rest with steady light, so that its scatter is noise.

Electronics alone cause white and flicker noise, independent between detectors, mains pick-up, and a
slow drift. Tests compare every reading with that, and use no configured noise:

light      no saturated converter, no dark detector, a steady total power.
steps      readings finer than the converter's steps, which otherwise hide the noise.
drift      the slope over the whole recording.
slow       the Allan deviation without the slope. For white and flicker noise it never rises with
           the averaging time; for a motion, a step, or a random walk it does.
fast       prediction of one detector from the other two at every time scale. Noise cannot be
           predicted; a motion of the mirror or of the beam can, nearly completely.
bursts     a constant variance.

A deviation is reported if it exceeds chance and changes the recording's result, the standard
deviation of one sample. The reference is the median scatter within short segments, about their own
straight lines, which slow motions affect least.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..core.names import DETECTORS, POSE, READING_COLUMNS
from ..core.units import ANGLE, LENGTH, Floats
from ..detectors.counts import SATURATED
from ..detectors.noise import least_light
from ..estimation.solver import solve
from ..model.arrays import jacobian
from .allan import allan
from .noise_model import NoiseModel, fill, find_spikes, fit_lines, fit_noise

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..core.settings import Config

Columns = dict[str, NDArray[Any]]
#: The common conclusion of all findings, and the remedy.
NOT_NOISE = "the noise of the bench cannot be estimated from this recording"
REMEDY = "Record the mirror at rest, in steady light, with counts that are finer than the noise."
#: Largest fraction of saturated or dark samples: the loss of a normal distribution's upper
#: thousandth reduces the standard deviation by 0.5 %.
LOST_FRACTION = 1e-3
#: Largest relative change of the total power: the noise of a position is inversely proportional to
#: the power, so that it changes by a twentieth at most.
POWER_CHANGE = 0.05
#: Largest fraction of equal successive readings: at a half, the noise is half a step of the
#: converter, and the scatter would only measure this step.
EQUAL_FRACTION = 0.5
#: Largest drift over the recording, relative to the scatter within segments. The result excludes a
#: linear drift; but if a fifth of this drift were not linear, it would be as large as the noise.
DRIFT_LIMIT = 5.0
#: Largest additional variance over the noise's variance: 0.2 increases the standard deviation by a
#: tenth.
ADDED_VARIANCE = 0.2
#: The same limit as an Allan deviation: a sinusoid of amplitude A adds A^2 / 2, and its largest
#: Allan deviation is 0.73 A.
ADDED_DEVIATION = 0.73 * (2 * ADDED_VARIANCE) ** 0.5
#: The same limit for lines at multiples of the mains' frequency; larger, since electronics pick
#: them up.
MAINS_VARIANCE = 1.0
#: Probability of one false alarm in one test; a recording has some hundreds of tests.
CHANCE = 1e-6
#: Number of standard deviations that a normal distribution exceeds with this probability.
TAIL_SIGMAS = 5.0
#: Confidence level of Allan deviations in the test; a recording has some tens of them.
ALLAN_LEVEL = 0.999
#: Number of segments of a recording, and the least number of samples in each.
SEGMENTS, MIN_SEGMENT_SAMPLES = 64, 16
#: Bursts are searched in segments that are longer by this factor, so that noise behind a low pass
#: has enough samples in each; a burst has at least `BURST_VARIANCE_RATIO` times the usual variance.
BURST_SEGMENT_FACTOR, BURST_VARIANCE_RATIO = 4, 4.0
#: Least number of differences for predicting one detector from the others.
MIN_DIFFERENCES = 100
#: A motion explains a slow change if at most this fraction of its sum of squares remains.
UNEXPLAINED_FRACTION = 0.1
#: A slow change belongs to one detector if at most this fraction of the sum of squares lies on the
#: others.
ELSEWHERE_FRACTION = 0.05


@dataclass(frozen=True)
class RecordingSection:
    """Samples without a jump of the time.  rows: rows of the columns.  seq: (n,) their numbers.
    rate: Hz."""

    rows: slice
    seq: NDArray[np.int64]
    rate: float

    def resample(self, column: NDArray[Any]) -> Floats:
        """The section of a column at evenly spaced times (m,), NaN where a sample is missing."""
        signal = np.full(int(self.seq[-1] - self.seq[0]) + 1, np.nan)
        signal[self.seq - self.seq[0]] = column[self.rows]
        return signal


def find_faults(
    columns: Columns, piece: RecordingSection, models: Sequence[NoiseModel], config: Config
) -> list[str]:
    """Describe evidence against a mirror at rest in steady light, in sentences.

    piece: the section of the recording.  models: noise of the nine readings, um and uW.
    """
    steady = Steady(columns, piece, models, config)
    wandering = steady.wandering_channels()
    wandering_detectors = {n // 3 for n, _ in wandering}
    slow = wandering + [
        (n, sentence)
        for n, sentence in steady.drifting_channels()
        if n // 3 not in wandering_detectors
    ]
    sentences = [*steady.power_faults(), *(sentence for _, sentence in slow)]
    # Slow changes also move detectors together and scatter unevenly: one sentence is enough.
    sentences += [steady.describe_cause()] if slow else [*steady.common_motion(), *steady.bursts()]
    return [*sentences, *steady.mains_pickup()]


def reading_faults(columns: Columns, config: Config) -> list[str]:
    """Describe readings that hide the noise, in sentences: saturated, dark, or too coarse."""
    least_power = least_light(config.sensor)
    full = columns["flags"] & SATURATED > 0
    sentences = []
    for k, letter in enumerate(DETECTORS):
        names = READING_COLUMNS[3 * k : 3 * k + 3]
        values = np.stack([columns[name] for name in names])
        missing = ~np.isfinite(values).all(axis=0)
        fractions = {
            "saturated": float((full & missing).mean()),
            "without light": float((~full & (missing | (values[2] < least_power[k]))).mean()),
        }
        lost = [
            f"Detector {letter.upper()} is {words} in {percent(fraction)} of the samples (allowed: "
            f"{percent(LOST_FRACTION)})."
            for words, fraction in fractions.items()
            if fraction > LOST_FRACTION
        ]
        equal = (np.diff(values, axis=1) == 0).mean(axis=1)
        if not lost and equal.max() > EQUAL_FRACTION:
            sentences.append(
                f"On detector {letter.upper()}, {percent(float(equal.max()))} of the successive "
                f"values of {names[int(np.argmax(equal))]} are equal: its noise is smaller than "
                "the converter's step and cannot be estimated."
            )
        sentences += lost
    return sentences


class Steady:
    """Tests of a recording's readings, evenly spaced, without spikes and mains.

    The nine channels are, of each detector, the positions psi and zeta, um, and its power over the
    total power, in thousandths, in which changes of the laser's power cancel.  rest: (n, 9)
    channels without slope and mains.  noise: (9,) their median scatter within segments.
    """

    def __init__(
        self,
        columns: Columns,
        piece: RecordingSection,
        models: Sequence[NoiseModel],
        config: Config,
    ) -> None:
        self.config, self.rate = config, piece.rate
        samples = np.stack(
            [fill(piece.resample(columns[name])) for name in READING_COLUMNS], axis=1
        )
        self.mean = samples.mean(axis=0)
        self.total = samples[:, 2::3].sum(axis=1)
        scaled = 1e3 * samples
        scaled[:, 2::3] /= self.total[:, None]
        scaled = clean_spikes(scaled)
        self.time = np.arange(len(scaled)) / piece.rate
        self.length = len(scaled) / piece.rate
        self.models = [
            fit_noise(scaled[:, n], self.rate) if n % 3 == 2 else model
            for n, model in enumerate(models)
        ]
        lines = mains_lines(self.models)
        coefficients, self.rest = fit_lines(scaled, self.time, lines)
        self.slope, self.hum = coefficients[-1], (coefficients[:-1] ** 2).sum(axis=0) / 2
        powers = clean_spikes(1e3 * samples[:, 2::3] / self.total.mean())
        self.powers = fit_lines(powers, self.time, lines)[1]
        count = max(8, min(SEGMENTS, len(scaled) // MIN_SEGMENT_SAMPLES))
        self.segments = np.array_split(np.arange(len(scaled)), count)
        variances = [segment_variance(self.rest[rows]) for rows in self.segments]
        self.noise = np.sqrt(np.maximum(np.median(variances, axis=0), 1e-30))
        self.scatter = f"the scatter within {self.length / count:.2g} s"

    def power_faults(self) -> list[str]:
        """Describe a change of the total power: of the laser, or of light missing the detectors."""
        means = np.array([self.total[rows].mean() for rows in self.segments])
        change = float(np.ptp(means) / abs(means.mean()))
        if change <= POWER_CHANGE:
            return []
        return [
            f"The power on all detectors together changes by {percent(change)} "
            f"(allowed: {percent(POWER_CHANGE)}): the laser, or light that misses the detectors."
        ]

    def drifting_channels(self) -> list[tuple[int, str]]:
        """Channels with a large slope, each with a sentence; at most the worst of each detector."""
        is_significant = np.abs(self.slope) > TAIL_SIGMAS * np.array(
            [model.drift.sigma for model in self.models]
        )
        size = np.where(is_significant, np.abs(self.slope) * self.length, 0.0)
        return [
            (n, f"{subject(n)} drifts by {amount(n, size[n])} over the recording, "
                f"{digits(size[n] / self.noise[n])} times {self.scatter} (allowed: "
                f"{DRIFT_LIMIT:g}).")
            for n in worst_channels(size / self.noise, DRIFT_LIMIT)
        ]  # fmt: skip

    def wandering_channels(self) -> list[tuple[int, str]]:
        """Channels with a rising Allan deviation, each with a sentence; at most the worst of each
        detector."""
        size = np.zeros(9)
        for n in range(9):
            curve = allan(self.rest[:, n], self.rate, ALLAN_LEVEL)
            for k in np.flatnonzero(curve.tau >= self.length / SEGMENTS):
                before = (curve.tau <= curve.tau[k] / 4) & (curve.tau >= self.length / 1024)
                if before.any() and curve.low[k] > curve.high[before].min():
                    size[n] = max(size[n], curve.deviation[k])
        return [
            (n, f"{subject(n)} {self.describe_change(n)} {amount(n, self.swing(n))}, "
                f"{digits(self.swing(n) / self.noise[n])} times {self.scatter}: slower "
                "than noise of electronics.")
            for n in worst_channels(size / self.noise, ADDED_DEVIATION)
        ]  # fmt: skip

    def segment_means(self) -> Floats:
        """Means of the channels in each segment, drift included: (segments, 9)."""
        drifting = self.rest + np.outer(self.time - self.time.mean(), self.slope)
        return np.array([drifting[rows].mean(axis=0) for rows in self.segments])

    def swing(self, channel: int) -> float:
        """Difference of the largest and the least segment mean of a channel, in its unit."""
        return float(np.ptp(self.segment_means()[:, channel]))

    def describe_change(self, channel: int) -> str:
        """The verb for a channel's slow change: a jump, if one explains nearly all of it, or
        wandering."""
        means = self.segment_means()[:, channel]
        remaining = [
            means[:k].var() * k + means[k:].var() * (len(means) - k) for k in range(1, len(means))
        ]
        k = int(np.argmin(remaining)) + 1
        if remaining[k - 1] > 0.1 * means.var() * len(means):
            return "wanders by"
        return f"jumps after {self.time[self.segments[k][0]]:.3g} s by"

    def common_motion(self) -> list[str]:
        """Describe a common motion of the detectors, at the time scale where it is largest."""
        worst, size, allowed = (0.0, 0.0, 0), 1, self.allowed_variances()
        while len(self.rest) // size - 1 >= MIN_DIFFERENCES:
            steps = np.diff(block_means(self.rest, size), axis=0) / self.noise
            powers = np.diff(block_means(self.powers, size), axis=0) / self.noise[2::3]
            for ratio, channel in (
                *predictable_variances(steps, allowed),
                *exchanged_variances(powers, allowed[2::3]),
            ):
                worst = max(worst, (ratio, size / self.rate, channel))
            size *= 2
        ratio, tau, channel = worst
        if ratio <= 1:
            return []
        added, letter = (ratio * allowed[channel]) ** 0.5, DETECTORS[channel // 3].upper()
        moving = "The shares of light on the detectors" if channel % 3 == 2 else "The spots"
        return [
            f"{moving} move together within {tau:.2g} s, on detector {letter} by "
            f"{digits(added)} times {self.scatter} (root mean square): the mirror or the beam "
            "moves or vibrates, or the same disturbance enters all detectors."
        ]

    def allowed_variances(self) -> Floats:
        """Largest variances (9,) that detectors may have in common, over the noise's variances;
        the configured jitter of the beam is included."""
        electronics = self.config.sensor.electronics
        pointing = electronics.pointing if electronics else 0.0
        beam = self.jacobian()[:, 6:] * pointing / self.noise[:, None]
        allowed: Floats = ADDED_VARIANCE + 2 * (beam**2).sum(axis=1)
        return allowed

    def mains_pickup(self) -> list[str]:
        """Describe lines at multiples of the mains' frequency that are larger than the noise."""
        size = (2 * self.hum) ** 0.5
        return [
            f"{subject(n)} swings with the mains by {amount(n, size[n])} (amplitude), "
            f"{digits(size[n] / self.noise[n])} times {self.scatter}: pick-up of the "
            "electronics or a vibration, which cannot be distinguished."
            for n in worst_channels(self.hum / self.noise**2, MAINS_VARIANCE)
        ]

    def bursts(self) -> list[str]:
        """Describe segments with a much larger variance than the others."""
        parts = np.array_split(
            np.arange(len(self.rest)), len(self.segments) // BURST_SEGMENT_FACTOR
        )
        variances = np.array([segment_variance(self.rest[rows]) for rows in parts])
        usual = np.median(variances, axis=0)
        ratio = np.where(
            variances.max(axis=0) > BURST_VARIANCE_RATIO * usual,
            variances.mean(axis=0) / usual - 1,
            0.0,
        )
        n = int(np.argmax(ratio))
        if ratio[n] <= ADDED_VARIANCE:
            return []
        k = int(np.argmax(variances[:, n]))
        return [
            f"{subject(n)} scatters {digits((variances[k, n] / usual[n]) ** 0.5)} times as much as "
            f"usual around {self.time[parts[k]].mean():.3g} s. The cause is unknown: a knock, a "
            "loose cable, something in the beam."
        ]

    def jacobian(self) -> Floats:
        """Derivatives (9, 8) of the channels by the state, in mm and rad, at the pose of the mean
        reading, or at the zero pose if that cannot be solved."""
        sensor = self.config.sensor
        solution = solve(sensor, self.mean, beam="known", power="unknown")
        state = solution.state if bool(solution.converged) else np.zeros(8)
        slopes = 1e3 * np.asarray(jacobian(sensor, state))
        slopes[2::3] /= self.mean[2::3].sum()
        return slopes

    def describe_cause(self) -> str:
        """Describe the cause of a slow change, or state that it is unknown."""
        slow = self.segment_means()
        slow = (slow - slow.mean(axis=0)) / self.noise
        energy = (slow**2).sum(axis=0)
        jacobian = self.jacobian() / self.noise[:, None]
        for columns, words in ((slice(6, 8), "beam"), (slice(0, 6), "mirror")):
            states = slow @ np.linalg.pinv(jacobian[:, columns]).T
            remaining = slow - states @ jacobian[:, columns].T
            if (remaining**2).sum() <= UNEXPLAINED_FRACTION * energy.sum():
                return self.describe_motion(words, states, jacobian[:, columns])
        # Positions only: if one power changes, all fractions of the total do.
        places = energy.reshape(3, 3)[:, :2].sum(axis=1)
        k = int(np.argmax(places))
        if places.sum() - places[k] <= ELSEWHERE_FRACTION * places.sum():
            return (
                f"Only detector {DETECTORS[k].upper()} changes, so it is not the mirror but that "
                "detector, its mount or its electronics."
            )
        return (
            "The cause is unknown: the detectors do not change together as they would with a "
            "motion of the mirror or of the beam."
        )

    @staticmethod
    def describe_motion(words: str, states: Floats, jacobian: Floats) -> str:
        """Describe a motion that explains a slow change.

        words: "beam" or "mirror".  states: (segments, k) its components, mm and rad.  jacobian:
        (9, k) derivatives of the channels by these, over their noise.
        """
        if words == "beam":
            size = float(np.ptp(states, axis=0).max())
            return (
                "All detectors change as when the beam moves, by "
                f"{digits(size * LENGTH.fine_factor)} {LENGTH.fine_unit}, or as when the "
                "mirror moves across the beam."
            )
        effect = states.std(axis=0) * np.linalg.norm(jacobian, axis=0)
        axis = int(np.argmax(effect))
        unit = LENGTH if axis < 3 else ANGLE
        size = float(np.ptp(states[:, axis]))
        return (
            f"All detectors change as when the mirror moves, mostly in {POSE[axis]}, by "
            f"{digits(size * unit.fine_factor)} {unit.fine_unit}."
        )


def mains_lines(models: Sequence[NoiseModel]) -> list[float]:
    """Frequencies of the mains' lines in any of the signals, Hz, without duplicates."""
    frequencies: list[float] = []
    for model in models:
        for line in model.lines:
            if line.name.startswith("mains") and all(
                abs(line.frequency - other) > 2 / model.length for other in frequencies
            ):
                frequencies.append(line.frequency)
    return frequencies


def clean_spikes(signals: Floats) -> Floats:
    """Replace spikes in signals (n, m) without gaps by interpolation."""
    columns = (fill(np.where(find_spikes(signal), np.nan, signal)) for signal in signals.T)
    return np.stack([*columns], axis=1)


def segment_variance(part: Floats) -> Floats:
    """Variances (m,) of signals (n, m) about their straight lines of best fit."""
    rest = fit_lines(part, np.arange(float(len(part))))[1]
    variance: Floats = (rest**2).sum(axis=0) / (len(part) - 2)
    return variance


def block_means(signals: Floats, size: int) -> Floats:
    """Means (n // size, m) of signals (n, m) over blocks of `size` rows; the last rows may be
    unused."""
    count = len(signals) // size
    means: Floats = signals[: count * size].reshape(count, size, -1).mean(axis=1)
    return means


def predictable_variances(steps: Floats, allowed: Floats) -> list[tuple[float, int]]:
    """Variances of positions that the other detectors predict, over the allowed variances (9,).

    Returns pairs of ratio and channel, for predictions beyond chance.  steps: (n, 9) differences of
    neighbouring means, over the noise. A regression on independent noise explains about 6 / n of
    the variance by chance, which is subtracted.
    """
    from scipy.special import gammaincinv

    ratios = []
    for n in (0, 1, 3, 4, 6, 7):
        others = np.delete(steps, np.s_[3 * (n // 3) : 3 * (n // 3) + 3], axis=1)
        fitted = others @ np.linalg.lstsq(others, steps[:, n], rcond=None)[0]
        explained = float(fitted @ fitted)
        remaining = max(float(((steps[:, n] - fitted) ** 2).mean()), 1e-300)
        if explained > remaining * 2 * gammaincinv(others.shape[1] / 2, 1 - CHANCE):
            variance = (explained / len(steps) - remaining * others.shape[1] / len(steps)) / 2
            ratios.append((variance / float(allowed[n]), n))
    return ratios


def exchanged_variances(steps: Floats, allowed: Floats) -> list[tuple[float, int]]:
    """Variances of light that two detectors exchange, over the allowed variances (3,).

    Returns pairs of ratio and channel, for exchanges beyond chance.  steps: (n, 3) differences of
    neighbouring means of the powers, over the noise. The covariance of independent noise is zero,
    and the laser's noise makes it positive. Light that moves from one detector to the others makes
    it negative: half the light's variance if both others receive the same.
    """
    covariance = steps.T @ steps / len(steps)
    scale = np.sqrt(np.diagonal(covariance))
    ratios = []
    for first, second in ((0, 1), (1, 2), (0, 2)):
        chance = TAIL_SIGMAS * scale[first] * scale[second] / len(steps) ** 0.5
        if covariance[first, second] < -chance:
            variance = -covariance[first, second]  # twice the covariance, halved for a difference
            ratios.append((float(variance / allowed[first]), 3 * first + 2))
    return ratios


def worst_channels(ratios: Floats, allowed: float) -> list[int]:
    """The channel with the largest ratio of each detector, if this exceeds the allowed ratio."""
    by_detector = np.nan_to_num(ratios).reshape(3, 3)
    return [3 * k + int(np.argmax(row)) for k, row in enumerate(by_detector) if row.max() > allowed]


def subject(channel: int) -> str:
    """The name of a channel, as the subject of a sentence."""
    noun = ("The spot's place psi", "The spot's place zeta", "The share of light")[channel % 3]
    return f"{noun} on detector {DETECTORS[channel // 3].upper()}"


def amount(channel: int, value: float) -> str:
    """Format a value of a channel, um or thousandths, with its unit."""
    return f"{digits(value / 10)} %" if channel % 3 == 2 else f"{digits(value)} µm"


def digits(value: float) -> str:
    """Format with three digits, without an exponent below a million."""
    return f"{float(f'{value:.3g}'):,g}"


def percent(fraction: float) -> str:
    return f"{100 * fraction:.3g} %"
