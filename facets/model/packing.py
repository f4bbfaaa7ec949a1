"""A sensor's vectors as one array of numbers for compiled code."""

from __future__ import annotations

from itertools import count
from typing import Any

import numpy as np

from ..optics.effects import LightOptions
from ..optics.forward import Geometry, build_geometry
from ..optics.parameters import parameter_axes
from ..scalars.dispatch import STEP
from ..scalars.dual import Dual, value_and_slope
from ..scalars.nesting import leaves, nest
from . import rare
from .kinds import LIT

#: An example of a sensor's vectors, for their arrangement.
EXAMPLE = build_geometry((1.0,) * 30)
#: The address of `rare.TABLE`, as a float.
HERE = rare.ADDRESS.item()
#: The number of numbers that `pack` makes from a sensor, before the address.
PACKED = len(list(leaves(EXAMPLE)))
#: The same for the vectors' derivatives by the parameters.
AXES = parameter_axes((1.0,) * 30)
#: The number of numbers in an input row: of a state, or of a state and the beam's power.
STATE, WITH_POWER = 8, 9
#: The arrangement without apertures for parallel rays, and for any rays.
PLAIN = EXAMPLE._replace(openings=None, light=None)  # type: ignore[arg-type]
PARALLEL = EXAMPLE._replace(light=None)  # type: ignore[arg-type]


def pack(vectors: Geometry) -> np.ndarray:
    """Pack a sensor's vectors into one array, followed by the address of `rare.TABLE`.

    The address is valid in this process.
    """
    numbers = np.array([number + 0.0 for number in leaves(vectors)])
    return np.concatenate([numbers, rare.ADDRESS])


def row_size(kind: str) -> int:
    """The number of numbers in a row of `pack_rows` for a kind of light: "plain", or one of LIT."""
    return PACKED if kind in LIT else len(list(leaves(PLAIN[:-2])))


def pack_rows(vectors: Geometry, kind: str, count: int) -> np.ndarray:
    """Pack the vectors of several sensors, arrays (count,) or numbers that all have in common, into
    rows (count, `row_size`)."""
    rows = np.empty((count, row_size(kind)))
    for n, numbers in zip(range(rows.shape[1]), leaves(vectors), strict=False):
        rows[:, n] = numbers
    return rows


def pack_slopes(vectors: Geometry) -> np.ndarray:
    """Pack the derivatives of a sensor's vectors by m variables: (m, ...), each row like `pack`."""
    slopes = [value_and_slope(number)[1] for number in leaves(vectors)]
    count = max(np.size(slope) for slope in slopes)
    return np.array([np.broadcast_to(slope, count) for slope in slopes]).T.copy()


def carry(vectors: Geometry, moved: Geometry) -> np.ndarray:
    """Copies of a sensor (m, ...) whose imaginary parts are their derivatives times STEP, for
    Numba."""
    return pack(vectors)[:-1] + 1j * STEP * pack_slopes(moved)


def is_of_this_process(packed: np.ndarray) -> bool:
    """Whether the address behind a sensor's vectors is that of this process.

    As a float an address is a very small number, never NaN.
    """
    return packed.item(-1) == HERE  # type: ignore[no-any-return]


def vectors_of(writer: Any, pointer: Any, kind: str) -> Geometry:
    """The vectors in memory (`vectors_at`) that formulas for a kind of light take: "plain", or one
    of LIT."""
    if kind not in LIT:
        return vectors_at(writer, pointer, PLAIN)  # type: ignore[no-any-return]
    whole = vectors_at(writer, pointer, EXAMPLE)
    coated, polarised, profiled = LIT[kind]
    options = whole.light.options._replace(
        on=True, coated=coated, polarised=polarised, profiled=profiled
    )
    light = whole.light._replace(options=options)
    return whole._replace(openings=None, light=light)  # type: ignore[no-any-return]


def is_ideal(vectors: Any) -> bool:
    """Whether formulas for ideal light take these vectors."""
    return vectors.light is None


def carry_slopes(values: Any, slopes: Any) -> Any:
    """Give vectors their derivatives; numbers that are always plain stay so."""
    if isinstance(values, LightOptions) or values is None:
        return values
    if not isinstance(values, tuple):
        return Dual(values, slopes)
    parts = [carry_slopes(*pair) for pair in zip(values, slopes, strict=True)]
    return type(values)(*parts) if hasattr(values, "_fields") else tuple(parts)


def vectors_at(writer: Any, pointer: Any, example: Any) -> Any:
    """A sensor's vectors in memory, for code that is being written.

    writer: a `scalars.machine.MachineWriter`. example: their arrangement, with None for vectors
    that are not needed.
    """
    places = count()
    vectors = [
        part
        if part is None
        else nest(part, (writer.load(pointer, next(places)) for _ in leaves(part)))
        for part in example
    ]
    return type(example)(*vectors)
