"""Addresses that samples are published at, as `--publish` takes them."""

from __future__ import annotations

import socket
from urllib.parse import urlsplit

from ...core.errors import InputError

SCHEMES = "zmq://HOST:PORT, udp://HOST:PORT (JSON) or lsl:NAME"


def check_address(address: str) -> None:
    """Raise `InputError` for a text that is not the address of a publication."""
    parts = urlsplit(address)
    try:
        sound = parts.scheme == "lsl" or (
            parts.scheme in ("udp", "zmq")
            and bool(parts.hostname)
            and parts.port is not None
            and (parts.scheme == "zmq" or parts.port > 0)
        )
        sound = sound and not parts.query
    except ValueError:
        sound = False
    if not sound:
        raise InputError(f"--publish {address}: is not an address; give {SCHEMES}")


def zmq_endpoint(address: str) -> str:
    """The address `zmq://HOST:PORT` as ZeroMQ has it, with the host's number.

    Raises `InputError` for another address, and for a host that is not known.

    >>> zmq_endpoint("zmq://127.0.0.1:5556")
    'tcp://127.0.0.1:5556'
    """
    parts = urlsplit(address)
    try:
        if parts.scheme != "zmq" or not parts.hostname or parts.port is None:
            raise ValueError
    except ValueError:
        raise InputError(f"{address}: is not an address; give zmq://HOST:PORT") from None
    if parts.hostname == "*":
        return f"tcp://*:{parts.port}"
    try:
        host = str(socket.getaddrinfo(parts.hostname, parts.port)[0][4][0])
    except OSError as error:
        raise InputError(f"{address}: {error.strerror or error}") from None
    return f"tcp://[{host}]:{parts.port}" if ":" in host else f"tcp://{host}:{parts.port}"
