"""`facets replay` and `facets recover`: recordings solved again, and saved."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from facets.core.names import STATE_COLUMNS as POSE_COLUMNS

from .console import FINDING
from .options import ConfigOption, Force, Publish, RecordingName, Web, filter_option, output_option

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator


def replay(
    recording: RecordingName,
    config: ConfigOption = None,
    output: Annotated[
        Path | None, output_option("table of poses, CSV or Parquet, or MCAP", "none is written")
    ] = None,
    force: Force = False,
    real_time: Annotated[
        bool, typer.Option("--real-time", help="Replay at the speed at which it was recorded.")
    ] = False,
    compare: Annotated[
        bool,
        typer.Option(
            "--compare",
            help="Compare the poses with the recorded ones, bit by bit; exit status 1 if they "
            "differ.",
        ),
    ] = False,
    smooth: Annotated[
        str | None,
        typer.Option(
            metavar="MODEL",
            help="Also write poses smoothed over the whole recording by a motion whose "
            "acceleration, speed or place (one of these words) is nearly constant.",
        ),
    ] = None,
    filter_by: Annotated[
        str | None, filter_option("they are written to -o, or sent with --publish")
    ] = None,
    publish: Publish = None,
    web: Web = None,
) -> None:
    """Solve a recording again from its bytes.

    Solves every sample, including those that the run skipped because it was behind. With the
    recording's own configuration and the same version of facets, the poses equal the recorded ones
    to the last bit; --compare checks this.
    """
    from facets import load
    from facets.core.extras import require_extra
    from facets.files import tables
    from facets.live.recording.index import Damage
    from facets.live.recording.reader import meta_of
    from facets.live.recording.replay import recorded_config
    from facets.live.recording.replay import replay as run
    from facets.live.run.pipeline import Pipeline
    from facets.live.streams.publication import require_packages

    meta_of(recording, own=config is None)
    settings = load(config) if config else recorded_config(recording)
    if smooth:
        check_smoothing(output, smooth)
    if filter_by:
        check_filter(filter_by, bool(smooth), output, publish)
    if output:
        if is_mcap(output):
            require_extra("mcap.writer", str(output))
        else:
            tables.ending(output)
        tables.refuse_to_overwrite([output], force)
    require_packages(publish, web)
    pipeline, damage = Pipeline(settings), Damage()
    replayed = run(recording, pipeline, real_time, damage)
    if publish:
        replayed = published(replayed, recording, settings, publish, filter_by)
    with page_of(web, pipeline, recording) as page:
        found = list(page.following(replayed) if page else replayed)
        tell(pipeline, recording, damage)
        if output and filter_by:
            write_filtered(output, found, pipeline, filter_by)
        else:
            save(output, found, pipeline, recording, smooth or "")
        if compare:
            compared(recording, found, pipeline, damage, config)
        if page:
            page.stay(lambda text: typer.echo(text, err=True))


def page_of(web: str | None, pipeline: Any, recording: Path) -> AbstractContextManager[Any]:
    """The page of a replay, which says where it is; None where none is asked for."""
    if web is None:
        return nullcontext()
    from facets.live.web.replay_page import ReplayPage
    from facets.pictures.page.scripts import rig_scripts

    page = ReplayPage(pipeline, recording, web, rig_scripts(pipeline.config.sensor))
    for text in page.page.greeting():
        typer.echo(text, err=True)
    return page


def save(output: Path | None, found: list[Any], pipeline: Any, recording: Path, model: str) -> None:
    """The poses as a table, smoothed by a model, if one is named."""
    from facets.files import provenance

    about = provenance.about(pipeline.config)
    if output and model:
        write_smoothed(output, found, pipeline, model)
    elif output and is_mcap(output):
        write_mcap(output, found, recording, about)
    elif output:
        write(output, found, about, pulses_of(pipeline.config, recording))


def check_smoothing(output: Path | None, model: str) -> None:
    from facets.core.errors import InputError
    from facets.live.run.smoothing import MODELS

    if output is None or is_mcap(output):
        raise InputError("--smooth needs -o, a table for the smoothed poses")
    if model not in MODELS:
        raise InputError(f"--smooth {model}: is no model; give {', '.join(MODELS)}")


def check_filter(model: str, smooth: bool, output: Path | None, publish: list[str] | None) -> None:
    from facets.core.errors import InputError
    from facets.live.run.smoothing import MODELS

    if model not in MODELS:
        raise InputError(f"--filter {model}: is no model; give {', '.join(MODELS)}")
    if smooth:
        raise InputError("--filter and --smooth are two ways to say more of a pose; give one")
    if not publish and (output is None or is_mcap(output)):
        raise InputError("--filter needs -o, a table for the filtered poses, or --publish")


def write_filtered(path: Path, found: list[Any], pipeline: Any, model: str) -> None:
    """The table of poses, with those that a live run would have had beside them."""
    import numpy as np

    from facets.core.errors import InputError
    from facets.files import provenance, tables
    from facets.live.recording.replay import label
    from facets.live.run.pipeline import join_poses
    from facets.live.streams.filtered_rows import WIDE, RowFilter
    from facets.live.streams.sample_rows import SAMPLE, rows_of

    if not found:
        raise InputError(f"{path}: not written, the recording holds no whole sample")
    rows = RowFilter(pipeline.config, model, pipeline.tally.misfit.carried)
    wide = np.concatenate([rows.widen(rows_of(poses, 0.0)) for poses in found])
    columns = {name: wide[name] for name in (WIDE.names or ())[len(SAMPLE.names or ()) :]}
    about = provenance.about(pipeline.config) | {"filtered": f"constant {model}"}
    tables.write_table(path, {**label(join_poses(found)), **columns}, about)
    typer.echo(f"  filtered by constant {model}; {rows.sentence}")


def write_smoothed(path: Path, found: list[Any], pipeline: Any, model: str) -> None:
    """The table of poses, with those that all samples together make likeliest beside them."""
    from facets.core.errors import InputError
    from facets.files import provenance, tables
    from facets.live.recording.replay import label
    from facets.live.run.pipeline import join_poses
    from facets.live.run.smoothing import smoothed_columns

    if not found:
        raise InputError(f"{path}: not written, the recording holds no whole sample")
    poses, carried = join_poses(found), pipeline.tally.misfit.carried
    try:
        columns, result = smoothed_columns(
            pipeline.config, 1e-6 * poses.time.astype(float), poses.solution, carried, model
        )
    except ValueError as error:
        raise InputError(f"{path}: not written: {error}") from None
    about = provenance.about(pipeline.config) | {"smoothed": f"constant {model}"}
    tables.write_table(path, {**label(poses), **columns}, about)
    typer.echo(f"  smoothed by constant {model}; {result.sentence}")


def is_mcap(path: Path) -> bool:
    return path.suffix.lower() == ".mcap"


def write_mcap(path: Path, found: list[Any], recording: Path, about: dict[str, str]) -> None:
    from facets.files.whole import Whole
    from facets.live.recording.reader import utc_offset
    from facets.live.streams.mcap_file import McapFile

    with Whole(path) as temporary, McapFile(temporary, about, utc_offset(recording) or 0.0) as file:
        for poses in found:
            file.write(poses)


def published(
    replayed: Iterable[Any],
    recording: Path,
    settings: Any,
    addresses: list[str],
    filter_by: str | None,
) -> Iterator[Any]:
    """The same poses; each is given to other programs on its way."""
    from facets.live.recording.reader import utc_offset
    from facets.live.streams.publication import Publications

    offset = utc_offset(recording)
    with Publications(addresses, settings, True, offset, filter_by) as publications:
        typer.echo(f"publishing at {', '.join(publications.places())}", err=True)
        for poses in replayed:
            publications.add_poses(poses)
            yield poses
    for text in publications.sentences():
        typer.echo(text)


def recover(
    recording: RecordingName,
    output: Annotated[
        Path | None,
        output_option("table of poses, CSV or Parquet", "RECORDING/recovered.parquet"),
    ] = None,
    force: Force = False,
) -> None:
    """Solve the bytes of an interrupted or damaged recording into a table of poses.

    The recording itself is not changed.
    """
    from facets.files import provenance, tables
    from facets.live.recording.index import Damage
    from facets.live.recording.replay import recorded_config
    from facets.live.recording.replay import replay as run
    from facets.live.run.pipeline import Pipeline

    path = output or recording / "recovered.parquet"
    settings = recorded_config(recording)
    tables.ending(path)
    tables.refuse_to_overwrite([path], force)
    pipeline, damage = Pipeline(settings), Damage()
    replayed = run(recording, pipeline, damage=damage, salvage=True)
    write(path, replayed, provenance.about(settings))
    tell(pipeline, recording, damage)
    typer.echo(f"{path}")


def pulses_of(settings: Any, recording: Path) -> tuple[Any, float] | None:
    """The clock that a pulse per second steers, and UTC over the host's clock; None without."""
    if settings.acquire.mark != "pps":
        return None
    from facets.live.recording.reader import utc_offset
    from facets.live.run.pulses import PulseClock

    return PulseClock(), utc_offset(recording) or 0.0


def write(
    path: Path,
    found: Iterable[Any],
    about: dict[str, str],
    pulses: tuple[Any, float] | None = None,
) -> None:
    """The table of poses. pulses: see `pulses_of`."""
    from facets.files import tables
    from facets.live.recording.replay import label
    from facets.live.run.pulses import pulse_columns

    with tables.Whole(path) as temporary:
        writer = tables.Writer(temporary, about)
        try:
            for poses in found:
                columns = label(poses)
                if pulses is not None:
                    columns |= pulse_columns(poses, pulses[1], pulses[0])
                writer.write(columns)
            if writer.file is None:
                from facets.core.errors import InputError

                raise InputError(f"{path}: not written, the recording holds no whole sample")
        finally:
            writer.close()
    if pulses is not None:
        typer.echo(f"  {pulses[0].sentence}")


def tell(pipeline: Any, recording: Path, damage: Any) -> None:
    """What the replay found, and what of the recording is not as it was written."""
    sequence, tally = pipeline.sequence, pipeline.tally
    typer.echo(
        f"{recording}: {tally.samples} samples, {sequence.lost} lost, "
        f"{pipeline.parser.corrupt} frames refused, {pipeline.parser.skipped} bytes passed over"
    )
    if sequence.restarts:
        typer.echo(f"  the board restarted {sequence.restarts} times; what it lost is not known")
    if damage.words:
        typer.echo(f"  damaged: {damage.words}")
    for label, count in tally.statuses.items():
        if count and label != "converged":
            typer.echo(f"  {count} {label}")
    if tally.misfit.sentence:
        typer.echo(f"  {tally.misfit.sentence}")
    for text in (pipeline.board.sentence(), pipeline.board.trouble()):
        if text:
            typer.echo(f"  {text}")


def compared(
    recording: Path, found: list[Any], pipeline: Any, damage: Any, config: str | None
) -> None:
    """Says whether the poses are those that were recorded, bit by bit, and all of them."""
    from facets.live.recording.pose_table import join_columns, pose_columns, recorded_poses
    from facets.live.recording.reader import seal_of
    from facets.live.recording.replay import compare

    new = join_columns([pose_columns(poses) for poses in found]) if found else {}
    seen, seal = compare(recorded_poses(recording), new), seal_of(recording)
    lost = max(0, seal.poses - seen.recorded) if seal else 0
    count = seen.recorded - seen.skipped - seen.absent
    of_all = f" of {seal.poses}" if seal and lost else ""
    verdict = "identical" if seen.same else f"NOT the same in {seen.different} samples"
    typer.echo(f"{count}{of_all} recorded poses: {verdict if count else 'nothing can be compared'}")
    if seen.skipped:
        typer.echo(f"  {seen.skipped} samples were skipped in the run, and are solved now")
    if lost:
        typer.echo(f"  {recording / 'poses.arrows'}: {lost} poses are missing or damaged")
    refused = bool(seal and seal.refused_bytes and not damage.words)
    if seen.absent:
        why = (
            "without their bytes, which the disk refused"
            if refused
            else "and their bytes cannot be read any more"
            if damage.words
            else "but the bytes hold no such samples; the cause is unknown"
        )
        typer.echo(f"  {seen.absent} were recorded {why}")
    incomplete = bool(lost) or (bool(seen.absent) and not refused)
    if seen.unrecorded:
        incomplete |= tell_unrecorded(seen, seal, lost)
    if seen.different:
        tell_different(recording, seen, damage, config)
    if seen.different or incomplete:
        raise typer.Exit(FINDING)


def tell_unrecorded(seen: Any, seal: Any, lost: int) -> bool:
    """Says which samples have no pose on record, and why if known; whether that is a loss."""
    first, last = seen.ends
    text = f"  {seen.unrecorded} samples, from {first} to {last}, have no recorded pose"
    if seal is None:
        typer.echo(
            f"{text}; how many poses were recorded is unknown, because the end of events.jsonl, "
            "which says that, is missing: the run was killed, the power failed, an older version "
            "recorded it, or it was cut off"
        )
        return True
    why = "the disk refused them" if seal.refused_poses else "the cause is unknown"
    typer.echo(text if lost else f"{text}; {why}")
    return not seal.refused_poses


def tell_different(recording: Path, seen: Any, damage: Any, config: str | None) -> None:
    """Says in what recorded and new poses differ, and the cause if it is known."""
    from facets.core.version import __version__
    from facets.live.recording.reader import meta_of

    names = ", ".join(seen.columns[:8]) + (", ..." if len(seen.columns) > 8 else "")
    typer.echo(f"  they differ in {names}")
    if any(name in seen.columns for name in POSE_COLUMNS):
        typer.echo(
            f"  the largest difference of a pose is {seen.worst:.2g} of the standard uncertainty"
        )
    version = meta_of(recording, own=False).get("facets")
    if config is not None:
        typer.echo(f"  they are solved by {config}, not by the recording's own configuration")
    elif version != __version__:
        typer.echo(f"  facets {version} recorded them, facets {__version__} solved them again")
    elif damage.since is not None and damage.since <= seen.since:
        typer.echo(
            f"  the recording is damaged (see above) from sample {damage.since} on, before the "
            "first difference: what an arrival time or a lost byte changes, changes later samples"
        )
    else:
        typer.echo(f"  the cause is unknown; the first difference is in sample {seen.since}")
