"""Checks that a source of bytes keeps the protocol `Source`, for the tests of any package.

from facets.live.sources import check_source

def test_my_source(board):
    check_source(lambda: open_mine("mine:1", 0), board.send, DATA)
"""

from __future__ import annotations

import time
from collections.abc import Callable

from .source import PortError, Source

#: The bytes that a source was given must arrive within this time, s; long enough for any machine.
GUARD_S = 600.0


def check_source(
    opened: Callable[[], Source], send: Callable[[bytes], object], data: bytes
) -> None:
    """Raise `AssertionError` if a source does not keep the protocol `Source`.

    opened: opens the source.  send: lets the other end send bytes.  data: the bytes to send, which
    must come.
    """
    port = opened()
    try:
        for name in ("ended", "waits"):
            assert isinstance(getattr(port, name), bool), f"{name} is neither True nor False"
        send(data)
        came, last = bytearray(), time.monotonic() + GUARD_S
        while len(came) < len(data):
            assert time.monotonic() < last, f"{len(came)} of {len(data)} bytes came"
            assert not port.ended, "the source ended before all had come"
            part = port.read()
            assert isinstance(part, bytes), f"read() gives {type(part).__name__}, not bytes"
            came.extend(part)
        assert bytes(came) == data, "other bytes came than were sent"
        for _ in range(3):  # Having nothing to read is no error.
            assert port.ended or port.read() == b"", "more came than was sent"
    finally:
        port.close()
    port.close()  # again does nothing


def check_missing(opened: Callable[[], Source]) -> None:
    """Raise `AssertionError` if opening a missing source raises no `PortError` with words."""
    message = None
    try:
        opened().close()
    except PortError as error:
        message = str(error)
    assert message is not None, "a source that is not there was opened"
    assert message, "the error says nothing"
