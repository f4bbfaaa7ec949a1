"""Sources of bytes: serial ports and sockets by pyserial's URLs, datagrams, recorded files.

Other packages add sources by entry points of the group `facets.sources`: one named `daq` opens the
ports whose names begin with `daq:`. It is called with the name and the baud rate, and returns a
`Source`.
"""

from __future__ import annotations

import errno
import socket
import time
from collections.abc import Callable
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from ...core.closing import ClosedAtExit
from .source import MAX_READ_BYTES, POLL_S, PortError, PortInUse, Source

#: Group of the entry points by which other packages bring ports.
GROUP = "facets.sources"
#: Entry points of the shipped sources that need an extra.
SHIPPED = (
    EntryPoint("ni", "facets.live.sources.ni_card:Card", GROUP),
    EntryPoint("thorlabs", "facets.live.sources.thorlabs_heads:Heads", GROUP),
)
#: The beginning of the names of ports that are benches in the process of a run, on its clock.
VIRTUAL = "virtual:"
#: Time between attempts to open a port, s.
RETRY_INTERVAL_S = 0.1


class SerialPort(ClosedAtExit):
    """A device, a pty, or a URL such as socket://host:port."""

    ended = waits = False

    def __init__(self, name: str, baud: int) -> None:
        self.name = name
        self.line = open_line(name, baud, POLL_S)
        self.line.write_timeout = POLL_S

    def read(self) -> bytes:
        """Return the bytes that came, at once or after POLL_S; raise `PortError` if the port is
        gone."""
        try:
            block: bytes = self.line.read(MAX_READ_BYTES)
        except Exception as error:  # pyserial's own, and what the system's driver raises through it
            raise PortError(f"{self.name}: went away: {error}") from None
        return block

    def write(self, data: bytes) -> bool:
        """Send a few bytes to the board, from another thread; return whether the line took them."""
        try:
            return bool(self.line.write(data) == len(data))
        except Exception:
            return False

    def close(self) -> None:
        self.line.close()


class DatagramPort(ClosedAtExit):
    """A board that sends its frames by UDP to a port of this machine, `udp://:PORT`.

    A host before the colon binds that address alone. Each datagram holds any number of whole
    frames, whose samples are missing by `seq` if the datagram is lost.
    """

    ended = waits = False
    #: Size of the system's buffer for datagrams that nobody has read yet, bytes.
    BUFFER = 1 << 22

    def __init__(self, name: str) -> None:
        parts = urlsplit(name)
        try:
            if parts.port is None:
                raise ValueError
            self.line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            self.line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, self.BUFFER)
            self.line.bind((parts.hostname or "", parts.port))
        except ValueError:
            raise PortError(f"{name}: is not an address to listen at; give udp://:PORT") from None
        except OSError as error:
            self.line.close()
            kind = PortInUse if error.errno == errno.EADDRINUSE else PortError
            raise kind(f"{name}: cannot be opened: {error.strerror or error}") from None
        self.name = name
        self.sender: Any = None
        self.line.settimeout(POLL_S)

    def read(self) -> bytes:
        """Return the bytes of all datagrams that have come."""
        parts: list[bytes] = []
        size = 0
        try:
            while size < MAX_READ_BYTES:
                data, self.sender = self.line.recvfrom(MAX_READ_BYTES)
                parts.append(data)
                size += len(parts[-1])
                self.line.settimeout(0.0)
        except (TimeoutError, BlockingIOError):
            pass
        except OSError as error:
            raise PortError(f"{self.name}: went away: {error.strerror or error}") from None
        finally:
            self.line.settimeout(POLL_S)
        return b"".join(parts)

    def write(self, data: bytes) -> bool:
        """Send a datagram to the sender of the last one; return whether that was possible."""
        try:
            return self.sender is not None and self.line.sendto(data, self.sender) == len(data)
        except OSError:
            return False

    def close(self) -> None:
        self.line.close()


class FilePort(ClosedAtExit):
    """A recorded file of bytes, `file:PATH`, read as fast as it can be solved."""

    waits = True

    def __init__(self, name: str) -> None:
        path = Path(name.removeprefix("file:"))
        try:
            self.file = path.open("rb")
        except OSError as error:
            raise PortError(f"{path}: cannot be read: {error.strerror}") from None
        self.path, self.ended = path, False

    def read(self) -> bytes:
        try:
            block = self.file.read(MAX_READ_BYTES)
        except OSError as error:
            raise PortError(f"{self.path}: cannot be read: {error.strerror}") from None
        self.ended = not block
        return block

    def close(self) -> None:
        self.file.close()


def open_line(name: str, baud: int, timeout: float) -> Any:
    """Open a pyserial port; raises `PortError` with a remedy if that fails."""
    import serial

    try:
        line = serial.serial_for_url(name, baudrate=baud, timeout=timeout, do_not_open=True)
        if "://" not in name:
            line.exclusive = True
        line.open()
        return line
    except Exception as error:  # pyserial lets termios' errors, which are no OSError, pass
        raise opening_error(f"{name}: cannot be opened", str(error)) from None


def opening_error(what: str, reason: str) -> PortError:
    """The error of a port that the system does not open for a reason, with its remedy."""
    text = reason.lower()
    if "exclusively lock" in text or "busy" in text:
        return PortInUse(f"{what}: another program uses it; close that program first")
    if "permission" in text:
        reason = "no permission; on Linux, join the group that owns it (dialout or uucp)"
    elif "inappropriate ioctl" in text:
        reason = "this is no serial port; to read a file of received bytes, give file:PATH"
    elif "no such file" in text or "filenotfound" in text:
        reason = "there is no such device; check that it is plugged in"
    return PortError(f"{what}: {reason}")


def open_port(name: str, baud: int) -> Source:
    """Open the port of a name; raises `PortError` if it cannot be opened."""
    if name.startswith("file:"):
        return FilePort(name)
    if name.startswith(VIRTUAL):
        raise PortInUse(
            f"{name}: virtual benches are opened by `facets acquire` and facets.live.Run"
        )
    if name.startswith("udp://"):
        return DatagramPort(name)
    if (other := source_of(name)) is not None:
        return open_by_package(other, name, baud)
    return SerialPort(name, baud)


def source_of(name: str) -> EntryPoint | None:
    """The entry point of `facets.sources` that opens the port of a name, if there is one."""
    scheme, colon, _ = name.partition(":")
    if not colon or len(scheme) < 2:  # a letter is a drive
        return None
    sources = [*entry_points(group=GROUP, name=scheme), *SHIPPED]
    return next((source for source in sources if source.name == scheme), None)


def open_by_package(source: EntryPoint, name: str, baud: int) -> Source:
    """Open a port of another package, which errors other than `PortError` name."""
    try:
        port: Source = source.load()(name, baud)
    except PortError:
        raise
    except Exception as error:
        what = f"{source.value}: {type(error).__name__}: {error}"
        raise PortError(f"{name}: cannot be opened by {what}") from None
    lacks = [part for part in ("read", "close", "ended", "waits") if not hasattr(port, part)]
    if lacks:
        raise PortInUse(f"{name}: {source.value} gives no port: it has no {', '.join(lacks)}")
    return port


def await_port(
    name: str, baud: int, wait: float, tell: Callable[[str], None] = lambda _: None
) -> Source:
    """Open the port of a name as soon as it is there: a board that boots takes some seconds.

    tell: receives a sentence once, if there is something to wait for. Raises `PortError` after
    `wait` seconds; at once for a file, and for a port that another program uses.
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
                tell(f"{error}. Waiting up to {wait:g} s for it.")
                told = True
            time.sleep(RETRY_INTERVAL_S)
