"""Samples that another process publishes by `zmq://`, as arrays, for programs in Python."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import numpy as np
import zmq

from ...core.closing import ClosedAtExit
from ...core.errors import InputError
from ...core.units import Rows
from .addresses import zmq_endpoint
from .zeromq import ABOUT, HIGH_WATER_MARK, LOST, SAMPLES

#: The end of a publication, or of the iteration, is looked for this often, ms.
POLL_MS = 100
#: A publisher that does not answer within three of these times is gone, ms.
HEARTBEAT_MS = 2_000


class Subscription(ClosedAtExit):
    """Samples of a publication as arrays, from now on, until it ends.

    Any number of programs may subscribe, on this machine or, where the publication's host is not
    127.0.0.1, on others.

    Parameters
    ----------
    address : str
        `zmq://HOST:PORT`, as given to `facets acquire --publish`.
    timeout : float
        The publication is waited for this long, s.

    Attributes
    ----------
    about : dict
        The publisher's description of the samples: configuration, units, words of each status.
    dtype : numpy.dtype
        Of the rows; `docs/formats.md` describes the columns.
    lost : int
        Number of published samples that were dropped, because this program did not take them in
        time.

    Raises
    ------
    InputError
        If the address is invalid, or nobody publishes there.

    Examples
    --------
    >>> from facets.live import Subscription
    >>> with Subscription("zmq://127.0.0.1:5556") as samples:  # doctest: +SKIP
    ...     for rows in samples:
    ...         print(rows["yaw_mrad"][-1])
    """

    def __init__(self, address: str, timeout: float = 10.0) -> None:
        endpoint = zmq_endpoint(address)
        options = {
            zmq.RCVHWM: HIGH_WATER_MARK,
            zmq.LINGER: 0,
            zmq.IPV6: int("[" in endpoint),
            zmq.HEARTBEAT_IVL: HEARTBEAT_MS,
            zmq.HEARTBEAT_TIMEOUT: 3 * HEARTBEAT_MS,
        }
        if not self.connect(endpoint, (SAMPLES,), options, timeout):
            raise InputError(f"{address}: no program publishes samples there")

    def connect(
        self,
        endpoint: str,
        topics: tuple[bytes, ...],
        options: dict[zmq.SocketOption, int],
        timeout: float,
    ) -> bool:
        """Subscribe to topics; return whether somebody publishes there, within a time, s."""
        self.context = zmq.Context()
        self.socket = self.context.socket(zmq.XSUB)
        for option, value in options.items():
            self.socket.setsockopt(option, value)
        self.monitor = self.socket.get_monitor_socket(zmq.EVENT_DISCONNECTED)
        self.lost, self.next, self.ended = 0, -1, False
        self.poller = zmq.Poller()
        for socket in (self.socket, self.monitor):
            self.poller.register(socket, zmq.POLLIN)
        greeting = b""
        try:
            self.socket.connect(endpoint)
            for topic in topics:
                self.socket.send(b"\1" + topic)
            if self.socket.poll(int(1e3 * timeout)):
                greeting = self.socket.recv()
        finally:
            if not greeting.startswith(ABOUT):
                self.close()
        if self.socket.closed:
            return False
        self.about: dict[str, Any] = json.loads(greeting[len(ABOUT) :])
        self.dtype = np.dtype([(name, kind) for name, kind in self.about["dtype"]])
        return True

    def __iter__(self) -> Iterator[Rows]:
        """Yield arrays of samples, as they come."""
        while not self.ended:
            topic, *parts = self.receive(POLL_MS) or [b""]
            if topic == SAMPLES:
                yield self.read_rows(*parts)

    def receive(self, wait_ms: int) -> list[bytes]:
        """Return the parts of the next message; an empty list if none comes in this time."""
        ready = dict(self.poller.poll(wait_ms))
        # the last samples may come a moment after the news that the publisher has gone
        if self.socket in ready or (ready and self.socket.poll(POLL_MS)):
            return self.socket.recv_multipart()
        if ready:
            self.ended = True
        return []

    def read_rows(self, header: bytes, data: bytes) -> Rows:
        """Return the rows of a message, and count the rows that were missed before it."""
        words = json.loads(header)
        missed = words["first"] - self.next if self.next >= 0 else 0
        if missed > 0:
            self.lost += missed
            self.report_loss(missed)
        self.next = words["first"] + words["count"]
        return np.frombuffer(data, self.dtype)

    def report_loss(self, missed: int) -> None:
        """Report the number of missed rows to the publisher."""
        with suppress(zmq.ZMQError):  # the publisher may have gone
            self.socket.send(LOST + b"%d" % missed, zmq.NOBLOCK)

    def stop(self) -> None:
        """End the iteration of another thread."""
        self.ended = True

    def close(self) -> None:
        """Leave the publication; a second call does nothing."""
        if not self.socket.closed:
            self.socket.disable_monitor()
            self.monitor.close()
            self.socket.close()
            self.context.term()
