"""The output of `facets rezero`: changes since a calibration, and whether they are explained."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, NoReturn

import typer

from facets import calibration
from facets.core.names import DETECTORS

from ..console import FINDING, wrap

if TYPE_CHECKING:
    from facets.calibration.rezero import ChangePriors, NewZero
    from facets.config import Config

#: An uncertainty above this fraction of the one before is named as not determined.
UNDETERMINED_FRACTION = 0.5
#: A chi-square that is exceeded with at least this probability is improbably small.
SUSPICIOUS_CHANCE = 0.999


#: The changes, in the order of `ChangePriors.sigmas`: name, unit, and the factor to the unit from
#: mm or a fraction.
ROWS = (
    *((f"beam {axis}", "µm", 1e3) for axis in "xy"),
    ("laser's power", "%", 100.0),
    *((f"gain of detector {letter.upper()}", "%", 100.0) for letter in DETECTORS),
    *((f"post of detector {letter.upper()}", "µm", 1e3) for letter in DETECTORS),
    ("beam's width", "%", 100.0),
)


def show_changes(settings: Config, zero: NewZero, priors: ChangePriors) -> None:
    """Print the changes, and which of them a stop does not determine."""
    print("Changes since the calibration, with standard uncertainties:")
    print(f"  {'':19} {'change':>9} {'u':>8} {'u before':>9}")
    weak = []
    scales = priors.sigmas(1.0) / zero.prior  # of the power, to a fraction
    numbers = zip(ROWS, scales, zero.change, zero.uncertainty, zero.prior, strict=True)
    for (name, unit, factor), scale, *values in numbers:
        change, u, before = (factor * scale * value for value in values)
        print(f"  {name:19} {change:+9.3g} {u:8.2g} {before:9.2g} {unit}")
        if u > UNDETERMINED_FRACTION * before:
            weak.append(name)
    notes = [f"A stop hardly determines: {', '.join(weak)}."] if weak else []
    notes += [
        f"The mirror is assumed to be at the stop again within {1e3 * priors.stop:g} µm and "
        f"{1e6 * priors.stop_angle:g} µrad (--stop-um, --stop-urad). If it is elsewhere, all poses "
        "are off by as much; along z nothing in the readings shows that.",
        f"Chi-square is {zero.chi_square:.3g} where {zero.freedom} is expected (probability of a "
        f"larger one: {zero.chance:.2g}; at least {calibration.rezero.LEAST_CHANCE:g} is needed).",
    ]
    if zero.chance > SUSPICIOUS_CHANCE:
        notes.append(
            "Chi-square is improbably small: the stated noise of the readings or the standard "
            "uncertainties of the options are probably too large."
        )
    if settings.solve.beam == "free":
        notes.append(
            "CONFIG solves for the beam (solve.beam: free); the beam's new position counts with "
            "`known` and `prior`."
        )
    for note in notes:
        print(wrap(f"- {note}"))


#: A change of more than this number of its prior standard uncertainties is named.
LARGE_CHANGE = 4.0


def refuse(zero: NewZero) -> NoReturn:
    """Report that the changes do not explain the readings; exit status 1."""
    ratios = abs(zero.change / zero.prior)
    worst = int(ratios.argmax())
    several = [alternative for alternative, _ in zero.causes]
    clauses = [f"{alternative.words} {size}" for alternative, size in zero.causes]
    cause = ""
    if len(several) == 1:
        cause = f" The likeliest cause: {clauses[0]}."
    elif several:
        cause = f" {calibration.alternatives.alternative.describe_rivals(several, clauses)}"
    words = (
        f"! These changes do not explain the readings.{cause} Nothing was written. Bring the "
        "mirror to the stop again; if the result stays, calibrate."
    )
    if ratios[worst] > LARGE_CHANGE:
        words += (
            f" Or the change is larger than assumed: {ROWS[worst][0]}, {ratios[worst]:.2g} "
            "standard uncertainties before; the options state these."
        )
    print(wrap(words), file=sys.stderr)
    raise typer.Exit(FINDING)
