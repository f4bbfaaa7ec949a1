"""A serial line between two programs on one machine."""

from __future__ import annotations

import os
from pathlib import Path

from ...core.errors import OutputError


class Pty:
    """One end of a serial line.

    link: path that always links to the line's other end, whose name changes.
    """

    def __init__(self, link: Path) -> None:
        self.link = link
        self.open()

    def open(self) -> None:
        """Open the line, and link its other end to the path; raises `OutputError` if that cannot be
        made."""
        import termios  # not on Windows
        import tty

        self.end, self.other = os.openpty()
        tty.setraw(self.other, termios.TCSANOW)
        os.set_blocking(self.end, False)
        self.name = os.ttyname(self.other)
        try:
            self.link.unlink(missing_ok=True)
            self.link.symlink_to(self.name)
        except OSError as error:
            raise OutputError(f"{self.link}: cannot be made: {error.strerror}") from None

    def close(self) -> None:
        self.link.unlink(missing_ok=True)
        os.close(self.end)
        os.close(self.other)

    def write(self, data: bytes | bytearray) -> int:
        """Send as many bytes as the line takes now, and return their number."""
        try:
            return os.write(self.end, data)
        except OSError:  # full, or the other end is just being opened or closed
            return 0

    def read(self) -> bytes:
        """The bytes that have come; empty if there are none or the other end is closed."""
        try:
            return os.read(self.end, 4096)
        except OSError:
            return b""
