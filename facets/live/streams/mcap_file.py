"""Poses of a recording as an MCAP file, which Foxglove and other tools of robotics open.

The channels are in JSON, each with its schema. `/facets/sample` has all values of a sample in the
units of the tables. `/facets/pose` is a `foxglove.PoseInFrame` of the mirror in the world's frame,
in metres, for views in three dimensions; with an object, `/facets/object` is its pose.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.closing import ClosedAtExit
from ...core.extras import require_extra
from ...core.names import STATE_COLUMNS, STATE_UNITS
from .json_rows import group_columns, json_of, numbers_of
from .sample_rows import rows_of, sample_dtype, unit_of

if TYPE_CHECKING:
    from ...core.units import Floats
    from ..run.pipeline import RunPoses

NANO = 1_000_000_000


class McapFile(ClosedAtExit):
    """Appends poses; closed at the end of a `with` statement. Raises `InputError` without mcap."""

    def __init__(
        self, path: Path, about: dict[str, str], utc_offset: float, content: dict[str, Any]
    ) -> None:
        """about: how it was made.  utc_offset: of the wall clock over the monotonic one, s.
        content: of a row, by `row_content`."""
        writer = require_extra("mcap.writer", str(path))
        self.offset = utc_offset
        self.file = path.open("wb")
        self.writer: Any = writer.Writer(self.file)
        self.writer.start(library="facets")
        self.writer.add_metadata("facets", about)
        self.sample = self.channel("/facets/sample", "facets.Sample", sample_schema(content))
        self.pose = self.channel("/facets/pose", "foxglove.PoseInFrame", pose_schema())
        self.object: int | None = None
        if content["object"] is not None:
            self.object = self.channel("/facets/object", "foxglove.PoseInFrame", pose_schema())

    def channel(self, topic: str, name: str, schema: dict[str, Any]) -> int:
        """Register a channel with its schema, and return its number."""
        schema_number = self.writer.register_schema(name, "jsonschema", json.dumps(schema).encode())
        number: int = self.writer.register_channel(topic, "json", schema_number)
        return number

    def write(self, poses: RunPoses) -> None:
        """Write the samples and poses of solved readings."""
        rows = rows_of(poses, self.offset)
        times = np.round(rows["utc_s"] * NANO).astype(np.int64).tolist()
        numbers, texts = rows["seq"].tolist(), json_of(rows)
        for number, time, text in zip(numbers, times, texts, strict=True):
            self.writer.add_message(self.sample, time, text.encode(), time, number % 2**32)
        states_by_channel = {self.pose: poses.solution.state[:, :6]}
        if self.object is not None:
            columns = [poses.object[f"object_{name}"] for name in STATE_COLUMNS[:6]]
            states_by_channel[self.object] = np.column_stack(columns) * STATE_UNITS[:6]
        for channel, states in states_by_channel.items():
            for n, message in pose_messages(states, times):
                data = json.dumps(message, separators=(",", ":")).encode()
                self.writer.add_message(channel, times[n], data, times[n], numbers[n] % 2**32)

    def close(self) -> None:
        """Write the file's end, and close it."""
        self.writer.finish()
        self.file.close()


def pose_messages(poses: Floats, times: list[int]) -> list[tuple[int, dict[str, Any]]]:
    """Return the known ones of poses (n, 6) as messages, with their row numbers.

    Positions are in m; the quaternion is that of the rotation Rz(yaw) Ry Rx.
    """
    from scipy.spatial.transform import Rotation

    good = np.flatnonzero(np.isfinite(poses).all(axis=1))
    if not len(good):
        return []
    turns = Rotation.from_euler("ZYX", poses[good, 5:2:-1]).as_quat()
    return [
        (n, {
            "timestamp": {"sec": times[n] // NANO, "nsec": times[n] % NANO},
            "frame_id": "world",
            "pose": {
                "position": dict(zip("xyz", place, strict=True)),
                "orientation": dict(zip("xyzw", turn, strict=True)),
            },
        })
        for n, place, turn in zip(
            good.tolist(), (1e-3 * poses[good, :3]).tolist(), turns.tolist(), strict=True
        )
    ]  # fmt: skip


def sample_schema(content: dict[str, Any]) -> dict[str, Any]:
    """The JSON Schema of a sample with these columns."""

    def number(name: str) -> dict[str, str]:
        """The schema of a column, with its unit."""
        return {"type": "number", "description": unit_of(name, content["channels"])}

    groups = group_columns(numbers_of(sample_dtype(content)))
    residual = {name: number(name) for name in groups.pop("")}
    described = {
        group: {"type": "object", "properties": {name: number(name) for name in names}}
        for group, names in groups.items()
    }
    return {
        "title": "facets.Sample",
        "type": "object",
        "properties": {
            "timestamp": {"type": "number", "description": "s, UTC"},
            "seq": {"type": "integer"},
            "status": {"type": "integer", "description": "0: converged"},
            "flags": {"type": "integer"},
            **residual,
            **described,
        },
    }


def pose_schema() -> dict[str, Any]:
    """The JSON Schema of Foxglove's `PoseInFrame`."""

    def parts(names: str) -> dict[str, Any]:
        """The schema of an object of numbers, one for each letter."""
        return {"type": "object", "properties": {name: {"type": "number"} for name in names}}

    time = {"sec": {"type": "integer"}, "nsec": {"type": "integer"}}
    return {
        "title": "foxglove.PoseInFrame",
        "type": "object",
        "properties": {
            "timestamp": {"type": "object", "title": "time", "properties": time},
            "frame_id": {"type": "string"},
            "pose": {
                "type": "object",
                "title": "foxglove.Pose",
                "properties": {"position": parts("xyz"), "orientation": parts("xyzw")},
            },
        },
    }
