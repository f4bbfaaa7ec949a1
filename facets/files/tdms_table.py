"""Tables in TDMS, which LabVIEW writes, read by npTDMS: references, forces, temperatures.

Each channel is a column. Its name is that of the channel, with the unit of its property
`unit_string` behind it if it ends in none: Force in N is `force_n`. Without a channel `time_s`, the
times come from the properties of waveforms, `wf_start_offset` and `wf_increment`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from ..core.channels import column_ending
from ..core.errors import InputError
from ..core.extras import require_extra
from ..core.units import unit_in
from .columns import Chunk, columns_to_read, refuse_text, row_chunks

SIGNATURE = b"TDSm"
KIND = "a TDMS file"
TIME = "time_s"


@contextmanager
def open_file(path: Path) -> Iterator[Any]:
    nptdms = require_extra("nptdms", str(path))
    try:
        with nptdms.TdmsFile.open(path) as file:
            yield file
    except (OSError, ValueError, KeyError, EOFError) as error:
        raise InputError(f"{path}: cannot be read as TDMS: {error}") from None


@contextmanager
def open_channels(path: Path) -> Iterator[dict[str, Any]]:
    """Open the channels of a file by the names of their columns.

    Raises `InputError` if they are not columns of one table.
    """
    with open_file(path) as file:
        channels = [channel for group in file.groups() for channel in group.channels()]
        counts = {channel.name: len(channel) for channel in channels}
        if len(set(counts.values())) > 1:
            shown = ", ".join(f"{name} {count}" for name, count in counts.items())
            raise InputError(
                f"{path}: the channels differ in length ({shown}); save those of one rate in a "
                "file of their own"
            )
        columns = {column_of(channel): channel for channel in channels}
        if len(columns) < len(channels):
            raise InputError(f"{path}: two channels give the same column; rename one of them")
        yield columns


def column_of(channel: Any) -> str:
    """The name of a channel's column: `force_n` of the channel Force in N."""
    name = "_".join(re.findall("[a-z0-9]+", channel.name.lower()))
    end = column_ending(str(channel.properties.get("unit_string", "")))
    return name if unit_in(name) or not end else f"{name}_{end}"


def values_of(columns: dict[str, Any], name: str, part: slice) -> Any:
    """Some rows of a column; times are computed where the file has none."""
    if name in columns:
        return columns[name][part]
    waveform = first_waveform(columns)
    numbers = np.arange(len(waveform))[part]
    start = float(waveform.properties.get("wf_start_offset", 0.0))
    return start + float(waveform.properties["wf_increment"]) * numbers


def first_waveform(columns: dict[str, Any]) -> Any:
    """The first channel that says how fast it was sampled; None if none does."""
    return next((c for c in columns.values() if c.properties.get("wf_increment")), None)


def names_in(columns: dict[str, Any]) -> list[str]:
    is_timed = TIME not in columns and first_waveform(columns) is not None
    return [*([TIME] if is_timed else []), *columns]


def read_chunks(
    path: Path, needed: Sequence[str], optional: Sequence[str], rows: int
) -> Iterator[Chunk]:
    with open_channels(path) as columns:
        use = columns_to_read(path, names_in(columns), needed, optional)
        for name in use:
            if name in columns and columns[name].dtype.kind not in "iuf":
                raise refuse_text(path, name, columns[name].dtype)
        count = len(next(iter(columns.values()), ()))
        yield from row_chunks(
            count,
            rows,
            path.stat().st_size,
            lambda part: {name: values_of(columns, name, part) for name in use},
        )


def read_head(path: Path) -> dict[str, str]:
    with open_file(path) as file:
        return {key: str(value) for key, value in file.properties.items()}


def column_names(path: Path) -> list[str]:
    with open_channels(path) as columns:
        return names_in(columns)


def read_columns(path: Path, names: Sequence[str]) -> dict[str, Any]:
    with open_channels(path) as columns:
        return {name: np.asarray(values_of(columns, name, slice(None))) for name in names}
