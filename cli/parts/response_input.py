"""The columns of `facets response`, from a recording or a table."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import facets
from facets import files, live, responses
from facets.core.errors import InputError

from ..console import load_config
from .recordings import report_clock, solve_recording

if TYPE_CHECKING:
    from facets.config import Config
    from facets.responses.signals import Columns


def read_columns(data: Path, inputs: list[str], config: str | None) -> tuple[Columns, Config]:
    """Read the columns of a recording or of a table, and the sensor's configuration."""
    if data.is_dir() or not data.name.lower().endswith(files.tables.READABLE):
        return solve_columns(data, inputs, config)
    if config is None:
        raise InputError(
            f"{data}: a table needs --config CONFIG, the configuration of the sensor, whose noise "
            "and bandwidth the picture shows"
        )
    columns = responses.signals.read_signal_table(data, inputs)
    report_clock(columns)
    return columns, load_config(config)


def solve_columns(recording: Path, inputs: list[str], config: str | None) -> tuple[Columns, Config]:
    """Solve a recording; return its poses and channels as columns, and its configuration. Raises
    `InputError` if an input's channel is missing, or no sample is complete."""
    playback = live.Playback(recording, facets.load(config) if config else None)
    names = [channel.column for channel in playback.config.acquire.channels]
    for column in inputs:
        if column not in names:
            has = ", ".join(names) or "none (acquire.channels names them)"
            raise InputError(
                f"{recording}: has no auxiliary channel with the column {column}; it has: {has}"
            )
    columns = solve_recording(playback)
    if not columns:
        raise InputError(f"{recording}: holds no complete sample")
    return columns, playback.config
