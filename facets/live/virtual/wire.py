"""A serial line within one process."""

from __future__ import annotations


class Wire:
    """One end of a serial line, like `Pty`.  sent, received: bytes on their way to either end."""

    def __init__(self) -> None:
        self.open()

    def open(self) -> None:
        self.sent, self.received = bytearray(), bytearray()

    def close(self) -> None:
        self.open()

    def write(self, data: bytes | bytearray) -> int:
        """Send all bytes, and return their number."""
        self.sent += data
        return len(data)

    def read(self) -> bytes:
        data, self.received = bytes(self.received), bytearray()
        return data

    def take(self) -> bytes:
        """Return what was sent, at the other end."""
        data, self.sent = bytes(self.sent), bytearray()
        return data
