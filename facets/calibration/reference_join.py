"""Join a reference's own table to readings by time, and find the offset of their clocks.

The readings are solved with the nominal sensor. At the offset, the reference's motion agrees best
with these poses. A cubic spline interpolates the reference, and the remaining offset is an unknown
of the fit (`reference.delay`).

Columns (rows,) have their units in their names; times and offsets are in s, poses (n, 6) in mm and
rad.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.names import READING_COLUMNS, STATE_COLUMNS, STATE_UNITS, state_columns
from ..core.sensor import Sensor
from ..core.units import Floats
from ..detectors.correction import correct
from ..estimation.solver import solve
from ..estimation.table import BEAM_UNCERTAINTIES
from .checks import remove_jumps
from .fitting.bundle_adjustment import Data
from .fitting.fit import fit
from .fitting.unknowns import DELAY, PLACE
from .table import BEAM, REFERENCE, RUN, choice, gather_samples, whole_table

if TYPE_CHECKING:
    from ..core.calibrate import Calibrate


#: Largest offset that is tried as a fraction of the common time, and number of trials.
OFFSET_FRACTION, OFFSET_COUNT = 0.25, 401
#: Largest offset that is tried, s.
LARGEST_OFFSET_S = 2.0
#: Likeness below which the motion does not determine the offset.
LEAST_LIKENESS = 0.5
#: Number of samples in the fit that finds the remaining offset.
OFFSET_SAMPLES = 150


class JoinedTables(NamedTuple):
    """Samples with the reference's poses.

    offset: the reference's time minus the readings', s; 0 if the motion does not determine it.
    likeness: the fraction of the reference's motion that the readings explain.
    """

    data: Data
    offset: float
    likeness: float


class Track(NamedTuple):
    """A reference's poses over time: (m,) s, (m, 6) mm and rad; and the cubic spline through
    them."""

    time: Floats
    pose: Floats
    curve: Any


def read_track(path: Path, settings: Calibrate) -> Track:
    """Read the reference's table: time_s, and ref_tx_mm ... or tx_mm ... of each axis that it
    measures.

    Raises `InputError` where a column is missing or the time does not increase.
    """
    measured = [n for n in range(6) if np.isfinite(settings.reference[n])]
    optional = (*REFERENCE, *STATE_COLUMNS[:6])
    columns = whole_table(path, ("time_s",), optional)
    time, pose = columns["time_s"], np.zeros((len(columns["time_s"]), 6))
    for n in range(6):
        named = [name for name in (REFERENCE[n], STATE_COLUMNS[n]) if name in columns]
        if named:
            pose[:, n] = columns[named[0]] * STATE_UNITS[n]
        elif n in measured:
            raise InputError(
                f"{path}: missing columns: {REFERENCE[n]} (or set calibrate.reference for it to "
                "null, if the reference does not measure that axis)"
            )
    good = np.isfinite(time) & np.isfinite(pose).all(axis=1)
    time, pose = time[good], pose[good]
    if len(time) < 4 or not (np.diff(time) > 0).all():
        raise InputError(f"{path}: time_s must go up, in four rows at least")
    from scipy.interpolate import CubicSpline

    return Track(time, pose, CubicSpline(time, pose))


def join_tables(
    readings: Path, reference: Path, sensor: Sensor, settings: Calibrate
) -> JoinedTables:
    """Join the tables of readings and reference; raise `InputError` if they share no time."""
    of_beam = () if settings.beam == "still" else (*BEAM, *BEAM_UNCERTAINTIES)
    columns = whole_table(readings, ("time_s", *READING_COLUMNS), (*of_beam, *RUN))
    track = read_track(reference, settings)
    time = columns["time_s"]
    check_overlap(readings, time, reference, track)
    offset, likeness = find_offset(sensor, columns, track)
    if likeness > LEAST_LIKENESS:
        moving = replace(settings, dwells=False)
        offset += remaining_offset(
            sensor, samples_at_offset(readings, columns, track, offset, moving), settings
        )
    return JoinedTables(
        samples_at_offset(readings, columns, track, offset, settings), offset, likeness
    )


def samples_at_offset(
    readings: Path, columns: dict[str, Floats], track: Track, offset: float, settings: Calibrate
) -> Data:
    """The samples with the reference's poses and their derivatives at an offset, s; velocities and
    accelerations are absent for a table of dwells."""
    joined, velocity, acceleration = add_reference(columns, track, offset)
    data = gather_samples(readings, joined, settings)
    if settings.dwells:  # at rest
        return data
    is_used = np.isfinite(joined[REFERENCE[0]]) & usable_rows(joined)
    return data._replace(velocity=velocity[is_used], acceleration=acceleration[is_used])


def remaining_offset(sensor: Sensor, data: Data, settings: Calibrate) -> float:
    """The remaining offset by a plain fit of some samples, s; 0 if the fit fails."""
    rows = np.unique(
        np.linspace(0, len(data.raw) - 1, min(len(data.raw), OFFSET_SAMPLES)).astype(np.int64)
    )
    unknowns = choice(sensor, settings).add_unknowns({DELAY: 0.01})
    result = fit(sensor, data.part(rows), unknowns, settings.outliers)
    return float(result.all_values[PLACE[DELAY]]) if result.ended else 0.0


def usable_rows(columns: dict[str, Floats]) -> NDArray[np.bool_]:
    """Whether each row of the table, (rows,), is one that `gather_samples` keeps."""
    raw = np.column_stack([columns[name] for name in READING_COLUMNS])
    good = np.asarray(np.isfinite(raw).any(axis=1))
    for name in BEAM:
        if name in columns:
            good = good & np.isfinite(columns[name])
    return good


def check_overlap(readings: Path, time: Floats, reference: Path, track: Track) -> None:
    """Raise `InputError` if the readings and the reference have no time in common."""
    low, high = float(np.nanmin(time)), float(np.nanmax(time))
    first, last = float(track.time[0]), float(track.time[-1])
    if high <= first or low >= last:
        raise InputError(
            f"{readings} runs from {low:.6g} to {high:.6g} s and {reference} from {first:.6g} to "
            f"{last:.6g} s: they share no time; bring both to one clock first (an offset of "
            f"{first - low:.6g} s would let them begin together)"
        )


def find_offset(sensor: Sensor, columns: dict[str, Floats], track: Track) -> tuple[float, float]:
    """The offset, s, at which the reference's motion agrees best with the solved poses, and their
    likeness; an offset of 0 if the likeness is not above LEAST_LIKENESS."""
    time, pose = some_poses(sensor, columns)
    shared = min(np.nanmax(time), track.time[-1]) - max(np.nanmin(time), track.time[0])
    width = min(OFFSET_FRACTION * shared, LARGEST_OFFSET_S)
    tried = np.linspace(-width, width, OFFSET_COUNT)
    for _ in range(3):
        marks = np.array([likeness(time, pose, track, offset) for offset in tried])
        best = float(tried[int(np.argmax(marks))])
        tried = best + np.linspace(-2, 2, 41) * (tried[1] - tried[0])
    mark = float(marks.max())
    return (best, mark) if mark > LEAST_LIKENESS else (0.0, mark)


def some_poses(sensor: Sensor, columns: dict[str, Floats]) -> tuple[Floats, Floats]:
    """Times (n,) and poses (n, 6) of some of the readings."""
    time = columns["time_s"]
    some = np.unique(np.linspace(0, len(time) - 1, min(len(time), 3000)).astype(np.int64))
    raw = np.column_stack([columns[name][some] for name in READING_COLUMNS])
    solved = solve(sensor, correct(sensor, raw), beam="known", power="unknown", covariance=False)
    return time[some], remove_jumps(solved.state[:, :6])


def likeness(time: Floats, pose: Floats, track: Track, offset: float) -> float:
    """The fraction of the reference's motion that the solved poses explain at an offset, s; 0 if
    the two have fewer than 20 poses in common.

    It is found by linear regression on all six axes, because a sensor that is not calibrated mixes
    them.
    """
    at = time + offset
    good = np.isfinite(pose).all(axis=1) & (at >= track.time[0]) & (at <= track.time[-1])
    if good.sum() < 20:
        return 0.0
    said = track.curve(at[good])
    said = said - said.mean(axis=0)
    rows = pose[good] - pose[good].mean(axis=0)
    ways, *_ = np.linalg.lstsq(rows / np.maximum(rows.std(axis=0), 1e-12), said, rcond=None)
    residual = said - rows / np.maximum(rows.std(axis=0), 1e-12) @ ways
    moved = said.std(axis=0) > 1e-7
    if not moved.any():
        return 0.0
    rest = (residual[:, moved] ** 2).sum(axis=0) / (said[:, moved] ** 2).sum(axis=0)
    return 1 - float(np.exp(np.log(np.maximum(rest, 1e-12)).mean()))  # the clearest axes decide


def add_reference(
    columns: dict[str, Floats], track: Track, offset: float
) -> tuple[dict[str, Floats], Floats, Floats]:
    """The readings' columns with the reference's at the readings' times, NaN outside the
    reference's own; and its velocity and acceleration (n, 6) there, mm, rad and s."""
    at, curve = columns["time_s"] + offset, track.curve
    outside = ~((at >= track.time[0]) & (at <= track.time[-1]))
    pose, velocity, acceleration = (curve(np.nan_to_num(at), order) for order in range(3))
    pose[outside] = np.nan
    return columns | state_columns(pose, "ref_"), velocity, acceleration
