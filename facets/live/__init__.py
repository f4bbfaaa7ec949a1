"""Samples as they come: read, recorded, solved, followed by a stage, and given to other programs.

    >>> import facets
    >>> from facets.live import poses
    >>> for found in poses(facets.load("bench"), "file:bytes.bin"):  # doctest: +SKIP
    ...     print(found.solution.state)

`Run` assembles everything that `facets acquire` runs. The folders: `sources` reads bytes, `run`
solves and shows, `recording` and `streams` are where samples go, beside a page (`web`) and a bench
that does not exist (`virtual`).
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

# A name is imported when it is first asked for, so that a program pays only for what it uses.
_HOMES = {
    "Live": "run.live",
    "Run": "assembly",
    "Screen": "run.view",
    "json_line": "run.view",
    "plain_line": "run.view",
    "summary": "run.view",
    "poses": "run.poses",
    "smooth": "run.smoothing",
    "PoseSensor": "streams.ophyd_device",
    "Subscription": "streams.subscription",
}
__all__ = sorted(_HOMES)

if TYPE_CHECKING:
    from .assembly import Run as Run
    from .run.live import Live as Live
    from .run.poses import poses as poses
    from .run.smoothing import smooth as smooth
    from .run.view import Screen as Screen
    from .run.view import json_line as json_line
    from .run.view import plain_line as plain_line
    from .run.view import summary as summary
    from .streams.ophyd_device import PoseSensor as PoseSensor
    from .streams.subscription import Subscription as Subscription


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f".{_HOMES[name]}", __name__), name)
    globals()[name] = value
    return value
