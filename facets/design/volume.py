"""The states that stand for the volume over which a layout has to meet its requirements.

The quantities that are limited over the volume (uncertainties, clearances of spots, powers, the
condition number) are nearly always worst at a corner, since each of them changes with the state
nearly linearly. So the states are all corners, 256 if the beam's place has a width too, and the
middles of the faces and the centre besides. That is no theorem: a spot's height falls with the
square of a roll, and an uncertainty has a least where the powers balance, so that the worst can lie
between the corners, by thousandths of the change over the volume. So a statement about the whole
volume also takes a search between the states, from the worst of them (`worst_places`).

If the layout has an object, the volume is that of the object's displacements. Its states hold these
in place of the mirror's pose, and `mirror_states` converts them where the model is evaluated.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.rigid_body import mirror_poses
from ..core.units import Booleans, Floats

if TYPE_CHECKING:
    from ..core.layout import Layout
    from ..core.rigid_body import MeasuredObject

#: A search between the corners begins with steps of this share of the volume's half width, and ends
#: with the last of these; the worst value is flat there, so that it is found to a millionth.
FIRST_STEP, LAST_STEP = 0.5, 1e-3
#: Number of the worst states of each value from which the search begins.
STARTS = 2
#: A value whose minimum is further from zero than this share of its change over the states is not
#: searched: it changes far less between the corners.
NEAR_SHARE = 0.2
#: A value between the corners counts as worse if it is less by this share of that change.
WORSE_SHARE = 1e-9


def shares_of_volume(wide: Booleans | None = None) -> Floats:
    """Places in the volume, -1 to 1: all corners, the middles of the faces, and the centre.

    wide: (8,) the axes in which the volume has a width; the others stay at zero.
    """
    corners = np.array(list(product((-1.0, 1.0), repeat=8)))
    faces = np.concatenate([np.eye(8), -np.eye(8)])
    shares = np.concatenate([corners, faces, np.zeros((1, 8))])
    return np.unique(shares if wide is None else np.where(wide, shares, 0.0), axis=0)


def wide_axes(layout: Layout) -> Booleans:
    """Whether the volume has a width in each axis: (8,)."""
    return np.array(layout.volume) > 0


def span_of(layout: Layout) -> Floats:
    """The matrix (8, 8) that turns shares of the volume into a state."""
    span = np.diag(np.array(layout.volume, dtype=float))
    if layout.following:  # the last two are the beam's offset from the apex
        span[0, 6], span[1, 7] = span[0, 0], span[1, 1]
    return span


def states_of(layout: Layout, scale: Any) -> list[Any]:
    """States (8,) over the volume, `scale` times as large, a number or a symbol; mm and rad."""
    states = shares_of_volume(wide_axes(layout)) @ span_of(layout)
    return [[float(value) * scale for value in state] for state in states]


def mirror_states(states: Floats, body: MeasuredObject | None, following: Any) -> Floats:
    """States (..., 8) of the mirror, from states with the displacement of an object in place of the
    pose.  following: whether the beam follows the mirror, (...) or for all."""
    if body is None:
        return states
    poses = mirror_poses(states[..., :6], body)
    shift = (poses[..., :2] - states[..., :2]) * np.asarray(following, dtype=float)[..., None]
    return np.concatenate([poses, states[..., 6:] + shift], axis=-1)


def worst_places(
    values: Callable[[Floats], Floats], shares: Floats, wide: Booleans, near: float = NEAR_SHARE
) -> tuple[Floats, Any]:
    """Find shares (k, 8) of the volume at which a value is less than at all known places, and the
    numbers (k,) of these values.

    values: of shares (n, 8), their margins (n, m), each of which should be large.  shares: the
    known places.  near: see `NEAR_SHARE`; infinite to search all values.
    """
    known = values(shares)
    sound = np.isfinite(known).all(axis=0)
    least, change = known.min(axis=0), np.ptp(np.where(sound, known, 0.0), axis=0)
    numbers = np.flatnonzero(sound & (least < near * change))
    if not len(numbers) or not wide.any():
        return np.empty((0, 8)), numbers[:0]
    order = np.argsort(known[:, numbers], axis=0, kind="stable")[:STARTS]
    ends = shares[order.T.ravel()]
    which = np.repeat(numbers, len(order))
    lowest = known[order.T.ravel(), which]
    ends, lowest = descend(values, ends, which, lowest, wide)
    best = np.array([np.flatnonzero(which == n)[lowest[which == n].argmin()] for n in numbers])
    worse = lowest[best] < least[numbers] - WORSE_SHARE * change[numbers]
    return ends[best[worse]], numbers[worse]


def add_worst_states(
    span: Floats, values: Callable[[Floats], Floats], drawn: Floats | None = None
) -> Floats:
    """States (n, 8): the states of `states_of`, some at drawn shares, and the places between them
    where a value is least.

    span: of `span_of`.  values: of states (n, 8), their margins (n, m), each of which should be
    large.
    """
    wide = np.diag(span) > 0
    shares = shares_of_volume(wide)
    if drawn is not None:
        shares = np.concatenate([shares, np.where(wide, drawn, 0.0)])
    places, _ = worst_places(lambda some: values(some @ span), shares, wide, np.inf)
    states: Floats = np.concatenate([shares, places]) @ span
    return states


def descend(
    values: Callable[[Floats], Floats], places: Floats, which: Any, lowest: Floats, wide: Booleans
) -> tuple[Floats, Floats]:
    """Minimise values `which` (k,) near places (k, 8), one axis at a time; return minima and
    places."""
    places, lowest = places.copy(), lowest.copy()
    sides = np.concatenate([np.eye(8)[wide], -np.eye(8)[wide]])
    step = np.full(len(places), FIRST_STEP)
    while (going := np.flatnonzero(step >= LAST_STEP)).size:
        tried = np.clip(places[going, None] + step[going, None, None] * sides, -1.0, 1.0)
        tried_values = np.full(tried.shape[:2], np.inf)
        within = (tried != places[going, None]).any(axis=2)  # clipping removes other steps
        inner = values(tried[within])
        tried_values[within] = inner[np.arange(len(inner)), which[going[np.nonzero(within)[0]]]]
        tried_values[np.isnan(tried_values)] = np.inf
        best = tried_values.argmin(axis=1)
        low = tried_values[np.arange(len(going)), best]
        better = low < lowest[going]
        moved = going[better]
        places[moved], lowest[moved] = tried[better, best[better]], low[better]
        step[going[~better]] /= 2
    return places, lowest
