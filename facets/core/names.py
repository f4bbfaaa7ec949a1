"""The names of states and readings, and their units in tables and messages."""

from __future__ import annotations

from typing import Any

DETECTORS = ("a", "b", "c")

#: Components of the state, Eq. (3), in the order of the arrays. The first six are the pose.
STATE = ("tx", "ty", "tz", "roll", "pitch", "yaw", "bx", "by")
POSE = STATE[:6]

#: Components of a reading, Eq. (2), in the order of the arrays.
KINDS = ("psi", "zeta", "power")
READING = tuple(f"{name}_{letter}" for letter in DETECTORS for name in KINDS)

ANGLES = ("roll", "pitch", "yaw")

#: Columns of tables: the same names with their units.
STATE_COLUMNS = tuple(f"{name}_mrad" if name in ANGLES else f"{name}_mm" for name in STATE)
READING_COLUMNS = tuple(
    f"{name}_mw" if name.startswith("power") else f"{name}_mm" for name in READING
)
#: Column of the temperature of readings, degrees Celsius, for sensors with `Sensor.thermal`.
TEMPERATURE_COLUMN = "temperature_c"

#: Units of the state's columns, in the code's units (mm, rad).
STATE_UNITS = tuple(1e-3 if name in ANGLES else 1.0 for name in STATE)

#: One um or urad in the code's units, by component of the state.
FINE_UNITS = tuple(1e-6 if name in ANGLES else 1e-3 for name in STATE)

#: Columns of ranges and of standard uncertainties of the pose.
RANGE_COLUMNS = tuple(f"range_{name}" for name in STATE_COLUMNS[:6])
FINE_COLUMNS = tuple(f"u_{name}_urad" if name in ANGLES else f"u_{name}_um" for name in POSE)

#: Names and units of an array's columns, by their number; the units in the code's units. Columns
#: whose names have no unit are in the code's units.
LABELS = {
    9: (READING_COLUMNS, (1.0,) * 9),
    8: (STATE_COLUMNS, STATE_UNITS),
    6: (STATE_COLUMNS[:6], STATE_UNITS[:6]),
    2: (STATE_COLUMNS[6:], STATE_UNITS[6:]),
}


def state_columns(values: Any, prefix: str = "") -> dict[str, Any]:
    """Convert states (..., 8) or poses (..., 6), mm and rad, to columns tx_mm, ..., mm and mrad.

    prefix: of the columns' names, such as object_.
    """
    return {
        f"{prefix}{name}": values[..., i] / STATE_UNITS[i]
        for i, name in enumerate(STATE_COLUMNS[: values.shape[-1]])
    }


def covariance_entries(prefix: str = "") -> dict[str, tuple[int, int]]:
    """Columns of a pose's covariance with the row and column of each in the matrix, on and above
    its diagonal: cov_tx_tx_mm2, cov_tx_roll_mm_mrad, ..., cov_yaw_yaw_mrad2.

    prefix: of the pose's names, such as object_.
    """
    units = [name.rpartition("_")[2] for name in STATE_COLUMNS[:6]]
    columns = {}
    for i in range(6):
        for j in range(i, 6):
            unit = f"{units[i]}2" if units[i] == units[j] else f"{units[i]}_{units[j]}"
            columns[f"cov_{prefix}{POSE[i]}_{POSE[j]}_{unit}"] = i, j
    return columns


def escape_undecodable(text: str) -> str:
    r"""Return a text that can be written as UTF-8: bytes of a file's name that are not UTF-8 become
    escapes such as \xe9."""
    return text.encode("utf-8", "backslashreplace").decode().replace(r"\udc", r"\x")
