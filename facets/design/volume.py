"""The states that represent the volume over which a layout has to meet its requirements.

The limited quantities (uncertainties, clearances of spots, powers, the condition number) vary
nearly linearly with the state, so they are nearly always worst at a corner. The states are
therefore all corners (256 if the beam's position has a width, too), the middles of the faces, and
the centre. Exceptions exist: a spot's height falls with the square of a roll, and an uncertainty
has a minimum where the powers balance. The worst value can then lie between the corners, and
differ from theirs by thousandths of the change over the volume. A statement about the whole volume
therefore needs a search between the states, from the worst of them (`worst_places`).

If the layout has an object, the volume consists of the object's displacements. The states hold
these in place of the mirror's pose, and `mirror_states` converts them for the model.
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

#: First and last step of a search between the corners, as fractions of the volume's half width. The
#: worst value is a minimum, and flat, so that the last step resolves it to a millionth.
FIRST_STEP, LAST_STEP = 0.5, 1e-3
#: Number of the worst states of each value from which the search begins.
STARTS = 2
#: A value is searched only if its minimum is nearer to zero than this fraction of its change over
#: the states, because it changes far less between the corners.
NEAR_FRACTION = 0.2
#: A value between the corners counts as worse if it is less by this fraction of that change.
WORSE_FRACTION = 1e-9


def volume_fractions(wide: Booleans | None = None) -> Floats:
    """Positions (n, 8) in the volume, each coordinate from -1 to 1: all corners, the middles of the
    faces, and the centre.

    wide: (8,) whether the volume has a width in each axis; the other axes stay at zero.
    """
    corners = np.array(list(product((-1.0, 1.0), repeat=8)))
    faces = np.concatenate([np.eye(8), -np.eye(8)])
    fractions = np.concatenate([corners, faces, np.zeros((1, 8))])
    return np.unique(fractions if wide is None else np.where(wide, fractions, 0.0), axis=0)


def wide_axes(layout: Layout) -> Booleans:
    """Whether the volume has a width in each axis: (8,)."""
    return np.array(layout.volume) > 0


def span_of(layout: Layout) -> Floats:
    """The matrix (8, 8) that converts a position in the volume, -1 to 1, to a state, mm and rad."""
    span = np.diag(np.array(layout.volume, dtype=float))
    if layout.following:  # the last two are the beam's offset from the apex
        span[0, 6], span[1, 7] = span[0, 0], span[1, 1]
    return span


def states_of(layout: Layout, scale: Any) -> list[Any]:
    """List the states (8,) over the volume, mm and rad.  scale: a factor of the volume's size."""
    states = volume_fractions(wide_axes(layout)) @ span_of(layout)
    return [[float(value) * scale for value in state] for state in states]


def mirror_states(states: Floats, body: MeasuredObject | None, following: Any) -> Floats:
    """States (..., 8) of the mirror, from those with an object's displacement instead of the pose.

    following: whether the beam follows the mirror, one Boolean or (...).
    """
    if body is None:
        return states
    poses = mirror_poses(states[..., :6], body)
    shift = (poses[..., :2] - states[..., :2]) * np.asarray(following, dtype=float)[..., None]
    return np.concatenate([poses, states[..., 6:] + shift], axis=-1)


def worst_places(
    values: Callable[[Floats], Floats],
    fractions: Floats,
    wide: Booleans,
    near: float = NEAR_FRACTION,
) -> tuple[Floats, Any]:
    """Find positions (k, 8) in the volume at which a margin is less than at all known positions,
    and the numbers (k,) of these margins.

    values: function from positions (n, 8) to their margins (n, m), each of which should be large.
    fractions: the known positions.  near: see `NEAR_FRACTION`; infinite to search all margins.
    """
    margins = values(fractions)
    is_finite = np.isfinite(margins).all(axis=0)
    lowest_known, change = margins.min(axis=0), np.ptp(np.where(is_finite, margins, 0.0), axis=0)
    numbers = np.flatnonzero(is_finite & (lowest_known < near * change))
    if not len(numbers) or not wide.any():
        return np.empty((0, 8)), numbers[:0]
    order = np.argsort(margins[:, numbers], axis=0, kind="stable")[:STARTS]
    minima = fractions[order.T.ravel()]
    columns = np.repeat(numbers, len(order))
    lowest = margins[order.T.ravel(), columns]
    minima, lowest = descend(values, minima, columns, lowest, wide)
    best = np.array([np.flatnonzero(columns == n)[lowest[columns == n].argmin()] for n in numbers])
    worse = lowest[best] < lowest_known[numbers] - WORSE_FRACTION * change[numbers]
    return minima[best[worse]], numbers[worse]


def add_worst_states(
    span: Floats, values: Callable[[Floats], Floats], random_fractions: Floats | None = None
) -> Floats:
    """States (n, 8): the states of `states_of`, some at random positions, and the states between
    them at which a margin is least.

    span: from `span_of`.  values: function from states (n, 8) to their margins (n, m), each of
    which should be large.  random_fractions: (k, 8), -1 to 1.
    """
    wide = np.diag(span) > 0
    fractions = volume_fractions(wide)
    if random_fractions is not None:
        fractions = np.concatenate([fractions, np.where(wide, random_fractions, 0.0)])
    places, _ = worst_places(lambda points: values(points @ span), fractions, wide, np.inf)
    states: Floats = np.concatenate([fractions, places]) @ span
    return states


def descend(
    values: Callable[[Floats], Floats], places: Floats, columns: Any, lowest: Floats, wide: Booleans
) -> tuple[Floats, Floats]:
    """Minimise the margins of `columns` (k,) from the positions `places` (k, 8), by steps along one
    axis; return the positions of the minima and their values."""
    places, lowest = places.copy(), lowest.copy()
    sides = np.concatenate([np.eye(8)[wide], -np.eye(8)[wide]])
    step = np.full(len(places), FIRST_STEP)
    while (active := np.flatnonzero(step >= LAST_STEP)).size:
        trials = np.clip(places[active, None] + step[active, None, None] * sides, -1.0, 1.0)
        trial_values = np.full(trials.shape[:2], np.inf)
        within = (trials != places[active, None]).any(axis=2)  # clipping removes other steps
        inner = values(trials[within])
        trial_values[within] = inner[np.arange(len(inner)), columns[active[np.nonzero(within)[0]]]]
        trial_values[np.isnan(trial_values)] = np.inf
        best = trial_values.argmin(axis=1)
        low = trial_values[np.arange(len(active)), best]
        better = low < lowest[active]
        moved = active[better]
        places[moved], lowest[moved] = trials[better, best[better]], low[better]
        step[active[~better]] /= 2
    return places, lowest
