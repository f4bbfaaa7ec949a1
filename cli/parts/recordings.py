"""A recording, solved for the commands that read one."""

from __future__ import annotations

from typing import TYPE_CHECKING

from facets import core, files, live

from ..console import show_progress

if TYPE_CHECKING:
    from facets.noise_analysis.rest import Columns


def solve_recording(playback: live.Playback) -> Columns:
    """Solve a recording for poses as columns, with a bar; print what is damaged."""
    with show_progress("solving the recording") as on_progress:
        parts = [poses.columns() for poses in playback.poses(on_progress=on_progress)]
    pipeline = playback.pipeline
    sequence = pipeline.sequence
    if playback.damage.words or pipeline.parser.corrupt or sequence.lost or sequence.leaps:
        print("\n".join(playback.sentences()))
    columns = files.columns.join_columns(parts) if parts else {}
    report_clock(columns)
    return columns


def report_clock(columns: Columns) -> None:
    """Print by how much a board's clock is off, if the times of the arrivals replace its own."""
    rate = files.columns.clock_rate(columns)
    if rate and rate < 1 - core.clocks.STANDSTILL:
        print(
            f"{core.clocks.describe_rate(rate)}. The times and frequencies here are those of the "
            "arrivals."
        )
