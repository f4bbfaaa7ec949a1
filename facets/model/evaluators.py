"""The model at one state as functions that compiled loops call by their address.

Each is compiled when it is first asked for, once for all loops: what cuts the light, and the light
of a bench, cost nothing where there is none. Importing this imports Numba; so it is imported only
where compiled code is needed.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterable
from math import nan
from typing import Any

from numba import carray  # type: ignore[attr-defined]  # noqa: TID253

from ..core.sensor import Sensor
from ..core.units import Floats
from ..optics import bench_gradient, bench_light, cut_light
from ..optics.curved_light import curved
from ..optics.detected import cut_scene, linearised_where_cut
from ..optics.footprint import footprint, slopes, spreading
from ..optics.forward import Geometry, by_power, placed, readings_of, with_power
from ..optics.forward import readings as readings_uncut
from ..optics.gradient import linearised as linearised_uncut
from ..optics.limits import COLUMNS, MOST
from ..scalars.machine import Value
from ..scalars.nesting import leaves
from . import kernels, machine_code, packing
from .jit import callback, compilable, raise_failure
from .kernels import unpack, unpack_cut
from .kinds import kind_of
from .machine_code import straight
from .packing import PACKED, PARALLEL, PLAIN
from .threads import once

Pointer = Any
Numbered = Iterable[tuple[int, Any]]


@compilable
def state_at(x: Pointer) -> Any:
    return x[0], x[1], x[2], x[3], x[4], x[5], x[6], x[7]


@compilable
def put_readings(found: Any, detectors: Any) -> None:
    for k in range(3):
        for i in range(3):
            found[3 * k + i] = detectors[k][i]


@compilable
def put_linearised(found: Any, detectors: Any) -> None:
    """Values in the first row of found (10, 10), then each one's derivatives but that by power."""
    for k in range(3):
        values, derivatives = detectors[k]
        for i in range(3):
            row = 3 * k + i
            found[0, row] = values[i]
            for c in range(8):
                found[1 + row, c] = derivatives[i][c]


@compilable
def put_by_power(found: Any, power: float) -> None:
    """The derivatives by the beam's power, in the last column: a place does not answer to it."""
    for row in range(9):
        found[1 + row, 8] = found[0, row] / power if row % 3 == 2 else 0.0


@compilable
def put_nothing(found: Any, count: int) -> None:
    """NaN for each result. Dividing complex numbers by zero, as where a facet has no light at all,
    is an error even in compiled code, which could not pass it on to who has called."""
    for n in range(count):
        found[n] = nan


def plain_readings(vectors: Geometry, state: list[Value]) -> Numbered:
    detectors = readings_uncut(vectors, tuple(state))
    return enumerate(leaves(detectors))


def plain_derivatives(vectors: Geometry, x: list[Value]) -> Numbered:
    """The formula of `linearised_plain`."""
    detectors = linearised_uncut(with_power(vectors, x[8]), tuple(x[:8]))
    for k, (values, derivatives) in enumerate(detectors):
        for i in range(3):
            row = 3 * k + i
            yield row, values[i]
            for c in range(8):
                yield 10 * (1 + row) + c, derivatives[i][c]
            yield 10 * (1 + row) + 8, values[i] / x[8] if i == 2 else 0.0


write_readings = straight(plain_readings, PLAIN, PACKED, 8)
write_derivatives = straight(plain_derivatives, PLAIN, PACKED, 9)


def readings_plain(packed: Pointer, x: Pointer, found: Pointer, memory: Pointer) -> None:
    """found (9,): the readings at the state x (8,)."""
    write_readings(packed, x, found)


def readings_cut(packed: Pointer, x: Pointer, found: Pointer, memory: Pointer) -> None:
    vectors = unpack_cut(carray(packed, (PACKED,)))
    outlines = carray(memory, (3, MOST, COLUMNS))
    put_readings(found, readings_of(vectors, cut_scene(vectors, state_at(x), outlines)[0]))


def readings_light(packed: Pointer, x: Pointer, found: Pointer, memory: Pointer) -> None:
    vectors = unpack(carray(packed, (PACKED,)))
    try:
        put_readings(found, bench_light.readings(vectors, state_at(x)))
    except Exception:
        put_nothing(found, 9)


def readings_cut_light(packed: Pointer, x: Pointer, found: Pointer, memory: Pointer) -> None:
    vectors = unpack(carray(packed, (PACKED,)))
    outlines = carray(memory, (3, MOST, COLUMNS))
    try:
        put_readings(found, cut_light.readings(vectors, state_at(x), outlines))
    except Exception:
        put_nothing(found, 9)


def linearised_plain(packed: Pointer, x: Pointer, found: Pointer, memory: Pointer) -> None:
    """found (10, 10): the readings at x (9,), a state and the beam's power; then their derivatives
    by each of these, a reading a row; the last column is not used."""
    write_derivatives(packed, x, found)


def linearised_cut(packed: Pointer, x: Pointer, found: Pointer, memory: Pointer) -> None:
    out = carray(found, (10, 10))
    vectors = unpack_cut(carray(packed, (PACKED,)))
    outlines = carray(memory, (3, MOST, COLUMNS))
    put_linearised(out, linearised_where_cut(with_power(vectors, x[8]), state_at(x), outlines))
    put_by_power(out, x[8])


@compilable
def put_light(found: Any, vectors: Any, detectors: Any) -> None:
    """`put_linearised`, and the derivatives by the beam's power, to which places answer too."""
    put_linearised(found, detectors)
    for k in range(3):
        for i in range(3):
            found[1 + 3 * k + i, 8] = by_power(vectors, detectors[k][0], k, i)


def linearised_light(packed: Pointer, x: Pointer, found: Pointer, memory: Pointer) -> None:
    vectors = with_power(unpack(carray(packed, (PACKED,))), x[8])
    try:
        put_light(carray(found, (10, 10)), vectors, bench_gradient.linearised(vectors, state_at(x)))
    except Exception:
        put_nothing(found, 100)


def linearised_cut_light(packed: Pointer, x: Pointer, found: Pointer, memory: Pointer) -> None:
    vectors = with_power(unpack(carray(packed, (PACKED,))), x[8])
    outlines = carray(memory, (3, MOST, COLUMNS))
    try:
        detectors = cut_light.linearised(vectors, state_at(x), outlines)
        put_light(carray(found, (10, 10)), vectors, detectors)
    except Exception:
        put_nothing(found, 100)


def nearly_linearised_light(packed: Pointer, x: Pointer, found: Pointer, memory: Pointer) -> None:
    vectors = with_power(unpack(carray(packed, (PACKED,))), x[8])
    try:
        detectors = bench_gradient.nearly_linearised(vectors, state_at(x))
        put_light(carray(found, (10, 10)), vectors, detectors)
    except Exception:
        put_nothing(found, 100)


def plain_footprints(vectors: Geometry, state: list[Value]) -> Numbered:
    """The formula of `footprints_plain`."""
    at = placed(vectors, tuple(state))
    for k in range(3):
        yield from enumerate(footprint(vectors, at, k, slopes(vectors, at, k)), 5 * k)


write_footprints = straight(plain_footprints, PARALLEL, PACKED, 8)


def footprints_plain(packed: Pointer, x: Pointer, found: Pointer, memory: Pointer) -> None:
    """found (3, 5): the footprints of the spots at the state x (8,), where rays are parallel."""
    write_footprints(packed, x, found)


def footprints_light(packed: Pointer, x: Pointer, found: Pointer, memory: Pointer) -> None:
    """The same under the light of a bench."""
    vectors, out = unpack(carray(packed, (PACKED,))), carray(found, (3, 5))
    at = curved(vectors, placed(vectors, state_at(x)))
    for k in range(3):
        ends = footprint(vectors, at, k, spreading(vectors, at, k))
        for i in range(5):
            out[k, i] = ends[i]


MODELS = {
    function.__name__: function
    for function in (
        readings_plain,
        readings_cut,
        readings_light,
        readings_cut_light,
        linearised_plain,
        linearised_cut,
        linearised_light,
        linearised_cut_light,
        nearly_linearised_light,
        footprints_plain,
        footprints_light,
    )
}


@once
def compiled(name: str) -> Any:
    """One of `MODELS`, compiled now if need be."""
    return callback(__file__, MODELS[name], kernels, machine_code, packing)


def address(name: str) -> int:
    """Where the compiled function is in this process."""
    return compiled(name).address  # type: ignore[no-any-return]


#: For so few rows no loop is compiled that calls a function for each: one in Python takes a
#: millisecond.
FEW = 1000
_KIND = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 4)


def call_each(model: int, packed: Floats, given: Floats, found: Floats, memory: Floats) -> None:
    """Calls a compiled function by its address for each row of `given`, with one of `found`."""
    start, rows = _KIND(model), (packed, given, found, memory)
    if not all(array.flags.c_contiguous for array in rows):
        raise ValueError("compiled code takes contiguous arrays only")
    vectors, asked, results, workspace = (array.ctypes.data for array in rows)
    for n in range(len(given)):
        start(vectors, asked + n * given.strides[0], results + n * found.strides[0], workspace)
    raise_failure()


def readings(sensor: Sensor) -> int:
    """The address of the function that computes a sensor's readings, compiled if need be."""
    return address(f"readings_{kind_of(sensor)}")


def footprints(sensor: Sensor) -> int:
    """The address of the function that computes the footprints of the spots."""
    return address("footprints_light" if sensor.light.on else "footprints_plain")


def linearised(sensor: Sensor) -> int:
    """The address of the function that computes readings and derivatives."""
    return address(f"linearised_{kind_of(sensor)}")


def nearly_linearised(sensor: Sensor) -> int:
    """The same, for steps of an iteration and for uncertainties: under the light of a bench the
    derivatives leave out what is slow to compute and counts for little."""
    return linearised(sensor) if kind_of(sensor) != "light" else address("nearly_linearised_light")
