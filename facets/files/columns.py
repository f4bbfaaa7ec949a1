"""Columns of tables in any format: their names, units, times and covariances."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from textwrap import shorten
from typing import Any

import numpy as np

from ..core.clocks import LARGEST_RATE, STANDSTILL, describe_rate
from ..core.errors import InputError
from ..core.names import covariance_entries
from ..core.plain_numbers import suggest_name
from ..core.units import KEY_UNITS, Booleans, Floats, Integers, unit_in

Columns = Mapping[str, Any]
#: Key of a table's head for the complete configuration as JSON, of which `config_sha256` is the
#: checksum. The comment lines of CSV omit it.
CONFIGURATION = "configuration"
TIME_HINT = "; give seconds, or leave the column out"
NUMBER_HINT = "; give numbers"


@dataclass(frozen=True)
class Chunk:
    """Successive rows (n,) of a table.

    columns: by name, (n,) floats, NaN where a cell is empty or holds NaN.  lines: (n,) line numbers
    in the file, from 1; row numbers in formats other than CSV.  unparsable: (n,) whether a row is
    malformed; its columns are NaN.  bytes_read: number of bytes of the file read so far.
    """

    columns: dict[str, Floats]
    lines: Integers
    unparsable: Booleans
    bytes_read: int


def row_chunks(
    count: int, rows: int, size: int, read: Callable[[slice], Mapping[str, Any]]
) -> Iterator[Chunk]:
    """Yield a table of `count` rows in chunks of `rows`.

    size: of the file, bytes.  read: returns columns of numbers for a slice of rows.
    """
    for start in range(0, count, rows):
        part = slice(start, min(start + rows, count))
        columns = {name: np.asarray(values, np.float64) for name, values in read(part).items()}
        lines = np.arange(part.start, part.stop) + 1
        yield Chunk(columns, lines, np.zeros(len(lines), dtype=bool), size * part.stop // count)


class MissingColumnsError(InputError):
    """Error for a table without needed columns.  names: of the missing columns."""

    def __init__(self, text: str, names: Sequence[str]) -> None:
        super().__init__(text)
        self.names = names


def join_columns(parts: Sequence[Columns]) -> dict[str, Any]:
    """Concatenate the rows of tables with the same columns."""
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def suggest_column(missing: str, names: Iterable[str]) -> str:
    """Suggest the column to use or to convert for a missing one; "" if none is near."""
    quantity = missing.removesuffix(unit_in(missing))
    for name in names:
        if unit_in(name) and name.removesuffix(unit_in(name)) == quantity:
            return f"; {name} has another unit: convert it to {unit_of_column(missing)}"
    return suggest_name(missing, sorted(names))


def columns_to_read(
    source: object, names: Sequence[str], needed: Sequence[str], optional: Sequence[str]
) -> list[str]:
    missing = [name for name in needed if name not in names]
    if missing:
        shown = shorten(", ".join(names) or "none", 200, placeholder=" ...")
        near = suggest_column(missing[0], set(names) - set(needed))
        text = f"{source}: missing columns: {', '.join(missing)}{near} (columns found: {shown})"
        raise MissingColumnsError(text, missing)
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(f"{source}: columns that appear twice: {', '.join(twice)}")
    return [*needed, *(name for name in optional if name in names and name not in needed)]


def refuse_text(source: object, name: str, kind: object) -> InputError:
    """Make the error for a column that holds no numbers.  kind: of its values."""
    hint = TIME_HINT if name == "time_s" else NUMBER_HINT
    return InputError(f"{source}: column {name} holds {kind}, not numbers{hint}")


#: Units of covariances, by the ends of their columns' names.
PRODUCT_UNITS = {"_mm2": "mm^2", "_mm_mrad": "mm mrad", "_mrad2": "mrad^2", "": ""}


def unit_of_column(name: str) -> str:
    """The unit at the end of a column's name, in its usual spelling; "" if there is none."""
    if name.startswith("cov_"):
        return next(label for ending, label in PRODUCT_UNITS.items() if name.endswith(ending))
    ending = unit_in(name)
    return KEY_UNITS[ending].label if ending else ""


def units_of(names: Iterable[str], about: Mapping[str, Any]) -> dict[str, str]:
    """The units of columns, by name; without the columns that have none.

    An entry "unit of NAME" of `about` takes precedence over the unit at the end of a column's name.
    """
    units = {name: str(about.get(f"unit of {name}", unit_of_column(name))) for name in names}
    return {name: unit for name, unit in units.items() if unit}


#: Columns of times, by precedence, with their units, s; a recording's table has the board's clock.
TIMES = {"time_s": 1.0, "board_us": 1e-6}
#: Columns that are times, not signals, in tables and recordings.
TIME_COLUMNS = (*TIMES, "host_s", "utc_s")
#: Two clocks are compared by this fraction of a table's rows, the last ones, and by the median
#: ratio over this many steps.
NEWEST_FRACTION, CLOCK_STEPS = 0.1, 20


def clock_rate(columns: Columns) -> float:
    """Relative deviation of the board's clock (board_us) from the host's (host_s); positive if the
    board's is slow, 0 if it is unknown or within the tolerance of a quartz."""
    if not {"board_us", "host_s"} <= columns.keys():
        return 0.0
    count = max(2, int(NEWEST_FRACTION * len(columns["host_s"])))
    steps = slice(-count, None, max(1, count // CLOCK_STEPS))
    board, host = (np.diff(columns[name][steps]) for name in ("board_us", "host_s"))
    ratios = 1e-6 * board[host > 0] / host[host > 0]
    rate = 1.0 - float(np.median(ratios)) if len(ratios) else 0.0
    return rate if abs(rate) > LARGEST_RATE else 0.0


def row_times(columns: Columns) -> Floats:
    """Times of rows (n,), s, from the first existing column of `TIMES`.

    Times of a board's clock that contradicts the host's clock are scaled to the latter. Raises
    `InputError` if the board's clock does not run.
    """
    name = next(name for name in TIMES if name in columns)
    time: Floats = TIMES[name] * np.asarray(columns[name], float)
    rate = clock_rate(columns) if name == "board_us" else 0.0
    if rate > 1 - STANDSTILL:
        raise InputError(describe_rate(rate))
    return time / (1 - rate) if rate else time


#: Columns over which the others are drawn.
AXES = (*TIMES, "frequency_hz", "position_mm", "position_deg")
#: The dimension of tables without such a column.
ROW = "row"
#: Dimensions of a covariance, whose numbers are named by `POSE`.
COVARIANCE_AXES = ("cov_row", "cov_column")


def axis_of(names: Iterable[str]) -> str:
    """Name of the column over which the others are drawn, or `ROW`."""
    return next((name for name in AXES if name in names), ROW)


def covariance_places(names: Iterable[str]) -> dict[str, tuple[str, int, int]]:
    """Elements of complete covariances, which have all 21 columns, by column: the name of the
    covariance, such as cov_object, and the element's row and column in it."""
    first, places = "tx_tx_mm2", dict[str, tuple[str, int, int]]()
    prefixes = [n[4 : -len(first)] for n in names if n.startswith("cov_") and n.endswith(first)]
    for prefix in prefixes:
        matrix_name = f"cov_{prefix.rstrip('_') or 'pose'}"
        columns = covariance_entries(prefix)
        if columns.keys() <= set(names):
            places |= {name: (matrix_name, i, j) for name, (i, j) in columns.items()}
    return places


def pack_covariances(columns: Columns) -> dict[str, Any]:
    """Replace the 21 columns of each covariance by one of matrices (n, 6, 6), mm and mrad."""
    packed = dict[str, Any]()
    places = covariance_places(columns)
    for name, values in columns.items():
        if name not in places:
            packed[name] = np.asarray(values)
            continue
        matrix_name, i, j = places[name]
        matrix = packed.setdefault(matrix_name, np.empty((len(values), 6, 6)))
        matrix[:, i, j] = matrix[:, j, i] = values
    return packed
