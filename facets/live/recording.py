"""A recording: a folder in which nothing that came is lost, whenever the program or the power ends.

meta.yaml       first of all: how it was made, the whole configuration, when it began
bytes.bin       the received bytes, as they are
index.bin       a row (`index.INDEX`) for each block of them: where, when, what the stage said
                then, and the sums that prove both
poses.arrows    the poses as an Arrow stream, batch by batch; where the loop fell behind, the newest
                first
events.jsonl    a line for each thing that happened; the last says how much the others hold
"""

from __future__ import annotations

import json
import threading
import time
import zlib
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass, fields
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, Self

import numpy as np

from ..config.loading import measured
from ..core.errors import FacetsError, InputError
from ..tracking.encoder import Encoder
from . import pose_table
from .disk import Disk
from .index import Block, Damage, make_row, proves, read_rows, unpack_encoder
from .pipeline import Poses, join_poses
from .pose_table import join_columns, pose_columns, recorded_poses

__all__ = [
    "Block",
    "Damage",
    "DiskError",
    "Recording",
    "blocks",
    "join_columns",
    "kept",
    "meta_of",
    "pose_columns",
    "recorded_poses",
]

#: In the order in which they are synced: no row reaches the disk long before its bytes.
NAMES = ("bytes.bin", "index.bin", "poses.arrows", "events.jsonl")
#: Poses are written so often, s: each batch is a short pause of the loop, and has a head of 1.6 kB.
FLUSH = 0.1
#: After a disk refused, it is tried again so often, s.
AGAIN = 1.0


#: The event that a recording ends with, unless the run was killed or the power failed.
CLOSED = "closed"


class DiskError(FacetsError):
    """A recording that can not be begun."""


class Recording:
    """Writes one, and says what it could not write.

    Bytes go to the system at once, so that the end of the program takes none of them; a thread of
    its own has the system put them on the disk every `sync` seconds, so that a power failure takes
    no more than that. Where the disk refuses, `trouble` says why and `lost` counts the bytes that
    came and are not recorded; what was written stays readable, and writing goes on as soon as it
    can. After the beginning no method raises.
    """

    def __init__(
        self,
        folder: Path,
        meta: str,
        resolved: dict[str, Any],
        sync: float = 0.0,
        disk: Disk | None = None,
    ) -> None:
        """Begins with the whole configuration, and what files it names about the sensor.

        sync: s, 0 for never. Raises `InputError` for a folder that is not new, `DiskError` where it
        can not be written.
        """
        self.folder, self.disk = folder, disk or Disk()
        self.lost = 0
        self.trouble = ""
        self.refused = False
        self.locks = {name: threading.Lock() for name in NAMES}
        self.sizes = dict.fromkeys(NAMES, 0)
        self.meta_crc = zlib.crc32(meta.encode())
        self.rows = self.poses_written = self.poses_refused = 0
        self.retry = 0.0
        try:
            if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
                what = "is not empty" if folder.is_dir() else "is a file"
                raise InputError(f"{folder}: {what}; a recording begins in a new folder")
            self.begin(meta, resolved)
        except OSError as error:
            raise DiskError(f"{folder}: can not be written: {error.strerror}") from None
        import pyarrow as pa

        pa.RecordBatch.from_pydict({"": np.zeros(1)})  # loads what it needs before poses come
        self.has_schema = self.closed = False
        self.waiting: list[Poses] = []
        self.written = time.monotonic()
        self.syncer = Syncer(self, sync) if sync > 0 else None
        if self.syncer:
            self.syncer.start()

    def begin(self, meta: str, resolved: dict[str, Any]) -> None:
        """The files that are there before the first byte comes, whatever happens then."""
        self.above = [one for one in self.folder.parents if not one.exists()]
        self.disk.make_folder(self.folder)
        self.save("meta.yaml", meta.encode())
        for keys, name, total in measured(resolved):
            self.save(kept(total), Path(keys[name]).read_bytes())
        self.files = {name: self.disk.create(self.folder / name) for name in NAMES}
        self.disk.sync_folder(self.folder)
        self.disk.sync_folder(self.folder.absolute().parent)

    def save(self, name: str, data: bytes) -> None:
        """A whole file, at once and for good."""
        handle = self.disk.create(self.folder / name)
        try:
            view = memoryview(data)
            while view:
                view = view[self.disk.append(handle, view) :]
            self.disk.sync(handle)
        finally:
            self.disk.close(handle)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        self.close()

    def put(self, name: str, *parts: bytes) -> bool:
        """All of the parts at a file's end, or nothing of them; whether that was possible."""
        with self.locks[name]:
            before = self.sizes[name]
            try:
                for part in parts:
                    view = memoryview(part)
                    while view:
                        view = view[self.disk.append(self.files[name], view) :]
            except OSError as error:
                self.complain(name, error)
                with suppress(OSError):
                    self.disk.shorten(self.files[name], before)
                return False
            self.sizes[name] = before + sum(map(len, parts))
        return True

    def complain(self, name: str, error: OSError) -> None:
        """Keeps the first thing that the disk refused, in words, for those who show it."""
        self.refused = True
        self.retry = time.monotonic() + AGAIN
        self.trouble = self.trouble or (
            f"{self.folder / name}: can not be written on: {error.strerror}"
        )

    def block(self, block: Block) -> None:
        """The bytes, then their row in the index: a row is never without its bytes."""
        if self.refused and time.monotonic() < self.retry:
            self.lost += len(block.data)
            return
        offset = self.sizes["bytes.bin"]
        written = self.put("bytes.bin", block.data)
        if written and not self.put("index.bin", make_row(block, offset, time.time())):
            self.take_back(offset)
            written = False
        self.rows += written
        if not written:
            self.lost += len(block.data)
        elif self.refused:
            self.refused = False
            self.event("recording again", lost_bytes=self.lost)

    def take_back(self, size: int) -> None:
        with self.locks["bytes.bin"], suppress(OSError):
            self.disk.shorten(self.files["bytes.bin"], size)
            self.sizes["bytes.bin"] = size

    def event(self, name: str, **more: Any) -> None:
        """A line about something that happened now."""
        row = {"monotonic": time.monotonic(), "utc": time.time(), "event": name, **more}
        self.put("events.jsonl", json.dumps(row, default=str).encode() + b"\n")

    def poses(self, batch: Poses) -> None:
        """Poses, which are written a little later, many at once."""
        self.waiting.append(batch)
        if time.monotonic() - self.written > FLUSH:
            self.flush()

    def flush(self) -> None:
        """Writes the poses that wait."""
        self.written = time.monotonic()
        if not self.waiting:
            return
        rows = pose_table.make_batch(pose_columns(join_poses(self.waiting)))
        self.waiting = []
        head = b"" if self.has_schema else pose_table.schema_of(rows)
        if self.put("poses.arrows", head, rows.serialize().to_pybytes()):
            self.has_schema = True
            self.poses_written += len(rows)
        else:
            self.poses_refused += len(rows)

    def sync(self) -> None:
        """Has the system put on the disk what it was given."""
        for name in NAMES:
            try:
                self.disk.sync(self.files[name])
            except OSError as error:
                self.trouble = self.trouble or (
                    f"{self.folder / name}: can not be synced: {error.strerror}"
                )

    def close(self) -> None:
        """Writes what waits, syncs, and closes every file, whatever of this fails."""
        if self.closed:
            return
        self.closed = True
        with ExitStack() as closing:
            for handle in self.files.values():
                closing.callback(self.close_file, handle)
            closing.callback(self.sync)
            if self.syncer:
                closing.callback(self.syncer.finish)
            closing.callback(self.seal)
            closing.callback(self.end_poses)

    def close_file(self, handle: int) -> None:
        with suppress(OSError):
            self.disk.close(handle)

    def end_poses(self) -> None:
        self.flush()
        if self.has_schema:
            self.put("poses.arrows", pose_table.END)

    def seal(self) -> None:
        """The last event: how much each file holds, so that what is cut off later is missed."""
        self.event(
            CLOSED, bytes=self.sizes["bytes.bin"], rows=self.rows, poses=self.poses_written,
            meta_crc=self.meta_crc, refused_bytes=self.lost, refused_poses=self.poses_refused,
        )  # fmt: skip

    def discard(self) -> None:
        """Takes back a recording in which nothing is yet, and the folders that were made for it."""
        self.close()
        for file in self.folder.iterdir():
            file.unlink()
        self.folder.rmdir()
        for folder in self.above:
            with suppress(OSError):  # another run may have begun in it
                folder.rmdir()


class Syncer(threading.Thread):
    """Syncs a recording every so often, beside those who write: a disk may take its time."""

    def __init__(self, recording: Recording, seconds: float) -> None:
        super().__init__(name="sync", daemon=True)
        self.recording, self.seconds = recording, seconds
        self.ending = threading.Event()

    def run(self) -> None:
        while not self.ending.wait(self.seconds):
            self.recording.sync()

    def finish(self) -> None:
        self.ending.set()
        if self.is_alive():
            self.join(timeout=10.0)


@dataclass(frozen=True)
class Seal:
    """What a recording's files held when it was closed; see `Recording.seal`."""

    bytes: int
    rows: int
    poses: int
    meta_crc: int
    refused_bytes: int
    refused_poses: int


def seal_of(folder: Path) -> Seal | None:
    """None of a recording that was not closed, or was made before recordings were sealed."""
    names = [field.name for field in fields(Seal)]
    try:
        lines = (folder / "events.jsonl").read_bytes().splitlines()
        last = next(json.loads(line) for line in reversed(lines) if line.strip())
        if last["event"] == CLOSED:
            return Seal(*(int(last[name]) for name in names))
    except (OSError, StopIteration, ValueError, KeyError, TypeError):
        pass
    return None


def blocks(folder: Path, damage: Damage | None = None, salvage: bool = False) -> Iterator[Block]:
    """The blocks of a recording, also of one that ended in the middle of a write.

    Bytes that no sound row of the index knows of come as blocks of their own, `doubtful`, and the
    beam's place is then unknown where a stage carried it. damage: is told what is not as it was
    written.  salvage: do without the index if it is missing or not that of these bytes; else this
    raises `InputError`.
    """
    damage = damage if damage is not None else Damage()
    seal, size = seal_of(folder), size_of(folder)
    rows, proven, damage.rows = read_rows(read_index(folder, salvage))
    if not proven:
        count = contiguous(rows)
        rows, damage.rows = rows[:count], len(rows) - count
    path = folder / "bytes.bin"
    try:
        file = path.open("rb")
    except OSError as error:
        raise missing_file(path, error, "a recording cannot be solved without its bytes") from None
    with file:
        if proven and not any_agrees(rows, file):
            if seal and not salvage and not size:
                raise InputError(
                    f"{path}: is empty, but held {seal.bytes} bytes when it was closed"
                )
            if seal and not salvage:
                raise InputError(
                    f"{folder / 'index.bin'}: none of its {len(rows)} rows agrees with {path}: one "
                    f"of the two is damaged or of another recording. `facets recover {folder}` "
                    "solves the bytes without it"
                )
            rows, damage.rows = rows[:0], damage.rows + len(rows)
        if seal:
            damage.absent = max(0, seal.rows - len(rows) - damage.rows)
            damage.missing = max(0, seal.bytes - size)
        known_missing = damage.missing
        carried = not len(rows) or not np.isnan(rows["stage"][:, 0]).all()
        nowhere = Encoder(-np.inf, np.zeros(2), np.zeros(2)) if carried else None
        place = 0
        for row in rows:
            offset, length, arrival = (
                int(row["offset"]),
                int(row["length"]),
                float(row["monotonic"]),
            )
            if proven and offset < place:  # nothing that this program writes
                damage.rows += 1
                continue
            if proven and offset > place:
                data = file.read(offset - place)
                damage.unproven += len(data)
                if data:
                    yield Block(data, arrival, nowhere, doubtful=True)
            data = file.read(min(length, size))
            place = offset + length
            damage.missing += max(0, length - len(data) - known_missing)
            known_missing = max(0, known_missing - length + len(data))
            sound = not proven or proves(row, data)
            damage.unproven += 0 if sound else len(data)
            if data:
                yield Block(data, arrival, unpack_encoder(row["stage"]), doubtful=not sound)
        rest = file.read()
        damage.unproven += len(rest)
        if rest:
            yield Block(rest, float("nan"), nowhere, doubtful=True)


def read_index(folder: Path, salvage: bool) -> bytes:
    path = folder / "index.bin"
    try:
        return path.read_bytes()
    except OSError as error:
        if salvage:
            return b""
        if not size_of(folder):
            raise InputError(
                f"{folder}: is no recording: it has no index.bin and no bytes"
            ) from None
        remedy = f"`facets recover {folder}` solves the bytes without it"
        raise missing_file(path, error, remedy) from None


def missing_file(path: Path, error: OSError, remedy: str) -> InputError:
    if isinstance(error, FileNotFoundError):
        return InputError(f"{path}: is missing; {remedy}")
    return InputError(f"{path}: can not be read: {error.strerror}; {remedy}")


def contiguous(rows: Any) -> int:
    """How many rows without a CRC follow each other as a recording writes them."""
    ends = np.cumsum(rows["length"])
    begins = np.append(np.zeros(1, ends.dtype), ends[:-1])[: len(rows)]
    return int(np.argmin(np.append(rows["offset"] == begins, False)))


def any_agrees(rows: Any, file: BinaryIO) -> bool:
    """Whether the bytes of any row are those of the file, which is then at its beginning."""
    for row in rows:
        file.seek(int(row["offset"]))
        if proves(row, file.read(int(row["length"]))):
            file.seek(0)
            return True
    file.seek(0)
    return False


def size_of(folder: Path) -> int:
    """Bytes that a recording holds, 0 where it has no file of them."""
    try:
        return (folder / "bytes.bin").stat().st_size
    except OSError:
        return 0


def utc_offset(folder: Path) -> float | None:
    """Of the wall clock over the host's monotonic one, s, at the recording's beginning."""
    rows, _, _ = read_rows(read_index(folder, salvage=True))
    known = rows[np.isfinite(rows["monotonic"])]
    return float(known["utc"][0] - known["monotonic"][0]) if len(known) else None


def kept(total: str) -> str:
    """The name in a recording of a file with that SHA-256."""
    return f"measured-{total[:12]}.csv"


def meta_of(folder: Path, own: bool = True) -> dict[str, Any]:
    """How a recording was made; raises `InputError` where the folder is none.

    own: refuse a `meta.yaml` that is not the one that the recording was closed with.
    """
    from ruamel.yaml import YAML
    from ruamel.yaml.error import YAMLError

    path = folder / "meta.yaml"
    remedy = (
        f"what came is in {folder / 'bytes.bin'}, which `facets acquire CONFIG --port "
        f"file:{folder / 'bytes.bin'}` reads"
    )
    if not path.is_file():
        if (folder / "bytes.bin").is_file():
            raise InputError(f"{path}: is missing; {remedy}")
        what = "it has no meta.yaml" if folder.is_dir() else "there is no such folder"
        raise InputError(f"{folder}: is no recording: {what}")
    try:
        data = path.read_bytes()
        found = YAML(typ="safe").load(data.decode())
    except OSError as error:
        raise InputError(f"{path}: can not be read: {error.strerror}") from None
    except (YAMLError, ValueError, RecursionError):
        found = None
    if not isinstance(found, dict) or not isinstance(found.get("resolved"), dict):
        raise InputError(f"{path}: is damaged, it holds no configuration; {remedy}")
    seal = seal_of(folder)
    if own and seal and seal.meta_crc != zlib.crc32(data):
        raise InputError(
            f"{path}: is not the file that this recording was closed with: it was changed, or is "
            "of another recording. Put the right one back, or name a configuration: "
            f"`facets replay {folder} --config CONFIG`"
        )
    return found
