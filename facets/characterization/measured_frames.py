"""Tests of axes and frequency responses from data frames of pandas."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from ..core.arguments import check_arguments
from ..core.rigid_body import MIRROR
from ..core.settings import Config
from ..files.frame_table import FrameTable
from .axis_report import AxisReport, evaluate_axis
from .axis_visits import read_commands, read_series
from .error_motions import AxisTest
from .frequency_response import FrequencyResponse, OutputChannel, estimate_response
from .response_signals import build_signals, describe_input, read_signal_table

if TYPE_CHECKING:
    from pandas import DataFrame


@check_arguments
def measure_axis(
    config: Config,
    poses: DataFrame,
    axis: Literal["X", "Y", "Z", "A", "B", "C"],
    commands: DataFrame | None = None,
    dwell: float = 0.2,
) -> AxisReport:
    """Measure the error motions of a linear or rotary axis, as `facets axis` does.

    Parameters
    ----------
    config
        The configuration of the sensor, with the point of interest (`object`).
    poses
        Poses in time: the columns time_s (or host_s) and tx_mm, ..., yaw_mrad, such as
        `facets.read_table` or `Solution.to_frame` gives.
    axis
        X, Y or Z: it moves along this axis of the object; A, B or C: it rotates about X, Y or Z.
    commands
        The commanded positions in their order, one row for each stand: position_mm (or another unit
        of length or angle) and, optionally, direction. None: equally spaced positions are found.
    dwell
        The shortest time for which the axis stands still, s.

    Returns
    -------
    AxisReport
        The quantities of ISO 230-2; `to_frame()` gives the error motions by position.

    Raises
    ------
    InputError
        If a column is missing, or the axis does not stand still at two positions or more.

    Examples
    --------
    >>> import numpy as np, pandas as pd, facets
    >>> places = np.repeat([0.0, 0.1, 0.2, 0.1, 0.0], 100)  # mm, 100 samples at each
    >>> poses = pd.DataFrame({f"{name}_mrad": 0 * places for name in ("roll", "pitch", "yaw")})
    >>> poses = poses.assign(time_s=0.01 * poses.index, tx_mm=1.001 * places, ty_mm=0, tz_mm=0)
    >>> commands = pd.DataFrame({"position_mm": [0.0, 0.1, 0.2, 0.1, 0.0]})
    >>> report = facets.measure_axis(facets.load("paper"), poses, "X", commands)
    >>> report.to_frame().EXX_um.diff().round(2).tolist()
    [nan, 0.1, 0.1]
    """
    table = None if commands is None else FrameTable(commands)
    test = AxisTest(
        axis,
        None if table is None else read_commands(table, axis),
        config.object or MIRROR,
        shortest_s=dwell,
    )
    series = read_series(FrameTable(poses))
    return evaluate_axis(config.sensor, config.solve.knowledge(config.sensor), series, test)


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
        Poses in time with the input beside them: the columns time_s (or board_us), tx_mm, ...,
        yaw_mrad, and the input's.
    column
        The column of the input, such as force_n.
    resolution_hz
        Distance of the frequencies; by default for about 32 averages.

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
    signals = build_signals(columns, [column], config.object or MIRROR, config, str(table))
    delay, _ = describe_input(config, column)
    output = OutputChannel(signals.deviation, config.electronics.bandwidth, delay=delay)
    return estimate_response(
        signals.stimulus, signals.motion, signals.stretches, resolution_hz, output
    )
