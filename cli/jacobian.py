"""`facets jacobian`: is the sensor invertible? Sampled as in Fig. 4, searched, and proved."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from facets import characterization, core, files

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
from .options.claims import claim_for
from .parts.certificates import prove
from .parts.state_survey import (
    draw_survey,
    find_and_show_pair,
    report,
    search_and_report,
    survey_box,
)
from .results import ResultFolder

if TYPE_CHECKING:
    from facets.characterization.state_box import StateBox
    from facets.config import Config

States = Annotated[int, typer.Option(min=1, help="Number of states to sample.")]
Box = Annotated[
    str | None,
    typer.Option(
        metavar="NAME=HALF|LOW:HIGH,...",
        help="Box of states, such as tx_mm=5,yaw_mrad=-10:20,offset_x_mm=0.1 (mm and mrad); other "
        "axes stay at zero.  [default: the range of each axis, by the block `range`]",
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


def jacobian(
    config: ConfigName,
    folder: Annotated[Path | None, folder_option("results/CONFIG-jacobian")] = None,
    force: Force = False,
    states: States = 200_000,
    seed: Annotated[int, seed_option()] = 1,
    box: Box = None,
    search_worst: SearchWorst = True,
    certify: Certify = 0,
    tolerances: Deviations = None,
    plot: Plot = PlotKind.png,
    look: Style = Look.screen,
) -> None:
    """Check whether the readings determine the pose.

        facets jacobian paper
        facets jacobian paper --box tx_mm=0.5,yaw_mrad=-10:20 --certify

    Samples states in a box and evaluates the determinant of the Jacobian without the power
    of C (Eq. (11) and Fig. 4 of the paper) and its smallest singular value, in standard deviations
    of readings per µm or µrad. With --certify, proves with interval arithmetic that no state of
    the box is singular and that no two states have the same readings, and writes a certificate;
    exit status 1 if this is not proved.
    """
    if certify:
        core.extras.require_extra("flint", "--certify")
    settings = load_config(config)
    domain, least_share = choose_box(settings, box)
    names = [f"jacobian.{plot.value}", "density.csv", "run.yaml"]
    names += ["certificate.json"] if certify else []
    results = ResultFolder(output_folder(folder, settings.name, "jacobian"), names, force)
    with results.publish(settings, seed) as (picture, table, _, *certificate):
        survey = survey_box(settings.sensor, domain, states, seed)
        report(settings, domain, survey, results.seconds)
        weakest = search_and_report(settings.sensor, domain, survey, seed) if search_worst else None
        pair = find_and_show_pair(settings.sensor, survey, weakest)
        results.write_table(table, characterization.tables.density_columns(survey))
        draw_survey(picture, survey, pair)
        entries: dict[str, Any] = {"states": survey.states, "one_sign": survey.one_sign}
        if certify:
            claim = claim_for(settings, domain, least_share, tolerances, weakest)
            about = files.provenance.provenance_header(settings, seed)
            entries |= prove(claim, certify, certificate[0], about)
        results.write_record(entries)
    results.name()
    if certify and not entries["unique"]:
        raise typer.Exit(FINDING)


def choose_box(settings: Config, box: str | None) -> tuple[StateBox, float | None]:
    """Return the box and, by the rules, the least fraction of light for a proof; None for --box."""
    boxes = characterization.state_box
    if box is not None:
        return boxes.parse_box(box), None
    sensor, rules = settings.sensor, settings.range
    return boxes.range_box(sensor, rules), boxes.least_share(sensor, rules)
