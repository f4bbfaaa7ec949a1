"""The sensor as a device for bluesky plans, by ophyd-async: read at a point, or flown.

Needs the extra `bluesky` (ophyd-async). `trigger` and `read` give one sample with its
uncertainties; `kickoff`, `complete` and `collect` give all samples of an interval as event pages.
What a RunEngine gets is not the record: where nothing may be lost, run `facets acquire --publish
zmq://127.0.0.1:PORT`, and give this device that address.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from bluesky.protocols import (
    EventPageCollectable,
    Flyable,
    HasHints,
    Hints,
    Preparable,
    Reading,
    Stageable,
    Triggerable,
)
from event_model import DataKey, PartialEventPage
from ophyd_async.core import AsyncConfigurable, AsyncReadable, AsyncStatus, Device

from ...core.errors import FacetsError, InputError
from ...core.names import STATE_COLUMNS
from ...core.units import Rows
from ...core.version import __version__
from ...estimation.solution import LABELS
from .row_stream import RowStream, is_published, kept_dtype
from .sample_rows import SAMPLE, row_content, unit_of

if TYPE_CHECKING:
    from ...core.settings import Config

#: Samples of one event page.
PAGE = 1_000


def columns_of(dtype: np.dtype[np.void]) -> tuple[str, ...]:
    """Columns of a sample; its time in UTC is the time stamp of each."""
    return tuple(name for name in dtype.names or () if name != "utc_s")


#: Columns of a sample without an object.
COLUMNS = columns_of(SAMPLE)


@dataclass(frozen=True)
class Interval:
    """The length of a flight, for `prepare`: a number of samples, or a time in seconds.

    Without either the flight ends when the plan calls `complete`, or at the end of a file.
    """

    samples: int | None = None
    seconds: float | None = None


class PoseSensor(
    Device,
    AsyncReadable,
    AsyncConfigurable,
    Triggerable,
    Stageable,
    Preparable,
    Flyable,
    EventPageCollectable,
    HasHints,
):
    """Poses with their standard uncertainties, of one sensor.

    A sample that cannot be solved has its status in words, and NaN for unknown values. The port is
    open from `stage`, or the first `trigger` or `kickoff`, to `unstage`.
    """

    def __init__(self, config: Config, address: str | None = None, name: str = "") -> None:
        """address: a board's port, `file:PATH` or `zmq://HOST:PORT` of `facets acquire
        --publish`; the configuration's own port by default."""
        self._config = config
        self._address = address or config.acquire.port or ""
        if not self._address:
            raise InputError(
                "no port is given: pass one to PoseSensor, or set acquire.port in the configuration"
            )
        self._dtype = kept_dtype(config)
        self._channels = row_content(config)["channels"]
        self._stream: RowStream | None = None
        self._interval = Interval()
        self._row: Rows | None = None
        self._end = 0.0
        self._left: int | None = None
        self._flying = False
        super().__init__(name=name)

    async def _open(self) -> RowStream:
        """Return the stream, which is opened on the first call; raises its error if it has
        failed."""
        if self._stream is None:
            self._stream = await asyncio.to_thread(RowStream, self._config, self._address)
        self._stream.check()
        return self._stream

    def _require_stream(self) -> RowStream:
        """Return the stream; raise `FacetsError` if it is not open."""
        if self._stream is None:
            raise FacetsError(f"{self.name}: is not staged and was neither triggered nor flown")
        return self._stream

    @AsyncStatus.wrap
    async def stage(self) -> None:
        """Open the source, and wait for its first sample."""
        stream = await self._open()
        await asyncio.to_thread(stream.wait, lambda: np.isfinite(stream.newest))

    @AsyncStatus.wrap
    async def unstage(self) -> None:
        """Close the source."""
        stream, self._stream = self._stream, None
        self._flying = False
        if stream is not None:
            await asyncio.to_thread(stream.close)

    @AsyncStatus.wrap
    async def trigger(self) -> None:
        """Wait for the first sample that is taken from now on; of a file, for the next one. Raises
        `FacetsError` during a flight, or if no sample will come."""
        if self._flying:
            raise FacetsError(f"{self.name}: is flying; complete the flight before a trigger")
        stream = await self._open()
        stream.keep()
        try:
            await asyncio.to_thread(stream.wait, lambda: stream.held.count > 0)
            rows = stream.take(1)
        finally:
            stream.forget()
        if not len(rows):
            raise FacetsError(f"{self._address}: has ended; no more samples will come")
        self._row = rows

    async def read(self) -> dict[str, Reading[Any]]:
        """Return the sample of the last trigger. Raises `FacetsError` if there was none."""
        if self._row is None:
            raise FacetsError(f"{self.name}: was not triggered, so that it has no sample to read")
        at = float(self._row["utc_s"][0])
        return {
            self._key(name): Reading(value=values[0], timestamp=at)
            for name, values in list_columns(self._row).items()
        }

    async def describe(self) -> dict[str, DataKey]:
        """The description of each column of a reading, by its key."""
        return {self._key(name): self._data_key(name) for name in columns_of(self._dtype)}

    async def describe_collect(self) -> dict[str, DataKey]:
        """The description of each column of a flight, as by `describe`."""
        return await self.describe()

    async def read_configuration(self) -> dict[str, Reading[Any]]:
        """The configuration's name, object and checksum, and the software, as readings."""
        now = time.time()
        return {
            self._key(name): Reading(value=value, timestamp=now)
            for name, value in self._describe_configuration().items()
        }

    async def describe_configuration(self) -> dict[str, DataKey]:
        """The description of each entry of `read_configuration`."""
        return {
            self._key(name): DataKey(source=self._address, dtype="string", shape=[])
            for name in self._describe_configuration()
        }

    @property
    def hints(self) -> Hints:
        """The columns that bluesky plots and prints: the six axes."""
        prefix = "" if self._config.object is None else "object_"
        return {"fields": [self._key(f"{prefix}{name}") for name in STATE_COLUMNS[:6]]}

    @AsyncStatus.wrap
    async def prepare(self, value: Interval) -> None:
        """Set the length of the next flight. Raises `InputError` if it is not above zero."""
        if (value.samples or 1) <= 0 or (value.seconds or 1) <= 0:
            raise InputError(f"{self.name}: {value}: needed is a time above zero")
        self._interval = value

    @AsyncStatus.wrap
    async def kickoff(self) -> None:
        """Keep the samples that are taken from now on; of a file, the remaining ones. Raises
        `FacetsError` if the device flies already."""
        if self._flying:
            raise FacetsError(f"{self.name}: flies already")
        stream = await self._open()
        stream.keep()
        stream.read_on()
        seconds = self._interval.seconds
        self._end = np.inf if seconds is None or stream.patient else stream.held.begin + seconds
        self._left = self._interval.samples
        self._flying = True

    @AsyncStatus.wrap
    async def complete(self) -> None:
        """Wait until all samples of the interval have arrived.

        Raises `FacetsError` if samples were lost because nobody collected them.
        """
        stream = self._require_stream()
        if self._left is None and self._end == np.inf and not stream.patient:
            self._end = time.monotonic()
        try:
            await asyncio.to_thread(stream.wait, lambda: self._is_whole(stream))
        finally:
            self._flying = False
        if not self._is_whole(stream) and not (stream.patient and self._left is None):
            raise FacetsError(
                f"{self._address}: ended before all samples of the flight had arrived"
            )
        if stream.held.lost:
            raise FacetsError(
                f"{self.name}: {stream.held.lost} samples of the flight are lost, since nobody "
                "collected them; collect while it completes, or fly for a shorter time"
            )

    def _is_whole(self, stream: RowStream) -> bool:
        """Whether the stream holds all rows of the reading or flight."""
        if self._left is None:
            return bool(stream.newest > self._end)
        return stream.held.count >= self._left

    async def collect_pages(self) -> AsyncIterator[PartialEventPage]:
        """Yield the samples of the interval that were not collected yet, as event pages."""
        stream = self._require_stream()
        rows = await asyncio.to_thread(self._gather, stream)
        if not self._flying:
            stream.forget()
        for start in range(0, len(rows), PAGE):
            part = rows[start : start + PAGE]
            at = part["utc_s"].tolist()
            values = list_columns(part)
            yield PartialEventPage(
                data={self._key(name): column for name, column in values.items()},
                timestamps={self._key(name): at for name in values},
                time=at,
            )

    def _gather(self, stream: RowStream) -> Rows:
        """Remove and return the rows of the reading or flight."""
        rows = stream.take(self._left)
        if self._left is not None:
            self._left -= len(rows)
        return rows[rows["host_s"] <= self._end]

    def _describe_configuration(self) -> dict[str, str]:
        """The entries of the configuration as texts."""
        body = self._config.object
        return {
            "config": self._config.name,
            "object": "the mirror" if body is None else body.text,
            "config_sha256": self._config.sha256,
            "facets": __version__,
            "address": self._address,
            "solved_by": "its publisher" if is_published(self._address) else "this device",
        }

    def _key(self, name: str) -> str:
        """The key of a column: the device's name and the column's."""
        return f"{self.name}-{name}"

    def _data_key(self, name: str) -> DataKey:
        """The description of a column: source, type and unit."""
        kind = self._dtype[name].kind
        dtype = "string" if name == "status" else "integer" if kind in "iu" else "number"
        key = DataKey(source=self._address, dtype=dtype, shape=[])  # type: ignore[typeddict-item]
        if unit := unit_of(name, self._channels):
            key["units"] = unit
        return key


def list_columns(rows: Rows) -> dict[str, list[Any]]:
    """Columns of rows as lists of plain numbers, the status in words."""
    columns: dict[str, list[Any]] = {name: rows[name].tolist() for name in columns_of(rows.dtype)}
    columns["status"] = [LABELS.get(number, str(number)) for number in columns["status"]]
    return columns
