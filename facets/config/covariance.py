"""The covariance of calibrated parameters as a file: a column a parameter, under its name."""

from __future__ import annotations

import csv
from pathlib import Path

from ..core.errors import InputError
from ..core.sensor import Calibration
from ..detectors.calibrated import KNOWN


def read(path: Path) -> Calibration:
    """Raises `InputError` where the file holds no square table of numbers."""
    with path.open(encoding="utf-8", newline="") as file:
        lines = csv.reader(line for line in file if not line.startswith("#"))
        try:
            names = tuple(next(lines))
            rows = tuple(tuple(float(value) for value in line) for line in lines)
        except (StopIteration, ValueError) as error:
            raise InputError(f"{path}: not a covariance: {error}") from None
    unknown = [name for name in names if name not in KNOWN]
    if unknown:
        raise InputError(f"{path}: not a parameter of the sensor: {', '.join(unknown)}")
    try:
        return Calibration(names, rows)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def columns(known: Calibration) -> dict[str, list[float]]:
    """The same as columns of a table."""
    return {name: [row[n] for row in known.covariance] for n, name in enumerate(known.names)}
