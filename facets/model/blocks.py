"""The model at many states, a block of them at a time, by machine code of `block_code`.

Each lane of the processor computes one pose (`scalars.lanes`). The result of a pose does not depend
on the others in its block, nor on their number.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from math import prod
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.units import Floats
from .threads import Pool, once

if TYPE_CHECKING:
    from .block_code import LaneWrite
    from .object_code import Write

#: The files from which blocks are made, in addition to the optics.
CODE = tuple(
    Path(__file__).parent / name
    for name in ("blocks.py", "block_code.py", "packing.py", "kinds.py")
)


#: The shape of a kernel's result at one state, by its task.
SHAPES = {"readings": (9,), "derivatives": (9, 8), "footprints": (3, 5)}
#: Number of lanes for one pose at a time; each additional lane takes time.
SINGLE = 2


@cache
def lanes() -> int:
    """Number of poses in a block: as many as the processor's registers hold."""
    from .object_code import vector_bits

    return vector_bits() // 64


def lane_code(
    name: str, width: int, count: int, write: Callable[[], LaneWrite], *files: str | Path | None
) -> Callable[..., None]:
    """Compile `object_code.function` for a number of lanes.

    Functions that few lanes need are compiled for `lanes()` lanes only, and are also called by
    single poses.
    """
    from .object_code import function

    def make_writer() -> Write:
        from ..scalars.lanes import LaneWriter

        formula, begin_code = write(), partial(LaneWriter, lanes=width, called_lanes=lanes())
        return lambda builder, arguments: formula(builder, arguments, begin_code)

    return function(f"{name}_in_{width}_lanes", count, make_writer, *CODE, *files)


def task_of(name: str) -> str:
    """The task of a kernel: its name without the kind of light."""
    return name.partition("_of_")[0]


@once
def kernel(name: str, width: int | None = None) -> Callable[..., None]:
    """Return one of `block_code.LOOPS`, compiled if needed.

    It is a function of the addresses of a sensor's vectors, of states and of the results, and of
    the number of blocks. width: of a block; `lanes()` unless given.
    """
    return load_code(name, 4, width)


def load_code(name: str, count: int, width: int | None = None) -> Callable[..., None]:
    """Load one of `block_code.LOOPS`, a function of `count` integers."""

    def make_writer() -> LaneWrite:
        from . import block_code

        return block_code.LOOPS[name]

    return lane_code(name, width or lanes(), count, make_writer)


@once
def slopes_kernel(name: str) -> Callable[..., None]:
    """Return a kernel of `slopes`, see `block_code.write_slopes`."""
    return load_code(name, 6)


def slopes(name: str, vectors: Floats, varied: Floats, states: Floats, out: Floats) -> None:
    """Fill `out` (n, 9, m) with the derivatives of the readings at states (n, 8) by m parameters
    of a sensor.

    name: of a kernel, "slopes_of_KIND".  varied: (m, ...) derivatives of each number of `vectors`
    by a parameter, and of a state, which are used only under real light.
    """
    code, copies = slopes_kernel(name), out.shape[2]
    blocks, short = divmod(len(states), lanes())
    if blocks:
        code(*map(address_of, (vectors, varied, states, out)), copies, blocks)
    if short:
        rows = states[np.minimum(np.arange(-short, lanes() - short), -1)]
        last = np.empty((lanes(), *out.shape[1:]))
        code(*map(address_of, (vectors, varied, rows, last)), copies, 1)
        out[-short:] = last[:short]


class BlockMemory:
    """Memory for one block: a single state, or the last states of a batch with padding.

    One of `SINGLES` or `RESTS` serves one call at a time.
    """

    def __init__(self, width: int | None = None) -> None:
        size = width or lanes()
        self.rows = np.empty((size, 8))
        numbers = np.empty(72 * size)
        self.found = {
            task: numbers[: size * prod(shape)].reshape(size, *shape)
            for task, shape in SHAPES.items()
        }
        self.addresses = [address_of(array) for array in (self.rows, numbers)]
        self._vectors: Any = None
        self._address = 0

    def results(self, name: str) -> Any:
        """The results of the last call, (lanes, ...), by their name."""
        return self.found[task_of(name).removeprefix("approximate_")]

    def address_of_vectors(self, vectors: Floats) -> int:
        """The address of the vectors, which is cached for those of the last call."""
        if vectors is not self._vectors:
            self._vectors, self._address = vectors, address_of(vectors)
        return self._address


def run_rest(name: str, vectors: Floats, states: Floats, out: Floats) -> None:
    """Fill `out` (n, ...) for states (n, 8), fewer than a block has."""
    memory, short = RESTS.take(), len(states)
    memory.rows[:short] = states
    memory.rows[short:] = states[-1]
    kernel(name)(memory.address_of_vectors(vectors), *memory.addresses, 1)
    out[:] = memory.results(name)[:short]
    RESTS.put_back(memory)


def run_one(name: str, vectors: Floats, state: Floats) -> Floats:
    """Return the results at one state (8,)."""
    memory = SINGLES.take()
    memory.rows[:] = state
    kernel(name, SINGLE)(memory.address_of_vectors(vectors), *memory.addresses, 1)
    results: Floats = memory.results(name)[0].copy()
    SINGLES.put_back(memory)
    return results


def run(name: str, vectors: Floats, states: Floats, out: Floats) -> None:
    """Fill `out` for states (n, 8)."""
    blocks, short = divmod(len(states), lanes())
    if blocks:
        kernel(name)(*map(address_of, (vectors, states, out)), blocks)
    if short:
        run_rest(name, vectors, states[-short:], out[-short:])


def address_of(array: Any) -> int:
    """The address of the numbers of a contiguous array. Raises `ValueError` for any other."""
    if not array.flags.c_contiguous:
        raise ValueError("compiled code takes only contiguous arrays")
    return array.__array_interface__["data"][0]  # type: ignore[no-any-return]


SINGLES = Pool(partial(BlockMemory, SINGLE))
RESTS = Pool(BlockMemory)
