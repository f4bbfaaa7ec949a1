"""An axis with known errors that is sent to its places and back, as a test of an axis does."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..core.motions import Motion, Runs
from ..core.names import STATE, STATE_UNITS
from ..core.units import Booleans, Floats, unit_of
from ..files.tables import write_table


class Course(NamedTuple):
    """The way points of an axis in their order.

    share: (w,) commanded, 0 at the first place and 1 at the last.  sign: (w,) 1 where it is
    approached in the positive direction, -1 in the negative.  is_stand: (w,) whether the axis
    stands still there; it does not where it overruns an end.
    """

    share: Floats
    sign: Floats
    is_stand: Booleans


def course_of(motion: Runs) -> Course:
    """The way points: from below the first place up and down again, in each run."""
    inner = np.linspace(0, 1, motion.steps)
    beyond = motion.overrun / (motion.steps - 1)
    share = np.tile(np.concatenate([inner, [1 + beyond], inner[::-1], [-beyond]]), motion.runs)
    sign = np.tile(np.repeat([1.0, -1.0], motion.steps + 1), motion.runs)
    is_stand = np.tile(np.arange(2 * motion.steps + 2) % (motion.steps + 1), motion.runs)
    return Course(
        np.concatenate([[-beyond], share]),
        np.concatenate([[-1.0], sign]),
        np.concatenate([[False], is_stand < motion.steps]),
    )


def course_states(motion: Runs, rng: np.random.Generator) -> Floats:
    """The true states (w, 8) at the way points, errors included; mm and rad."""
    course = course_of(motion)
    start, stop = np.array(motion.start), np.array(motion.stop)
    share, middle = course.share[:, None], course.share[:, None] - 0.5
    places = start + share * (stop - start)
    states: Floats = (
        places
        + motion.scale * middle * (stop - start)
        + (1 - 4 * middle**2) * np.array(motion.bow)
        + np.sin(2 * np.pi * motion.periods * share) * np.array(motion.wave)
        + course.sign[:, None] / 2 * np.array(motion.backlash)
        + rng.standard_normal((len(places), 8)) * np.array(motion.scatter)
    )
    return states


def run_states(motion: Runs, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Times (n,) in s and true states (n, 8): it moves evenly from way point to way point."""
    states, course = course_states(motion, rng), course_of(motion)
    ends = np.cumsum(motion.move + np.where(course.is_stand, motion.dwell, 0.0)) - motion.move
    starts = ends - np.where(course.is_stand, motion.dwell, 0.0)
    knots = np.column_stack([starts, ends]).ravel()
    time = np.arange(round(knots[-1] * motion.rate)) / motion.rate
    way = np.repeat(states, 2, axis=0)
    return time, np.column_stack([np.interp(time, knots, column) for column in way.T])


def command_columns(motion: Runs) -> dict[str, Floats]:
    """The commanded positions as a table for `facets axis`: the component of the pose that changes
    most, in mm or mrad, and the direction of approach."""
    course = course_of(motion)
    way = np.array(motion.stop) - np.array(motion.start)
    main = int(np.argmax(np.abs(way[:6] / np.array(STATE_UNITS[:6]))))
    position = (motion.start[main] + course.share * way[main]) / STATE_UNITS[main]
    sign = course.sign * np.sign(way[main])
    return {
        f"position_{unit_of(STATE[main]).unit}": position[course.is_stand],
        "direction": sign[course.is_stand],
    }


def write_commands(path: Path, motion: Motion, about: dict[str, str]) -> bool:
    """Write the commanded positions of an axis to a table; False for any other motion."""
    if not isinstance(motion, Runs):
        return False
    write_table(path, command_columns(motion), about)
    return True
