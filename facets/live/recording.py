"""A recording: a folder in which nothing that came is lost, whenever the program ends.

meta.yaml       first of all: how it was made, the whole configuration, when it began
bytes.bin       the received bytes, as they are
index.bin       a row (INDEX) for each block of them: where, when, and what the stage said then
poses.arrows    the poses as an Arrow stream, batch by batch
events.jsonl    a line for each thing that happened
"""

from __future__ import annotations

import json
import os
import shutil
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..config.loading import measured
from ..core.errors import FacetsError, InputError
from ..core.names import READING_COLUMNS, STATE_COLUMNS, STATE_UNITS
from ..tracking.encoder import Encoder
from .pipeline import Poses

if TYPE_CHECKING:
    pass

INDEX = np.dtype(
    [
        ("offset", "<u8"),
        ("length", "<u8"),
        ("monotonic", "<f8"),
        ("utc", "<f8"),
        ("stage", "<f8", 5),
    ]
)
NAMES = ("meta.yaml", "bytes.bin", "index.bin", "poses.arrows", "events.jsonl")
#: Poses are written so often, s: each batch costs a head of a kilobyte.
BATCH = 0.25


class DiskError(FacetsError):
    """The recording could not be written on; what was written is intact."""


class Block(NamedTuple):
    """A block as it came. arrival: monotonic, s."""

    data: bytes
    arrival: float
    encoder: Encoder | None


class Recording:
    """Writes one. Bytes go to the system at once, so that only a power failure can take them."""

    def __init__(self, folder: Path, meta: str, resolved: dict[str, Any]) -> None:
        """Begins with the whole configuration, and what files it names about the sensor."""
        self.folder = folder
        if folder.exists() and any(folder.iterdir()):
            raise InputError(f"{folder}: is not empty; a recording begins in a new folder")
        try:
            folder.mkdir(parents=True, exist_ok=True)
            (folder / "meta.yaml").write_text(meta, "utf-8")
            for keys, name, total in measured(resolved):
                shutil.copyfile(keys[name], folder / kept(total))
            flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND
            self.files = {
                name: os.open(folder / name, flags, 0o644) for name in NAMES if name != "meta.yaml"
            }
        except OSError as error:
            raise DiskError(f"{folder}: can not be written: {error.strerror}") from None
        import pyarrow as pa

        pa.RecordBatch.from_pydict({"": np.zeros(1)})  # loads what it needs before poses come

        self.offset = 0
        self.stream: Any = None
        self.waiting: list[Poses] = []
        self.written = time.monotonic()

    def put(self, name: str, data: bytes) -> None:
        try:
            view = memoryview(data)
            while view:
                view = view[os.write(self.files[name], view) :]
        except OSError as error:
            raise DiskError(
                f"{self.folder / name}: can not be written on: {error.strerror}; what was written "
                "is intact, see `facets recover`"
            ) from None

    def block(self, block: Block) -> None:
        """The bytes, then their row in the index: a row is never without its bytes."""
        self.put("bytes.bin", block.data)
        row = np.zeros(1, INDEX)
        row["offset"], row["length"] = self.offset, len(block.data)
        row["monotonic"], row["utc"] = block.arrival, time.time()
        row["stage"] = packed(block.encoder)
        self.put("index.bin", row.tobytes())
        self.offset += len(block.data)

    def event(self, name: str, **more: Any) -> None:
        row = {"monotonic": time.monotonic(), "utc": time.time(), "event": name, **more}
        self.put("events.jsonl", json.dumps(row).encode() + b"\n")

    def poses(self, batch: Poses) -> None:
        self.waiting.append(batch)
        if time.monotonic() - self.written > BATCH:
            self.flush()

    def flush(self) -> None:
        if not self.waiting:
            return
        import pyarrow as pa

        rows = pa.RecordBatch.from_pydict(joined([pose_columns(batch) for batch in self.waiting]))
        self.waiting = []
        self.written = time.monotonic()
        if self.stream is None:
            self.put("poses.arrows", schema_of(rows))
            self.stream = rows.schema
        self.put("poses.arrows", rows.serialize().to_pybytes())

    def close(self) -> None:
        self.flush()
        if self.stream is not None:
            self.put("poses.arrows", b"\xff\xff\xff\xff\0\0\0\0")  # the stream's end
        for handle in self.files.values():
            os.close(handle)


def schema_of(batch: Any) -> bytes:
    data: bytes = batch.schema.serialize().to_pybytes()
    return data


def packed(encoder: Encoder | None) -> list[float]:
    if encoder is None:
        return [np.nan] * 5
    return [encoder.time, *encoder.place, *encoder.speed]


def unpacked(row: NDArray[np.float64]) -> Encoder | None:
    return None if np.isnan(row[0]) else Encoder(float(row[0]), row[1:3].copy(), row[3:5].copy())


def pose_columns(poses: Poses) -> dict[str, Any]:
    """Poses as columns of a table, with the readings that they are from."""
    solution = poses.solution
    columns: dict[str, Any] = {
        "seq": poses.seq,
        "board_us": poses.time,
        "host_s": poses.host,
        "status": solution.status,
        "flags": poses.flags,
    }
    columns |= {name: poses.readings[:, i] for i, name in enumerate(READING_COLUMNS)}
    for i, name in enumerate(STATE_COLUMNS):
        columns[name] = solution.state[:, i] / STATE_UNITS[i]
    for i, name in enumerate(STATE_COLUMNS):
        columns[f"u_{name}"] = solution.uncertainty[:, i] / STATE_UNITS[i]
    columns["residual"] = solution.residual
    return columns


def joined(parts: list[dict[str, Any]]) -> dict[str, Any]:
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def blocks(folder: Path) -> Iterator[Block]:
    """The blocks of a recording, also of one that ended in the middle of a write.

    Bytes past the last row of the index come as a last block of their own.
    """
    rows = index_of(folder)
    try:
        file = (folder / "bytes.bin").open("rb")
    except OSError as error:
        raise InputError(f"{folder}: is no recording: {error.strerror}") from None
    with file:
        last = 0.0
        for row in rows:
            data = file.read(int(row["length"]))
            if data:
                last = float(row["monotonic"])
                yield Block(data, last, unpacked(row["stage"]))
        rest = file.read()
        if rest:
            yield Block(rest, last, None)


def index_of(folder: Path) -> NDArray[np.void]:
    """The rows that were written whole."""
    try:
        raw = (folder / "index.bin").read_bytes()
    except OSError as error:
        raise InputError(f"{folder}: is no recording: {error.strerror}") from None
    whole = len(raw) // INDEX.itemsize
    return np.frombuffer(raw[: whole * INDEX.itemsize], INDEX)


def recorded_poses(folder: Path) -> dict[str, NDArray[Any]]:
    """The poses as they were written, up to a torn end."""
    import pyarrow as pa

    parts = []
    try:
        with pa.OSFile(str(folder / "poses.arrows")) as file:
            reader = pa.ipc.open_stream(file)
            while True:
                batch = reader.read_next_batch()
                parts.append({name: batch[name].to_numpy() for name in batch.schema.names})
    except (StopIteration, pa.ArrowInvalid, OSError):
        pass
    return joined(parts) if parts else {}


def kept(total: str) -> str:
    """The name in a recording of a file with that SHA-256."""
    return f"measured-{total[:12]}.csv"


def meta_of(folder: Path) -> dict[str, Any]:
    from ruamel.yaml import YAML

    path = folder / "meta.yaml"
    if not path.is_file():
        raise InputError(f"{folder}: is no recording: it has no meta.yaml")
    found: dict[str, Any] = YAML(typ="safe").load(path)
    return found
