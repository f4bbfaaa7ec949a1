"""Tables in CSV and Parquet, of any length: read in chunks, written whole or not at all.

A table begins with how it was made: comment lines `# key: value` in CSV, metadata in Parquet.
"""

from __future__ import annotations

import csv
import difflib
import os
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError, OutputError

Columns = Mapping[str, Any]
ENDINGS = (".csv", ".parquet")
CHUNK = 50_000


@dataclass(frozen=True)
class Chunk:
    """Some rows of a table.

    columns: by name, float, NaN where a cell is empty or says so.  lines: in the file, from 1; row
    numbers in Parquet.  unparsable: rows that are not numbers; their columns are NaN.
    bytes_read: of the file, so far.
    """

    columns: dict[str, NDArray[np.float64]]
    lines: NDArray[np.int64]
    unparsable: NDArray[np.bool_]
    bytes_read: int


def ending(path: Path) -> str:
    if path.suffix.lower() not in ENDINGS:
        raise InputError(f"{path}: a table's name ends in {' or '.join(ENDINGS)}")
    return path.suffix.lower()


def read_chunks(
    path: Path, needed: Sequence[str] = (), optional: Sequence[str] = (), rows: int = CHUNK
) -> Iterator[Chunk]:
    """The named columns of a table, `rows` at a time; the others are passed over.

    A column that is needed and missing, or a file that cannot be read, raises `InputError`.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    read = read_csv if ending(path) == ".csv" else read_parquet
    return read(path, needed, optional, rows)


def wanted(
    path: Path, names: Sequence[str], needed: Sequence[str], optional: Sequence[str]
) -> list[str]:
    missing = [name for name in needed if name not in names]
    if missing:
        near = [difflib.get_close_matches(name, names, 1, 0.7) for name in missing]
        hints = [f"{name} (found: {close[0]})" if close else name
                 for name, close in zip(missing, near, strict=True)]  # fmt: skip
        raise InputError(f"{path}: missing columns: {', '.join(hints)}")
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(f"{path}: columns that appear twice: {', '.join(twice)}")
    return [*needed, *(name for name in optional if name in names and name not in needed)]


def read_csv(
    path: Path, needed: Sequence[str], optional: Sequence[str], rows: int
) -> Iterator[Chunk]:
    with (
        path.open("rb") as raw,
        open(
            raw.fileno(), encoding="utf-8-sig", errors="replace", newline="", closefd=False
        ) as file,
    ):
        header = ""
        first = 0
        for first, header in enumerate(file, start=1):  # noqa: B007
            if header.strip() and not header.startswith("#"):
                break
        delimiter = ";" if ";" in header and "," not in header else ","
        names = [name.strip() for name in next(csv.reader([header], delimiter=delimiter), [])]
        use = wanted(path, names, needed, optional)
        # numbers need no quotes, and a stray one must not swallow the lines that follow it
        lines = csv.reader(file, delimiter=delimiter, quoting=csv.QUOTE_NONE)
        places = [names.index(name) for name in use]
        numbered = (
            (first + lines.line_num, row) for row in lines if row and not row[0].startswith("#")
        )
        while block := list(islice(numbered, rows)):
            values, bad = numbers([row for _, row in block], places, len(names))
            yield Chunk(
                columns=dict(zip(use, values.T, strict=True)),
                lines=np.array([line for line, _ in block]),
                unparsable=bad,
                bytes_read=os.lseek(raw.fileno(), 0, os.SEEK_CUR),
            )


def numbers(
    rows: list[list[str]], places: list[int], width: int
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Cells as floats (n, columns), and which rows are not numbers; an empty cell is NaN."""
    bad = np.array([len(row) != width for row in rows])
    cells = [[row[i] or "nan" for i in places] for row in rows] if not bad.any() else None
    if cells is not None:
        with suppress(ValueError):
            return np.array(cells, dtype=float).reshape(len(rows), len(places)), bad
    values = np.full((len(rows), len(places)), np.nan)
    for n, row in enumerate(rows):
        if bad[n]:
            continue
        try:
            values[n] = [float(row[i] or "nan") for i in places]
        except ValueError:
            values[n], bad[n] = np.nan, True
    return values, bad


def read_parquet(
    path: Path, needed: Sequence[str], optional: Sequence[str], rows: int
) -> Iterator[Chunk]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        file = pq.ParquetFile(path)
        use = wanted(path, file.schema_arrow.names, needed, optional)
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
    except pa.ArrowInvalid as error:
        raise InputError(f"{path}: not a Parquet table of numbers: {error}") from None


def refuse_to_overwrite(paths: Sequence[Path], force: bool) -> None:
    """Raises `OutputError` where one of the paths exists and is not to be replaced."""
    existing = [str(path) for path in paths if path.exists()]
    if existing and not force:
        raise OutputError(f"{', '.join(existing)}: exists already; --force replaces it")


class Whole:
    """A file that appears under its name when all is written, and not at all if that fails.

    `with Whole(path) as temporary:` write to `temporary`, a path in the same folder.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def __enter__(self) -> Path:
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            handle, name = tempfile.mkstemp(
                dir=self.path.parent, prefix=f".{self.path.stem}-", suffix=self.path.suffix
            )
        except OSError as error:
            raise OutputError(f"{self.path}: can not be written: {error.strerror}") from None
        os.close(handle)
        umask = os.umask(0)
        os.umask(umask)
        self.temporary = Path(name)
        self.temporary.chmod(0o666 & ~umask)
        return self.temporary

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        if kind is None:
            self.temporary.replace(self.path)
            return
        self.temporary.unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise OutputError(f"{self.path}: can not be written: {error.strerror}") from None


class Writer:
    """Appends blocks of rows to a table; by its ending CSV or Parquet. See `written`."""

    def __init__(self, path: Path, about: Mapping[str, str]) -> None:
        self.path = path
        self.about = about
        self.file: Any = None
        self.sink: Any = None

    def write(self, columns: Columns) -> None:
        import pyarrow as pa

        batch = pa.RecordBatch.from_pydict(dict(columns))
        if self.file is None:
            self.open(batch.schema)
        self.file.write_batch(batch)

    def open(self, schema: Any) -> None:
        if self.path.suffix.lower() == ".parquet":
            import pyarrow.parquet as pq

            self.file = pq.ParquetWriter(self.path, schema.with_metadata(dict(self.about)))
            return
        import pyarrow.csv as pc

        self.sink = self.path.open("wb")
        lines = [f"# {key}: {' '.join(value.split())}" for key, value in self.about.items()]
        text = "\n".join([*lines, ",".join(schema.names)]) + "\n"
        self.sink.write(text.encode())
        options = pc.WriteOptions(include_header=False, quoting_style="none")
        self.file = pc.CSVWriter(self.sink, schema, write_options=options)

    def close(self) -> None:
        for part in (self.file, self.sink):
            if part is not None:
                part.close()


def write_table(path: Path, columns: Columns, about: Mapping[str, str]) -> None:
    """A whole table at once. about: how it was made."""
    ending(path)
    with Whole(path) as temporary:
        writer = Writer(temporary, about)
        try:
            writer.write(columns)
        finally:
            writer.close()
