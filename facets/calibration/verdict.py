"""A calibration from beginning to end, and whether its result may be trusted.

The table is looked at; the plain fit is made; where it is bad, faults of the data are tried as
hypotheses; then the effects that the data call for are taken; and what is left is judged. A result
with a bad finding is not to be trusted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..core.sensor import Sensor
from ..estimation.compiling import compile_for
from .bundle_adjustment import Data, over_the_run
from .candidates import Search, beyond_chance, promised, search, tried_kinds
from .fit import Fit, fit
from .hypotheses import explanation
from .laser import steadied
from .misfit import Finding, findings, model_error, pulls, widened
from .samples import averaged, distinct, faults, inside
from .small_matrices import one_thread
from .table import split
from .unknowns import DELAY, Choice
from .validation import validation

if TYPE_CHECKING:
    from ..core.settings import Calibrate

#: Errors on held-back samples over the stated ones, from which on they are told, and forbid.
WIDER, WRONG = 1.5, 4.0
#: Chi-square for each reading, as effects of light promise it, from which on faults are looked for
#: before these effects: real light is explained by them nearly whole, a fault is not.
PROMISING = 2.0
#: Chi-square for each degree of freedom that no light of a bench makes.
LIGHT = 300.0
#: How far a fit without the effects of light that has not settled goes from the configuration, in
#: standard uncertainties, where it is of no use to look for these effects beside it. On twenty rigs
#: that had them all it went up to 17.
ASTRAY = 50.0
#: Samples that a fit needs.
LEAST = 10
#: How late a reference may be, s, before faults of the data are looked for.
LATE = 0.01


@dataclass(frozen=True)
class Verdict:
    """fitted, held: the samples.  found: the last fit, None where none was made.
    search: what became of the candidates.  sensor: what may be written.
    errors: on held-back samples, a table.  findings: what is to be said, bad ones first.
    """

    fitted: Data
    held: Data
    found: Fit | None
    search: Search | None
    sensor: Sensor | None
    errors: dict[str, NDArray[Any]] | None
    findings: list[Finding]

    @property
    def trusted(self) -> bool:
        return self.sensor is not None and not any(one.bad for one in self.findings)


@one_thread
def verdict(sensor: Sensor, data: Data, chosen: Choice, settings: Calibrate) -> Verdict:
    """Fits, tries, judges.  Raises `InputError` where there is too little to fit."""
    early = faults(sensor, data)
    whole, lost = inside(sensor, distinct(data))
    early += lost
    if len(whole.raw) < LEAST:
        early.insert(0, Finding(True, f"{len(whole.raw)} samples are left: too few."))
        return Verdict(whole, whole.part(slice(0)), None, None, None, None, early)
    fitted, held = split(averaged(sensor, over_the_run(whole)), settings.held_back)
    if any(one.bad for one in early):
        return Verdict(fitted, held, None, None, None, None, early)
    compile_for(sensor, "readings", "derivatives", "slopes", kinds=tried_kinds(sensor, settings))
    plain = fit(sensor, fitted, chosen, settings.outliers)
    if fitted.velocity is not None and suspicious(sensor, plain):
        late = fit(sensor, fitted, chosen.and_also({DELAY: LATE}), settings.outliers)
        hopeless = suspicious(sensor, late)
        plain = plain if hopeless or plain.ended else late
    else:
        hopeless = suspicious(sensor, plain)
    astray = [] if plain.ended else pulls(sensor, plain, ASTRAY)
    promising = (
        hopeless
        and plain.ended
        and plain.reduced < LIGHT
        and promised(sensor, fitted, settings, plain) < PROMISING
    )
    if hopeless and not promising and (told := explanation(sensor, fitted, chosen)):
        return Verdict(fitted, held, plain, None, None, None, [told.finding, *early])
    if hopeless and astray:  # at a sensor that can not be, no effect of light can be told
        said = [unsettled(plain), *astray, *early]
        return Verdict(fitted, held, plain, None, None, None, said)
    plain = steadied(sensor, fitted, plain, settings.outliers)
    done = search(sensor, fitted, settings, plain)
    found = done.found
    if promising and suspicious(done.sensor, found) and (
        told := explanation(sensor, fitted, chosen)
    ):  # fmt: skip
        return Verdict(fitted, held, plain, None, None, None, [told.finding, *early])
    if not found.ended:
        said = [unsettled(found), *pulls(sensor, found), *early]
        return Verdict(fitted, held, found, done, None, None, said)
    said = [*findings(done.sensor, found, fitted), *early]
    made = widened(found.sensor, found, model_error(found, fitted, done.sensor))
    known = replace(found, sensor=made)
    errors = validation(sensor, known, held if len(held.raw) else fitted)
    said += tried(errors)
    return Verdict(
        fitted, held, known, done, made, errors, sorted(said, key=lambda one: not one.bad)
    )


def unsettled(found: Fit) -> Finding:
    return Finding(True, f"The fit did not settle in {found.steps} steps: {found.cause}.")


def suspicious(sensor: Sensor, plain: Fit) -> bool:
    """Whether a fit is so bad that faults of the data are looked for."""
    return not plain.ended or beyond_chance(plain) > 0 or bool(pulls(sensor, plain))


def tried(errors: dict[str, NDArray[Any]]) -> list[Finding]:
    """Of errors on samples held back."""
    with np.errstate(invalid="ignore"):
        over = errors["robust"] / errors["stated"]
    if not np.isfinite(over).any():
        return []
    worst = int(np.nanargmax(over))
    if over[worst] < WIDER:
        return []
    axis, unit = errors["axis"][worst], errors["unit"][worst]
    words = (
        f"On samples held back the poses err by {errors['robust'][worst]:.3g} {unit} in {axis}, "
        f"where {errors['stated'][worst]:.3g} {unit} is stated: "
    )
    if over[worst] > WRONG:
        return [Finding(True, words + "the calibration does not hold beyond its own samples.")]
    return [Finding(False, words + "take the larger for the truth.")]
