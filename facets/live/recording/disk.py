"""The calls of a recording to a file system, which tests replace to simulate power failures."""

from __future__ import annotations

import errno
import os
from pathlib import Path


class Disk:
    """A file system whose files only grow. All methods raise `OSError` if the system refuses."""

    def make_folder(self, folder: Path) -> None:
        """Make a folder and its parents if they are missing."""
        folder.mkdir(parents=True, exist_ok=True)

    def create(self, path: Path) -> int:
        """Make an empty file, and open it for appending."""
        return os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND, 0o644)

    def append(self, handle: int, data: bytes | memoryview) -> int:
        """Hand bytes to the system; return how many it took."""
        return os.write(handle, data)

    def shorten(self, handle: int, size: int) -> None:
        """Cut a file off after `size` bytes."""
        os.ftruncate(handle, size)

    def sync(self, handle: int) -> None:
        """Wait until a file survives a power failure; raise `FileNotFoundError` for a file without
        a name, which is gone as soon as it is closed."""
        os.fsync(handle)
        if not os.fstat(handle).st_nlink:
            raise FileNotFoundError(errno.ENOENT, "it was deleted, and what it held is lost")

    def sync_folder(self, folder: Path) -> None:
        """Wait until the names of the files in a folder survive a power failure."""
        if os.name == "nt":  # Windows does not sync folders.
            return
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)

    def close(self, handle: int) -> None:
        os.close(handle)
