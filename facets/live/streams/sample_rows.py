"""A sample as a fixed row of bytes, as other programs get it; docs/formats.md describes it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.names import READING_COLUMNS, STATE_COLUMNS, STATE_UNITS
from ...estimation.table import UNCERTAINTY_PARTS

if TYPE_CHECKING:
    from ..run.pipeline import Poses

HEAD = [
    ("seq", "<i8"),
    ("board_us", "<i8"),
    ("host_s", "<f8"),
    ("utc_s", "<f8"),
    ("status", "i1"),
    ("flags", "u1"),
]
NUMBERS = (
    *READING_COLUMNS,
    *STATE_COLUMNS,
    *(f"u_{name}" for name in STATE_COLUMNS),
    "residual",
)
#: A row: 242 bytes, little-endian, packed.
SAMPLE = np.dtype([*HEAD, *((name, "<f8") for name in NUMBERS)])
#: The parts of the uncertainties, which samples of a calibrated sensor also have.
PARTS = tuple(f"u_{part}_{name}" for part in UNCERTAINTY_PARTS for name in STATE_COLUMNS)
#: A row of a calibrated sensor: 370 bytes.
CALIBRATED_SAMPLE = np.dtype([*SAMPLE.descr, *((name, "<f8") for name in PARTS)])


def sample_dtype(about: dict[str, Any]) -> np.dtype[np.void]:
    """Of the rows of a publication, by what it says of them."""
    return CALIBRATED_SAMPLE if about.get("uncertainty_parts") else SAMPLE


def unit_of(name: str) -> str:
    """The unit that a column's name ends with, as people write it; empty where it has none."""
    end = name.rpartition("_")[2]
    known = {
        "mm": "mm",
        "mrad": "mrad",
        "mw": "mW",
        "um": "um",
        "urad": "urad",
        "s": "s",
        "us": "us",
    }
    return known.get(end, "sigma" if name == "residual" else "")


def rows_of(poses: Poses, utc_offset: float) -> NDArray[np.void]:
    """Rows of SAMPLE, or of CALIBRATED_SAMPLE where the poses' uncertainties have parts.

    utc_offset: of the wall clock over the host's monotonic one, s.
    """
    solution = poses.solution
    parts = solution.calibration_covariance is not None
    dtype = CALIBRATED_SAMPLE if parts else SAMPLE
    count = len(dtype.names or ()) - len(HEAD)
    rows = np.empty(len(poses), [*HEAD, ("numbers", "<f8", count)])
    rows["seq"], rows["board_us"], rows["host_s"] = poses.seq, poses.time, poses.host
    rows["utc_s"] = poses.host + utc_offset
    rows["status"], rows["flags"] = solution.status, poses.flags
    numbers, units = rows["numbers"], np.asarray(STATE_UNITS)
    numbers[:, :9] = poses.readings
    numbers[:, 9:17] = solution.state / units
    numbers[:, 17:25] = solution.uncertainty / units
    numbers[:, 25] = solution.residual
    if parts:
        numbers[:, 26:34] = solution.noise_uncertainty / units
        numbers[:, 34:42] = solution.calibration_uncertainty / units
    return rows.view(dtype)


def description(about: dict[str, Any]) -> dict[str, Any]:
    """What a receiver must know to read rows, as JSON takes it. about: what else is to be said."""
    return {**about, **columns_of(sample_dtype(about))}


def columns_of(dtype: np.dtype[np.void]) -> dict[str, Any]:
    """The columns of rows and their units, as JSON takes them."""
    return {
        "dtype": [list(pair) for pair in dtype.descr],
        "units": {name: unit_of(name) for name in dtype.names or () if unit_of(name)},
    }
