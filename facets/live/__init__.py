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
_NAMES_OF = {
    "run.live": "Live",
    "playback": "Playback refuse_output",
    "web.replay_page": "ReplayPage",
    "assembly": "Run RunOptions",
    "run.view": "Screen json_line plain_line summary values",
    "streams.publication": "require_packages Publications",
    "run.poses": "poses",
    "streams.ophyd_device": "Interval PoseSensor",
    "streams.subscription": "Subscription",
    "recording.comparison": "PoseComparison",
    "recording.disk": "Disk",
    "recording.index": "Damage are_events_whole",
    "recording.pose_table": "recorded_columns recorded_poses",
    "recording.reader": "blocks meta_of utc_offset",
    "recording.replay": "recorded_config replay",
    "recording.writer": "Recording",
    "run.board_poses": "SOLVED board_solution",
    "run.loop": "CLOCK_MOVED Ending Loop acquire",
    "run.pipeline": "Pipeline RunPoses join_poses locate",
    "run.reader": "MAX_BLOCK_S Reader",
    "run.sink": "Sink",
    "sources": "Block check_missing check_source",
    "sources.clock": "Sequence WRAP",
    "sources.frames": (
        "ELECTRODES FixedFrames MARK PERMIT POSE SIZE RawSamples XY_SUM encode pack parser"
    ),
    "sources.host_time": "HostTime",
    "sources.ports": "DatagramPort PortError PortInUse open_port",
    "streams.sample_rows": "SAMPLE row_content rows_of sample_dtype",
    "virtual": "Bench BenchSetup Faults Pty truth_of",
    "virtual.stages": "CONTROLLERS PiController ZaberDevice",
    "web.page": "WebPage",
    "web.status": "stage status_of",
}
__all__ = sorted(" ".join(_NAMES_OF.values()).split())

if TYPE_CHECKING:
    from . import (
        recording as recording,
        run as run,
        streams as streams,
        virtual as virtual,
        web as web,
    )
    from .assembly import Run as Run, RunOptions as RunOptions
    from .playback import Playback as Playback, refuse_output as refuse_output
    from .run.live import Live as Live
    from .run.poses import poses as poses
    from .run.view import (
        Screen as Screen,
        json_line as json_line,
        plain_line as plain_line,
        summary as summary,
    )
    from .streams.ophyd_device import PoseSensor as PoseSensor
    from .streams.publication import require_packages as require_packages
    from .streams.subscription import Subscription as Subscription
    from .web.replay_page import ReplayPage as ReplayPage
else:
    __getattr__ = load_on_use(__name__, _NAMES_OF)
