"""`facets replay` and `facets recover`: recordings solved again, and saved."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from collections.abc import Iterable


def replay(
    recording: Annotated[Path, typer.Argument(help="Folder of a recording.")],
    config: Annotated[
        str | None, typer.Option(help="Solve by this one.  [default: the recording's own]")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Poses: a CSV or Parquet file.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an older file.")] = False,
    real_time: Annotated[
        bool, typer.Option("--real-time", help="As slowly as it was recorded.")
    ] = False,
    compare: Annotated[
        bool, typer.Option("--compare", help="With the poses that were recorded.")
    ] = False,
) -> None:
    """Run a recording through the parser and the solver again.

    By the recording's own configuration the poses are those of the run, to the last bit.
    """
    from facets import load
    from facets.files import provenance, tables
    from facets.live.pipeline import Pipeline
    from facets.live.recording import meta_of
    from facets.live.replay import recorded_config, replayed

    meta_of(recording)
    settings = load(config) if config else recorded_config(recording)
    if output:
        tables.ending(output)
        tables.refuse_to_overwrite([output], force)
    pipeline = Pipeline(settings)
    found = list(replayed(recording, pipeline, real_time))
    tell(pipeline, recording)
    if output:
        write(output, found, provenance.about(settings))
    if compare:
        compared(recording, found)


def recover(
    recording: Annotated[Path, typer.Argument(help="Folder of a recording.")],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", help="Poses: CSV or Parquet.  [default: RECORDING/recovered.parquet]"
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an older file.")] = False,
) -> None:
    """Save what a recording holds, however it ended: solves its bytes into a table of poses.

    Nothing in the recording is changed or deleted.
    """
    from facets.files import provenance, tables
    from facets.live.pipeline import Pipeline
    from facets.live.replay import recorded_config, replayed

    path = output or recording / "recovered.parquet"
    settings = recorded_config(recording)
    tables.ending(path)
    tables.refuse_to_overwrite([path], force)
    pipeline = Pipeline(settings)
    write(path, replayed(recording, pipeline), provenance.about(settings))
    tell(pipeline, recording)
    typer.echo(f"{path}")


def write(path: Path, found: Iterable[Any], about: dict[str, str]) -> None:
    from facets.files import tables
    from facets.live.replay import labelled

    with tables.Whole(path) as temporary:
        writer = tables.Writer(temporary, about)
        try:
            for poses in found:
                writer.write(labelled(poses))
            if writer.file is None:
                from facets.core.errors import InputError

                raise InputError(f"{path}: not written, the recording holds no whole sample")
        finally:
            writer.close()


def tell(pipeline: Any, recording: Path) -> None:
    sequence, tally = pipeline.sequence, pipeline.tally
    typer.echo(
        f"{recording}: {tally.samples} samples, {sequence.lost} lost, "
        f"{pipeline.parser.corrupt} frames refused, {pipeline.parser.skipped} bytes passed over"
    )
    for label, count in tally.statuses.items():
        if count and label != "converged":
            typer.echo(f"  {count} {label}")


def compared(recording: Path, found: list[Any]) -> None:
    """Says whether the poses are those that were recorded, bit by bit."""
    import numpy as np

    from facets.live.recording import joined, pose_columns, recorded_poses

    old = recorded_poses(recording)
    new = joined([pose_columns(poses) for poses in found]) if found else {}
    count = len(old["seq"]) if old else 0
    same = all(np.array_equal(old[n], new[n][:count], equal_nan=True) for n in old)
    typer.echo(f"{count} recorded poses: {'identical' if same else 'NOT the same'}")
    if not same:
        raise typer.Exit(1)
