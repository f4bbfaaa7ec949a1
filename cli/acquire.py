"""`facets acquire`: a detector board's stream, recorded, solved and followed as it comes."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from facets.config import Config
    from facets.live.acquire import Live
    from facets.live.recording import Recording
    from facets.live.tracker import Tracker


def acquire(
    config: Annotated[str, typer.Argument(help="Name of a shipped config, or a YAML file.")],
    port: Annotated[
        str | None, typer.Option(help="Of the detector board.  [default: the config's]")
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="Folder of the recording.  [default: recordings/TIME]"),
    ] = None,
    record: Annotated[
        bool, typer.Option("--record/--no-record", help="Keep all that comes.")
    ] = True,
    track: Annotated[
        bool, typer.Option("--track", help="Move the stage so that the beam follows the mirror.")
    ] = False,
    stage_port: Annotated[
        str | None, typer.Option(help="Of the stage.  [default: the config's]")
    ] = None,
    search: Annotated[
        bool, typer.Option("--search", help="With --track: look for a mirror that was lost.")
    ] = False,
    seconds: Annotated[float | None, typer.Option(min=0, help="Then it ends.")] = None,
    samples: Annotated[int | None, typer.Option(min=1, help="Then it ends.")] = None,
    reconnect: Annotated[
        bool, typer.Option("--reconnect", help="Wait for an unplugged board, and go on.")
    ] = False,
    max_loss: Annotated[
        float, typer.Option(min=0, max=1, help="Share of lost samples for exit status 1.")
    ] = 0.001,
    plain: Annotated[bool, typer.Option("--plain", help="Lines of text, for a log.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Lines of JSON, for a program.")] = False,
    rate: Annotated[float | None, typer.Option(min=0.1, max=50, help="Of the display, Hz.")] = None,
) -> None:
    """Acquire a stream of detector counts and solve every sample.

    All that comes is recorded before anything else is done with it. With --track the stage moves;
    without, it never does. Ends on Ctrl-C, and then stops the stage and closes the recording.
    """
    from facets import load
    from facets.live.acquire import Ending, Live, Reader
    from facets.live.acquire import acquire as run
    from facets.live.pipeline import Pipeline

    settings = load(config)
    name = required(port or settings.acquire.port, "--port", "acquire.port")
    live = Live(Pipeline(settings))
    warm_up(live)
    recording = started(settings, output) if record else None
    try:
        if track:
            live.tracker = tracker_of(settings, stage_port, search, recording)
        reader = Reader(settings, name, recording, reconnect, live)
    except BaseException:
        abandon(recording)
        raise
    ending = Ending(seconds or float("inf"), samples or float("inf"))
    with display(live, plain, json, rate) as show:
        run(live, reader, recording, ending, show)
    report(live, recording)
    if live.loss > max_loss or not live.pipeline.tally.samples:
        raise typer.Exit(1)


def abandon(recording: Recording | None) -> None:
    """Takes back a recording in which nothing is yet."""
    if recording is None:
        return
    recording.close()
    for file in recording.folder.iterdir():
        file.unlink()
    recording.folder.rmdir()


def required(value: str | None, option: str, key: str) -> str:
    from facets.core.errors import InputError

    if not value:
        raise InputError(f"no port is given: give {option}, or {key} in the configuration")
    return value


def warm_up(live: Live) -> None:
    """Compiles, or loads, what the stream will need, before it runs."""
    import numpy as np

    live.pipeline.solved(np.full((2, 9), 0.1), np.zeros(2), None)
    live.pipeline.state = np.zeros(8)


def started(settings: Config, output: Path | None) -> Recording:
    import time
    from datetime import UTC, datetime

    from facets.files.provenance import run_record
    from facets.live.recording import Recording

    now = datetime.now(UTC)
    folder = output or Path("recordings") / now.strftime("%Y%m%d-%H%M%S")
    begin = {"begin_utc": now.isoformat(), "begin_monotonic": time.monotonic()}
    return Recording(folder, run_record(settings, None, 0.0, begin), settings.resolved)


def tracker_of(
    settings: Config, port: str | None, search: bool, recording: Recording | None
) -> Tracker:
    """Opens the stage, and says how well it will follow before it moves."""
    import numpy as np

    from facets.characterization.ranges import axis_ranges
    from facets.live.pi import Pi
    from facets.live.ports import opened
    from facets.live.tracker import Tracker
    from facets.live.zaber import Zaber
    from facets.tracking.control import Law, margin_of, pull_of

    stage = settings.stage
    name = required(port or stage.port, "--stage-port", "stage.port")
    fixed = axis_ranges(settings.sensor, settings.range, np.zeros(6))[:2]
    room = min(axis.symmetric / 2 for axis in fixed)
    margin = margin_of(stage, pull_of(settings.sensor, room))
    typer.echo(f"stage: {stage.law}, {margin.words}", err=True)
    if margin.times < 1:
        from facets.core.errors import InputError

        raise InputError(
            f"stage.gain is {stage.gain}: with a delay of {1e3 * margin.delay:.3g} ms at "
            f"{stage.rate:g} Hz the loop is unstable; allowed: below {margin.most:.3g}"
        )
    line = opened(name, stage.baud, 0.5)
    driver = Zaber(line, stage) if stage.driver == "zaber" else Pi(line, stage)
    say = recording.event if recording else lambda *_, **__: None
    return Tracker(driver, stage, Law.of(settings.sensor, stage), say, search)


def display(
    live: Live, plain: bool, json: bool, rate: float | None
) -> AbstractContextManager[Callable[[Live], None]]:
    """A view in the terminal, or lines; gives what is to be called often and shows now and then."""
    import sys
    import time

    from facets.live import view

    if json or plain or not sys.stdout.isatty():
        every, last = 1 / (rate or (8 if json else 1)), [time.monotonic()]

        def line(now: Live) -> None:
            if time.monotonic() - last[0] >= every:
                last[0] = time.monotonic()
                typer.echo(view.json_line(now) if json else view.plain_line(now))

        return nullcontext(line)
    shown: AbstractContextManager[Callable[[Live], None]] = terminal(live, rate or 8)
    return shown


def terminal(live: Live, rate: float) -> Any:
    from contextlib import contextmanager

    from rich.live import Live as Screen

    from facets.live.view import panel

    @contextmanager
    def shown() -> Any:
        with Screen(get_renderable=lambda: panel(live), refresh_per_second=rate, transient=False):
            yield lambda _: None

    return shown()


def report(live: Live, recording: Recording | None) -> None:
    from facets.live.view import plain_line

    typer.echo(plain_line(live))
    typer.echo(f"{live.pipeline.tally.samples} samples, {100 * live.loss:.4f} % lost")
    for label, count in live.pipeline.tally.statuses.items():
        if label != "converged" and count:
            typer.echo(f"  {count} {label}")
    for name, count in live.pipeline.tally.flags.items():
        if count:
            typer.echo(f"  {count} {name}")
    if recording:
        typer.echo(f"{recording.folder}/")
