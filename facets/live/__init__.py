"""Live samples: read, record, solve and publish them, and let a stage follow the mirror.

    >>> import facets
    >>> from facets.live import poses
    >>> for found in poses(facets.load("bench"), "file:bytes.bin"):  # doctest: +SKIP
    ...     print(found.solution.state)

`Run` assembles everything that `facets acquire` runs. `sources` reads bytes, `run` solves and
shows samples, `recording` and `streams` write and send them, `web` serves a page, and `virtual`
is a simulated bench.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..core.faces import load_on_use

# Names are imported at their first use, so that a program loads only what it uses.
_HOMES = {
    "Live": "run.live",
    "Playback": "playback",
    "ReplayPage": "web.replay_page",
    "Run": "assembly",
    "Screen": "run.view",
    "json_line": "run.view",
    "plain_line": "run.view",
    "refuse_output": "playback",
    "require_packages": "streams.publication",
    "summary": "run.view",
    "poses": "run.poses",
    "smooth": "run.smoothing",
    "PoseSensor": "streams.ophyd_device",
    "Subscription": "streams.subscription",
}
__all__ = sorted(_HOMES)

if TYPE_CHECKING:
    from . import recording as recording
    from . import run as run
    from . import streams as streams
    from . import virtual as virtual
    from . import web as web
    from .assembly import Run as Run
    from .playback import Playback as Playback
    from .playback import refuse_output as refuse_output
    from .run.live import Live as Live
    from .run.poses import poses as poses
    from .run.smoothing import smooth as smooth
    from .run.view import Screen as Screen
    from .run.view import json_line as json_line
    from .run.view import plain_line as plain_line
    from .run.view import summary as summary
    from .streams.ophyd_device import PoseSensor as PoseSensor
    from .streams.publication import require_packages as require_packages
    from .streams.subscription import Subscription as Subscription
    from .web.replay_page import ReplayPage as ReplayPage
else:
    __getattr__ = load_on_use(__name__, _HOMES)
