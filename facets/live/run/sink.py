"""What a run writes to: the protocol `Sink`, which recordings and publications follow."""

from __future__ import annotations

from typing import Any, Protocol

from ..sources.source import Block
from .pipeline import RunPoses


class Sink(Protocol):
    """Receives what a run reads and solves. No method raises, or keeps a live run waiting.

    `add_block` is called by the thread that reads, `add_event` by one of its own, all others by the
    thread that solves.
    """

    def add_block(self, block: Block) -> None:
        """Take bytes as they came, before anything else is done with them."""
        return

    def add_poses(self, poses: RunPoses) -> None:
        """Take the poses of some samples, as soon as they are solved."""

    def add_event(self, name: str, **details: Any) -> None:
        """Take note of something that happened; details: `monotonic` and `utc`, when it did, s."""
        return

    def refresh(self) -> None:
        """Do what is due; called often, also while no samples come."""
        return

    def messages(self) -> list[str]:
        """Return what a person should know now, in sentences."""
        return []

    def values(self) -> dict[str, Any]:
        """Return counts and names for a view, in JSON's types."""
        return {}

    def sentences(self) -> list[str]:
        """Return what is said at the end of a run, line by line."""
        return []

    def close(self) -> None:
        """Finish what was begun, and release everything."""
