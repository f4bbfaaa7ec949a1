"""The states of a configured motion."""

from __future__ import annotations

from copy import deepcopy
from pathlib import Path

import numpy as np

from ..core.errors import InputError
from ..core.motions import Motion, Runs, Sine, Steps, Sweep, Table, Vibration
from ..core.names import STATE_COLUMNS, STATE_UNITS
from ..core.settings import Config
from ..core.units import Floats
from ..files.tables import read_chunks
from .axis_runs import run_states
from .vibration import shake


def find_motion(config: Config, name: str) -> Motion:
    """Find the configuration's motion of a name."""
    if name not in config.motions:
        has = ", ".join(config.motions) or "none"
        raise InputError(f"{config.path}: no motion {name}; its motions: {has}")
    return config.motions[name]


def states(motion: Motion, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Times (n,) in s and true states (n, 8) in mm and rad. rng: only for random motions and
    forces."""
    if isinstance(motion, Table):
        time, state = read_motion_table(motion.file, motion.rate)
        if motion.samples_per_step == 1:
            return time, state
        refuse_times(motion)
        state = np.repeat(state, motion.samples_per_step, axis=0)
        return np.arange(len(state)) / motion.rate, state
    if isinstance(motion, Runs):
        return run_states(motion, rng)
    time = np.arange(motion.samples) / motion.rate
    if isinstance(motion, Steps):
        places = np.linspace(motion.start, motion.stop, motion.steps)
        return time, np.repeat(places, motion.samples_per_step, axis=0)
    if isinstance(motion, Sweep):
        return time, np.linspace(motion.start, motion.stop, motion.samples)
    centre = np.array(motion.centre)
    if isinstance(motion, Vibration):
        moved = shake(motion, rng)[1]
        return time, centre + np.pad(moved, ((0, 0), (0, 2)))
    if isinstance(motion, Sine):
        share = np.arange(motion.samples)[:, None] / motion.samples
        angle = 2 * np.pi * np.array(motion.cycles) * share + np.array(motion.phase)
        return time, centre + np.array(motion.amplitude) * np.sin(angle)
    box = np.array(motion.box)
    return time, rng.uniform(centre - box, centre + box, (motion.samples, 8))


def shaker_force(motion: Motion, rng: np.random.Generator) -> Floats | None:
    """Force (n,) of a vibration's shaker, N, at the states that `states` gives for the same
    `rng`, which stays as it is; None for other motions."""
    return shake(motion, deepcopy(rng))[0] if isinstance(motion, Vibration) else None


def read_motion_table(file: Path, rate: float) -> tuple[Floats, Floats]:
    """Read states from a table with some columns of tx_mm ... by_mm; the others are zero."""
    times, parts, rows = [], [], 0
    for chunk in read_chunks(file, optional=(*STATE_COLUMNS, "time_s")):
        if not any(name in chunk.columns for name in STATE_COLUMNS):
            raise InputError(
                f"{file}: no column of a state; give some of {', '.join(STATE_COLUMNS)}"
            )
        if chunk.unparsable.any():
            line = chunk.lines[chunk.unparsable][0]
            raise InputError(f"{file}:{line}: this row cannot be read as numbers")
        zero = np.zeros(len(chunk.lines))
        state = np.column_stack([chunk.columns.get(name, zero) for name in STATE_COLUMNS])
        time = chunk.columns.get("time_s", (rows + np.arange(len(state))) / rate)
        finite = np.isfinite(state).all(axis=1) & np.isfinite(time)
        if not finite.all():
            line = chunk.lines[~finite][0]
            raise InputError(f"{file}:{line}: a state and its time need finite numbers")
        parts.append(state * STATE_UNITS)
        times.append(time)
        rows += len(state)
    if not rows:
        raise InputError(f"{file}: no rows")
    return np.concatenate(times), np.concatenate(parts)


def refuse_times(motion: Table) -> None:
    """Raise `InputError` if the file has a column of times."""
    if any("time_s" in chunk.columns for chunk in read_chunks(motion.file, optional=("time_s",))):
        raise InputError(
            f"{motion.file}: has a column time_s, which says when each row is taken; remove that "
            f"column, or samples_per_step: {motion.samples_per_step} from the motion"
        )
