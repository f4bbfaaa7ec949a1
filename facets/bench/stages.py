"""The special functions that all readings need, alone: a floor for the time of a reading."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

from ..model import blocks
from ..model.block_code import LaneWrite, each_block
from ..model.packing import vectors_of
from ..optics.central import side_central
from ..optics.forward import Geometry
from ..scalars.lanes import LaneWriter

Array = Any


def special(code: LaneWriter, state: tuple[Any, ...]) -> Iterator[Any]:
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

    def write(code: LaneWriter, vectors: Geometry, states: Any, results: Any) -> None:
        total: Any = 0.0
        for number in special(code, tuple(code.load_rows(states, 8, 8))):
            total = total + number
        code.store_lanes(total, results, 0)

    def make() -> LaneWrite:
        return each_block(write, lambda code, pointer: vectors_of(code, pointer, "plain"), 1)

    code = blocks.lane_code("floor", blocks.lanes(), 4, make, Path(__file__))

    def work(vectors: Array, states: Array, out: Array) -> None:
        count = len(states) // blocks.lanes()
        code(*map(blocks.address_of, (vectors, states, out)), count)

    return work
