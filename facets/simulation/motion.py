"""The states of a configured motion.

Functions named `..._states` return times (n,), s, and states (n, 8), mm and rad.
"""

from __future__ import annotations

from copy import deepcopy
from functools import singledispatch
from pathlib import Path

import numpy as np

from ..core.errors import InputError
from ..core.motions import Motion, Random, Sine, Steps, Sweep, Table, Vibration
from ..core.names import STATE_COLUMNS, STATE_UNITS
from ..core.plain_numbers import suggest_name
from ..core.settings import Config
from ..core.units import Floats
from ..files.tables import read_chunks
from .axis_runs import run_states
from .vibration import shake


def find_motion(config: Config, name: str) -> Motion:
    """Find a motion of the configuration by its name."""
    if name not in config.motions:
        has = ", ".join(config.motions) or "none"
        raise InputError(
            f"{config.path}: no motion {name}; its motions: {has}"
            f"{suggest_name(name, config.motions)}"
        )
    return config.motions[name]


@singledispatch
def states(motion: Motion, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Times (n,) in s and true states (n, 8) in mm and rad. rng: only for random motions and
    forces."""
    raise TypeError(motion)


states.register(run_states)


@states.register
def table_states(motion: Table, rng: np.random.Generator) -> tuple[Floats, Floats]:
    time, state = read_motion_table(motion.file, motion.rate)
    if motion.samples_per_step == 1:
        return time, state
    refuse_times(motion)
    state = np.repeat(state, motion.samples_per_step, axis=0)
    return np.arange(len(state)) / motion.rate, state


@states.register
def step_states(motion: Steps, rng: np.random.Generator) -> tuple[Floats, Floats]:
    places = np.linspace(motion.start, motion.stop, motion.steps)
    return np.arange(motion.samples) / motion.rate, np.repeat(
        places, motion.samples_per_step, axis=0
    )


@states.register
def sweep_states(motion: Sweep, rng: np.random.Generator) -> tuple[Floats, Floats]:
    return np.arange(motion.samples) / motion.rate, np.linspace(
        motion.start, motion.stop, motion.samples
    )


@states.register
def vibration_states(motion: Vibration, rng: np.random.Generator) -> tuple[Floats, Floats]:
    moved = shake(motion, rng)[1]
    return np.arange(motion.samples) / motion.rate, np.array(motion.centre) + np.pad(
        moved, ((0, 0), (0, 2))
    )


@states.register
def sine_states(motion: Sine, rng: np.random.Generator) -> tuple[Floats, Floats]:
    phase = np.arange(motion.samples)[:, None] / motion.samples
    angle = 2 * np.pi * np.array(motion.cycles) * phase + np.array(motion.phase)
    waves = np.array(motion.amplitude) * np.sin(angle)
    return np.arange(motion.samples) / motion.rate, np.array(motion.centre) + waves


@states.register
def random_states(motion: Random, rng: np.random.Generator) -> tuple[Floats, Floats]:
    centre, box = np.array(motion.centre), np.array(motion.box)
    return np.arange(motion.samples) / motion.rate, rng.uniform(
        centre - box, centre + box, (motion.samples, 8)
    )


def shaker_force(motion: Motion, rng: np.random.Generator) -> Floats | None:
    """Force (n,) of a vibration's shaker, N, at the states that `states` gives for the same `rng`,
    whose own state does not change; None for other motions."""
    return shake(motion, deepcopy(rng))[0] if isinstance(motion, Vibration) else None


def read_motion_table(file: Path, rate: float) -> tuple[Floats, Floats]:
    """Read states from a table with some of the columns tx_mm ... by_mm; absent ones are zero.
    Returns times (n,), s, and states (n, 8), mm and rad; raises `InputError` for a malformed
    table."""
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
