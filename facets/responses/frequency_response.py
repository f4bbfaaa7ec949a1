"""Estimate frequency response functions from a measured input and measured motions (Welch).

With G the one-sided auto- and cross-spectral densities of the input x and an output y, averaged
over overlapping segments under a Hann window,

    H1 = G_xy / G_xx,   H2 = G_yy / G_yx,   coherence = |G_xy|^2 / (G_xx G_yy).

Noise of the output leaves H1 unbiased and makes H2 too large; noise of the input makes H1 too
small. The random error of |H| (Bendat and Piersol, Random Data, 4th edition, section 9.2) is

    sigma(|H|) / |H| = sqrt((1 - coherence) / (2 coherence n)),

n averages; the phase has as much in rad. Here n - 1 replaces n, because the incoherent part of
the output is itself estimated from n averages and the input's line takes one of them. Overlapping
segments share samples: n is the number of independent segments with the same variance.

With several inputs, the response to each of them is estimated from conditioned spectra (ibid.,
chapter 7): those of this input and of the outputs without the parts due to the other inputs.
H1, H2 and the coherence, then called partial, follow from these as above, and each other input
takes one of the n averages. The multiple coherence is the fraction of an output's power that is
due to all inputs together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..core import POSE, Booleans, Complexes, Floats, InputError, Integers, show_shortly
from ..estimation import coverage_factor
from ..files import make_frame
from .forms import RECEPTANCE, ResponseForm

if TYPE_CHECKING:
    from pandas import DataFrame

#: Averages that the default segment length aims at.
DEFAULT_AVERAGES = 32.0
#: Shortest segment, samples.
MIN_SEGMENT_SAMPLES = 64
#: Number of the lowest lines that are excluded: removing each segment's straight line changes them.
SKIPPED_LINES = 2
#: A step of the time that differs from the usual one by more than this share is a gap or a repeat.
STEP_TOLERANCE = 0.5
#: The times are uneven if the steps scatter by more than this fraction of a step.
LARGEST_JITTER = 0.1
#: The input does not excite a line if its density is below this fraction of the largest.
EXCITED_SHARE = 1e-4
#: An input is periodic if it correlates with itself a period later by this or more.
PERIODIC_LIKENESS = 0.98
#: Responses to several inputs are separated if at least this fraction of an input's power is
#: independent of the others, in the median line.
SEPARATE_SHARE = 1e-3
INSEPARABLE = (
    "an input goes with the other inputs at most frequencies (coherence above "
    f"{1 - SEPARATE_SHARE:g}), so that their responses cannot be told apart; drive the body by "
    "forces that are independent of each other, or name one input"
)
#: The input passes through the frequencies, if a line has input in this share or less of the
#: segments that have any, in the median line; of a random input, a half.
SLOW_INPUT_SHARE = 0.25
#: Segments that are transformed at once.
SEGMENTS_AT_ONCE = 64


class Stretches(NamedTuple):
    """Evenly spaced samples without a gap.

    rate: Hz.  starts, stops: (k,) rows of each stretch.  span: samples from the first to the last
    with those that are missing.  unsolved: rows without a number.
    """

    rate: float
    starts: Integers
    stops: Integers
    span: int
    unsolved: int


class OutputChannel(NamedTuple):
    """How the outputs were measured.

    deviation: (d,) standard deviations of the outputs' own noise in one sample, None if unknown.
    bandwidth: of the electronics' low pass of the first order, Hz.  is_corrected: whether responses
    are divided by its transmission.  delay: from the instant of an output's sample to that of the
    stimulus, s, which is corrected.
    """

    deviation: Floats | None = None
    bandwidth: float = np.inf
    is_corrected: bool = False
    delay: float = 0.0


#: Outputs without noise, low pass or delay.
PERFECT_CHANNEL = OutputChannel()


@show_shortly
@dataclass(frozen=True)
class FrequencyResponse:
    """Responses of d outputs to one input at m frequencies.

    frequency: (m,) Hz.  h1, h2: (m, d) complex, output's unit per input's unit.  coherence: (m, d).
    input_density: (m,), output_density: (m, d), unit^2/Hz.  noise_density: (m, d) of the outputs'
    own noise, NaN where not known.  averages: number of independent averages.  segments: number
    of segments.  left_out: segments that a gap prevented.  resolution: distance of lines, Hz.
    input_share: (m,) number of segments with input at a line, over the number with any input; both
    as the number of equal segments whose mean would scatter as much.  is_corrected: whether the
    electronics' low pass is divided out, of the densities of output and noise, too.  period: of a
    periodic input, s, to whose lines the frequencies are
    restricted; else 0.  form: of h1 and h2; densities are always those of displacements.
    multiple_coherence: (m, d) with all of several inputs; then input, output, h1, h2 and coherence
    are those without the parts that go with the other inputs. None of a single input.
    """

    frequency: Floats
    h1: Complexes
    h2: Complexes
    coherence: Floats
    input_density: Floats
    output_density: Floats
    noise_density: Floats
    rate: float
    averages: float
    segments: int
    left_out: int
    resolution: float
    input_share: Floats
    is_corrected: bool = False
    period: float = 0.0
    form: ResponseForm = RECEPTANCE
    multiple_coherence: Floats | None = None

    def convert(self, form: ResponseForm) -> FrequencyResponse:
        """Return a receptance in another form."""
        h1, h2 = (form.convert(self.frequency, values) for values in (self.h1, self.h2))
        return replace(self, h1=h1, h2=h2, form=form)

    @property
    def random_error(self) -> Floats:
        """Relative standard uncertainty of |H| (m, d), which is also that of the phase in rad; NaN
        of an input that is not stationary, since then segments do not scatter by chance alone."""
        error: Floats = np.sqrt((1 - self.coherence) / (self.coherence * self.freedom))
        return error if self.is_stationary else np.full_like(error, np.nan)

    @property
    def mean_input_share(self) -> float:
        """The `input_share` where the input's power is: leakage and noise of other lines are in all
        segments."""
        return float(np.average(self.input_share, weights=self.input_density))

    @property
    def is_stationary(self) -> bool:
        """Whether the lines have input at the same times, and not one after the other."""
        return self.mean_input_share >= SLOW_INPUT_SHARE

    @property
    def freedom(self) -> float:
        """Degrees of freedom of the random error."""
        return 2 * (self.averages - 1)

    @property
    def uncertainty(self) -> Floats:
        """Standard uncertainty of |H1| (m, d)."""
        size: Floats = np.abs(self.h1) * self.random_error
        return size

    @property
    def coverage_factor(self) -> float:
        """Factor of the standard uncertainty for an interval of 95 %, by Student's distribution."""
        return float(coverage_factor(0.95, self.freedom))

    @property
    def noise_floor(self) -> Floats:
        """|H1| (m, d) that the outputs' own noise alone gives, root mean square; one over that of
        an inverse form."""
        floor = np.sqrt(self.noise_density / self.input_density[:, None] / self.averages)
        return np.abs(self.form.convert(self.frequency, floor))

    @property
    def significant_coherence(self) -> float:
        """The coherence that an output without any relation to the input exceeds in 0.1 % of the
        lines."""
        return float(1 - 0.001 ** (1 / max(self.averages - 1, 1e-9)))

    @property
    def is_excited(self) -> Booleans:
        """Lines (m,) at which the input has power."""
        lines: Booleans = self.input_density >= EXCITED_SHARE * self.input_density.max()
        return lines

    def to_frame(self) -> DataFrame:
        """The columns of `response_table` as a data frame of pandas."""
        return make_frame(response_table(self))


def find_stretches(time: Floats, usable: Booleans, name: str) -> Stretches:
    """Find the stretches of rows (n,) without a gap.

    time: (n,) s.  usable: (n,) whether a row has all numbers.  name: for messages. Raises
    `InputError` for times that do not ascend or are uneven.
    """
    if len(time) < 2 * MIN_SEGMENT_SAMPLES or usable.sum() < 2 * MIN_SEGMENT_SAMPLES:
        raise InputError(
            f"{name}: has {int(usable.sum())} rows with a pose and an input, too few for a "
            f"frequency response; allowed: {2 * MIN_SEGMENT_SAMPLES} or more"
        )
    steps = np.diff(time)
    if not (steps > 0).all():
        row = int(np.flatnonzero(~(steps > 0))[0])
        raise InputError(
            f"{name}: the time does not ascend after row {row + 1} ({time[row]:.9g} s); sort the "
            "rows, and remove repeated ones"
        )
    usual = float(np.median(steps))
    even = np.abs(steps / usual - 1) <= STEP_TOLERANCE
    step = float(steps[even].mean())
    jitter = float(steps[even].std() / step)
    if jitter > LARGEST_JITTER or even.mean() < 0.5:
        raise InputError(
            f"{name}: the rows are not evenly spaced in time (the steps scatter by "
            f"{100 * (jitter if even.mean() >= 0.5 else np.std(steps) / usual):.0f} %); resample "
            "the table at equal steps, or give the recording"
        )
    joined = even & usable[1:] & usable[:-1]
    edges = np.flatnonzero(np.diff(np.concatenate([[False], joined, [False]]).astype(np.int8)))
    span = round((time[-1] - time[0]) / step) + 1
    return Stretches(1 / step, edges[::2], edges[1::2] + 1, span, int((~usable).sum()))


def find_period(stimulus: Floats, stretches: Stretches) -> int:
    """Period of an input (n,) in samples, by its autocorrelation; 0 of one that is not periodic.

    Two periods at least must lie in the longest stretch.
    """
    from scipy.signal import correlate

    n = int(np.argmax(stretches.stops - stretches.starts)) if len(stretches.starts) else 0
    x = (
        stimulus[stretches.starts[n] : stretches.stops[n]]
        if len(stretches.starts)
        else stimulus[:0]
    )
    if not len(x) or np.ptp(x) == 0:
        return 0
    x = x - x.mean()
    most = len(x) // 2
    ahead = correlate(x, x, method="fft")[len(x) - 1 :][: most + 1]
    power = np.concatenate([[0.0], np.cumsum(x**2)])
    lags = np.arange(most + 1)
    both = np.sqrt(power[len(x) - lags] * (power[-1] - power[lags]))
    alike = ahead / np.maximum(both, 1e-300)
    begin = int(np.argmax(alike < PERIODIC_LIKENESS / 2))
    if not begin or alike[begin:].max() < PERIODIC_LIKENESS:
        return 0
    first = begin + int(
        np.argmax(alike[begin:] >= alike[begin:].max() - (1 - PERIODIC_LIKENESS) / 10)
    )
    near = alike[first : first + 1 + max(2, first // 100)]
    return first + int(np.argmax(near))


def segment_starts(stretches: Stretches, length: int, hop: int | None = None) -> list[Integers]:
    """First rows of segments that begin every `hop` rows, by stretch; half-overlapping if None."""
    hop = hop or length // 2
    return [
        start + hop * np.arange((stop - start - length) // hop + 1)
        for start, stop in zip(stretches.starts, stretches.stops, strict=True)
        if stop - start >= length
    ]


def count_averages(starts: Sequence[Integers], window: Floats) -> float:
    """Number of independent averages of overlapping segments (Welch 1967)."""
    hop = len(window) // 2
    products = [float(window[: len(window) - n * hop] @ window[n * hop :]) for n in (1, 2)]
    shares = [(values / float(window @ window)) ** 2 for values in products]
    count = sum(len(values) for values in starts)
    pairs = sum(
        2 * overlap * max(len(values) - n, 0)
        for values in starts
        for n, overlap in enumerate(shares, 1)
    )
    return count**2 / (count + pairs) if count else 0.0


def choose_length(stretches: Stretches) -> int:
    """Segment length, samples, that gives about `DEFAULT_AVERAGES`; shorter if gaps need it."""
    from scipy.fft import next_fast_len
    from scipy.signal import get_window

    usable = int((stretches.stops - stretches.starts).sum())
    length = int(2 * usable / (DEFAULT_AVERAGES + 1))
    while length > MIN_SEGMENT_SAMPLES:
        length = max(int(next_fast_len(int(length), real=True)), MIN_SEGMENT_SAMPLES)
        count = count_averages(segment_starts(stretches, length), get_window("hann", length))
        if count >= DEFAULT_AVERAGES / 2:
            return length
        length = length * 3 // 4
    return MIN_SEGMENT_SAMPLES


def segment_length(stretches: Stretches, resolution: float | None, period: int) -> int:
    """Segment length, samples: of the resolution, or chosen; whole periods of a periodic input."""
    if resolution is not None and not 0 < resolution < np.inf:
        raise InputError(f"a resolution of {resolution:g} Hz is none; allowed: above 0")
    if not period:
        return (
            choose_length(stretches) if resolution is None else round(stretches.rate / resolution)
        )
    periods = round(stretches.rate / resolution / period) if resolution else 1
    return period * max(periods, -(-MIN_SEGMENT_SAMPLES // period))


def noise_spectrum(frequency: Floats, deviation: Floats, rate: float, bandwidth: float) -> Floats:
    """One-sided density (m, d) of sampled noise of standard deviations (d,) at frequencies (m,).

    White noise behind a low pass of the first order with the corner `bandwidth` (Hz), sampled at
    the rate; aliases included. It is white if the corner is far above the rate.
    """
    memory = np.exp(-2 * np.pi * bandwidth / rate)
    shape = (1 - memory**2) / (1 - 2 * memory * np.cos(2 * np.pi * frequency / rate) + memory**2)
    density: Floats = 2 / rate * shape[:, None] * deviation**2
    return density


def low_pass(frequency: Floats, bandwidth: float) -> Complexes:
    """Transmission (m,) of a low pass of the first order at frequencies (m,), Hz."""
    return np.asarray(1 / (1 + 1j * frequency / bandwidth))


def estimate_response(
    stimulus: Floats,
    outputs: Floats,
    stretches: Stretches,
    resolution: float | None = None,
    channel: OutputChannel = PERFECT_CHANNEL,
    others: Floats | None = None,
) -> FrequencyResponse:
    """Estimate the responses of outputs (n, d) to a stimulus (n,), by rows of `stretches`.

    resolution: distance of lines, Hz; chosen for about 32 averages if None.  channel: how the
    outputs were measured.  others: (n, q) other inputs, whose parts are taken out. Raises
    `InputError` if there are not two averages, or if the stimulus follows the others.
    """
    others = np.empty((len(stimulus), 0)) if others is None else others
    period = 0 if others.size else find_period(stimulus, stretches)
    options, averages, left_out = choose_segments(stretches, resolution, period, others.shape[1])
    rate, length = stretches.rate, len(options.window)
    used = np.zeros(len(stimulus), dtype=bool)
    for start in options.starts.tolist():
        used[start : start + length] = True
    for x in (stimulus, *others.T):
        if np.ptp(x[used]) == 0:
            raise InputError(
                "the input does not change in the rows without gaps; name the column of a changing "
                "input"
            )
    spectra = separate_spectra(np.column_stack([stimulus, others]), outputs, options)
    lines = np.arange(SKIPPED_LINES, len(spectra.frequency))
    if period:  # elsewhere there is neither force nor leakage, only noise
        power = spectra.g_xx[1:]
        lines = 1 + np.flatnonzero(power >= EXCITED_SHARE * power.max())
    chosen = Spectra(*(values[lines] for values in spectra))  # type: ignore[arg-type]
    frequency, g_xx, g_xy, g_yy, input_share, shares = chosen
    factor = np.exp(2j * np.pi * frequency * channel.delay)[:, None]
    if channel.is_corrected:
        factor = factor / low_pass(frequency, channel.bandwidth)[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        h1, h2 = factor * g_xy / g_xx[:, None], factor * g_yy / np.conj(g_xy)
        coherence = np.clip(np.abs(g_xy) ** 2 / (g_xx[:, None] * g_yy), 0.0, 1.0)
    noise = np.full(g_yy.shape[1], np.nan) if channel.deviation is None else channel.deviation
    gain = np.abs(factor) ** 2
    density = gain * noise_spectrum(frequency, noise, rate, channel.bandwidth)
    return FrequencyResponse(
        frequency, h1, h2, coherence, g_xx, gain * g_yy, density, rate, averages,
        len(options.starts), left_out, rate / length, input_share, channel.is_corrected,
        period / rate,
        multiple_coherence=1 - (1 - coherence) * shares if others.size else None,
    )  # fmt: skip


def choose_segments(
    stretches: Stretches, resolution: float | None, period: int, others: int
) -> tuple[SegmentOptions, float, int]:
    """Choose the segments, and return with them the number of independent averages less one
    for each other input, and the number of segments that gaps prevent.

    period: of the input, samples; 0 if it has none.
    """
    from scipy.signal import get_window

    rate = stretches.rate
    longest = int((stretches.stops - stretches.starts).max(initial=0))
    if longest < MIN_SEGMENT_SAMPLES:
        raise InputError(
            f"gaps cut the rows into parts of {longest} samples at most; a segment needs "
            f"{MIN_SEGMENT_SAMPLES}. Record without gaps"
        )
    length = segment_length(stretches, resolution, period)
    if length < MIN_SEGMENT_SAMPLES:
        raise InputError(
            f"a resolution of {resolution:g} Hz leaves {length} samples in a segment; allowed: up "
            f"to {rate / MIN_SEGMENT_SAMPLES:.4g} Hz at {rate:.6g} samples per second"
        )
    window = get_window("boxcar" if period else "hann", min(length, longest))
    hop = length if period else length // 2
    starts = segment_starts(stretches, length, hop)
    count = sum(map(len, starts))
    averages = (count if period else count_averages(starts, window)) - others
    if averages < 2:
        raise InputError(
            f"there are {averages:.3g} averages of segments of {length / rate:.4g} s, too few for "
            f"a coherence (the longest part without a gap has {longest / rate:.4g} s); allowed: 2 "
            "or more. Record for longer, or give a larger --resolution-hz"
        )
    possible = max(0, (stretches.span - length) // hop + 1)
    detrend = "constant" if period else "linear"
    options = SegmentOptions(np.concatenate(starts), window, rate, detrend)
    return options, float(averages), max(0, possible - count)


class SegmentOptions(NamedTuple):
    """How segments are transformed.  starts: their first rows.  detrend: "constant" or "linear"."""

    starts: Integers
    window: Floats
    rate: float
    detrend: str


class Spectra(NamedTuple):
    """Densities at frequencies (m,) of an input (m,), of it and each output (m, d), and of the
    outputs (m, d).  input_share: (m,) as in `FrequencyResponse`.  shares: (m, d) of the outputs'
    power that do not go with other inputs."""

    frequency: Floats
    g_xx: Floats
    g_xy: Complexes
    g_yy: Floats
    input_share: Floats
    shares: Floats


def separate_spectra(inputs: Floats, outputs: Floats, options: SegmentOptions) -> Spectra:
    """Average the spectra of the first of the inputs (n, q) and of the outputs (n, d), and remove
    from both the parts due to the other inputs."""
    q = inputs.shape[1]
    cross, autos, input_share = average_spectra(np.column_stack([inputs, outputs]), q, options)
    power = autos[:, 0]
    rest, chosen = cross[:, 1:, 1:q], np.delete(cross[:, 1:], np.arange(1, q), axis=2)
    try:  # of the first input and the outputs, over each other input
        parts = np.linalg.solve(rest, chosen)
    except np.linalg.LinAlgError:
        raise InputError(INSEPARABLE) from None
    taken = (chosen.conj() * parts).sum(axis=1).real  # of the powers, by the other inputs
    g_xx = power - taken[:, 0]
    excited = power >= EXCITED_SHARE * power.max()
    if np.median(g_xx[excited] / power[excited]) < SEPARATE_SHARE:
        raise InputError(INSEPARABLE)
    g_xy = cross[:, 0, q:] - np.einsum("mr,mrd->md", chosen[:, :, 0].conj(), parts[:, :, 1:])
    g_yy = autos[:, q:] - taken[:, 1:]
    frequency = np.asarray(np.fft.rfftfreq(len(options.window), 1 / options.rate), np.float64)
    with np.errstate(invalid="ignore"):  # an output may be zero in all rows
        return Spectra(frequency, g_xx, g_xy, g_yy, input_share, g_yy / autos[:, q:])


def average_spectra(
    signals: Floats, inputs: int, options: SegmentOptions
) -> tuple[Complexes, Floats, Floats]:
    """Average the densities of signals (n, d), of which the first `inputs` are inputs.

    Returns the cross densities (m, inputs, d) of each input with each signal, the densities (m, d)
    of each signal, and `FrequencyResponse.input_share` (m,) of the first input.
    """
    count, length = len(options.starts), len(options.window)
    sums: list[Any] = [0.0, 0.0, 0.0]
    energy: list[Floats] = []
    for part in np.array_split(options.starts, -(-count // SEGMENTS_AT_ONCE)):
        spectra = segment_spectra(signals, options._replace(starts=part))
        powers = np.abs(spectra) ** 2
        cross = np.einsum("kmi,kmd->mid", spectra[:, :, :inputs].conj(), spectra)
        values = cross, powers.sum(axis=0), (powers[:, :, 0] ** 2).sum(axis=0)
        sums = [total + some for total, some in zip(sums, values, strict=True)]
        energy.append(powers[:, :, 0].sum(axis=1))
    sides = np.full((length // 2 + 1, 1), 2.0)  # but at zero, and at half the rate
    sides[0] = 1.0
    if length % 2 == 0:
        sides[-1] = 1.0
    scale = sides / (options.rate * (options.window**2).sum() * count)
    each = np.concatenate(energy)
    segments = each.sum() ** 2 / (each**2).sum()
    input_share = sums[1][:, 0] ** 2 / np.maximum(sums[2], 1e-300) / segments
    return scale[:, None] * sums[0], scale * sums[1], input_share


def segment_spectra(signals: Floats, options: SegmentOptions) -> Complexes:
    """Fourier transforms (k, m, d) of the segments of signals (n, d), without their straight lines
    or means and under the window."""
    from scipy.signal import detrend

    pieces = signals[options.starts[:, None] + np.arange(len(options.window))]
    pieces = detrend(pieces, axis=1, type=options.detrend) * options.window[:, None]
    return np.asarray(np.fft.rfft(pieces, axis=1))


def response_table(response: FrequencyResponse) -> dict[str, Floats]:
    """The responses as columns, in the units of their form: a row for each frequency."""
    columns: dict[str, Floats] = {
        "frequency_hz": response.frequency,
        "input_density": response.input_density,
        "excited": response.is_excited.astype(np.float64),
    }
    several = response.multiple_coherence
    for n, axis in enumerate(POSE):
        unit, scale = response.form.unit_of(axis), response.form.factor(axis)
        columns |= {
            f"h1_{axis}_real_{unit}": scale * response.h1[:, n].real,
            f"h1_{axis}_imag_{unit}": scale * response.h1[:, n].imag,
            f"h2_{axis}_real_{unit}": scale * response.h2[:, n].real,
            f"h2_{axis}_imag_{unit}": scale * response.h2[:, n].imag,
            f"u_h1_{axis}_{unit}": scale * response.uncertainty[:, n],
            f"coherence_{axis}": response.coherence[:, n],
            **({} if several is None else {f"multiple_coherence_{axis}": several[:, n]}),
            f"noise_{axis}_{unit}": scale * response.noise_floor[:, n],
        }
    return columns
