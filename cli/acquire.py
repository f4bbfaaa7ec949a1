"""`facets acquire`: a detector board's stream, recorded, solved and followed as it comes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .options import (
    ConfigName,
    Publish,
    Seconds,
    Track,
    Web,
    filter_option,
    folder_option,
    write_option,
)

if TYPE_CHECKING:
    from facets.config import Config
    from facets.live.acquire import Ending, Live, Reader
    from facets.live.recording import Recording
    from facets.live.web.page import WebPage
    from facets.tracking.check import StageCheck
    from facets.tracking.tracker import Tracker


PortName = Annotated[
    str | None,
    typer.Option(
        help="Serial port, TCP address or file of the detector board.  [default: the "
        "configuration's `acquire.port`]"
    ),
]
Record = Annotated[
    bool,
    typer.Option("--record/--no-record", help="Record all received bytes and poses in the folder."),
]
StagePort = Annotated[
    str | None,
    typer.Option(
        help="Serial port or TCP address of the stage.  [default: the configuration's `stage.port`]"
    ),
]
SearchMirror = Annotated[
    bool,
    typer.Option(
        "--search-mirror/--no-search-mirror",
        help="With --track: move the stage to search for a mirror that the beam has lost, after a "
        "person has resumed the stopped stage.",
    ),
]
CheckStage = Annotated[
    bool,
    typer.Option(
        "--check-stage",
        help="Move the stage by 0.05 mm along each axis and check with the readings that it is "
        "wired as configured. The mirror must stand still.",
    ),
]
Write = Annotated[
    Path | None,
    write_option("the date of a passed --check-stage, which --track requires"),
]
Samples = Annotated[
    int | None,
    typer.Option(min=1, help="Stop after this many samples.  [default: never]"),
]
Reconnect = Annotated[
    bool,
    typer.Option("--reconnect", help="Wait for a detector board that was unplugged, then go on."),
]
MaxLoss = Annotated[
    float,
    typer.Option(
        min=0, max=1, help="Largest share of lost samples (0 to 1) that still ends with status 0."
    ),
]
AsLines = Annotated[
    bool, typer.Option("--plain", help="Print lines of text, for a log, instead of a live display.")
]
AsJson = Annotated[
    bool,
    typer.Option("--json", help="Print lines of JSON, for a program, instead of a live display."),
]
CompareBoard = Annotated[
    bool,
    typer.Option(
        "--compare-board",
        help="Compare the poses with those that the board computes itself; exit status 1 if they "
        "differ.",
    ),
]
DisplayRate = Annotated[
    float | None,
    typer.Option(
        min=0.1,
        max=50,
        help="Updates of the display per second.  [default: 8, with --plain 1]",
    ),
]


def acquire(
    config: ConfigName,
    port: PortName = None,
    folder: Annotated[Path | None, folder_option("recordings/TIME")] = None,
    record: Record = True,
    track: Track = False,
    stage_port: StagePort = None,
    search_mirror: SearchMirror = True,
    check_stage: CheckStage = False,
    write: Write = None,
    seconds: Seconds = None,
    samples: Samples = None,
    reconnect: Reconnect = False,
    max_loss: MaxLoss = 0.001,
    plain: AsLines = False,
    json: AsJson = False,
    display_rate: DisplayRate = None,
    publish: Publish = None,
    filter_by: Annotated[str | None, filter_option("they are sent with --publish")] = None,
    web: Web = None,
    compare_board: CompareBoard = False,
) -> None:
    """Record the data of a detector board and solve every sample as it arrives.

    All received bytes are recorded before they are used. The stage moves only with --track or
    --check-stage. A stopped stage stays stopped until a person resumes it with the key r, the
    button on the web page, or SIGUSR1. Ctrl-C, SIGTERM and closing the terminal end the run: the
    stage is stopped first, and the recording is closed last.

    Exit status 1 if too many samples were lost, no sample arrived, most samples did not fit, the
    stage was stopped and not resumed, or the check of the stage or the disk failed; the command
    prints which. Exit status 2 if it cannot start or the port is closed; after SIGTERM or SIGHUP
    128 plus the signal's number.
    """
    from facets import load
    from facets.live.acquire import Ending, Live
    from facets.live.pipeline import Pipeline
    from facets.live.publication import require_packages
    from facets.tracking.check import StageCheck

    check_options(seconds, plain, json)
    check_filter(filter_by, publish)
    check_write(write, check_stage, track)
    settings = load(config)
    name = required(port or settings.acquire.port, "--port", "acquire.port")
    if track or check_stage:
        check_lines(settings, name)
    if check_stage:
        settings = with_free_beam(settings)
    require_packages(publish, web)
    live = Live(Pipeline(settings))
    live.pipeline.warm_up()
    recording = started(settings, folder) if record else None
    try:
        page = receivers(live, settings, publish or [], web, filter_by, track)
        if track or check_stage:
            live.tracker = tracker_of(settings, stage_port, search_mirror, recording, check_stage)
            if page:
                page.resume = partial(live.tracker.resume, "the page")
        reader = reader_of(settings, name, recording, reconnect, live)
    except BaseException:
        abandon(live, recording)
        raise
    check = live.tracker if isinstance(live.tracker, StageCheck) else None
    limits = seconds or float("inf"), samples or float("inf")
    ending = Ending(*limits, lambda: check is not None and check.is_over)
    shown = display(live, plain, json, display_rate)
    judge = partial(complaints, max_loss=max_loss, compare=compare_board)
    stream(live, reader, recording, ending, on_page(page, shown) if page else shown, judge)
    reasons = judge(live)
    if check:
        tell_check(check, settings, stage_port, write, not reasons)
    for reason in reasons:
        tell(f"exit status 1: {reason}")
    if reasons:
        raise typer.Exit(1)


def check_write(path: Path | None, check_stage: bool, track: bool) -> None:
    """Refuses two uses of the stage at once, and a file that could not be meant or be written."""
    from facets.core.errors import InputError
    from facets.files.whole import refuse_to_overwrite

    if check_stage and track:
        raise InputError("--check-stage and --track both move the stage; check it first")
    if path is None:
        return
    if not check_stage:
        raise InputError("--write needs --check-stage: it writes what the check finds")
    if path.suffix.lower() not in (".yaml", ".yml"):
        raise InputError(f"{path}: a configuration's name ends in .yaml or .yml")
    refuse_to_overwrite([path], False)


def with_free_beam(settings: Config) -> Config:
    """The readings alone say where the beam is, and not where it should be."""
    from dataclasses import replace

    return replace(settings, solve=replace(settings.solve, beam="free"))


def require_check(settings: Config, port: str) -> None:
    """Refuses a stage whose wiring was not checked."""
    from facets.core.errors import InputError
    from facets.tracking.check import stage_checked

    known, here = settings.stage.checked, stage_checked(settings.stage, port)
    if known and known.partition(" ")[2] == here:
        return
    what = f"is {known!r}, and so of another stage than {here!r}" if known else "is not given"
    raise InputError(
        f"stage.checked {what}: run `facets acquire CONFIG --check-stage --write FILE.yaml` once, "
        "with the mirror at rest, and then track with FILE.yaml"
    )


def tell_check(
    check: StageCheck, settings: Config, port: str | None, path: Path | None, is_good: bool
) -> None:
    """What the check found, and where that is written."""
    from facets.files import provenance, whole
    from facets.tracking.check import checked_today

    if check.leg == len(check.LEGS):
        for axis in check.axes():
            typer.echo(axis.sentence)
    if not is_good:
        return
    stage = settings.stage
    s = 1e3 * (stage.latency + stage.lag)
    typer.echo(
        "The stage is wired as the configuration has it. It counts on a delay of "
        f"{s:.3g} ms (stage.latency_ms and stage.lag_ms)."
    )
    value = checked_today(stage, str(port or stage.port))
    if path is None:
        typer.echo(f"For --track, write into the configuration: stage: {{checked: {value}}}")
        return
    block = {**settings.resolved["stage"], "checked": value}
    with whole.Whole(path) as temporary:
        about = provenance.about(settings)
        temporary.write_text(provenance.configuration(settings, block, about, "stage"), "utf-8")
    typer.echo(f"{path}")


def receivers(
    live: Live,
    settings: Config,
    publish: list[str],
    web: str | None,
    filter_by: str | None,
    carried: bool,
) -> WebPage | None:
    """Begins to give samples away, and says where; the page, if there is one."""
    if not publish and web is None:
        return None
    from facets.live.publication import Publications

    live.publications = Publications(publish, settings, filter_by=filter_by, carried=carried)
    if publish:
        tell(f"publishing at {', '.join(live.publications.places())}")
    if web is None:
        return None
    from facets.live.web.page import WebPage
    from facets.live.web.status import status_of
    from facets.pictures.page.scripts import rig_scripts

    more = {"kind": "acquire"}
    page = WebPage(settings, web, lambda: status_of(live), more, drawn=rig_scripts(settings.sensor))
    live.publications.all.append(page)
    for text in page.greeting():
        tell(text)
    page.show()
    return page


@contextmanager
def on_page(
    page: WebPage, shown: AbstractContextManager[Callable[[Live], None]]
) -> Iterator[Callable[[Live], None]]:
    """The same view, and beside it what the page is told; it goes on where a terminal closes."""
    gone = False
    with shown as show:

        def both(live: Live) -> None:
            nonlocal gone
            page.show()
            try:
                if not gone:
                    show(live)
            except OSError:
                gone = True

        yield both


def reader_of(
    settings: Config, port: str, recording: Recording | None, reconnect: bool, live: Live
) -> Reader:
    from facets.live.acquire import Reader

    return Reader(settings, port, recording, reconnect, live, tell)


def stream(
    live: Live,
    reader: Reader,
    recording: Recording | None,
    ending: Ending,
    shown: AbstractContextManager[Callable[[Live], None]],
    judge: Callable[[Live], list[str]],
) -> None:
    """Runs to the end and sums up. What went wrong is told after what came until then."""
    from facets.core.errors import FacetsError
    from facets.live.acquire import acquire as run

    failure: FacetsError | None = None
    with shown as show:
        try:
            run(live, reader, recording, ending, show, judge)
        except FacetsError as error:
            failure = error
    report(live, recording)
    if failure:
        raise failure


def check_options(seconds: float | None, plain: bool, json: bool) -> None:
    """Refuses what can not be meant."""
    from facets.core.errors import InputError

    if seconds == 0:
        raise InputError(
            "--seconds 0 would end before it begins; give more, or leave it out to run until ^C"
        )
    if plain and json:
        raise InputError("--plain and --json are two ways to show the same; give one of them")


def check_filter(model: str | None, publish: list[str] | None) -> None:
    """Refuses a model that is none, and filtered poses that nobody would get."""
    from facets.core.errors import InputError

    if model is None:
        return
    from facets.live.smoothing import MODELS

    if model not in MODELS:
        raise InputError(f"--filter {model}: is no model; give {', '.join(MODELS)}")
    if not publish:
        raise InputError("--filter needs --publish: filtered poses go to other programs")


def tell(text: str) -> None:
    """On the standard error, which may be gone with its terminal."""
    from contextlib import suppress

    with suppress(OSError):
        typer.echo(text, err=True)


def complaints(live: Live, max_loss: float, compare: bool = False) -> list[str]:
    """Why a run that came to its end is not a good one, in sentences."""
    from facets.tracking.check import StageCheck

    found = []
    if not live.pipeline.tally.samples:
        found.append("no sample came.")
    if live.loss > max_loss:
        found.append(
            f"{live.pipeline.sequence.lost} samples were lost, {100 * live.loss:.3g} % of all; "
            f"--max-loss allows {100 * max_loss:.3g} %."
        )
    if live.pipeline.tally.misfit.mostly:
        found.append(live.pipeline.tally.misfit.sentence)
    board = live.pipeline.board
    if compare and not board.compared:
        found.append("the board sent no pose of its own that could be compared.")
    elif compare and board.trouble():
        found.append(board.trouble())
    if isinstance(live.tracker, StageCheck):
        return found + live.tracker.faults()
    if live.stage_stop:
        found.append(f"the stage was stopped and not resumed: {live.stage_stop}")
    if live.recording and live.recording.trouble:
        found.append(
            f"{live.recording.trouble}; {live.recording.lost} bytes that came are not recorded."
        )
    return found


def abandon(live: Live, recording: Recording | None) -> None:
    """Lets go of a stage that was not started, and takes back a recording that holds nothing."""
    from contextlib import ExitStack

    with ExitStack() as closing:
        if recording is not None:
            closing.callback(recording.discard)
        if live.tracker is not None:
            closing.callback(live.tracker.close)
        if live.publications is not None:
            closing.callback(live.publications.close)


def required(value: str | None, option: str, key: str) -> str:
    from facets.core.errors import InputError

    if not value:
        raise InputError(f"no port is given: give {option}, or {key} in the configuration")
    return value


def started(settings: Config, output: Path | None) -> Recording:
    import time
    from datetime import UTC, datetime

    from facets.files.provenance import run_record
    from facets.live.recording import Recording

    now = datetime.now(UTC)
    folder = output or Path("recordings") / now.strftime("%Y%m%d-%H%M%S")
    begin = {"begin_utc": now.isoformat(), "begin_monotonic": time.monotonic()}
    meta = run_record(settings, None, 0.0, begin)
    return Recording(folder, meta, settings.resolved, settings.acquire.sync)


def tracker_of(
    settings: Config, port: str | None, search: bool, recording: Recording | None, check: bool
) -> Tracker:
    """Opens the stage, and says how well it will follow before it moves."""
    import numpy as np

    from facets.characterization.ranges import axis_ranges
    from facets.live.ports import open_line
    from facets.tracking.check import StageCheck
    from facets.tracking.control import Law, margin_of, pull_of
    from facets.tracking.tracker import Tracker

    stage = settings.stage
    name = required(port or stage.port, "--stage-port", "stage.port")
    if not check:
        require_check(settings, name)
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

    def open_stage() -> Any:
        return name if stage.driver == "other" else open_line(name, stage.baud, 0.02)

    say = recording.event if recording else lambda *_, **__: None
    law = Law.of(settings.sensor, stage)
    if check:
        return StageCheck(open_stage(), stage, law, say)
    return Tracker(open_stage(), stage, law, say, search, open_again=open_stage)


def check_lines(settings: Config, port: str) -> None:
    """Refuses a permit or a heartbeat by a board that has no such thing."""
    from facets.core.errors import InputError

    if settings.stage.permit == "board" and settings.acquire.format == "text":
        raise InputError(
            "stage.permit is board: lines of text have no flag for it; use acquire.format: frames"
        )
    if settings.stage.heartbeat == "board" and port.startswith(("file:", "ni:", "thorlabs:")):
        raise InputError(f"stage.heartbeat is board: nothing can be sent to {port}")


def display(
    live: Live, plain: bool, json: bool, rate: float | None
) -> AbstractContextManager[Callable[[Live], None]]:
    """A view in the terminal, or lines; gives what is to be called often and shows now and then."""
    import sys
    import time

    from facets.live import view

    if json or plain or not sys.stdout.isatty():
        every, last, known = 1 / (rate or (8 if json else 1)), time.monotonic(), 0

        def line(now: Live) -> None:
            """A line every so often, and at once where there is a message more or less."""
            nonlocal last, known
            count = len(now.messages())
            if count != known or time.monotonic() - last >= every:
                last, known = time.monotonic(), count
                typer.echo(view.json_line(now) if json else view.plain_line(now))

        return nullcontext(line)
    shown: AbstractContextManager[Callable[[Live], None]] = terminal(live, rate or 8)
    return shown


def terminal(live: Live, rate: float) -> Any:
    from contextlib import contextmanager, suppress

    from rich.live import Live as Screen

    from facets.live.view import Screen as View

    @contextmanager
    def shown() -> Any:
        screen = Screen(get_renderable=lambda: View(live), refresh_per_second=rate)
        screen.start()
        try:
            yield lambda _: None
        finally:
            with suppress(OSError):  # the terminal may be gone
                screen.stop()

    return shown()


def report(live: Live, recording: Recording | None) -> None:
    """What came of the run, also where nobody listens any more."""
    from contextlib import suppress

    from facets.live.view import summary

    with suppress(OSError):
        for text in summary(live):
            typer.echo(text)
        if recording:
            typer.echo(f"{recording.folder}/")
