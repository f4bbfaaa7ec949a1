"""Check that a written file is complete, because some libraries do not notice a full disk."""

from __future__ import annotations

import errno
import json
from pathlib import Path

from ..core.extras import require_extra

#: Last bytes of complete files by suffix; whitespace may follow.
ENDS = {
    ".png": b"IEND\xaeB`\x82",
    ".svg": b"</svg>",
    ".pdf": b"%%EOF",
    ".html": b"</html>",
    ".gif": b";",
    ".parquet": b"PAR1",
}


def require_complete(path: Path) -> None:
    """Raise `OSError` if a file is truncated; suffixes without a check count as complete."""
    kind = path.suffix.lower()
    if kind in ENDS:
        is_complete = last_bytes(path).rstrip().endswith(ENDS[kind])
    elif kind == ".gltf":
        is_complete = is_json(path)
    elif kind == ".mp4":
        is_complete = has_complete_boxes(path)
    elif kind == ".h5":
        is_complete = is_hdf5(path)
    else:
        return
    if not is_complete:
        raise OSError(errno.ENOSPC, "it was cut off; is the disk full?")


def last_bytes(path: Path, size: int = 64) -> bytes:
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - size))
        return file.read()


def is_json(path: Path) -> bool:
    try:
        json.loads(path.read_bytes())
    except ValueError:
        return False
    return True


def is_hdf5(path: Path) -> bool:
    """Whether HDF5 can open a file, which it cannot if the file's end is missing."""
    try:
        require_extra("h5py", str(path)).File(path, "r", locking=False).close()
    except OSError:
        return False
    return True


def has_complete_boxes(path: Path) -> bool:
    """Whether the boxes of an MP4 (ISO/IEC 14496-12) fill the file exactly and include `moov`."""
    size, place, names = path.stat().st_size, 0, set()
    with path.open("rb") as file:
        while place + 8 <= size:
            file.seek(place)
            head = file.read(16)
            length = int.from_bytes(head[:4], "big")
            if length == 1:
                length = int.from_bytes(head[8:16], "big")
            if length < 8:
                return False
            names.add(head[4:8])
            place += length
    return place == size and b"moov" in names
