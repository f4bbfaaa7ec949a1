"""Describe the limits of a frequency response: averages, gaps, input, leakage, noise, light.

Each `*_limits` function yields the sentences on its limit, none if it does not apply.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..core import POSE, Booleans, Floats, short_number, unit_of
from .frequency_response import FrequencyResponse, low_pass

if TYPE_CHECKING:
    from .signals import ResponseSignals

#: Number of averages below which random errors are large and poorly known themselves.
FEW_AVERAGES = 10.0
#: A peak is resolved if its half-power width is at least this many lines: its height is then too
#: low by a fiftieth at most.
RESOLVED_LINES = 8.0
#: A peak exceeds its surroundings by this factor, and has at least this coherence.
PEAK_FACTOR, PEAK_COHERENCE = 3.0, 0.5
#: Coherence below this is low: with n averages, the random error then exceeds 0.4 |H| / sqrt(n).
LOW_COHERENCE = 0.75
#: Fraction of the excited lines with a low coherence up to which it is not reported.
SMALL_FRACTION = 0.02
#: The incoherent part of the output is attributed to the sensor's noise if its density is at most
#: this many times the noise's.
NOISE_FACTOR = 2.0
#: The input counts as clipped if it is at one of its extreme values in more than this fraction of
#: the rows, and three times in succession. It must also be there this many times as often as at the
#: next value; for a sine in the steps of its converter, this ratio is at most five.
CLIPPED_FRACTION, CLIPPED_RATIO = 1e-3, 8.0
#: Fraction of rows with a residual beyond chance above which the model is doubted; one in 10,000
#: of the correct poses has such a residual.
MISFIT_FRACTION = 1e-3
#: The zero moved if the means of the first and the last tenth of the recording differ enough. The
#: limits are multiples of the median step between twentieths and of the motion's deviation.
MOVED_STEPS, MOVED_FRACTION = 8.0, 0.2
#: Number of bands that a sentence names.
MAX_BANDS = 3
#: Further causes of a low coherence.
POSSIBLE_CAUSES = (
    "another force, play or a non-linear spring, peaks narrower than the lines, a jump of the "
    "zero, noise of the input's channel"
)


class Peak(NamedTuple):
    """A peak of |H1|.  axis: axis of the pose.  frequency: Hz.  width: at half power, Hz.  size:
    |H1| at the peak, mm or rad per unit of the input.  line: index in the response's frequencies.
    """

    axis: str
    frequency: float
    width: float
    size: float
    line: int


def find_peaks(response: FrequencyResponse) -> list[Peak]:
    """Find the peaks of the sum over all axes of |H1|^2 relative to the noise, lowest first.

    The sum is used because an antiresonance of one axis, which other axes hardly have at the same
    frequency, would otherwise look like a valley between two peaks.
    """
    from scipy import signal

    excited = np.flatnonzero(response.is_excited)
    # The median, because the noise floor varies with the input's own peaks.
    floor = np.median(response.noise_floor[excited], axis=0)
    floor = np.where(np.isfinite(floor), floor, np.median(np.abs(response.h1[excited]), axis=0))
    sizes = np.abs(response.h1) / floor
    together = np.sqrt((sizes[excited] ** 2).sum(axis=1))
    lines, _ = signal.find_peaks(np.log(together), prominence=np.log(PEAK_FACTOR))
    required = max(PEAK_COHERENCE, response.significant_coherence)
    peaks = []
    for line in excited[lines].tolist():
        n = int(np.argmax(sizes[line]))
        if response.coherence[line, n] > required:
            size = np.abs(response.h1[:, n])
            width = half_power_width(size, line) * response.resolution
            peaks.append(
                Peak(POSE[n], float(response.frequency[line]), width, float(size[line]), line)
            )
    return peaks


def half_power_width(size: Floats, line: int) -> float:
    """Width of the peak of |H| (m,) at a line, between the points where |H|^2 is half of the peak's
    value, in lines; interpolated."""
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
    """Describe the limits of a response with their likely causes, in sentences.

    bandwidth: of the electronics' low pass, Hz.
    """
    return [
        *average_limits(response),
        *gap_limits(response, signals),
        *input_limits(response, signals),
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
    """Sentences on bands without power, on an input that is not stationary, and on a clipped
    input; none without such a limit."""
    silent = bands(response.frequency, ~response.is_excited)
    if silent:
        yield (
            f"The input has hardly any power {silent} (less than 1/10,000 of its largest density): "
            "there the response is not known."
        )
    if not response.is_stationary:
        count = response.mean_input_share * response.segments
        yield (
            f"At most frequencies only {max(round(count), 1)} of the {response.segments} "
            "segments have input: the input passes through the frequencies (a sweep or a stepped "
            "sine longer than a segment) and is not stationary. Random errors are therefore not "
            "stated. Excite all frequencies at once, or let a segment hold a whole sweep, by a "
            "faster sweep or a smaller --resolution-hz."
        )
    clipped = sum(clipped_fractions(signals.stimulus[signals.usable]))
    if clipped:
        yield (
            f"The input stays at its largest or smallest value in {100 * clipped:.2g} % of the "
            "rows: it is probably clipped by its amplifier or converter, or has flat tops by "
            "design. A clipped input makes the response too large."
        )


def clipped_fractions(stimulus: Floats) -> Iterator[float]:
    """Yield the fraction of rows in which an input (n,) is clipped, for each clipped extreme."""
    for side in (stimulus, -stimulus):
        at_end = side == side.max()
        stays = at_end[2:] & at_end[1:-1] & at_end[:-2]
        below = side[~at_end].max(initial=-np.inf)
        at_rest = side.max() == np.median(side)
        if (
            stays.any() and not at_rest and at_end.mean() > CLIPPED_FRACTION
            and at_end.sum() > CLIPPED_RATIO * (side == below).sum()
        ):  # fmt: skip
            yield float(at_end.mean())


def bands(frequency: Floats, chosen: Booleans) -> str:
    """Describe the widest bands of chosen lines (m,): "from 1 to 4 Hz and from 90 to 500 Hz"; ""
    if none is chosen."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], chosen, [False]]).astype(np.int8)))
    pairs = list(zip(edges[::2].tolist(), (edges[1::2] - 1).tolist(), strict=True))
    widest = sorted(sorted(pairs, key=lambda pair: pair[0] - pair[1])[:MAX_BANDS])
    texts = [f"from {frequency[a]:.4g} to {frequency[b]:.4g} Hz" for a, b in widest]
    return " and ".join(texts) + (", and elsewhere" if len(pairs) > MAX_BANDS else "")


def light_limits(signals: ResponseSignals) -> Iterator[str]:
    if signals.saturated:
        yield (
            f"Detectors were saturated in {signals.saturated} of {len(signals.usable)} rows, which "
            "have no pose: too much light, or a spot near an edge. The response lacks the largest "
            "motions."
        )


def misfit_limits(signals: ResponseSignals) -> Iterator[str]:
    if signals.misfits > MISFIT_FRACTION * len(signals.usable):
        yield (
            f"In {signals.misfits} of {len(signals.usable)} rows the residual is beyond chance, "
            "where one in 10,000 is expected: these poses do not fit the configuration, and the "
            "response holds only as far as they do. Likely cause: another power of the laser or "
            "place of the beam than configured, or a sensor that was not calibrated."
        )


def zero_limits(signals: ResponseSignals) -> Iterator[str]:
    """A sentence on axes whose mean position changed from the beginning to the end."""
    motion = signals.motion[signals.usable]
    means = np.array([part.mean(axis=0) for part in np.array_split(motion, 20)])
    shift = means[-2:].mean(axis=0) - means[:2].mean(axis=0)
    usual = np.median(np.abs(np.diff(means, axis=0)), axis=0)
    limit = np.maximum(MOVED_STEPS * usual, MOVED_FRACTION * motion.std(axis=0))
    sizes = [
        f"{axis} by {short_number(unit_of(axis).fine_factor * size)} {unit_of(axis).fine_unit}"
        for axis, size, is_moved in zip(POSE, shift, np.abs(shift) > limit, strict=True)
        if is_moved
    ]
    if sizes:
        yield (
            f"The zero moved from the beginning to the end, {', '.join(sizes)}. Something slipped "
            "or was touched, the temperature drifted, or a clamp creeps; the poses over time show "
            "which. Of each segment the straight line is removed, so that a drift spoils only the "
            "lowest lines; a jump spoils its segment."
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
    """A sentence for each axis with a low coherence and the fraction that each cause explains."""
    lines = response.is_excited
    narrow = np.zeros(len(response.frequency), bool)
    for peak in peaks:
        if peak.width < RESOLVED_LINES * response.resolution:
            near = max(peak.width, 3 * response.resolution)
            narrow |= np.abs(response.frequency - peak.frequency) <= near
    incoherent = (1 - response.coherence) * response.output_density
    silent = silent_axes(response)
    for n, axis in enumerate(POSE):
        low = lines & (response.coherence[:, n] < LOW_COHERENCE)
        fraction = low.sum() / max(lines.sum(), 1)
        if fraction <= SMALL_FRACTION or silent[n]:
            continue
        noisy = low & (incoherent[:, n] <= NOISE_FACTOR * response.noise_density[:, n])
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
            f"The coherence of {axis} is below {LOW_COHERENCE:g} in {100 * fraction:.3g} % of the "
            f"excited lines; {'; '.join(causes)}."
        )


def silent_axes(response: FrequencyResponse) -> Booleans:
    """Whether the coherence of each axis (6,) is not beyond chance in nearly all excited lines."""
    chance = response.coherence <= response.significant_coherence
    is_silent: Booleans = chance[response.is_excited].mean(axis=0) >= 1 - SMALL_FRACTION
    return is_silent


def bandwidth_limits(response: FrequencyResponse, bandwidth: float) -> Iterator[str]:
    """A sentence on the effect of the electronics' low pass at the highest excited line."""
    top = float(response.frequency[response.is_excited].max())
    gain = low_pass(np.array([top]), bandwidth)[0]
    yield (
        f"The electronics' low pass of the first order at {bandwidth:.4g} Hz changes |H| by "
        f"{100 * (abs(gain) - 1):.2g} % and the phase by {np.degrees(np.angle(gain)):.2g} "
        f"degrees at {top:.4g} Hz; "
        + ("this is corrected." if response.is_corrected else
           "this is not corrected (--correct-bandwidth does so).")
    )  # fmt: skip
