"""The external permit for every motion, and the heartbeat that shows that the loop runs.

A permit comes by the flag 8 of the detector board's frames, by an input of a card of National
Instruments, or by a file. A heartbeat is sent to the board's port, to an output of such a card, or
to a file: only while the loop runs, and only while the stage may move.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from ..core.extras import require_extra
from .stage import StageError

#: Time between two heartbeats, s; a board should stop the stage after five missing heartbeats.
HEARTBEAT_INTERVAL_S = 0.02
#: Time for which heartbeats must have allowed motion before the first command, s: a relay and a
#: controller need a while to enable the stage.
ENABLE_S = 0.1
#: Format of a heartbeat: sign, kind, flags, count; then the CRC-32 of these 8 bytes.
HEARTBEAT = struct.Struct("<2sBBII")
SIGN, KIND, MAY_MOVE = b"\xa5\x5a", 4, 1


def heartbeat_frame(count: int, may_move: bool) -> bytes:
    """The 12 bytes of a heartbeat.

    >>> heartbeat_frame(7, True).hex(" ")
    'a5 5a 04 01 07 00 00 00 49 5f 92 3e'
    """
    head = HEARTBEAT.pack(SIGN, KIND, MAY_MOVE if may_move else 0, count % 2**32, 0)[:-4]
    return head + zlib.crc32(head).to_bytes(4, "little")


class Permit:
    """Permission for the stage to move, which this one always gives.

    was_lost: whether the permit was found missing at any time since somebody resumed.
    """

    was_lost = False

    def read(self, now: float) -> bool | None:
        """Whether the permit is given now; None while that is unknown. Raises `StageError` if it
        cannot be read."""
        return True

    def allows_motion(self, now: float) -> bool | None:
        """Read the permit; False from its first loss on, even if it has come back. None while that
        is unknown."""
        is_on = self.read(now)
        self.was_lost |= is_on is False
        return False if self.was_lost else is_on


#: The permit of a stage without an external one.
ALWAYS = Permit()


class BoardPermit(Permit):
    """The flag of the newest samples, while they are fresh; every sample that arrived counts."""

    def __init__(self, stale: float) -> None:
        self.stale, self.time, self.on = stale, -math.inf, False

    def take(self, time: float, on: bool) -> None:
        """Take the flags of samples, the last of which has the time `time`, s; on: all are set."""
        self.was_lost |= not on
        self.time, self.on = time, on

    def read(self, now: float) -> bool | None:
        """The flag of the newest samples, while they are fresh; None when they are older."""
        return self.on if now - self.time <= self.stale else None


class FilePermit(Permit):
    """A file that contains 1; any other content and a missing file forbid motion."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def read(self, now: float) -> bool | None:
        """Whether the file contains 1; False if it cannot be read."""
        try:
            return self.path.read_bytes().strip() == b"1"
        except OSError:
            return False


class CardLine(Permit):
    """A digital line of a card. Not tested on a card: written from the maker's documentation."""

    def __init__(self, name: str, is_output: bool) -> None:
        nidaqmx = require_extra("nidaqmx", name)
        try:
            self.task = nidaqmx.Task()
            channels = self.task.do_channels if is_output else self.task.di_channels
            add = channels.add_do_chan if is_output else channels.add_di_chan
            add(name.partition(":")[2])
        except Exception as error:  # also if the maker's driver is not installed
            raise StageError(f"{name}: cannot be opened: {error}") from None
        self.name, self.high = name, False

    def read(self, now: float) -> bool | None:
        """Whether the input is high. Raises `StageError` if it cannot be read."""
        try:
            return bool(self.task.read())
        except Exception as error:
            raise StageError(f"{self.name}: cannot be read: {error}") from None

    def toggle(self) -> bool:
        """Switch the output to its other level."""
        self.high = not self.high
        self.task.write(self.high)
        return True

    def close(self) -> None:
        with suppress(Exception):
            self.task.close()


def open_permit(name: str, stale: float) -> Permit:
    """Open the permit of a name. Raises `StageError` if a card is not available."""
    kind, _, place = name.partition(":")
    if kind == "board":
        return BoardPermit(stale)
    return FilePermit(Path(place)) if kind == "file" else CardLine(name, is_output=False)


class Heartbeat:
    """A sign of life that is sent repeatedly.

    to_board: sends bytes to the board, and returns whether that was possible.
    """

    def __init__(self, name: str) -> None:
        kind, _, place = name.partition(":")
        self.kind, self.path = kind, Path(place)
        self.card = CardLine(name, is_output=True) if kind == "ni" else None
        self.to_board: Callable[[bytes], bool] = lambda _: False
        self.count, self.due, self.since = 0, -math.inf, math.inf
        self.is_sent = False

    def beat(self, now: float, may_move: bool) -> None:
        """Send a heartbeat if due. A line or a file stays unchanged while motion is forbidden."""
        if not may_move:
            self.since = math.inf
        elif self.since > now:
            self.since = self.due = now
        if now < self.due:
            return
        self.due = now + HEARTBEAT_INTERVAL_S
        self.count += 1
        try:
            self.is_sent = self.send(may_move)
        except Exception:  # after any failure the stage may not move
            self.is_sent = False
        if not self.is_sent:
            self.since = math.inf

    def is_heard(self, now: float) -> bool:
        """Whether the receiver has had the time to enable the stage."""
        return self.is_sent and now - self.since >= ENABLE_S

    def send(self, may_move: bool) -> bool:
        """Send a heartbeat to the board or, if the stage may move, toggle the output or count in
        the file; return whether it was sent."""
        if self.kind == "board":
            return self.to_board(heartbeat_frame(self.count, may_move))
        if not may_move:
            return True
        if self.card:
            return self.card.toggle()
        self.path.write_text(f"{self.count}\n", "utf-8")
        return True


def close_line(line: Any) -> None:
    """Close the card of a permit or a heartbeat, if it has one."""
    card = getattr(line, "card", line)
    if isinstance(card, CardLine):
        card.close()
