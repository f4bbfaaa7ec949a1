"""The protocol `Source` of sources of bytes, its errors, and its blocks of bytes."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from ...core.errors import FacetsError
from ...tracking.encoder import Encoder

#: Longest time for which a read waits for bytes, s, which keeps blocks short.
POLL_S = 0.003
#: A read returns at most this many bytes.
MAX_READ_BYTES = 65_536


class PortError(FacetsError):
    """A port cannot be opened, or it went away."""


class PortInUse(PortError):
    """A port cannot be opened, and waiting does not help: another program has it, for example."""


class Block(NamedTuple):
    """Bytes that came together.

    arrival: time of arrival on the host's monotonic clock, s; NaN if it is not known.  encoder: the
    stage's last place before then.  doubtful: whether nothing proves that these bytes came.
    """

    data: bytes
    arrival: float
    encoder: Encoder | None
    doubtful: bool = False


class Source(Protocol):
    """A source of bytes in one of the formats of `frames`.

    The call that opens it raises `PortError` if there is nothing to open, and `PortInUse` if
    waiting does not help. One thread uses a source.
    """

    @property
    def ended(self) -> bool:
        """Whether the source has ended, so that no more bytes come."""
        ...

    @property
    def waits(self) -> bool:
        """Whether no bytes are lost while the source is not read, as from a file."""
        ...

    def read(self) -> bytes:
        """Return the bytes that came, after `POLL_S` at the latest; empty bytes are no error.

        Raises `PortError` if the source has disappeared.
        """
        ...

    def close(self) -> None:
        """Release the source. Nothing is read afterwards; a second call does nothing."""
        ...
