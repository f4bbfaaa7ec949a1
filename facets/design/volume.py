"""The volume that a layout has to measure, as the states at which it is asked for."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.units import Floats

if TYPE_CHECKING:
    from ..core.settings import Layout


def shares_of_volume() -> Floats:
    """Places in the volume, -1 to 1: corners of the pose and of the offset, faces, centre."""
    corners = np.array(list(product((-1.0, 1.0), repeat=6)))
    offsets = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
    with_offset = np.concatenate(
        [
            np.column_stack([corners, np.broadcast_to(o, (64, 2))])[n::4]
            for n, o in enumerate(offsets)
        ]
    )
    faces = np.concatenate([np.eye(8), -np.eye(8)])
    return np.unique(np.concatenate([with_offset, faces, np.zeros((1, 8))]), axis=0)


def states_of(layout: Layout, scale: Any) -> list[Any]:
    """States (8,) over the volume, `scale` times as large; mm and rad.

    Symbols where `scale` is one; else each state once, although several places of the volume are
    the same state where an axis has no width.
    """
    states = []
    for share in shares_of_volume():
        pose = [float(s * w) * scale for s, w in zip(share[:6], layout.volume[:6], strict=True)]
        offset = [float(s * w) * scale for s, w in zip(share[6:], layout.volume[6:], strict=True)]
        beam = [pose[0] + offset[0], pose[1] + offset[1]] if layout.following else offset
        states.append([*pose, *beam])
    if isinstance(scale, float):
        return [list(row) for row in np.unique(np.array(states, dtype=float), axis=0)]
    return states
