"""`facets replay`: a recording solved again."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import Annotated

import typer

import facets
from facets import estimation, live, pictures
from facets.files.whole import STANDARD_STREAM

from .console import FINDING, free_output
from .options import (
    ConfigOption,
    Covariance,
    Force,
    Point,
    RecordingName,
    Web,
    Zero,
    output_option,
)
from .options.places import choose_point, zero_of
from .parts.run_display import tell

Output = Annotated[
    Path | None,
    output_option(
        "table of poses (CSV, .csv.gz, - for standard output, Parquet, or HDF5), or MCAP",
        "none is written; with --recover RECORDING/recovered.parquet",
    ),
]
Recover = Annotated[
    bool,
    typer.Option(
        "--recover",
        help="Solve as many bytes of an interrupted or damaged recording as can be read, and "
        "write the poses to the table of -o.",
    ),
]
Compare = Annotated[
    bool,
    typer.Option(
        "--compare",
        help="Compare the poses with the recorded ones, bit by bit; exit status 1 if they differ.",
    ),
]


def replay(
    recording: RecordingName,
    config: ConfigOption = None,
    output: Output = None,
    force: Force = False,
    recover: Recover = False,
    compare: Compare = False,
    web: Web = None,
    point: Point = None,
    zero: Zero = None,
    covariance: Covariance = False,
) -> None:
    """Solve a recording again from its bytes.

        facets replay recordings/run -o poses.parquet
        facets replay recordings/run --compare

    Solves every sample, including those that the run skipped because it was behind. With the
    recording's own configuration and the same version of facets, the poses equal the recorded ones
    to the last bit; --compare checks this. The recording itself is not changed. With an object in
    the configuration or --point, each sample also has the pose of that object, and with --zero its
    displacement. Exit status 1 if no sample gave a pose, or if --compare finds a difference.
    """
    if recover and output is None:
        output = recording / "recovered.parquet"
    written = [] if output in (None, STANDARD_STREAM) else [str(output)]
    request = zero_of(zero)
    live.refuse_output(output, force, request)
    live.require_packages((), web)
    playback = live.Playback(
        recording,
        facets.load(config) if config else None,
        change=lambda settings: choose_point(settings, point),
        columns=estimation.PoseColumns(request, covariance),
    )
    poses = playback.poses(recover)
    with open_page(playback, web) as page:
        sentences, is_same = playback.finish(
            page.following(poses) if page else poses, output, compare, config
        )
        with free_output(output):
            print("\n".join([*sentences, *written]))
        if page and is_same:
            page.stay(tell)
    require_poses(playback)
    if not is_same:
        raise typer.Exit(FINDING)


def require_poses(playback: live.Playback) -> None:
    """End with status 1 if no sample gave a pose, and say what they gave."""
    if reason := playback.pipeline.tally.pose_complaint():
        tell(f"exit status {FINDING}: {reason}")
        raise typer.Exit(FINDING)


def open_page(playback: live.Playback, web: str | None) -> live.ReplayPage | nullcontext[None]:
    """Open the page of a replay and print its address; no page without --web."""
    if web is None:
        return nullcontext()
    scripts = pictures.page.scripts.rig_scripts(playback.config.sensor)
    page = live.ReplayPage(playback.pipeline, playback.folder, web, scripts)
    for text in page.page.greeting():
        tell(text)
    return page
