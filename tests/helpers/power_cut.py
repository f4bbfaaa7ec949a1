"""Model of a file system at a power failure, which loses, tears or reorders unsynced data; its idea
comes from SQLite's crash tests (`test6.c`).

A program writes by a `Log`, which keeps what it did and holds the files in memory. `image` is what
a disk may hold where the power went at one moment of it: of all that was written since the last
sync of a file any part may have reached the disk, in sectors, in any order, and its new length or
not. The name of a file that was made since the folder was synced may be missing.
"""

import numpy as np

from facets.live import Disk

SECTOR = 512


class Log(Disk):
    """Log of all operations; `on_sync` is called during each sync to imitate other threads. The
    handle of a file is its name."""

    def __init__(self):
        self.done = []
        self.on_sync = lambda name: None

    def make_folder(self, folder):
        pass

    def create(self, path):
        self.done.append(("create", path.name, b""))
        return path.name

    def append(self, handle, data):
        self.done.append(("append", handle, bytes(data)))
        return len(data)

    def sync(self, handle):
        self.done.append(("sync", handle, b""))
        self.on_sync(handle)

    def sync_folder(self, folder):
        self.done.append(("sync folder", "", b""))

    def close(self, handle):
        pass


def image(log, moment, rng):
    """Possible contents of the disk, by file, if power fails after this number of operations."""
    written, synced, named, images = {}, {}, set(), {}
    for what, name, data in log.done[:moment]:
        if what == "create":
            written[name], synced[name] = b"", 0
        elif what == "append":
            written[name] += data
        elif what == "sync":
            synced[name] = len(written[name])
        else:
            named |= set(written)
    for name, sure in synced.items():
        data = np.frombuffer(written[name], np.uint8).copy()
        sector = np.arange(len(data)) // SECTOR
        is_lost = rng.random(len(data))[sector] < rng.choice([0.0, 0.5, 1.0])
        is_lost[:sure] = False
        data[is_lost] = 0
        size = rng.choice([sure, rng.integers(sure, len(data) + 1), len(data)])
        if name in named or rng.random() < 0.5:
            images[name] = data[:size].tobytes()
    return images
