"""What limits a frequency response, in sentences: averages, gaps, input, leakage, noise, light."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..core.names import POSE
from ..core.units import Booleans, Floats, unit_of
from .frequency_response import (
    SKIPPED_LINES,
    FrequencyResponse,
    SegmentOptions,
    average_spectra,
    low_pass,
    segment_starts,
)

if TYPE_CHECKING:
    from .response_signals import ResponseSignals

#: Averages below which random errors are large and badly known themselves.
FEW_AVERAGES = 10.0
#: A peak is resolved if its half-power width is at least this number of lines: its height is then
#: too low by a fiftieth at most.
RESOLVED_LINES = 8.0
#: A peak stands out of its surroundings by this factor, and has at least this coherence.
PEAK_FACTOR, PEAK_COHERENCE = 3.0, 0.5
#: Coherence is low below this: the random error is then above 0.4 of |H| over sqrt(n).
LOW_COHERENCE = 0.75
#: Share of the excited lines with a low coherence that is not worth a sentence.
SMALL_SHARE = 0.02
#: The incoherent part of the output is the sensor's noise if it is at most this factor above it.
NOISE_FACTOR = 2.0
#: Share of rows with the input at one of its ends from which it is called clipped.
CLIPPED_SHARE = 1e-3
#: Share of rows with a residual beyond chance from which the model is doubted; of right poses one
#: in 10,000 has such a one.
MISFIT_SHARE = 1e-3
#: The zero moved if the means of the first and the last tenth differ by this number of standard
#: deviations of the means of twentieths, and by this share of the motion's standard deviation.
MOVED_SIGMAS, MOVED_SHARE = 8.0, 0.2
#: Number of parts of the recording for that.
PARTS = 20
#: The input changes slowly if this share of the segments or less has it, in the median line; of a
#: random input a half of them count.
SLOW_INPUT_SHARE = 0.25
#: The input is bent if its square's or cube's coherence, averaged over the lines, exceeds chance by
#: this number of standard deviations.
BENT_SIGMAS = 8.0
#: What else lowers the coherence.
POSSIBLE_CAUSES = (
    "another force, play or a non-linear spring, peaks narrower than the lines, a jump of the "
    "zero, noise of the input's channel"
)


class Peak(NamedTuple):
    """A peak of |H1|.  axis: axis of the pose.  frequency, width: Hz, at half power.  size: |H1| at
    the peak, mm or rad per unit of the input.  line: number of the line."""

    axis: str
    frequency: float
    width: float
    size: float
    line: int


def find_peaks(response: FrequencyResponse) -> list[Peak]:
    """Find the peaks of all axes together: of the sum of their |H1|^2 over the noise's.

    An antiresonance of one axis makes none, since the others hardly have it at the same frequency.
    """
    from scipy import signal

    floor = np.nan_to_num(response.noise_floor, nan=float(np.median(np.abs(response.h1))))
    sizes = np.abs(response.h1) / floor
    together = np.sqrt((sizes**2).sum(axis=1))
    lines, _ = signal.find_peaks(np.log(together), prominence=np.log(PEAK_FACTOR))
    least = max(PEAK_COHERENCE, response.significant_coherence)
    peaks = []
    for line in lines[response.is_excited[lines]].tolist():
        n = int(np.argmax(sizes[line]))
        if response.coherence[line, n] > least:
            size = np.abs(response.h1[:, n])
            width = half_power_width(size, line) * response.resolution
            peaks.append(
                Peak(POSE[n], float(response.frequency[line]), width, float(size[line]), line)
            )
    return peaks


def half_power_width(size: Floats, line: int) -> float:
    """Width of the peak of |H| at a line where |H|^2 is half, in lines; interpolated."""
    power = (size / size[line]) ** 2
    width = 0.0
    for step in (-1, 1):
        n = line
        while 0 < n < len(power) - 1 and power[n + step] > 0.5:
            n += step
        beyond = min(max(n + step, 0), len(power) - 1)
        drop = power[n] - power[beyond]
        width += abs(n - line) + (float((power[n] - 0.5) / drop) if drop > 0 else 0.5)
    return width


def find_limits(
    response: FrequencyResponse, signals: ResponseSignals, peaks: list[Peak], bandwidth: float
) -> list[str]:
    """Describe what limits a response, with the likely cause.

    bandwidth: of the electronics, Hz.
    """
    return [
        *average_limits(response),
        *gap_limits(response, signals),
        *input_limits(response, signals),
        *bent_input_limits(response, signals),
        *light_limits(signals),
        *misfit_limits(signals),
        *zero_limits(signals),
        *leakage_limits(response, peaks),
        *silence_limits(response),
        *coherence_limits(response, peaks),
        *bandwidth_limits(response, bandwidth),
    ]


def average_limits(response: FrequencyResponse) -> Iterator[str]:
    if response.averages < FEW_AVERAGES:
        error = np.sqrt((1 - 0.9) / (0.9 * response.freedom))
        yield (
            f"There are only {response.averages:.3g} independent averages: at a coherence of 0.9 "
            f"the standard uncertainty of |H| is {100 * error:.2g} %, and the coherence itself is "
            "too large by chance. Record for longer, or give a larger --resolution-hz."
        )


def gap_limits(response: FrequencyResponse, signals: ResponseSignals) -> Iterator[str]:
    if response.left_out:
        lost = max(0, signals.stretches.span - len(signals.stimulus))
        yield (
            f"{response.left_out} of {response.left_out + response.segments} segments were left "
            f"out, because gaps cut them: {lost} samples were lost or not taken, and "
            f"{signals.stretches.unsolved} rows have no pose or no input."
            + (" A larger --resolution-hz makes segments shorter and saves more of them."
               if response.left_out > response.segments else "")
        )  # fmt: skip


def input_limits(response: FrequencyResponse, signals: ResponseSignals) -> Iterator[str]:
    """Sentences on bands without power, and on a clipped input."""
    dark = bands(response.frequency, ~response.is_excited)
    if dark:
        yield (
            f"The input has hardly any power {dark} (less than 1/10,000 of its largest density): "
            "there the response is not known."
        )
    counts = response.input_averages[response.is_excited]
    if np.median(counts) < SLOW_INPUT_SHARE * response.segments:
        yield (
            f"At most frequencies only {np.median(counts):.2g} of the {response.segments} segments "
            "have input: a sweep or bursts slower than a segment. Near narrow peaks the random "
            "error is then larger than stated; let a segment hold a whole sweep, by a faster sweep "
            "or a smaller --resolution-hz."
        )
    known = signals.stimulus[signals.usable]
    sides = [end for end in (known.max(), known.min()) if end != np.median(known)]  # not at rest
    ends = [float(np.mean(known == end)) for end in sides]
    if max(ends, default=0.0) > CLIPPED_SHARE:
        yield (
            f"The input is at its largest or smallest value in {100 * sum(ends):.2g} % of the "
            "rows: it is probably clipped by its amplifier or converter, or a square wave. A "
            "clipped input makes the response too large."
        )


def bent_input_limits(response: FrequencyResponse, signals: ResponseSignals) -> Iterator[str]:
    """A sentence on a motion that goes with the square or the cube of the input, beyond what goes
    with the input itself."""
    from scipy.signal import get_window

    if response.period:
        return
    length = round(response.rate / response.resolution)
    rows = np.concatenate(segment_starts(signals.stretches, length))
    options = SegmentOptions(rows, get_window("hann", length), response.rate, "linear")
    known = signals.stimulus[signals.usable]
    x = np.where(signals.usable, (signals.stimulus - known.mean()) / np.ptp(known), 0.0)
    for power, name in ((2, "square"), (3, "cube")):
        both = np.column_stack([x**power, signals.motion])
        _, g_xx, g_x, g_yy, _ = (
            density[SKIPPED_LINES:] for density in average_spectra(x, both, options)
        )
        g_r = average_spectra(x**power, signals.motion, options)[2][SKIPPED_LINES:]
        rest = g_yy - np.abs(g_x) ** 2 / g_xx[:, None]
        cross = g_r - np.conj(g_x[:, :1]) * g_x[:, 1:] / g_xx[:, None]
        coherence = np.abs(cross) ** 2 / (rest[:, :1] * rest[:, 1:])
        lines = response.is_excited
        chance = (1 + BENT_SIGMAS * np.sqrt(1.5 / lines.sum())) / (response.averages - 1)
        bent = coherence[lines].mean(axis=0) > chance
        if bent.any():
            axes = ", ".join(axis for axis, is_bent in zip(POSE, bent, strict=True) if is_bent)
            yield (
                f"The motion of {axes} goes with the {name} of the input, too: the input's "
                "channel or the spring is not linear, and |H| depends on the amplitude by more "
                "than the random error. Halve the force, and compare."
            )
            return


def bands(frequency: Floats, chosen: Booleans, most: int = 3) -> str:
    """The widest bands of chosen lines in words: "from 1 to 4 Hz, and from 90 to 500 Hz"."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], chosen, [False]]).astype(np.int8)))
    pairs = list(zip(edges[::2].tolist(), (edges[1::2] - 1).tolist(), strict=True))
    widest = sorted(sorted(pairs, key=lambda pair: pair[0] - pair[1])[:most])
    texts = [f"from {frequency[a]:.4g} to {frequency[b]:.4g} Hz" for a, b in widest]
    return " and ".join(texts) + (", and elsewhere" if len(pairs) > most else "")


def light_limits(signals: ResponseSignals) -> Iterator[str]:
    if signals.saturated:
        yield (
            f"Detectors were saturated in {signals.saturated} of {len(signals.usable)} rows, which "
            "have no pose: too much light, or a spot near an edge. The response lacks the largest "
            "motions."
        )


def misfit_limits(signals: ResponseSignals) -> Iterator[str]:
    if signals.misfits > MISFIT_SHARE * len(signals.usable):
        yield (
            f"In {signals.misfits} of {len(signals.usable)} rows the residual is beyond chance, "
            "where one in 10,000 is expected: these poses do not fit the configuration, and the "
            "response holds only as far as they do. Likely cause: another power of the laser or "
            "place of the beam than configured, or a sensor that was not calibrated."
        )


def zero_limits(signals: ResponseSignals) -> Iterator[str]:
    """A sentence on axes whose mean at the end is not that at the beginning."""
    rows = np.flatnonzero(signals.usable)
    parts = np.array_split(signals.motion[rows], PARTS)
    means = np.array([part.mean(axis=0) for part in parts])
    apart = means[-2:].mean(axis=0) - means[:2].mean(axis=0)
    steps = np.diff(means, axis=0)
    usual = 1.4826 * np.median(np.abs(steps - np.median(steps, axis=0)), axis=0) / np.sqrt(2)
    motion = signals.motion[rows].std(axis=0)
    moved = (np.abs(apart) > MOVED_SIGMAS * usual) & (np.abs(apart) > MOVED_SHARE * motion)
    if not moved.any():
        return
    texts = []
    for n in np.flatnonzero(moved).tolist():
        unit = unit_of(POSE[n])
        texts.append(f"{POSE[n]} by {unit.fine_factor * apart[n]:+.3g} {unit.fine_unit}")
    sudden = (np.abs(means[2:] - means[:-2]).max(axis=0) > 0.7 * np.abs(apart))[moved].any()
    cause = (
        "all at once: something slipped, or was touched" if sudden else
        "little by little: a drift of the temperature, or a creeping clamp; which one is unknown"
    )  # fmt: skip
    yield (
        f"The zero moved from the beginning to the end, {', '.join(texts)}, {cause}. Of each "
        "segment the straight line is removed, so that only the lowest lines suffer."
    )


def leakage_limits(response: FrequencyResponse, peaks: list[Peak]) -> Iterator[str]:
    if response.period:
        yield (
            f"The input repeats every {response.period:.4g} s. The spectra are averaged over whole "
            f"periods without a window, and the responses are given at its "
            f"{len(response.frequency)} lines only; a peak between two lines does not show."
        )
        return
    narrow = [peak for peak in peaks if peak.width < RESOLVED_LINES * response.resolution]
    if narrow:
        texts = ", ".join(
            f"{peak.frequency:.5g} Hz ({peak.width / response.resolution:.2g} lines)"
            for peak in narrow
        )
        needed = 0.95 * min(peak.width for peak in narrow) / RESOLVED_LINES
        yield (
            f"The lines are too far apart for the peaks at {texts}: leakage makes them too low and "
            f"their damping too large. Give --resolution-hz {needed:.2g} or less, and record for "
            f"{16.5 / needed:.2g} s or more."
        )


def silence_limits(response: FrequencyResponse) -> Iterator[str]:
    """A sentence that names the axes without a response."""
    silent = silent_axes(response)
    if not silent.any():
        return
    ratio = np.median(
        (response.output_density / response.noise_density)[response.is_excited], axis=0
    )
    names = ", ".join(axis for axis, is_silent in zip(POSE, silent, strict=True) if is_silent)
    yield f"No response beyond chance: {names}. What is drawn is an upper limit; " + (
        "the motion there is the sensor's noise." if (ratio[silent] < NOISE_FACTOR).all() else
        "the motion there is more than the sensor's noise, and its cause is unknown."
    )  # fmt: skip


def coherence_limits(response: FrequencyResponse, peaks: list[Peak]) -> Iterator[str]:
    """A sentence for each axis whose coherence is low, with the share that each cause explains."""
    lines = response.is_excited
    narrow = np.zeros(len(response.frequency), bool)
    for peak in peaks:
        if peak.width < RESOLVED_LINES * response.resolution:
            near = max(peak.width, 3 * response.resolution)
            narrow |= np.abs(response.frequency - peak.frequency) <= near
    rest = (1 - response.coherence) * response.output_density
    silent = silent_axes(response)
    for n, axis in enumerate(POSE):
        low = lines & (response.coherence[:, n] < LOW_COHERENCE)
        share = low.sum() / max(lines.sum(), 1)
        if share <= SMALL_SHARE or silent[n]:
            continue
        noisy = low & (rest[:, n] <= NOISE_FACTOR * response.noise_density[:, n])
        leaking = low & ~noisy & narrow
        parts = {
            "the sensor's noise": noisy.sum() / low.sum(),
            "leakage at narrow peaks": leaking.sum() / low.sum(),
        }
        causes = [f"{name} explains {100 * part:.0f} % of them" for name, part in parts.items()
                  if part > 0.005]  # fmt: skip
        if sum(parts.values()) < 0.9:
            which = "the cause of the others" if causes else "the cause"
            causes.append(f"{which} is unknown ({POSSIBLE_CAUSES})")
        yield (
            f"The coherence of {axis} is below {LOW_COHERENCE:g} in {100 * share:.3g} % of the "
            f"excited lines; {'; '.join(causes)}."
        )


def silent_axes(response: FrequencyResponse) -> Booleans:
    """Whether each axis (6,) has a coherence that is that of chance in nearly all excited lines."""
    chance = response.coherence <= response.significant_coherence
    is_silent: Booleans = chance[response.is_excited].mean(axis=0) >= 1 - SMALL_SHARE
    return is_silent


def bandwidth_limits(response: FrequencyResponse, bandwidth: float) -> Iterator[str]:
    """A sentence on what the electronics' low pass does at the highest excited line."""
    top = float(response.frequency[response.is_excited].max())
    passed = low_pass(np.array([top]), bandwidth)[0]
    yield (
        f"The electronics' low pass of the first order at {bandwidth:.4g} Hz changes |H| by "
        f"{100 * (abs(passed) - 1):.2g} % and the phase by {np.degrees(np.angle(passed)):.2g} "
        f"degrees at {top:.4g} Hz; "
        + ("this is corrected." if response.is_corrected else
           "this is not corrected (--correct-bandwidth does so).")
    )  # fmt: skip
