"""Compiled loops over states. Importing this imports Numba; the functions of `arrays` do so.

Arrays in, arrays out: a sensor is its geometry's numbers (`pack`), states are (n, 8), readings
(n, 9). Each state or reading is computed alone, so results do not depend on the batch.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..optics.cut_parameters import cut_by_parameter
from ..optics.detected import cut_scene, linearised, readings
from ..optics.footprint import footprint
from ..optics.forward import Geometry, Openings, placed
from ..optics.forward import scene as uncut_scene
from ..optics.limits import COLUMNS, MOST
from ..optics.parameters import detector_by_parameters
from .jit import compilable, compiler

Array = Any

compiled = compiler(__file__)


def pack(sensor: Geometry) -> np.ndarray:
    """A sensor's geometry as one array, for `unpack`."""
    parts: list[Any] = [sensor.direction, (sensor.power,), *sensor.spread, *sensor.whitening]
    parts += [*sensor.normals, *sensor.centres]
    for axes in sensor.axes:
        parts += [*axes]
    openings = sensor.openings
    parts += [(openings.cut, openings.radius, openings.tip, openings.rim, openings.gap)]
    parts += [*openings.halves]
    return np.array([number for part in parts for number in part])


@compilable
def triple(a: Array, i: int) -> Any:
    return a[i], a[i + 1], a[i + 2]


@compilable
def unpack(a: Array) -> Geometry:
    halves = ((a[66], a[67]), (a[68], a[69]), (a[70], a[71]))
    found: Geometry = unpack_with(a, Openings(a[61] > 0, a[62], a[63], a[64], a[65], halves))
    return found


@compilable
def unpack_with(a: Array, openings: Openings) -> Geometry:
    return Geometry(
        triple(a, 0),
        a[3],
        (triple(a, 4), triple(a, 7)),
        (triple(a, 10), triple(a, 13)),
        (triple(a, 16), triple(a, 19), triple(a, 22)),
        (triple(a, 25), triple(a, 28), triple(a, 31)),
        (
            (triple(a, 34), triple(a, 37), triple(a, 40)),
            (triple(a, 43), triple(a, 46), triple(a, 49)),
            (triple(a, 52), triple(a, 55), triple(a, 58)),
        ),
        openings,
    )


@compilable
def outlines() -> Array:
    """Memory for the sides of three outlines, for `optics.detected`."""
    return np.empty((3, MOST, COLUMNS))


@compilable
def state_of(states: Array, n: int) -> Any:
    s = states[n]
    return s[0], s[1], s[2], s[3], s[4], s[5], s[6], s[7]


@compiled
def read(packed: Array, states: Array, out: Array) -> None:
    """out (n, 9): the readings at states (n, 8)."""
    sensor, room = unpack(packed), outlines()
    for n in range(len(states)):
        on_detectors = readings(sensor, state_of(states, n), room)
        for k in range(3):
            for i in range(3):
                out[n, 3 * k + i] = on_detectors[k][i]


@compiled
def outline(packed: Array, states: Array, out: Array) -> None:
    """out (n, 3, 5): the footprints of the spots at states (n, 8)."""
    sensor = unpack(packed)
    for n in range(len(states)):
        at = placed(sensor, state_of(states, n))
        for k in range(3):
            ends = footprint(sensor, at, k)
            for i in range(5):
                out[n, k, i] = ends[i]


@compiled
def differentiate(packed: Array, states: Array, out: Array) -> None:
    """out (n, 9, 8): the Jacobian at states (n, 8)."""
    sensor, room = unpack(packed), outlines()
    for n in range(len(states)):
        detectors = linearised(sensor, state_of(states, n), room)
        for k in range(3):
            values, derivatives = detectors[k]
            for i in range(3):
                lit = values[i] == values[i]
                for c in range(8):
                    out[n, 3 * k + i, c] = derivatives[i][c] if lit else np.nan


@compiled
def determine(
    packed: Array, states: Array, noise: Array, sigmas: Array, left_out: int, out: Array
) -> None:
    """out (n, 3): determinant without one row, smallest singular value, condition number.

    noise: (3,) a place's sigma times the power (mm mW), a power's (mW), and whether the last two
    are wanted.  sigmas (n, 9): where the readings' standard deviations are not those; else empty.
    The Jacobian's rows are then in standard deviations, its columns in um and urad.
    """
    sensor, room = unpack(packed), outlines()
    square, scaled, normal = np.empty((8, 8)), np.empty((9, 8)), np.empty((8, 8))
    for n in range(len(states)):
        detectors = linearised(sensor, state_of(states, n), room)
        lit = True
        for k in range(3):
            values, derivatives = detectors[k]
            lit = lit and values[0] == values[0]
            for i in range(3):
                row = 3 * k + i
                sigma = noise[0] / values[2] if i < 2 else noise[1]
                if len(sigmas) > 0:
                    sigma = sigmas[n, row]
                for c in range(8):
                    if row != left_out:
                        square[row - (row > left_out), c] = derivatives[i][c]
                    scaled[row, c] = derivatives[i][c] * (1e-6 if 3 <= c < 6 else 1e-3) / sigma
        if not lit:
            out[n] = np.nan
            continue
        out[n, 0] = np.linalg.det(square)
        if noise[2] > 0:
            out[n, 1], out[n, 2] = extremes(scaled, normal)


#: Past this condition number, squared, the eigenvalues of J'J have lost half their digits.
SQUARED = 1e8


@compilable
def extremes(matrix: Array, normal: Array) -> tuple[float, float]:
    """The smallest singular value and the condition number. normal: memory, (8, 8)."""
    for i in range(8):
        for j in range(i + 1):
            total = 0.0
            for row in range(9):
                total += matrix[row, i] * matrix[row, j]
            normal[i, j] = total
            normal[j, i] = total
    values = np.linalg.eigvalsh(normal)
    if values[0] * SQUARED > values[7]:
        return np.sqrt(values[0]), np.sqrt(values[7] / values[0])
    singular = np.linalg.svd(matrix)[1]
    return singular[7], singular[0] / singular[7]


@compiled
def differentiate_by_parameters(packed: Array, parameters: Any, states: Array, out: Array) -> None:
    """out (n, 9, 30), zeroed: derivatives by the sensor's parameters at states (n, 8)."""
    sensor = unpack(packed)
    for n in range(len(states)):
        state = state_of(states, n)
        at = uncut_scene(sensor, state)
        for k in range(3):
            values, derivatives = detector_by_parameters(sensor, parameters, state, at, k)
            for i in range(3):
                row = out[n, 3 * k + i]
                beam, facet_a, facet_b, facet_c, psd = derivatives[i]
                for c in range(6):
                    row[c] = beam[c]
                    row[12 + 6 * k + c] = psd[c]
                for c in range(2):
                    row[6 + c], row[8 + c], row[10 + c] = facet_a[c], facet_b[c], facet_c[c]
                if values[i] != values[i]:
                    row[:] = np.nan


@compiled
def differentiate_cut(packed: Array, varied: Array, states: Array, out: Array) -> None:
    """Overwrites out (n, 9, 30) with the derivatives of those sub-beams that are cut.

    varied: (30, ...) the sensor with each parameter varied, see `optics.cut_parameters`.
    """
    sensor, room = unpack(packed), outlines()
    for n in range(len(states)):
        state = state_of(states, n)
        at, counts = cut_scene(sensor, state, room)
        for p in range(len(varied)):
            copy = unpack_with(varied[p], sensor.openings)
            moved = placed(copy, state)
            for k in range(3):
                if counts[k] > 0:
                    lit = at.moments[k][1][0] == at.moments[k][1][0]
                    rows = cut_by_parameter(sensor, at, copy, moved, k, room[k], counts[k])
                    for i in range(3):
                        out[n, 3 * k + i, p] = rows[i] if lit else np.nan
