"""Sources of bytes: serial ports and pyserial's URLs, TCP, datagrams, recorded files.

Other packages add sources by entry points of the group `facets.sources`: one named `daq` opens the
ports whose names begin with `daq:`. It is called with the name and the baud rate, and returns a
`Source`.
"""

from __future__ import annotations

import errno
import socket
import time
from collections.abc import Callable
from contextlib import suppress
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any
from urllib.parse import SplitResult, parse_qsl, urlsplit

from ...core.closing import ClosedAtExit
from ...core.errors import FacetsError
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
#: Longest time that a TCP connection may take to be made, s.
CONNECT_TIMEOUT_S = 2.0
#: Another sender of datagrams is read once the present one has sent nothing for this time, s.
SENDER_SILENCE_S = 1.0
#: Options of TCP by which a connection fails within 10 s of the loss of its other end. A board that
#: lost its power closes nothing. After 5 s without data a probe is sent every second; the last
#: entry bounds the time in which sent data must be confirmed, ms. Not every system has all options.
KEEP_ALIVE = {
    "TCP_KEEPIDLE": 5, "TCP_KEEPALIVE": 5, "TCP_KEEPINTVL": 1, "TCP_KEEPCNT": 5,
    "TCP_USER_TIMEOUT": 10_000,
}  # fmt: skip


class SerialPort(ClosedAtExit):
    """A device, a pty, or a URL of pyserial such as rfc2217://host:port."""

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


class SocketPort(ClosedAtExit):
    """A board behind a network, whose address `open` understands."""

    ended = waits = False
    FORM = ""

    def __init__(self, name: str) -> None:
        self.name = name
        try:
            self.line = self.open(urlsplit(name))
        except ValueError:
            raise PortError(f"{name}: is not an address; give {self.FORM}") from None
        except OSError as error:
            raise opening_error(f"{name}: cannot be opened", str(error)) from None

    def open(self, parts: SplitResult) -> socket.socket:
        """Open the socket of an address; raises `ValueError` if it is none."""
        raise NotImplementedError

    def receive(self) -> bytes:
        """Return the next bytes that are to be read."""
        raise NotImplementedError

    def read(self) -> bytes:
        """Return all bytes that have come; raise `PortError` after them if the port is gone."""
        data, count = bytearray(), 0
        self.line.settimeout(POLL_S)
        try:
            while len(data) + count < MAX_READ_BYTES:
                data += self.receive()
                count += 1
                self.line.settimeout(0.0)
        except OSError as error:
            is_over = error.errno not in (None, errno.EAGAIN, errno.EWOULDBLOCK)
            if is_over and not data:
                raise PortError(f"{self.name}: went away: {error.strerror}") from None
        return bytes(data)

    def send(self, data: bytes) -> int:
        """Send bytes to the board; return how many the line took."""
        raise NotImplementedError

    def write(self, data: bytes) -> bool:
        """Send a few bytes to the board, from another thread; return whether the line took them."""
        with suppress(OSError):
            return self.send(data) == len(data)
        return False

    def close(self) -> None:
        self.line.close()


class ConnectionPort(SocketPort):
    """A board that serves its bytes by TCP, `socket://HOST:PORT`."""

    FORM = "socket://HOST:PORT"

    def open(self, parts: SplitResult) -> socket.socket:
        """Connect to the host and port of a URL; raises `ValueError` if one is missing, `OSError`
        if nobody answers."""
        if not parts.hostname or parts.port is None:
            raise ValueError
        line = socket.create_connection((parts.hostname, parts.port), CONNECT_TIMEOUT_S)
        keep_alive(line)
        return line

    def receive(self) -> bytes:
        """Receive bytes; raises `OSError` when the other end has closed the connection."""
        if not (data := self.line.recv(MAX_READ_BYTES)):
            raise OSError(errno.EPIPE, "its other end closed the connection")
        return data

    def send(self, data: bytes) -> int:
        """Send bytes, and return the number that was sent."""
        return self.line.send(data)


class DatagramPort(SocketPort):
    """A board that sends its frames by UDP to a port of this machine, `udp://HOST:PORT`.

    HOST is an address of this machine: 127.0.0.1 by default, so that only programs of this machine
    can send; 0.0.0.0 means all of its addresses. Each datagram holds any number of whole
    frames, whose samples are missing by `seq` if the datagram is lost. The first sender is read,
    and another one after it has sent nothing for `SENDER_SILENCE_S`; with `?from=HOST` the senders
    of this host alone, and with `?from=any` all at once.
    """

    FORM = "udp://HOST:PORT, or udp://HOST:PORT?from=HOST"
    #: Size of the system's buffer for datagrams that nobody has read yet, bytes.
    BUFFER = 1 << 22
    #: The sender that is read: host and port; when it was heard last, s.
    sender: Any = None
    heard = 0.0
    #: Number of datagrams that were dropped, and the sender of the last.
    refused, stranger = 0, ""

    def open(self, parts: SplitResult) -> socket.socket:
        """Bind the port of a URL; raises `ValueError` for a malformed one, `OSError` if the port
        cannot be bound."""
        options = dict(parse_qsl(parts.query, keep_blank_values=True))
        host = options.pop("from", "first")
        if parts.port is None or options or not host:
            raise ValueError
        self.host = host if host in ("first", "any") else socket.gethostbyname(host)
        line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, self.BUFFER)
            line.bind((parts.hostname or "127.0.0.1", parts.port))
        except OSError:
            line.close()
            raise
        return line

    def receive(self) -> bytes:
        """Return the next datagram; nothing for that of a sender that is not read."""
        data, sender = self.line.recvfrom(MAX_READ_BYTES)
        now = time.monotonic()
        is_next = self.host == "any" or now - self.heard > SENDER_SILENCE_S
        if self.host in ("first", "any", sender[0]) and (is_next or self.sender in (None, sender)):
            self.sender, self.heard = sender, now
            return data
        self.refused += 1
        self.stranger = "{}:{}".format(*sender)
        return b""

    @property
    def message(self) -> str:
        """A message about the senders; empty if there is none."""
        if self.refused:
            board = "{}:{}".format(*self.sender) if self.sender else self.host
            return (
                f"{self.refused} datagrams of other senders were dropped, the last of "
                f"{self.stranger}: {board} is read, and another sender once it is silent; "
                "?from=HOST in the port's address chooses the host"
            )
        host, port = self.line.getsockname()
        if self.sender or not host.startswith("127."):
            return ""
        return f"only this machine can send to {self.name}; udp://0.0.0.0:{port} hears all others"

    def send(self, data: bytes) -> int:
        """Send a datagram to the sender that is read; return how many bytes the line took."""
        return self.line.sendto(data, self.sender) if self.sender else 0


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
        """Read a block; empty at the end. Raises `PortError` if the file cannot be read."""
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
        if hasattr(line, "_socket"):  # of pyserial's socket:// and rfc2217://
            keep_alive(line._socket)
        return line
    except Exception as error:  # pyserial lets termios' errors, which are no OSError, pass
        raise opening_error(f"{name}: cannot be opened", str(error)) from None


def keep_alive(connection: socket.socket) -> None:
    """Have a TCP connection fail soon after its other end is gone, which may send no end."""
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for name, value in KEEP_ALIVE.items():
        with suppress(OSError, AttributeError):
            connection.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)


def opening_error(what: str, reason: str) -> PortError:
    """The error of a port that the system does not open for a reason, with its remedy."""
    text = reason.lower()
    if any(words in text for words in ("exclusively lock", "busy", "in use")):
        return PortInUse(f"{what}: another program uses it; close that program first")
    if "permission" in text:
        reason = "no permission; on Linux, join the group that owns it (dialout or uucp)"
    elif "inappropriate ioctl" in text:
        reason = "this is no serial port; to read a file of received bytes, give file:PATH"
    elif "no such file" in text or "filenotfound" in text:
        reason = "there is no such device; check that it is plugged in"
        if what.partition(":")[0].endswith("/board"):
            reason += "; for a virtual bench run `facets emulate CONFIG --motion NAME` first"
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
    if name.startswith("socket://"):
        return ConnectionPort(name)
    if (other := source_of(name)) is not None:
        return open_by_package(other, name, baud)
    return SerialPort(name, baud)


def source_of(name: str) -> EntryPoint | None:
    """The entry point of `facets.sources` that opens the port of a name, None if there is none."""
    scheme, colon, _ = name.partition(":")
    if not colon or len(scheme) < 2:  # a letter is a drive
        return None
    sources = [*entry_points(group=GROUP, name=scheme), *SHIPPED]
    return next((source for source in sources if source.name == scheme), None)


def open_by_package(source: EntryPoint, name: str, baud: int) -> Source:
    """Open a port of another package. Errors other than those of facets become a `PortError` that
    names the package; `PortInUse` if it returns no port."""
    try:
        port: Source = source.load()(name, baud)
    except FacetsError:
        raise
    except Exception as error:
        what = f"{source.value}: {type(error).__name__}: {error}"
        raise PortError(f"{name}: cannot be opened by {what}") from None
    lacks = [part for part in ("read", "close", "ended", "waits") if not hasattr(port, part)]
    if lacks:
        raise PortInUse(f"{name}: {source.value} gives no port: it has no {', '.join(lacks)}")
    return port


def await_port(
    name: str, baud: int, wait: float, on_progress: Callable[[str], None] = lambda _: None
) -> Source:
    """Open the port of a name as soon as it is there: a board that boots takes some seconds.

    on_progress: receives a sentence once, if there is something to wait for. Raises `PortError`
    after `wait` seconds; at once for a file, and for a port that another program uses.
    """
    last, is_announced = time.monotonic() + wait, False
    while True:
        try:
            return open_port(name, baud)
        except PortInUse:
            raise
        except PortError as error:
            if name.startswith("file:") or time.monotonic() >= last:
                raise
            if not is_announced:
                on_progress(f"{error}. Waiting up to {wait:g} s for it.")
                is_announced = True
            time.sleep(RETRY_INTERVAL_S)
