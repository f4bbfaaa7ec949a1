"""The exported C, compiled as a library and called from Python."""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.errors import InputError
from ..core.units import Floats
from ..model.arrays import as_vectors, readings

if TYPE_CHECKING:
    from ..core.sensor import Sensor


#: Half widths of the range of states at which a library is compared with a sensor, mm and rad.
COMPARISON_RANGE = np.array([0.1, 0.1, 0.1, 5e-3, 5e-3, 5e-3, 0.1, 0.1])
#: Error of a reading in single precision that such a comparison allows, mm and mW.
READING_TOLERANCE = 2e-4


class FirmwareSolutions(NamedTuple):
    """Poses from the exported solver, NaN where it has not converged.

    state: (n, 8) mm and rad.  power: (n,) mW.  status: (n,) codes of `facets_status` in the header.
    covariance: (n, 8, 8) of the states.  residual: (n,) in standard deviations.  used: (n, 3)
    whether each detector was used.
    """

    state: Floats
    power: Floats
    status: NDArray[np.int32]
    covariance: Floats
    residual: Floats
    used: NDArray[np.bool_]


class FirmwareLibrary:
    """A shared library of the exported C code, in single or double precision.

    path: the library's file. Raises `InputError` if this cannot be loaded or is another library.
    """

    def __init__(self, path: Path) -> None:
        try:
            self._code = ctypes.CDLL(str(path.resolve()))
            size = int(self._code.facets_real_size())
        except (OSError, AttributeError) as error:
            raise InputError(
                f"{path} cannot be used as the exported solver: {error}; "
                "make it with `make library` in a folder that `facets export-c` has written"
            ) from None
        self.kind = np.dtype(np.float64 if size == 8 else np.float32)
        int32 = np.dtype(np.int32)
        #: Layouts of the header's structures `facets_options` and `facets_solution`.
        self._options = np.dtype(
            [("mean", self.kind, 3), ("sigma", self.kind, 3), ("max_steps", int32),
             ("covariance", int32), ("accept_unchecked", int32)], align=True,
        )  # fmt: skip
        self._solution = np.dtype(
            [("state", self.kind, 8), ("power", self.kind), ("residual", self.kind),
             ("covariance", self.kind, (8, 8)), ("status", int32), ("steps", int32),
             ("used", int32, 3)], align=True,
        )  # fmt: skip

    def readings(self, states: ArrayLike) -> Floats:
        """Compute the readings (n, 9), mm and mW, at states (n, 8), as `facets.readings` does."""
        rows = np.ascontiguousarray(as_vectors(states, 8, "states"), self.kind)
        out = np.empty((len(rows), 9), self.kind)
        for state, reading in zip(rows, out, strict=True):
            self._code.facets_readings(pointer(state), pointer(reading))
        return out.astype(float)

    def is_of(self, sensor: Sensor) -> bool:
        """Whether the library's readings at a few states are those of this sensor."""
        states = COMPARISON_RANGE * np.random.default_rng(1).uniform(-1, 1, (4, 8))
        close = np.isclose(self.readings(states), readings(sensor, states), 1e-4, READING_TOLERANCE)
        return bool(close.all())

    def solve(
        self, readings: ArrayLike, start: ArrayLike | None = None, **options: ArrayLike
    ) -> FirmwareSolutions:
        """Solve readings (n, 9) for poses.

        start: states and powers (9,) or (n, 9) to start from; None for zero.  options: fields of
        `facets_options` that differ from `facets_default_options`.
        """
        rows = np.ascontiguousarray(as_vectors(readings, 9, "readings"), self.kind)
        solutions = np.zeros(len(rows), self._solution)
        starts: list[Any] = [None] * len(rows)
        if start is not None:
            starts = [*np.ascontiguousarray(np.broadcast_to(start, (len(rows), 9)), self.kind)]
        settings = np.zeros((), self._options)
        self._code.facets_default_options(pointer(settings))
        for name, value in options.items():
            settings[name] = value
        for n, (row, first) in enumerate(zip(rows, starts, strict=True)):
            self._code.facets_solve(
                pointer(row),
                None if first is None else pointer(first),
                pointer(settings),
                pointer(solutions[n : n + 1]),
            )
        return FirmwareSolutions(
            solutions["state"].astype(float),
            solutions["power"].astype(float),
            solutions["status"].copy(),
            solutions["covariance"].astype(float),
            solutions["residual"].astype(float),
            solutions["used"] > 0,
        )

    def readings_of_counts(self, counts: ArrayLike, dark_counts: ArrayLike, xy_sum: bool) -> Floats:
        """Convert counts (n, 12) to readings (n, 9), mm and mW.

        dark_counts: (12,) counts without light.  xy_sum: whether counts are X, Y, SUM and a spare
        number of each detector.
        """
        rows = np.ascontiguousarray(counts, np.int32)
        without_light = np.ascontiguousarray(dark_counts, self.kind)
        out = np.empty((len(rows), 9), self.kind)
        for row, reading in zip(rows, out, strict=True):
            self._code.facets_from_counts(
                pointer(row), pointer(without_light), int(xy_sum), pointer(reading)
            )
        return out.astype(float)


def pointer(array: NDArray[Any]) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)
