"""A sample as a fixed row of bytes, as other programs get it; docs/formats.md describes it."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.names import READING_COLUMNS, STATE_COLUMNS
from ...core.units import Rows
from ...estimation.measurement import Measurement
from ...estimation.solution import UNCERTAINTY_PARTS
from ...files.tables import unit_of_column

if TYPE_CHECKING:
    from ...core.settings import Config
    from ..run.pipeline import RunPoses

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


def row_content(config: Config, objects: Measurement | None = None) -> dict[str, Any]:
    """Describe the columns of rows in addition to those of SAMPLE, as a publication sends it.

    They are the parts of the uncertainties, the pose of the measured object, and the auxiliary
    channels.  objects: the run's measurement; by default that of the configuration alone.
    """
    return {
        "uncertainty_parts": config.sensor.calibration is not None,
        **(objects or Measurement(config)).description(),
        "channels": [
            {
                "column": channel.column,
                "name": channel.name,
                "unit": channel.unit,
                "delay_us": 1e6 * channel.delay,
            }
            for channel in config.acquire.channels
        ],
    }


def sample_dtype(about: dict[str, Any]) -> np.dtype[np.void]:
    """Return the dtype of a publication's rows, from its description."""
    channels = [channel["column"] for channel in about.get("channels", ())]
    further = (*about.get("object_columns", ()), *channels)
    return row_dtype(bool(about.get("uncertainty_parts")), further)


@cache
def row_dtype(parts: bool, further: tuple[str, ...]) -> np.dtype[np.void]:
    """Return the dtype of rows whose last columns are `further`.  parts: with those of u."""
    names = (*(PARTS if parts else ()), *further)
    return np.dtype([*SAMPLE.descr, *((name, "<f8") for name in names)]) if names else SAMPLE


#: A row of a calibrated sensor: 370 bytes.
CALIBRATED_SAMPLE = row_dtype(True, ())


def unit_of(name: str, channels: Iterable[dict[str, Any]] = ()) -> str:
    """The unit of a column as people write it; empty where it has none.

    channels: the auxiliary channels, as `row_content` has them; the unit of any other column is at
    the end of its name.
    """
    for channel in channels:
        if channel["column"] == name:
            return "" if channel["unit"] == "1" else str(channel["unit"])
    return "sigma" if name == "residual" else unit_of_column(name)


def rows_of(poses: RunPoses, utc_offset: float) -> Rows:
    """Rows of SAMPLE, or of CALIBRATED_SAMPLE where the poses' uncertainties have parts, with the
    object's poses and the auxiliary channels.

    utc_offset: of the wall clock over the host's monotonic one, s.
    """
    columns = {**poses.columns(), "utc_s": poses.host + utc_offset}
    has_parts = poses.solution.calibration_covariance is not None
    rows = np.empty(len(poses), row_dtype(has_parts, tuple(poses.further)))
    for name in rows.dtype.names or ():
        rows[name] = columns[name]
    return rows


def description(about: dict[str, Any]) -> dict[str, Any]:
    """Return `about` with the columns and units of the rows, for receivers, in JSON's types."""
    dtype = sample_dtype(about)
    units = {name: unit_of(name, about.get("channels", ())) for name in dtype.names or ()}
    return {
        **about,
        "dtype": [list(pair) for pair in dtype.descr],
        "units": {name: unit for name, unit in units.items() if unit},
    }
