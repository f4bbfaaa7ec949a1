"""The model at many states, a block of them at a time, by machine code of `block_code`.

Each lane of the processor has a pose (`scalars.lanes`). What does not fit a block, because a facet
is faint, the apex far off the beam or the mirror far turned, is left, and computed by
`evaluators`, one state at a time. What a pose gives does not depend on the others in its block, nor
on how many there are.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.units import Floats
from .threads import Pool, once

if TYPE_CHECKING:
    from .block_code import LaneWrite
    from .object_code import Write

#: The files that blocks are made of, beside the optics.
CODE = tuple(
    Path(__file__).parent / name
    for name in ("blocks.py", "block_code.py", "packing.py", "kinds.py")
)


#: Lanes of code for one pose at a time: each more takes its time.
SINGLE = 2


@cache
def lanes() -> int:
    """Poses in a block of many: as many as the processor's registers have room for."""
    from .object_code import vector_bits

    return vector_bits() // 64


def lane_code(
    name: str, width: int, count: int, write: Callable[[], LaneWrite], *files: str | Path | None
) -> Callable[..., None]:
    """`object_code.function` of code for so many lanes."""
    from .object_code import function

    def make_writer() -> Write:
        formula = write()
        return lambda builder, arguments: formula(builder, arguments, width)

    return function(f"{name}_in_{width}_lanes", count, make_writer, *CODE, *files)


def task_of(name: str) -> str:
    """What a kernel computes, by its name without that of the light's kind."""
    return name.partition("_of_")[0]


@once
def kernel(name: str, width: int | None = None) -> Callable[..., None]:
    """One of `block_code.LOOPS`, compiled now if need be: a function of the addresses of a sensor's
    vectors, of states, of where results go and of where a 64-bit integer for each block tells by
    its bits which lanes are left; and of how many blocks there are.

    width: of a block; `lanes()` unless given.
    """
    return load_code(name, 5, width)


def load_code(name: str, count: int, width: int | None = None) -> Callable[..., None]:
    """One of `block_code.LOOPS`, which takes `count` integers."""

    def make_writer() -> LaneWrite:
        from . import block_code

        return block_code.LOOPS[name]

    return lane_code(name, width or lanes(), count, make_writer)


@once
def slopes_kernel(name: str) -> Callable[..., None]:
    """That of `slopes`, see `block_code.each_block_of_slopes`."""
    return load_code(name, 7)


def slopes(name: str, vectors: Floats, varied: Floats, states: Floats, found: Floats) -> Any:
    """Fills found (n, 9, m): the derivatives of the readings at states (n, 8) by m parameters of a
    sensor; returns the numbers of those that are left.

    name: of a kernel: "slopes_of_KIND", KIND of `kinds.LIT`, where `varied` (m, ...) is how much
    each number of `vectors` answers to a parameter; or "slopes_by_parameters", where it is
    `parameters.Axes`.
    """
    code, copies = slopes_kernel(name), found.shape[2]
    whole, short = divmod(len(states), lanes())
    left = np.zeros(whole + 1, np.int64)
    if whole:
        code(*map(address_of, (vectors, varied, states, found, left)), copies, whole)
    if short:
        rows = states[np.minimum(np.arange(-short, lanes() - short), -1)]
        out = np.empty((lanes(), *found.shape[1:]))
        code(*map(address_of, (vectors, varied, rows, out, left[-1:])), copies, 1)
        found[-short:] = out[:short]
    return lanes_of(left, len(states))


class BlockMemory:
    """Memory for one block: of a single state, or of the last states of a batch, padded.

    One of `SINGLES` or `RESTS` serves one call at a time.
    """

    def __init__(self, width: int | None = None) -> None:
        size = width or lanes()
        self.rows, self.left = np.empty((size, 8)), np.empty(1, np.int64)
        found = np.empty(72 * size)
        self.found = {
            "readings": found[: 9 * size].reshape(size, 9),
            "derivatives": found.reshape(size, 9, 8),
            "footprints": found[: 15 * size].reshape(size, 3, 5),
        }
        self.addresses = [address_of(array) for array in (self.rows, found, self.left)]
        self.bits = self.left.data
        self._vectors: Any = None
        self._address = 0

    def results(self, name: str) -> Any:
        return self.found[task_of(name).removeprefix("approximate_")]

    def address_of_vectors(self, vectors: Floats) -> int:
        """`address_of`, kept for the vectors of the last call."""
        if vectors is not self._vectors:
            self._vectors, self._address = vectors, address_of(vectors)
        return self._address


def run_rest(name: str, vectors: Floats, states: Floats, found: Floats) -> int:
    """Fills `found` for less than a block of states; returns a bit for each that is left."""
    memory, short = RESTS.take(), len(states)
    memory.rows[:short] = states
    memory.rows[short:] = states[-1]
    kernel(name)(memory.address_of_vectors(vectors), *memory.addresses, 1)
    found[:] = memory.results(name)[:short]
    bits = memory.bits[0] & ((1 << short) - 1)
    RESTS.put_back(memory)
    return bits


def run_one(name: str, vectors: Floats, state: Floats) -> Floats | None:
    """Results at one state (8,); None where it is left."""
    memory = SINGLES.take()
    memory.rows[:] = state
    kernel(name, SINGLE)(memory.address_of_vectors(vectors), *memory.addresses, 1)
    found: Floats | None = None if memory.bits[0] else memory.results(name)[0].copy()
    SINGLES.put_back(memory)
    return found


def run(name: str, vectors: Floats, states: Floats, found: Floats) -> Any:
    """Fills `found` for states (n, 8); returns the numbers of those that are left."""
    whole, short = divmod(len(states), lanes())
    left = np.zeros(whole + 1, np.int64)
    if whole:
        kernel(name)(*map(address_of, (vectors, states, found, left)), whole)
    if short:
        left[-1] = run_rest(name, vectors, states[-short:], found[-short:])
    return lanes_of(left, len(states))


def lanes_of(bits: Any, count: int) -> Any:
    """The numbers of the lanes whose bits are set, of those that are not padding."""
    if not bits.any():
        return np.empty(0, np.intp)
    return np.flatnonzero(((bits[:, None] >> np.arange(lanes())) & 1).ravel()[:count])


def address_of(array: Any) -> int:
    """Where the numbers of a contiguous array are."""
    if not array.flags.c_contiguous:
        raise ValueError("compiled code takes contiguous arrays only")
    return array.__array_interface__["data"][0]  # type: ignore[no-any-return]


SINGLES = Pool(partial(BlockMemory, SINGLE))
RESTS = Pool(BlockMemory)
