"""Tables in CSV and Parquet of any length: reading in chunks, writing completely or not at all.

A table begins with its provenance: comment lines `# key: value` in CSV, metadata in Parquet. CSV
may be compressed (.csv.gz), and the name - means CSV from the standard input or to the standard
output.
"""

from __future__ import annotations

import csv
import difflib
import gzip
import os
import sys
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, replace
from io import TextIOWrapper
from itertools import chain, islice
from pathlib import Path
from typing import Any

import numpy as np

from ..core.errors import InputError
from ..core.extras import require_extra
from ..core.names import READING_COLUMNS
from ..core.plain_numbers import plain_number
from ..core.units import (
    KEY_UNITS,
    Booleans,
    Floats,
    Integers,
    describe_bounds,
    find_implausible,
    unit_in,
)
from .whole import STANDARD_STREAM
from .whole import ResultSet as ResultSet
from .whole import Whole as Whole
from .whole import refuse_to_overwrite as refuse_to_overwrite

Columns = Mapping[str, Any]
ENDINGS = (".csv", ".csv.gz", ".parquet")
CHUNK = 50_000


@dataclass(frozen=True)
class Chunk:
    """Some rows of a table.

    columns: by name, float, NaN where a cell is empty or holds NaN.  lines: line numbers in the
    file, from 1; row numbers in Parquet.  unparsable: whether a row is not numbers; its columns
    are NaN.  bytes_read: bytes of the file read so far.
    """

    columns: dict[str, Floats]
    lines: Integers
    unparsable: Booleans
    bytes_read: int


def ending(path: Path) -> str:
    if path == STANDARD_STREAM:
        return ".csv"
    if not path.name.lower().endswith(ENDINGS):
        raise InputError(f"{path}: a table's name ends in .csv, .csv.gz or .parquet")
    if path.suffix.lower() == ".parquet":
        require_extra("pyarrow", str(path))
    return path.suffix.lower()


def read_chunks(
    path: Path, needed: Sequence[str] = (), optional: Sequence[str] = (), rows: int = CHUNK
) -> Iterator[Chunk]:
    """Read the named columns of a table, `rows` at a time, and skip the others.

    Values that are not plausible in their column's unit are NaN. Raises `InputError` if a needed
    column is missing or holds words, if most of a column is not plausible, or if the file cannot be
    read.
    """
    require_table(path)
    read = read_parquet if ending(path) == ".parquet" else read_csv
    return (screen(path, chunk) for chunk in read(path, needed, optional, rows))


def screen(path: Path, chunk: Chunk) -> Chunk:
    """The chunk with NaN where a value is not plausible, see `read_chunks`.

    Readings stay: those of a dark detector are of any size, and the solver gives them a status.
    """
    columns = dict(chunk.columns)
    for name in columns.keys() - set(READING_COLUMNS):
        values = columns[name]
        wrong = find_implausible(values, name)
        if 2 * wrong.sum() > len(wrong) - np.isnan(values).sum():
            line, value = chunk.lines[wrong.argmax()], values[wrong.argmax()]
            raise InputError(
                f"{path}:{line}: column {name} holds {value:g}; plausible: "
                f"{describe_bounds(name)}; give the column in the unit that its name says"
            )
        columns[name] = np.where(wrong, np.nan, values)
    return replace(chunk, columns=columns)


#: First bytes of files that are not text tables, and the kind of file.
BEGINNINGS = {
    b"\xff\xfe": "UTF-16 text; save it as UTF-8",
    b"\xfe\xff": "UTF-16 text; save it as UTF-8",
    b"PK\x03\x04": "a spreadsheet or an archive; save it as CSV",
    b"\x1f\x8b": "compressed; name it .csv.gz",
}
PARQUET = b"PAR1"


def require_table(path: Path) -> None:
    """Raise `InputError` if a file is missing or is not of the kind that its name says."""
    if path == STANDARD_STREAM:
        return
    if path.is_dir():
        raise InputError(f"{path}: is a folder, not a table")
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    with open_bytes(path) as file:
        begin = file.read(4)
    if ending(path) == ".parquet":
        if begin != PARQUET:
            raise InputError(f"{path}: not a Parquet table; name a table of text .csv")
        return
    if begin == PARQUET:
        raise InputError(f"{path}: is a Parquet table; name it .parquet")
    for sign, what in BEGINNINGS.items():
        if begin.startswith(sign):
            raise InputError(f"{path}: is {what}")


@contextmanager
def open_bytes(path: Path) -> Iterator[Any]:
    """Open a file, a compressed one, or the standard input."""
    file = 0 if path == STANDARD_STREAM else path
    try:
        with (
            open(file, "rb", closefd=file != 0) as raw,
            gzip.open(raw) if path.suffix.lower() == ".gz" else raw as text,
        ):
            yield text
    except (OSError, EOFError, zlib.error) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{path}: cannot be read: {reason}") from None


class MissingColumnsError(InputError):
    """Error for a table that lacks the columns `names`."""

    def __init__(self, text: str, names: Sequence[str]) -> None:
        super().__init__(text)
        self.names = names


def columns_to_read(
    path: Path, names: Sequence[str], needed: Sequence[str], optional: Sequence[str]
) -> list[str]:
    missing = [name for name in needed if name not in names]
    if missing:
        near = [difflib.get_close_matches(name, names, 1, 0.7) for name in missing]
        hints = [f"{name} (found: {close[0]})" if close else name
                 for name, close in zip(missing, near, strict=True)]  # fmt: skip
        raise MissingColumnsError(f"{path}: missing columns: {', '.join(hints)}", missing)
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(f"{path}: columns that appear twice: {', '.join(twice)}")
    return [*needed, *(name for name in optional if name in names and name not in needed)]


class Sheet:
    """An open CSV table after its header: rows with their line numbers."""

    def __init__(self, path: Path, raw: Any) -> None:
        self.path, self.raw = path, raw
        file = TextIOWrapper(raw, encoding="utf-8-sig", errors="replace", newline="")
        header, self.first, self.head = "", 0, {}
        for self.first, header in enumerate(file, start=1):
            if header.strip() and not header.startswith("#"):
                break
            key, mark, value = header[1:].partition(":")
            if mark:
                self.head[key.strip()] = value.strip()
        delimiter = delimiter_of(header)
        try:
            names = next(csv.reader([header], delimiter=delimiter), [])
        except csv.Error as error:
            raise InputError(f"{path}:{self.first}: not a header: {error}") from None
        self.names = [name.strip() for name in names]
        # numbers need no quotes, and a stray one must not swallow the lines that follow it
        self.reader = csv.reader(file, delimiter=delimiter, quoting=csv.QUOTE_NONE)

    def rows(self) -> Iterator[tuple[int, list[str]]]:
        """Yield line numbers, from 1, and cells; skip comments and empty lines."""
        while True:
            try:
                row = next(self.reader)
            except StopIteration:
                return
            except csv.Error as error:
                line = self.first + self.reader.line_num
                raise InputError(f"{self.path}:{line}: not a line of a table: {error}") from None
            if row and not row[0].startswith("#"):
                yield self.first + self.reader.line_num, row

    def bytes_read(self) -> int:
        return os.lseek(self.raw.fileno(), 0, os.SEEK_CUR) if self.raw.seekable() else 0


def read_head(path: Path) -> dict[str, str]:
    """Read the head of a table, written by `provenance.provenance_header`; empty if it has none."""
    require_table(path)
    if ending(path) == ".parquet":
        import pyarrow as pa
        import pyarrow.parquet as pq

        try:
            metadata = pq.read_schema(path).metadata or {}
        except (pa.ArrowException, OSError):
            return {}
        return {key.decode(): value.decode(errors="replace") for key, value in metadata.items()}
    with open_sheet(path) as sheet:
        return sheet.head


def delimiter_of(header: str) -> str:
    """Delimiter of a line: a comma or, if it has none, a semicolon or a tab."""
    return next((mark for mark in ",;\t" if mark in header), ",")


@contextmanager
def open_sheet(path: Path) -> Iterator[Sheet]:
    with open_bytes(path) as raw:
        yield Sheet(path, raw)


def read_numbers(path: Path, names: Sequence[str] = ()) -> tuple[list[str], Floats]:
    """Read names and rows of a small CSV table that holds only numbers.

    Raises `InputError` with the line of a cell that is not a number.
    """
    with open_sheet(path) as sheet:
        use = columns_to_read(path, sheet.names, names or sheet.names, ())
        places, rows = [sheet.names.index(name) for name in use], []
        for line, row in sheet.rows():
            try:
                rows.append([number(row[place]) for place in places])
            except (ValueError, IndexError):
                raise InputError(f"{path}:{line}: this row cannot be read as numbers") from None
    return use, np.array(rows, dtype=float).reshape(len(rows), len(use))


def read_words(path: Path, name: str) -> list[str] | None:
    """Read a column of words of a whole table; None if it has no such column."""
    require_table(path)
    if ending(path) == ".parquet":
        import pyarrow.parquet as pq

        if name not in pq.read_schema(path).names:
            return None
        return [str(word) for word in pq.read_table(path, columns=[name])[name].to_pylist()]
    with open_sheet(path) as sheet:
        if name not in sheet.names:
            return None
        place = sheet.names.index(name)
        return [row[place].strip() if place < len(row) else "" for _, row in sheet.rows()]


def read_csv(
    path: Path, needed: Sequence[str], optional: Sequence[str], rows: int
) -> Iterator[Chunk]:
    with open_sheet(path) as sheet:
        use = columns_to_read(path, sheet.names, needed, optional)
        places, width = [sheet.names.index(name) for name in use], len(sheet.names)
        numbered = sheet.rows()
        first = list(islice(numbered, LOOKED_AT))
        refuse_words(path, dict(zip(use, places, strict=True)),
                     [(line, row) for line, row in first if len(row) == width])  # fmt: skip
        numbered = chain(first, numbered)
        while block := list(islice(numbered, rows)):
            values, bad = numbers([row for _, row in block], places, width)
            yield Chunk(
                columns=dict(zip(use, values.T, strict=True)),
                lines=np.array([line for line, _ in block]),
                unparsable=bad,
                bytes_read=sheet.bytes_read(),
            )


#: A column that holds only words in this number of rows is taken for a column of words.
LOOKED_AT = 1000


def refuse_words(
    path: Path, places: Mapping[str, int], rows: Sequence[tuple[int, list[str]]]
) -> None:
    """Raise `InputError` for a column that holds words and no number in the checked rows."""
    for name, place in places.items():
        cells = [(line, row[place].strip()) for line, row in rows]
        words = [(line, cell) for line, cell in cells if not is_number(cell)]
        if words and len(words) == len(cells) and len(cells) > 1:
            line, word = words[0]
            hint = "; write decimals after a point" if is_number(word.replace(",", ".")) else ""
            raise InputError(
                f"{path}:{line}: column {name} holds {word[:40]!r}, not a number{hint}"
                f"{TIME_HINT if name == 'time_s' else ''}"
            )


TIME_HINT = "; give seconds, or leave the column out"


def number(cell: str) -> float:
    """Convert a cell to a number, an empty one to NaN; quotes around it are ignored."""
    text = cell.strip()
    if len(text) > 1 and text[0] == text[-1] == '"':
        text = text[1:-1]
    return plain_number(text or "nan")


def is_plain(text: str) -> bool:
    """Return whether NumPy reads the numbers of a text as `number` does."""
    return text.isascii() and "_" not in text


def is_number(cell: str) -> bool:
    try:
        number(cell)
    except ValueError:
        return False
    return True


def numbers(rows: list[list[str]], places: list[int], width: int) -> tuple[Floats, Booleans]:
    """Convert cells to floats (n, columns), empty ones to NaN; flag rows that are not numbers."""
    bad = np.array([len(row) != width for row in rows])
    cells = [[row[i] or "nan" for i in places] for row in rows] if not bad.any() else None
    if cells is not None and is_plain("".join(map("".join, cells))):
        with suppress(ValueError):
            return np.array(cells, dtype=float).reshape(len(rows), len(places)), bad
    values = np.full((len(rows), len(places)), np.nan)
    for n in np.flatnonzero(~bad):
        try:
            values[n] = [number(rows[n][i]) for i in places]
        except ValueError:
            bad[n] = True
    return values, bad


def read_parquet(
    path: Path, needed: Sequence[str], optional: Sequence[str], rows: int
) -> Iterator[Chunk]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        file = pq.ParquetFile(path)
        use = columns_to_read(path, file.schema_arrow.names, needed, optional)
        require_numbers(path, file.schema_arrow, use)
        done = 0
        for batch in file.iter_batches(rows, columns=use):
            columns = {
                name: column.cast(pa.float64()).to_numpy(zero_copy_only=False)
                for name, column in zip(batch.schema.names, batch.columns, strict=True)
            }
            size = path.stat().st_size * (done + len(batch)) // file.metadata.num_rows
            lines = np.arange(done, done + len(batch)) + 1
            done += len(batch)
            yield Chunk(columns, lines, np.zeros(len(batch), dtype=bool), size)
    except (pa.ArrowException, OSError) as error:
        what = str(error).partition("\n")[0]
        raise InputError(f"{path}: not a Parquet table of numbers: {what}") from None


def require_numbers(path: Path, schema: Any, names: Sequence[str]) -> None:
    """Raise `InputError` for columns of a Parquet table that are not of a numeric type."""
    from pyarrow import types

    kinds = (types.is_integer, types.is_floating, types.is_decimal, types.is_null)
    for name in names:
        kind = schema.field(name).type
        if not any(is_kind(kind) for is_kind in kinds):
            raise InputError(
                f"{path}: column {name} holds {kind}, not numbers"
                f"{TIME_HINT if name == 'time_s' else ''}"
            )


def arrow_column(values: Any) -> Any:
    """Make an Arrow column: numbers without a copy, texts one after the other.

    `pyarrow.array` would first import pandas to check whether the values are a pandas series, which
    takes longer than solving a small table.
    """
    import pyarrow as pa

    array = np.asarray(values)
    if array.ndim == 1 and array.size and array.dtype in (np.float64, np.int64):
        memory = pa.py_buffer(np.ascontiguousarray(array))
        return pa.Array.from_buffers(pa.from_numpy_dtype(array.dtype), array.size, [None, memory])
    if array.ndim == 1 and array.size and array.dtype.kind == "U":
        texts = [text.encode() for text in array.tolist()]
        ends = np.cumsum([0, *map(len, texts)])
        if ends[-1] < 2**31:
            parts = [None, pa.py_buffer(ends.astype(np.int32)), pa.py_buffer(b"".join(texts))]
            return pa.Array.from_buffers(pa.string(), array.size, parts)
    return pa.array(values)


def text_cells(values: Any) -> list[str]:
    """Write a column's values as text; floats have the digits that give the same float again."""
    import orjson

    array = np.ascontiguousarray(values)
    if array.dtype.kind in "biuf" and array.size and not np.isinf(array).any():
        text = orjson.dumps(array, option=orjson.OPT_SERIALIZE_NUMPY).decode()
        return text[1:-1].replace("null", "nan").split(",")
    texts = ["" if value is None else str(value) for value in array.tolist()]
    if array.dtype.kind in "OU" and any(mark in "".join({*texts}) for mark in ',"\r\n'):
        raise ValueError("a cell holds a comma, a quote or a line break")
    return texts


def text_lines(columns: Columns) -> str:
    """Write rows as lines of CSV."""
    rows = zip(*map(text_cells, columns.values()), strict=True)
    return "".join(f"{','.join(row)}\n" for row in rows)


class Writer:
    """Appends blocks of rows to a table, which is CSV or Parquet by the file's suffix."""

    def __init__(self, path: Path, about: Mapping[str, str]) -> None:
        self.path = path
        self.about = about
        self.file: Any = None

    def write(self, columns: Columns) -> None:
        if self.path.suffix.lower() == ".parquet":
            self.write_batch(columns)
            return
        if self.file is None:
            self.file = self.open_text()
            lines = [f"# {key}: {' '.join(value.split())}" for key, value in self.about.items()]
            self.file.write("\n".join([*lines, ",".join(columns)]).encode() + b"\n")
        self.file.write(text_lines(columns).encode())

    def write_batch(self, columns: Columns) -> None:
        import pyarrow as pa
        import pyarrow.parquet as pq

        arrays = [arrow_column(values) for values in columns.values()]
        batch = pa.RecordBatch.from_arrays(arrays, names=list(columns))
        if self.file is None:
            self.file = pq.ParquetWriter(self.path, add_units(batch.schema, self.about))
        self.file.write_batch(batch)

    def open_text(self) -> Any:
        if self.path == STANDARD_STREAM:
            return sys.stdout.buffer
        return (gzip.open if self.path.suffix.lower() == ".gz" else open)(self.path, "wb")

    def close(self) -> None:
        if self.path == STANDARD_STREAM:
            sys.stdout.flush()
        elif self.file is not None:
            self.file.close()


@contextmanager
def open_writer(path: Path, about: Mapping[str, str]) -> Iterator[Writer]:
    """Open a table that appears under its name once it is complete.  about: its provenance."""
    ending(path)
    with nullcontext(path) if path == STANDARD_STREAM else Whole(path) as temporary:
        writer = Writer(temporary, about)
        try:
            yield writer
        finally:
            writer.close()


#: Units of covariances, by the ends of their columns' names.
PRODUCT_UNITS = {"_mm2": "mm^2", "_mm_mrad": "mm mrad", "_mrad2": "mrad^2", "": ""}


def unit_of_column(name: str) -> str:
    """The unit at the end of a column's name, in its usual spelling, or an empty text."""
    if name.startswith("cov_"):
        return next(label for ending, label in PRODUCT_UNITS.items() if name.endswith(ending))
    ending = unit_in(name)
    return KEY_UNITS[ending].label if ending else ""


def add_units(schema: Any, about: Mapping[str, str]) -> Any:
    """Add each field's unit (key `unit`) and `about` to an Arrow schema.

    An entry "unit of NAME" of `about` goes before the unit at the end of a column's name.
    """
    import pyarrow as pa

    fields = [
        field.with_metadata({"unit": unit}) if unit else field
        for field in schema
        for unit in [about.get(f"unit of {field.name}", unit_of_column(field.name))]
    ]
    return pa.schema(fields, metadata=dict(about))


def write_table(path: Path, columns: Columns, about: Mapping[str, str]) -> None:
    """Write a table at once.  about: its provenance."""
    with open_writer(path, about) as writer:
        writer.write(columns)
