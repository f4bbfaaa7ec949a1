"""Poses as columns, and the Arrow stream of them in a recording."""

from __future__ import annotations

import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..run.pipeline import RunPoses

Columns = dict[str, NDArray[Any]]
#: The stream's end, as Arrow has it.
END = b"\xff\xff\xff\xff\0\0\0\0"
#: The column that proves a batch: the CRC-32 of all others, the same in each of its rows.
CRC = "crc"
#: Columns of poses that a recording leaves out; its replay has them.
REPLAYED = ("used", "power_mw", "misfit")


def recorded_columns(poses: RunPoses) -> Columns:
    """Return the columns of poses that a recording keeps, and that publications send."""
    return {name: column for name, column in poses.columns().items() if name not in REPLAYED}


def join_columns(parts: list[Columns]) -> Columns:
    """Join tables of the same columns, one after the other."""
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def make_batch(columns: Columns) -> Any:
    """Make an Arrow batch of columns, with their CRC in each row."""
    import pyarrow as pa

    count = len(next(iter(columns.values())))
    proof = np.full(count, crc_of(columns), np.uint32)
    return pa.RecordBatch.from_pydict({**columns, CRC: proof})


def crc_of(columns: Columns) -> int:
    crc = 0
    for name, column in columns.items():
        crc = zlib.crc32(np.ascontiguousarray(column).tobytes(), zlib.crc32(name.encode(), crc))
    return crc


def schema_of(batch: Any) -> bytes:
    """Return the bytes with which a stream of batches like this one begins."""
    data: bytes = batch.schema.serialize().to_pybytes()
    return data


def recorded_poses(folder: Path) -> Columns:
    """Return the poses that a recording holds and that can be proven, in the samples' order.

    A batch that is not as it was written is left out; past a torn end nothing can be read. Status
    is the number of a `facets.Status`.
    """
    import pyarrow as pa

    parts: list[Columns] = []
    try:
        with pa.OSFile(str(folder / "poses.arrows")) as file:
            reader = pa.ipc.open_stream(file)
            while True:
                batch = reader.read_next_batch()
                batch.validate(full=True)
                part = {name: batch[name].to_numpy() for name in batch.schema.names}
                proof = part.pop(CRC, None)
                if proof is not None and len(proof) and (proof == crc_of(part)).all():
                    parts.append(part)
    except (StopIteration, pa.ArrowException, OSError, ValueError, MemoryError):
        pass
    if not parts:
        return {}
    poses = join_columns(parts)
    order = np.argsort(poses["seq"], kind="stable")
    return poses if (np.diff(order) == 1).all() else {n: c[order] for n, c in poses.items()}
