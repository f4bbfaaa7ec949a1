"""Boxes of poses, low and high (6,), mm and rad, and their division."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import NamedTuple

import numpy as np

from ..characterization.state_box import StateBox
from ..core.units import Floats

#: Number of initial pieces along each axis of the pose: tx ty tz roll pitch yaw.
INITIAL_COUNTS = (2, 2, 1, 3, 3, 3)


class ProvedPiece(NamedTuple):
    """A box of poses, low and high (6,), mm and rad, and a lower bound of Eq. (11)'s |det| over it.

    at_least: 0 if nothing was proved.
    """

    low: tuple[float, ...]
    high: tuple[float, ...]
    at_least: float


def proved_piece(low: Floats, high: Floats, at_least: float) -> ProvedPiece:
    """The record of a box of poses over which the determinant's magnitude is at least this."""
    return ProvedPiece(tuple(low.tolist()), tuple(high.tolist()), at_least)


def initial_pieces(box: StateBox) -> Iterator[tuple[Floats, Floats]]:
    """Divide the box into its initial pieces, low and high (6,); neighbours share their edge to the
    last digit."""
    counts = [n if box.high[i] > box.low[i] else 1 for i, n in enumerate(INITIAL_COUNTS)]
    places = [np.linspace(box.low[i], box.high[i], n + 1) for i, n in enumerate(counts)]
    for cell in product(*(range(n) for n in counts)):
        low = np.array([places[i][n] for i, n in enumerate(cell)])
        yield low, np.array([places[i][n + 1] for i, n in enumerate(cell)])


def share_levers(box: StateBox) -> Floats:
    """Levers (6,) that scale a piece to fractions of its box; 0 for an axis without width."""
    width = (box.high - box.low)[:6]
    return np.divide(1.0, width, out=np.zeros(6), where=width > 0)


def cut_in_two(low: Floats, high: Floats, levers: Floats) -> list[tuple[Floats, Floats]]:
    """Halve a box across its longest axis, where each length is multiplied by its lever (6,)."""
    axis = int(((high - low) * levers).argmax())
    first, second = high.copy(), low.copy()
    first[axis] = second[axis] = (low[axis] + high[axis]) / 2
    return [(low, first), (second, high)]
