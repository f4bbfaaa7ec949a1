"""The protocol `Sink` of the receivers of a run's data: recordings and publications."""

from __future__ import annotations

from typing import Any, Protocol

from ..sources.source import Block
from .pipeline import RunPoses


class Sink(Protocol):
    """Receives the data of a run. No method raises an error or keeps a live run waiting.

    `add_block` is called by the thread that reads, `add_event` by one of its own, all others by the
    thread that solves.
    """

    def add_block(self, block: Block) -> None:
        """Take bytes as they came, before anything else is done with them."""
        return

    def add_poses(self, poses: RunPoses) -> None:
        """Take the poses of some samples, as soon as they are solved."""

    def add_event(self, name: str, **details: Any) -> None:
        """Note an event.  details: its times `monotonic` and `utc`, s, and other values."""
        return

    def refresh(self) -> None:
        """Do work that is due; called often, also while no samples come."""
        return

    def messages(self) -> list[str]:
        """Return the sentences that a person should read now."""
        return []

    def values(self) -> dict[str, Any]:
        """Return counts and names for a view, in JSON's types."""
        return {}

    def sentences(self) -> list[str]:
        """Return the lines for the end of a run."""
        return []

    def close(self) -> None:
        """Write the remaining data, and release all resources."""
