"""Poses in a loop of a Python program, without a recording."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

from ...core.errors import InputError
from ..sources.ports import await_port
from .pipeline import Pipeline, RunPoses

if TYPE_CHECKING:
    from ...core.settings import Config
    from ...estimation.zero import PoseColumns


def poses(
    config: Config,
    port: str | None = None,
    ended: Callable[[], bool] = lambda: False,
    columns: PoseColumns | None = None,
) -> Iterator[RunPoses]:
    """Open a detector board and yield the poses of its samples as they come, some at a time.

    config: configuration of the sensor and the stream; the solver is compiled before the port is
    opened.  port: port of the board; `acquire.port` by default.  ended: called at each read;
    returns whether to end, for programs with threads.  columns: further columns of the poses, in
    `RunPoses.object`. The poses end with the stream of a file, or when the loop is left; the port
    is then closed. Raises `PortError` if the port cannot be opened, or disappears.

    A sample that cannot be solved has a status and NaN, as in `facets.solve`. A loop that is slower
    than the stream loses samples in the system's buffers; gaps in `seq` show them.
    """
    pipeline = Pipeline(config, columns)
    pipeline.warm_up()
    name = port or config.acquire.port
    if not name:
        raise InputError("no port is given: pass one, or set acquire.port in the configuration")
    source = await_port(name, config.acquire.baud, config.acquire.wait)
    try:
        while not (source.ended or ended()):
            if data := source.read():
                solved = pipeline.feed(data, time.monotonic())
                if solved is not None:
                    yield solved
        yield from map(pipeline.solve, pipeline.release())
    finally:
        source.close()
