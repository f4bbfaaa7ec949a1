"""The input of `facets response`: columns of a recording or of a table."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import facets
from facets import characterization, files, live
from facets.core.errors import InputError

from ..console import load_config
from .recordings import solve_recording

if TYPE_CHECKING:
    from facets.characterization.response_signals import Columns
    from facets.config import Config


def read_columns(data: Path, column: str, config: str | None) -> tuple[Columns, Config]:
    """Read the columns of a recording or of a table, and the sensor's configuration."""
    if data.is_dir() or not data.name.lower().endswith(files.tables.READABLE):
        return solve_columns(data, column, config)
    if config is None:
        raise InputError(
            f"{data}: a table needs --config CONFIG, the configuration of the sensor, whose noise "
            "and bandwidth the picture shows"
        )
    return characterization.response_signals.read_signal_table(data, column), load_config(config)


def solve_columns(recording: Path, column: str, config: str | None) -> tuple[Columns, Config]:
    """Solve a recording, which must have the auxiliary channel of the column."""
    playback = live.Playback(recording, facets.load(config) if config else None)
    names = [channel.column for channel in playback.config.acquire.channels]
    if column not in names:
        has = ", ".join(names) or "none (acquire.channels names them)"
        raise InputError(
            f"{recording}: has no auxiliary channel with the column {column}; it has: {has}"
        )
    columns = solve_recording(playback)
    if not columns:
        raise InputError(f"{recording}: holds no complete sample")
    return columns, playback.config


def describe_input(settings: Config, column: str) -> tuple[float, str]:
    """The delay of the input's samples, s, and the input's unit; 0 and by its name by default."""
    for channel in settings.acquire.channels:
        if channel.column == column:
            return channel.delay, "" if channel.unit == "1" else channel.unit
    return 0.0, files.tables.unit_of_column(column)
