"""A sensor's vectors as one array of numbers for compiled code."""

from __future__ import annotations

from itertools import count
from typing import Any

import numpy as np

from ..optics.effects import IDEAL, LightOptions
from ..optics.forward import Geometry, Openings, build_geometry
from ..scalars.dual import Dual
from ..scalars.nesting import leaves, nest
from .kinds import CUT, LIT

#: An example of a sensor's vectors, for their arrangement.
EXAMPLE = build_geometry((1.0,) * 30)
#: The number of numbers that `pack` makes from a sensor.
PACKED = len(list(leaves(EXAMPLE)))
#: The arrangement of a sensor's vectors under ideal light: without apertures, and with them.
PLAIN = EXAMPLE._replace(openings=None, light=None)  # type: ignore[arg-type]
PARALLEL = EXAMPLE._replace(light=None)  # type: ignore[arg-type]


def pack(vectors: Geometry) -> np.ndarray:
    """Pack a sensor's vectors into one array (numbers,)."""
    return np.array([number + 0.0 for number in leaves(vectors)])


def row_size(kind: str) -> int:
    """The length of a row of `pack_rows` for a kind of light: "plain", or one of LIT."""
    return PACKED if kind in LIT else len(list(leaves(PLAIN[:-2])))


def pack_rows(vectors: Geometry, count: int, width: int = PACKED) -> np.ndarray:
    """The first `width` numbers of `pack` for several sensors, in rows (count, width).

    vectors: with numbers that all sensors share, and columns with one number for each sensor.
    """
    rows = np.empty((count, width))
    for n, number in zip(range(width), leaves(vectors), strict=False):
        rows[:, n] = np.ravel(number)
    rows += 0.0
    return rows


def pack_slopes(vectors: Geometry, count: int) -> np.ndarray:
    """Pack the derivatives of a sensor's vectors by some variables: (count, ...).

    Each row is like that of `pack`, with eight more zeros for the derivatives of a state.

    vectors: with floats, and with `Dual` numbers or complex columns, which carry derivatives.
    """
    slopes = np.zeros((count, PACKED + 8))
    for n, number in enumerate(leaves(vectors)):
        if isinstance(number, Dual | np.ndarray):
            slopes[:, n] = number.imag
    return slopes


def vectors_of(writer: Any, pointer: Any, kind: str) -> Geometry:
    """The vectors in memory (`vectors_at`) for the formulas of a kind of light: "plain", one of LIT
    or CUT, or ANY_LIGHT, whose options are in memory, too."""
    if kind == "plain":
        return vectors_at(writer, pointer, PLAIN)  # type: ignore[no-any-return]
    if kind == "cut":
        return vectors_at(writer, pointer, PARALLEL)  # type: ignore[no-any-return]
    example = vectors_at(writer, pointer, EXAMPLE)
    flags: Any = {**LIT, **CUT}.get(kind)
    coated, polarised, profiled = flags or (flag > 0 for flag in example.light.options[1:4])
    options = example.light.options._replace(
        on=True, coated=coated, polarised=polarised, profiled=profiled
    )
    vectors = example._replace(light=example.light._replace(options=options))
    return vectors if kind in CUT else vectors._replace(openings=None)  # type: ignore[no-any-return]


def is_cut(vectors: Any) -> bool:
    """Whether formulas for light that apertures cut take these vectors."""
    return vectors.openings is not None


def is_ideal(vectors: Any) -> bool:
    """Whether formulas for ideal light take these vectors."""
    return vectors.light is None


def complete_light(vectors: Any) -> Any:
    """Add ideal light, which is not in memory, to vectors without light."""
    return vectors._replace(light=IDEAL) if is_ideal(vectors) else vectors


def carry_slopes(values: Any, slopes: Any) -> Any:
    """Combine vectors with their derivatives; options and openings have none."""
    if isinstance(values, LightOptions | Openings) or values is None:
        return values
    if not isinstance(values, tuple):
        return Dual(values, slopes)
    parts = [carry_slopes(*pair) for pair in zip(values, slopes, strict=True)]
    return type(values)(*parts) if hasattr(values, "_fields") else tuple(parts)


def vectors_at(writer: Any, pointer: Any, example: Any) -> Any:
    """A sensor's vectors in memory, for code that is being written.

    writer: a `scalars.lanes.LaneWriter`. example: their arrangement, with None for vectors
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
