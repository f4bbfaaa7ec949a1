"""The exported C, compiled as a library and called from Python."""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.errors import InputError
from ..core.units import Floats

#: How many numbers `facets_solve_plain` gives: state, power, residual, covariance, used.
NUMBERS = 77


class Solved(NamedTuple):
    """state: (n, 8) mm, rad, power: (n,) mW, NaN where not converged.  status: (n,).
    covariance: (n, 8, 8).  residual: (n,).  used: (n, 3) the detectors that took part."""

    state: Floats
    power: Floats
    status: NDArray[np.int32]
    covariance: Floats
    residual: Floats
    used: NDArray[np.bool_]


class FirmwareLibrary:
    """A shared library of the exported C, in the precision that it was compiled for.

    path: of the library. Raises `InputError` where it is none, or not of this C.
    """

    def __init__(self, path: Path) -> None:
        try:
            self._code = ctypes.CDLL(str(path.resolve()))
            size = int(self._code.facets_real_size())
        except (OSError, AttributeError) as error:
            raise InputError(
                f"{path} can not be used as the exported solver: {error}; "
                "make it with `make library` in a folder that `facets export-c` has written"
            ) from None
        self.kind = np.dtype(np.float64 if size == 8 else np.float32)
        self._code.facets_solve_plain.restype = ctypes.c_int32
        self._code.facets_from_counts.restype = ctypes.c_int32

    def readings(self, states: ArrayLike) -> Floats:
        """(n, 9) at states (n, 8), as `facets.readings` gives them."""
        rows = np.ascontiguousarray(states, self.kind)
        out = np.empty((len(rows), 9), self.kind)
        for state, reading in zip(rows, out, strict=True):
            self._code.facets_readings(pointer(state), pointer(reading))
        return out.astype(float)

    def solve(
        self, readings: ArrayLike, beam: str = "free", start: ArrayLike | None = None
    ) -> Solved:
        """The poses of readings (n, 9).

        start: a state and the power (9,) that each starts from; None for zero.  beam: "free", or
        "known" to be where the start has it.
        """
        rows = np.ascontiguousarray(readings, self.kind)
        numbers = np.empty((len(rows), NUMBERS), self.kind)
        status = np.empty(len(rows), np.int32)
        known = int(beam == "known")
        first = None if start is None else np.ascontiguousarray(start, self.kind)
        begin = None if first is None else pointer(first)
        for n, row in enumerate(rows):
            status[n] = self._code.facets_solve_plain(
                pointer(row), begin, known, pointer(numbers[n])
            )
        wide = numbers.astype(float)
        return Solved(
            wide[:, :8],
            wide[:, 8],
            status,
            wide[:, 10:74].reshape(-1, 8, 8),
            wide[:, 9],
            wide[:, 74:] > 0,
        )

    def readings_of_counts(self, counts: ArrayLike, dark: ArrayLike, xy_sum: bool) -> Floats:
        """(n, 9) of counts (n, 12); dark: (12,)."""
        rows = np.ascontiguousarray(counts, np.int32)
        without = np.ascontiguousarray(dark, self.kind)
        out = np.empty((len(rows), 9), self.kind)
        for row, reading in zip(rows, out, strict=True):
            self._code.facets_from_counts(
                pointer(row), pointer(without), int(xy_sum), pointer(reading)
            )
        return out.astype(float)


def pointer(array: NDArray[np.generic]) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)
