"""A complete calibration, and the decision whether its result may be trusted.

The columns are checked, and the plain fit is made. If it is bad, faults of the data are tried as
hypotheses. Then the effects that the data require are added, and causes of the remaining residuals
are found. A result with a bad finding is not to be trusted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..core.sensor import Sensor
from ..core.small_matrices import one_thread
from ..core.units import Floats
from .alternatives.alternative import Finding, chance_of
from .alternatives.columns import drift_columns, warmth
from .alternatives.faults import WORST_LIGHT_SIGMAS, Explanation, find_fault
from .alternatives.judge import (
    LEAST_SCORE_FRACTION,
    Cause,
    find_causes,
    find_large_causes,
    raise_noise,
    restore_readings,
    rivals_of_shape,
    undo_causes,
)
from .alternatives.remainder import Remainder, rise_without
from .alternatives.scatter import fit_steady_laser
from .alternatives.score import score_bases
from .candidates import SIGMAS, Candidate, candidates, open_bends
from .checks import add_written_steps, check_columns, exclude_edge_readings, reference_steps
from .findings import (
    PROFILE,
    SHADED,
    cause_findings,
    centre_findings,
    effect_findings,
    exclude_shade,
    findings,
    outlier_findings,
    pull_findings,
    scatter_findings,
    spike_finding,
)
from .fitting.bundle_adjustment import Data, add_approach, add_power_polynomials
from .fitting.fit import NORMAL_MEDIAN, Fit, fit
from .fitting.samples import (
    add_converter_steps,
    average_equal_poses,
    exclude_outliers,
    remove_duplicates,
    row_numbers,
)
from .fitting.unknowns import DELAY, Choice
from .halves import (
    WIDER_CHANCE,
    WRONG_CHANCE,
    compare_halves,
    half_findings,
)
from .search import (
    CHANCE,
    EffectSearch,
    add_cheap_candidates,
    reachable_chi_square,
    search,
)
from .table import split
from .uncertainty import (
    centre_sigma,
    complete_uncertainty,
    validation_table,
)

if TYPE_CHECKING:
    from ..core.calibrate import Calibrate

#: Ratios of measured to stated error on held-back samples, above which the result is reported, and
#: refused, if chance exceeds the ratio with no more than these probabilities.
WIDER_FACTOR, WRONG_FACTOR = 1.5, 2.0
#: Faults are looked for before effects of light unless these promise a chi-square per reading below
#: this: they explain real light nearly completely, but not a fault.
PROMISING_CHI_SQUARE = 2.0
#: A plain fit that does not converge and moves a parameter further than this from its configured
#: value, in standard uncertainties, has failed; effects of light are then not tried. On twenty rigs
#: with all of them it moved parameters by up to 17.
ASTRAY_SIGMAS = 50.0
#: Undone causes are accepted if they lower chi-square of a plain fit to this fraction.
LEAST_CURE = 0.3
#: Effects that absorb noise which is larger than stated.
BEAM_SHAPES = ("profile", "asymmetry")
#: Number of rounds in which effects and causes are found in turn.
JUDGE_ROUNDS = 3
#: Samples that a fit needs.
MIN_SAMPLES = 10


@dataclass(frozen=True)
class Verdict:
    """The result of a calibration.

    fitted, held: the samples that were fitted, and those held back.  fit: the last fit, None if
    there was none.  search: the decisions on the candidates.  sensor: the calibrated sensor with
    its uncertainties, None if it must not be written.  errors: a table of the errors on held-back
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
        """Whether there is a sensor and no finding forbids its use."""
        return self.sensor is not None and not any(finding.bad for finding in self.findings)

    def refuse(self) -> Verdict:
        """The verdict on samples that fit only after a cause of most residuals was undone, since
        another cause may look the same."""
        if not self.is_trusted:
            return self
        words = (
            "The samples fit only after the cause below was undone, whose effect is many times the "
            "noise; another cause may look the same. Remove the cause first."
        )
        return replace(self, findings=[Finding(True, words), *self.findings])


@one_thread
def verdict(sensor: Sensor, data: Data, chosen: Choice, settings: Calibrate) -> Verdict:
    """Screen the samples, fit them, judge all alternatives, and accept, warn or refuse.

    Raises `InputError` if there are too few samples or unknowns to fit.
    """
    screened = screen(sensor, data, settings)
    if screened.is_refused:
        return screened.refusal()
    sensor = screened.sensor
    plain, fault, large = first_fit(sensor, screened, chosen, settings)
    if astray := unsettled_findings(sensor, plain):
        return plain.refusal(astray if fault is None else [])
    every = candidates(sensor, plain.data, settings)
    plain = follow_temperature(sensor, plain, every, settings.outliers)
    done, causes = explain(sensor, plain, chosen, settings, large)
    if fault is None and plain.promising and is_suspicious(done.sensor, done.fit):
        fault = find_fault(sensor, plain.data, chosen)
        causes = causes if fault is None else []  # they belong to samples with the fault
    if fault is not None or not done.fit.ended:
        return plain.refusal(reasons(plain, fault, causes, done), done)
    result = validate(sensor, plain, done, causes, settings)
    return result.refuse() if large else result


# ---- screen: the table alone


@dataclass(frozen=True)
class Screened:
    """The samples after the checks of the table.

    sensor: the sensor, with excluded readings out of its range.  fitted, held: the samples to fit,
    and those held back.  findings: on the table.  kind: what a sample is, rows or dwells.
    original: the unchanged samples to fit, if causes were undone.
    """

    sensor: Sensor
    fitted: Data
    held: Data
    findings: list[Finding]
    kind: str
    original: Data | None = None

    def remove(self, causes: list[Cause]) -> Screened:
        """Return the samples without the effects of causes on their readings."""
        original = self.original or self.fitted
        return replace(self, fitted=undo_causes(original, causes), original=original)

    def follow(self, n: int) -> Screened:
        """The samples with one of `Data.pasts` as the delayed temperature."""
        original = self.original and self.original.follow(n)
        fitted, held = self.fitted.follow(n), self.held.follow(n)
        return replace(self, fitted=fitted, held=held, original=original)

    @property
    def is_refused(self) -> bool:
        """Whether a finding on the columns forbids a calibration."""
        return any(finding.bad for finding in self.findings)

    def undo(self, fault: Explanation) -> Screened:
        """The samples without a fault, and the finding on it."""
        return replace(
            self, fitted=fault.undo(self.fitted), held=fault.undo(self.held),
            findings=[fault.finding, *self.findings],
        )  # fmt: skip

    def refusal(self) -> Verdict:
        """The verdict that the table cannot be used, without a fit, with the findings of its
        checks."""
        return Verdict(self.fitted, self.held, None, None, None, None, self.findings)


def screen(sensor: Sensor, data: Data, settings: Calibrate) -> Screened:
    """Check the columns, exclude readings over an edge, and hold samples back."""
    kind = "rows" if data.noise is None else "dwells"
    early = check_columns(sensor, data)
    samples, coarse = add_written_steps(sensor, data._replace(number=row_numbers(data)))
    sensor, samples, lost = exclude_edge_readings(sensor, remove_duplicates(add_approach(samples)))
    early += coarse + lost
    if len(samples.raw) < MIN_SAMPLES:
        early.insert(0, Finding(True, f"{len(samples.raw)} samples remain: too few."))
        return Screened(sensor, samples, samples.part(slice(0)), early, kind)
    averages = add_converter_steps(
        sensor, average_equal_poses(sensor, add_power_polynomials(samples))
    )
    fitted, held = split(averages, settings.held_back)
    return Screened(sensor, fitted, held, early, kind)


# ---- fit: without effects of light and without outliers


@dataclass(frozen=True)
class Plain:
    """The fit without effects of the light and without outliers.

    screened: all samples.  data: the samples that were fitted.  fit: the fit.  outliers: excluded
    rows.  hopeless: whether the fit is so bad that faults of the data are looked for.  promising:
    whether effects of light promise to explain it.
    """

    screened: Screened
    data: Data
    fit: Fit
    outliers: list[int]
    hopeless: bool
    promising: bool

    def is_better_than(self, other: Plain) -> bool:
        """Whether chi-square is clearly lower than another fit's, or lower at all if that did not
        converge; False if only the other converged."""
        if not self.fit.ended and other.fit.ended:
            return False
        factor = LEAST_CURE if other.fit.ended else 1.0
        return self.fit.reduced_chi_square < factor * other.fit.reduced_chi_square

    @property
    def original(self) -> Data:
        """The samples to fit, screened and averaged, before causes were undone."""
        return self.screened.original or self.screened.fitted

    def refusal(self, reasons: list[Finding], done: EffectSearch | None = None) -> Verdict:
        """The verdict that the calibration is not to be trusted, with its reasons. done: a search
        for effects, whose fit and samples then replace those of the plain fit."""
        every = [*reasons, *self.screened.findings]
        result, data = (self.fit, self.data) if done is None else (done.fit, done.data)
        return Verdict(data, self.screened.held, result, done, None, None, every)


def plain_fit(sensor: Sensor, screened: Screened, chosen: Choice, settings: Calibrate) -> Plain:
    """Fit without effects of the light; if that is hopeless, also with a delay of the reference."""
    robust = settings.outliers

    def fit_without_outliers(choice: Choice) -> tuple[Data, Fit, list[int]]:
        """Fit a choice; returns the samples without outliers, the fit and the rows excluded."""
        result = fit(sensor, screened.fitted, choice, robust)
        return exclude_outliers(sensor, screened.fitted, result, robust)

    data, result, outliers = fit_without_outliers(chosen)
    hopeless = is_suspicious(sensor, result)
    if screened.fitted.velocity is not None and hopeless:
        late = fit_without_outliers(chosen.add_unknowns({DELAY: SIGMAS["delay"]}))
        hopeless = is_suspicious(sensor, late[1])
        if late[1].ended and not result.ended:
            data, result, outliers = late
    every = candidates(sensor, data, settings)
    promising = (
        hopeless
        and result.ended
        and result.reduced_chi_square < WORST_LIGHT_SIGMAS**2
        and reachable_chi_square(sensor, data, result, every) < PROMISING_CHI_SQUARE
    )
    return Plain(screened, data, result, outliers, hopeless, promising)


# ---- judge: causes of the residuals


def first_fit(
    sensor: Sensor, screened: Screened, chosen: Choice, settings: Calibrate
) -> tuple[Plain, Explanation | None, list[Cause]]:
    """The plain fit, the fault of the table that was undone before it (None if none was), and the
    large causes.

    A fault or causes are undone only if no light explains the residuals of a first plain fit.
    """
    plain = plain_fit(sensor, screened, chosen, settings)
    if plain.promising or not plain.hopeless:
        return plain, None, []
    clean, large = undo_large_causes(sensor, plain, chosen, settings)
    if clean.promising or not clean.hopeless:
        return clean, None, large
    is_better, fault = clean.is_better_than(plain), find_fault(sensor, plain.data, chosen)
    if fault is not None and not (fault.is_block and is_better and clean.fit.ended):
        return plain_fit(sensor, screened.undo(fault), chosen, settings), fault, []
    return (clean, None, large) if is_better else (plain, None, [])


def undo_large_causes(
    sensor: Sensor, plain: Plain, chosen: Choice, settings: Calibrate
) -> tuple[Plain, list[Cause]]:
    """The plain fit to samples without the causes that explain most of its residuals, in addition
    to all effects."""
    causes, every = list[Cause](), candidates(sensor, plain.data, settings)
    for _ in range(JUDGE_ROUNDS):
        wide = add_cheap_candidates(every, plain.fit.choice)
        data = restore_readings(plain.data, plain.original)
        robust = None if causes else settings.outliers
        with np.errstate(over="ignore", invalid="ignore"):  # for a fit that diverged
            result = replace(plain.fit, choice=wide)
            large = find_large_causes(Remainder(sensor, data, result, robust))
        if not large:
            break
        causes, plain = large, plain_fit(sensor, plain.screened.remove(large), chosen, settings)
        if plain.promising or not plain.hopeless:
            break
    return plain, causes


def follow_temperature(
    sensor: Sensor, plain: Plain, every: list[Candidate], robust: float | None
) -> Plain:
    """The plain fit with the likeliest delay of the beam and the places behind the temperature. The
    same fit for a table without temperature."""
    if plain.data.pasts is None:
        return plain
    wide = add_cheap_candidates(every, plain.fit.choice)
    fitted = replace(plain.fit, choice=wide)
    rest = Remainder(sensor, plain.data, fitted, robust)
    best = int(score_bases(rest, "temperature", drift_columns(rest), warmth(rest)).at[0])
    return replace(plain, screened=plain.screened.follow(best), data=plain.data.follow(best))


def unsettled_findings(sensor: Sensor, plain: Plain) -> list[Finding]:
    """Findings on a fit that failed."""
    if not plain.hopeless or plain.fit.ended:
        return []
    astray = pull_findings(sensor, plain.fit, ASTRAY_SIGMAS)
    return [unsettled_finding(plain.fit), *astray] if astray else []


def extend(sensor: Sensor, plain: Plain, settings: Calibrate) -> EffectSearch:
    """Add the effects that the data require."""
    steady = fit_steady_laser(sensor, plain.data, plain.fit, settings.outliers)
    return search(sensor, plain.data, settings, steady, plain.outliers)


def explain(
    sensor: Sensor, plain: Plain, chosen: Choice, settings: Calibrate, causes: list[Cause]
) -> tuple[EffectSearch, list[Cause]]:
    """Add the effects that the data require, and find causes of the remaining residuals.

    An effect that absorbs a part of a cause is wrong. So the causes are undone in the samples, and
    effects and causes are found again, without effects that are unnecessary in addition to the
    causes, until the causes remain the same.  causes: those that were undone before. Returns the
    search and the causes.
    """
    original, best = plain.original, None
    for _ in range(JUDGE_ROUNDS):
        done = extend(sensor, plain, settings)
        if best is not None and not done.fit.ended:
            break  # undoing the causes made it worse
        data = restore_readings(done.data, original) if causes else done.data
        robust = None if causes else settings.outliers
        together = done.scatter.cross_covariance
        rest = Remainder(done.sensor, data, done.fit, robust, together)
        remainder = raise_noise(rest, robust, together)
        before, causes = [cause.best.key for cause in causes], find_causes(remainder)
        best = done, causes
        needless = needless_effects(remainder, causes, done, settings)
        if [cause.best.key for cause in causes] == before and not needless:
            break
        settings = replace(settings, effects=settings.effects | dict.fromkeys(needless, "off"))
        plain = plain_fit(sensor, plain.screened.remove(causes), chosen, settings)
    assert best is not None
    return best


def needless_effects(
    remainder: Remainder, causes: list[Cause], done: EffectSearch, settings: Calibrate
) -> list[str]:
    """The effects that are unnecessary with the noise and the causes that were found.

    Modes of the beam are tested without the causes, which were found in addition to them, and are
    also unnecessary if another alternative explains more.
    """
    extended = remainder.extend_by([cause.best for cause in causes])
    doubtful = effects_to_doubt(done, settings)
    needless = list[str]()
    for candidate in doubtful if causes or done.scatter.causes else []:
        names = set(candidate.sigma) & set(done.fit.choice.names)
        rest = remainder if candidate.key in BEAM_SHAPES else extended
        if chance_of(rise_without(rest, names), len(names)) > CHANCE:
            needless.append(candidate.key)
    shapes = [part.key for part in doubtful if part.key in BEAM_SHAPES]
    of_shape = tuple(name for name in done.fit.choice.names if name in PROFILE)
    if shapes and rivals_of_shape(remainder, of_shape)[1]:
        needless += shapes
    return needless


def effects_to_doubt(done: EffectSearch, settings: Calibrate) -> list[Candidate]:
    """The fitted effects that the user did not require and that look like others."""
    return [
        part for part in done.accepted
        if settings.effects.get(part.key) != "on" and set(part.sigma) & set(done.fit.choice.names)
        and (part.key in BEAM_SHAPES or part.effect.rivals)
    ]  # fmt: skip


def reasons(
    plain: Plain, fault: Explanation | None, causes: list[Cause], done: EffectSearch
) -> list[Finding]:
    """The reasons why there is no result."""
    every = [] if fault is None or fault.finding in plain.screened.findings else [fault.finding]
    if done.fit.ended:
        every += cause_findings(causes)
    elif fault is None:  # those that are certain nevertheless
        every += cause_findings([cause for cause in causes if cause.is_most])
    if fault is not None or done.fit.ended:
        return every
    return [*every, unsettled_finding(done.fit), *pull_findings(done.sensor, done.fit)]


# ---- validate: on samples held back


def validate(
    sensor: Sensor, plain: Plain, done: EffectSearch, causes: list[Cause], settings: Calibrate
) -> Verdict:
    """The verdict on a converged fit, with its sensor's uncertainty and its errors on held-back
    samples."""
    data, held = done.data, plain.screened.held
    remainder = remainder_of(done, settings.outliers)
    centre = centre_sigma(done.sensor, remainder, settings.before)
    every, fitted = settled_findings(plain, done, causes, remainder)
    every += centre_findings(centre)
    read = restore_readings(data, plain.original)
    made = complete_uncertainty(
        fitted, remainder, read, done.scatter, causes, centre, open_bends(settings),
        settings.outliers,
    )  # fmt: skip
    calibrated = replace(done.fit, sensor=made)
    held = held._replace(sigma=data.sigma) if len(held.raw) else data
    errors = validation_table(sensor, calibrated, held)
    if all(
        cause.alternatives[0].persists for cause in causes
    ):  # others also act on held-back samples
        every += validation_findings(errors)
    every.sort(key=lambda finding: not finding.bad)
    return Verdict(data, held, calibrated, done, made, errors, every)


def remainder_of(done: EffectSearch, robust: float | None) -> Remainder:
    """The remainder of the fit with its effects."""
    return Remainder(done.sensor, done.data, done.fit, robust, done.scatter.cross_covariance)


def settled_findings(
    plain: Plain, done: EffectSearch, causes: list[Cause], remainder: Remainder
) -> tuple[list[Finding], Sensor]:
    """Findings on the samples and on a converged fit, and the fitted sensor, with shaded places out
    of range."""
    result, fitted = done.fit, done.fit.sensor
    outliers = outlier_findings(
        done.sensor, plain.original, done.outliers, result, plain.screened.kind
    )
    if any(SHADED in finding.causes for finding in outliers):
        fitted = exclude_shade(result, plain.original, done.outliers)
    every = cause_findings(causes) + outliers
    judged = findings(done.sensor, result, done.data)
    min_fall = LEAST_SCORE_FRACTION * max((cause.best.fall for cause in causes), default=0.0)
    if not any(
        finding.bad and not finding.causes for finding in judged
    ):  # else they absorb other causes
        every += effect_findings(remainder, min_fall)
        every += scatter_findings(done.scatter, min_fall)
    every += half_findings(compare_halves(remainder))
    every += reference_steps(plain.original, done.scatter) + judged + plain.screened.findings
    return every, fitted


def unsettled_finding(result: Fit) -> Finding:
    """The finding, which refuses the calibration, on a fit that did not converge."""
    return Finding(True, f"The fit did not converge in {result.steps} steps: {result.cause}.")


def is_suspicious(sensor: Sensor, plain: Fit) -> bool:
    """Whether a fit is so bad that faults of the data are looked for."""
    spikes = spike_finding(plain)
    is_worse = plain.excess > 0 or bool(spikes and spikes.bad)
    return not plain.ended or is_worse or bool(pull_findings(sensor, plain))


def largest_by_chance(counts: Floats, probability: float) -> Floats:
    """The ratios of robust to stated error of the axes that a calibration without a fault exceeds
    in any axis with this probability.

    counts: (m,) of independent samples by axis. The median of n values has the rank of a beta
    variable with (n + 1) / 2 twice; the m axes share the probability (Sidak).
    """
    from scipy.special import betaincinv, ndtri

    half = (counts + 1) / 2
    rank = betaincinv(half, half, (1 - probability) ** (1 / len(counts)))
    limit: Floats = NORMAL_MEDIAN * ndtri((1 + rank) / 2)
    return limit


def validation_findings(errors: dict[str, NDArray[Any]]) -> list[Finding]:
    """A finding on the errors of poses from held-back samples, see `validation_table`; empty if
    they are as small as stated."""
    with np.errstate(invalid="ignore"):
        over = errors["robust"] / errors["stated"]
    measured = np.flatnonzero(np.isfinite(over))
    if not measured.size:
        return []
    over, counts = over[measured], errors["samples"][measured]
    wider, wrong = (
        over / np.maximum(factor, largest_by_chance(counts, chance))
        for factor, chance in ((WIDER_FACTOR, WIDER_CHANCE), (WRONG_FACTOR, WRONG_CHANCE))
    )
    if wider.max() <= 1:
        return []
    n = measured[np.argmax(wider)]
    unit = errors["unit"][n]
    words = (
        f"On {errors['samples'][n]:.0f} samples held back the poses err by "
        f"{errors['robust'][n]:.3g} {unit} in {errors['axis'][n]}, but the stated uncertainty is "
        f"{errors['stated'][n]:.3g} {unit}; chance does not explain this: "
    )
    if wrong.max() > 1:
        return [Finding(True, words + "the calibration does not hold beyond its own samples.")]
    return [Finding(False, words + "use the larger of the two.")]
