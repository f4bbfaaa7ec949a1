"""Model of a file system at a power failure, which loses, tears or reorders unsynced data; its idea
comes from SQLite's crash tests (`test6.c`).

A program writes by a `Log`, which keeps what it did and holds the files in memory. `image` is what
a disk may hold where the power went at one moment of it: of all that was written since the last
sync of a file any part may have reached the disk, in sectors, in any order. The name of a file that
was made since the folder was synced may be missing.
"""

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np

from facets.live import Disk

SECTOR = 512


class Log(Disk):
    """Log of all operations; `on_sync` is called during each sync to imitate other threads."""

    def __init__(self) -> None:
        self.done: list[tuple[str, str, bytes]] = []
        self.names: list[str] = []
        self.on_sync: Callable[[str], None] = lambda _: None

    def make_folder(self, folder: Path) -> None:
        pass

    def create(self, path: Path) -> int:
        self.done.append(("create", path.name, b""))
        self.names.append(path.name)
        return len(self.names) - 1

    def append(self, handle: int, data: bytes | memoryview) -> int:
        some = bytes(data)
        self.done.append(("append", self.names[handle], some))
        return len(some)

    def shorten(self, handle: int, size: int) -> None:
        raise NotImplementedError

    def sync(self, handle: int) -> None:
        self.done.append(("sync", self.names[handle], b""))
        self.on_sync(self.names[handle])

    def sync_folder(self, folder: Path) -> None:
        self.done.append(("sync folder", "", b""))

    def close(self, handle: int) -> None:
        pass


def image(log: Log, moment: int, rng: np.random.Generator) -> dict[str, bytes]:
    """Possible contents of the disk, by file, if power fails after this number of operations."""
    sure: dict[str, bytearray] = {}
    loose: dict[str, list[tuple[int, bytes]]] = {}
    ends: dict[str, int] = {}
    named: set[str] = set()
    for what, name, data in log.done[:moment]:
        if what == "create":
            sure[name], loose[name], ends[name] = bytearray(), [], 0
        elif what == "append":
            loose[name].append((ends[name], data))
            ends[name] += len(data)
        elif what == "sync":
            for place, part in loose[name]:
                put(sure[name], place, part)
            loose[name] = []
        else:
            named |= set(sure)
    for name, parts in loose.items():
        mood = rng.choice(["nothing", "all", "any", "in order", "length only"])
        stop = int(rng.integers(0, len(parts) + 1))
        if mood == "length only" and parts:
            put(sure[name], ends[name], b"")
        for n, (place, part) in enumerate(parts):
            if mood == "all" or (mood == "in order" and n < stop):
                put(sure[name], place, part)
            elif mood == "any":
                for start, end in sectors(place, len(part)):
                    if rng.random() < 0.5:
                        put(sure[name], start, part[start - place : end - place])
    return {n: bytes(d) for n, d in sure.items() if n in named or rng.random() < 0.5}


def sectors(place: int, length: int) -> list[tuple[int, int]]:
    """Pieces of a range of bytes that reach a disk together."""
    cuts = [place, *range((place // SECTOR + 1) * SECTOR, place + length, SECTOR), place + length]
    return list(pairwise(cuts))


def put(file: bytearray, place: int, data: bytes) -> None:
    """Write bytes at a position; a gap before it reads as zeros."""
    if len(file) < place:
        file.extend(bytes(place - len(file)))
    file[place : place + len(data)] = data
