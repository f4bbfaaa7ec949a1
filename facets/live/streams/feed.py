"""What a publication sends, at the other end of its socket."""

from __future__ import annotations

import json
import sys
import time
from contextlib import suppress
from typing import Any

import numpy as np
import zmq
from numpy.typing import NDArray

from ...core.closing import ClosedAtExit
from ...core.errors import InputError
from .zeromq import (
    ABOUT,
    END,
    FROM,
    LINGER_MS,
    LOST,
    SAMPLES,
    STATUS,
    new_socket,
)

Rows = NDArray[np.void]

#: The end of a publication, or of the iteration, is looked for this often, ms.
POLL_MS = 100
#: A run that started this process is waited for this long, s.
RUN_WAIT_S = 60.0
#: The run is told what became of the samples this often, s.
REPORT_INTERVAL_S = 0.25
#: Maximum number of messages that wait in a process that a run has started.
RELAY_HIGH_WATER_MARK = 100


class Feed(ClosedAtExit):
    """Messages of a publication, from now on, until it ends.

    about: the description of the samples.  dtype: of their rows.  lost: number of rows that found
    no place here.  ended: whether nothing more comes.
    """

    def __init__(self, socket: Any, endpoint: str, topics: tuple[bytes, ...], wait_s: float):
        """socket: XSUB, which `close` closes with its context.  wait_s: for the publication.

        Raises `InputError` where nobody publishes.
        """
        self.socket = socket
        self.monitor = socket.get_monitor_socket(zmq.EVENT_DISCONNECTED)
        self.lost, self.next, self.ended = 0, -1, False
        try:
            socket.connect(endpoint)
            for topic in topics:
                socket.send(b"\1" + topic)
            greeting = socket.recv() if socket.poll(1e3 * wait_s) else b""
            if not greeting.startswith(ABOUT):
                place = endpoint.replace("tcp://", "zmq://")
                raise InputError(f"{place}: no program publishes samples there")
        except BaseException:
            self.close()
            raise
        self.about: dict[str, Any] = json.loads(greeting[len(ABOUT) :])
        self.dtype = np.dtype([(name, kind) for name, kind in self.about["dtype"]])
        self.poller = zmq.Poller()
        self.poller.register(socket, zmq.POLLIN)
        self.poller.register(self.monitor, zmq.POLLIN)

    def receive(self, wait_ms: int) -> list[bytes]:
        """The parts of the next message; nothing where none comes in this time."""
        ready = dict(self.poller.poll(wait_ms))
        # the last samples may come a moment after the news that the publisher has gone
        if self.socket in ready or (ready and self.socket.poll(POLL_MS)):
            parts: list[bytes] = self.socket.recv_multipart()
            return parts
        if ready:
            self.ended = True
        return []

    def read_rows(self, header: bytes, data: bytes) -> Rows:
        """The rows of a message; counts those before it that were missed."""
        words = json.loads(header)
        missed = words["first"] - self.next if self.next >= 0 else 0
        if missed > 0:
            self.lost += missed
            self.tell_loss(missed)
        self.next = words["first"] + words["count"]
        return np.frombuffer(data, self.dtype)

    def tell_loss(self, missed: int) -> None:
        """Tell the publisher how many rows were missed."""
        with suppress(zmq.ZMQError):  # the publisher may have gone
            self.socket.send(LOST + b"%d" % missed, zmq.NOBLOCK)

    def close(self) -> None:
        """Leave the publication; a second call does nothing."""
        if self.socket.closed:
            return
        self.socket.disable_monitor()
        self.monitor.close()
        self.socket.close()
        self.socket.context.term()


class RunFeed(Feed):
    """Samples and status of the run that started this process, and the way back to it.

    setup: what the run has to say to this process alone.  count: number of rows that came.
    has_end: whether the run has said that nothing more comes, instead of breaking off.
    """

    def __init__(self) -> None:
        """Raises `InputError` where the run has gone."""
        self.setup: dict[str, Any] = json.load(sys.stdin)
        self.token = self.setup["token"].encode()
        self.count, self.has_end, self.due = 0, False, 0.0
        socket = new_socket(zmq.Context(), zmq.XSUB, RELAY_HIGH_WATER_MARK, LINGER_MS)
        topics = (self.token, SAMPLES, STATUS, END)
        super().__init__(socket, self.setup["endpoint"], topics, RUN_WAIT_S)
        self.next = 0

    def take(self, most: int, wait_ms: int = 0) -> tuple[list[Rows], list[dict[str, Any]]]:
        """Rows and statuses, as they come; no further message once there are `most` rows.

        wait_ms: for the first message.
        """
        parts, statuses, last = list[Rows](), list[dict[str, Any]](), self.count + most
        while self.count < last and not self.ended and (message := self.receive(wait_ms)):
            topic, *content = message
            wait_ms = 0
            if topic == SAMPLES:
                parts.append(self.read_rows(*content))
                self.count += len(parts[-1])
            elif topic == STATUS:
                statuses.append(json.loads(content[0]))
            elif topic == END:
                self.ended = self.has_end = True
        return parts, statuses

    def tell_loss(self, missed: int) -> None:
        """The run is told the number of all with what became of the others."""

    def report(self, sent: int, receivers: int | None) -> None:
        """Tell the run what became of the samples, every now and then and at the end."""
        if self.ended or time.monotonic() >= self.due:
            self.due = time.monotonic() + REPORT_INTERVAL_S
            dropped = self.count - sent + self.lost
            self.tell(sent=sent, dropped=dropped, receivers=receivers)

    def tell(self, **words: Any) -> None:
        """Say something to the run, which may have gone."""
        with suppress(zmq.ZMQError):
            self.socket.send(FROM + self.token + b" " + json.dumps(words).encode(), zmq.NOBLOCK)
