"""The other end of a publication: a process that gives samples to those who want them.

`python -m facets.live.streams.senders ADDRESS` reads rows from its standard input, each lot after
its length, and tells on its standard output, in lines of JSON, what became of them. It is a process
of its own, so that neither making text nor a slow receiver takes time from the loop.
"""

from __future__ import annotations

import json
import socket
import sys
import threading
import time
from collections.abc import Callable
from typing import Any, BinaryIO, Protocol
from urllib.parse import urlsplit

import numpy as np
from numpy.typing import NDArray

from ...core.errors import FacetsError, InputError
from ...core.extras import require_extra
from .addresses import check_address, options_of
from .json_rows import json_of
from .lots import lots
from .sample_rows import HEAD as HEAD_COLUMNS
from .sample_rows import SAMPLE, sample_dtype, unit_of
from .zeromq import ZmqSender

#: The parent is told what became of the samples this often, s.
REPORT_INTERVAL_S = 0.25
#: Bytes of one datagram: what every network takes whole, and what one machine does.
NETWORK_BYTES, LOCAL_BYTES = 1_400, 8_192

Rows = NDArray[np.void]


class Sender(Protocol):
    """Gives rows away."""

    @property
    def receivers(self) -> int | None:
        """Number of receivers now; None where that cannot be known."""
        ...

    @property
    def missed_count(self) -> int:
        """Number of rows that receivers have told that they missed."""
        ...

    def send(self, rows: Rows) -> int:
        """Send rows; return how many were given away."""
        ...

    def close(self) -> None: ...


class Udp:
    """Datagrams of JSON to one address.

    A datagram is an array of samples, each with its `timestamp`, as the UDP server of PlotJuggler
    takes it; with `?single` an object each, as its older versions do.
    """

    missed_count = 0

    def __init__(self, host: str, port: int, options: dict[str, str]) -> None:
        kind = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
        self.line = socket.socket(kind[0], socket.SOCK_DGRAM)
        self.line.connect(kind[4])
        near = str(kind[4][0]).startswith("127.") or kind[4][0] == "::1"
        self.most = int(options.get("bytes", LOCAL_BYTES if near else NETWORK_BYTES))
        self.single = "single" in options

    @property
    def receivers(self) -> None:
        return None

    def send(self, rows: Rows) -> int:
        return sum(count for data, count in self.datagrams(rows) if self.put(data))

    def put(self, data: bytes) -> bool:
        """False where the other machine says that nobody listens, or this one has no way there."""
        try:
            self.line.send(data)
        except OSError:
            return False
        return True

    def datagrams(self, rows: Rows) -> list[tuple[bytes, int]]:
        """Their bytes, and how many samples are in each."""
        texts = json_of(rows)
        each = 1 if self.single else max(1, self.most // (max(map(len, texts)) + 1))
        if self.single:
            return [(text.encode(), 1) for text in texts]
        lots = [texts[start : start + each] for start in range(0, len(texts), each)]
        return [(f"[{','.join(lot)}]".encode(), len(lot)) for lot in lots]

    def close(self) -> None:
        self.line.close()


class Lsl:
    """An outlet of the Lab Streaming Layer, with names and units of its channels."""

    missed_count = 0

    def __init__(self, name: str, about: dict[str, Any], wait: float) -> None:
        pylsl = require_extra("pylsl", f"lsl:{name}")
        names = tuple(name for name, _ in about.get("dtype", ())) or SAMPLE.names or ()
        self.channels = ("seq", "status", "flags", *names[len(HEAD_COLUMNS) :])
        auxiliary = about.get("channels", ())
        own = {channel["column"] for channel in auxiliary}
        source = f"facets-{about.get('config_sha256', '')[:16]}"
        info = pylsl.StreamInfo(
            name or "facets", "Pose", len(self.channels), pylsl.IRREGULAR_RATE, "double64", source
        )
        channels = info.desc().append_child("channels")
        for label in self.channels:
            channel = channels.append_child("channel")
            channel.append_child_value("label", label)
            channel.append_child_value("unit", unit_of(label, auxiliary))
            known = ("seq", "status", "flags", "residual")
            kind = "Status" if label in known else "Auxiliary" if label in own else "Pose"
            channel.append_child_value("type", kind)
        for key in ("config", "config_sha256", "facets", "object", "zero"):
            info.desc().append_child_value(key, str(about.get(key, "")))
        self.outlet = pylsl.StreamOutlet(info, chunk_size=100, max_buffered=60)
        # both count from the start of this machine where it can be; else the offset is known here
        self.offset = pylsl.local_clock() - time.monotonic()
        self.until = time.monotonic() + wait

    @property
    def receivers(self) -> int:
        return int(self.outlet.have_consumers())

    def send(self, rows: Rows) -> int:
        if self.until > time.monotonic() and not self.outlet.have_consumers():
            self.outlet.wait_for_consumers(self.until - time.monotonic())
            self.until = 0.0
        heard = self.outlet.have_consumers()
        values = np.column_stack([rows[name].astype(float) for name in self.channels])
        self.outlet.push_chunk(values.tolist(), (rows["host_s"] + self.offset).tolist())
        return len(rows) if heard else 0

    def close(self) -> None:
        """Leaves what was pushed last the time to go."""
        last = time.monotonic() + 1.0
        while self.outlet.have_consumers() and time.monotonic() < last:
            time.sleep(0.05)


def open_sender(address: str, about: dict[str, Any], wait: float) -> Sender:
    """The sender of an address. wait: s, for a first receiver, where there can be none yet."""
    check_address(address)
    parts = urlsplit(address)
    try:
        if parts.scheme == "lsl":
            return Lsl(parts.path, about, wait)
        if parts.scheme == "zmq":
            return ZmqSender(address, about, wait)
        assert parts.hostname is not None
        assert parts.port is not None
        return Udp(parts.hostname, parts.port, options_of(address))
    except OSError as error:
        raise InputError(f"--publish {address}: {error.strerror or error}") from None


def serve(
    sender: Sender,
    stream: BinaryIO,
    dtype: np.dtype[np.void],
    tell: Callable[[dict[str, Any]], None],
) -> None:
    """Gives away what comes on the stream until it ends; tells every now and then how it goes.

    dtype: of the rows.
    """
    sent = dropped = 0
    ended = threading.Event()

    def report() -> None:
        words: dict[str, Any] = {"sent": sent, "dropped": dropped, "receivers": sender.receivers}
        words["lost"] = sender.missed_count
        tell(words)

    def report_often() -> None:
        while not ended.wait(REPORT_INTERVAL_S):
            report()

    reporter = threading.Thread(target=report_often)
    reporter.start()
    try:
        for data in lots(stream):
            rows = np.frombuffer(data, dtype)
            count = sender.send(rows)
            sent, dropped = sent + count, dropped + len(rows) - count
    finally:
        ended.set()
        reporter.join()
    sender.close()
    report()


def main() -> None:
    def tell(words: dict[str, Any]) -> None:
        sys.stdout.write(json.dumps(words) + "\n")
        sys.stdout.flush()

    address, wait = sys.argv[1], float(sys.argv[2])
    stream = sys.stdin.buffer
    incoming = lots(stream)
    about = json.loads(next(incoming))
    try:
        sender = open_sender(address, about, wait)
    except FacetsError as error:
        tell({"error": str(error)})
        return
    port = sender.port if isinstance(sender, ZmqSender) else None
    tell({"ready": True, "port": port})
    serve(sender, stream, sample_dtype(about), tell)


if __name__ == "__main__":
    main()
