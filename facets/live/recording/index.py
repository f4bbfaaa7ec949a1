"""The index of a recording: a row for each block of bytes, which proves itself and its block."""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...tracking.encoder import Encoder
from ..sources.host_time import wall_clock_offset
from ..sources.source import Block

#: data_crc: see `block_crc`.  crc: CRC-32 of the row's bytes before it.
INDEX = np.dtype(
    [
        ("offset", "<u8"),
        ("length", "<u8"),
        ("monotonic", "<f8"),
        ("utc", "<f8"),
        ("stage", "<f8", 5),
        ("data_crc", "<u4"),
        ("crc", "<u4"),
    ]
)
SIZE = INDEX.itemsize
#: The event that a recording ends with, unless the run was killed or the power failed.
CLOSED = "closed"
#: Before the last number of an event: the CRC-32 of `events.jsonl` up to this text.
SUM = b', "crc": '


@dataclass
class Damage:
    """The parts of a recording that are not as they were written.

    rows: number of corrupted rows of the index.  absent: number of rows that the index had when the
    recording was closed, and lacks now.  missing: number of bytes that the index or the seal
    counts and the file lacks.  unproven: number of bytes without a row that proves them, such as
    those that came last before the end.  events: whether lines of events.jsonl are not as they were
    written.  since: the first sample that this damage can have changed, if it is known.
    """

    rows: int = 0
    absent: int = 0
    missing: int = 0
    unproven: int = 0
    events: bool = False
    since: int | None = None

    @property
    def words(self) -> str:
        """The damage in words; empty for a recording without damage."""
        faults = (
            (self.rows, "rows of index.bin are damaged"),
            (self.absent, "rows of index.bin are missing"),
            (self.missing, "bytes of bytes.bin are missing"),
            (self.unproven, "bytes of bytes.bin have no row in index.bin that confirms them"),
        )
        words = [f"{count} {what}" for count, what in faults if count]
        return ", ".join([*words, *["events.jsonl is changed or missing"] * self.events])


def make_row(block: Block, offset: int) -> bytes:
    """The row of a block that begins at `offset`, with the wall clock's time of its arrival."""
    row = np.zeros(1, INDEX)
    row["offset"], row["length"] = offset, len(block.data)
    row["monotonic"], row["utc"] = block.arrival, block.arrival + wall_clock_offset()
    row["stage"] = pack_encoder(block.encoder)
    row["data_crc"] = block_crc(block.data)
    row["crc"] = zlib.crc32(row.tobytes()[:-4])
    return row.tobytes()


def add_sum(event: bytes, before: int) -> bytes:
    """The line of an event, an object in JSON, after lines whose CRC-32 is `before`."""
    head = event.removesuffix(b"}")
    return head + SUM + b"%d}\n" % zlib.crc32(head, before)


def are_events_whole(events: bytes | None) -> bool:
    """Whether each line has the sum that it was written with; the last may be torn. False if there
    are none."""
    if events is None:
        return False
    crc = 0
    for line in events.splitlines(keepends=True):
        if line.endswith(b"\n") and line != add_sum(line.rpartition(SUM)[0], crc):
            return False
        crc = zlib.crc32(line, crc)
    return True


def block_crc(data: bytes) -> int:
    """CRC-32 of a block's bytes from the last to the first.

    Computed from the first to the last, it would be the same for all blocks of a length. Each frame
    ends with its own CRC-32, and the CRC-32 of bytes followed by their CRC-32 is a constant.
    """
    return zlib.crc32(data[::-1])


def proves(row: np.void, data: bytes) -> bool:
    """Whether a row of the index is that of these bytes."""
    return int(row["data_crc"]) == block_crc(data)


def read_rows(raw: bytes) -> tuple[NDArray[np.void], int]:
    """Return the sound rows of an index, and the number of corrupted ones; the last may be torn."""
    count = len(raw) // SIZE
    rows = np.frombuffer(raw[: count * SIZE], INDEX)
    sound = np.array([is_sound(raw[n * SIZE : (n + 1) * SIZE]) for n in range(count)], bool)
    return rows[sound], int((~sound).sum()) + (len(raw) % SIZE > 0)


def is_sound(row: bytes) -> bool:
    """Whether a row has the checksum that it was written with."""
    return zlib.crc32(row[:-4]) == int.from_bytes(row[-4:], "little")


def pack_encoder(encoder: Encoder | None) -> list[float]:
    """The encoder's time, s, place, mm, and speed, mm/s, as five numbers; NaN for none."""
    if encoder is None:
        return [np.nan] * 5
    return [encoder.time, *encoder.place, *encoder.speed]


def unpack_encoder(row: NDArray[np.float64]) -> Encoder | None:
    """The encoder of five numbers; None if the first is NaN."""
    return None if np.isnan(row[0]) else Encoder(float(row[0]), row[1:3].copy(), row[3:5].copy())


def name_of_copy(digest: str) -> str:
    """The name that a file with this SHA-256 has in a recording."""
    return f"measured-{digest[:12]}.csv"
