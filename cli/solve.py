"""`facets solve`: a table of readings in, a table of poses out."""

from __future__ import annotations

from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from facets import estimation, files

from .console import FINDING, free_output, load_config, report_coverage, report_lines, show_progress
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
        help="Table of readings, CSV (.csv, .csv.gz, or - for standard input), Parquet, HDF5 (.h5) "
        "or TDMS, with the columns psi_a_mm, zeta_a_mm, power_a_mw and so on for the detectors b "
        "and c.",
    ),
]
Output = Annotated[
    Path | None,
    output_option(
        "table of poses, CSV (.csv, .csv.gz, or - for standard output), Parquet or HDF5 (.h5)",
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
        f"solution, which takes longer, for poses far from rest.{CONFIGURED}"
    ),
]
AcceptUnchecked = Annotated[
    bool,
    typer.Option(
        "--accept-unchecked",
        help="Also give poses that no redundant reading checks (for example when only two "
        "detectors have light, or when beam and power are both hardly known).",
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

        facets solve paper readings.csv
        facets solve calibrated.yaml readings.parquet --beam known -o poses.parquet

    Writes one row for each row of READINGS: the pose with its standard uncertainties (mm, mrad)
    and a status. A row that cannot be solved gets a status and no pose. If READINGS has the
    columns bx_mm and by_mm, they are the beam's measured position for --beam known and prior. With
    an object in the configuration or --point, each row also has the pose of that object
    (object_tx_mm and so on), and with --zero its displacement (displacement_tx_mm and so on).
    --coverage adds expanded uncertainties. Exit status 1 if no row could be solved, or if most of
    them do not fit.
    """
    settings = choose_point(load_config(config), point)
    request = zero_of(zero)
    words = {"beam": beam, "power": power, "method": method, "start": start}
    chosen = {key: word.value for key, word in words.items() if word is not None}
    options = replace(settings.solve, **chosen)  # type: ignore[arg-type]
    if accept_unchecked:
        options = replace(options, accept_unchecked=True)
    about = files.provenance.provenance_header(settings)
    about |= files.provenance.configuration_entry(settings)
    if coverage is not None:
        about |= estimation.uncertainty.describe_coverage(settings.sensor, coverage)
    path = output_folder(output, settings.name, "poses.csv")
    files.tables.ending(path)
    files.tables.require_table(readings)
    files.tables.refuse_to_overwrite([path], force, [readings, request.file if request else None])
    columns = estimation.PoseColumns(request, covariance, coverage)
    tally = estimation.Tally("rows", "READINGS has no column temperature_c")
    measurement = estimation.Measurement(replace(settings, solve=options), columns, tally=tally)
    size = readings.stat().st_size if readings.is_file() else None
    with show_progress("solving") as on_progress:
        estimation.solve_table(
            measurement, readings, path, about, lambda done: on_progress(done, size)
        )
    with free_output(path):
        report(measurement, path)
        if coverage is not None:
            report_coverage(about)
    if not tally.solved_count or 2 * tally.misfit.flagged > tally.solved_count:
        raise typer.Exit(FINDING)


def report(measurement: estimation.Measurement, output: Path) -> None:
    """Print the statuses of the rows, and sentences on their poses."""
    tally = measurement.tally
    place = "to standard output" if output == files.whole.STANDARD_STREAM else output
    print(f"{tally.solved_count} of {tally.statuses.total()} rows solved: {place}")
    for text in tally.status_sentences():
        print(f"  {text}")
    for sentence in measurement.sentences():
        report_lines(sentence)
