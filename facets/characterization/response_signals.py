"""The input and the motion of an object from a recording's or a table's columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.names import STATE_COLUMNS, STATE_UNITS
from ..core.rigid_body import MeasuredObject, object_displacements
from ..core.units import Booleans, Floats
from ..detectors.counts import SATURATED
from ..estimation.plan import make_plan
from ..estimation.samples import common_detectors, detectors_of
from ..estimation.uncertainty import propagate
from ..files.columns import TIMES, row_times, unit_of_column
from ..files.tables import Source, read_chunks, read_words
from .frequency_response import Stretches, find_stretches

if TYPE_CHECKING:
    from ..core.settings import Config

Columns = dict[str, NDArray[Any]]
#: A larger number is no measured input: its powers overflow.
LARGEST_INPUT = 1e30


@dataclass(frozen=True)
class ResponseSignals:
    """Signals of n rows for a frequency response.

    stimulus: (n,) the input.  others: (n, q) the other inputs.  motion: (n, 6) displacement of the
    object from its mean pose, in its own axes there, mm and rad.  usable: (n,) whether a row has
    all of them.  deviation: (6,) standard deviation of the motion by the sensor's noise in one
    sample; NaN if not known.  saturated, misfits: numbers of rows with a saturated detector, and
    with a residual beyond chance.
    """

    stimulus: Floats
    others: Floats
    motion: Floats
    usable: Booleans
    stretches: Stretches
    deviation: Floats
    saturated: int
    misfits: int


def read_signal_table(path: Source, inputs: Sequence[str]) -> Columns:
    """Read the columns of a table that a frequency response to inputs needs.

    Raises `InputError` without a column of times, of a pose or of an input.
    """
    optional = (*TIMES, "host_s", *STATE_COLUMNS[6:], "flags", "misfit")
    parts = [chunk.columns for chunk in
             read_chunks(path, (*inputs, *STATE_COLUMNS[:6]), optional)]  # fmt: skip
    if not parts:
        raise InputError(f"{path}: no rows")
    if not any(name in parts[0] for name in TIMES):
        raise InputError(f"{path}: missing columns: {' or '.join(TIMES)}")
    columns: Columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    words = read_words(path, "used")
    return columns if words is None else columns | {"used": np.array(words)}


def build_signals(
    columns: Columns, inputs: Sequence[str], body: MeasuredObject, config: Config, name: str
) -> ResponseSignals:
    """Build the signals from columns of poses, times and inputs; the first input is the stimulus.

    body: the point of interest.  config: configuration of the sensor, for its noise.  name: name of
    the columns' source, for messages.
    """
    time = row_times(columns)
    poses = np.stack(
        [columns[key] * STATE_UNITS[n] for n, key in enumerate(STATE_COLUMNS[:6])], axis=1
    )
    stimuli = np.column_stack([columns[column] for column in inputs]).astype(float)
    usable = np.isfinite(poses).all(axis=1) & (np.abs(stimuli) < LARGEST_INPUT).all(axis=1)
    stretches = find_stretches(time, usable, name)
    mean = poses[usable].mean(axis=0)
    motion, _, _ = object_displacements(poses, mean, body)
    beam = [columns[key][usable].mean() if key in columns else 0.0 for key in STATE_COLUMNS[6:]]
    used = np.ones(3, dtype=bool)
    if "used" in columns:
        used = common_detectors(detectors_of(columns["used"][usable]))
    deviation = noise_deviation(config, np.array([*mean, *beam]), used, body)
    none = np.zeros(len(time))
    saturated = int((columns.get("flags", none).astype(np.int64) & SATURATED > 0).sum())
    misfits = int((columns.get("misfit", none) > 0).sum())
    return ResponseSignals(
        stimuli[:, 0], stimuli[:, 1:], motion, usable, stretches, deviation, saturated, misfits
    )


def describe_input(config: Config, column: str) -> tuple[float, str]:
    """The delay of the input's samples, s, and the input's unit; 0 and by its name by default."""
    for channel in config.acquire.channels:
        if channel.column == column:
            return channel.delay, "" if channel.unit == "1" else channel.unit
    return 0.0, unit_of_column(column)


def noise_deviation(config: Config, state: Floats, used: Booleans, body: MeasuredObject) -> Floats:
    """Standard deviation (6,) of an object's displacement by the readings' noise of the detectors
    used (3,) in one sample at a state (8,); NaN where the sensor does not determine the pose."""
    sensor = config.sensor
    plan = make_plan(sensor, config.solve.knowledge(sensor), config.solve.method)
    propagation = propagate(sensor, None, state[None], used[None], plan)
    slopes = object_displacements(state[None, :6], state[:6], body)[1][0]
    variance = np.diagonal(slopes @ propagation.noise[0, :6, :6] @ slopes.T)
    deviation: Floats = np.sqrt(variance)
    return deviation
