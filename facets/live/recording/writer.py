"""A recording: a folder that keeps all received data, even if the program or the power fails.

`meta.yaml` is written first. It states how the recording was made, and the whole configuration.

`bytes.bin` holds the received bytes.

`index.bin` has a row (`index.INDEX`) for each block of bytes: its offset and time, the stage's
position then, and the checksums of row and bytes.

`poses.arrows` holds the poses as an Arrow stream, in batches. While the loop is behind, the newest
poses come first.

`events.jsonl` has a line for each event. The last line states the sizes of the other files.
"""

from __future__ import annotations

import errno
import json
import threading
import time
import zlib
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import numpy as np

from ...config.loading import measured_files
from ...core.closing import ClosedAtExit
from ...core.errors import FacetsError, InputError
from ..run.pipeline import RunPoses, join_poses
from ..run.sink import Sink
from ..sources.source import Block
from . import pose_table
from .disk import Disk
from .index import CLOSED, add_sum, make_row, name_of_copy

#: The files in the order in which they are synced: no row reaches the disk long before its bytes.
NAMES = ("bytes.bin", "index.bin", "poses.arrows", "events.jsonl")
POSES = "poses.arrows"
#: Errors of a full disk or quota, on which the poses make room for the bytes.
FULL = (errno.ENOSPC, errno.EDQUOT)
#: Poses are written this often, s: each batch is a short pause of the loop, with a head of 1.6 kB.
FLUSH_INTERVAL_S = 0.1
#: A disk that refused is tried again after this time, s.
RETRY_INTERVAL_S = 1.0


class DiskError(FacetsError):
    """A recording cannot be begun."""


class Recording(ClosedAtExit, Sink):
    """Writes a recording, and reports the data that it could not write.

    Bytes are handed to the system at once, so that a killed program loses none of them. A separate
    thread syncs the files every `sync` seconds, so that a power failure loses at most the bytes of
    that time. If the disk refuses a file, `troubles` has the reason, and `lost` counts the received
    bytes that are not recorded. The written bytes stay readable, the other files are written on,
    and writing continues as soon as the disk accepts it. On a full disk the poses make room for the
    bytes, because a replay computes them again: their file is emptied and no longer written. No
    method raises after the beginning.
    """

    def __init__(
        self,
        folder: Path,
        meta: str,
        resolved: dict[str, Any],
        sync: float = 0.0,
        disk: Disk | None = None,
    ) -> None:
        """Begin a recording with its meta data and the files that the configuration names.

        meta: the text of `meta.yaml`.  resolved: the whole configuration.  sync: time between
        syncs, s; 0 for none. Raises `InputError` for a folder that is not new, and `DiskError` for
        one that cannot be written.
        """
        self.folder, self.disk = folder, disk or Disk()
        self.lost = 0
        self.troubles: dict[str, str] = {}
        self.refused = False
        self.locks = {name: threading.Lock() for name in NAMES}
        self.sizes = dict.fromkeys(NAMES, 0)
        self.meta_crc, self.events_crc = zlib.crc32(meta.encode()), 0
        self.summing = threading.Lock()
        self.rows = self.poses_written = self.poses_refused = 0
        self.has_dropped_poses = False
        self.retry = 0.0
        try:
            if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
                what = "is not empty" if folder.is_dir() else "is a file"
                raise InputError(f"{folder}: {what}; a recording begins in a new folder")
            self.begin(meta, resolved)
        except OSError as error:
            raise DiskError(f"{folder}: cannot be written: {error.strerror}") from None
        pose_table.stream_parts({"": np.zeros(1)})  # loads its modules before poses come
        self.has_schema = self.closed = False
        self.waiting: list[RunPoses] = []
        self.written = time.monotonic()
        self.syncer = Syncer(self, sync) if sync > 0 else None
        if self.syncer:
            self.syncer.start()

    def begin(self, meta: str, resolved: dict[str, Any]) -> None:
        """Make the files that must exist before the first byte comes."""
        self.above = [parent for parent in self.folder.parents if not parent.exists()]
        self.disk.make_folder(self.folder)
        self.save("meta.yaml", meta.encode())
        for keys, name, digest in measured_files(resolved):
            self.save(name_of_copy(digest), Path(keys[name]).read_bytes())
        self.files = {name: self.disk.create(self.folder / name) for name in NAMES}
        self.disk.sync_folder(self.folder)
        self.disk.sync_folder(self.folder.absolute().parent)

    def save(self, name: str, data: bytes) -> None:
        """Write a whole file, and sync it."""
        handle = self.disk.create(self.folder / name)
        try:
            append_all(self.disk, handle, data)
            self.disk.sync(handle)
        finally:
            self.disk.close(handle)

    def put(self, name: str, *parts: bytes) -> bool:
        """Append all of the parts to a file or none; return whether that was possible."""
        with self.locks[name]:
            if name == POSES and self.has_dropped_poses:
                return False
            error = self.append(name, parts)
            may_drop_poses = name != POSES and not self.has_dropped_poses
            if error and error.errno in FULL and may_drop_poses:
                self.drop_poses()
                error = self.append(name, parts)
            if error:
                self.complain(name, f"cannot be written to: {error.strerror}")
            return error is None

    def append(self, name: str, parts: tuple[bytes, ...]) -> OSError | None:
        """Append all of the parts to a file or none; return the error that prevented it, else
        None."""
        before = self.sizes[name]
        try:
            for part in parts:
                append_all(self.disk, self.files[name], part)
        except OSError as error:
            with suppress(OSError):
                self.disk.shorten(self.files[name], before)
            return error
        self.sizes[name] = before + sum(map(len, parts))
        return None

    def drop_poses(self) -> None:
        """Empty the file of the poses for good."""
        with self.locks[POSES], suppress(OSError):
            self.has_dropped_poses = True
            self.disk.shorten(self.files[POSES], 0)
            self.sizes[POSES] = 0
        reason = "was emptied, to make room for the received bytes on a full disk"
        self.troubles[POSES] = f"{self.folder / POSES}: {reason}"

    def complain(self, name: str, what: str) -> None:
        """Keep a sentence about the first trouble with a file."""
        self.troubles.setdefault(name, f"{self.folder / name}: {what}")

    def add_block(self, block: Block) -> None:
        """Write the bytes, then their row in the index: a row is never without its bytes.

        Bytes whose row is refused stay, because nothing else has them.
        """
        if self.refused and time.monotonic() < self.retry:
            self.lost += len(block.data)
            return
        offset = self.sizes["bytes.bin"]
        if not self.put("bytes.bin", block.data):
            self.lost += len(block.data)
            self.refused, self.retry = True, time.monotonic() + RETRY_INTERVAL_S
            return
        self.rows += self.put("index.bin", make_row(block, offset))
        if self.refused:
            self.refused = False
            self.add_event("recording again", lost_bytes=self.lost)

    def add_event(self, name: str, **details: Any) -> None:
        """Write a line about an event that happens now, with the checksum of all lines up to it."""
        row = {"monotonic": time.monotonic(), "utc": time.time(), "event": name, **details}
        with self.summing:
            line = add_sum(json.dumps(row, default=str).encode(), self.events_crc)
            if self.put("events.jsonl", line):
                self.events_crc = zlib.crc32(line, self.events_crc)

    def add_poses(self, poses: RunPoses) -> None:
        """Keep poses, which are written a little later, many at once."""
        self.waiting.append(poses)
        if time.monotonic() - self.written > FLUSH_INTERVAL_S:
            self.flush()

    def flush(self) -> None:
        """Write the waiting poses."""
        self.written = time.monotonic()
        if self.has_dropped_poses:
            self.poses_refused += self.poses_written + sum(map(len, self.waiting))
            self.poses_written, self.waiting = 0, []
        if not self.waiting:
            return
        columns = pose_table.recorded_columns(join_poses(self.waiting))
        self.waiting = []
        count = len(columns["seq"])
        head, rows = pose_table.stream_parts(columns)
        if self.put("poses.arrows", b"" if self.has_schema else head, rows):
            self.has_schema = True
            self.poses_written += count
        else:
            self.poses_refused += count

    def sync(self) -> None:
        """Let the system put all written bytes on the disk; an error is kept as a complaint."""
        for name in NAMES:
            try:
                self.disk.sync(self.files[name])
            except OSError as error:
                self.complain(name, f"cannot be synced: {error.strerror}")

    def close(self) -> None:
        """Write the waiting poses, sync, and close every file, even if one of these steps fails."""
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
        """Close a file; errors are ignored."""
        with suppress(OSError):
            self.disk.close(handle)

    def end_poses(self) -> None:
        """Write the poses that wait, and the end of their stream."""
        self.flush()
        if self.has_schema:
            self.put("poses.arrows", pose_table.END)

    def seal(self) -> None:
        """Write the last event: the sizes of all files, which show if one is cut off later.

        It is written again if the poses make room for it.
        """
        self.flush()
        self.add_event(
            CLOSED, bytes=self.sizes["bytes.bin"], rows=self.rows, poses=self.poses_written,
            meta_crc=self.meta_crc, refused_bytes=self.lost, refused_poses=self.poses_refused,
        )  # fmt: skip
        if self.has_dropped_poses and self.poses_written:
            self.seal()

    def messages(self) -> list[str]:
        """Return a sentence on refused data: the reason for the first file, and how much."""
        counts = {
            f"{self.lost} received bytes are not recorded": self.lost,
            f"{self.poses_refused} poses are not recorded, `facets replay` computes them again": (
                self.poses_refused
            ),
        }
        reasons = [self.troubles[name] for name in NAMES if name in self.troubles]
        parts = [*reasons[:1], *(text for text, count in counts.items() if count)]
        return ["; ".join(parts)] if parts else []

    def values(self) -> dict[str, Any]:
        """The entries of a status: the folder, and the number of bytes not recorded."""
        return {"recording": str(self.folder), "not_recorded_bytes": self.lost}

    def discard(self) -> None:
        """Close a recording; remove it, with the folders made for it, if it holds no bytes."""
        self.close()
        if self.sizes["bytes.bin"]:
            return
        for file in self.folder.iterdir():
            file.unlink()
        self.folder.rmdir()
        for folder in self.above:
            with suppress(OSError):  # another run may have begun in it
                folder.rmdir()


def append_all(disk: Disk, handle: int, data: bytes) -> None:
    """Append bytes to a file of a disk that may take a part of them at a time."""
    view = memoryview(data)
    while view:
        view = view[disk.append(handle, view) :]


class Syncer(threading.Thread):
    """Syncs a recording at intervals, in a separate thread, because a disk may take its time."""

    def __init__(self, recording: Recording, seconds: float) -> None:
        super().__init__(name="sync", daemon=True)
        self.recording, self.seconds = recording, seconds
        self.ending = threading.Event()

    def run(self) -> None:
        """Force the recording's data to the disk at intervals until the end."""
        while not self.ending.wait(self.seconds):
            self.recording.sync()

    def finish(self) -> None:
        """End the thread, and wait for it at most 10 s."""
        self.ending.set()
        if self.is_alive():
            self.join(timeout=10.0)
