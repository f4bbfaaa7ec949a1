"""Tables in Parquet, with the provenance in the file's metadata and units in the columns'."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from ..core.errors import InputError
from ..core.extras import require_extra
from .columns import Chunk, Columns, columns_to_read, refuse_text, units_of

#: The first bytes of a file, and its last.
SIGNATURE = b"PAR1"
KIND = "a Parquet table"


def require_arrow(path: Path) -> tuple[Any, Any]:
    """Import pyarrow and its module for Parquet. Raises `InputError` without the extra."""
    return require_extra("pyarrow", str(path)), require_extra("pyarrow.parquet", str(path))


@contextmanager
def open_arrow(path: Path) -> Iterator[tuple[Any, Any, BinaryIO]]:
    """Context with pyarrow, its module for Parquet, and the open file, because pyarrow cannot open
    names that are not UTF-8. Raises `InputError` for a damaged file."""
    pa, pq = require_arrow(path)
    try:
        with path.open("rb") as raw:
            yield pa, pq, raw
    except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
        reason = str(error).partition("\n")[0]
        raise InputError(
            f"{path}: cannot be read as a Parquet table of numbers and words: {reason}; copy or "
            "write it again"
        ) from None


def read_chunks(
    path: Path, needed: Sequence[str], optional: Sequence[str], rows: int
) -> Iterator[Chunk]:
    with open_arrow(path) as (pa, pq, raw):
        file = pq.ParquetFile(raw)
        use = columns_to_read(path, file.schema_arrow.names, needed, optional)
        require_numbers(path, file.schema_arrow, use)
        count = 0
        for batch in file.iter_batches(rows, columns=use):
            columns = {
                name: column.cast(pa.float64()).to_numpy(zero_copy_only=False)
                for name, column in zip(batch.schema.names, batch.columns, strict=True)
            }
            size = path.stat().st_size * (count + len(batch)) // file.metadata.num_rows
            lines = np.arange(count, count + len(batch)) + 1
            count += len(batch)
            yield Chunk(columns, lines, np.zeros(len(batch), dtype=bool), size)


def require_numbers(path: Path, schema: Any, names: Sequence[str]) -> None:
    """Raise `InputError` for columns of a Parquet table that are not of a numeric type."""
    from pyarrow import types

    kinds = (types.is_integer, types.is_floating, types.is_decimal, types.is_null)
    for name in names:
        kind = schema.field(name).type
        if not any(is_kind(kind) for is_kind in kinds):
            raise refuse_text(path, name, kind)


def read_head(path: Path) -> dict[str, str]:
    metadata: dict[bytes, bytes] = {}
    with suppress(InputError), open_arrow(path) as (_, pq, raw):
        metadata = pq.read_schema(raw).metadata or {}
    texts = {key: value.decode(errors="replace") for key, value in metadata.items()}
    return {key.decode(errors="replace"): text for key, text in texts.items()}


def column_names(path: Path) -> list[str]:
    with open_arrow(path) as (_, pq, raw):
        return [str(name) for name in pq.read_schema(raw).names]


def read_columns(path: Path, names: Sequence[str]) -> dict[str, Any]:
    with open_arrow(path) as (_, pq, raw):
        table = pq.ParquetFile(raw).read(list(names))
        return {name: table[name].to_numpy() for name in names}


def record_batch(columns: Columns) -> Any:
    """Convert columns to an Arrow record batch."""
    import pyarrow as pa

    arrays = [arrow_column(values) for values in columns.values()]
    return pa.RecordBatch.from_arrays(arrays, names=list(columns))


def arrow_column(values: Any) -> Any:
    """Convert values (n,) to an Arrow column: numbers without a copy, words from distinct ones.

    `pyarrow.array` would first import pandas, to check whether the values are a pandas series. This
    takes longer than solving a small table.
    """
    import pyarrow as pa

    array = np.ascontiguousarray(values)
    if (
        array.ndim > 1
        or not array.size
        or array.dtype.kind not in "iufU"
        or not array.dtype.isnative
    ):
        return pa.array(values)
    if array.dtype.kind != "U":
        return fixed_size_column(pa.from_numpy_dtype(array.dtype), array)
    coded = fixed_size_column(pa.binary(array.itemsize), array).dictionary_encode()
    words = np.frombuffer(coded.dictionary.buffers()[1], array.dtype)
    texts = [word.encode() for word in words.tolist()]
    ends = np.cumsum([0, *map(len, texts)], dtype=np.int32)
    parts = [None, pa.py_buffer(ends), pa.py_buffer(b"".join(texts))]
    return pa.Array.from_buffers(pa.string(), len(texts), parts).take(coded.indices)


def fixed_size_column(kind: Any, array: Any) -> Any:
    """Wrap the memory of an array (n,) in an Arrow column.  kind: a type of the same size."""
    import pyarrow as pa

    return pa.Array.from_buffers(kind, len(array), [None, pa.py_buffer(array)])


def add_units(schema: Any, about: Mapping[str, str]) -> Any:
    """Add the provenance `about`, and each field's unit (key `unit`), to an Arrow schema."""
    import pyarrow as pa

    units = units_of(schema.names, about)
    fields = [
        field.with_metadata({"unit": units[field.name]}) if field.name in units else field
        for field in schema
    ]
    return pa.schema(fields, metadata=dict(about))


class ParquetWriter:
    """Writer that appends blocks of rows to a Parquet table; the first block sets its columns."""

    def __init__(self, path: Path, about: Mapping[str, str], columns: Columns) -> None:
        pa, pq = require_arrow(path)
        schema = add_units(record_batch(columns).schema, about)
        self.raw = path.open("wb")
        floats = [field.name for field in schema if pa.types.is_float64(field.type)]
        self.file = pq.ParquetWriter(
            self.raw,
            schema,
            use_dictionary=[name for name in schema.names if name not in floats],
            use_byte_stream_split=floats,
        )

    def write(self, columns: Columns) -> None:
        self.file.write_batch(record_batch(columns))

    def close(self) -> None:
        with self.raw:
            self.file.close()
