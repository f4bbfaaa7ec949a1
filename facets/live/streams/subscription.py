"""Samples that another process publishes by `tcp://`, as arrays, for programs in Python."""

from __future__ import annotations

import json
import socket
from collections.abc import Iterator
from contextlib import suppress
from typing import Any
from urllib.parse import urlsplit

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError
from .sample_rows import MAGIC
from .senders import LENGTH

MOST = 1 << 20


class Subscription:
    """Opens `tcp://HOST:PORT` and iterates over arrays of samples until the publication ends.

    about: what the publisher says of them: configuration, units, the words of a status.
    """

    def __init__(self, address: str, timeout: float = 10.0) -> None:
        """timeout: s, for the connection. Raises `InputError` where nobody publishes there."""
        parts = urlsplit(address)
        if parts.scheme != "tcp" or not parts.hostname or not parts.port:
            raise InputError(f"{address}: is no address; give tcp://HOST:PORT")
        try:
            self.line = socket.create_connection((parts.hostname, parts.port), timeout)
            self.stream: Any = self.line.makefile("rb", buffering=MOST)
            self.line.settimeout(None)
            head = self.stream.read(len(MAGIC))
            if head != MAGIC:
                raise InputError(f"{address}: what answers there publishes no samples")
            self.about: dict[str, Any] = json.loads(self.read(LENGTH.unpack(self.read(4))[0]))
        except OSError as error:
            raise InputError(f"{address}: {error.strerror or error}") from None
        self.dtype = np.dtype([(name, kind) for name, kind in self.about["dtype"]])

    def read(self, count: int) -> bytes:
        data: bytes = self.stream.read(count)
        return data

    def __iter__(self) -> Iterator[NDArray[np.void]]:
        rest = b""
        while data := self.stream.read1(MOST):
            data = rest + data
            whole = len(data) // self.dtype.itemsize * self.dtype.itemsize
            rest = data[whole:]
            if whole:
                yield np.frombuffer(data[:whole], self.dtype)

    def stop(self) -> None:
        """Ends the iteration of another thread."""
        with suppress(OSError):  # the publisher may have gone before
            self.line.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        self.stream.close()
        self.line.close()

    def __enter__(self) -> Subscription:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
