"""The covariance of calibrated parameters as a file: a column a parameter, under its name."""

from __future__ import annotations

from pathlib import Path

from ..core.errors import InputError
from ..core.sensor import Calibration
from ..detectors.calibrated import KNOWN
from ..files.tables import read_numbers


def read(path: Path) -> Calibration:
    """Raises `InputError` where the file holds no square table of numbers."""
    names, rows = read_numbers(path)
    unknown = [name for name in names if name not in KNOWN]
    if unknown:
        raise InputError(f"{path}: not a parameter of the sensor: {', '.join(unknown)}")
    try:
        return Calibration(tuple(names), tuple(map(tuple, rows.tolist())))
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def columns(known: Calibration) -> dict[str, list[float]]:
    """The same as columns of a table."""
    return {name: [row[n] for row in known.covariance] for n, name in enumerate(known.names)}
