"""The input and the motion of an object from a recording's or a table's columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..core import (
    MIRROR,
    STATE_COLUMNS,
    STATE_UNITS,
    Booleans,
    Config,
    Floats,
    InputError,
    MeasuredObject,
    check_arguments,
    object_displacements,
)
from ..detectors import SATURATED
from ..estimation import common_detectors, detectors_of, make_plan, propagate
from ..files import (
    TIMES,
    FrameTable,
    Source,
    join_columns,
    read_chunks,
    read_words,
    row_times,
    unit_of_column,
)
from .frequency_response import (
    FrequencyResponse,
    OutputChannel,
    Stretches,
    estimate_response,
    find_stretches,
)

if TYPE_CHECKING:
    from pandas import DataFrame

Columns = dict[str, NDArray[Any]]
#: Rows with a larger input are excluded: it is no measurement, and its square would overflow.
LARGEST_INPUT = 1e30


@dataclass(frozen=True)
class ResponseSignals:
    """Signals of n rows for a frequency response.

    stimulus: (n,) the input.  others: (n, q) the other inputs.  motion: (n, 6) displacement of the
    object from its mean pose, in the object's axes there, mm and rad.  usable: (n,) whether a row
    has all of them.  deviation: (6,) standard deviation of one sample of the motion due to the
    sensor's noise, mm and rad; NaN if unknown.  saturated: number of rows with a saturated
    detector.  misfits: number of rows with a residual beyond chance.
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
    """Read from a table the columns that a frequency response to inputs needs.

    Raises `InputError` if a column of times, of the pose or of an input is missing.
    """
    optional = (*TIMES, "host_s", *STATE_COLUMNS[6:], "flags", "misfit")
    parts = [chunk.columns for chunk in
             read_chunks(path, (*inputs, *STATE_COLUMNS[:6]), optional)]  # fmt: skip
    if not parts:
        raise InputError(f"{path}: no rows")
    if not any(name in parts[0] for name in TIMES):
        raise InputError(f"{path}: missing columns: {' or '.join(TIMES)}")
    columns = join_columns(parts)
    words = read_words(path, "used")
    return columns if words is None else columns | {"used": np.array(words)}


def build_signals(
    columns: Columns, inputs: Sequence[str], config: Config, name: str
) -> ResponseSignals:
    """Build the signals from columns of poses, times and inputs; the first input is the stimulus.

    config: configuration of the sensor, for the point of interest and the noise.  name: name of the
    columns' source, for messages.
    """
    time, body = row_times(columns), config.object or MIRROR
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
    """The delay, s, and the unit of the input in a column; without a configured channel, 0 and the
    unit in the column's name."""
    for channel in config.acquire.channels:
        if channel.column == column:
            return channel.delay, "" if channel.unit == "1" else channel.unit
    return 0.0, unit_of_column(column)


def noise_deviation(config: Config, state: Floats, used: Booleans, body: MeasuredObject) -> Floats:
    """Standard deviation (6,) of one sample of an object's displacement due to the readings' noise,
    mm and rad, at a state (8,); NaN where the sensor does not determine the pose.

    used: (3,) whether each detector is used.
    """
    sensor = config.sensor
    plan = make_plan(sensor, config.solve.knowledge(sensor), config.solve.method)
    propagation = propagate(sensor, None, state[None], used[None], plan)
    slopes = object_displacements(state[None, :6], state[:6], body)[1][0]
    variance = np.diagonal(slopes @ propagation.noise[0, :6, :6] @ slopes.T)
    deviation: Floats = np.sqrt(variance)
    return deviation


@check_arguments
def measure_response(
    config: Config, poses: DataFrame, column: str, resolution_hz: float | None = None
) -> FrequencyResponse:
    """Estimate the frequency responses of the six axes, as `facets response` does.

    Parameters
    ----------
    config
        The configuration of the sensor, with the point of interest (`object`).
    poses
        Poses in time and the input: the columns time_s (or board_us), tx_mm, ...,
        yaw_mrad, and the input's.
    column
        The column of the input, such as force_n.
    resolution_hz
        Distance of the frequencies, Hz; by default chosen for about 32 averages.

    Returns
    -------
    FrequencyResponse
        The responses H1 and H2, coherences and random errors; `to_frame()` gives them in the
        columns of the command's table.

    Raises
    ------
    InputError
        If a column is missing, the times are uneven, or the rows are too few.

    Examples
    --------
    >>> import numpy as np, pandas as pd, facets
    >>> force = np.random.default_rng(1).standard_normal(4000)
    >>> poses = pd.DataFrame({name: 0 * force for name in ("roll_mrad", "pitch_mrad", "yaw_mrad")})
    >>> poses = poses.assign(time_s=1e-3 * poses.index, tx_mm=0, ty_mm=0, tz_mm=2e-3 * force)
    >>> response = facets.measure_response(
    ...     facets.load("paper"), poses.assign(force_n=force), "force_n", 10.0
    ... )
    >>> response.to_frame().h1_tz_real_um.mean().round(3)  # um/N
    np.float64(2.0)
    """
    table = FrameTable(poses)
    columns = read_signal_table(table, [column])
    return respond(columns, [column], config, str(table), resolution_hz)[1]


def respond(
    columns: Columns,
    inputs: Sequence[str],
    config: Config,
    name: str,
    resolution_hz: float | None,
    is_corrected: bool = False,
) -> tuple[ResponseSignals, FrequencyResponse]:
    """Estimate the receptances of the six axes for the first of the inputs, with the contributions
    of the others removed; returned with the signals.

    name: name of the columns' source, for messages.  resolution_hz: distance of lines; chosen if
    None.  is_corrected: whether the electronics' low pass is divided out.
    """
    signals = build_signals(columns, inputs, config, name)
    delay, _ = describe_input(config, inputs[0])
    bandwidth = config.electronics.bandwidth
    channel = OutputChannel(signals.deviation, bandwidth, is_corrected, delay)
    return signals, estimate_response(
        signals.stimulus, signals.motion, signals.stretches, resolution_hz, channel, signals.others
    )
