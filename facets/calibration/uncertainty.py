"""The uncertainty of a calibrated sensor: errors that the fit does not see, validation on samples
that were held back, and the uncertainty budget.

With F the information on all unknowns, including the samples' own, and F_s the part of it that
comes from source s, the covariance is the sum of F^-1 F_s F^-1 over the sources. The samples' own
unknowns are eliminated as in the fit.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.knowledge import Prior
from ..core.names import ANGLES, POSE
from ..core.sensor import Sensor
from ..core.small_matrices import one_thread
from ..core.units import Floats
from ..detectors.calibrated import LIGHT_CENTRE, MISFIT, MODEL_ERROR
from ..detectors.correction import correct
from ..estimation.differences import propagate_in_light
from ..estimation.plan import make_plan
from ..estimation.solution import Solution
from ..estimation.solver import solve
from ..estimation.uncertainty import carry, coverage_factor, effective_degrees_of_freedom
from ..model.arrays import EFFECTS, readings
from .alternatives.columns import beam_sigma, chip_columns, effect_columns, shape_columns
from .alternatives.judge import Cause, trace_in_use, unsaid_shift
from .alternatives.remainder import Remainder, second_moment
from .alternatives.scatter import (
    PLACE_READINGS,
    POWERS,
    Scatter,
    covariance_factor,
    is_doubtful,
)
from .checks import rounding
from .findings import profile_size, residual_sizes
from .fitting.bundle_adjustment import (
    OWN_COUNT,
    OWN_UNITS,
    Data,
    add_skew,
    deviations,
    own_information,
    relative_power,
    states_of,
)
from .fitting.fit import NORMAL_MEDIAN, Fit, Task, add_mean_power, sensor_covariance
from .fitting.samples import PLACE_SIGMA_MM, half_drift, model_accuracy
from .fitting.unknowns import PLACE, fold_mount, spline_error, values_of
from .halves import compare_halves, half_covariance

if TYPE_CHECKING:
    from ..core.knowledge import Knowledge


def complete_uncertainty(
    sensor: Sensor,
    remainder: Remainder,
    read: Data,
    scatter: Scatter,
    causes: list[Cause],
    centre: float,
    bends: dict[str, float],
    robust: float | None,
) -> Sensor:
    """The fitted sensor with the uncertainty of the fit and of the errors that it does not see.

    read: the samples with their original readings.  centre: see `centre_sigma`.  bends: see
    `add_open_bends`.
    """
    result, data = remainder.fit, remainder.data
    misfit = misfit_covariance(result, read, remainder.nominal, scatter, causes)
    made = add_open_bends(sensor, remainder, bends, robust)
    centre = float(np.hypot(centre, beam_drift(result, data, causes)))
    made = add_unseen_errors(made, result, data, misfit, centre)
    made = add_shared_noise(made, remainder, scatter, robust)
    made = add_causes(made, remainder, causes)
    made = widen(made, result, half_covariance(compare_halves(remainder)))
    return add_background_scale(made, result, data)


def misfit_covariance(
    result: Fit,
    data: Data,
    sensor: Sensor,
    scatter: Scatter,
    causes: list[Cause],
) -> Floats:
    """The covariance (9, 9) of errors of the model in the readings, mm and mW.

    It includes the detectors' scatter in excess of their noise, the uncertainty of their splines,
    and the drift since the middle of the run. The steps in which readings are written are added,
    and residuals beyond chance whose cause is unknown or stays with the sensor.

    data: samples with their original readings. The unknowns absorb a part of the model's error, as
    they do of the noise, and a larger one, because this error changes smoothly from pose to pose.
    So the residuals beyond chance are divided once more by the fraction of noise that stays in
    residuals.
    """
    sigma = np.nanmedian(deviations(sensor, data), axis=0)
    scattered = scatter.size_of(POWERS) ** 2 * np.eye(9)
    scattered[np.ix_(PLACE_READINGS, PLACE_READINGS)] = scatter.places
    stated = sigma / np.sqrt(1 + np.diag(scattered))
    missed = np.zeros(9)
    if is_doubtful(result):
        sizes = residual_sizes(result, data)
        redundancy = float(result.redundancy[np.isfinite(data.raw)].mean())
        missed = sigma * np.sqrt(np.maximum(sizes**2 - 1, 0.0) / max(redundancy, 0.1))
    spline = spline_error(sensor, data.raw, result.choice.names, result.covariance)
    drifted = np.zeros(9)
    drifted[PLACE_READINGS] = half_drift(result, data)[2:]
    matrix: Floats = np.outer(drifted, drifted) + scattered * stated * stated[:, None]
    matrix += np.diag(missed**2 + spline**2 + rounding(sensor, data) ** 2)
    for cause in causes:
        matrix += cause.lasting_misfit
    return matrix


#: Shift of the light's centre, in the beam's standard deviations, per unit of the power fraction
#: outside the model's cross-section, as the residuals bound it. An asymmetric beam has its r.m.s.
#: deviation from a Gaussian for this fraction. Ghosts of a thousandth moved x and y of calibrations
#: by 0.5 to 1.4 of their fraction (the study `disturbed_rigs`), for which the bound gives 0.3 to
#: 0.6. Another reflex, 1 to 2.5 standard deviations away, moves it by 2.4 to 0.4 of its fraction.
CENTRE_PER_FRACTION = 1.5
#: Root of the sum of squares of the third-order Hermite coefficients of a second beam, per unit of
#: its fraction of the power, at a distance of nearly two standard deviations.
ORDER_3_PER_FRACTION = 1.45
#: Prior standard uncertainty of the area broken off each facet's tip, square to the mirror's axis,
#: mm^2.
CHIP_SIGMA_MM2 = 4e-4
#: Prior standard uncertainty of light that is lost, as by dust or a chipped edge, a fraction of a
#: facet's light. It is that of each term of second to fourth order in x and y, over the reach.
MAP_SIGMA = 2e-4


def centre_sigma(sensor: Sensor, remainder: Remainder, before: dict[str, float]) -> float:
    """Standard uncertainty of the light's centre in each direction, mm.

    A small deviation from the fitted cross-section of the beam looks like another position of the
    apex. The residuals show little of it, but they bound it: a second beam has a profile of third
    order, and so has a chipped tip. Light is taken to be Gaussian where the fit has no effect of
    real light.  before: see `calibrate.before`.
    """
    if not any(name in EFFECTS for name in remainder.fit.choice.names):
        return 0.0
    fraction = before.get("beam_profile_percent", 0.0) / 100
    if fraction:
        sigma = ORDER_3_PER_FRACTION * fraction / 2  # each of four numbers
        square = second_moment(remainder, effect_columns(remainder, "asymmetry"), sigma)
        fraction = float(np.sqrt(square)) / ORDER_3_PER_FRACTION
    uneven = CENTRE_PER_FRACTION * np.hypot(fraction, profile_size(remainder.fit, "asymmetry"))
    return float(np.hypot(beam_sigma(sensor) * uneven, lost_light_shift(remainder)))


def lost_light_shift(remainder: Remainder) -> float:
    """Possible shift (r.m.s.) of the apex on the reference by light that is lost on the facets, the
    larger of x and y, mm.

    Pieces may be broken off the tip, different ones on each facet, and light may be lost as a
    smooth function of the beam's place, both as far as the samples allow.
    """
    square = np.zeros(2)
    for columns, sigma in (
        (chip_columns(remainder), CHIP_SIGMA_MM2), (shape_columns(remainder), MAP_SIGMA)
    ):  # fmt: skip
        wider = remainder.extend(remainder.readable(columns), sigma**-2)
        at = apex_places(remainder.fit)
        moved = (wider.values - remainder.values)[at]
        more = (np.diag(wider.covariance)[at] - np.diag(remainder.covariance)[at]).clip(0.0)
        square[: len(at)] += moved**2 + more
    return float(np.sqrt(square.max()))


#: R.m.s. distance of the points of a straight line from its end, in half lengths.
FROM_END = 2 / np.sqrt(3)


def apex_places(result: Fit) -> list[int]:
    """The places of the apex's x and y on the reference among a fit's unknowns."""
    return [n for n, name in enumerate(result.choice.names) if name in ("apex.x", "apex.y")]


def beam_drift(result: Fit, data: Data, causes: list[Cause]) -> float:
    """Distance of the beam from its final position, r.m.s. over the run, the larger of x and y, mm:
    by a straight drift, and by causes that move the beam."""
    square = (half_drift(result, data)[:2] * FROM_END) ** 2
    for cause in causes:
        if cause.best.key.startswith("beam."):
            rest = cause.remainder
            way = np.linalg.pinv(rest.beam_columns) @ cause.best.effect[:, :, None]
            square = square + (way[:, :, 0] ** 2).mean(axis=0)
    return float(np.sqrt(square.max()))


def add_open_bends(
    sensor: Sensor, remainder: Remainder, sigma: dict[str, float], robust: float | None
) -> Sensor:
    """The calibrated sensor whose uncertainty includes bends of the detectors that are not in the
    fit, as far as the samples allow them: mostly over places that no spot reached.

    sigma: prior standard uncertainties of the bends by name, mm.
    """
    calibration, result = sensor.calibration, remainder.fit
    assert calibration is not None
    size = len(result.choice.names)
    if not sigma.keys() - set(result.choice.names):
        return sensor
    wide = result.choice.add_unknowns(sigma)
    bent = Remainder(remainder.nominal, remainder.data, replace(result, choice=wide), robust)
    covariance = bent.covariance[:, size : len(wide.names)]
    of_bends = np.linalg.inv(covariance[size : len(wide.names)])
    added: Floats = np.asarray(covariance @ of_bends @ covariance.T, dtype=float)
    more = sensor_covariance(list(wide.names), result.all_values, added)
    further = [name for name in more.names if name not in calibration.names]
    names = (*calibration.names, *further)
    at = [names.index(name) for name in more.names]
    matrix = np.pad(np.array(calibration.covariance), (0, len(further)))
    matrix[np.ix_(at, at)] += more.covariance
    return replace_covariance(sensor, names, matrix)


def add_unseen_errors(
    sensor: Sensor, result: Fit, data: Data, misfit: Floats, centre: float
) -> Sensor:
    """The calibrated sensor whose uncertainty includes errors of the model in the readings, the
    accuracy of the model of real light, and the uncertainty of the light's centre.

    misfit: see `misfit_covariance`.  centre: standard uncertainty of the light's centre, with the
    beam's drift, mm.
    """
    from scipy.linalg import block_diag

    calibration = sensor.calibration
    assert calibration is not None
    exact = real_light_accuracy(result, data)
    unseen = block_diag(misfit, np.diag(exact**2), centre**2 * np.eye(2))
    more = np.flatnonzero(np.diag(unseen) > 0)
    names = np.array([*MISFIT, *MODEL_ERROR, *LIGHT_CENTRE])[more]
    fitted = covariance_factor(result) * np.array(calibration.covariance)
    matrix = block_diag(fitted, unseen[np.ix_(more, more)])
    return replace_covariance(sensor, (*calibration.names, *names.tolist()), matrix)


def replace_covariance(sensor: Sensor, names: tuple[str, ...], matrix: Floats) -> Sensor:
    """The calibrated sensor with another covariance (names, names), of these names."""
    assert sensor.calibration is not None
    rows = tuple(map(tuple, matrix.tolist()))
    calibration = replace(sensor.calibration, names=names, covariance=rows)
    return replace(sensor, calibration=calibration)


def real_light_accuracy(result: Fit, data: Data) -> Floats:
    """Standard error (9,) of the model of real light in the readings, mm and mW; zero where the fit
    has no effects of real light."""
    if any(name in EFFECTS for name in result.choice.names):
        return model_accuracy(data, PLACE_SIGMA_MM)
    return np.zeros(9)


def add_causes(sensor: Sensor, remainder: Remainder, causes: list[Cause]) -> Sensor:
    """The calibrated sensor whose uncertainty includes that of the causes of residuals.

    Each cause, or a rival in its place, is known by the samples alone. One that does not stay with
    the sensor may have moved its parameters: the likeliest was undone, though a rival may be true.
    A cause that is likely, but not certain enough to be named, may have moved them, too.

    remainder: of the fit to samples without the causes.
    """
    result, unsaid = remainder.fit, unsaid_shift(remainder)
    extra = np.outer(unsaid, unsaid)
    for cause in causes:
        extra += rivals_covariance(remainder, cause)
    return widen(sensor, result, extra)


#: Probability that the true cause is none of the alternatives: faults of unknown kinds are named
#: wrongly once in ten times (the study `calibrations --faults unseen`).
OTHER_CHANCE = 0.1


def rivals_covariance(remainder: Remainder, cause: Cause) -> Floats:
    """The covariance (p, p) that the unknown identity and size of a cause add to that of a fit's
    unknowns: the mean over the alternatives, weighted by their probabilities."""
    rest, size = cause.remainder, len(remainder.fit.values)
    undone, extra = rest.shift_of_unknowns(cause.best), np.zeros((size, size))
    extra += OTHER_CHANCE * np.outer(undone, undone)
    scale = (rest.noise / remainder.noise)[:, :, None]
    for part, trace, chance in zip(cause.alternatives, cause.traces, cause.chances, strict=True):
        wider = remainder.extend_by([trace._replace(columns=trace.columns * scale)])
        extra += chance * (wider.covariance[:size, :size] - remainder.covariance)
        if not part.persists:
            used = trace_in_use(rest, trace)
            moved = rest.shift_of_unknowns(used)
            if used is trace or trace is not cause.best:
                moved = moved - undone
            extra += chance * np.outer(moved, moved)
    return extra


def widen(sensor: Sensor, result: Fit, extra: Floats) -> Sensor:
    """The calibrated sensor with a covariance (p, p) of a fit's unknowns added."""
    calibration, names = sensor.calibration, list(result.choice.names)
    assert calibration is not None
    part = np.array(sensor_covariance(names, result.all_values, extra).covariance)
    matrix = np.array(calibration.covariance)
    matrix[: len(part), : len(part)] += part
    return replace_covariance(sensor, calibration.names, matrix)


#: Relative change of the laser's power above which background light may not be proportional to it.
LEAST_CHANGE = 0.05


def add_background_scale(sensor: Sensor, result: Fit, data: Data) -> Sensor:
    """The calibrated sensor whose uncertainty includes that background light may not be
    proportional to the laser's power, as the fit takes it to be."""
    power = relative_power(data, result.own_values, result.all_values)
    change = float(np.abs(power / power.mean() - 1).max())
    if change < LEAST_CHANGE:
        return sensor
    names = result.choice.names
    is_background = [name.startswith("background") and name.endswith("power") for name in names]
    error = result.values * is_background * change
    return widen(sensor, result, np.diag(error**2))


def add_shared_noise(
    sensor: Sensor, remainder: Remainder, scatter: Scatter, robust: float | None
) -> Sensor:
    """The calibrated sensor whose uncertainty includes that errors of different places are
    correlated, which the weights of the fit ignore; directions that this would determine better
    keep their uncertainty."""
    shared = scatter.cross_covariance
    if not shared.matrix.any():
        return sensor
    bare = Remainder(remainder.nominal, remainder.data, remainder.fit, robust)
    pulled = np.swapaxes(bare.weighted, 1, 2) @ bare.likelihood.place_columns(shared.is_absolute)
    both = np.tensordot(pulled @ shared.matrix, pulled, axes=((0, 2), (0, 2)))
    level, ways = np.linalg.eigh(bare.covariance @ both @ bare.covariance)
    size = len(bare.fit.values)
    extra = ((ways * np.maximum(level, 0.0)) @ ways.T)[:size, :size]
    return widen(sensor, bare.fit, extra)


#: The coverage probability of expanded uncertainties.
COVERAGE = 0.95


class Trial(NamedTuple):
    """Errors of solved poses against those of the reference, and their standard uncertainties: (n,
    6)."""

    error: Floats
    uncertainty: Floats

    @property
    def coverage(self) -> Floats:
        """The fraction (6,) of 95 % intervals that contain the error, for each axis."""
        with np.errstate(invalid="ignore"):
            is_inside = np.abs(self.error) <= coverage_factor(COVERAGE) * self.uncertainty
        is_solved = np.isfinite(self.error)
        counts = (is_inside & is_solved).sum(axis=0)
        fraction: Floats = counts / np.maximum(is_solved.sum(axis=0), 1)
        return fraction


def compare_poses(sensor: Sensor, held: Data, values: Floats, result: Fit) -> Trial:
    """Compare poses from held-back readings with the reference's, with the fit's prior of the
    beam.

    values: values of `ALL`, for the mirror's place on the reference.
    """
    still, values = np.zeros((len(held.raw), OWN_COUNT)), fold_mount(values)
    truth = states_of(held, still, values)
    exact = readings(sensor, truth)
    delayed = exact.copy()
    add_skew(delayed, sensor, held, still, values)
    solution: Solution = solve(
        sensor,
        correct(sensor, held.raw) - (delayed - exact),
        beam=Prior(truth[:, 6:], result.choice.beam),
        power="unknown" if result.choice.power else "known",
        threads=0,
    )
    return Trial(
        (solution.state - truth)[:, :6],
        np.hypot(solution.uncertainty[:, :6], np.where(np.isfinite(held.sigma), held.sigma, 0.0)),
    )


def validation_table(nominal: Sensor, result: Fit, held: Data) -> dict[str, NDArray[Any]]:
    """A table of the errors of poses solved from held-back readings, against the reference; um and
    urad.

    before: r.m.s. error with the nominal sensor, without its mean, because the mirror's place on
    the reference is not known then.  after: r.m.s. error with the calibrated sensor.  robust: the
    same from the median of the absolute errors, which a few spikes do not change.  stated: standard
    uncertainty of pose and reference.  inside: percentage of 95 % intervals that contain the
    error.  samples: number of poses.
    """
    measured = np.isfinite(held.sigma)
    start = compare_poses(nominal, held, values_of(nominal), result)
    ended = compare_poses(result.sensor, held, result.all_values, result)
    columns = {
        "before": rms(start.error - np.nanmean(start.error, axis=0)) / OWN_UNITS[:6],
        "after": rms(ended.error) / OWN_UNITS[:6],
        "robust": NORMAL_MEDIAN * np.nanmedian(np.abs(ended.error), axis=0) / OWN_UNITS[:6],
        "stated": rms(ended.uncertainty) / OWN_UNITS[:6],
        "inside": 100 * ended.coverage,
        "samples": np.isfinite(ended.error).sum(axis=0).astype(float),
    }
    names: dict[str, NDArray[Any]] = {
        "axis": np.array(POSE),
        "unit": np.array(["urad" if name in ANGLES else "um" for name in POSE]),
    }
    return names | {name: np.where(measured, column, np.nan) for name, column in columns.items()}


def rms(values: Floats) -> Floats:
    """The root of the mean square of each column; NaN values are ignored."""
    root: Floats = np.sqrt(np.nanmean(values**2, axis=0))
    return root


#: The sources of a fit's uncertainty.
READINGS = "noise of the calibration's readings"
REFERENCE = "reference instrument, as stated"
LASER = "power of the laser, from sample to sample"
BEAM = "position of the beam, from sample to sample"
PRIOR = "values known before the calibration"
#: Sources that the fit does not contain, with their names in the covariance.
UNSEEN = {
    "misfit of the model, of unknown cause": MISFIT,
    "accuracy of the model": MODEL_ERROR,
    "middle of the light": LIGHT_CENTRE,
}
#: The source of what `add_causes`, `add_shared_noise`, `add_background_scale` and `add_open_bends`
#: add.
CAUSES = "what the findings name, or the samples leave open"
#: Fraction of a variance below which a remainder is a rounding error.
LEAST_REST = 1e-9


class Budget(NamedTuple):
    """The covariance of the written parameters by source.

    sensor: (p, p) for each source, in the order of `Sensor.calibration`.  estimated: the sources
    whose size is estimated from the residuals.  freedom: degrees of freedom of that estimate.
    """

    sensor: dict[str, Floats]
    estimated: tuple[str, ...]
    freedom: float

    def effective_freedom(self, variances: dict[str, Floats]) -> Floats:
        """Effective degrees of freedom of sums of variances by source (Welch and Satterthwaite)."""
        total = np.asarray(sum(variances.values()))
        estimated = np.asarray(sum(variances[name] for name in self.estimated))
        return effective_degrees_of_freedom(total, estimated, self.freedom)


@one_thread
def calibration_budget(
    nominal: Sensor, data: Data, result: Fit, made: Sensor, robust: float | None
) -> Budget:
    """The uncertainty budget of a fit that began at `nominal`.

    made: the calibrated sensor with its complete uncertainty.
    """
    assert made.calibration is not None
    parts, names = fitted_parts(Task(nominal, data, result.choice, robust), result)
    factor, sensor = covariance_factor(result), dict[str, Floats]()
    written = np.array(made.calibration.covariance)
    for source, part in parts.items():
        covariance = np.array(sensor_covariance(names, result.all_values, factor * part).covariance)
        further = len(written) - len(covariance)
        sensor[source] = np.pad(covariance, (0, further))
    for source, kinds in UNSEEN.items():
        is_kind = np.array([name in kinds for name in made.calibration.names])
        if is_kind.any():
            sensor[source] = np.where(np.outer(is_kind, is_kind), written, 0.0)
    rest: Floats = written - sum(sensor.values())
    if (np.diag(rest) > LEAST_REST * np.diag(written)).any():
        sensor[CAUSES] = rest
    # The covariance of an earlier calibration was itself estimated from residuals.
    estimated = (READINGS,) if result.choice.joint is None else (READINGS, PRIOR)
    freedom = made.calibration.degrees_of_freedom or result.freedom
    return Budget(sensor, estimated if factor == 1 else tuple(parts), max(freedom, 1.0))


def fitted_parts(task: Task, result: Fit) -> tuple[dict[str, Floats], list[str]]:
    """Covariances (p, p) of the unknowns by source, and the unknowns' names: those of the fit, and
    the laser's mean power where each sample has its own."""
    at = task.guess(result.all_values, result.own_values)
    _, _, normal = task.linearise(at, task.outlier_limit(at))
    names, size = list(result.choice.names), len(result.covariance)
    back, total = normal.back[:, :, :size], result.covariance
    by_common, by_own = np.eye(size), np.zeros((len(back), 1, OWN_COUNT))
    if np.isinf(result.choice.power):
        names.append("beam.power")
        total = add_mean_power(task, at, normal, total)
        unit = OWN_UNITS[6] * at.values[PLACE["beam.power"]]
        by_common = np.vstack([by_common, -unit * back[:, 6].mean(axis=0)])
        by_own = np.zeros((len(back), size + 1, OWN_COUNT))
        by_own[:, -1] = np.linalg.inv(normal.inner)[:, 6] * unit / len(back)
    # The derivatives of the estimates by the prior means of each sample's own unknowns.
    rows = by_own - by_common @ result.covariance @ np.swapaxes(back, 1, 2)
    prior = np.where(task.is_known, 0.0, own_information(task.own_sigma))

    def part_of(unknowns: slice) -> Floats:
        """The part of the covariance (p, p) that these own unknowns cause."""
        some: Floats = np.einsum(
            "npk,k,nqk->pq", rows[:, :, unknowns], prior[unknowns], rows[:, :, unknowns]
        )
        return some

    by_prior = by_common @ result.covariance
    parts = {
        REFERENCE: part_of(slice(0, 6)),
        LASER: part_of(slice(6, 7)),
        BEAM: part_of(slice(7, 9)),
        PRIOR: by_prior @ task.prior @ by_prior.T,
    }
    parts = {source: part for source, part in parts.items() if part.any()}
    return {READINGS: total - sum(parts.values()), **parts}, names


def pose_covariances(
    sensor: Sensor, budget: Budget, states: Floats, knowledge: Knowledge
) -> dict[str, Floats]:
    """Covariances (n, 6, 6) of the poses at states (n, 8), for each source of the calibration's
    uncertainty; mm and rad."""
    propagated = propagate_in_light(
        sensor, states, make_plan(sensor, knowledge, shape=states.shape[:1])
    )
    assert propagated.slopes is not None
    slopes = propagated.slopes[:, :6]
    return {source: carry(slopes, part) for source, part in budget.sensor.items()}


def fitted_states(data: Data, result: Fit) -> Floats:
    """The states (n, 8) of the samples of a fit."""
    return states_of(data, result.own_values, result.all_values)
