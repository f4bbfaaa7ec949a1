"""Samples by ZeroMQ: one publisher, any number of subscribers, each at full rate.

A message has three parts: the topic `samples`; a header in JSON, with the number of the first row,
the number of rows, the dtype and the units of the columns; and the rows as they are in memory. A
subscriber for which `HIGH_WATER_MARK` messages wait misses what comes then, and the others do not.
It sees from the number of the first row how many rows it has missed, and tells the publisher
(`lost N`), which counts them. Each new subscriber first gets the description of the samples, after
the topic `about`. docs/formats.md describes the messages for other languages.
"""

from __future__ import annotations

import json
import threading
import time
from typing import Any

import numpy as np
import zmq
from numpy.typing import NDArray

from ...core.errors import InputError
from .addresses import zmq_endpoint

Rows = NDArray[np.void]

SAMPLES, ABOUT, LOST = b"samples", b"about", b"lost "
#: Maximum number of messages that wait for one subscriber, at each end: 250,000 samples at 50 kHz.
HIGH_WATER_MARK = 1_000
#: A subscriber that takes nothing for this long, s, is not waited for any more, by a replay.
STUCK_S = 5.0
#: A full queue is tried again after this time, s, by a replay.
RETRY_S = 0.002
#: What waits at the end is still sent for up to this time, ms.
LINGER_MS = 2_000
#: Other ends that do not answer within three of these times are gone, ms.
HEARTBEAT_MS = 2_000


def new_socket(context: zmq.Context[Any], kind: int, endpoint: str, linger_ms: int) -> Any:
    """A socket with the options that both ends share."""
    found = context.socket(kind)
    found.setsockopt(zmq.IPV6, int("[" in endpoint))
    found.setsockopt(zmq.SNDHWM, HIGH_WATER_MARK)
    found.setsockopt(zmq.RCVHWM, HIGH_WATER_MARK)
    found.setsockopt(zmq.LINGER, linger_ms)
    found.setsockopt(zmq.HEARTBEAT_IVL, HEARTBEAT_MS)
    found.setsockopt(zmq.HEARTBEAT_TIMEOUT, 3 * HEARTBEAT_MS)
    return found


class ZmqSender:
    """Publishes rows. A live run waits for nobody; a replay, for its subscribers.

    missed_count: number of rows that subscribers say they have missed.  port: of the socket.
    """

    def __init__(self, address: str, about: dict[str, Any], wait: float) -> None:
        """Bind `zmq://HOST:PORT`. about: the description of the samples.  wait: for a first
        subscriber, s; 0 for a live run. Raises `InputError` where it cannot be bound."""
        self.context = zmq.Context()
        endpoint = zmq_endpoint(address)
        self.socket = new_socket(self.context, zmq.XPUB, endpoint, LINGER_MS)
        self.socket.setsockopt(zmq.XPUB_VERBOSER, 1)  # each subscriber comes and goes by itself
        self.socket.setsockopt(zmq.XPUB_WELCOME_MSG, ABOUT + json.dumps(about).encode())
        self.patient = wait > 0
        self.socket.setsockopt(zmq.XPUB_NODROP, int(self.patient))
        try:
            self.socket.bind(endpoint)
        except zmq.ZMQError as error:
            self.context.destroy(0)
            raise InputError(f"--publish {address}: {error.strerror}") from None
        self.port = int(self.socket.getsockopt(zmq.LAST_ENDPOINT).rpartition(b":")[2].strip(b"\0"))
        self.wait_until = time.monotonic() + wait
        self.columns = json.dumps({name: about[name] for name in ("dtype", "units")})[1:].encode()
        self.lock = threading.Lock()  # of the socket and the counts
        self.subscribers = self.missed_count = self.first = 0

    @property
    def receivers(self) -> int:
        """Number of subscribers now."""
        with self.lock:
            self.hear()
            return self.subscribers

    def hear(self) -> None:
        """Take in what subscribers say: that they come, go, or have missed rows."""
        while not self.socket.closed and self.socket.poll(0):
            said = self.socket.recv()
            if said[:1] in (b"\0", b"\1"):
                if SAMPLES.startswith(said[1:]):
                    self.subscribers += 1 if said[:1] == b"\1" else -1
            elif said.startswith(LOST) and said[len(LOST) :].isdigit():
                self.missed_count += int(said[len(LOST) :])

    def send(self, rows: Rows) -> int:
        """Publish rows; return how many had a subscriber."""
        while self.patient and not self.receivers and time.monotonic() < self.wait_until:
            time.sleep(RETRY_S)
        self.wait_until = 0.0
        with self.lock:
            self.hear()
            header = b'{"first": %d, "count": %d, ' % (self.first, len(rows)) + self.columns
            self.put([SAMPLES, header, rows.tobytes()])
            self.first += len(rows)
            return len(rows) if self.subscribers else 0

    def put(self, parts: list[bytes]) -> None:
        """Send a message; a replay first waits while it would miss a subscriber."""
        last = time.monotonic() + STUCK_S
        while True:
            try:
                self.socket.send_multipart(parts, zmq.NOBLOCK)
                return
            except zmq.Again:
                time.sleep(RETRY_S)
            if time.monotonic() > last:
                self.socket.setsockopt(zmq.XPUB_NODROP, 0)
                self.socket.send_multipart(parts, zmq.NOBLOCK)
                self.socket.setsockopt(zmq.XPUB_NODROP, 1)
                return

    def close(self) -> None:
        """Close the socket once what waits has been sent, or after `LINGER_MS`."""
        with self.lock:
            self.hear()
            self.socket.close()
            self.context.term()
