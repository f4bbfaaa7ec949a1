"""The output of `facets calibrate`: undetermined parameters, effects, results and checks."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from facets import calibration
from facets.core.plain_numbers import count_text

from ..console import show_table, wrap

if TYPE_CHECKING:
    from facets.calibration.fitting.unknowns import Choice
    from facets.calibration.motions import Direction
    from facets.calibration.search import EffectSearch
    from facets.calibration.verdict import Verdict
    from facets.config import Config


def show_weak(directions: list[Direction]) -> None:
    """Print the parameters that the data do not determine, before the fit."""
    if not directions:
        print("The motion determines every parameter better than its prior value.")
        return
    print(
        "The motion determines these combinations of parameters less well than their prior "
        "values,\nwhich they keep (information of the motion over that of the prior):"
    )
    for direction in directions:
        print(f"  {direction.information:8.2g}  {direction.words}")


def show_lost_uncertainties(settings: Config, unknowns: Choice) -> None:
    """Warn if a calibration loses the uncertainties of parameters that it does not fit."""
    previous = settings.sensor.calibration
    lost = [] if previous is None else [
        name for name in previous.names
        if name in calibration.fitting.unknowns.OF_SENSOR and name not in unknowns.names
        and name != "beam.power"
    ]  # fmt: skip
    if lost:
        print(
            f"CONFIG has the uncertainties of {len(lost)} parameters that are not fitted here; the "
            "result\ntakes them as exact unless the data require them. With --only they remain."
        )


def show_verdict(settings: Config, verdict: Verdict) -> None:
    if verdict.search is not None:
        show_candidates(verdict.search)
    if verdict.errors is not None and verdict.fit is not None and verdict.search is not None:
        show_parameters(calibration.table.unknowns_table(verdict.search.sensor, verdict.fit))
        show_errors(verdict.errors)
    for finding in verdict.findings:
        print(wrap(("! " if finding.bad else "- ") + finding.words))
    fit = verdict.fit
    if fit is not None and verdict.is_trusted:
        steps = count_text(fit.steps, "step") if fit.steps else "no further steps"
        print(
            f"The fit converged in {steps}. Chi-square per degree of freedom is "
            f"{fit.reduced_chi_square:.3f} (1 is expected)."
        )


def show_candidates(done: EffectSearch) -> None:
    """Print the effects, and whether the data require them."""
    columns = ("effect", "unknowns", "fall of chi-square", "error of new readings", "", "why")
    rows = [("the plain fit", str(len(done.plain.choice.names)), "", f"{done.error:.4f}", "", "")]
    for row in done.rows:
        error = f"{row.error:.4f}" if row.error == row.error else ""
        fall = f"{row.fall:.5g}" if row.fall == row.fall else ""
        decision = "included" if row.accepted else "excluded"
        rows.append((row.words, str(row.unknowns), fall, error, decision, row.why))
    title = (
        "\nEffects of real light, and whether the data require them; error of new readings: of "
        "readings\nthat were not fitted, relative to their noise"
    )
    show_table(title, columns, rows, left_columns=(0, 4, 5))


def show_parameters(table: dict[str, Any]) -> None:
    columns = ("parameter", "known before", "change", "u (1 sigma)", "unit")
    rows = [
        (name, f"± {before:.3g}", f"{change:+.4g}", f"{u:.2g}", unit)
        for name, unit, before, change, u in zip(*table.values(), strict=True)
    ]
    show_table("", columns, rows, left_columns=(0, 4))


def show_errors(table: dict[str, Any]) -> None:
    print(
        "Errors of poses on samples that were not fitted, with the beam known: RMS before and "
        "after the\ncalibration, robust estimate (from the median), stated uncertainty, and "
        "fraction\nwithin the 95 % intervals"
    )
    print(f"  {'':6} {'before':>9} {'after':>9} {'robust':>9} {'stated':>9}       {'held':>6}")
    for axis, unit, before, after, robust, stated, inside, _ in zip(*table.values(), strict=True):
        if after == after:
            print(
                f"  {axis:6} {before:9.3g} {after:9.3g} {robust:9.3g} {stated:9.3g} {unit:4} "
                f"{inside:6.1f} %"
            )
    print("")
