"""Compare a recording's noise, for every reading and pose axis, with the configured model."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.errors import InputError
from ..core.names import READING_COLUMNS, STATE_COLUMNS
from ..core.units import Floats
from ..detectors.noise import standard_deviations
from ..files.columns import row_times
from .allan import Allan, allan
from .noise_model import MIN_SAMPLES, NoiseModel, fit_lines, fit_noise
from .rest import Columns, RecordingSection, find_faults

if TYPE_CHECKING:
    from ..core.settings import Config

#: Columns of the report, each with the factor to the unit in which it is shown, and this unit.
CHANNELS = {
    **{name: (1e3, "um" if name.endswith("mm") else "uW") for name in READING_COLUMNS},
    **{name: (1e3, "um" if name.endswith("mm") else "urad") for name in STATE_COLUMNS[:6]},
}
#: Largest number of samples that are used, from the beginning: seven minutes at 10 kHz.
MAX_SAMPLES = 1 << 22
#: Two noises are reported as correlated above this correlation, and above this many standard
#: deviations of the correlation of independent noise.
MIN_CORRELATION, CORRELATION_SIGMAS = 0.1, 5.0
#: A jump of the time by more than this many samples ends a section.
JUMP_SAMPLES = 100


@dataclass(frozen=True)
class Channel:
    """The noise of one column.  unit: of all its numbers.  signal: (n,) evenly spaced samples.
    configured: standard deviation of a sample by the configuration."""

    name: str
    unit: str
    signal: Floats
    model: NoiseModel
    allan: Allan
    configured: float


@dataclass(frozen=True)
class NoiseReport:
    """The noise of a recording.

    rate: of sampling, Hz.  seconds: length of the section.  samples, missing: numbers of samples
    recorded and lost in it.  correlation: (9, 9) of the readings' fast noise.

    faults: sentences with evidence against a mirror at rest in steady light; with any of them the
    numbers do not represent noise.  position, at_power, power: noise of the simple model, mm at a
    power in mW, and mW.  common: standard deviation of the laser's power, as a fraction.
    """

    rate: float
    seconds: float
    samples: int
    missing: int
    channels: list[Channel]
    correlation: Floats
    position: float
    at_power: float
    power: float
    common: float
    faults: list[str]

    @property
    def noise_pairs(self) -> list[tuple[str, str, float]]:
        """Pairs of positions on different detectors whose noises are correlated beyond chance, with
        the correlation, the largest first. Powers are omitted, because the laser's noise correlates
        them."""
        limit = max(MIN_CORRELATION, CORRELATION_SIGMAS / np.sqrt(self.samples))
        places = [n for n, name in enumerate(READING_COLUMNS) if not name.startswith("power")]
        pairs = [
            (READING_COLUMNS[i], READING_COLUMNS[j], float(self.correlation[i, j]))
            for i, j in combinations(places, 2)
            if i // 3 != j // 3 and abs(self.correlation[i, j]) > limit
        ]
        return sorted(pairs, key=lambda pair: -abs(pair[2]))

    def channel(self, name: str) -> Channel:
        return next(channel for channel in self.channels if channel.name == name)


def report_of(
    columns: Columns,
    config: Config,
    name: str,
    on_progress: Callable[[int, int], None] = lambda *_: None,
) -> NoiseReport:
    """Estimate the noise of a recording from the columns of `live.pose_table`.

    name: name of the recording, for messages.  on_progress: called with the number of finished
    channels and their total. Raises `InputError` if the recording has too few samples.
    """
    piece = longest_section(columns, name)
    rows, rate = piece.rows, piece.rate
    channels = []
    readings = np.stack([columns[column][rows] for column in READING_COLUMNS], axis=1)
    for n, (column, (scale, unit)) in enumerate(CHANNELS.items()):
        on_progress(n, len(CHANNELS))
        signal = scale * piece.resample(columns[column])
        try:
            model = fit_noise(signal, rate)
        except ValueError as error:
            raise InputError(f"{name}: {column}: {error}") from None
        stated = configured_deviation(column, columns, rows, readings, config) * scale
        channels.append(Channel(column, unit, signal, model, allan(signal, rate), stated))
    by_name = {channel.name: channel for channel in channels}
    position, at_power = position_noise(by_name, readings, config)
    power, common = power_noise(by_name, readings)
    faults = find_faults(columns, piece, [channel.model for channel in channels[:9]], config)
    missing = int(piece.seq[-1] - piece.seq[0]) + 1 - len(piece.seq)
    return NoiseReport(
        rate, float(piece.seq[-1] - piece.seq[0]) / rate, len(piece.seq), missing, channels,
        correlation(readings), position, at_power, power, common, faults,
    )  # fmt: skip


def longest_section(columns: Columns, name: str) -> RecordingSection:
    """Find the longest section without a jump of the time; at most its first MAX_SAMPLES samples.

    name: name of the recording, for messages. Raises `InputError` if it has too few samples.
    """
    if not columns or len(columns["seq"]) < MIN_SAMPLES:
        raise InputError(f"{name}: holds less than {MIN_SAMPLES} samples, too few for their noise")
    times = row_times(columns)
    durations, steps = np.diff(times), np.diff(columns["seq"])
    usual = float(np.median(durations / steps))
    ends = np.flatnonzero(durations > usual * (steps + JUMP_SAMPLES)) + 1
    starts = np.concatenate([[0], ends])
    stops = np.concatenate([ends, [len(columns["seq"])]])
    n = int(np.argmax(stops - starts))
    rows = slice(int(starts[n]), int(min(stops[n], starts[n] + MAX_SAMPLES)))
    seq, time = columns["seq"][rows], times[rows]
    if len(seq) < MIN_SAMPLES:
        raise InputError(
            f"{name}: holds less than {MIN_SAMPLES} samples without a gap, too few for their noise"
        )
    return RecordingSection(rows, seq, float((seq[-1] - seq[0]) / (time[-1] - time[0])))


def configured_deviation(
    name: str, columns: Columns, rows: slice, readings: Floats, config: Config
) -> float:
    """Standard deviation of one sample by the configuration, in the column's unit; NaN if no row
    has numbers for it.  readings: (n, 9) of the rows, mm and mW."""
    if name in READING_COLUMNS:
        is_complete = np.isfinite(readings).all(axis=1)
        if not is_complete.any():
            return float("nan")
        deviations = standard_deviations(config.sensor, readings[is_complete].mean(axis=0))
        return float(deviations[READING_COLUMNS.index(name)])
    total = columns[f"u_{name}"]  # At rest, the calibration's part does not scatter.
    stated = columns.get(f"u_noise_{name}", total)[rows]
    return float(np.nanmean(stated)) if np.isfinite(stated).any() else float("nan")


def correlation(readings: Floats) -> Floats:
    """Correlation (9, 9) of the readings' changes between successive samples."""
    steps = np.diff(readings[np.isfinite(readings).all(axis=1)], axis=0)
    return np.asarray(np.corrcoef(steps.T), dtype=np.float64)


def position_noise(
    channels: dict[str, Channel], readings: Floats, config: Config
) -> tuple[float, float]:
    """Noise of a position by the simple model, mm, and the power at which it holds, mW."""
    at_power = config.sensor.noise.at_power
    parts = [
        1e-3 * channels[name].model.standard_deviation
        * float(np.nanmean(readings[:, 3 * (n // 3) + 2])) / at_power
        for n, name in enumerate(READING_COLUMNS) if n % 3 != 2
    ]  # fmt: skip
    return float(np.sqrt(np.mean(np.square(parts)))), at_power


def power_noise(channels: dict[str, Channel], readings: Floats) -> tuple[float, float]:
    """Noise of a single power, mW, and noise common to the three powers, as a fraction of them."""
    powers = readings[:, 2::3]
    powers = powers[np.isfinite(powers).all(axis=1)]
    mean = powers.mean(axis=0)
    rest = fit_lines(powers / mean, np.arange(float(len(powers))))[1]
    covariance = np.cov(rest.T)
    common = max(0.0, float((covariance.sum() - np.trace(covariance)) / 6))
    variances = np.array([
        (1e-3 * channels[name].model.standard_deviation) ** 2 - common * mean[n] ** 2
        for n, name in enumerate(READING_COLUMNS[2::3])
    ])  # fmt: skip
    floor = np.diagonal(covariance) * mean**2 * 1e-6
    return float(np.sqrt(np.mean(np.maximum(variances, floor)))), float(np.sqrt(common))


def noise_block(report: NoiseReport) -> dict[str, Any]:
    """The block `sensor.noise` with the estimated noise, by the simple model."""
    return {
        "model": "simple",
        "position_um": float(f"{1e3 * report.position:.4g}"),
        "at_power_mw": report.at_power,
        "power_uw": float(f"{1e3 * report.power:.4g}"),
    }


HEADINGS = (
    "channel", "unit", "white_per_rthz", "white_low", "white_high", "flicker_at_1hz_per_rthz",
    "flicker_low", "flicker_high", "drift_per_s", "drift_low", "drift_high", "sigma_white",
    "sigma", "sigma_configured", "spikes", "filled_percent", "lines",
)  # fmt: skip


def table_of(report: NoiseReport) -> dict[str, list[Any]]:
    """Columns of the noise table, with a row per channel, in its unit; amplitude densities and the
    drift have 95 % intervals."""
    rows = []
    for channel in report.channels:
        model = channel.model
        ends = [np.sqrt(np.maximum(0.0, part.interval)) for part in (model.white, model.flicker)]
        lines = "; ".join(
            f"{line.frequency:.3f} Hz {line.amplitude.value:.3g} +- "
            f"{line.amplitude.interval[1] - line.amplitude.value:.2g} ({line.name})"
            for line in model.lines
        ).replace(",", "")
        rows.append([
            channel.name, channel.unit, np.sqrt(model.white.value), *ends[0],
            np.sqrt(model.flicker.value), *ends[1], model.drift.value, *model.drift.interval,
            model.white_deviation, model.standard_deviation, channel.configured, model.spikes,
            100 * model.filled, lines,
        ])  # fmt: skip
    return {
        name: list(column) for name, column in zip(HEADINGS, zip(*rows, strict=True), strict=True)
    }
