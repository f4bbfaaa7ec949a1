"""The sampled survey of a box of states by `facets jacobian`, and its printed results."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import typer

from facets import characterization, files, pictures
from facets.core.names import STATE_COLUMNS, STATE_UNITS

from ..console import draw_beside, leave_out_picture, track
from ..options.claims import claim_for
from ..options.survey_request import SurveyRequest, refuse_too_many
from ..results import ResultFolder
from .certificates import prove

if TYPE_CHECKING:
    from facets.characterization.ambiguity import AmbiguousPair
    from facets.characterization.singularity import Survey, Worst
    from facets.config import Config


def survey_box(
    request: SurveyRequest, results: ResultFolder, search: bool
) -> tuple[Survey, Worst | None, AmbiguousPair | None]:
    """Sample, measure and report; then search the worst state and two with like readings."""
    refuse_too_many(request)
    survey = measure(request)
    report(request, survey, results.seconds)
    if not search:
        return survey, None, None
    worst = search_worst(request, survey)
    alike = survey.has_one_sign_in_light
    pair = (
        None
        if alike
        else characterization.ambiguity.find_ambiguous_pair(request.settings.sensor, worst.state)
    )
    show_pair(pair)
    return survey, worst, pair


def measure(request: SurveyRequest) -> Survey:
    """Sample and measure in chunks, with a progress bar."""
    chunks = characterization.singularity.samples(
        request.domain, request.states, "sobol", request.seed
    )
    count = -(-request.states // characterization.singularity.CHUNK)
    return characterization.singularity.survey(
        request.settings.sensor, track(chunks, "measuring", count), request.left_out
    )


def write(
    request: SurveyRequest, results: ResultFolder, survey: Survey, pair: AmbiguousPair | None
) -> dict[str, Any]:
    """Write table and picture; return their entries of the record."""
    density = characterization.tables.density_columns(survey)
    results.write_table(request.folder / "density.csv", density)
    if survey.states - survey.dark > 1:
        make = pictures.singularity.survey_picture
        draw_beside(request.picture, make, survey, request.left_out, pair)
    else:
        leave_out_picture(request.picture, "it needs at least two states with light")
    return {"states": survey.states, "one_sign": survey.one_sign}


def report(request: SurveyRequest, survey: Survey, seconds: float) -> None:
    settings, domain, left_out = request.settings, request.domain, request.left_out
    typer.echo(f"{settings.name}: {survey.states} states sampled in {seconds:.2f} s from the box")
    for name, unit, low, high in zip(
        characterization.state_box.COLUMNS,
        characterization.state_box.UNITS,
        domain.low,
        domain.high,
        strict=True,
    ):
        typer.echo(f"  {name:<12} {low / unit:10.4g} to {high / unit:.4g}")
    below, zero, above = survey.signs
    typer.echo(
        f"determinant without {left_out}: {above} above zero, {below} below"
        + (f", {zero} zero" if zero else "")
        + (f"; {survey.dark} states leave a detector without a reading" if survey.dark else "")
    )
    if survey.saturated:
        typer.echo(
            f"  {survey.saturated} states saturate a detector, so that the sensor reads nothing "
            "there;\n  they are counted all the same, and --box takes a smaller box"
        )
    typer.echo(f"  from {survey.low[0]:.4g} to {survey.high[0]:.4g} (mm, mW, rad)")
    typer.echo(
        "  with psi to the side y = z x x of detectors whose x points outward; the paper draws it\n"
        "  negative, as it is with psi mirrored"
    )
    typer.echo(
        f"smallest singular value: {survey.low[1]:.4g} to {survey.high[1]:.4g} standard "
        "deviations\n"
        f"  per µm or µrad; condition number {survey.low[2]:.4g} to {survey.high[2]:.4g}"
    )
    show_weakest("weakest state of the sample", settings, survey.weakest)


def show_weakest(title: str, settings: Config, worst: Worst) -> None:
    place = ", ".join(
        f"{name} {value / unit:.4g}"
        for name, value, unit in zip(STATE_COLUMNS, worst.state, STATE_UNITS, strict=True)
    )
    direction = characterization.singularity.direction_in_words(
        characterization.singularity.weakest_direction(settings.sensor, worst.state)
    )
    typer.echo(
        f"{title}: smallest singular value {worst.values[1]:.4g}, for a change of {direction}\n"
        f"  at {place}"
    )


def search_worst(request: SurveyRequest, survey: Survey) -> Worst:
    """Search the worst state, and report how near the sample came to it."""
    settings, domain = request.settings, request.domain
    lowest = characterization.singularity.search(
        settings.sensor, domain, 0, request.left_out, request.seed
    )
    weakest = characterization.singularity.search(
        settings.sensor, domain, 1, request.left_out, request.seed
    )
    show_weakest("weakest state found by a search", settings, weakest)
    if survey.one_sign:
        typer.echo(
            "the search finds a determinant of "
            f"{lowest.values[0] / survey.lowest.values[0]:.3g} times, and a singular value of "
            f"{weakest.values[1] / survey.weakest.values[1]:.3g} times the smallest of the sample"
        )
    elif not survey.has_one_sign_in_light:
        typer.echo("the determinant has both signs in the box, so it is zero at some states")
    else:
        typer.echo(
            f"nothing can be said of the whole box: {100 * survey.dark / survey.states:.3g} % of "
            "its states leave a detector without a reading"
        )
    return weakest


def show_pair(pair: AmbiguousPair | None) -> None:
    if pair is None:
        return
    typer.echo("two states with the same readings:")
    for name, unit, first, second in zip(
        STATE_COLUMNS, STATE_UNITS, pair.first, pair.second, strict=True
    ):
        typer.echo(f"  {name:<10} {first / unit:12.6g} {second / unit:12.6g}")


def certify_and_report(
    request: SurveyRequest,
    work: int,
    limit: float,
    tolerances: float | None,
    worst: Worst | None,
) -> dict[str, Any]:
    """Prove and write the certificate; return its entries of the record."""
    weakest = None if worst is None else worst.state
    claim = claim_for(request.settings, request.domain, request.least_share, tolerances, weakest)
    about = files.provenance.provenance_header(request.settings, request.seed)
    return prove(claim, work, limit, request.certificate, about)
