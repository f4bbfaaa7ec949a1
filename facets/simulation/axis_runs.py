"""States of an axis with known errors that runs through its positions and back, as in an axis
test."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..core.motions import Motion, Runs
from ..core.names import STATE, STATE_UNITS
from ..core.units import Booleans, Floats, unit_of
from ..files.tables import write_table


class WayPoints(NamedTuple):
    """The way points of an axis in their order.

    fraction: (w,) of the commanded travel, 0 at the first position and 1 at the last.  sign: (w,) 1
    if the point is approached in the positive direction, -1 in the negative.  is_dwell: (w,)
    whether the axis is at rest there; it is not where it overruns an end.
    """

    fraction: Floats
    sign: Floats
    is_dwell: Booleans


def way_points(motion: Runs) -> WayPoints:
    """The way points: from below the first position up and down again, in each run."""
    inner = np.linspace(0, 1, motion.steps)
    beyond = motion.overrun / (motion.steps - 1)
    fraction = np.tile(np.concatenate([inner, [1 + beyond], inner[::-1], [-beyond]]), motion.runs)
    sign = np.tile(np.repeat([1.0, -1.0], motion.steps + 1), motion.runs)
    is_dwell = np.tile(np.arange(2 * motion.steps + 2) % (motion.steps + 1), motion.runs)
    return WayPoints(
        np.concatenate([[-beyond], fraction]),
        np.concatenate([[-1.0], sign]),
        np.concatenate([[False], is_dwell < motion.steps]),
    )


def way_point_states(motion: Runs, rng: np.random.Generator) -> Floats:
    """The true states (w, 8) at the way points, errors included; mm and rad."""
    points = way_points(motion)
    start, stop = np.array(motion.start), np.array(motion.stop)
    fraction = points.fraction[:, None]
    middle, places = fraction - 0.5, start + fraction * (stop - start)
    states: Floats = (
        places
        + motion.scale * middle * (stop - start)
        + (1 - 4 * middle**2) * np.array(motion.bow)
        + np.sin(2 * np.pi * motion.periods * fraction) * np.array(motion.wave)
        + points.sign[:, None] / 2 * np.array(motion.backlash)
        + rng.standard_normal((len(places), 8)) * np.array(motion.scatter)
    )
    return states


def run_states(motion: Runs, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Times (n,) in s and true states (n, 8) of an axis that moves at constant speed from one way
    point to the next."""
    states = way_point_states(motion, rng)
    dwell = np.where(way_points(motion).is_dwell, motion.dwell, 0.0)
    ends = np.cumsum(motion.move + dwell) - motion.move
    starts = ends - dwell
    knots = np.column_stack([starts, ends]).ravel()
    time = np.arange(round(knots[-1] * motion.rate)) / motion.rate
    way = np.repeat(states, 2, axis=0)
    return time, np.column_stack([np.interp(time, knots, column) for column in way.T])


def command_columns(motion: Runs) -> dict[str, Floats]:
    """The commanded positions (dwells,) as a table for `facets axis`: the component of the pose
    that changes most, in mm or mrad, and the direction of approach."""
    points = way_points(motion)
    way = np.array(motion.stop) - np.array(motion.start)
    main = int(np.argmax(np.abs(way[:6] / np.array(STATE_UNITS[:6]))))
    position = (motion.start[main] + points.fraction * way[main]) / STATE_UNITS[main]
    sign = points.sign * np.sign(way[main])
    return {
        f"position_{unit_of(STATE[main]).unit}": position[points.is_dwell],
        "direction": sign[points.is_dwell],
    }


def write_commands(path: Path, motion: Motion, about: dict[str, str]) -> bool:
    """Write the commanded positions of an axis to a table; False for any other motion."""
    if not isinstance(motion, Runs):
        return False
    write_table(path, command_columns(motion), about)
    return True
