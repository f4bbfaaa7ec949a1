"""Compiled loops over states. Importing this imports Numba; the functions of `arrays` do so.

Arrays in, arrays out: a sensor is its geometry's numbers (`packing.pack`), states are (n, 8),
readings (n, 9). Each state or reading is computed alone, so results do not depend on the batch.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import count
from typing import Any

import numpy as np

from ..optics import bench_gradient, bench_light
from ..optics.cut_parameters import cut_by_parameter
from ..optics.detected import cut_scene
from ..optics.effects import Light, Options
from ..optics.forward import Geometry, Openings, placed
from ..optics.forward import scene as uncut_scene
from ..optics.limits import COLUMNS, MOST
from ..optics.parameters import detector_by_parameters
from .jit import call_address, compilable, compiler
from .packing import EXAMPLE

Array = Any

compiled = compiler(__file__)


#: Whose numbers are plain, whatever carries a derivative beside them.
PLAIN = (Openings, Options)


def expression(part: Any, numbers: Iterator[int], plain: bool = False) -> str:
    """The text that makes tuples like `part` of the numbers a[0], a[1], ..."""
    if isinstance(part, tuple):
        plain = plain or isinstance(part, PLAIN)
        inner = "".join(f"{expression(each, numbers, plain)}, " for each in part)
        return f"{type(part).__name__ if hasattr(part, '_fields') else ''}({inner})"
    if part is None:
        return "None"
    number = f"a[{next(numbers)}]"
    if isinstance(part, bool):
        return f"{number}.real > 0"
    return f"{number}.real" if plain else number


def unpacking(example: Geometry) -> Callable[[Array], Geometry]:
    """The function that takes what `packing.pack` makes apart, in straight text for Numba.

    example: a sensor's vectors, with None for the last ones where these are not wanted.
    """
    names = {kind.__name__: kind for kind in (Geometry, Light, Openings, Options)}
    exec(f"def unpack(a):\n    return {expression(example, count())}", names)
    return compilable(names["unpack"])


unpack = unpacking(EXAMPLE)
unpack_cut = unpacking(EXAMPLE._replace(light=None))  # type: ignore[arg-type]


@compilable
def outlines() -> Array:
    """Memory for the sides of three outlines, for `optics.detected`."""
    return np.empty((3, MOST, COLUMNS))


@compilable
def state_of(states: Array, n: int) -> Any:
    s = states[n]
    return s[0], s[1], s[2], s[3], s[4], s[5], s[6], s[7]


@compiled
def evaluate(model: int, packed: Array, states: Array, out: Array) -> None:
    """out (n, ...): what a function of `evaluators` gives for each row of `states`, which may have
    the beam's power behind a state.  model: its address."""
    memory = outlines()
    for n in range(len(states)):
        call_address(model, packed, states[n], out[n], memory)


@compiled
def differentiate_by_parameters(packed: Array, parameters: Any, states: Array, out: Array) -> None:
    """out (n, 9, 30), zeroed: derivatives by the sensor's parameters at states (n, 8)."""
    geometry = unpack(packed)
    for n in range(len(states)):
        state = state_of(states, n)
        at = uncut_scene(geometry, state)
        for k in range(3):
            values, derivatives = detector_by_parameters(geometry, parameters, state, at, k)
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
    geometry, workspace = unpack(packed), outlines()
    for n in range(len(states)):
        state = state_of(states, n)
        at, counts = cut_scene(geometry, state, workspace)
        for p in range(len(varied)):
            copy = unpack(varied[p])
            moved = placed(copy, state)
            for k in range(3):
                if counts[k] > 0:
                    lit = at.moments[k][1][0] == at.moments[k][1][0]
                    rows = cut_by_parameter(geometry, at, copy, moved, k, workspace[k], counts[k])
                    for i in range(3):
                        out[n, 3 * k + i, p] = rows[i] if lit else np.nan


@compiled
def differentiate_light(packed: Array, varied: Array, states: Array, out: Array) -> None:
    """out (n, 9, m): derivatives under the light of a bench, by what is varied in m copies.

    varied: (m, ...) the sensor with each number varied by `dispatch.STEP`.
    """
    vectors = unpack(packed)
    for n in range(len(states)):
        state = state_of(states, n)
        at = bench_light.scene(vectors, state)
        for p in range(len(varied)):
            detectors = bench_gradient.varied(unpack(varied[p]), state, at)
            for k in range(3):
                for i in range(3):
                    out[n, 3 * k + i, p] = detectors[k][i]
