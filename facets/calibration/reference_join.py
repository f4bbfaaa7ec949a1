"""A reference's own table joined to readings by time, the offset of their clocks found.

The readings are solved by the sensor as it is thought to be; the offset at which the reference
moves most like these poses is taken, the reference read there by a cubic through its samples, and
the rest of the offset is an unknown of the fit (`reference.delay`).
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.names import READING_COLUMNS, STATE_COLUMNS, STATE_UNITS
from ..core.sensor import Sensor
from ..detectors.correction import corrected
from ..estimation.solver import solve
from ..estimation.table import BEAM_UNCERTAINTIES
from .bundle_adjustment import Data
from .table import BEAM, REFERENCE, RUN, gathered, whole_table

if TYPE_CHECKING:
    from ..core.settings import Calibrate

Floats = NDArray[np.float64]

#: Offsets are tried over this share of the common time, at most so many seconds, in so many steps.
SHARE, SECONDS, STEPS = 0.25, 2.0, 401
#: Of a likeness below this nothing is concluded.
ALIKE = 0.5


class Joined(NamedTuple):
    """offset: added to the readings' time to be the reference's, s; 0 where the motion tells none.
    likeness: the correlation of both motions there."""

    data: Data
    offset: float
    likeness: float


class Track(NamedTuple):
    """A reference's poses over time: (m,) s, (m, 6) mm and rad."""

    time: Floats
    pose: Floats


def read_track(path: Path, settings: Calibrate) -> Track:
    """The reference's table: time_s, and ref_tx_mm ... or tx_mm ... of each axis that it measures.

    Raises `InputError` where a column is missing or the time does not go up.
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
    return Track(time, pose)


def read_joined(readings: Path, reference: Path, sensor: Sensor, settings: Calibrate) -> Joined:
    """Readings and reference of two tables.  Raises `InputError` where they share no time."""
    beside = () if settings.beam == "still" else (*BEAM, *BEAM_UNCERTAINTIES)
    columns = whole_table(readings, ("time_s", *READING_COLUMNS), (*beside, *RUN))
    track = read_track(reference, settings)
    time = columns["time_s"]
    check_overlap(readings, time, reference, track)
    offset, likeness = found_offset(sensor, columns, track)
    columns, velocity = with_reference(columns, track, offset)
    data = gathered(readings, columns, settings)
    kept = np.isfinite(columns[REFERENCE[0]]) & usable(columns)
    return Joined(data._replace(velocity=velocity[kept]), offset, likeness)


def usable(columns: dict[str, Floats]) -> NDArray[np.bool_]:
    """Rows that `gathered` keeps."""
    raw = np.column_stack([columns[name] for name in READING_COLUMNS])
    good: NDArray[np.bool_] = np.isfinite(raw).any(axis=1)
    for name in BEAM:
        if name in columns:
            good = good & np.isfinite(columns[name])
    return good


def check_overlap(readings: Path, time: Floats, reference: Path, track: Track) -> None:
    low, high = float(np.nanmin(time)), float(np.nanmax(time))
    first, last = float(track.time[0]), float(track.time[-1])
    if high <= first or low >= last:
        raise InputError(
            f"{readings} runs from {low:.6g} to {high:.6g} s and {reference} from {first:.6g} to "
            f"{last:.6g} s: they share no time; bring both to one clock first (an offset of "
            f"{first - low:.6g} s would let them begin together)"
        )


def found_offset(sensor: Sensor, columns: dict[str, Floats], track: Track) -> tuple[float, float]:
    """The offset at which the reference moves most like the solved poses, and how alike."""
    time = columns["time_s"]
    some = np.unique(np.linspace(0, len(time) - 1, min(len(time), 3000)).astype(np.int64))
    raw = np.column_stack([columns[name][some] for name in READING_COLUMNS])
    pose = solve(
        sensor, corrected(sensor, raw), beam="known", power="unknown", covariance=False
    ).state[:, :6]
    time = time[some]
    shared = min(np.nanmax(time), track.time[-1]) - max(np.nanmin(time), track.time[0])
    width = min(SHARE * shared, SECONDS)
    tried = np.linspace(-width, width, STEPS)
    for _ in range(3):
        marks = np.array([likeness(time, pose, track, offset) for offset in tried])
        best = float(tried[int(np.argmax(marks))])
        tried = best + np.linspace(-2, 2, 41) * (tried[1] - tried[0])
    mark = float(marks.max())
    return (best, mark) if mark > ALIKE else (0.0, mark)


def likeness(time: Floats, pose: Floats, track: Track, offset: float) -> float:
    """The mean correlation of the axes that move, at an offset."""
    at = time + offset
    good = np.isfinite(pose).all(axis=1) & (at >= track.time[0]) & (at <= track.time[-1])
    if good.sum() < 10:
        return 0.0
    marks = []
    for n in range(6):
        a, b = pose[good, n], np.interp(at[good], track.time, track.pose[:, n])
        if np.std(a) > 0 and np.std(b) > 1e-7:
            marks.append(float(np.corrcoef(a, b)[0, 1]))
    return float(np.mean(marks)) if marks else 0.0


def with_reference(
    columns: dict[str, Floats], track: Track, offset: float
) -> tuple[dict[str, Floats], Floats]:
    """The readings' columns with those of the reference at their times, NaN outside its own; and
    its velocity (n, 6) there, mm/s and rad/s."""
    from scipy.interpolate import CubicSpline

    at = columns["time_s"] + offset
    curve = CubicSpline(track.time, track.pose)
    outside = ~((at >= track.time[0]) & (at <= track.time[-1]))
    pose, velocity = curve(np.nan_to_num(at)), curve(np.nan_to_num(at), 1)
    pose[outside] = np.nan
    named = {name: pose[:, n] / STATE_UNITS[n] for n, name in enumerate(REFERENCE)}
    return columns | named, velocity
