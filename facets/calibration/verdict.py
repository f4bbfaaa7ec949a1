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
from ..estimation.estimates import compile_for
from .bundle_adjustment import Data, add_approach, add_power_polynomials
from .candidates import DELAY_SIGMA_S, tried_kinds
from .effect_search import EffectSearch, search
from .fit import Fit, fit
from .hypotheses import find_fault
from .laser import fit_steady_laser
from .linear_prediction import reachable_chi_square
from .misfit import (
    Finding,
    add_unseen_errors,
    centre_sigma,
    common_findings,
    common_scatter,
    findings,
    model_error,
    outlier_findings,
    pull_findings,
)
from .outliers import exclude_outliers, row_numbers
from .samples import (
    add_converter_steps,
    average_equal_poses,
    exclude_edge_readings,
    faults,
    remove_duplicates,
)
from .small_matrices import one_thread
from .table import split
from .unknowns import DELAY, Choice
from .unmodelled import Remainder, find_causes, find_changes
from .unmodelled_findings import centre_findings, change_findings, unmodelled_findings
from .validation import validation_table

if TYPE_CHECKING:
    from ..core.calibrate import Calibrate

#: Errors on held-back samples over the stated ones, from which on they are told, and forbid.
WIDER_FACTOR, WRONG_FACTOR = 1.5, 4.0
#: Chi-square for each reading, as effects of light promise it, from which on faults are looked for
#: before these effects: real light is explained by them nearly whole, a fault is not.
PROMISING_CHI_SQUARE = 2.0
#: Chi-square for each degree of freedom that no light of a bench makes.
WORST_LIGHT_CHI_SQUARE = 300.0
#: How far a fit without the effects of light that has not settled goes from the configuration, in
#: standard uncertainties, where it is of no use to look for these effects beside it. On twenty rigs
#: that had them all it went up to 17.
ASTRAY_SIGMAS = 50.0
#: Samples that a fit needs.
MIN_SAMPLES = 10


@dataclass(frozen=True)
class Verdict:
    """The result of a calibration.

    fitted, held: the samples that were fitted, and those held back.  fit: the last fit, None where
    none was made.  search: what became of the candidates.  sensor: the calibrated sensor with its
    uncertainties, None where none may be written.  errors: a table of the errors on held-back
    samples.  findings: in sentences, those that forbid the use first.
    """

    fitted: Data
    held: Data
    fit: Fit | None
    search: EffectSearch | None
    sensor: Sensor | None
    errors: dict[str, NDArray[Any]] | None
    findings: list[Finding]

    @property
    def is_trusted(self) -> bool:
        return self.sensor is not None and not any(finding.bad for finding in self.findings)


@one_thread
def verdict(sensor: Sensor, data: Data, chosen: Choice, settings: Calibrate) -> Verdict:
    """Screen the samples, fit them, look for faults, add effects, and validate.

    Raises `InputError` where there are too few samples or unknowns to fit.
    """
    screened = screen(sensor, data, settings)
    if screened.is_refused:
        return screened.verdict()
    plain = plain_fit(sensor, screened, chosen, settings)
    reasons = explain(sensor, plain, chosen, settings)
    if reasons:
        return plain.verdict(reasons)
    done = extend(sensor, plain, settings)
    reasons = doubt(sensor, plain, done, chosen, settings)
    if reasons:
        return plain.verdict(reasons, done)
    return validate(sensor, plain, done, settings)


# ---- screen: the table alone


@dataclass(frozen=True)
class Screened:
    """The samples after a look at the table.

    fitted, held: the samples to fit, and those held back.  findings: on the table.  kind: what a
    sample is, rows or stands.
    """

    fitted: Data
    held: Data
    findings: list[Finding]
    kind: str

    @property
    def is_refused(self) -> bool:
        return any(finding.bad for finding in self.findings)

    def verdict(self) -> Verdict:
        return Verdict(self.fitted, self.held, None, None, None, None, self.findings)


def screen(sensor: Sensor, data: Data, settings: Calibrate) -> Screened:
    """Check the columns, leave out readings over an edge, and hold samples back."""
    kind = "rows" if data.noise is None else "stands"
    early = faults(sensor, data)
    whole, lost = exclude_edge_readings(
        sensor, remove_duplicates(add_approach(data._replace(number=row_numbers(data))))
    )
    early += lost
    if len(whole.raw) < MIN_SAMPLES:
        early.insert(0, Finding(True, f"{len(whole.raw)} samples are left: too few."))
        return Screened(whole, whole.part(slice(0)), early, kind)
    averages = add_converter_steps(
        sensor, average_equal_poses(sensor, add_power_polynomials(whole))
    )
    fitted, held = split(averages, settings.held_back)
    return Screened(fitted, held, early, kind)


# ---- fit: without effects of light and without outliers


@dataclass(frozen=True)
class Plain:
    """The fit without effects of the light and without outliers.

    screened: all samples.  data: the samples that were fitted.  fit: the fit.  outliers: rows that
    were taken out.  hopeless: whether the fit is so bad that faults of the data are looked for.
    promising: whether effects of light promise to explain it.
    """

    screened: Screened
    data: Data
    fit: Fit
    outliers: list[int]
    hopeless: bool
    promising: bool

    def verdict(self, reasons: list[Finding], done: EffectSearch | None = None) -> Verdict:
        """The verdict that the calibration is not to be trusted, with its reasons."""
        said = [*reasons, *self.screened.findings]
        result, data = (self.fit, self.data) if done is None else (done.fit, done.data)
        return Verdict(data, self.screened.held, result, done, None, None, said)


def plain_fit(sensor: Sensor, screened: Screened, chosen: Choice, settings: Calibrate) -> Plain:
    """Fit without effects of the light; where that is hopeless, also with a delay of the
    reference."""
    robust = settings.outliers
    compile_for(sensor, "readings", "derivatives", "slopes", kinds=tried_kinds(sensor, settings))

    def fit_without_outliers(choice: Choice) -> tuple[Data, Fit, list[int]]:
        result = fit(sensor, screened.fitted, choice, robust)
        return exclude_outliers(sensor, screened.fitted, result, robust)

    data, result, gone = fit_without_outliers(chosen)
    hopeless = is_suspicious(sensor, result)
    if screened.fitted.velocity is not None and hopeless:
        late = fit_without_outliers(chosen.add_unknowns({DELAY: DELAY_SIGMA_S}))
        hopeless = is_suspicious(sensor, late[1])
        if not (hopeless or result.ended):
            data, result, gone = late
    promising = (
        hopeless
        and result.ended
        and result.reduced_chi_square < WORST_LIGHT_CHI_SQUARE
        and reachable_chi_square(sensor, data, settings, result) < PROMISING_CHI_SQUARE
    )
    return Plain(screened, data, result, gone, hopeless, promising)


# ---- explain: faults of the data


def explain(sensor: Sensor, plain: Plain, chosen: Choice, settings: Calibrate) -> list[Finding]:
    """Findings on a fault of the data that explains a bad fit, or on a fit on which nothing can be
    built."""
    if not plain.hopeless:
        return []
    if not plain.promising and (reasons := find_fault(sensor, plain.data, chosen, plain.fit)):
        return [reasons.finding]
    astray = [] if plain.fit.ended else pull_findings(sensor, plain.fit, ASTRAY_SIGMAS)
    return [unsettled_finding(plain.fit), *astray] if astray else []


# ---- extend: with the effects that the data call for


def extend(sensor: Sensor, plain: Plain, settings: Calibrate) -> EffectSearch:
    steady = fit_steady_laser(sensor, plain.data, plain.fit, settings.outliers)
    return search(sensor, plain.data, settings, steady, plain.outliers)


def doubt(
    sensor: Sensor, plain: Plain, done: EffectSearch, chosen: Choice, settings: Calibrate
) -> list[Finding]:
    """Findings on a fault of the data that effects of light only promised to explain, or on a fit
    that did not settle."""
    if plain.promising and is_suspicious(done.sensor, done.fit) and (
        reasons := find_fault(sensor, plain.data, chosen, plain.fit)
    ):  # fmt: skip
        return [reasons.finding]
    if not done.fit.ended:
        remainder = Remainder(done.sensor, done.data, done.fit, settings.outliers)
        changes = change_findings(find_changes(remainder), row_numbers(done.data))
        return [*changes, unsettled_finding(done.fit),
                *pull_findings(sensor, done.fit)]  # fmt: skip
    return []


# ---- validate: on samples held back


def validate(sensor: Sensor, plain: Plain, done: EffectSearch, settings: Calibrate) -> Verdict:
    result, data, held = done.fit, done.data, plain.screened.held
    remainder = Remainder(done.sensor, data, result, settings.outliers)
    unmodelled = find_causes(remainder)
    said = outlier_findings(done.outliers, len(plain.screened.fitted.raw), plain.screened.kind)
    said += [*unmodelled_findings(unmodelled), *findings(done.sensor, result, data, done.scatter)]
    said += plain.screened.findings
    missed = model_error(result, data, done.sensor, done.scatter)
    centre = centre_sigma(done.sensor, remainder, settings)
    said += centre_findings(centre)
    as_stated = data._replace(sigma=plain.screened.fitted.sigma)
    common = common_scatter(Remainder(done.sensor, as_stated, result, settings.outliers))
    said += common_findings(common)
    made = add_unseen_errors(result.sensor, result, missed, centre, common)
    known = replace(result, sensor=made)
    held = held._replace(sigma=data.sigma) if len(held.raw) else data
    errors = validation_table(sensor, known, held)
    said += validation_findings(errors)
    said.sort(key=lambda finding: not finding.bad)
    return Verdict(data, held, known, done, made, errors, said)


def unsettled_finding(result: Fit) -> Finding:
    return Finding(True, f"The fit did not settle in {result.steps} steps: {result.cause}.")


def is_suspicious(sensor: Sensor, plain: Fit) -> bool:
    """Whether a fit is so bad that faults of the data are looked for."""
    return not plain.ended or plain.excess > 0 or bool(pull_findings(sensor, plain))


def validation_findings(errors: dict[str, NDArray[Any]]) -> list[Finding]:
    """A finding on the errors of poses from held-back samples."""
    with np.errstate(invalid="ignore"):
        over = errors["robust"] / errors["stated"]
    if not np.isfinite(over).any():
        return []
    worst = int(np.nanargmax(over))
    if over[worst] < WIDER_FACTOR:
        return []
    axis, unit = errors["axis"][worst], errors["unit"][worst]
    words = (
        f"On samples held back the poses err by {errors['robust'][worst]:.3g} {unit} in {axis}, "
        f"where {errors['stated'][worst]:.3g} {unit} is stated: "
    )
    if over[worst] > WRONG_FACTOR:
        return [Finding(True, words + "the calibration does not hold beyond its own samples.")]
    return [Finding(False, words + "take the larger for the truth.")]
