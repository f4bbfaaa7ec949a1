"""Where bytes come from: serial ports and sockets by pyserial's URLs, and recorded files."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol

from ..core.errors import FacetsError

#: A read waits no longer than this for more, s: blocks are then as long.
POLL = 0.003
MOST = 65_536


class PortError(FacetsError):
    """A port that can not be opened, or that went away."""


class Port(Protocol):
    """A source of bytes. ended: nothing more will ever come."""

    ended: bool

    def read(self) -> bytes: ...

    def close(self) -> None: ...


class SerialPort:
    """A device, a pty, or a URL such as socket://host:port."""

    ended = False

    def __init__(self, name: str, baud: int) -> None:
        self.name = name
        self.line = opened(name, baud, POLL)

    def read(self) -> bytes:
        import serial

        try:
            block: bytes = self.line.read(MOST)
        except (serial.SerialException, OSError, TypeError) as error:
            raise PortError(f"{self.name}: went away: {error}") from None
        return block

    def close(self) -> None:
        self.line.close()


class FilePort:
    """A recorded file of bytes, `file:PATH`, read as fast as it can be solved."""

    def __init__(self, name: str) -> None:
        path = Path(name.removeprefix("file:"))
        try:
            self.file = path.open("rb")
        except OSError as error:
            raise PortError(f"{path}: can not be read: {error.strerror}") from None
        self.ended = False

    def read(self) -> bytes:
        block = self.file.read(MOST)
        self.ended = not block
        return block

    def close(self) -> None:
        self.file.close()


def opened(name: str, baud: int, timeout: float) -> Any:
    """An open pyserial port, or a message that says what to do."""
    import serial

    try:
        line = serial.serial_for_url(name, baudrate=baud, timeout=timeout, do_not_open=True)
        if "://" not in name:
            line.exclusive = True
        line.open()
        return line
    except (serial.SerialException, OSError, ValueError) as error:
        raise PortError(f"{name}: can not be opened: {advice(str(error))}") from None


def advice(reason: str) -> str:
    text = reason.lower()
    if "exclusively lock" in text or "busy" in text:
        return "another program has it; close that first"
    if "permission" in text:
        return "no permission; on Linux, join the group that owns it (dialout or uucp)"
    if "no such file" in text or "filenotfound" in text:
        return "there is no such device; is it plugged in?"
    return reason


def open_port(name: str, baud: int) -> Port:
    return FilePort(name) if name.startswith("file:") else SerialPort(name, baud)
