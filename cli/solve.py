"""`facets solve`: a table of readings in, a table of poses out."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Annotated

import typer

from facets import estimation, files

from .console import FINDING, free_output, load_config, report_coverage
from .options import (
    ConfigName,
    Covariance,
    Coverage,
    Force,
    Point,
    Zero,
    describe_default,
    output_folder,
    output_option,
)
from .options.places import choose_point, zero_of

if TYPE_CHECKING:
    from facets.config import Config, Solve
    from facets.estimation.table import StatusCounts
    from facets.estimation.zero import ZeroRequest


#: Errors of a pose that are reported, and those without a bound; standard uncertainties.
MUCH, BOUNDLESS = 10.0, 1e4


#: The default of most options.
CONFIGURED = describe_default("the configuration's")


class BeamChoice(StrEnum):
    free = "free"
    known = "known"
    prior = "prior"


class Power(StrEnum):
    known = "known"
    prior = "prior"
    unknown = "unknown"


class Method(StrEnum):
    least_squares = "least-squares"
    paper = "paper"


class Start(StrEnum):
    zero = "zero"
    previous = "previous"


ReadingsTable = Annotated[
    Path,
    typer.Argument(
        metavar="READINGS",
        help="Table of readings, CSV (.csv, .csv.gz, or - for standard input) or Parquet, with the "
        "columns psi_a_mm, zeta_a_mm, power_a_mw and so on for the detectors b and c.",
    ),
]
Output = Annotated[
    Path | None,
    output_option(
        "table of poses, CSV (.csv, .csv.gz, or - for standard output) or Parquet",
        "results/CONFIG-poses.csv",
    ),
]
BeamKnowledge = Annotated[
    BeamChoice | None,
    typer.Option(
        help="What is known about the beam's position: nothing (free), the position (known), "
        f"or the position with an uncertainty (prior).{CONFIGURED}"
    ),
]
PowerKnowledge = Annotated[
    Power | None,
    typer.Option(
        help="What is known about the laser's power: the power (known), the power with an "
        f"uncertainty (prior), or nothing (unknown).{CONFIGURED}"
    ),
]
MethodName = Annotated[
    Method | None,
    typer.Option(
        help="Method of solving: weighted least squares on all nine readings, or the paper's "
        f"Newton iteration on eight of them.{CONFIGURED}"
    ),
]
StartPose = Annotated[
    Start | None,
    typer.Option(
        help="Pose at which the solver starts in each row: zero, or the previous row's "
        f"solution, which suits slow motions.{CONFIGURED}"
    ),
]
AcceptUnchecked = Annotated[
    bool,
    typer.Option(
        "--accept-unchecked",
        help="Also give poses that were solved from as many readings as unknowns, so that no "
        "reading is left to check them (for example when only two detectors have light).",
    ),
]


def solve(
    config: ConfigName,
    readings: ReadingsTable,
    output: Output = None,
    force: Force = False,
    beam: BeamKnowledge = None,
    power: PowerKnowledge = None,
    method: MethodName = None,
    start: StartPose = None,
    accept_unchecked: AcceptUnchecked = False,
    coverage: Coverage = None,
    point: Point = None,
    zero: Zero = None,
    covariance: Covariance = False,
) -> None:
    """Solve a table of readings for poses.

    Writes one row for each row of READINGS: the pose with its standard uncertainties (mm, mrad; um,
    urad) and a status. A row that cannot be solved gets a status and no pose. If READINGS has the
    columns bx_mm and by_mm, they are the beam's measured position for --beam known and prior. With
    an object in the configuration or --point, each row also has the pose of that object
    (object_tx_mm and so on), and with --zero its displacement (displacement_tx_mm and so on).
    --coverage adds expanded uncertainties. Exit status 1 if no row could be solved, or if most of
    them do not fit.
    """
    settings = choose_point(load_config(config), point)
    request = zero_of(zero)
    given = {"beam": beam, "power": power, "method": method, "start": start}
    chosen = {key: word.value for key, word in given.items() if word is not None}
    options = replace(settings.solve, **chosen)  # type: ignore[arg-type]
    if accept_unchecked:
        options = replace(options, accept_unchecked=True)
    about = files.provenance.provenance_header(settings)
    if coverage is not None:
        about |= estimation.coverage.describe_coverage(settings.sensor, coverage)
    path = output_folder(output, settings.name, "poses.csv")
    files.tables.ending(path)
    files.tables.require_table(readings)
    files.tables.refuse_to_overwrite([path], force, [readings, request.file if request else None])
    with progress_bar(readings) as advance:
        count = estimation.table.solve_table(
            settings,
            options,
            readings,
            path,
            about,
            advance,
            coverage=coverage,
            zero=request,
            covariance=covariance,
        )
    with free_output(path):
        report(count, path, settings, options, request)
        if coverage is not None:
            report_coverage(about)
    if not count.solved_count or misfit(count):
        raise typer.Exit(FINDING)


@contextmanager
def progress_bar(readings: Path) -> Iterator[Callable[[int], None]]:
    """Yields a function of the bytes read so far; the bar appears only on a terminal."""
    if not sys.stderr.isatty():
        yield lambda _: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, DownloadColumn, Progress, TimeRemainingColumn

    columns = (BarColumn(), DownloadColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True)) as progress:
        size = readings.stat().st_size if readings.is_file() else None
        task = progress.add_task("solve", total=size)
        yield lambda done: progress.update(task, completed=done)


def misfit(count: StatusCounts) -> bool:
    """Return whether more than half of the solved rows fit worse than noise explains."""
    return 2 * count.misfit.flagged > count.solved_count


def report(
    count: StatusCounts, output: Path, settings: Config, options: Solve, zero: ZeroRequest | None
) -> None:
    typer.echo(f"{count.solved_count} of {count.rows} rows solved: {output}")
    for status, number in count.statuses.items():
        if status != "converged":
            typer.echo(f"  {number} {status}")
    if count.unparsable_lines:
        lines = ", ".join(map(str, count.unparsable_lines))
        more = " ..." if count.statuses["unparsable"] > len(count.unparsable_lines) else ""
        typer.echo(f"  not numbers in line {lines}{more}")
    if zero is not None and count.zero is not None:
        text = f"zero: {estimation.zero.zero_text(zero, count.zero)}"
        typer.echo(fill(text, 98, initial_indent="  ", subsequent_indent="  "))
    beside = (
        unchecked_sentence(count),
        edge_sentence(count),
        unseen_sentence(count),
        temperature_sentence(count, settings, options),
        *(estimation.zero.zero_findings(count.zero) if count.zero else ()),
    )
    for sentence in (count.misfit.words, *beside):
        if sentence:
            typer.echo(fill(sentence, 98, initial_indent="  ", subsequent_indent="  "))


def unchecked_sentence(count: StatusCounts) -> str:
    """Message about rows that have, or could have, a pose which nothing checks."""
    refused = count.statuses[estimation.solution.Status.UNCHECKED.label]
    if refused:
        return (
            f"Rows with as many readings as unknowns: {refused}. A wrong reading would not be "
            "noticed there; --accept-unchecked gives their poses all the same."
        )
    if count.unchecked:
        return (
            f"Poses from as many readings as unknowns: {count.unchecked}. No reading is left to "
            "check them, and a distant pose may give the same readings."
        )
    return ""


def edge_sentence(count: StatusCounts) -> str:
    if not count.edges:
        return ""
    return (
        f"Poses with a spot closer to its detector's edge than its own diameter: {count.edges}. "
        "Light may miss the detector there, and then the stated uncertainties do not hold. Set "
        "sensor.apertures.detectors to model the edges."
    )


def unseen_sentence(count: StatusCounts) -> str:
    """Message about the undetected error that one spoilt number can cause, if it is large."""
    place, power = count.unseen.tolist()
    if not max(place, power) > MUCH:
        return ""
    return (
        "A single wrong reading can shift a pose without raising its residual: a wrong position of "
        f"a spot by {amount(place)}, a wrong power by {amount(power)} standard uncertainties."
    )


def temperature_sentence(count: StatusCounts, settings: Config, options: Solve) -> str:
    """Message about the error if the table lacks a temperature that the sensor needs."""
    if not count.lacks_temperature:
        return estimation.table.unknown_temperatures(count.unknown_temperatures, "rows")
    source = "READINGS has no column temperature_c"
    return estimation.table.missing_temperature(settings.sensor, options, source)


def amount(errors: float) -> str:
    if errors > BOUNDLESS:
        return "any amount"
    return f"up to {errors:.2g}"
