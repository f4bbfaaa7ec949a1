"""The messages of a publication by ZeroMQ, and the options that both ends share.

A message with samples has three parts: the topic `samples`; a header in JSON, with the number of
the first row, the number of rows, the dtype and the units of the columns; and the rows as they are
in memory. A subscriber for which `HIGH_WATER_MARK` messages wait misses what comes then, and the
others do not. It sees from the number of the first row how many rows it has missed, and tells the
publisher (`lost N`), which counts them. Each new subscriber first gets the description of the
samples, after the topic `about`. docs/formats.md describes the messages for other languages.

The processes that a run starts (`relay`) also take the topics `status`, the run's words of itself
for the page, and `end`, after which nothing follows. What they say begins with `from` and their
token, which nobody else knows.
"""

from __future__ import annotations

from typing import Any

import zmq

SAMPLES, STATUS, END = b"samples", b"status", b"end"
ABOUT, LOST, FROM = b"about", b"lost ", b"from "
#: Maximum number of messages that wait for one subscriber, at each end: 250,000 samples at 50 kHz.
HIGH_WATER_MARK = 1_000
#: What waits at the end is still sent for up to this time, ms.
LINGER_MS = 2_000


def new_socket(context: zmq.Context[Any], kind: int, high_water_mark: int, linger_ms: int) -> Any:
    """A socket with maximum numbers of messages that wait, and a time for them at its end."""
    socket = context.socket(kind)
    socket.setsockopt(zmq.SNDHWM, high_water_mark)
    socket.setsockopt(zmq.RCVHWM, high_water_mark)
    socket.setsockopt(zmq.LINGER, linger_ms)
    return socket
