"""The model of cut light, for one state after the other. Importing this imports Numba.

Numba compiles this text because of its loops over the sides of outlines.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import carray  # type: ignore[attr-defined]  # noqa: TID253

from ..optics import cut_light
from ..optics.detected import cut_scene, linearise_where_cut
from ..optics.forward import power_derivative, replace_power, scene_readings
from ..optics.limits import COLUMNS, MOST_SIDES
from . import kernels, packing
from .jit import MODEL, callback, compilable
from .kernels import state_of, unpack, unpack_cut
from .packing import PACKED

Pointer = Any


@compilable
def put_readings(found: Any, detectors: Any) -> None:
    for k in range(3):
        for i in range(3):
            found[3 * k + i] = detectors[k][i]


@compilable
def put_linearisation(found: Any, detectors: Any) -> None:
    """Put the values in the first row of found (10, 10), then each one's derivatives except that by
    power."""
    for k in range(3):
        values, derivatives = detectors[k]
        for i in range(3):
            row = 3 * k + i
            found[0, row] = values[i]
            for c in range(8):
                found[1 + row, c] = derivatives[i][c]


@compilable
def put_by_power(found: Any, power: float) -> None:
    """Put the derivatives by the beam's power in the last column: a place does not depend on it."""
    for row in range(9):
        found[1 + row, 8] = found[0, row] / power if row % 3 == 2 else 0.0


@compilable
def put_light(found: Any, vectors: Any, detectors: Any) -> None:
    """Run `put_linearisation`, and put the derivatives by the beam's power, on which places depend
    too."""
    put_linearisation(found, detectors)
    for k in range(3):
        for i in range(3):
            found[1 + 3 * k + i, 8] = power_derivative(vectors, detectors[k][0], k, i)


@compilable
def put_nothing(found: Any) -> None:
    """Put NaN for each result.

    A facet without light would divide complex numbers by zero, which is an error even in compiled
    code that cannot report it.
    """
    found[:] = np.nan


def readings_of_cut(
    packed: Pointer, inputs: Pointer, found: Pointer, memory: Pointer, rows: int
) -> None:
    vectors, outlines = (
        unpack_cut(carray(packed, (PACKED,))),
        carray(memory, (3, MOST_SIDES, COLUMNS)),
    )
    states, out = carray(inputs, (rows, 8)), carray(found, (rows, 9))
    for n in range(rows):
        at = cut_scene(vectors, state_of(states, n), outlines)[0]
        put_readings(out[n], scene_readings(vectors, at))


def readings_of_cut_light(
    packed: Pointer, inputs: Pointer, found: Pointer, memory: Pointer, rows: int
) -> None:
    vectors, outlines = unpack(carray(packed, (PACKED,))), carray(memory, (3, MOST_SIDES, COLUMNS))
    states, out = carray(inputs, (rows, 8)), carray(found, (rows, 9))
    for n in range(rows):
        try:
            put_readings(out[n], cut_light.readings(vectors, state_of(states, n), outlines))
        except Exception:
            put_nothing(out[n])


def approximate_linearisation_of_cut(
    packed: Pointer, inputs: Pointer, found: Pointer, memory: Pointer, rows: int
) -> None:
    """As `row_code.write_linearisation`, and exact."""
    vectors, outlines = (
        unpack_cut(carray(packed, (PACKED,))),
        carray(memory, (3, MOST_SIDES, COLUMNS)),
    )
    states, out = carray(inputs, (rows, 9)), carray(found, (rows, 10, 10))
    for n in range(rows):
        power = states[n, 8]
        powered = replace_power(vectors, power)
        put_linearisation(out[n], linearise_where_cut(powered, state_of(states, n), outlines))
        put_by_power(out[n], power)


def approximate_linearisation_of_cut_light(
    packed: Pointer, inputs: Pointer, found: Pointer, memory: Pointer, rows: int
) -> None:
    vectors, outlines = unpack(carray(packed, (PACKED,))), carray(memory, (3, MOST_SIDES, COLUMNS))
    states, out = carray(inputs, (rows, 9)), carray(found, (rows, 10, 10))
    for n in range(rows):
        powered = replace_power(vectors, states[n, 8])
        try:
            detectors = cut_light.linearise(powered, state_of(states, n), outlines)
            put_light(out[n], powered, detectors)
        except Exception:
            put_nothing(out[n])


MODELS = {
    function.__name__: function
    for function in (
        readings_of_cut,
        readings_of_cut_light,
        approximate_linearisation_of_cut,
        approximate_linearisation_of_cut_light,
    )
}
_KIND = ctypes.CFUNCTYPE(None, *[ctypes.c_int64] * 5)


def model(name: str) -> Callable[..., None]:
    """Return one of `MODELS`, compiled if needed, for `evaluators.model`."""
    compiled = callback(__file__, MODELS[name], kernels, packing, signature=MODEL)
    start = _KIND(compiled.address)
    start.keeps = compiled  # type: ignore[attr-defined]
    return start
