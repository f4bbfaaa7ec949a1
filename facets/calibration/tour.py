"""Order poses for a short path of a stage: nearest neighbours, improved by local changes.

The way is open: it begins at a given pose and ends anywhere. Reversals of a part (2-opt; Croes,
1958) and moves of up to three poses to another place (Or, 1976) are taken until none shortens it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..core.units import Floats

#: A change that shortens the way by less than this share of it is none.
LEAST_SAVING = 1e-9
#: Poses that are moved together, at most.
MOST_MOVED = 3


def travel(points: Floats) -> float:
    """The length of the way through points (n, d) in their order, each step as long as its largest
    component: all axes move at once."""
    return float(np.abs(np.diff(points, axis=0)).max(axis=1).sum()) if len(points) > 1 else 0.0


def short_order(points: Floats, start: Floats) -> NDArray[np.int64]:
    """A short order of points (n, d) from `start` (d,), in units in which the axes are comparable;
    see `travel`."""
    if not len(points):
        return np.zeros(0, np.int64)
    whole = np.concatenate([start[None], points])
    apart: Floats = np.abs(whole[:, None] - whole[None]).max(axis=-1)
    order = nearest_neighbours(apart)
    least = LEAST_SAVING * max(float(apart.max()), 1e-300)
    while True:
        shorter = reverse_part(apart, order, least)
        if shorter is None:
            shorter = move_part(apart, order, least)
        if shorter is None:
            return order[1:] - 1
        order = shorter


def nearest_neighbours(apart: Floats) -> NDArray[np.int64]:
    """Go from the first point always to the nearest unvisited one."""
    count = len(apart)
    order = np.zeros(count, np.int64)
    open_ = np.ones(count, bool)
    for n in range(1, count):
        open_[order[n - 1]] = False
        order[n] = int(np.argmin(np.where(open_, apart[order[n - 1]], np.inf)))
    return order


def reverse_part(apart: Floats, order: NDArray[np.int64], least: float) -> NDArray[np.int64] | None:
    """Reverse the part of the order that shortens it most; None if none does."""
    steps = apart[np.ix_(order, order)]
    count = len(order)
    step = steps[np.arange(count - 1), np.arange(1, count)]
    after = np.append(step, 0.0)  # behind the last there is nothing
    first = np.arange(1, count)[:, None]
    last = np.arange(1, count)[None]
    behind = np.minimum(last + 1, count - 1)
    there = np.where(last + 1 < count, steps[first, behind], 0.0)
    saved = step[first - 1] + after[last] - steps[first - 1, last] - there
    saved = np.where(first < last, saved, -np.inf)
    if count < 3 or saved.max() <= least:
        return None
    i, j = (int(n) + 1 for n in np.unravel_index(int(np.argmax(saved)), saved.shape))
    return np.concatenate([order[:i], order[i : j + 1][::-1], order[j + 1 :]])


def move_part(apart: Floats, order: NDArray[np.int64], least: float) -> NDArray[np.int64] | None:
    """Move the first few neighbours that are better elsewhere; None if there are none."""
    count = len(order)
    for size in range(1, min(MOST_MOVED, count - 2) + 1):
        for i in range(1, count - size + 1):
            part, rest = order[i : i + size], np.delete(order, slice(i, i + size))
            before = order[i - 1]
            saved = apart[before, part[0]]
            if i + size < count:
                behind = order[i + size]
                saved += apart[part[-1], behind] - apart[before, behind]
            ahead = np.append(apart[rest[:-1], rest[1:]], 0.0)
            for turned in (part, part[::-1]):
                follow = np.append(apart[turned[-1], rest[1:]], 0.0)
                cost = apart[rest, turned[0]] + follow - ahead
                place = int(np.argmin(cost))
                if saved - cost[place] > least:
                    return np.concatenate([rest[: place + 1], turned, rest[place + 1 :]])
    return None
