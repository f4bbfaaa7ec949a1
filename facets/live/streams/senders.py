"""Processes of a run that pass its samples on: `python -m facets.live.streams.senders ADDRESS`.

They subscribe to the run that has started them, and report the counts of samples to it.
"""

from __future__ import annotations

import socket
import sys
import time
from typing import Any
from urllib.parse import urlsplit

import numpy as np

from ...core.errors import FacetsError, InputError
from ...core.extras import require_extra
from ...core.units import Rows
from .json_rows import json_of
from .run_feed import RunFeed
from .sample_rows import HEAD as HEAD_COLUMNS, unit_of
from .subscription import POLL_MS


class Udp:
    """Datagrams of JSON to one address, one for each sample with its `timestamp`, as the UDP server
    of PlotJuggler takes them."""

    receivers = None

    def __init__(self, host: str, port: int) -> None:
        kind = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
        self.line = socket.socket(kind[0], socket.SOCK_DGRAM)
        self.line.connect(kind[4])

    def send(self, rows: Rows) -> int:
        """Send samples; return for how many of them somebody listens there."""
        return sum(self.put(text.encode()) for text in json_of(rows))

    def put(self, data: bytes) -> bool:
        """Send a datagram; return False if nobody listens there, or the address has no route."""
        try:
            self.line.send(data)
        except OSError:
            return False
        return True

    def close(self) -> None:
        self.line.close()


class Lsl:
    """An outlet of the Lab Streaming Layer, with names and units of its channels."""

    def __init__(self, name: str, about: dict[str, Any]) -> None:
        pylsl = require_extra("pylsl", f"lsl:{name}")
        names = [name for name, _ in about["dtype"]]
        self.channels = ("seq", "status", "flags", *names[len(HEAD_COLUMNS) :])
        auxiliary = about.get("channels", ())
        auxiliary_columns = {channel["column"] for channel in auxiliary}
        source = f"facets-{about.get('config_sha256', '')[:16]}"
        info = pylsl.StreamInfo(
            name or "facets", "Pose", len(self.channels), pylsl.IRREGULAR_RATE, "double64", source
        )
        channels = info.desc().append_child("channels")
        for label in self.channels:
            channel = channels.append_child("channel")
            channel.append_child_value("label", label)
            channel.append_child_value("unit", unit_of(label, auxiliary))
            of_status = ("seq", "status", "flags", "residual")
            kind = "Auxiliary" if label in auxiliary_columns else "Pose"
            channel.append_child_value("type", "Status" if label in of_status else kind)
        for key in ("config", "config_sha256", "facets", "object", "zero"):
            info.desc().append_child_value(key, str(about.get(key, "")))
        self.outlet = pylsl.StreamOutlet(info, chunk_size=100, max_buffered=60)
        # both count from the start of this machine where it can be; else the offset is known here
        self.offset = pylsl.local_clock() - time.monotonic()

    @property
    def receivers(self) -> int:
        """1 if somebody receives, else 0."""
        return int(self.outlet.have_consumers())

    def send(self, rows: Rows) -> int:
        """Send rows; return the number of rows that somebody received."""
        heard = self.outlet.have_consumers()
        values = np.column_stack([rows[name].astype(float) for name in self.channels])
        self.outlet.push_chunk(values.tolist(), (rows["host_s"] + self.offset).tolist())
        return len(rows) if heard else 0

    def close(self) -> None:
        """Give the last samples time to go."""
        last = time.monotonic() + 1.0
        while self.outlet.have_consumers() and time.monotonic() < last:
            time.sleep(0.05)


def open_sender(address: str, about: dict[str, Any]) -> Udp | Lsl:
    """Open the sender of an address. Raises `InputError` if the address cannot be used."""
    parts = urlsplit(address)
    try:
        if parts.scheme == "lsl":
            return Lsl(parts.path, about)
        assert parts.hostname is not None
        assert parts.port is not None
        return Udp(parts.hostname, parts.port)
    except OSError as error:
        raise InputError(f"--publish {address}: {error.strerror or error}") from None


def pass_on(feed: RunFeed, sender: Udp | Lsl) -> None:
    """Pass samples on until the run ends."""
    sent = 0
    feed.reply(ready=True, receivers=sender.receivers)
    while not feed.ended:
        rows, _ = feed.take(1, POLL_MS)
        sent += sum(map(sender.send, rows))
        feed.report(sent, sender.receivers)
    sender.close()


def main() -> None:
    """Send the samples of a run to the address of the command line; report an error to the run."""
    with RunFeed() as feed:
        try:
            sender = open_sender(sys.argv[1], feed.about)
        except FacetsError as error:
            feed.reply(error=str(error))
        else:
            pass_on(feed, sender)


if __name__ == "__main__":
    main()
