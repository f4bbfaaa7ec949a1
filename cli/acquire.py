"""`facets acquire`: a detector board's stream, recorded, solved and followed as it comes."""

from __future__ import annotations

from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import facets
from facets import estimation, live, pictures
from facets.core.errors import FacetsError, InputError
from facets.files.whole import refuse_to_overwrite

from .options import (
    ConfigName,
    Covariance,
    Point,
    Publish,
    Seconds,
    Track,
    Web,
    Zero,
    folder_option,
    require_yaml,
    write_option,
)
from .options.places import choose_point, zero_of
from .parts.run_display import display, report, tell

if TYPE_CHECKING:
    from facets.live.assembly import Show

PortName = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS",
        help="Serial port, TCP address or file of the detector board, or virtual:MOTION for a "
        "simulated bench, stage included.  [default: the configuration's `acquire.port`]",
    ),
]
Record = Annotated[
    bool,
    typer.Option("--record/--no-record", help="Record all received bytes and poses in the folder."),
]
StagePort = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS",
        help="Serial port or TCP address of the stage.  [default: the configuration's "
        "`stage.port`]",
    ),
]
CheckStage = Annotated[
    bool,
    typer.Option(
        "--check-stage",
        help="Move the stage by 0.05 mm along each axis, beginning with one native step, and check "
        "with the readings that it is wired as configured. The mirror must be at rest.",
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
        min=0,
        max=1,
        help="Largest share of lost samples, or of time without samples (0 to 1), that still ends "
        "with status 0.",
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


def acquire(
    config: ConfigName,
    port: PortName = None,
    folder: Annotated[Path | None, folder_option("recordings/TIME")] = None,
    record: Record = True,
    track: Track = False,
    stage_port: StagePort = None,
    check_stage: CheckStage = False,
    write: Write = None,
    seconds: Seconds = None,
    samples: Samples = None,
    reconnect: Reconnect = False,
    max_loss: MaxLoss = 0.001,
    plain: AsLines = False,
    json: AsJson = False,
    publish: Publish = None,
    web: Web = None,
    compare_board: CompareBoard = False,
    point: Point = None,
    zero: Zero = None,
    covariance: Covariance = False,
) -> None:
    """Record a detector board's data and solve every sample.

        facets acquire bench --port virtual:circle --seconds 10
        facets acquire calibrated.yaml --port /dev/ttyACM0 --web

    All received bytes are recorded before they are used. The stage moves only with --track or
    --check-stage. A stopped stage stays stopped until a person resumes it with the key r, the
    button on the web page, or SIGUSR1. With an object in the configuration or --point, each sample
    also has the pose of that object, and with --zero its displacement; hold the mirror still while
    the zero is measured. Ctrl-C, SIGTERM and closing the terminal end the run: the
    stage is stopped first, and the recording is closed last.

    The exit status is 1, with the reasons in words, if too many samples were lost, the board was
    silent for too long, no sample arrived or gave a pose, or most samples did not fit. It is also 1
    if the stage was stopped and not resumed, no zero could be measured, or the check of the stage
    or the disk failed. It is 2 if the run cannot start or the port is closed, and 128 plus the
    signal's number after SIGTERM or SIGHUP.
    """
    if plain and json:
        raise InputError("--plain and --json exclude each other; give one of them")
    refuse_file(write, check_stage)
    settings = choose_point(facets.load(config), point)
    options = live.RunOptions(
        record=record,
        folder=folder,
        track=track,
        check_stage=check_stage,
        stage_port=stage_port,
        seconds=seconds,
        samples=samples,
        reconnect=reconnect,
        max_loss=max_loss,
        compare=compare_board,
        publish=publish or (),
        web=web,
        page_scripts=pictures.page.scripts.rig_scripts(settings.sensor) if web else None,
        columns=estimation.PoseColumns(zero_of(zero), covariance),
    )
    run = live.Run.from_config(settings, port, options, tell)
    run_to_end(run, display(run.live, plain, json))
    check_results(run, write)


def refuse_file(path: Path | None, check_stage: bool) -> None:
    """Refuse a file for --write that is not a configuration or cannot be written."""
    if path is None:
        return
    if not check_stage:
        raise InputError("--write needs --check-stage: it writes what the check finds")
    require_yaml(path)
    refuse_to_overwrite([path], False)


def run_to_end(run: live.Run, screen: AbstractContextManager[Show]) -> None:
    """Run, and print the outcome, even if an error ended the reading."""
    failure: FacetsError | None = None
    try:
        with screen as show:
            run.acquire(show)
    except FacetsError as error:
        failure = error
    except KeyboardInterrupt:  # of a signal that came before the run took note of them
        run.abandon()
        raise
    report(run)
    if failure:
        raise failure


def check_results(run: live.Run, write: Path | None) -> None:
    """Print the result of the stage's check and the reasons for exit status 1, if any."""
    for text in run.check_sentences(write):
        print(text)
    reasons = run.complaints()
    for reason in reasons:
        tell(f"exit status 1: {reason}")
    if reasons:
        raise typer.Exit(1)
