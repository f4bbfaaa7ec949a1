"""Samples that another process publishes by `zmq://`, as arrays, for programs in Python."""

from __future__ import annotations

from collections.abc import Iterator

import zmq

from .addresses import zmq_endpoint
from .feed import POLL_MS, Feed, Rows
from .zeromq import HIGH_WATER_MARK, SAMPLES, new_socket

#: A publisher that does not answer within three of these times is gone, ms.
HEARTBEAT_MS = 2_000


class Subscription(Feed):
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
        socket = new_socket(zmq.Context(), zmq.XSUB, HIGH_WATER_MARK, 0)
        socket.setsockopt(zmq.IPV6, int("[" in endpoint))
        socket.setsockopt(zmq.HEARTBEAT_IVL, HEARTBEAT_MS)
        socket.setsockopt(zmq.HEARTBEAT_TIMEOUT, 3 * HEARTBEAT_MS)
        super().__init__(socket, endpoint, (SAMPLES,), timeout)

    def __iter__(self) -> Iterator[Rows]:
        """Yield arrays of samples, as they come."""
        while not self.ended:
            topic, *parts = self.receive(POLL_MS) or [b""]
            if topic == SAMPLES:
                yield self.read_rows(*parts)

    def stop(self) -> None:
        """End the iteration of another thread."""
        self.ended = True
