"""The model of many sensors, each at its own states, in one call.

For ideal light that nothing cuts. Sensors are rows of their 30 parameters, which `vectors_of`
converts to vectors all at once; the results have the same bits as those of `arrays`.
"""

from __future__ import annotations

import numpy as np

from ..core.units import Floats, Integers
from ..optics.forward import Geometry, build_geometry
from ..scalars.nesting import leaves
from .blocks import address_of, kernel, lanes
from .packing import EXAMPLE

#: The shape of a kernel's result at a state.
SHAPES = {"readings": (9,), "derivatives": (9, 8), "footprints": (3, 5)}


def vectors_of(parameters: Floats) -> Floats:
    """`packing.pack` of each row of 30 parameters: (n, m)."""
    columns = tuple(np.ascontiguousarray(parameters.T)[:, :, None])
    return pack_all(build_geometry(columns), len(parameters))


#: The parts of packed vectors that follow those that depend on the 30 parameters.
VARIED = 7
REST = np.array([number + 0.0 for number in leaves(EXAMPLE[VARIED:])])


def pack_all(vectors: Geometry, count: int) -> Floats:
    """`packing.pack` of several sensors (n, m), whose vectors are floats or columns (n, 1)."""
    numbers = list(leaves(vectors[:VARIED]))
    packed = np.empty((count, len(numbers) + len(REST)))
    for i, number in enumerate(numbers):
        packed[:, i : i + 1] = number
    packed[:, : len(numbers)] += 0.0
    packed[:, len(numbers) :] = REST
    return packed


def evaluate(name: str, vectors: Floats, owner: Integers, states: Floats) -> Floats:
    """Compute readings, derivatives or footprints (k, ...) of sensors at states (k, 8).

    name: of `SHAPES`.  vectors (n, m): from `vectors_of`.  owner (k,): the row of the sensor that a
    state belongs to, in ascending order.
    """
    width, code = lanes(), kernel(name)
    counts = np.bincount(owner, minlength=len(vectors))
    some = np.flatnonzero(counts)
    begins, blocks = (np.cumsum(counts) - counts)[some], -(-counts[some] // width)
    # The last block of a sensor reaches into the next one's states, whose own block overwrites
    # them.
    rows = np.concatenate([states, np.zeros((width, 8))])
    results = np.empty((len(rows), *SHAPES[name]))
    for arguments in zip(
        (address_of(vectors) + vectors.strides[0] * some).tolist(),
        (address_of(rows) + rows.strides[0] * begins).tolist(),
        (address_of(results) + results.strides[0] * begins).tolist(),
        blocks.tolist(),
        strict=True,
    ):
        code(*arguments)
    return results[: len(states)]
