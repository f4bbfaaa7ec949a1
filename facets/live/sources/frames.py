"""The three formats of a detector board's bytes: parsed in blocks, also after noise, and encoded.

Every format carries the same sample: seq (u32), t_us (u32), 12 counts (i32), four a detector, and
up to 15 auxiliary channels (f32). docs/formats.md describes the bytes for those who write firmware.
"""

from __future__ import annotations

import zlib
from abc import ABC, abstractmethod
from dataclasses import dataclass, fields
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

SYNC = b"\xa5\x5a"
#: Largest number of auxiliary channels of a frame, which the four upper bits of its kind state.
MAX_CHANNELS = 15


@cache
def frame_dtype(channels: int) -> np.dtype[np.void]:
    """A frame with this number of auxiliary channels."""
    return np.dtype(
        [
            ("sync", "<u2"),
            ("kind", "u1"),
            ("flags", "u1"),
            ("seq", "<u4"),
            ("time", "<u4"),
            ("counts", "<i4", 12),
            ("channels", "<f4", (channels,)),
            ("crc", "<u4"),
        ]
    )


FRAME = frame_dtype(0)
SIZE = FRAME.itemsize
SIGN = int.from_bytes(SYNC, "little")
#: Number of frames that are checked together, and again after a corrupted one.
TOGETHER = 64
#: Kinds of frames. ELECTRODES: counts of four electrodes for each detector. XY_SUM: X, Y, SUM and a
#: spare number. POSE: a pose that the board has solved (`board_poses`), with its sample's number.
ELECTRODES, XY_SUM, POSE = 1, 2, 3
#: Bits of `flags`. OVERRUN: the board lost samples before this one. SATURATED: a converter was at
#: the end of its range. MARK: the board's input for a trigger or a PPS signal had an edge since the
#: last sample. PERMIT: its input for a permit is on, so that the stage may move.
OVERRUN, SATURATED, MARK, PERMIT = 1, 2, 4, 8


@dataclass(frozen=True)
class RawSamples:
    """Samples in the order in which they came.

    kind, flags: (n,) uint8.  seq, time: (n,) uint32, as sent.  counts: (n, 12) int32.  channels:
    (n, m) float32, none by default.
    """

    kind: NDArray[np.uint8]
    flags: NDArray[np.uint8]
    seq: NDArray[np.uint32]
    time: NDArray[np.uint32]
    counts: NDArray[np.int32]
    channels: Any = None

    def __post_init__(self) -> None:
        if self.channels is None:
            object.__setattr__(self, "channels", np.zeros((len(self.seq), 0), np.float32))

    def __len__(self) -> int:
        return len(self.seq)

    def where(self, chosen: NDArray[Any] | slice) -> RawSamples:
        """Return some of the samples."""
        return RawSamples(*(getattr(self, item.name)[chosen] for item in fields(self)))


class Parser(ABC):
    """Turns blocks of bytes into samples.

    rest: bytes of a sample that has not come whole.  corrupt: number of frames refused.  skipped:
    number of bytes passed over.
    """

    def __init__(self, channels: int = 0) -> None:
        self.channels, self.dtype, self.rest = channels, frame_dtype(channels), b""
        self.corrupt = self.skipped = 0

    @abstractmethod
    def feed(self, block: bytes) -> RawSamples:
        """Return the samples that a block completes."""


def pack(samples: RawSamples) -> bytes:
    """Samples as fixed frames."""
    channels = samples.channels.shape[1]
    frames = np.zeros(len(samples), frame_dtype(channels))
    frames["sync"] = SIGN
    frames["kind"] = samples.kind | np.uint8(channels << 4)
    for name in ("flags", "seq", "time", "counts", "channels"):
        frames[name] = getattr(samples, name)
    raw, size = bytearray(frames.tobytes()), frames.itemsize
    view = memoryview(raw)
    for start in range(0, len(raw), size):
        crc = zlib.crc32(view[start : start + size - 4])
        raw[start + size - 4 : start + size] = crc.to_bytes(4, "little")
    return bytes(raw)


def samples_from(frames: NDArray[np.void]) -> RawSamples:
    """Convert frames (n,) to samples."""
    kind, flags, seq, time, counts, channels = (
        np.array(frames[name]) for name in ("kind", "flags", "seq", "time", "counts", "channels")
    )
    return RawSamples(kind & np.uint8(0x0F), flags, seq, time, counts, channels)


def sound_frames(view: memoryview, dtype: np.dtype[np.void]) -> int:
    """Number of sound frames, one after the other, with which the bytes begin."""
    size = dtype.itemsize
    total = len(view) // size
    for first in range(0, total, TOGETHER):
        count = min(TOGETHER, total - first)
        sound = are_sound(view[first * size : (first + count) * size], dtype)
        if not sound.all():
            return first + int(sound.argmin())
    return total


def are_sound(view: memoryview, dtype: np.dtype[np.void]) -> NDArray[np.bool_]:
    """Whether each of the frames (n,), one after the other, has the sign, the number of channels
    and a CRC-32 that is right."""
    frames, size = np.frombuffer(view, dtype), dtype.itemsize
    sums = [zlib.crc32(view[at : at + size - 4]) for at in range(0, len(view), size)]
    sound: NDArray[np.bool_] = (frames["crc"] == sums) & (frames["sync"] == SIGN)
    sound &= frames["kind"] >> 4 == (size - SIZE) // 4
    return sound


class FixedFrames(Parser):
    """Format "frames": 64 bytes each, and 4 for each auxiliary channel, one after the other."""

    def feed(self, block: bytes) -> RawSamples:
        """Return the samples that a block completes; damaged frames are counted and skipped."""
        raw, size = self.rest + block, self.dtype.itemsize
        view = memoryview(raw)
        good: list[bytes | memoryview] = []
        place = 0
        while True:
            start = place
            place += size * sound_frames(view[place:], self.dtype)
            if place > start:
                good.append(view[start:place])
            if len(raw) - place < size:
                break
            place = self.resume(raw, view, place)
        self.rest = raw[place:]
        return samples_from(np.frombuffer(b"".join(good), self.dtype))

    def resume(self, raw: bytes, view: memoryview, place: int) -> int:
        """Return the next position at which a sound frame begins, or may begin with later bytes."""
        self.corrupt += raw.startswith(SYNC, place)
        following = place
        while True:
            following = raw.find(SYNC, following)
            if following < 0:
                following = len(raw) - (raw[-1:] == SYNC[:1])
                break
            frame = view[following : following + self.dtype.itemsize]
            if len(frame) < self.dtype.itemsize or are_sound(frame, self.dtype).all():
                break
            following += 1
        self.skipped += following - place
        return following


class CobsFrames(Parser):
    """Format "cobs": the bytes of "frames" made free of zeros, and a zero after each frame."""

    def __init__(self, channels: int = 0) -> None:
        super().__init__(channels)
        #: One byte more than the frame, since it is shorter than 254.
        self.coded = self.dtype.itemsize + 1

    def feed(self, block: bytes) -> RawSamples:
        """Return the samples that a block completes; damaged frames are counted and skipped."""
        *parts, self.rest = (self.rest + block).split(b"\0")
        complete = [part for part in parts if len(part) == self.coded]
        self.refuse([part for part in parts if part and len(part) != self.coded])
        if len(self.rest) > 4 * self.coded:  # no end in sight: not this format
            self.refuse([self.rest])
            self.rest = b""
        raw = cobs_decode(np.frombuffer(b"".join(complete), np.uint8).reshape(-1, self.coded))
        fine = are_sound(memoryview(raw.tobytes()), self.dtype)
        self.refuse([part for part, good in zip(complete, fine, strict=True) if not good])
        return samples_from(np.ascontiguousarray(raw[fine]).view(self.dtype).ravel())

    def refuse(self, parts: list[bytes]) -> None:
        """Count damaged frames and their bytes."""
        self.corrupt += len(parts)
        self.skipped += sum(len(part) + 1 for part in parts)


def cobs_decode(coded: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Decode COBS, for rows (n, size + 1) of frames shorter than 254 bytes: (n, size).

    Each code is the distance to the next one, in whose place the frame has a zero. A chain that
    does not end at the row's end leaves a row whose CRC fails.
    """
    raw = coded.copy()
    rows = np.arange(len(raw))
    place = raw[:, 0].astype(np.int64)
    while len(rows):
        inside = place < raw.shape[1]
        rows, place = rows[inside], place[inside]
        step = raw[rows, place].astype(np.int64)
        raw[rows, place] = 0
        rows, place = rows[step > 0], (place + step)[step > 0]
    return raw[:, 1:]


def cobs_encode(samples: RawSamples) -> bytes:
    """Samples in format "cobs"."""
    raw, out = pack(samples), bytearray()
    size = frame_dtype(samples.channels.shape[1]).itemsize
    for start in range(0, len(raw), size):
        for part in raw[start : start + size].split(b"\0"):
            out.append(len(part) + 1)
            out += part
        out.append(0)
    return bytes(out)


class TextLines(Parser):
    """Format "text": lines of seq,t_us,c0,...,c11, and of the auxiliary channels. There is no
    checksum: use it only for tests."""

    #: Length of a line, bytes, that no line reaches.
    LONGEST = 800

    def __init__(self, kind: int, channels: int = 0) -> None:
        super().__init__(channels)
        self.kind = kind

    def feed(self, block: bytes) -> RawSamples:
        """Return the samples of the lines that a block completes; damaged lines are counted and
        skipped."""
        *lines, self.rest = (self.rest + block).split(b"\n")
        if len(self.rest) > self.LONGEST:
            lines, self.rest = [*lines, self.rest], b""
        rows = [row for row in map(self.numbers, lines) if row is not None]
        if not rows:
            return samples_from(np.zeros(0, self.dtype))
        table = np.array([row[:14] for row in rows], dtype=np.int64)
        with np.errstate(over="ignore"):
            channels = np.array([row[14:] for row in rows], dtype=np.float32)
        none = np.zeros(len(table), np.uint8)
        return RawSamples(
            none + np.uint8(self.kind),
            none,
            table[:, 0].astype(np.uint32),
            table[:, 1].astype(np.uint32),
            table[:, 2:].astype(np.int32),
            channels,
        )

    def numbers(self, line: bytes) -> list[Any] | None:
        """The numbers of a line; None for an empty, commented or damaged line, of which the last is
        counted."""
        text = line.strip()
        if not text or text.startswith(b"#"):
            return None
        try:
            parts = text.split(b",")
            row: list[Any] = [int(part) for part in parts[:14]]
            row += [float(part) if part.strip() else np.nan for part in parts[14:]]
        except ValueError:
            row = []
        within = len(row) == 14 + self.channels and all(0 <= x < 2**32 for x in row[:2])
        if within and all(-(2**31) <= x < 2**31 for x in row[2:14]):
            return row
        self.corrupt += 1
        self.skipped += len(line) + 1
        return None


def text_encode(samples: RawSamples) -> bytes:
    """Samples in format "text"."""
    rows = np.column_stack([samples.seq, samples.time, samples.counts]).tolist()
    texts = (
        [b"%d" % x for x in row] + [b"%.9g" % x for x in values]
        for row, values in zip(rows, samples.channels.tolist(), strict=True)
    )
    return b"".join(b",".join(text) + b"\n" for text in texts)


def parser(form: str, content: str, channels: int = 0) -> Parser:
    """The parser of a format.

    form: "frames", "cobs" or "text".  content: of text, "electrodes" or "xy-sum".  channels: number
    of auxiliary channels of each sample.
    """
    if form == "text":
        return TextLines(XY_SUM if content == "xy-sum" else ELECTRODES, channels)
    return CobsFrames(channels) if form == "cobs" else FixedFrames(channels)


def encode(form: str, samples: RawSamples) -> bytes:
    """Samples as the bytes of a format: "frames", "cobs" or "text"."""
    return {"frames": pack, "cobs": cobs_encode, "text": text_encode}[form](samples)
