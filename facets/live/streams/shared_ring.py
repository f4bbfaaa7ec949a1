"""Samples in shared memory, for one reader on this machine at full rate: `shm:NAME`.

A ring of rows with counters of all rows ever. The writer says how far it is going to write before
it does (`begun`), and how far it has written after (`written`); a reader copies rows, and looks at
`begun` again: what may have been overwritten meanwhile it gives up, and counts. So the writer never
waits for a slow reader, and the reader knows what it has lost. The layout is in docs/formats.md.

The counters are read and written in the order of the program, which processors of the x86 family
keep for another process; on others a reader should compare `seq` from row to row.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from multiprocessing import resource_tracker, shared_memory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError

#: Rows of a ring: 1.3 s at 50,000 samples a second.
CAPACITY = 65_536
MAGIC = b"FACETSR1"
#: The head of the memory. size: of a row, bytes.  rows: where the ring begins.  pid, reader: of the
#: two processes, 0 for none.  ended: whether no more is written.  read: by the reader.
HEAD = np.dtype([
    ("magic", "S8"), ("size", "<u4"), ("capacity", "<u4"), ("description", "<u4"), ("rows", "<u4"),
    ("pid", "<u4"), ("ended", "<u4"), ("begun", "<u8"), ("written", "<u8"), ("reader", "<u4"),
    ("spare", "<u4"), ("read", "<u8"),
])  # fmt: skip
#: A reader that finds nothing looks again after so long, s.
POLL = 5e-4
#: A replay waits for its reader to go on no longer than this, s.
STUCK = 5.0

Rows = NDArray[np.void]


def attach(name: str) -> shared_memory.SharedMemory:
    """Memory that another process owns, and takes away: Python before 3.13 would do that here, too.
    Raises `FileNotFoundError`."""
    if sys.version_info >= (3, 13):
        return shared_memory.SharedMemory(name, track=False)
    register = resource_tracker.register
    resource_tracker.register = lambda *_: None
    try:
        return shared_memory.SharedMemory(name)
    finally:
        resource_tracker.register = register


class Ring:
    """The parts of a memory, seen as arrays. They must go before the memory is closed."""

    def __init__(self, memory: shared_memory.SharedMemory) -> None:
        self.memory = memory
        self.head: Any = np.frombuffer(self.bytes, HEAD, 1)

    @property
    def bytes(self) -> Any:
        return self.memory.buf

    def rows(self, dtype: np.dtype[np.void]) -> Rows:
        first, count = int(self.head["rows"][0]), int(self.head["capacity"][0])
        return np.frombuffer(self.bytes, dtype, count, first)

    def close(self) -> None:
        del self.head
        self.memory.close()


def is_alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except OSError:  # somebody else's
        return True
    return pid != 0


def check_name(name: str) -> None:
    """Raises `InputError` for a name that is none."""
    if not name or not all(one.isalnum() or one in "-_." for one in name):
        raise InputError(f"shm:{name}: is no name; give letters, digits, - and _")


class SharedSender:
    """The writing end. In a replay it waits for a reader, and for a slow one."""

    def __init__(self, name: str, about: dict[str, Any], wait: float) -> None:
        """wait: s, for a first reader; 0 for a live run, which waits for nobody."""
        check_name(name)
        self.dtype = np.dtype([(one, kind) for one, kind in about["dtype"]])
        told = json.dumps(about).encode()
        first = -(-(HEAD.itemsize + len(told)) // 64) * 64
        size = first + CAPACITY * self.dtype.itemsize
        self.ring = Ring(self.created(name, size))
        head = self.ring.head
        head["size"], head["capacity"], head["rows"] = self.dtype.itemsize, CAPACITY, first
        head["description"], head["pid"] = len(told), os.getpid()
        self.ring.bytes[HEAD.itemsize : HEAD.itemsize + len(told)] = told
        self.rows: Rows | None = self.ring.rows(self.dtype)
        head["magic"] = MAGIC  # last: what has it is whole
        self.patient, self.until = wait > 0, time.monotonic() + wait

    def created(self, name: str, size: int) -> shared_memory.SharedMemory:
        """New memory; what a process left that is dead is taken away before."""
        try:
            return shared_memory.SharedMemory(name, create=True, size=size)
        except FileExistsError:
            pass
        old = Ring(attach(name))
        ours = bytes(old.head["magic"][0]) == MAGIC
        pid = int(old.head["pid"][0])
        left = ours and not is_alive(pid)
        if left:
            old.memory.unlink()
        old.close()
        if not left:
            who = f"process {pid}" if ours else "another program"
            raise InputError(f"shm:{name}: {who} has memory of that name; give another name")
        return shared_memory.SharedMemory(name, create=True, size=size)

    @property
    def receivers(self) -> int:
        return int(self.rows is not None and is_alive(int(self.ring.head["reader"][0])))

    def unread(self) -> int:
        return int(self.ring.head["written"][0] - self.ring.head["read"][0])

    def send(self, rows: Rows) -> int:
        """Returns how many rows found a reader, less those that it can no longer read."""
        sent = 0
        for start in range(0, len(rows), CAPACITY // 4):
            sent += self.put(rows[start : start + CAPACITY // 4])
        return sent

    def put(self, rows: Rows) -> int:
        assert self.rows is not None
        head, count = self.ring.head, len(rows)
        while self.patient and not self.receivers and time.monotonic() < self.until:
            time.sleep(POLL)
        heard = self.receivers
        last = time.monotonic() + STUCK
        while heard and self.patient and self.unread() + count > CAPACITY:
            if time.monotonic() > last or not self.receivers:
                break
            time.sleep(POLL)
        written = int(head["written"][0])
        before = max(0, self.unread() - CAPACITY)
        head["begun"] = written + count
        at = (written + np.arange(count)) % CAPACITY
        self.rows[at] = rows
        head["written"] = written + count
        return max(0, count - max(0, self.unread() - CAPACITY) + before) if heard else 0

    def close(self) -> None:
        """Says that it has ended. The memory goes; who has it open reads on to its end."""
        self.rows = None
        self.ring.head["ended"] = 1
        with suppress(FileNotFoundError):
            self.ring.memory.unlink()
        self.ring.close()


class SharedSubscription:
    """Opens `shm:NAME` and iterates over arrays of samples until the publication ends.

    about: what the publisher says of them.  lost: samples that were overwritten before they were
    read. One reader at a time: a second one is refused.
    """

    def __init__(self, address: str, timeout: float = 10.0) -> None:
        """timeout: s, for a publication that is not there yet. Raises `InputError`."""
        name = address.removeprefix("shm:")
        check_name(name)
        self.ring = self.opened(name, address, timeout)
        if is_alive(int(self.ring.head["reader"][0])):
            self.ring.close()
            raise InputError(f"{address}: another process reads there already")
        head = self.ring.head
        size = int(head["description"][0])
        told = bytes(self.ring.bytes[HEAD.itemsize : HEAD.itemsize + size])
        self.about: dict[str, Any] = json.loads(told)
        self.dtype = np.dtype([(one, kind) for one, kind in self.about["dtype"]])
        self.lost, self.stopped = 0, False
        self.place = int(head["written"][0])
        head["read"], head["reader"] = self.place, os.getpid()

    def opened(self, name: str, address: str, timeout: float) -> Ring:
        last = time.monotonic() + timeout
        while True:
            with suppress(FileNotFoundError, ValueError):  # ValueError: still without a size
                ring = Ring(attach(name))
                whole = bytes(ring.head["magic"][0]) == MAGIC
                if whole and is_alive(int(ring.head["pid"][0])):
                    return ring
                ring.close()
            if time.monotonic() > last:
                raise InputError(f"{address}: nobody publishes there")
            time.sleep(10 * POLL)

    def read(self) -> Rows:
        """What has come since, at once; may be nothing."""
        head = self.ring.head
        written = int(head["written"][0])
        place = max(self.place, written - CAPACITY)
        rows = self.ring.rows(self.dtype)
        found: Rows = rows[np.arange(place, written) % CAPACITY]  # a copy
        del rows
        spoilt = max(0, min(int(head["begun"][0]) - CAPACITY - place, len(found)))
        self.lost += place + spoilt - self.place
        self.place = written
        head["read"] = written
        return found[spoilt:]

    def __iter__(self) -> Iterator[Rows]:
        while not self.stopped:
            ended = bool(self.ring.head["ended"][0])
            ended = ended or not is_alive(int(self.ring.head["pid"][0]))
            rows = self.read()
            if len(rows):
                yield rows
            elif ended:
                return
            else:
                time.sleep(POLL)

    def stop(self) -> None:
        """Ends the iteration of another thread."""
        self.stopped = True

    def close(self) -> None:
        if hasattr(self.ring, "head"):
            self.ring.head["reader"] = 0
            self.ring.close()

    def __enter__(self) -> SharedSubscription:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
