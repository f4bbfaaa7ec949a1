"""Tables of any length: reading in chunks, writing completely or not at all.

A table begins with its provenance: comment lines `# key: value` in CSV, which is read and written
here; metadata and attributes in the formats of `FORMATS`. CSV may be compressed (.csv.gz), and the
name - means CSV from the standard input or to the standard output.
"""

from __future__ import annotations

import csv
import gzip
import os
import re
import sys
import warnings
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import replace
from io import TextIOWrapper
from itertools import chain, islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.errors import InputError
from ..core.names import READING_COLUMNS, escape_undecodable
from ..core.plain_numbers import plain_number
from ..core.units import Booleans, Floats, describe_bounds, find_implausible
from . import frame_table, hdf5_table, parquet_table, tdms_table
from .columns import CONFIGURATION, TIME_HINT, Columns, columns_to_read
from .columns import Chunk as Chunk
from .columns import MissingColumnsError as MissingColumnsError
from .columns import unit_of_column as unit_of_column
from .frame_table import FrameTable, make_frame
from .hdf5_table import Hdf5Writer
from .parquet_table import ParquetWriter
from .whole import STANDARD_STREAM
from .whole import ResultSet as ResultSet
from .whole import Whole as Whole
from .whole import refuse_to_overwrite as refuse_to_overwrite

if TYPE_CHECKING:
    from pandas import DataFrame

#: A table in a file, or in memory.
Source = Path | FrameTable
#: Endings of tables that are written, and of those that are only read.
ENDINGS = (".csv", ".csv.gz", ".parquet", ".h5")
READABLE = (*ENDINGS, ".tdms")
#: Formats other than CSV, by the suffixes of their files.
FORMATS: dict[str, Any] = {".parquet": parquet_table, ".h5": hdf5_table, ".tdms": tdms_table}
CHUNK = 50_000


def ending(path: Path, allowed: Sequence[str] = ENDINGS) -> str:
    """The suffix of a table's file; raises `InputError` if it is none of a table."""
    if path == STANDARD_STREAM:
        return ".csv"
    if not path.name.lower().endswith(tuple(allowed)):
        *some, last = allowed
        raise InputError(f"{path}: a table's name ends in {', '.join(some)} or {last}")
    return path.suffix.lower()


def format_of(source: Source) -> Any:
    """The functions that read a table, after `require_table`; None for CSV."""
    if isinstance(source, FrameTable):
        return frame_table
    require_table(source)
    return FORMATS.get(ending(source, READABLE))


def read_chunks(
    source: Source, needed: Sequence[str] = (), optional: Sequence[str] = (), rows: int = CHUNK
) -> Iterator[Chunk]:
    """Read the named columns of a table, `rows` at a time, and skip the others.

    Values that are not plausible in their column's unit are NaN. Raises `InputError` if a needed
    column is missing or holds words, if most of a column is not plausible, or if the file cannot be
    read.
    """
    other = format_of(source)
    read: Callable[..., Iterator[Chunk]] = other.read_chunks if other else read_csv
    return (screen(source, chunk) for chunk in read(source, needed, optional, rows))


def screen(source: Source, chunk: Chunk) -> Chunk:
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
                f"{source}:{line}: column {name} holds {value:g}; plausible: "
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
    expected = FORMATS.get(ending(path, READABLE))
    if expected and begin != expected.SIGNATURE:
        raise InputError(f"{path}: not {expected.KIND}; name a table of text .csv")
    for suffix, other in FORMATS.items():
        if other is not expected and begin == other.SIGNATURE:
            raise InputError(f"{path}: is {other.KIND}; name it {suffix}")
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


class Sheet:
    """An open CSV table after its header: rows with their line numbers."""

    def __init__(self, path: Path, raw: Any) -> None:
        self.path, self.raw = path, raw
        file = TextIOWrapper(raw, encoding="utf-8-sig", errors="replace", newline="")
        header, self.first, self.head, declared = "", 0, {}, ""
        for self.first, header in enumerate(file, start=1):
            if declaration := re.fullmatch(r'(?i)"?sep= ?(.)"?\s*', header):  # Excel's
                declared = declaration[1]
            elif header.strip() and not header.startswith("#"):
                break
            key, mark, value = header[1:].partition(":")
            if mark:
                self.head[key.strip()] = value.strip()
        else:
            raise InputError(f"{path}: is empty: it has no header and no rows")
        self.file, self.delimiter = file, declared or delimiter_of(header)
        try:
            names = next(csv.reader([header], delimiter=self.delimiter), [])
        except csv.Error as error:
            raise InputError(f"{path}:{self.first}: not a header: {error}") from None
        self.names = [name.strip() for name in names]
        while len(self.names) > 1 and not self.names[-1]:  # each line ends with a delimiter
            self.names.pop()
        #: Cells that a row may have besides, if they are empty.
        self.spare = 1 + len(names) - len(self.names)
        # numbers need no quotes, and a stray one must not swallow the lines that follow it
        self.reader = csv.reader(file, delimiter=self.delimiter, quoting=csv.QUOTE_NONE)

    def rows(self) -> Iterator[tuple[int, list[str]]]:
        """Yield line numbers, from 1, and cells; skip comments, empty lines, and empty cells at
        the end of a row that has more cells than the header."""
        width = len(self.names)
        while True:
            try:
                row = next(self.reader)
            except StopIteration:
                return
            except csv.Error as error:
                line = self.first + self.reader.line_num
                raise InputError(f"{self.path}:{line}: not a line of a table: {error}") from None
            if row and not row[0].startswith("#"):
                is_empty = len(row) > width and not "".join(row[width:]).strip()
                yield self.first + self.reader.line_num, row[:width] if is_empty else row

    def columns_to_read(self, needed: Sequence[str], optional: Sequence[str]) -> list[str]:
        """Names of the columns to read; errors say which line was taken for the header."""
        place = f"{self.path}: header in line {self.first}"
        return columns_to_read(place, self.names, needed, optional)

    def refuse_width(self, line: int, row: Sequence[str]) -> InputError:
        """The error for a row that has another number of cells than the header."""
        return InputError(
            f"{self.path}:{line}: this row has {len(row)} cells, and the header in line "
            f"{self.first} has {len(self.names)}; give each row as many"
        )

    def bytes_read(self) -> int:
        return os.lseek(self.raw.fileno(), 0, os.SEEK_CUR) if self.raw.seekable() else 0


def read_head(path: Path) -> dict[str, str]:
    """Read the head of a table, written by `provenance.provenance_header`; empty if it has none."""
    other = format_of(path)
    if other:
        head: dict[str, str] = other.read_head(path)
        return head
    with open_sheet(path) as sheet:
        return sheet.head


def column_names(path: Path) -> list[str]:
    """The names of a table's columns; none for a file whose name is not that of a table."""
    if not path.name.lower().endswith(READABLE):
        return []
    other = format_of(path)
    if other:
        return list(other.column_names(path))
    with open_sheet(path) as sheet:
        return sheet.names


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
        use = sheet.columns_to_read(names or sheet.names, ())
        places, rows = [sheet.names.index(name) for name in use], []
        for line, row in sheet.rows():
            if len(row) != len(sheet.names):
                raise sheet.refuse_width(line, row)
            try:
                rows.append([number(row[place]) for place in places])
            except ValueError:
                raise InputError(f"{path}:{line}: this row cannot be read as numbers") from None
    return use, np.array(rows, dtype=float).reshape(len(rows), len(use))


def read_words(source: Source, name: str) -> list[str] | None:
    """Read a column of words of a whole table; None if it has no such column."""
    other = format_of(source)
    if other:
        if name not in other.column_names(source):
            return None
        return [str(word) for word in other.read_columns(source, [name])[name]]
    assert isinstance(source, Path)
    with open_sheet(source) as sheet:
        if name not in sheet.names:
            return None
        place = sheet.names.index(name)
        return [unquote(row[place]) if place < len(row) else "" for _, row in sheet.rows()]


def read_csv(
    path: Path, needed: Sequence[str], optional: Sequence[str], rows: int
) -> Iterator[Chunk]:
    with open_sheet(path) as sheet:
        use = sheet.columns_to_read(needed, optional)
        places, width = [sheet.names.index(name) for name in use], len(sheet.names)
        numbered = sheet.rows()
        first = list(islice(numbered, LOOKED_AT))
        whole = [(line, row) for line, row in first if len(row) == width]
        if first and not whole:
            raise sheet.refuse_width(*first[0])
        refuse_words(path, dict(zip(use, places, strict=True)), whole)
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


def number(cell: str) -> float:
    """Convert a cell to a number, an empty one to NaN; quotes around it are ignored."""
    return plain_number(unquote(cell) or "nan")


def unquote(cell: str) -> str:
    """A cell without the blanks and the quotes around it."""
    text = cell.strip()
    return text[1:-1] if len(text) > 1 and text[0] == text[-1] == '"' else text


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


def read_columns(path: Path) -> Columns:
    """Read all columns of a table, numbers and words, as they are."""
    other = format_of(path)
    if other:
        columns: Columns = other.read_columns(path, other.column_names(path))
        return columns
    import pandas as pd

    # before 3.1 the last digit of a number was by default not that of the text
    is_exact = tuple(map(int, pd.__version__.split(".")[:2])) >= (3, 1)
    exact: Any = {} if is_exact else {"float_precision": "round_trip"}
    with open_sheet(path) as sheet, warnings.catch_warnings():
        sheet.columns_to_read((), ())
        spare = list(range(sheet.spare))
        # pandas would leave the last cells of a first row with too many out
        warnings.simplefilter("error", pd.errors.ParserWarning)
        try:
            frame = pd.read_csv(
                sheet.file, names=[*sheet.names, *spare], sep=sheet.delimiter, comment="#",
                skipinitialspace=True, index_col=False, keep_default_na=False,
                na_values=["", "nan"], quoting=csv.QUOTE_NONE, **exact,
            )  # fmt: skip
            is_cut = not frame[spare].isna().all(axis=None)
        except (pd.errors.ParserWarning, ValueError) as error:  # pandas' ParserError among them
            refuse_wide_rows(path)
            raise InputError(f"{path}: cannot be read as a table: {str(error).strip()}") from None
    if is_cut:
        refuse_wide_rows(path)
    return {name: numbers_or_words(frame[name]) for name in sheet.names}


def refuse_wide_rows(path: Path) -> None:
    """Raise `InputError` for the first row that has more cells than the header."""
    with open_sheet(path) as sheet:
        for line, row in sheet.rows():
            if len(row) > len(sheet.names):
                raise sheet.refuse_width(line, row)


def numbers_or_words(column: Any) -> Any:
    """A column of pandas as numbers, NaN where a cell is no number; as words if most cells are.

    Quotes around cells are left out, as in `number`.
    """
    import pandas as pd

    if pd.api.types.is_numeric_dtype(column):
        return column.to_numpy()
    is_text = column.map(lambda cell: isinstance(cell, str))  # of a long table not all are
    column = column.mask(is_text, column[is_text].map(unquote)).replace("", np.nan)
    numbers = pd.to_numeric(column, errors="coerce")
    is_number = 2 * numbers.notna().sum() > column.notna().sum()
    return (numbers if is_number else column.fillna("")).to_numpy()


def read_frame(path: Path) -> DataFrame:
    """Read a table as a data frame, with its units and its head in `attrs`."""
    return make_frame(read_columns(path), read_head(path))


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


def head_lines(about: Mapping[str, str]) -> list[str]:
    """Provenance as comment lines, without the whole configuration."""
    known = {key: " ".join(value.split()) for key, value in about.items() if key != CONFIGURATION}
    return [f"# {key}: {value}" for key, value in known.items()]


class CsvWriter:
    """Appends blocks of rows to a table of text, whose columns are those of the first block."""

    def __init__(self, path: Path, about: Mapping[str, str], columns: Columns) -> None:
        self.is_stream = path == STANDARD_STREAM
        self.file = self.open_text(path)
        lines = [*head_lines(about), ",".join(columns)]
        self.file.write("\n".join(lines).encode() + b"\n")

    def open_text(self, path: Path) -> Any:
        if self.is_stream:
            return sys.stdout.buffer
        return (gzip.open if path.suffix.lower() == ".gz" else open)(path, "wb")

    def write(self, columns: Columns) -> None:
        rows = zip(*map(text_cells, columns.values()), strict=True)
        self.file.write("".join(f"{','.join(row)}\n" for row in rows).encode())

    def close(self) -> None:
        if self.is_stream:
            sys.stdout.flush()
        else:
            self.file.close()


#: Writers of formats other than CSV, by the suffixes of their files.
WRITERS: dict[str, Any] = {".parquet": ParquetWriter, ".h5": Hdf5Writer}


class Writer:
    """Appends blocks of rows to a table, in the format that the file's suffix says.

    file: the writer in that format; None as long as there are no rows.
    """

    def __init__(self, path: Path, about: Mapping[str, str]) -> None:
        self.path = path
        self.about = {key: escape_undecodable(value) for key, value in about.items()}
        self.file: Any = None

    def write(self, columns: Columns) -> None:
        if self.file is None:
            make = WRITERS.get(self.path.suffix.lower(), CsvWriter)
            self.file = make(self.path, self.about, columns)
        self.file.write(columns)

    def close(self) -> None:
        if self.file is not None:
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


def write_table(path: Path, columns: Columns, about: Mapping[str, str]) -> None:
    """Write a table at once.  about: its provenance."""
    with open_writer(path, about) as writer:
        writer.write(columns)
