"""Read the covariance of calibrated parameters from a file with one column for each parameter."""

from __future__ import annotations

from pathlib import Path

from ..core.errors import InputError
from ..core.sensor import Calibration
from ..detectors.calibrated import KNOWN
from ..files.tables import read_numbers


def read(path: Path, degrees_of_freedom: float | None = None) -> Calibration:
    """Read the covariance of parameters.

    Raises `InputError` for an unknown parameter, and if the table is not square or not numbers.
    """
    names, rows = read_numbers(path)
    unknown = [name for name in names if name not in KNOWN]
    if unknown:
        raise InputError(f"{path}: unknown parameter of the sensor: {', '.join(unknown)}")
    try:
        return Calibration(tuple(names), tuple(map(tuple, rows.tolist())), degrees_of_freedom)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def columns(calibration: Calibration) -> dict[str, list[float]]:
    """Return a covariance as columns of a table, one for each parameter."""
    rows = calibration.covariance
    return {name: [row[n] for row in rows] for n, name in enumerate(calibration.names)}
