"""The few things that a recording asks of a file system, so that tests can take the power away."""

from __future__ import annotations

import errno
import os
from pathlib import Path


class Disk:
    """Files that only grow. Every method raises `OSError` where the system refuses."""

    def make_folder(self, folder: Path) -> None:
        """Makes a folder and those above it, where they are missing."""
        folder.mkdir(parents=True, exist_ok=True)

    def create(self, path: Path) -> int:
        """A new, empty file, open for appending."""
        return os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND, 0o644)

    def append(self, handle: int, data: bytes | memoryview) -> int:
        """Hands bytes to the system; returns how many it took."""
        return os.write(handle, data)

    def shorten(self, handle: int, size: int) -> None:
        """Cuts a file off after `size` bytes."""
        os.ftruncate(handle, size)

    def sync(self, handle: int) -> None:
        """Waits until a file is where a power failure cannot take it; refuses one without a name,
        which is gone as soon as it is closed."""
        os.fsync(handle)
        if not os.fstat(handle).st_nlink:
            raise FileNotFoundError(errno.ENOENT, "it was deleted, and what it held is lost")

    def sync_folder(self, folder: Path) -> None:
        """The same for the names of the files in a folder."""
        if os.name == "nt":  # which has no such thing
            return
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)

    def close(self, handle: int) -> None:
        os.close(handle)
