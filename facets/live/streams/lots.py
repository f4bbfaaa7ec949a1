"""Bytes on a pipe to a process, lot by lot, each after its length."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import BinaryIO

LENGTH = struct.Struct("<I")


def lots(stream: BinaryIO) -> Iterator[bytes]:
    """Yield what comes on a stream until its end; a lot that is cut off is left out."""
    while len(head := stream.read(LENGTH.size)) == LENGTH.size:
        data = stream.read(LENGTH.unpack(head)[0])
        if len(data) < LENGTH.unpack(head)[0]:
            return
        yield data
