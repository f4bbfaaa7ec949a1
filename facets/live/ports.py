"""Where bytes come from: serial ports and sockets by pyserial's URLs, and recorded files."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol, Self

from ..core.errors import FacetsError

#: A read waits no longer than this for more, s: blocks are then as long.
POLL = 0.003
MOST = 65_536
#: Between attempts to open a port, s.
AGAIN = 0.1
IN_USE = "another program has it; close that first"


class PortError(FacetsError):
    """A port that can not be opened, or that went away."""


class PortInUse(PortError):
    """A port that another program has: no waiting helps."""


class Port(Protocol):
    """A source of bytes. ended: nothing more will ever come.  waits: nothing is lost while it is
    not read."""

    ended: bool
    waits: bool

    def read(self) -> bytes: ...

    def close(self) -> None: ...


class Closing:
    """A port in a `with` statement is closed at its end."""

    def close(self) -> None: ...

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        self.close()


class SerialPort(Closing):
    """A device, a pty, or a URL such as socket://host:port."""

    ended = waits = False

    def __init__(self, name: str, baud: int) -> None:
        self.name = name
        self.line = open_line(name, baud, POLL)

    def read(self) -> bytes:
        """What came, at once or after POLL; nothing is no error, a port that is gone is."""
        try:
            block: bytes = self.line.read(MOST)
        except Exception as error:  # pyserial's own, and what the system's driver raises through it
            raise PortError(f"{self.name}: went away: {error}") from None
        return block

    def close(self) -> None:
        self.line.close()


class FilePort(Closing):
    """A recorded file of bytes, `file:PATH`, read as fast as it can be solved."""

    waits = True

    def __init__(self, name: str) -> None:
        path = Path(name.removeprefix("file:"))
        try:
            self.file = path.open("rb")
        except OSError as error:
            raise PortError(f"{path}: can not be read: {error.strerror}") from None
        self.path, self.ended = path, False

    def read(self) -> bytes:
        try:
            block = self.file.read(MOST)
        except OSError as error:
            raise PortError(f"{self.path}: can not be read: {error.strerror}") from None
        self.ended = not block
        return block

    def close(self) -> None:
        self.file.close()


def open_line(name: str, baud: int, timeout: float) -> Any:
    """An open pyserial port, or a message that says what to do."""
    import serial

    try:
        line = serial.serial_for_url(name, baudrate=baud, timeout=timeout, do_not_open=True)
        if "://" not in name:
            line.exclusive = True
        line.open()
        return line
    except Exception as error:  # pyserial lets termios' errors, which are no OSError, pass
        reason = advice(str(error))
        kind = PortInUse if reason == IN_USE else PortError
        raise kind(f"{name}: can not be opened: {reason}") from None


def advice(reason: str) -> str:
    """What to do about an error of the system."""
    text = reason.lower()
    if "exclusively lock" in text or "busy" in text:
        return IN_USE
    if "permission" in text:
        return "no permission; on Linux, join the group that owns it (dialout or uucp)"
    if "no such file" in text or "filenotfound" in text:
        return "there is no such device; is it plugged in?"
    return reason


def open_port(name: str, baud: int) -> Port:
    """The port of a name, now; raises `PortError` where it can not be opened."""
    return FilePort(name) if name.startswith("file:") else SerialPort(name, baud)


def await_port(
    name: str, baud: int, wait: float, tell: Callable[[str], None] = lambda _: None
) -> Port:
    """The port of a name, as soon as it is there: a board that boots takes some seconds.

    tell: is told once, in words, if there is something to wait for. Raises `PortError` after `wait`
    seconds; at once for a file, and for a port that another program has.
    """
    last, told = time.monotonic() + wait, False
    while True:
        try:
            return open_port(name, baud)
        except PortInUse:
            raise
        except PortError as error:
            if name.startswith("file:") or time.monotonic() >= last:
                raise
            if not told:
                tell(f"{error} Waiting up to {wait:g} s for it.")
                told = True
            time.sleep(AGAIN)
