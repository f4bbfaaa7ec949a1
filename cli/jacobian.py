"""`facets jacobian`: is the sensor invertible? Sampled as in Fig. 4, searched, and proved."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from facets import core

from .console import FINDING, load_config
from .options import (
    Certify,
    ConfigName,
    Force,
    Look,
    Plot,
    PlotKind,
    Style,
    folder_option,
    output_folder,
    seed_option,
)
from .options.survey_request import SurveyRequest, choose_box
from .parts.state_survey import certify_and_report, survey_box, write
from .results import ResultFolder

States = Annotated[int, typer.Option(min=1, help="Number of states to sample.")]
Box = Annotated[
    str | None,
    typer.Option(
        metavar="NAME=HALF|LOW:HIGH,...",
        help="Box of states, such as tx_mm=5,yaw_mrad=-10:20,offset_x_mm=0.1 (mm and mrad); axes "
        "left out stay at zero.  [default: the range of each axis, by the block `range`]",
    ),
]
LeftOut = Annotated[
    str,
    typer.Option(
        metavar="READING",
        help="Reading to leave out of the determinant of Eq. (11), which takes eight of the nine.",
    ),
]
SearchWorst = Annotated[
    bool,
    typer.Option(
        "--search-worst/--no-search-worst",
        help="Also search for the state with the smallest singular value.",
    ),
]
Deviations = Annotated[
    float | None,
    typer.Option(
        min=0,
        help="Prove the uniqueness for every sensor whose parameters lie within this many standard "
        "uncertainties of the calibrated values, or of the nominal values by `calibrate.before`.  "
        "[default: the sensor exactly as configured]",
    ),
]
Limit = Annotated[float, typer.Option(min=1, help="Stop the proof after this many seconds.")]


def jacobian(
    config: ConfigName,
    folder: Annotated[Path | None, folder_option("results/CONFIG-jacobian")] = None,
    force: Force = False,
    states: States = 200_000,
    seed: Annotated[int, seed_option()] = 1,
    box: Box = None,
    left_out: LeftOut = "power_c",
    search_worst: SearchWorst = True,
    certify: Certify = 0,
    tolerances: Deviations = None,
    limit: Limit = 300.0,
    plot: Plot = PlotKind.png,
    look: Style = Look.screen,
) -> None:
    """Check whether the readings determine the pose.

    Samples states in a box and evaluates the determinant of the Jacobian without one reading
    (Eq. (11) and Fig. 4 of the paper) and its smallest singular value, in standard deviations
    of readings per µm or µrad. With --certify, proves with interval arithmetic that no state of
    the box is singular and that no two states have the same readings, and writes a certificate;
    exit status 1 if this is not proved.
    """
    if certify:
        core.extras.require_extra("flint", "--certify")
    settings = load_config(config)
    place = output_folder(folder, settings.name, "jacobian")
    request = SurveyRequest(
        settings, *choose_box(settings, box), states, seed, left_out, place, plot.value,
        certify > 0,
    )  # fmt: skip
    results = ResultFolder(place, request.names, force)
    with results.publish(settings, seed):
        survey, worst, pair = survey_box(request, results, search_worst)
        entries = write(request, results, survey, pair)
        if certify:
            entries |= certify_and_report(request, certify, limit, tolerances, worst)
        results.write_record(entries)
    results.name()
    if certify and not entries["unique"]:
        raise typer.Exit(FINDING)
