"""Read the table of readings and reference poses of a calibration, and make tables of results."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.names import (
    ANGLES,
    DETECTORS,
    READING_COLUMNS,
    STATE_COLUMNS,
    STATE_UNITS,
    TEMPERATURE_COLUMN,
)
from ..core.sensor import MONOMIALS, Sensor
from ..core.units import Floats
from ..detectors.calibrated import TEMPERATURE
from ..estimation.dwells import LARGEST_DISTANCE, MIN_ROWS, Dwells, dwell_means
from ..estimation.table import BEAM_UNCERTAINTIES, require_known_beam
from ..files import tables
from ..files.columns import join_columns
from ..model.arrays import EFFECTS
from ..model.beam_shape import SHAPE
from .alternatives.scatter import covariance_factor
from .fitting.bundle_adjustment import Data
from .fitting.fit import Fit
from .fitting.unknowns import (
    BACKLASH,
    CLOCKS,
    DRIFTS,
    LAG,
    MOUNTING,
    OF_SENSOR,
    PLACE,
    POWER_DRIFT,
    SKEW,
    Choice,
    block,
    fold_mount,
    values_of,
)  # fmt: skip

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from ..core.calibrate import Calibrate
    from ..core.sensor import Psd


#: Columns of the reference's pose, one for each axis that it measures.
REFERENCE = tuple(f"ref_{name}" for name in STATE_COLUMNS[:6])
BEAM = STATE_COLUMNS[6:]
#: Time over which a board's clock is taken to be uniform, and interval at which it is compared, s.
CLOCK_WINDOW_S, CLOCK_STEP_S = 10.0, 0.05
#: Columns of a sample's time and temperature.
RUN = ("time_s", TEMPERATURE_COLUMN)


def read(path: Path, settings: Calibrate) -> Data:
    """Read a table with readings and the columns of `REFERENCE`.

    Optional columns are `bx_mm` and `by_mm` of a moving beam, `time_s` and `temperature_c`.
    Raises `InputError` if a column is missing for an axis whose uncertainty is given, or if the
    beam's position is an estimate.
    """
    return gather_samples(path, read_columns(path, settings), settings)


def read_columns(path: Path, settings: Calibrate) -> dict[str, Floats]:
    """Read the columns of `read`, (rows,) each. Raises `InputError` if some are missing."""
    of_beam = () if settings.beam == "still" else (*BEAM, *BEAM_UNCERTAINTIES)
    measured = [n for n in range(6) if np.isfinite(settings.reference[n])]
    needed = (*READING_COLUMNS, *(REFERENCE[n] for n in measured))
    optional = (*of_beam, *RUN, *(REFERENCE[n] for n in range(6) if n not in measured))
    try:
        return whole_table(path, needed, optional)
    except tables.MissingColumnsError as error:
        if set(error.names).isdisjoint(REFERENCE):
            raise
        raise InputError(
            f"{error}. These are the reference's poses: write them beside the readings, or give "
            "their own table with --reference"
        ) from None


def whole_table(
    path: Path, needed: tuple[str, ...], optional: tuple[str, ...]
) -> dict[str, Floats]:
    """Read columns of a table into memory; where `time_s` is missing, the times of a recording
    replace it. Raises `InputError` if the table is empty or lacks a needed column."""
    chunks = []
    others = tuple(name for name in needed if name != "time_s")
    times = ("time_s", "host_s", "board_us")
    for chunk in tables.read_chunks(path, others, (*optional, *times), tables.CHUNK):
        if "time_s" in needed and not {"time_s", "host_s"} & set(chunk.columns):
            raise InputError(f"{path}: missing columns: time_s (or host_s, a recording's)")
        require_known_beam(path, chunk, "say `calibrate: {beam: still}` if the laser stood still")
        chunks.append(chunk.columns)
    if not chunks:
        raise InputError(f"{path}: no rows; a calibration needs 10 at least")
    columns = join_columns(chunks)
    host, board = columns.pop("host_s", None), columns.pop("board_us", None)
    if host is not None and "time_s" not in columns:
        columns["time_s"] = host if board is None else recording_time(host, 1e-6 * board)
    return columns


def recording_time(host: Floats, board: Floats) -> Floats:
    """Times (n,) of samples, s: `host`, without the momentary delays of a busy machine.

    board: the board's clock, s, which hardly drifts within CLOCK_WINDOW_S: the difference of both
    clocks is replaced by its median over this time. Where the board's clock does not increase, the
    result is `host`.
    """
    if len(host) < 2 or not (np.isfinite(host) & np.isfinite(board)).all():
        return host
    if (np.diff(board) <= 0).any():
        return host
    from scipy.ndimage import median_filter

    knots = np.arange(board[0], board[-1], CLOCK_STEP_S)
    difference = (host - board)[np.searchsorted(board, knots)]
    size = int(CLOCK_WINDOW_S / CLOCK_STEP_S)
    time: Floats = board + np.interp(board, knots, median_filter(difference, size, mode="reflect"))
    return time


def gather_samples(path: Path, columns: dict[str, Floats], settings: Calibrate) -> Data:
    """Make samples from columns, without rows that lack a pose or any reading.

    columns: (rows,) each. Raises `InputError` if fewer than 10 remain.
    """
    count = len(next(iter(columns.values())))

    def stack(names: tuple[str, ...]) -> Floats:
        """The columns of these names side by side, (rows, names); zeros for one that is missing."""
        return np.column_stack([columns.get(name, np.zeros(count)) for name in names])

    noise = rows = None
    if settings.dwells:
        columns, noise, rows = averaged_columns(path, columns, settings)
        count = len(noise)
    raw, pose, beam = stack(READING_COLUMNS), stack(REFERENCE) * STATE_UNITS[:6], stack(BEAM)
    good = np.asarray(np.isfinite(np.hstack([pose, beam])).all(axis=1))
    good &= np.isfinite(raw).any(axis=1)
    if good.sum() < 10:
        raise InputError(f"{path}: {int(good.sum())} whole rows; a calibration needs 10 at least")
    velocity = acceleration = None
    if "time_s" in columns and noise is None:
        velocity, acceleration = time_derivatives(columns["time_s"][good], pose[good])
    return Data(
        raw[good],
        pose[good],
        np.array(settings.reference),
        beam[good],
        velocity=velocity,
        acceleration=acceleration,
        noise=None if noise is None else noise[good],
        clock=clock(columns, good),
        pasts=pasts(columns, good),
        rows=None if rows is None else rows[good],
        number=np.flatnonzero(good) + 1,
        temperature=float(np.nanmean(columns[TEMPERATURE_COLUMN][good]))
        if TEMPERATURE_COLUMN in columns
        else None,
    )


def averaged_columns(
    path: Path, columns: dict[str, Floats], settings: Calibrate
) -> tuple[dict[str, Floats], Floats, Floats]:
    """Means of the columns over each dwell of the reference, the noise (dwells, 9) of the mean
    readings, and the numbers (dwells,) of rows in them.

    Raises `InputError` where the reference has fewer than ten dwells.
    """
    dwells = find_reference_dwells(columns, settings.reference)
    if len(dwells.rows) < 10:
        raise InputError(
            f"{path}: the reference is at rest {len(dwells.rows)} times, for {MIN_ROWS} rows or "
            f"more within {LARGEST_DISTANCE:g} of its standard uncertainties; a calibration needs "
            "10 at least. Leave out --dwells for a motion that does not stop"
        )
    return dwells.columns, dwells.noise, dwells.rows


def find_reference_dwells(columns: dict[str, Floats], reference: Sequence[float]) -> Dwells:
    """The dwells of a reference.  reference: its standard uncertainties (6,)."""
    measured = [n for n in range(6) if np.isfinite(reference[n])]
    pose = np.column_stack([columns[REFERENCE[n]] * STATE_UNITS[n] for n in measured])
    return dwell_means(columns, pose, np.array(reference)[measured])


def clock(columns: dict[str, Floats], good: NDArray[np.bool_]) -> Floats | None:
    """Times and temperatures of the samples (n, 3), see `Data.clock`; None for a table without
    both."""
    if not any(name in columns for name in ("time_s", TEMPERATURE_COLUMN)):
        return None
    out = np.zeros((int(good.sum()), len(CLOCKS)))
    if "time_s" in columns:
        out[:, 0] = half_runs(columns["time_s"][good])
    if TEMPERATURE_COLUMN in columns:
        temperature = columns[TEMPERATURE_COLUMN][good]
        out[:, 1] = temperature - np.nanmean(temperature)
    return np.nan_to_num(out)


def half_runs(time: Floats) -> Floats:
    """Times (n,) scaled to the range from -1 to 1."""
    low, high = np.nanmin(time), np.nanmax(time)
    scaled: Floats = (2 * time - low - high) / max(high - low, 1e-300)
    return scaled


#: Fraction of a run over which the temperature is smoothed before its rate of change is taken.
CHANGE_FRACTION = 0.05
#: Time constants of a head that follows the temperature late, in half runs.
PAST_HALF_RUNS = np.array([0.1, 0.2, 0.4, 0.8, 1.6])


def pasts(columns: dict[str, Floats], good: NDArray[np.bool_]) -> Floats | None:
    """Temperatures of heads relative to the column `temperature_c` (n, 6), K: of heads that follow
    it with the time constants `PAST_HALF_RUNS`, and of one that a slow thermometer follows.

    None without a temperature. A head begins in equilibrium. Without `time_s` the rows count as
    taken at equal intervals.
    """
    if TEMPERATURE_COLUMN not in columns:
        return None
    from scipy.integrate import cumulative_trapezoid
    from scipy.ndimage import uniform_filter1d

    temperature = columns[TEMPERATURE_COLUMN][good]
    time = half_runs(columns.get("time_s", np.arange(len(good), dtype=float))[good])
    finite = np.flatnonzero(np.isfinite(time) & np.isfinite(temperature))
    order = finite[np.argsort(time[finite], kind="stable")]
    at, air = time[order, None] / PAST_HALF_RUNS, temperature[order, None]
    growth = np.exp(at - at[0])
    past = cumulative_trapezoid(growth * (air - air[0]), at, axis=0, initial=0) / growth
    out = np.zeros((len(time), len(PAST_HALF_RUNS) + 1))
    out[order, :-1] = past + air[0] - air
    if len(order) > 1:
        size = max(3, int(CHANGE_FRACTION * len(order)))
        smooth = uniform_filter1d(air[:, 0], size, mode="nearest")
        steps = np.maximum(np.diff(time[order]), 1e-12)
        out[order[1:], -1] = np.diff(smooth) / steps
        out[order[0], -1] = out[order[1], -1]
    return out


#: Largest ratio of a pose's distance from the line between its neighbours to their distance, for
#: rows to count as samples of a motion in time.
MOST_BEND = 0.3


def time_derivatives(time: Floats, pose: Floats) -> tuple[Floats, Floats] | tuple[None, None]:
    """Velocities and accelerations (n, 6), in mm, rad and s, of a cubic spline through the rows;
    None if the rows are not samples of a motion in time."""
    step = np.diff(time)
    if len(time) < 5 or not (np.isfinite(step).all() and (step > 0).all()):
        return None, None
    bend = np.abs(pose[2:] - 2 * pose[1:-1] + pose[:-2]).mean(axis=0)
    span = np.abs(pose[2:] - pose[:-2]).mean(axis=0)
    if not (bend[span > 0] < MOST_BEND * span[span > 0]).any():
        return None, None
    from scipy.interpolate import CubicSpline

    curve = CubicSpline(time, pose)
    derivatives = np.stack([curve(time, 1), curve(time, 2)])
    gap = step > 5 * np.median(step)
    derivatives[:, :, bend > MOST_BEND * span] = 0.0
    derivatives[:, np.append(gap, False) | np.append(False, gap)] = 0.0
    return derivatives[0], derivatives[1]


def choice(sensor: Sensor, settings: Calibrate) -> Choice:
    """The unknowns of every fit and their priors, from the keys of `calibrate.before`. Raises
    `InputError` if all of them are null."""
    before = settings.before
    sigma: dict[str, float] = {}
    diameter = before.get("beam_diameter_percent", 0) / 100
    variance = sensor.beam.diameter_x * sensor.beam.diameter_y / 16
    sigma |= dict(zip(SHAPE, np.array([2, 2, 1]) * diameter * variance, strict=True))
    if not settings.power_per_sample:
        sigma["beam.power"] = before.get("laser_percent", 0) / 100 * sensor.beam.power
    for name in ("tilt_x", "tilt_y"):
        sigma[f"beam.{name}"] = before.get("beam_tilt_mrad", 0) / 1000
    for letter, psd in zip(DETECTORS, sensor.psds, strict=True):
        sigma |= facet_sigmas(letter, before) | detector_sigmas(letter, psd, before)
    sigma |= mounting_sigmas(before)
    unknowns = {name: value for name, value in sigma.items() if value > 0}
    if not unknowns:
        raise InputError("every key of calibrate.before is null: nothing is to be found")
    power = np.inf if settings.power_per_sample else 0.0
    return Choice(tuple(unknowns), np.array(list(unknowns.values())), power)


#: Groups of parameters that may have changed since a calibration, by the beginnings of their names.
GROUPS = {
    "beam": ("beam.",),
    "gains": tuple(f"correction_{letter}.power" for letter in DETECTORS),
    "detectors": ("psd_",),
    "facets": ("facet_",),
}


def group_names(before: Iterable[str], groups: Sequence[str]) -> list[str]:
    """The parameters of groups; raises `InputError` for a group without any."""
    members = list[str]()
    for group in groups:
        names = [name for name in before if name.startswith(GROUPS[group])]
        if not names:
            raise InputError(f"--only {group}: every key of calibrate.before for it is null")
        members += names
    return members


def choose_groups(sensor: Sensor, settings: Calibrate, groups: Sequence[str]) -> Choice:
    """All parameters of a calibrated sensor, with the covariance of its calibration as the prior.

    The parameters of `groups` may have changed since, by the standard uncertainties of
    `calibrate.before`. With independent changes, a fit to the data of both calibrations would have
    this prior. The laser's power, where each sample has its own, and the mirror's seat have the
    priors of `choice`. Raises `InputError` where the sensor has no calibration, or where a group
    has no parameters.
    """
    if sensor.calibration is None:
        raise InputError(
            "--only needs a calibrated configuration, whose covariance it keeps; this one has none "
            "in sensor.calibration"
        )
    if sensor.thermal.is_on:
        raise InputError(
            "--only does not go with sensor.temperature: its coefficients would need the readings "
            "of the first calibration; calibrate anew, without --only"
        )
    plain = choice(sensor, settings)
    before = dict(zip(plain.names, plain.sigma.tolist(), strict=True))
    changed = group_names(before, groups)
    names = [name for name in sensor.calibration.names if name in OF_SENSOR]
    if settings.power_per_sample and "beam.power" in names:
        names.remove("beam.power")
    old = [sensor.calibration.names.index(name) for name in names]
    names += [name for name in changed if name not in names]
    matrix = np.zeros((len(names), len(names)))
    matrix[: len(old), : len(old)] = np.array(sensor.calibration.covariance)[np.ix_(old, old)]
    for name in changed:
        matrix[names.index(name), names.index(name)] += before[name] ** 2
    sigma = dict(zip(names, np.sqrt(np.diag(matrix)).tolist(), strict=True))
    sigma |= {name: before[name] for name in before if name in MOUNTING}
    joint = replace(
        sensor.calibration, names=tuple(names), covariance=tuple(map(tuple, matrix.tolist()))
    )
    return Choice(tuple(sigma), np.array(list(sigma.values())), plain.power, joint=joint)


def facet_sigmas(letter: str, before: dict[str, float]) -> dict[str, float]:
    """Prior standard uncertainties of a facet's angles by name, rad."""
    return {
        f"facet_{letter}.{name}": before.get("facet_mrad", 0) / 1000
        for name in ("inclination", "azimuth")
    }


def detector_sigmas(letter: str, psd: Psd, before: dict[str, float]) -> dict[str, float]:
    """Prior standard uncertainties of a detector's parameters by name, mm, rad, mW and
    fractions."""
    place, scale = before.get("psd_place_mm", 0), before.get("scale_percent", 0) / 100
    sigma = {f"psd_{letter}.{name}": place for name in ("radius", "height")}
    sigma[f"psd_{letter}.azimuth"] = place / psd.radius
    for name in ("roll", "pitch", "yaw"):
        sigma[f"psd_{letter}.{name}"] = before.get("psd_turn_mrad", 0) / 1000
    sigma[f"correction_{letter}.power"] = before.get("power_percent", 0) / 100
    sigma[f"correction_{letter}.dark"] = before.get("dark_uw", 0) / 1000
    sigma[f"correction_{letter}.y10"] = scale * psd.size_y / 2
    sigma[f"correction_{letter}.z01"] = scale * psd.size_z / 2
    return sigma | bends(letter, before.get("bend_um", 0) / 1000)


def bends(letter: str, size: float) -> dict[str, float]:
    """Prior uncertainties (`size`, mm) of a detector's second and third-order terms at its edge."""
    return {f"correction_{letter}.{axis}{a}{b}": size for a, b in MONOMIALS[2:] for axis in "yz"}


def mounting_sigmas(before: dict[str, float]) -> dict[str, float]:
    """Prior uncertainties of the mirror's place on the reference, mm and rad; the apex's height is
    zero by convention."""
    sigma = {}
    for name in MOUNTING:
        is_angle = "mount" in name
        size = before.get(f"{name.partition('.')[0]}_{'deg' if is_angle else 'mm'}", 0)
        sigma[name] = size * (np.pi / 180 if is_angle else 1.0)
    return sigma | {"apex.z": 0.0}


def split(data: Data, fraction: float) -> tuple[Data, Data]:
    """Split samples, in their order, into those to fit and, evenly between them, the fraction to
    hold back."""
    number = np.arange(len(data.raw))
    held = np.floor((number + 1) * fraction) > np.floor(number * fraction)
    return data.part(~held), data.part(held)


#: Output units of parameters, and their factors from the units of the code, by the full name or
#: else by the part after its last dot.
UNITS = {
    **dict.fromkeys(EFFECTS, ("", 1.0)),
    **dict.fromkeys(POWER_DRIFT, ("%", 100.0)),
    **dict.fromkeys((*DRIFTS, *BACKLASH), ("um", 1e3)),
    **dict.fromkeys(LAG, ("%", 100.0)),
    **{name: ("mrad", 1e3) if "mount" in name else ("mm", 1.0) for name in MOUNTING},
    **dict.fromkeys(SKEW, ("us", 1e6)),
    "beam.power": ("mW", 1.0),
}
UNITS_OF_PARTS = {
    "delay": ("ms", 1e3),
    "radius": ("mm", 1.0),
    "height": ("mm", 1.0),
    "power": ("%", 100.0),
    "dark": ("uW", 1e3),
}


def unit_of(name: str, sensor: Sensor) -> tuple[str, float]:
    """The output unit of a parameter, and the factor from the unit of the code."""
    head, _, part = name.rpartition(".")
    if name in SHAPE:
        return "%", 1600.0 / (sensor.beam.diameter_x * sensor.beam.diameter_y)
    if name in BACKLASH and part in ANGLES:
        return "urad", 1e6
    unit = UNITS.get(name) or UNITS_OF_PARTS.get(part)
    if unit is not None:
        return unit
    return ("um", 1e3) if head.startswith(("correction", "spline")) else ("mrad", 1e3)


def standard_uncertainties(result: Fit, names: Sequence[str]) -> Floats:
    """The standard uncertainty (names,) of each named parameter, in mm, rad, mW or fractions.

    Parameters of the sensor have the uncertainties of the covariance that is written, which
    includes errors that the fit does not see. Unknowns of the motion, such as the mirror's place on
    the reference, are not written and have the uncertainties of the fit.
    """
    calibrated = result.sensor.calibration
    assert calibrated is not None
    fitted = np.sqrt(covariance_factor(result)) * result.uncertainty
    stated = dict(zip(result.choice.names, fitted, strict=True))
    stated |= zip(calibrated.names, np.sqrt(np.diag(calibrated.covariance)), strict=True)
    return np.array([stated[name] for name in names])


def unknowns_table(nominal: Sensor, result: Fit) -> dict[str, NDArray[Any]]:
    """A table of each unknown's change and uncertainties, in the units of its column `unit`.

    The mount's angles are excluded, because the facets' changes and uncertainties include them.
    """
    rows = [n for n, name in enumerate(result.choice.names) if not name.startswith("mount.")]
    names = [result.choice.names[n] for n in rows]
    units = [unit_of(name, nominal) for name in names]
    factors = np.array([factor for _, factor in units])
    change = fold_mount(result.all_values) - values_of(nominal)
    return {
        "parameter": np.array(names),
        "unit": np.array([unit for unit, _ in units]),
        "known_before": result.choice.sigma[rows] * factors,
        "change": change[[PLACE[name] for name in names]] * factors,
        "u": standard_uncertainties(result, names) * factors,
    }


def parameter_table(nominal: Sensor, result: Fit, made: Sensor) -> dict[str, NDArray[Any]]:
    """A table of the parameters of the calibrated sensor `made`, in the units of its column `unit`.

    place: the parameter's place in the order of `Sensor.calibration`.
    """
    assert made.calibration is not None
    names = [name for name in made.calibration.names if name in PLACE]
    before, after = values_of(nominal), values_of(made)
    after[block(DRIFTS)] = result.all_values[block(DRIFTS)]
    at = [PLACE[name] for name in names]
    units = [unit_of(name, nominal) for name in names]
    factors = np.array([factor for _, factor in units])
    per = ["/K" if name in TEMPERATURE else "" for name in names]
    return {
        "parameter": np.array(names),
        "unit": np.array([unit + more for (unit, _), more in zip(units, per, strict=True)]),
        "value": after[at] * factors,
        "change": (after - before)[at] * factors,
        "u": standard_uncertainties(result, names) * factors,
        "place": np.array([made.calibration.names.index(name) for name in names]),
    }
