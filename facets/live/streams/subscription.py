"""Samples that another process publishes by `zmq://`, as arrays, for programs in Python."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import numpy as np
import zmq
from numpy.typing import NDArray

from ...core.closing import ClosedAtExit
from ...core.errors import InputError
from .addresses import zmq_endpoint
from .zeromq import ABOUT, LOST, SAMPLES, new_socket

#: The end of a publication, or of the iteration, is looked for this often, ms.
POLL_MS = 100


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
        What the publisher says of the samples: configuration, units, the words of each status.
    dtype : numpy.dtype
        Of the rows; `docs/formats.md` describes the columns.
    lost : int
        Number of samples that were published and did not find place here, because this program
        did not take them in time.

    Raises
    ------
    InputError
        For what is no such address, and where nobody publishes there.

    Examples
    --------
    >>> from facets.live import Subscription
    >>> with Subscription("zmq://127.0.0.1:5556") as samples:  # doctest: +SKIP
    ...     for rows in samples:
    ...         print(rows["yaw_mrad"][-1])
    """

    def __init__(self, address: str, timeout: float = 10.0) -> None:
        endpoint = zmq_endpoint(address)
        self.context = zmq.Context()
        self.socket = new_socket(self.context, zmq.XSUB, endpoint, 0)
        self.monitor = self.socket.get_monitor_socket(zmq.EVENT_DISCONNECTED)
        self.lost, self.next, self.stopped = 0, -1, False
        try:
            self.socket.connect(endpoint)
            self.socket.send(b"\1" + SAMPLES)
            greeting = self.socket.recv() if self.socket.poll(1e3 * timeout) else b""
            if not greeting.startswith(ABOUT):
                raise InputError(f"{address}: no program publishes samples there")
            self.about: dict[str, Any] = json.loads(greeting[len(ABOUT) :])
        except BaseException:
            self.close()
            raise
        self.dtype = np.dtype([(name, kind) for name, kind in self.about["dtype"]])

    def __iter__(self) -> Iterator[NDArray[np.void]]:
        """Yield arrays of samples, as they come."""
        poller = zmq.Poller()
        poller.register(self.socket, zmq.POLLIN)
        poller.register(self.monitor, zmq.POLLIN)
        while not self.stopped:
            ready = dict(poller.poll(POLL_MS))
            # the last samples may come a moment after the news that the publisher has gone
            if self.socket in ready or (ready and self.socket.poll(POLL_MS)):
                topic, *parts = self.socket.recv_multipart()
                if topic == SAMPLES:
                    yield self.read_message(*parts)
            elif ready:
                return

    def read_message(self, header: bytes, data: bytes) -> NDArray[np.void]:
        """The rows of a message; counts those before it that were missed."""
        words = json.loads(header)
        missed = words["first"] - self.next if self.next >= 0 else 0
        if missed > 0:
            self.lost += missed
            with suppress(zmq.ZMQError):  # the publisher may have gone
                self.socket.send(LOST + b"%d" % missed, zmq.NOBLOCK)
        self.next = words["first"] + words["count"]
        return np.frombuffer(data, self.dtype)

    def stop(self) -> None:
        """End the iteration of another thread."""
        self.stopped = True

    def close(self) -> None:
        """Leave the publication; a second call does nothing."""
        self.socket.disable_monitor()
        self.monitor.close()
        self.socket.close()
        self.context.term()
