"""A serial line within one process."""

from __future__ import annotations


class Wire:
    """One end of a serial line, like `Pty`.  sent, received: bytes on their way to either end."""

    sent = received = b""

    def open(self) -> None:
        """Begin without bytes on their way."""
        self.sent = self.received = b""

    close = open

    def write(self, data: bytes | bytearray) -> int:
        """Send all bytes, and return their number."""
        self.sent += data
        return len(data)

    def read(self) -> bytes:
        data, self.received = self.received, b""
        return data

    def take(self) -> bytes:
        """Return the bytes that were sent, at the other end."""
        data, self.sent = self.sent, b""
        return data
