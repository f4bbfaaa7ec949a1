"""Poses as columns, and the Arrow stream of them in a recording."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...files.columns import join_columns
from ..run.pipeline import RunPoses

Columns = dict[str, NDArray[Any]]
#: The stream's end, as Arrow has it.
END = b"\xff\xff\xff\xff\0\0\0\0"
#: The column that proves a batch: the CRC-32 of all others, the same in each of its rows.
CRC = "crc"
#: Columns of poses that a recording does not store, because its replay computes them.
REPLAYED = ("used", "power_mw", "misfit")


def recorded_columns(poses: RunPoses) -> Columns:
    """Return the columns of poses that a recording keeps."""
    return {name: column for name, column in poses.columns().items() if name not in REPLAYED}


def stream_parts(columns: Columns) -> tuple[bytes, bytes]:
    """Return the head and the batch of an Arrow stream of columns, with their CRC in each row."""
    import nanoarrow as na
    from nanoarrow.ipc import StreamWriter

    count = len(next(iter(columns.values())))
    proven = {**columns, CRC: np.full(count, crc_of(columns), np.uint32)}
    arrays = [na.c_array(np.ascontiguousarray(column)) for column in proven.values()]
    fields = dict(zip(proven, (na.Schema(array.schema) for array in arrays), strict=True))
    schema = na.struct(fields, nullable=False)
    batch = na.c_array_from_buffers(schema, count, [None], null_count=0, children=arrays)
    stream = BytesIO()
    StreamWriter.from_writable(stream).write_stream(na.c_array_stream(batch))
    data = stream.getvalue()
    head = 8 + int.from_bytes(data[4:8], "little")  # a mark, the size of what follows, the schema
    return data[:head], data[head:]


def crc_of(columns: Columns) -> int:
    """The CRC-32 of the names and bytes of all columns."""
    crc = 0
    for name, column in columns.items():
        crc = zlib.crc32(np.ascontiguousarray(column).tobytes(), zlib.crc32(name.encode(), crc))
    return crc


def recorded_parts(folder: Path) -> Iterator[Columns]:
    """Yield the recorded poses whose checksum is right, in the order in which they were written.

    A corrupted batch is excluded; nothing can be read after a torn end. The status is the number of
    a `facets.Status`.
    """
    import nanoarrow as na
    from nanoarrow.ipc import InputStream

    with (
        suppress(OSError, RuntimeError, ValueError, MemoryError),
        InputStream.from_path(str(folder / "poses.arrows")) as stream,
        na.c_array_stream(stream) as batches,
    ):
        for batch in batches:
            arrays = {child.schema.name: na.Array(child) for child in batch.children}
            part = {name: np.asarray(array.to_pysequence()) for name, array in arrays.items()}
            proof = part.pop(CRC, None)
            if proof is not None and len(proof) and (proof == crc_of(part)).all():
                yield part


def recorded_poses(folder: Path) -> Columns:
    """Return all of `recorded_parts`, in the samples' order."""
    parts = list(recorded_parts(folder))
    if not parts:
        return {}
    poses = join_columns(parts)
    order = np.argsort(poses["seq"], kind="stable")
    return poses if (np.diff(order) == 1).all() else {n: c[order] for n, c in poses.items()}
