"""A sample as a fixed row of bytes, as other programs get it; docs/formats.md describes it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.names import READING_COLUMNS, STATE_COLUMNS, STATE_UNITS

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
#: The same bytes, all numbers beyond the head together.
BLOCK = np.dtype([*HEAD, ("numbers", "<f8", len(NUMBERS))])


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
    """Rows of SAMPLE. utc_offset: of the wall clock over the host's monotonic one, s."""
    solution = poses.solution
    rows = np.empty(len(poses), BLOCK)
    rows["seq"], rows["board_us"], rows["host_s"] = poses.seq, poses.time, poses.host
    rows["utc_s"] = poses.host + utc_offset
    rows["status"], rows["flags"] = solution.status, poses.flags
    numbers, units = rows["numbers"], np.asarray(STATE_UNITS)
    numbers[:, :9] = poses.readings
    numbers[:, 9:17] = solution.state / units
    numbers[:, 17:25] = solution.uncertainty / units
    numbers[:, 25] = solution.residual
    return rows.view(SAMPLE)


def description(about: dict[str, Any]) -> dict[str, Any]:
    """What a receiver must know to read rows, as JSON takes it. about: what else is to be said."""
    return {
        **about,
        "dtype": [list(pair) for pair in SAMPLE.descr],
        "units": {name: unit_of(name) for name in SAMPLE.names or () if unit_of(name)},
    }
