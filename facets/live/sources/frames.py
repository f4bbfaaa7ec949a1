"""What a detector board sends: three formats, parsed in blocks, made again after noise.

Every format carries the same sample: seq (u32), t_us (u32), and 12 counts (i32), four a detector.
docs/formats.md describes the bytes for those who write firmware.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

SYNC = b"\xa5\x5a"
FRAME = np.dtype(
    [
        ("sync", "<u2"),
        ("kind", "u1"),
        ("flags", "u1"),
        ("seq", "<u4"),
        ("time", "<u4"),
        ("counts", "<i4", 12),
        ("crc", "<u4"),
    ]
)
SIZE = FRAME.itemsize
SIGN = int.from_bytes(SYNC, "little")
#: Frames that are checked together: after a spoilt one, no more than so many are checked again.
TOGETHER = 64
#: Kinds of frames: the counts of four electrodes a detector, or X, Y, SUM and one spare; or a pose
#: that the board has solved (`board_poses`), with the number of the sample that it belongs to.
ELECTRODES, XY_SUM, POSE = 1, 2, 3
#: Bits of `flags`: the board lost samples before this one; a converter was at its end; its input
#: for a trigger or a PPS signal had an edge since the sample before; its input for a permit is on,
#: so that the stage may move.
OVERRUN, SATURATED, MARK, PERMIT = 1, 2, 4, 8


@dataclass(frozen=True)
class Samples:
    """Samples in the order in which they came.

    kind, flags: (n,) uint8.  seq, time: (n,) uint32, as sent.  counts: (n, 12) int32.
    """

    kind: NDArray[np.uint8]
    flags: NDArray[np.uint8]
    seq: NDArray[np.uint32]
    time: NDArray[np.uint32]
    counts: NDArray[np.int32]

    def __len__(self) -> int:
        return len(self.seq)

    def where(self, keep: NDArray[np.bool_] | slice) -> Samples:
        return Samples(
            self.kind[keep], self.flags[keep], self.seq[keep], self.time[keep], self.counts[keep]
        )


class Parser(Protocol):
    """Turns blocks of bytes into samples. corrupt: frames refused; skipped: bytes passed over."""

    corrupt: int
    skipped: int

    def feed(self, block: bytes) -> Samples: ...


def pack(samples: Samples) -> bytes:
    """Samples as fixed frames."""
    frames = np.zeros(len(samples), FRAME)
    frames["sync"] = SIGN
    for name in ("kind", "flags", "seq", "time", "counts"):
        frames[name] = getattr(samples, name)
    raw = bytearray(frames.tobytes())
    view = memoryview(raw)
    for start in range(0, len(raw), SIZE):
        crc = zlib.crc32(view[start : start + SIZE - 4])
        raw[start + SIZE - 4 : start + SIZE] = crc.to_bytes(4, "little")
    return bytes(raw)


def samples_from(frames: NDArray[np.void]) -> Samples:
    kind, flags, seq, time, counts = (
        np.array(frames[name]) for name in ("kind", "flags", "seq", "time", "counts")
    )
    return Samples(kind, flags, seq, time, counts)


def no_samples() -> Samples:
    return samples_from(np.zeros(0, FRAME))


def is_sound(frame: memoryview | bytes) -> bool:
    """Whether a frame's CRC-32 is that of its bytes."""
    return zlib.crc32(frame[: SIZE - 4]) == int.from_bytes(frame[SIZE - 4 :], "little")


def sound_frames(view: memoryview) -> int:
    """How many sound frames, one after the other, the bytes begin with."""
    whole = len(view) // SIZE
    for first in range(0, whole, TOGETHER):
        count = min(TOGETHER, whole - first)
        sound = are_sound(view[first * SIZE : (first + count) * SIZE])
        if not sound.all():
            return first + int(sound.argmin())
    return whole


def are_sound(view: memoryview) -> NDArray[np.bool_]:
    """Of frames, one after the other, which have the sign and their CRC-32."""
    frames = np.frombuffer(view, FRAME)
    sums = [zlib.crc32(view[at : at + SIZE - 4]) for at in range(0, len(view), SIZE)]
    sound: NDArray[np.bool_] = (frames["crc"] == sums) & (frames["sync"] == SIGN)
    return sound


class FixedFrames:
    """Format "frames": 64 bytes each, one after the other."""

    def __init__(self) -> None:
        self.rest = b""
        self.corrupt = self.skipped = 0

    def feed(self, block: bytes) -> Samples:
        raw = self.rest + block
        view = memoryview(raw)
        good: list[bytes | memoryview] = []
        place = 0
        while True:
            start = place
            place += SIZE * sound_frames(view[place:])
            if place > start:
                good.append(view[start:place])
            if len(raw) - place < SIZE:
                break
            place = self.resume(raw, view, place)
        self.rest = raw[place:]
        return samples_from(np.frombuffer(b"".join(good), FRAME)) if good else no_samples()

    def resume(self, raw: bytes, view: memoryview, place: int) -> int:
        """Where a sound frame begins again, or may begin in what has not come yet."""
        self.corrupt += raw.startswith(SYNC, place)
        following = place + 1
        while True:
            following = raw.find(SYNC, following)
            if following < 0:
                following = len(raw) - (raw[-1:] == SYNC[:1])
                break
            if len(raw) - following < SIZE or is_sound(view[following : following + SIZE]):
                break
            following += 1
        self.skipped += following - place
        return following


class CobsFrames:
    """Format "cobs": the same 64 bytes, made free of zeros, each ended by a zero."""

    #: One byte more than the frame, since it is shorter than 254.
    CODED = SIZE + 1

    def __init__(self) -> None:
        self.rest = b""
        self.corrupt = self.skipped = 0

    def feed(self, block: bytes) -> Samples:
        *parts, self.rest = (self.rest + block).split(b"\0")
        whole = [part for part in parts if len(part) == self.CODED]
        self.refuse([part for part in parts if part and len(part) != self.CODED])
        if len(self.rest) > 4 * self.CODED:  # no end in sight: not this format
            self.refuse([self.rest])
            self.rest = b""
        if not whole:
            return no_samples()
        raw = cobs_decode(np.frombuffer(b"".join(whole), np.uint8).reshape(-1, self.CODED))
        fine = [row.startswith(SYNC) and is_sound(row) for row in map(bytes, raw)]
        self.refuse([part for part, good in zip(whole, fine, strict=True) if not good])
        kept = np.ascontiguousarray(raw[np.array(fine)])
        return samples_from(kept.view(FRAME).ravel())

    def refuse(self, parts: list[bytes]) -> None:
        self.corrupt += len(parts)
        self.skipped += sum(len(part) + 1 for part in parts)


def cobs_decode(coded: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """COBS undone, for rows (n, 65) of frames shorter than 254 bytes: (n, 64).

    Each code says how far the next one is; in the frame, a zero stands there. A chain that does not
    end at the row's end leaves a row whose CRC fails.
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


def cobs_encode(samples: Samples) -> bytes:
    """Samples in format "cobs"."""
    raw, out = pack(samples), bytearray()
    for start in range(0, len(raw), SIZE):
        for part in raw[start : start + SIZE].split(b"\0"):
            out.append(len(part) + 1)
            out += part
        out.append(0)
    return bytes(out)


class TextLines:
    """Format "text": lines of seq,t_us,c0,...,c11. There is no checksum: use it to try things."""

    #: A line is never so long.
    LONGEST = 400

    def __init__(self, kind: int) -> None:
        self.kind = kind
        self.rest = b""
        self.corrupt = self.skipped = 0

    def feed(self, block: bytes) -> Samples:
        *lines, self.rest = (self.rest + block).split(b"\n")
        if len(self.rest) > self.LONGEST:
            lines, self.rest = [*lines, self.rest], b""
        rows = [row for row in map(self.numbers, lines) if row is not None]
        if not rows:
            return no_samples()
        table = np.array(rows, dtype=np.int64)
        none = np.zeros(len(table), np.uint8)
        return Samples(
            none + np.uint8(self.kind),
            none,
            table[:, 0].astype(np.uint32),
            table[:, 1].astype(np.uint32),
            table[:, 2:].astype(np.int32),
        )

    def numbers(self, line: bytes) -> list[int] | None:
        text = line.strip()
        if not text or text.startswith(b"#"):
            return None
        try:
            row = [int(part) for part in text.split(b",")]
        except ValueError:
            row = []
        within = len(row) == 14 and all(0 <= x < 2**32 for x in row[:2])
        if within and all(-(2**31) <= x < 2**31 for x in row[2:]):
            return row
        self.corrupt += 1
        self.skipped += len(line) + 1
        return None


def text_encode(samples: Samples) -> bytes:
    """Samples in format "text"."""
    rows = np.column_stack([samples.seq, samples.time, samples.counts])
    return b"".join(b",".join(b"%d" % x for x in row) + b"\n" for row in rows.tolist())


def parser(form: str, content: str) -> Parser:
    """form: "frames", "cobs" or "text". content: of text, "electrodes" or "xy-sum"."""
    if form == "text":
        return TextLines(XY_SUM if content == "xy-sum" else ELECTRODES)
    return CobsFrames() if form == "cobs" else FixedFrames()


def encode(form: str, samples: Samples) -> bytes:
    """Samples as the bytes of a format: "frames", "cobs" or "text"."""
    return {"frames": pack, "cobs": cobs_encode, "text": text_encode}[form](samples)
