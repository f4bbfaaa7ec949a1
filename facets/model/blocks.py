"""The plain model at many states, a block of them at a time, as compiled functions.

Each lane of the processor has a pose (`scalars.lanes`). What does not fit a block, because a facet
is faint, the apex far off the beam or the mirror far turned, is left, and computed by
`evaluators`, one state at a time. What a pose gives does not depend on the others in its block, nor
on how many there are. Importing this imports Numba.
"""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Callable
from functools import cache
from math import nan
from types import ModuleType
from typing import Any

import numpy as np
from numba import types  # noqa: TID253

from ..core.units import Floats
from ..optics import central
from ..optics.forward import Geometry
from ..optics.forward import readings as readings_uncut
from ..optics.gradient import linearised as linearised_uncut
from ..scalars import lanes, machine, polynomials
from ..scalars.lanes import LaneWriter
from ..scalars.machine import Value, leaves
from . import evaluators, jit, kernels, machine_code
from .evaluators import PLAIN
from .machine_code import straight_lanes

#: Poses in a block.
LANES = 4
#: Files that blocks are made of, beside the optics.
PARTS = (lanes, machine, machine_code, polynomials, central, kernels, evaluators)


def write_readings(code: LaneWriter, vectors: Geometry, states: Any, found: Any) -> None:
    """found: a row of nine readings for each row of eight numbers of a state."""
    state = code.load_rows(states, 8, 8)
    code.store_rows(list(leaves(readings_uncut(vectors, tuple(state)))), found, 9)


def write_derivatives(code: LaneWriter, vectors: Geometry, states: Any, found: Any) -> None:
    """found: nine rows of eight derivatives for each state; NaN where there is no reading."""
    state = code.load_rows(states, 8, 8)
    derivatives: list[Value] = []
    for values, rows in linearised_uncut(vectors, tuple(state)):
        for value, row in zip(values, rows, strict=True):
            lit = code.compare("==", value, value)
            derivatives += [code.select(lit, each, nan) for each in row]
    code.store_rows(derivatives, found, 72)


block_readings = straight_lanes(write_readings, PLAIN, LANES, 8 * LANES, 9 * LANES)
block_derivatives = straight_lanes(write_derivatives, PLAIN, LANES, 8 * LANES, 72 * LANES)


def readings(packed: int, states: int, found: int, left: int, blocks: int) -> None:
    block_readings(packed, states, found, left, blocks)


def derivatives(packed: int, states: int, found: int, left: int, blocks: int) -> None:
    block_derivatives(packed, states, found, left, blocks)


LOOPS = {"readings": readings, "derivatives": derivatives}


def compiled(function: Callable[..., None], *modules: ModuleType) -> Callable[..., None]:
    """`function` of addresses and counts, compiled now if need be, to be called with them.

    modules: that it is made of beside PARTS.  The interpreter's lock is let go.
    """
    count = function.__code__.co_argcount
    signature: Any = types.void(*[types.int64] * count)
    code = jit.callback(__file__, function, *PARTS, *modules, signature=signature)
    start = ctypes.CFUNCTYPE(None, *[ctypes.c_int64] * count)(code.address)
    start.keeps = code  # type: ignore[attr-defined]
    return start


@cache
def kernel(name: str) -> Callable[..., None]:
    """One of LOOPS."""
    return compiled(LOOPS[name])


class Padding(threading.local):
    """Memory of a thread for the last block of a batch, which the last row fills up."""

    def __init__(self) -> None:
        self.rows, self.left = np.empty((LANES, 8)), np.empty(1, np.int64)
        found = np.empty(72 * LANES)
        self.found = {
            "readings": found[: 9 * LANES].reshape(LANES, 9),
            "derivatives": found.reshape(LANES, 9, 8),
        }
        self.addresses = [address_of(array) for array in (self.rows, found, self.left)]
        self.vectors: Any = None
        self.where = 0

    def run(self, name: str, vectors: Floats, states: Floats, found: Floats) -> int:
        """Fills `found` for less than a block of states; returns a bit for each that is left."""
        if vectors is not self.vectors:
            self.vectors, self.where = vectors, address_of(vectors)
        short = len(states)
        self.rows[:short] = states
        self.rows[short:] = states[-1]
        kernel(name)(self.where, *self.addresses, 1)
        found[:] = self.found[name][:short]
        return int(self.left[0]) & ((1 << short) - 1)


def run(name: str, vectors: Floats, states: Floats, found: Floats) -> Any:
    """Fills `found` for states (n, 8); returns the numbers of those that are left."""
    if len(states) == 1:
        return (0,) if PADDING.run(name, vectors, states, found) else ()
    whole, short = divmod(len(states), LANES)
    left = np.zeros(whole + 1, np.int64)
    if whole:
        kernel(name)(*map(address_of, (vectors, states, found, left)), whole)
    if short:
        left[-1] = PADDING.run(name, vectors, states[-short:], found[-short:])
    return lanes_of(left, len(states)) if left.any() else ()


def lanes_of(bits: Any, count: int) -> Any:
    """The numbers of the lanes whose bits are set, of those that are not padding."""
    return np.flatnonzero(((bits[:, None] >> np.arange(LANES)) & 1).ravel()[:count])


def address_of(array: Any) -> int:
    """Where the numbers of a contiguous array are."""
    if not array.flags.c_contiguous:
        raise ValueError("compiled code takes contiguous arrays only")
    return array.__array_interface__["data"][0]  # type: ignore[no-any-return]


PADDING = Padding()
