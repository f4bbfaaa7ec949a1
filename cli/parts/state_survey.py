"""The sampled survey of a box of states by `facets jacobian`, and its printed results."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from facets import characterization, pictures
from facets.core.names import STATE_COLUMNS, STATE_UNITS
from facets.core.plain_numbers import count_text

from ..console import draw_extra, skip_picture, track

if TYPE_CHECKING:
    from facets.characterization.ambiguity import AmbiguousPair
    from facets.characterization.singularity import Survey, Worst
    from facets.characterization.state_box import StateBox
    from facets.config import Config
    from facets.core.sensor import Sensor
    from facets.core.units import Floats


def survey_box(sensor: Sensor, domain: StateBox, states: int, seed: int) -> Survey:
    """Sample and measure in chunks, with a progress bar."""
    singularity = characterization.singularity
    chunks = singularity.samples(domain, states, "sobol", seed)
    count = -(-states // singularity.CHUNK)
    return singularity.survey(sensor, track(chunks, "measuring", count))


def draw_survey(picture: Path, survey: Survey, pair: AmbiguousPair | None) -> None:
    """Draw the survey and the pair, if there are two states with light to be drawn."""
    if survey.states - survey.unlit > 1:
        draw_extra(picture, pictures.singularity.survey_picture, survey, pair)
    else:
        skip_picture(picture, "it needs at least two states with light")


def report(settings: Config, domain: StateBox, survey: Survey, seconds: float) -> None:
    states = count_text(survey.states, "state")
    print(f"{settings.name}: {states} sampled in {seconds:.2f} s from the box")
    for name, unit, low, high in zip(
        characterization.state_box.COLUMNS,
        characterization.state_box.UNITS,
        domain.low,
        domain.high,
        strict=True,
    ):
        print(f"  {name:<12} {low / unit:10.4g} to {high / unit:.4g}")
    below, zero, above = survey.signs
    print(
        f"determinant without power_c: {above} above zero, {below} below"
        + (f", {zero} zero" if zero else "")
        + (f"; {survey.unlit} states leave a detector without a reading" if survey.unlit else "")
    )
    if survey.saturated:
        print(
            f"  {count_text(survey.saturated, 'state')} saturate a detector, so that the sensor "
            "has no reading there;\n  they are counted nevertheless; --box takes a smaller box"
        )
    print(f"  from {survey.low[0]:.4g} to {survey.high[0]:.4g} (mm, mW, rad)")
    print(
        "  with psi to the side y = z x x of detectors whose x points outward; the paper draws it\n"
        "  negative, as it is with psi mirrored"
    )
    print(
        f"smallest singular value: {survey.low[1]:.4g} to {survey.high[1]:.4g} standard "
        "deviations\n"
        f"  per µm or µrad; condition number {survey.low[2]:.4g} to {survey.high[2]:.4g}"
    )
    show_weakest("weakest state of the sample", settings.sensor, survey.weakest)


def show_weakest(title: str, sensor: Sensor, worst: Worst) -> None:
    place = ", ".join(
        f"{name} {value / unit:.4g}"
        for name, value, unit in zip(STATE_COLUMNS, worst.state, STATE_UNITS, strict=True)
    )
    singularity = characterization.singularity
    direction = singularity.direction_in_words(singularity.weakest_direction(sensor, worst.state))
    print(
        f"{title}: smallest singular value {worst.values[1]:.4g}, for a change of {direction}\n"
        f"  at {place}"
    )


def search_and_report(sensor: Sensor, domain: StateBox, survey: Survey, seed: int) -> Floats:
    """Search the weakest state, and report how near the sample came to it."""
    weakest = characterization.singularity.search_weakest(sensor, domain, seed)
    show_weakest("weakest state found by a search", sensor, weakest)
    if survey.one_sign:
        ratio = weakest.values[1] / survey.weakest.values[1]
        print(f"the search finds a singular value of {ratio:.3g} times the sample's smallest")
    elif not survey.has_one_sign_in_light:
        print("the determinant has both signs in the box, so it is zero at some states")
    else:
        print(
            "the survey allows no statement on the box, because "
            f"{100 * survey.unlit / survey.states:.3g} % of its states leave a detector without a "
            "reading"
        )
    return weakest.state


def find_and_show_pair(
    sensor: Sensor, survey: Survey, weakest: Floats | None
) -> AmbiguousPair | None:
    """Find and print two states with the same readings, if the survey leaves room for them."""
    if weakest is None or survey.has_one_sign_in_light:
        return None
    pair = characterization.ambiguity.find_ambiguous_pair(sensor, weakest)
    if pair is not None:
        print("two states with the same readings:")
        for name, unit, first, second in zip(
            STATE_COLUMNS, STATE_UNITS, pair.first, pair.second, strict=True
        ):
            print(f"  {name:<10} {first / unit:12.6g} {second / unit:12.6g}")
    return pair
