"""Tables of any length: reading in chunks, writing completely or not at all.

A table begins with its provenance: comment lines `# key: value` in CSV, which this module reads and
writes; metadata or attributes in the formats of `FORMATS`. CSV may be compressed (.csv.gz), and the
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
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import replace
from io import BytesIO, StringIO, TextIOWrapper
from itertools import groupby, islice, tee
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.errors import InputError
from ..core.names import READING_COLUMNS, escape_undecodable
from ..core.plain_numbers import plain_number
from ..core.units import Floats, describe_bounds, find_implausible
from . import frame_table, hdf5_table, parquet_table, tdms_table
from .columns import (
    CONFIGURATION,
    TIME_HINT,
    Chunk as Chunk,
    Columns,
    MissingColumnsError as MissingColumnsError,
    columns_to_read,
    unit_of_column as unit_of_column,
)
from .frame_table import FrameTable, make_frame
from .hdf5_table import Hdf5Writer
from .parquet_table import ParquetWriter
from .whole import (
    STANDARD_STREAM,
    ResultSet as ResultSet,
    Whole as Whole,
    refuse_to_overwrite as refuse_to_overwrite,
)

if TYPE_CHECKING:
    from pandas import DataFrame

#: A table in a file, or in memory.
Source = Path | FrameTable
#: Endings of tables that can be written, and of tables that can be read.
ENDINGS = (".csv", ".csv.gz", ".parquet", ".h5")
READABLE = (*ENDINGS, ".tdms")
#: Formats other than CSV, by the suffixes of their files.
FORMATS: dict[str, Any] = {".parquet": parquet_table, ".h5": hdf5_table, ".tdms": tdms_table}
#: Default number of rows in a chunk.
CHUNK = 50_000


def ending(path: Path, allowed: Sequence[str] = ENDINGS) -> str:
    """The suffix of a table's file; raises `InputError` if the name has no allowed ending."""
    if path == STANDARD_STREAM:
        return ".csv"
    if not path.name.lower().endswith(tuple(allowed)):
        *others, last = allowed
        raise InputError(f"{path}: a table's name ends in {', '.join(others)} or {last}")
    return path.suffix.lower()


def format_of(source: Source) -> Any:
    """The module that reads a table's format; None for CSV.

    Raises `InputError` if the file is no table, see `require_table`.
    """
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
    """Replace implausible values of a chunk by NaN, see `read_chunks`.

    Readings remain, because a dark detector's are of any size, and the solver gives them a status.
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
    """Raise `InputError` if a file is missing, empty, or not of the format of its name."""
    if path == STANDARD_STREAM:
        return
    if path.is_dir():
        raise InputError(f"{path}: is a folder, not a table")
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    with open_bytes(path) as file:
        begin = file.read(4)
    expected = FORMATS.get(ending(path, READABLE))
    if not begin:
        raise InputError(f"{path}: is empty")
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
    """Open a file, decompressed if its suffix is .gz, or the standard input, for reading bytes.

    Raises `InputError` if it cannot be read.
    """
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


#: Numbers of bytes read, and of rows written, at a time: their texts fit into a processor's cache.
BLOCK_BYTES, BLOCK_ROWS = 100_000, 1000


#: The number of a line, from 1, and the text of complete lines from there on.
Block = tuple[int, bytes]


class Sheet:
    """An open CSV table, whose header has been read.

    first: line number of the header.  head: provenance.  names: of the columns.  Raises
    `InputError` for an empty file or a malformed header.
    """

    def __init__(self, path: Path, raw: Any) -> None:
        self.path, self.raw = path, raw
        # Old systems end lines with CR alone.
        is_old = re.search(rb"\r[^\n]", raw.peek(1))
        self.file = file = BytesIO(line_feeds(raw.read())) if is_old else raw
        header, self.first, self.head, declared = "", 0, {}, ""
        for self.first, line in enumerate(file, start=1):
            header = line.decode("utf-8-sig", "replace")
            if declaration := re.fullmatch(r'(?i)"?sep= ?(.)"?\s*', header):  # Excel's
                declared = declaration[1]
            elif header.strip() and not header.startswith("#"):
                break
            key, mark, value = header[1:].partition(":")
            if mark:
                self.head[key.strip()] = value.strip()
        else:
            raise InputError(f"{path}: is empty: it has no header and no rows")
        self.delimiter = declared or delimiter_of(header)
        names = self.header_cells(header)
        self.names = [name.strip() for name in names]
        while len(self.names) > 1 and not self.names[-1]:  # Each line may end with a delimiter.
            self.names.pop()
        #: Number of further cells that a row may have if they are empty.
        self.spare = 1 + len(names) - len(self.names)

    def header_cells(self, header: str) -> list[str]:
        try:
            return next(csv.reader([header], delimiter=self.delimiter), [])
        except csv.Error as error:
            raise InputError(f"{self.path}:{self.first}: not a header: {error}") from None

    def blocks(self) -> Iterator[Block]:
        """Yield the lines after the header, which end with line feeds, in blocks."""
        line = self.first + 1
        while text := self.file.read(BLOCK_BYTES):
            text = line_feeds(text + self.file.readline())
            yield line, text
            line += text.count(b"\n")

    def rows(self, blocks: Iterable[Block]) -> Iterator[tuple[int, list[str]]]:
        """Yield the line number, from 1, and the cells of each row.

        Comments, empty lines, and empty cells beyond the header's are skipped. Raises `InputError`
        for a malformed line.
        """
        width = len(self.names)
        for first, text in blocks:
            lines = StringIO(text.decode(errors="replace"))
            # Without quoting, because a stray quote would swallow the lines that follow it.
            reader = csv.reader(lines, delimiter=self.delimiter, quoting=csv.QUOTE_NONE)
            try:
                for row in reader:
                    if row and not row[0].startswith("#"):
                        is_empty = len(row) > width and not "".join(row[width:]).strip()
                        yield first - 1 + reader.line_num, row[:width] if is_empty else row
            except csv.Error as error:
                line = first - 1 + reader.line_num
                raise InputError(f"{self.path}:{line}: not a line of a table: {error}") from None

    def plain_numbers(self, text: bytes, places: Sequence[int]) -> Floats | None:
        """Parse a block whose lines are all rows of plain numbers and words, fast.

        places: indices of the columns to parse.  Returns their numbers (n, columns); None for a
        block with other lines, or with a cell there that is no plain number.
        """
        mark, width = self.delimiter.encode(), len(self.names)
        # One column is excluded, because an empty line is no row; long cells are refused elsewhere.
        if width > 1 == self.spare and len(text) <= csv.field_size_limit() and text[-1:] == b"\n":
            marks = (mark * (width - 1) + b"\n") * text.count(b"\n")
            for characters, parse in ((NUMERIC, parse_numbers), (WORDY, parse_words)):
                if text.translate(None, characters.replace(mark, b"")) == marks:
                    with suppress(ValueError):
                        return parse(text, mark, width, places)
        return None

    def numbers(self, row: Sequence[str], places: Sequence[int]) -> list[float]:
        """Whether a row is malformed, followed by the numbers in its cells at `places`, or NaN."""
        with suppress(ValueError):
            if len(row) == len(self.names):
                return [False, *(number(row[place]) for place in places)]
        return [True, *(np.nan for _ in places)]

    def columns_to_read(self, needed: Sequence[str], optional: Sequence[str]) -> list[str]:
        """Names of the columns to read; errors state which line was taken for the header."""
        place = f"{self.path}: header in line {self.first}"
        return columns_to_read(place, self.names, needed, optional)

    def refuse_width(self, line: int, row: Sequence[str]) -> InputError:
        """Make the error for a row whose number of cells differs from the header's."""
        return InputError(
            f"{self.path}:{line}: this row has {len(row)} cells, and the header in line "
            f"{self.first} has {len(self.names)}; give each row as many"
        )

    def bytes_read(self) -> int:
        return os.lseek(self.raw.fileno(), 0, os.SEEK_CUR) if self.raw.seekable() else 0


def line_feeds(text: bytes) -> bytes:
    """Convert the ends of lines to line feeds."""
    return text.replace(b"\r\n", b"\n").replace(b"\r", b"\n") if b"\r" in text else text


#: Bytes that numbers consist of, and bytes that rows without comments consist of.
NUMERIC = b"0123456789+-.eE "
WORDY = bytes(range(32, 127)).replace(b"#", b"")


def parse_numbers(text: bytes, mark: bytes, width: int, places: Sequence[int]) -> Floats:
    """Parse lines of `width` numbers in the syntax of JSON; returns (n, columns) at `places`.

    Raises `ValueError` for other lines.
    """
    import orjson

    flat = text[:-1].replace(b"\n", b",").replace(mark, b",")
    table = np.array(orjson.loads(b"[%b]" % flat), dtype=float).reshape(-1, width)
    if not table.all() and re.search(rb"-0\s*(,|$)", flat):
        raise ValueError("-0 is an integer of JSON, which has no sign")
    return table[:, places]


def parse_words(text: bytes, mark: bytes, width: int, places: Sequence[int]) -> Floats:
    """Parse lines of `width` numbers and words; returns (n, columns) at `places`, NaN for empty
    cells.

    Raises `ValueError` for words at `places`, and for an empty first cell.
    """
    mark_before_gap = rb"%b(?=%b|\n)" % (2 * (re.escape(mark),))
    filled = re.sub(mark_before_gap, lambda match: match[0] + b"nan", text)
    lines = filled.decode().splitlines()
    return np.loadtxt(lines, delimiter=mark.decode(), comments=None, usecols=places, ndmin=2)


def read_head(path: Path) -> dict[str, str]:
    """Read the head of a table, written by `provenance.provenance_header`; empty if it has none."""
    other = format_of(path)
    if other:
        head: dict[str, str] = other.read_head(path)
        return head
    with open_sheet(path) as sheet:
        return sheet.head


def column_names(path: Path) -> list[str]:
    """The names of a table's columns; none for a file without the ending of a table."""
    if not path.name.lower().endswith(READABLE):
        return []
    other = format_of(path)
    if other:
        return list(other.column_names(path))
    with open_sheet(path) as sheet:
        return sheet.names


def delimiter_of(header: str) -> str:
    """The delimiter of a line: a comma or, if it contains none, a semicolon or a tab."""
    return next((mark for mark in ",;\t" if mark in header), ",")


@contextmanager
def open_sheet(path: Path) -> Iterator[Sheet]:
    with open_bytes(path) as raw:
        yield Sheet(path, raw)


def read_numbers(path: Path, names: Sequence[str] = ()) -> tuple[list[str], Floats]:
    """Read a small CSV table of numbers: the names of its columns and its rows (n, columns).

    names: of the columns to read; all if empty. Raises `InputError` with the line of a cell that is
    not a number.
    """
    with open_sheet(path) as sheet:
        use = sheet.columns_to_read(names or sheet.names, ())
        places, rows = [sheet.names.index(name) for name in use], []
        for line, row in sheet.rows(sheet.blocks()):
            if len(row) != len(sheet.names):
                raise sheet.refuse_width(line, row)
            is_bad, *numbers = sheet.numbers(row, places)
            if is_bad:
                raise InputError(f"{path}:{line}: this row cannot be read as numbers")
            rows.append(numbers)
    return use, np.array(rows, dtype=float).reshape(len(rows), len(use))


def read_words(source: Source, name: str) -> list[str] | None:
    """Read a column of words of a table, with a word for each row; None without such a column."""
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
        return [
            unquote(row[place]) if place < len(row) else "" for _, row in sheet.rows(sheet.blocks())
        ]


def read_csv(
    path: Path, needed: Sequence[str], optional: Sequence[str], rows: int
) -> Iterator[Chunk]:
    with open_sheet(path) as sheet:
        use = sheet.columns_to_read(needed, optional)
        blocks, same_blocks = tee(sheet.blocks())
        refuse_words(sheet, use, list(islice(sheet.rows(same_blocks), CHECKED_ROWS)))
        del same_blocks  # It would hold all blocks in memory.
        pieces = (read_rows(sheet, use, block) for block in blocks)
        for part in equal_pieces(pieces, rows):
            lines, bad, *columns = part.T
            named = dict(zip(use, columns, strict=True))
            yield Chunk(named, lines.astype(np.int64), bad.astype(bool), sheet.bytes_read())


def read_rows(sheet: Sheet, names: Sequence[str], block: Block) -> Floats:
    """The rows of a block (n, 2 + columns): line number, whether it is malformed, and numbers."""
    places = [sheet.names.index(name) for name in names]
    first, text = block
    values = sheet.plain_numbers(text, places)
    if values is None:
        rows = [[line, *sheet.numbers(row, places)] for line, row in sheet.rows([block])]
        return np.array(rows, dtype=float).reshape(-1, 2 + len(places))
    lines = first + np.arange(len(values))
    return np.column_stack([lines, np.zeros(len(lines)), values])


def equal_pieces(pieces: Iterable[Floats], rows: int) -> Iterator[Floats]:
    """Yield the rows of arrays (n, m) in arrays of `rows` rows; the last may be shorter."""
    waiting, count = list[Floats](), 0
    for piece in pieces:
        waiting.append(piece)
        count += len(piece)
        if count >= rows:
            joined = np.concatenate(waiting)
            end = count - count % rows
            yield from (joined[start : start + rows] for start in range(0, end, rows))
            waiting, count = [joined[end:]], count % rows
    if count:
        yield np.concatenate(waiting)


#: A column without a number in this many rows is assumed to be a column of words.
CHECKED_ROWS = 1000


def refuse_words(sheet: Sheet, names: Sequence[str], rows: Sequence[tuple[int, list[str]]]) -> None:
    """Raise `InputError` if a column has no number in the checked rows, or if none of these rows
    has as many cells as the header.  rows: line numbers with cells."""
    full = [(line, row) for line, row in rows if len(row) == len(sheet.names)]
    if rows and not full:
        raise sheet.refuse_width(*rows[0])
    for name in names:
        place = sheet.names.index(name)
        if len(full) > 1 and not any(is_number(row[place]) for _, row in full):
            line, word = full[0][0], full[0][1][place].strip()
            hint = "; write decimals after a point" if is_number(word.replace(",", ".")) else ""
            raise InputError(
                f"{sheet.path}:{line}: column {name} holds {word[:40]!r}, not a number{hint}"
                f"{TIME_HINT if name == 'time_s' else ''}"
            )


def number(cell: str) -> float:
    """Convert a cell to a number, an empty cell to NaN; quotes around it are ignored.

    Raises `ValueError` for other text.
    """
    return plain_number(unquote(cell) or "nan")


def unquote(cell: str) -> str:
    """Remove blanks and quotes around a cell."""
    text = cell.strip()
    return text[1:-1] if len(text) > 1 and text[0] == text[-1] == '"' else text


def is_number(cell: str) -> bool:
    try:
        number(cell)
    except ValueError:
        return False
    return True


def read_columns(path: Path) -> Columns:
    """Read all columns of a table, numbers and words, without a check of plausibility.

    Raises `InputError` if the file cannot be read as a table.
    """
    other = format_of(path)
    if other:
        columns: Columns = other.read_columns(path, other.column_names(path))
        return columns
    import pandas as pd

    # Before pandas 3.1, the last digit of a number may by default differ from the text.
    is_exact = tuple(map(int, pd.__version__.split(".")[:2])) >= (3, 1)
    exact: Any = {} if is_exact else {"float_precision": "round_trip"}
    with (
        open_sheet(path) as sheet,
        TextIOWrapper(sheet.file, "utf-8", "replace", newline="") as text,
        warnings.catch_warnings(),
    ):
        sheet.columns_to_read((), ())
        spare = list(range(sheet.spare))
        # Otherwise pandas drops surplus cells of the first row.
        warnings.simplefilter("error", pd.errors.ParserWarning)
        try:
            frame = pd.read_csv(
                text, names=[*sheet.names, *spare], sep=sheet.delimiter, comment="#",
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
    """Raise `InputError` for the first row with more cells than the header, if there is one."""
    with open_sheet(path) as sheet:
        for line, row in sheet.rows(sheet.blocks()):
            if len(row) > len(sheet.names):
                raise sheet.refuse_width(line, row)


def numbers_or_words(column: Any) -> Any:
    """Convert a pandas column to numbers, NaN for other cells; to words if most cells are words.

    Quotes around cells are removed, as in `number`.
    """
    import pandas as pd

    if pd.api.types.is_numeric_dtype(column):
        return column.to_numpy()
    is_text = column.map(lambda cell: isinstance(cell, str))  # Long tables have mixed types.
    column = column.mask(is_text, column[is_text].map(unquote)).replace("", np.nan)
    numbers = pd.to_numeric(column, errors="coerce")
    is_number = 2 * numbers.notna().sum() > column.notna().sum()
    return (numbers if is_number else column.fillna("")).to_numpy()


def read_frame(path: Path) -> DataFrame:
    """Read a table as a data frame, with its units and its head in `attrs`."""
    return make_frame(read_columns(path), read_head(path))


def cells_of(values: Any) -> Any:
    """A column's values (n,) unchanged if JSON writes them in the same way as CSV, else their
    texts, with all digits of floats.

    Raises `ValueError` for a cell with a comma, a quote or a line break.
    """
    array = np.ascontiguousarray(values)
    if array.dtype.kind in "biuf" and not np.isinf(array).any():
        return array
    texts = ["" if value is None else str(value) for value in array.tolist()]
    if array.dtype.kind in "OU" and {*',"\r\n'} & {*"".join({*texts})}:
        raise ValueError("a cell holds a comma, a quote or a line break")
    return texts


def joined_cells(columns: Iterable[Any]) -> Iterator[Any]:
    """Yield the cells of columns (n,); m neighbours of one numeric type as one array (n, m)."""

    def kind_of(cells: Any) -> str:
        return "" if isinstance(cells, list) else cells.dtype.str

    for kind, run in groupby(map(cells_of, columns), kind_of):
        if kind:
            yield np.column_stack(list(run))
        else:
            yield from run


def texts_of(cells: Any) -> list[str]:
    """The text of each row of cells, joined by commas."""
    import orjson

    if isinstance(cells, list):
        return cells
    text = orjson.dumps(cells, option=orjson.OPT_SERIALIZE_NUMPY).decode()
    if np.isnan(cells).any():
        text = text.replace("null", "nan")
    return [row[2:] for row in f",{text[1:-2]}".split("]")]  # [[1.0,2.0],[3.0,4.0]]


def head_lines(about: Mapping[str, str]) -> list[str]:
    """Provenance as comment lines, without the complete configuration."""
    entries = {key: " ".join(text.split()) for key, text in about.items() if key != CONFIGURATION}
    return [f"# {key}: {text}" for key, text in entries.items()]


class CsvWriter:
    """Writer that appends blocks of rows to a CSV table; the first block sets its columns."""

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
        cells = list(joined_cells(columns.values()))
        (count,) = {len(values) for values in cells} or {0}
        for start in range(0, count, BLOCK_ROWS):
            texts = (texts_of(values[start : start + BLOCK_ROWS]) for values in cells)
            lines = map(",".join, zip(*texts, strict=True))
            self.file.write("\n".join([*lines, ""]).encode())

    def close(self) -> None:
        if self.is_stream:
            sys.stdout.flush()
        else:
            self.file.close()


#: Writers of formats other than CSV, by the suffixes of their files.
WRITERS: dict[str, Any] = {".parquet": ParquetWriter, ".h5": Hdf5Writer}


class Writer:
    """Writer that appends blocks of rows to a table, in the format of the file's suffix.

    file: writer of that format; None until the first block.
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
    """Open a table for writing; it appears under its name once it is complete.

    about: its provenance. Raises `InputError` for a name without the ending of a table.
    """
    ending(path)
    with nullcontext(path) if path == STANDARD_STREAM else Whole(path) as temporary:
        writer = Writer(temporary, about)
        try:
            yield writer
        finally:
            writer.close()


def write_table(path: Path, columns: Columns, about: Mapping[str, str]) -> None:
    """Write a table of columns.  about: its provenance."""
    with open_writer(path, about) as writer:
        writer.write(columns)
