"""The model at many states, a block of them at a time, by machine code of `block_code`.

Each lane of the processor has a pose (`scalars.lanes`). What does not fit a block, because a facet
is faint, the apex far off the beam or the mirror far turned, is left, and computed by
`evaluators`, one state at a time. What a pose gives does not depend on the others in its block, nor
on how many there are.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ..core.units import Floats
from .threads import Pool

#: Poses in a block.
LANES = 4
#: The files that blocks are made of, beside the optics.
CODE = tuple(
    Path(__file__).parent / name
    for name in ("blocks.py", "block_code.py", "packing.py", "kinds.py")
)


def task_of(name: str) -> str:
    """What a kernel computes, by its name without that of the light's kind."""
    return name.partition("_of_")[0]


@cache
def kernel(name: str) -> Callable[..., None]:
    """One of `block_code.LOOPS`, compiled now if need be: a function of the addresses of a sensor's
    vectors, of states, of where results go and of where a 64-bit integer for each block tells by
    its bits which lanes are left; and of how many blocks there are."""
    return made(name, 5)


def made(name: str, count: int) -> Callable[..., None]:
    """One of `block_code.LOOPS`, which takes `count` integers."""
    from .object_code import Write, function

    def written() -> Write:
        from . import block_code

        return block_code.LOOPS[name]

    return function(name, count, written, *CODE)


@cache
def slopes_kernel(name: str) -> Callable[..., None]:
    """That of `slopes`, see `block_code.each_block_of_slopes`."""
    return made(name, 7)


def slopes(name: str, vectors: Floats, varied: Floats, states: Floats, found: Floats) -> Any:
    """Fills found (n, 9, m): the derivatives of the readings at states (n, 8) by m parameters of a
    sensor; returns the numbers of those that are left.

    name: of a kernel: "slopes_of_KIND", KIND of `kinds.LIT`, where `varied` (m, ...) is how much
    each number of `vectors` answers to a parameter; or "slopes_by_parameters", where it is
    `parameters.Axes`.
    """
    count = -(-len(states) // LANES)
    rows = states[np.minimum(np.arange(count * LANES), len(states) - 1)]
    out, left = np.empty((len(rows), *found.shape[1:])), np.empty(count, np.int64)
    addresses = map(address_of, (vectors, varied, rows, out, left))
    slopes_kernel(name)(*addresses, found.shape[2], count)
    found[:] = out[: len(states)]
    return lanes_of(left, len(states)) if left.any() else ()


class Padding:
    """Memory for a single state, and for the last block of a batch, which the last row fills up.

    One of `PADDING` serves one call at a time.
    """

    def __init__(self) -> None:
        self.rows, self.left = np.empty((LANES, 8)), np.empty(1, np.int64)
        found = np.empty(72 * LANES)
        self.found = {
            "readings": found[: 9 * LANES].reshape(LANES, 9),
            "derivatives": found.reshape(LANES, 9, 8),
            "footprints": found[: 15 * LANES].reshape(LANES, 3, 5),
        }
        self.addresses = [address_of(array) for array in (self.rows, found, self.left)]
        self.bits = self.left.data
        self.vectors: Any = None
        self.where = 0

    def results(self, name: str) -> Any:
        return self.found[task_of(name).removeprefix("near_")]

    def run(self, name: str, vectors: Floats, states: Floats, found: Floats) -> int:
        """Fills `found` for less than a block of states; returns a bit for each that is left."""
        short = len(states)
        self.rows[:short] = states
        self.rows[short:] = states[-1]
        self._call(name, vectors)
        found[:] = self.results(name)[:short]
        return self.bits[0] & ((1 << short) - 1)

    def one(self, name: str, vectors: Floats, state: Floats) -> Floats | None:
        """What is found at one state (8,); None where it is left."""
        self.rows[:] = state
        self._call(name, vectors)
        return None if self.bits[0] else self.results(name)[0].copy()

    def _call(self, name: str, vectors: Floats) -> None:
        if vectors is not self.vectors:
            self.vectors, self.where = vectors, address_of(vectors)
        kernel(name)(self.where, *self.addresses, 1)


def pad(name: str, vectors: Floats, states: Floats, found: Floats) -> int:
    """`Padding.run` of memory that no other call uses."""
    padding = PADDING.take()
    bits = padding.run(name, vectors, states, found)
    PADDING.put_back(padding)
    return bits


def run_one(name: str, vectors: Floats, state: Floats) -> Floats | None:
    """`Padding.one` of memory that no other call uses."""
    padding = PADDING.take()
    found = padding.one(name, vectors, state)
    PADDING.put_back(padding)
    return found


def run(name: str, vectors: Floats, states: Floats, found: Floats) -> Any:
    """Fills `found` for states (n, 8); returns the numbers of those that are left."""
    if len(states) == 1:
        return (0,) if pad(name, vectors, states, found) else ()
    whole, short = divmod(len(states), LANES)
    left = np.zeros(whole + 1, np.int64)
    if whole:
        kernel(name)(*map(address_of, (vectors, states, found, left)), whole)
    if short:
        left[-1] = pad(name, vectors, states[-short:], found[-short:])
    return lanes_of(left, len(states)) if left.any() else ()


def lanes_of(bits: Any, count: int) -> Any:
    """The numbers of the lanes whose bits are set, of those that are not padding."""
    if not bits.any():
        return np.empty(0, np.intp)
    return np.flatnonzero(((bits[:, None] >> np.arange(LANES)) & 1).ravel()[:count])


def address_of(array: Any) -> int:
    """Where the numbers of a contiguous array are."""
    if not array.flags.c_contiguous:
        raise ValueError("compiled code takes contiguous arrays only")
    return array.__array_interface__["data"][0]  # type: ignore[no-any-return]


PADDING = Pool(Padding)
