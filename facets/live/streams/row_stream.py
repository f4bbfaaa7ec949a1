"""Samples as rows, of a board or of another process, kept by a thread until they are taken."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from ...core.errors import FacetsError
from ...core.units import Rows
from ..run.poses import poses
from .sample_rows import SAMPLE, row_content, rows_of, sample_dtype
from .subscription import Subscription

if TYPE_CHECKING:
    from ...core.settings import Config

#: Maximum number of samples kept for a reader that does not take them: 480 MB, three minutes at
#: 10 kHz.
MAX_HELD_ROWS = 2_000_000
#: Samples that are read ahead of a file, which loses nothing while it waits.
AHEAD = 10_000
#: A stream from which nothing comes for this time is taken to be silent, s.
SILENCE_TIMEOUT_S = 10.0


def is_published(address: str) -> bool:
    """Whether an address is that of another process's publication, and not of a board."""
    return address.startswith("zmq://")


class HeldRows:
    """Rows in the order in which they came, of samples taken at `begin` (host's clock, s) or later.

    lost: number of rows that found no place.
    """

    def __init__(self, begin: float) -> None:
        self.begin = begin
        self.parts: list[Rows] = []
        self.count = self.lost = 0

    def add(self, rows: Rows) -> None:
        """Keep rows since `begin`; all of them are counted as lost if that would exceed
        MAX_HELD_ROWS."""
        rows = rows[rows["host_s"] >= self.begin]
        if self.count + len(rows) > MAX_HELD_ROWS:
            self.lost += len(rows)
            return
        self.parts.append(rows)
        self.count += len(rows)

    def take(self, most: int | None = None) -> Rows:
        """Remove and return the oldest rows: all, or at most `most`; empty if there are none."""
        rows = np.concatenate(self.parts) if self.parts else np.empty(0, SAMPLE)
        most = self.count if most is None else most
        self.parts, self.count = [rows[most:]], max(self.count - most, 0)
        return rows[:most]


class RowStream:
    """A thread that reads a stream from now on, and keeps the rows that are asked for.

    patient: whether the source is a file, which is read only as fast as its rows are taken.
    newest: host's time of the newest sample, s.  ended: whether the stream has ended.
    """

    def __init__(self, config: Config, address: str) -> None:
        """address: a board's port, `file:PATH`, or `zmq://HOST:PORT` of a publication.

        Raises `FacetsError` if a publication cannot be opened; `check` raises a port's error.
        """
        self.config, self.address = config, address
        self.dtype = kept_dtype(config)
        self.patient = address.startswith("file:")
        self.ahead = AHEAD
        self.held = HeldRows(-np.inf if self.patient else np.inf)
        self.newest, self.came = -np.inf, np.inf  # nothing is late before the port is open
        self.ended = False
        self.error: Exception | None = None
        self.ending = threading.Event()
        self.news = threading.Condition()
        self.remote = Subscription(address) if is_published(address) else None
        self.thread = threading.Thread(target=self.run, name="samples", daemon=True)
        self.thread.start()

    def rows(self) -> Iterator[Rows]:
        """Yield the rows of the other process or of the board as they come."""
        if self.remote is not None:
            for rows in self.remote:
                yield same_columns(rows, self.dtype)
            return
        offset = time.time() - time.monotonic()

        def is_over() -> bool:
            """Asked at each read, first when the port has been opened."""
            self.came = min(self.came, time.monotonic())
            return self.ending.is_set()

        for part in poses(self.config, self.address, is_over):
            yield same_columns(rows_of(part, offset), self.dtype)

    def run(self) -> None:
        """Keep rows until the stream or the device ends; an error is kept for `check`."""
        try:
            for rows in self.rows():
                self.add(rows)
                if self.ending.is_set():
                    break
        except Exception as error:  # raised by `check` in the thread that waits
            self.error = error
        finally:
            with self.news:
                self.ended = True
                self.news.notify_all()

    def add(self, rows: Rows) -> None:
        """Keep rows; a patient stream first waits for room."""
        with self.news:
            while self.patient and self.held.count > self.ahead and not self.ending.is_set():
                self.news.wait(0.1)
            self.held.add(rows)
            self.newest = max(self.newest, float(rows["host_s"][-1]))
            self.came = time.monotonic()
            self.news.notify_all()

    def keep(self) -> None:
        """Keep the rows of samples that are taken from now on; of a file, all that are left."""
        with self.news:
            now = time.monotonic()
            if not self.patient:
                self.held = HeldRows(now)
            self.came = now if np.isfinite(self.came) else self.came

    def read_on(self) -> None:
        """Read a file on without waiting for its rows to be taken."""
        with self.news:
            self.ahead = MAX_HELD_ROWS
            self.news.notify_all()

    def forget(self) -> None:
        """Stop keeping rows. The rows of a file wait until they are taken."""
        with self.news:
            if not self.patient:
                self.held = HeldRows(np.inf)

    def take(self, most: int | None = None) -> Rows:
        """Remove and return the oldest kept rows: all, or at most `most`; empty if there are
        none."""
        with self.news:
            rows = self.held.take(most)
            self.news.notify_all()
            return rows

    def wait(self, true: Callable[[], bool]) -> None:
        """Wait until a condition is true, or the stream has ended.

        Raises `FacetsError` if nothing comes for SILENCE_TIMEOUT_S, or the source has failed.
        """
        with self.news:
            while not (true() or self.ended):
                if time.monotonic() - self.came > SILENCE_TIMEOUT_S:
                    raise FacetsError(
                        f"{self.address}: no sample came for {SILENCE_TIMEOUT_S:g} s: check that "
                        "the board is on, and acquire.baud and acquire.format"
                    )
                self.news.wait(0.1)
        self.check()

    def check(self) -> None:
        """Raise the error of the source, if there is one."""
        if self.error is not None and not self.ending.is_set():
            raise self.error

    def close(self) -> None:
        """End the thread and close the source."""
        self.ending.set()
        if self.remote is not None:
            self.remote.stop()
        with self.news:
            self.news.notify_all()
        self.thread.join(timeout=SILENCE_TIMEOUT_S)
        if self.remote is not None:
            self.remote.close()


def kept_dtype(config: Config) -> np.dtype[np.void]:
    """The columns of kept rows: all that the configuration gives."""
    return sample_dtype(row_content(config))


def same_columns(rows: Rows, dtype: np.dtype[np.void]) -> Rows:
    """Rows with the columns of a dtype. Raises `FacetsError` where one is missing."""
    if rows.dtype == dtype:
        return rows
    names = dtype.names or ()
    lacks = [name for name in names if name not in (rows.dtype.names or ())]
    if lacks:
        raise FacetsError(
            f"the publication has no {', '.join(lacks[:3])}: it is of another version of facets, "
            "or its configuration names no such object (--point) or auxiliary channels "
            "(acquire.channels), or has no covariance of a calibration (sensor.calibration)"
        )
    return rows[list(names)].astype(dtype)
