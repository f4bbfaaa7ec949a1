"""Check by a file's format that it is complete: some libraries do not notice a full disk."""

from __future__ import annotations

import errno
import json
from pathlib import Path

from ..core.extras import require_extra

#: Last bytes of complete files by kind; blanks after them do not count.
ENDS = {
    ".png": b"IEND\xaeB`\x82",
    ".svg": b"</svg>",
    ".pdf": b"%%EOF",
    ".html": b"</html>",
    ".gif": b";",
    ".parquet": b"PAR1",
}


def require_complete(path: Path) -> None:
    """Raise `OSError` if a picture, film, page or table, by the file's suffix, is cut off."""
    kind = path.suffix.lower()
    if kind in ENDS:
        is_complete = tail_of(path).rstrip().endswith(ENDS[kind])
    elif kind == ".gltf":
        is_complete = is_json(path)
    elif kind == ".mp4":
        is_complete = has_whole_boxes(path)
    elif kind == ".h5":
        is_complete = is_hdf5(path)
    else:
        return
    if not is_complete:
        raise OSError(errno.ENOSPC, "it was cut off; is the disk full?")


def tail_of(path: Path, size: int = 64) -> bytes:
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
    """Return whether HDF5 opens a file, which it does not where the file's end is missing."""
    try:
        require_extra("h5py", str(path)).File(path, "r", locking=False).close()
    except OSError:
        return False
    return True


def has_whole_boxes(path: Path) -> bool:
    """Return whether the boxes of an MP4 (ISO/IEC 14496-12) fill the file and include `moov`."""
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
