"""Estimate frequency response functions from a measured input and measured motions (Welch).

With G the one-sided auto- and cross-spectral densities of the input x and an output y, averaged
over overlapping segments under a Hann window,

    H1 = G_xy / G_xx,   H2 = G_yy / G_yx,   coherence = |G_xy|^2 / (G_xx G_yy).

Noise of the output leaves H1 unbiased and makes H2 too large; noise of the input makes H1 too
small. The random error of |H| (Bendat and Piersol, Random Data, 4th edition, section 9.2) is

    sigma(|H|) / |H| = sqrt((1 - coherence) / (2 coherence n)),

with n averages; the phase has the same error in rad. Here n - 1 replaces n, because the incoherent
part of the output is itself estimated from the n averages, of which the response takes one degree
of freedom. Overlapping segments share samples: n is the number of independent segments that would
give the same variance.

With several inputs, the response to each of them is estimated from conditioned spectra (ibid.,
chapter 7): spectra of this input and of the outputs after the parts due to the other inputs are
removed. H1, H2 and the coherence, then called partial, follow from these as above, with n reduced
by one for each other input. The multiple coherence is the fraction of an output's power that is due
to all inputs together.
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

#: Number of averages for which the default segment length is chosen.
DEFAULT_AVERAGES = 32.0
#: Shortest segment, samples.
MIN_SEGMENT_SAMPLES = 64
#: Number of the lowest lines that are excluded: removing each segment's straight line changes them.
SKIPPED_LINES = 2
#: A time step that differs from the usual one by more than this fraction is a gap or a repetition.
STEP_TOLERANCE = 0.5
#: The times are uneven if the steps scatter by more than this fraction of a step.
LARGEST_JITTER = 0.1
#: The input does not excite a line if its density is below this fraction of the largest.
EXCITED_FRACTION = 1e-4
#: An input is periodic if its correlation with itself a period later is at least this.
PERIODIC_CORRELATION = 0.98
#: Responses to several inputs are separated if at least this fraction of an input's power is
#: independent of the others, in the median line.
SEPARATE_FRACTION = 1e-3
INSEPARABLE = (
    "an input follows the other inputs at most frequencies (coherence above "
    f"{1 - SEPARATE_FRACTION:g}), so that their responses cannot be distinguished; drive the body "
    "by forces that are independent of each other, or name one input"
)
#: The input passes through the frequencies (a sweep) if a line has input in less than this fraction
#: of the segments with any input; the fraction is a half for a random input.
SWEEP_FRACTION = 0.25
#: Number of segments that are transformed at once, which bounds the memory.
SEGMENTS_AT_ONCE = 64


class Stretches(NamedTuple):
    """Stretches of evenly spaced samples without a gap.

    rate: of sampling, Hz.  starts, stops: (k,) first row of each stretch, and the row after its
    last.  span: number of samples from the first row to the last, missing ones included.  unsolved:
    number of rows without a pose or an input.
    """

    rate: float
    starts: Integers
    stops: Integers
    span: int
    unsolved: int


class OutputChannel(NamedTuple):
    """Properties of the measurement of the outputs.

    deviation: (d,) standard deviations of the outputs' own noise in one sample, None if unknown.
    bandwidth: of the electronics' low pass of the first order, Hz.  is_corrected: whether responses
    are divided by its transmission.  delay: time by which the stimulus was sampled later than the
    outputs of the same row, s; it is corrected.
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

    frequency: (m,) Hz.  h1, h2: (m, d) complex, unit of the output per unit of the input.
    coherence: (m, d).  input_density: (m,), output_density: (m, d), unit^2/Hz.  noise_density: (m,
    d) density of the outputs' own noise, NaN if unknown.  averages: number of independent averages.
    segments: number of segments.  left_out: number of segments that gaps prevented.  resolution:
    distance of lines, Hz.

    input_share: (m,) number of segments with input at a line, over the number with any input; both
    are numbers of equal segments whose mean would scatter as much.  is_corrected: whether the
    electronics' low pass is divided out, also of the densities of outputs and noise.  period: of a
    periodic input, s, at whose lines alone the responses are given; else 0.  form: of h1 and h2;
    densities are always of displacements.  multiple_coherence: (m, d) of an output with all inputs,
    None for a single input. With several, the input, the outputs, h1, h2 and the coherence exclude
    the parts due to the other inputs.
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
        """Relative standard uncertainty of |H| (m, d), and standard uncertainty of the phase, rad;
        NaN if the input is not stationary, because segments then differ not only by chance."""
        error: Floats = np.sqrt((1 - self.coherence) / (self.coherence * self.freedom))
        return error if self.is_stationary else np.full_like(error, np.nan)

    @property
    def mean_input_share(self) -> float:
        """Mean `input_share`, weighted by the input's density, because lines without input have
        leakage and noise in all segments."""
        return float(np.average(self.input_share, weights=self.input_density))

    @property
    def is_stationary(self) -> bool:
        """Whether all lines have input at the same time instead of one after the other."""
        return self.mean_input_share >= SWEEP_FRACTION

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
        """Root mean square |H1| (m, d) that the outputs' own noise alone would cause, in the
        response's form."""
        floor = np.sqrt(self.noise_density / self.input_density[:, None] / self.averages)
        return np.abs(self.form.convert(self.frequency, floor))

    @property
    def significant_coherence(self) -> float:
        """Coherence that an output independent of the input exceeds by chance in 0.1 % of the
        lines."""
        return float(1 - 0.001 ** (1 / max(self.averages - 1, 1e-9)))

    @property
    def is_excited(self) -> Booleans:
        """Whether the input has power at each line (m,)."""
        lines: Booleans = self.input_density >= EXCITED_FRACTION * self.input_density.max()
        return lines

    def to_frame(self) -> DataFrame:
        """Return the columns of `response_table` as a pandas data frame."""
        return make_frame(response_table(self))


def find_stretches(time: Floats, usable: Booleans, name: str) -> Stretches:
    """Find the stretches of rows without a gap.

    time: (n,) s.  usable: (n,) whether a row has a pose and an input.  name: name of the data, for
    messages. Raises `InputError` for too few rows, and for times that do not ascend or are uneven.
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
    """Find the period of an input (n,), in samples, by its autocorrelation; 0 if there is none.

    At least two periods must lie in the longest stretch.
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
    max_lag = len(x) // 2
    products = correlate(x, x, method="fft")[len(x) - 1 :][: max_lag + 1]
    power = np.concatenate([[0.0], np.cumsum(x**2)])
    lags = np.arange(max_lag + 1)
    scale = np.sqrt(power[len(x) - lags] * (power[-1] - power[lags]))
    correlation = products / np.maximum(scale, 1e-300)
    begin = int(np.argmax(correlation < PERIODIC_CORRELATION / 2))
    if not begin or correlation[begin:].max() < PERIODIC_CORRELATION:
        return 0
    threshold = correlation[begin:].max() - (1 - PERIODIC_CORRELATION) / 10
    first = begin + int(np.argmax(correlation[begin:] >= threshold))
    peak = correlation[first : first + 1 + max(2, first // 100)]
    return first + int(np.argmax(peak))


def segment_starts(stretches: Stretches, length: int, hop: int | None = None) -> list[Integers]:
    """First rows of segments of `length` rows, by stretch.

    hop: rows from one segment's begin to the next; None: half the length.
    """
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
    overlaps = [(product / float(window @ window)) ** 2 for product in products]
    count = sum(len(values) for values in starts)
    pairs = sum(
        2 * overlap * max(len(values) - n, 0)
        for values in starts
        for n, overlap in enumerate(overlaps, 1)
    )
    return count**2 / (count + pairs) if count else 0.0


def choose_length(stretches: Stretches) -> int:
    """Choose a segment length, samples, for about `DEFAULT_AVERAGES` averages; with gaps, it is
    shorter if this leaves fewer than half of them."""
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
    """Segment length, samples, for a resolution in Hz, or chosen if None.

    period: of the input, samples, of which a segment holds a whole number; 0: none. Raises
    `InputError` for a resolution that is not positive.
    """
    if resolution is not None and not 0 < resolution < np.inf:
        raise InputError(f"a resolution of {resolution:g} Hz is none; allowed: above 0")
    if not period:
        return (
            choose_length(stretches) if resolution is None else round(stretches.rate / resolution)
        )
    periods = round(stretches.rate / resolution / period) if resolution else 1
    return period * max(periods, -(-MIN_SEGMENT_SAMPLES // period))


def noise_spectrum(frequency: Floats, deviation: Floats, rate: float, bandwidth: float) -> Floats:
    """One-sided densities (m, d) of sampled noise with standard deviations (d,), unit^2/Hz.

    frequency: (m,) Hz.  rate: of sampling, Hz.  bandwidth: corner of the low pass of the first
    order that the white noise passes before it is sampled, Hz; far above the rate, the samples'
    noise is white. Aliases are included.
    """
    memory = np.exp(-2 * np.pi * bandwidth / rate)
    shape = (1 - memory**2) / (1 - 2 * memory * np.cos(2 * np.pi * frequency / rate) + memory**2)
    density: Floats = 2 / rate * shape[:, None] * deviation**2
    return density


def low_pass(frequency: Floats, bandwidth: float) -> Complexes:
    """Complex transmission (m,) of a low pass of the first order at frequencies (m,), Hz.

    bandwidth: its corner, Hz.
    """
    return np.asarray(1 / (1 + 1j * frequency / bandwidth))


def estimate_response(
    stimulus: Floats,
    outputs: Floats,
    stretches: Stretches,
    resolution: float | None = None,
    channel: OutputChannel = PERFECT_CHANNEL,
    others: Floats | None = None,
) -> FrequencyResponse:
    """Estimate the responses of outputs (n, d) to a stimulus (n,) in the rows of `stretches`.

    resolution: distance of lines, Hz; chosen for about 32 averages if None.  channel: properties of
    the outputs' measurement.  others: (n, q) other inputs, whose contributions are removed. Raises
    `InputError` for fewer than two averages, an input that is constant, or a stimulus that follows
    the other inputs.
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
    if period:  # Other lines have neither input nor leakage, only noise.
        power = spectra.g_xx[1:]
        lines = 1 + np.flatnonzero(power >= EXCITED_FRACTION * power.max())
    chosen = Spectra(*(values[lines] for values in spectra))  # type: ignore[arg-type]
    frequency, g_xx, g_xy, g_yy, input_share, independent = chosen
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
        multiple_coherence=1 - (1 - coherence) * independent if others.size else None,
    )  # fmt: skip


def choose_segments(
    stretches: Stretches, resolution: float | None, period: int, others: int
) -> tuple[SegmentOptions, float, int]:
    """Choose the segments.

    Returns them with the number of independent averages, reduced by `others`, and the number of
    segments that gaps prevent.  resolution: Hz.  period: of the input, samples; 0: none.  others:
    number of other inputs. Raises `InputError` for fewer than two averages, or too short segments.
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
    """Segments and their transform.  starts: (k,) first rows.  window: (length,) weights.  rate:
    of sampling, Hz.  detrend: "constant" or "linear", the part that is removed."""

    starts: Integers
    window: Floats
    rate: float
    detrend: str


class Spectra(NamedTuple):
    """Spectral densities at frequencies (m,), Hz.

    g_xx: (m,) of the input.  g_xy: (m, d) cross densities of input and outputs.  g_yy: (m, d) of
    the outputs.  input_share: (m,) as in `FrequencyResponse`.  independent: (m, d) fraction of an
    output's power that is independent of the other inputs.
    """

    frequency: Floats
    g_xx: Floats
    g_xy: Complexes
    g_yy: Floats
    input_share: Floats
    independent: Floats


def separate_spectra(inputs: Floats, outputs: Floats, options: SegmentOptions) -> Spectra:
    """Average the spectra of the first of the inputs (n, q) and of the outputs (n, d), and remove
    the parts due to the other inputs from both.

    Raises `InputError` if the first input follows the others, or these follow each other.
    """
    q = inputs.shape[1]
    cross, autos, input_share = average_spectra(np.column_stack([inputs, outputs]), q, options)
    power = autos[:, 0]
    rest, chosen = cross[:, 1:, 1:q], np.delete(cross[:, 1:], np.arange(1, q), axis=2)
    try:  # responses of the first input and of the outputs to the other inputs
        parts = np.linalg.solve(rest, chosen)
    except np.linalg.LinAlgError:
        raise InputError(INSEPARABLE) from None
    explained = (chosen.conj() * parts).sum(axis=1).real  # powers due to the other inputs
    g_xx = power - explained[:, 0]
    excited = power >= EXCITED_FRACTION * power.max()
    if np.median(g_xx[excited] / power[excited]) < SEPARATE_FRACTION:
        raise InputError(INSEPARABLE)
    g_xy = cross[:, 0, q:] - np.einsum("mr,mrd->md", chosen[:, :, 0].conj(), parts[:, :, 1:])
    g_yy = autos[:, q:] - explained[:, 1:]
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
        sums = [total + value for total, value in zip(sums, values, strict=True)]
        energy.append(powers[:, :, 0].sum(axis=1))
    sides = np.full((length // 2 + 1, 1), 2.0)  # 1 only at zero and at half the rate
    sides[0] = 1.0
    if length % 2 == 0:
        sides[-1] = 1.0
    scale = sides / (options.rate * (options.window**2).sum() * count)
    energies = np.concatenate(energy)
    segments = energies.sum() ** 2 / (energies**2).sum()
    input_share = sums[1][:, 0] ** 2 / np.maximum(sums[2], 1e-300) / segments
    return scale[:, None] * sums[0], scale * sums[1], input_share


def segment_spectra(signals: Floats, options: SegmentOptions) -> Complexes:
    """Fourier transforms (k, m, d) of the segments of signals (n, d), after their means or straight
    lines are removed and the window is applied."""
    from scipy.signal import detrend

    pieces = signals[options.starts[:, None] + np.arange(len(options.window))]
    pieces = detrend(pieces, axis=1, type=options.detrend) * options.window[:, None]
    return np.asarray(np.fft.rfft(pieces, axis=1))


def response_table(response: FrequencyResponse) -> dict[str, Floats]:
    """Columns of a response in the units of its form, with a row for each frequency."""
    columns: dict[str, Floats] = {
        "frequency_hz": response.frequency,
        "input_density": response.input_density,
        "excited": response.is_excited.astype(np.float64),
    }
    multiple = response.multiple_coherence
    for n, axis in enumerate(POSE):
        unit, scale = response.form.unit_of(axis), response.form.factor(axis)
        columns |= {
            f"h1_{axis}_real_{unit}": scale * response.h1[:, n].real,
            f"h1_{axis}_imag_{unit}": scale * response.h1[:, n].imag,
            f"h2_{axis}_real_{unit}": scale * response.h2[:, n].real,
            f"h2_{axis}_imag_{unit}": scale * response.h2[:, n].imag,
            f"u_h1_{axis}_{unit}": scale * response.uncertainty[:, n],
            f"coherence_{axis}": response.coherence[:, n],
            **({} if multiple is None else {f"multiple_coherence_{axis}": multiple[:, n]}),
            f"noise_{axis}_{unit}": scale * response.noise_floor[:, n],
        }
    return columns
