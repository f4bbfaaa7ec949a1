"""A compiled loop over states with cut light, and its tools. Imports Numba.

Arrays in, arrays out: a sensor is its packed vectors (`packing.pack`), states are (n, 8), readings
(n, 9). Each state is computed alone, so results do not depend on the batch.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import count
from typing import Any

import numpy as np

from ..optics.cut_parameters import cut_parameter_slopes
from ..optics.detected import cut_scene
from ..optics.effects import Light, LightOptions
from ..optics.forward import Geometry, Openings, dark_scene
from ..optics.limits import COLUMNS, MOST_SIDES
from .jit import compilable, compiler
from .packing import EXAMPLE

Array = Any

compiled = compiler(__file__)


#: Types whose numbers are plain, even if other numbers carry a derivative.
PLAIN = (Openings, LightOptions)


def expression(part: Any, numbers: Iterator[int], plain: bool = False) -> str:
    """The text that makes tuples like `part` from the numbers a[0], a[1], ..."""
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
    """Make the function that unpacks the array of `packing.pack`, as straight text for Numba.

    example: a sensor's vectors, with None for last ones that are not needed.
    """
    names = {kind.__name__: kind for kind in (Geometry, Light, Openings, LightOptions)}
    exec(f"def unpack(a):\n    return {expression(example, count())}", names)
    return compilable(names["unpack"])


unpack = unpacking(EXAMPLE)
unpack_cut = unpacking(EXAMPLE._replace(light=None))  # type: ignore[arg-type]


@compilable
def outlines() -> Array:
    """Memory for the sides of three outlines, for `optics.detected`."""
    return np.empty((3, MOST_SIDES, COLUMNS))


@compilable
def state_of(states: Array, n: int) -> Any:
    s = states[n]
    return s[0], s[1], s[2], s[3], s[4], s[5], s[6], s[7]


@compiled
def differentiate_cut(packed: Array, varied: Array, states: Array, out: Array) -> None:
    """Overwrite out (n, 9, 30) with the derivatives of the sub-beams that are cut.

    varied: (30, ...) the sensor with each parameter varied, see `optics.cut_parameters`.
    """
    geometry, workspace = unpack(packed), outlines()
    for n in range(len(states)):
        state = state_of(states, n)
        at, counts = cut_scene(geometry, state, workspace)
        for p in range(len(varied)):
            copy = unpack(varied[p])
            moved = dark_scene(copy, state)
            for k in range(3):
                if counts[k] > 0:
                    lit = at.moments[k][1][0] == at.moments[k][1][0]
                    rows = cut_parameter_slopes(
                        geometry, at, copy, moved, k, workspace[k], counts[k]
                    )
                    for i in range(3):
                        out[n, 3 * k + i, p] = rows[i] if lit else np.nan
