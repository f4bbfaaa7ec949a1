"""Auxiliary channels of a detector board's stream: force, drive current, temperature, tacho."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable
from dataclasses import MISSING, dataclass

import numpy as np
from numpy.typing import NDArray

from .keys import key
from .names import READING_COLUMNS, STATE_COLUMNS
from .units import KEY_UNITS, Floats, find_implausible, unit_in


def plain_unit(unit: str) -> str:
    """Write a unit in one of its possible spellings: "um/s2" for µm/s² and for um/s^2."""
    text = unicodedata.normalize("NFKC", unit).replace("μ", "u")
    return text.replace("°", "deg").replace("^", "")


#: Endings of columns by the unit, see `plain_unit`.
ENDINGS = {
    plain_unit(unit.label): ending for ending, unit in reversed(KEY_UNITS.items()) if unit.label
} | {"1": ""}
#: Names of a pose table's columns, which channels cannot have, and beginnings of such names.
TAKEN = frozenset(
    {
        *READING_COLUMNS, *STATE_COLUMNS, "seq", "board_us", "host_s", "utc_s", "time_s", "status",
        "flags", "used", "residual", "misfit", "power_mw", "crc", "samples", "poses",
    }
)  # fmt: skip
TAKEN_BEGINNINGS = (
    "u_", "cov_", "ref_", "object_", "displacement_", "filtered_", "smooth_", "smoothed_", "pulse_",
    "least_", "most_", "mean_",
)  # fmt: skip


#: Characters that a unit must not have: control characters, and spaces other than the plain one.
UNPRINTABLE = r"\x00-\x1f\x7f-\xa0\xad\u200b-\u200f\u2028-\u202f\u205f-\u206f\u3000\ufeff"


@dataclass(frozen=True)
class AuxiliaryChannel:
    """One auxiliary channel of each sample: its value is `offset` plus `scale` times the number in
    the frame."""

    name: str = key(
        "name",
        MISSING,
        "name, with which the column of tables begins: `force` in N is the column `force_n`",
        pattern="^[a-z][a-z0-9_]{0,39}$",
        error="must be small letters, digits and '_', at most 40, and begin with a letter",
    )
    unit: str = key(
        "unit",
        "1",
        "unit as people write it, such as N, A, degC, 1/min; 1: none",
        pattern=rf"^(?! )[^{UNPRINTABLE}]{{1,16}}(?<! )$",
        error="must be a unit of 1 to 16 characters; 1 for no unit",
    )
    scale: float = key("scale", 1.0, "size of one count or volt, in `unit`", ge=-1e15, le=1e15)
    offset: float = key("offset", 0.0, "value at zero counts or volts", ge=-1e15, le=1e15)
    delay: float = key(
        "delay_us",
        0.0,
        "time from the instant of the detectors' sample to that of the channel's; negative for a "
        "channel that shows an earlier value, such as one behind a filter. Columns hold the "
        "values without a shift by it",
        ge=-1e6,
        le=1e6,
    )

    @property
    def column(self) -> str:
        """Name of the channel's column: `force_n`, `temperature_c`."""
        return "_".join(part for part in (self.name, column_ending(self.unit)) if part)

    def values(self, raw: NDArray[np.float32]) -> Floats:
        """Convert numbers of frames (n,) to values (n,) in the channel's unit; NaN for numbers that
        are not finite, or not plausible in this unit."""
        with np.errstate(over="ignore", invalid="ignore"):
            values: Floats = self.offset + self.scale * raw.astype(np.float64)
        is_number = np.isfinite(values) & ~find_implausible(values, self.column)
        return np.where(is_number, values, np.nan)

    def raw(self, values: Floats) -> NDArray[np.float32]:
        """Convert values (n,) in the channel's unit to the numbers in frames (n,)."""
        with np.errstate(over="ignore"):
            return ((values - self.offset) / self.scale).astype(np.float32)


def describe_channels(channels: Iterable[AuxiliaryChannel]) -> dict[str, str]:
    """Entries of a table's head with the unit of each channel, and its delay if it is not 0."""
    entries = {}
    for channel in channels:
        entries[f"unit of {channel.column}"] = channel.unit
        if channel.delay:
            entries[f"delay of {channel.column}"] = f"{1e6 * channel.delay:.6g} us"
    return entries


def column_ending(unit: str) -> str:
    """Ending of a column for a unit: "c" for degC, "mm_s2" for mm/s^2, "n" for N.

    It is empty if it would be read as another unit: "" for Nm, which is not nm.
    """
    plain = plain_unit(unit)
    if plain in ENDINGS:
        return ENDINGS[plain]
    text = plain.lower().replace("%", "percent")
    if text.startswith("1/"):
        text = f"per_{text[2:]}"
    ending = "_".join(re.findall("[a-z0-9]+", text))
    other = unit_in(f"_{ending}")
    return "" if other and KEY_UNITS[other].label else ending


def is_taken(column: str) -> bool:
    """Whether tables of poses use a column's name for another quantity."""
    return column in TAKEN or column.startswith(TAKEN_BEGINNINGS)
