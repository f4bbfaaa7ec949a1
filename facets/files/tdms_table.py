"""Tables in TDMS, which LabVIEW writes, read by npTDMS: references, forces, temperatures.

Each channel is a column, named after the channel. If the name ends in no unit, the unit in the
property `unit_string` is appended: Force in N becomes `force_n`. A unit that would be read as
another at the end of a name is only in the head: Torque in Nm becomes `torque`.

Without a channel `time_s`, the times follow from the properties of waveforms, `wf_start_offset` and
`wf_increment`. Waveforms that began at different times, or have different rates, are refused.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from ..core.channels import column_ending, plain_unit
from ..core.errors import InputError
from ..core.extras import require_extra
from ..core.units import unit_in
from .columns import Chunk, columns_to_read, refuse_text, row_chunks, unit_of_column

SIGNATURE = b"TDSm"
KIND = "a TDMS file"
TIME = "time_s"
#: Number of bytes before each segment, and the bit of the fifth byte that indicates numbers with
#: the largest byte first. Bytes 13 to 20 are the segment's length.
LEAD, BIG_ENDIAN = 28, 0x40
#: Starts of waveforms that differ by less than this fraction of a step count as equal: the phase
#: error at the highest frequency is 0.03 rad.
LARGEST_SHIFT = 0.01
#: Exceptions of npTDMS for damaged files.
DAMAGES = (
    OSError, ValueError, LookupError, EOFError, struct.error, NotImplementedError, ArithmeticError,
    MemoryError,
)  # fmt: skip


@contextmanager
def open_file(path: Path) -> Iterator[Any]:
    nptdms = require_extra("nptdms", str(path))
    try:
        with path.open("rb") as raw:  # npTDMS would not close a damaged file.
            require_last_segment(path, raw)
            with nptdms.TdmsFile.open(raw) as file:
                yield file
    except DAMAGES as error:
        reason = str(error) or type(error).__name__
        raise InputError(
            f"{path}: cannot be read as TDMS: {reason}; copy or save it again"
        ) from None


def require_last_segment(path: Path, raw: BinaryIO) -> None:
    """Raise `InputError` for a file that ends within its last segment, of which npTDMS would
    silently drop values."""
    size, place = path.stat().st_size, 0
    while place + LEAD <= size:
        raw.seek(place)
        lead = raw.read(LEAD)
        place += LEAD + int.from_bytes(lead[12:20], "big" if lead[4] & BIG_ENDIAN else "little")
    raw.seek(0)
    if place != size:
        raise InputError(
            f"{path}: is cut off: the file ends within a segment; copy it again, or wait until the "
            "program that writes it has closed it"
        )


@contextmanager
def open_channels(path: Path) -> Iterator[dict[str, Any]]:
    """Context with the channels of a file by column, see `columns_in`."""
    with open_file(path) as file:
        yield columns_in(path, file)


def columns_in(path: Path, file: Any) -> dict[str, Any]:
    """The channels of an open file, by column.

    Raises `InputError` if there are none, or if they differ in length, rate or start.
    """
    channels = [channel for group in file.groups() for channel in group.channels()]
    if not channels:
        raise InputError(f"{path}: holds no channels; save those of the table in it")
    require_equal(path, "length", {channel.name: len(channel) for channel in channels})
    columns = {column_of(path, channel): channel for channel in channels}
    if len(columns) < len(channels):
        raise InputError(f"{path}: two channels give the same column; rename one of them")
    require_equal_times(path, [c for c in channels if c.properties.get("wf_increment")])
    return columns


def require_equal_times(path: Path, waveforms: Sequence[Any]) -> None:
    """Raise `InputError` if waveforms differ in rate or start, or have an axis other than time."""
    steps = {c.name: float(c.properties["wf_increment"]) for c in waveforms}
    require_equal(path, "wf_increment", steps)
    units = {c.name: c.properties.get("wf_xunit_string") or "s" for c in waveforms}
    if other := [name for name, unit in units.items() if unit != "s"]:
        raise InputError(
            f"{path}: channel {other[0]!r} has wf_xunit_string {units[other[0]]!r}; allowed: s"
        )
    starts = {c.name: start_of(c) for c in waveforms}
    spread = np.ptp([*starts.values()]) / np.timedelta64(1, "s") if starts else 0.0
    if starts and spread > LARGEST_SHIFT * min(steps.values()):
        require_equal(path, "wf_start_time + wf_start_offset", starts)


def start_of(waveform: Any) -> np.datetime64:
    """Time of a waveform's first sample; without `wf_start_time`, relative to LabVIEW's zero."""
    offset = round(1e9 * float(waveform.properties.get("wf_start_offset", 0.0)))
    begin = np.datetime64(waveform.properties.get("wf_start_time", "1904-01-01"), "ns")
    return begin + np.timedelta64(offset, "ns")


def require_equal(path: Path, quantity: str, values: dict[str, Any]) -> None:
    """Raise `InputError` if channels differ in a quantity.  values: of it, by channel."""
    if len(set(values.values())) > 1:
        shown = ", ".join(f"{name} {value}" for name, value in values.items())
        raise InputError(
            f"{path}: the channels differ in {quantity} ({shown}); save those of one rate and "
            "start in a file of their own"
        )


def column_of(path: Path, channel: Any) -> str:
    """The column's name for a channel: `force_n` for the channel Force in N.

    Raises `InputError` if the channel's name ends in another unit than its `unit_string`.
    """
    text = plain_unit(channel.name).replace("degC", "C").lower()
    name = "_".join(re.findall("[a-z0-9]+", text))
    unit, named_unit = unit_text(channel), unit_in(name)
    end = column_ending(unit)
    if not named_unit:
        return f"{name}_{end}" if end else name
    if unit and (unit_of_column(f"_{end}") or end) != (unit_of_column(name) or named_unit):
        raise InputError(
            f"{path}: channel {channel.name!r} has the unit_string {unit!r}, but as the column "
            f"{name} it is in {unit_of_column(name) or named_unit}; rename it, or correct "
            "unit_string"
        )
    return name


def unit_text(channel: Any) -> str:
    """The unit of a channel, "" if it has none."""
    return str(channel.properties.get("unit_string", "")).strip()


def values_of(columns: dict[str, Any], name: str, part: slice) -> Any:
    """Some rows of a column; times are computed from the waveforms if the file has none."""
    if name in columns:
        return columns[name][part]
    waveform = first_waveform(columns)
    numbers = np.arange(len(waveform))[part]
    start = float(waveform.properties.get("wf_start_offset", 0.0))
    return start + float(waveform.properties["wf_increment"]) * numbers


def first_waveform(columns: dict[str, Any]) -> Any:
    """The first channel that states its sampling interval; None if there is none."""
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
        head = {key: str(value) for key, value in file.properties.items()}
        units = {name: unit_text(channel) for name, channel in columns_in(path, file).items()}
    return head | {
        f"unit of {name}": unit
        for name, unit in units.items()
        if unit not in ("", "1") and not unit_in(name)
    }


def column_names(path: Path) -> list[str]:
    with open_channels(path) as columns:
        return names_in(columns)


def read_columns(path: Path, names: Sequence[str]) -> dict[str, Any]:
    with open_channels(path) as columns:
        return {name: np.asarray(values_of(columns, name, slice(None))) for name in names}
