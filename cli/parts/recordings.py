"""A recording, solved for the commands that read one."""

from __future__ import annotations

from typing import TYPE_CHECKING

import typer

from facets import live

from ..console import show_progress

if TYPE_CHECKING:
    from facets.characterization.rest import Columns


def solve_recording(playback: live.Playback) -> Columns:
    """Solve a recording for poses as columns, with a bar; print what is damaged."""
    with show_progress("solving the recording") as tell:
        parts = [poses.columns() for poses in playback.poses(tell=tell)]
    pipeline = playback.pipeline
    if playback.damage.words or pipeline.parser.corrupt or pipeline.sequence.lost:
        typer.echo("\n".join(playback.sentences()))
    return live.recording.pose_table.join_columns(parts) if parts else {}
