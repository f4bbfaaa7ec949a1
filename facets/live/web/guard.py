"""Who may look at the page: whoever has its address, by that address, from no other page."""

from __future__ import annotations

import hmac
import socket
from ipaddress import IPv4Address, IPv6Address, ip_address
from urllib.parse import urlsplit

from ...core.errors import InputError

LOOPBACK = "127.0.0.1"


def parse_address(text: str) -> tuple[str, int]:
    """Host and port of `[HOST:]PORT`; port 0 is for any that is free.

    Raises `InputError` for a text in another form.

    >>> parse_address("8080"), parse_address("[::1]:0")
    (('127.0.0.1', 8080), ('::1', 0))
    """
    head, colon, port = text.rpartition(":")
    host = head.removeprefix("[").removesuffix("]") if colon else LOOPBACK
    bare = ":" in host and not head.startswith("[")
    if not host or bare or not (port.isascii() and port.isdigit()) or int(port) > 65_535:
        raise InputError(
            f"--web {text}: is not an address; give --web=PORT (8080, or 0 for any free port), "
            "--web=HOST:PORT ([::1]:8080 for IPv6), or --web alone as the last option"
        )
    return host, int(port)


def is_local(host: str) -> bool:
    """Whether only programs on this machine reach an address."""
    number = ip_number(host)
    return host.lower() == "localhost" if number is None else number.is_loopback


def ip_number(host: str) -> IPv4Address | IPv6Address | None:
    """Return the IP address that a host is given by; None for a name."""
    try:
        return ip_address(host)
    except ValueError:
        return None


def place(host: str, port: int) -> str:
    """Return HOST:PORT as in an address of the web."""
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


class Guard:
    """Decides whether a request is refused.

    The token in the address keeps out those who do not know it. The request must address this
    machine by one of its own names, which refuses a page of another site whose name was made to
    lead here. A request that a page of another origin makes is refused as well.
    """

    def __init__(self, token: str, host: str, port: int) -> None:
        self.token, self.port = token, port
        self.names = {host.lower()}
        self.any_number = False
        if is_local(host):
            self.names |= {"localhost", "127.0.0.1", "::1"}
        else:
            self.names |= {socket.gethostname().lower(), socket.getfqdn().lower()}
            self.any_number = True

    def complaint(self, token: str, host: str, origin: str | None) -> str:
        """Return the reason to refuse a request, or ''.

        token: of its path.  host: its header Host.  origin: its header Origin, if any.
        """
        if not self.knows(host):
            return "this page is not served under that name"
        if origin is not None and origin.lower() != f"http://{host.lower()}":
            return "the request comes from another page"
        if not hmac.compare_digest(token.encode(), self.token.encode()):
            return "the address is incomplete: it needs the token that the program has printed"
        return ""

    def knows(self, host: str) -> bool:
        """Whether the page is served under a host's name and port."""
        try:
            parts = urlsplit(f"//{host}")
            host, port = parts.hostname or "", parts.port or 80
        except ValueError:
            return False
        # no other site can make an IP address lead here
        is_allowed_number = self.any_number and ip_number(host) is not None
        return port == self.port and (host in self.names or is_allowed_number)
