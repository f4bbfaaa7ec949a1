"""The special functions that all readings need, alone: a floor for the time of a reading."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ..model import blocks
from ..model.block_code import LaneWrite, each_block
from ..model.packing import vectors_of
from ..optics.central import side_central
from ..optics.forward import Geometry
from ..scalars.lanes import LaneWriter

Array = Any


def stage_code(formula: Callable[[LaneWriter, Any, tuple[Any, ...]], Iterable[Any]]) -> LaneWrite:
    """Make block code that writes one sum of numbers per pose."""

    def write(code: LaneWriter, vectors: Geometry, states: Any, found: Any) -> None:
        state = tuple(code.load_rows(states, 8, 8))
        total: Any = 0.0
        for number in formula(code, vectors, state):
            total = total + number
        code.store_lanes(total, found, 0)

    return each_block(write, lambda code, pointer: vectors_of(code, pointer, "plain"), 1)


def special(code: LaneWriter, vectors: Geometry, state: tuple[Any, ...]) -> Iterator[Any]:
    """Evaluate only the functions of three edges, which all readings need: a Gaussian of the point;
    of each edge a Gaussian, two error functions, a triangle's mass, a root and an arc tangent; of
    each angle its sine and cosine."""
    q = state[:2]
    for k in range(3):
        a, h, angle = state[k], state[k + 1], state[3 + k]
        yield from side_central(q, a, h)
        yield code.function("sqrt", a * a + angle)
        yield code.function("atan2", a, h)
        yield code.function("sin", angle) + code.function("cos", angle)


#: The functions alone, of inputs that need no computation.
FLOOR = "functions of three edges alone"


@cache
def floor() -> Callable[[Array, Array, Array], None]:
    """The functions as a function of arrays: a sensor's vectors, (n, 8) states, (n,) results; n in
    blocks."""
    code = blocks.lane_code(
        "stage_0", blocks.lanes(), 5, lambda: stage_code(special), Path(__file__)
    )

    def work(vectors: Array, states: Array, out: Array) -> None:
        count = len(states) // blocks.lanes()
        left = np.empty(count, np.int64)
        code(*map(blocks.address_of, (vectors, states, out, left)), count)

    return work
