"""Read and write measured corrections of a detector, as CSV files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..core.errors import InputError
from ..core.sensor import Grid
from ..files.tables import read_numbers

COLUMNS = ("psi_mm", "zeta_mm", "add_psi_um", "add_zeta_um")


def read(path: Path) -> Grid:
    """Read a grid of corrections, whose rows may be in any order.

    Raises `InputError` if a row is missing, twice or not numbers.
    """
    _, rows = read_numbers(path, COLUMNS)
    y, z = np.unique(rows[:, 0]), np.unique(rows[:, 1])
    crossings = len(np.unique(rows[:, :2], axis=0))
    if not np.isfinite(rows).all() or not len(rows) == crossings == len(y) * len(z):
        raise InputError(
            f"{path}: not a grid: {len(rows)} rows, {len(y)} values of psi_mm, {len(z)} of "
            "zeta_mm; "
            "needed is one row of numbers for each pair of them"
        )
    rows = rows[np.lexsort((rows[:, 1], rows[:, 0]))]
    add = 1e-3 * rows[:, 2:].reshape(len(y), len(z), 2)
    tuples = [tuple(map(tuple, add[:, :, n].tolist())) for n in range(2)]
    try:
        return Grid(tuple(y.tolist()), tuple(z.tolist()), *tuples)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def columns(grid: Grid) -> dict[str, Any]:
    """Return a grid as columns of a table, with a row for each of its points."""
    y, z = np.meshgrid(grid.y, grid.z, indexing="ij")
    corrections = (1e3 * np.array(values) for values in (grid.add_y, grid.add_z))
    parts = (part.ravel() for part in (y, z, *corrections))
    return dict(zip(COLUMNS, parts, strict=True))
