"""The plan of an estimate, made once for a sensor: unknowns, priors, starts, limits of residuals.

The degrees of freedom are the count of a reading's numbers and of priors minus the count of
unknowns. If the model is right, the squared residual follows the chi-square distribution with these
degrees of freedom, and noise exceeds the limit with the probability `FALSE_ALARM_RATE`.
"""

from __future__ import annotations

from math import hypot
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.arguments import as_floats
from ..core.errors import InputError
from ..core.knowledge import Knowledge, Prior, Question
from ..core.sensor import Calibration, Psd, Sensor
from ..core.units import Floats
from ..detectors.calibrated import MISFIT, MODEL_ERROR
from ..detectors.noise import least_light, other_light, power_floor, standard_deviations
from ..model.arrays import as_vectors, readings, spot_size
from . import problem

#: Probability that the residual of a correct pose exceeds its limit.
FALSE_ALARM_RATE = 1e-4
#: The residuals, in standard deviations, that noise exceeds with FALSE_ALARM_RATE, for 0 to 9
#: degrees of freedom. They are written out because importing the chi-square distribution is slow.
LIMITS = np.array([
    np.inf, 3.8905918864130937, 4.291932052578694, 4.594291399787372, 4.848993962152442,
    5.073936534787943, 5.277910688521919, 5.466031824754125, 5.641598000678736, 5.806888016740519,
])  # fmt: skip


def count_checks(detectors: int, free: NDArray[np.int64], weights: Floats) -> int:
    """Count of readings and priors minus the count of unknowns.

    detectors: number of detectors used.  free: indices of the unknowns.  weights: (3,) of the
    priors of bx, by and the power.
    """
    priors = sum(bool(weights[c - 6] > 0) for c in free.tolist() if c >= 6)
    return 3 * detectors + priors - len(free)


class Chance(NamedTuple):
    """The limits of the residuals for one plan.

    none: `count_checks` without a detector.  widening: see `widening_of`.
    """

    none: int
    widening: float

    def checks(self, used: NDArray[np.bool_]) -> NDArray[np.int8]:
        """The degrees of freedom of each pose (...), from the detectors used (..., 3)."""
        if used.all():  # A shortcut, because counting takes longer than a step of the estimate.
            return np.full(used.shape[:-1], max(9 + self.none, 0), np.int8)
        count = np.maximum(3 * np.count_nonzero(used, axis=-1) + self.none, 0)
        return np.asarray(count, np.int8)

    def limits(self, checks: NDArray[np.int8]) -> Floats:
        """The limits of the residuals (...) of poses with `checks`; infinite for none."""
        return np.asarray(self.widening * LIMITS.take(checks))

    @property
    def limit(self) -> float:
        """The limit of the residual of a pose from all three detectors."""
        return float(self.widening * LIMITS[max(9 + self.none, 0)])


def widening_of(sensor: Sensor) -> float:
    """Factor by which model errors raise a calibrated sensor's residuals above the noise; 1 without
    such errors. Cached per sensor."""
    calibration = sensor.calibration
    errors = (*MISFIT, *MODEL_ERROR)
    if calibration is None or not any(name in errors for name in calibration.names):
        return 1.0
    widening: float | None = sensor.__dict__.get("_widening")
    if widening is None:
        widening = sensor.__dict__["_widening"] = measure_widening(sensor, calibration)
    return widening


#: The zero state as a batch of one row, because single states use other code with other rounding.
REST = np.zeros((1, 8))


def measure_widening(sensor: Sensor, calibration: Calibration) -> float:
    """Compute `widening_of` at the zero state: the largest factor of the nine readings."""
    (noise,) = standard_deviations(sensor, readings(sensor, REST))
    variances = {name: calibration.covariance[n][n] for n, name in enumerate(calibration.names)}
    ratios = [
        sum(variances.get(name, 0.0) for name in names) / s**2
        for *names, s in zip(MISFIT, MODEL_ERROR, noise, strict=True)
    ]
    return float(np.sqrt(1 + np.nanmax(ratios)))


class Plan(NamedTuple):
    """The unknowns and the priors of an estimate.

    means: (1 or n, 3) prior means of bx, by, mm, and the power, mW.  weights: (3,) 1/sigma of the
    priors, 0 if unknown or known exactly.  free: indices of the unknowns.  limits: limits for
    screening readings.  least_redundancy: poses with less redundancy are unchecked. It is negative,
    for no limit, if a prior's uncertainty is mostly the laser's jitter, because jitter differs
    between samples like the noise of a reading.
    """

    means: Floats
    weights: Floats
    free: NDArray[np.int64]
    limits: problem.ScreeningLimits
    least_redundancy: float


def prior_means(place: Prior, light: Prior, shape: tuple[int, ...]) -> Floats:
    """Prior means of bx, by, mm, and the power, mW: (1, 3), or (n, 3) if they differ by reading.

    Raises `InputError` if a prior's means do not fit the readings' leading shape.
    """
    position, power = as_floats(place.mean, "mean"), as_floats(light.mean, "mean")
    shape = shape if position.shape[:-1] or power.shape else ()
    try:
        means = np.empty((*shape, 3))
        means[..., :2], means[..., 2] = position, power
    except ValueError as error:
        raise InputError(f"a prior does not fit readings of shape {shape}: {error}") from None
    return means.reshape(-1, 3)


def find_limits(sensor: Sensor, eight: bool) -> problem.ScreeningLimits:
    """The screening limits of a sensor's readings, cached because a live loop needs them often."""
    limits: dict[bool, problem.ScreeningLimits] = sensor.__dict__.setdefault("_limits", {})
    if eight not in limits:
        limits[eight] = make_limits(sensor, eight)
    return limits[eight]


def make_limits(sensor: Sensor, eight: bool) -> problem.ScreeningLimits:
    floor = power_floor(sensor)
    light = np.stack([least_light(sensor), other_light(sensor) + problem.DARK_SIGMAS * floor])
    noise, cut = sensor.noise, edge_cut_width(sensor)
    distance = max(hypot(psd.radius, psd.height) for psd in sensor.psds)
    return problem.ScreeningLimits(
        noise=np.array((noise.position, noise.at_power, floor)),
        light=light,
        usable=np.array([usable_area(psd, cut) for psd in sensor.psds]),
        eight=eight,
        rounding=problem.ROUNDING * np.array((distance, sensor.beam.power)),
    )


def usable_area(psd: Psd, cut: float) -> tuple[float, ...]:
    """Lowest and highest psi and zeta at which readings are used, mm.  cut: `edge_cut_width`."""
    y, z = psd.size_y / 2 - cut, psd.size_z / 2 - cut
    low_y, high_y, low_z, high_z = psd.usable
    return (max(-y, low_y), min(y, high_y), max(-z, low_z), min(z, high_z))


def edge_cut_width(sensor: Sensor) -> float:
    """Distance from an edge within which it cuts the spot, mm; 0 if edges do not cut light."""
    return spot_size(sensor) / 2 if sensor.apertures.detectors else 0.0


def make_plan(
    sensor: Sensor, knowledge: Knowledge, method: str = "least-squares", shape: tuple[int, ...] = ()
) -> Plan:
    """Make the plan of an estimate.

    shape: leading shape of the readings, for priors with a mean for each reading. Raises
    `InputError` for priors of a wrong shape, and for priors with the paper's method.
    """
    paper = method == "paper"
    if paper and knowledge != Knowledge():
        raise InputError('method="paper" has the beam "free" and the power "known"')
    place, light = knowledge.beam_prior, knowledge.power_prior(sensor.beam.power)
    sigmas = np.empty(3)
    try:
        sigmas[:2], sigmas[2] = as_floats(place.sigma, "sigma"), as_floats(light.sigma, "sigma")
    except ValueError:
        raise InputError(
            "a prior has too many sigmas; allowed: one number, or two for the beam's position"
        ) from None
    free = np.concatenate([np.arange(6), 6 + np.flatnonzero(sigmas > 0)])
    with np.errstate(divide="ignore"):
        weights = np.where(sigmas > 0, 1 / sigmas, 0.0)
    is_jitter = (jitter_fraction(sensor, weights**2) > 0.5).any()
    required = -1.0 if is_jitter else problem.MIN_REDUNDANCY
    means = prior_means(place, light, shape)
    return Plan(means, weights, free, find_limits(sensor, paper), required)


def jitter_fraction(sensor: Sensor, information: Floats) -> Floats:
    """The fractions (3,) of the priors' variances due to pointing jitter and power noise.

    information: (3,) 1/variance of the priors of bx, by and the power, 0 without a prior. Jitter
    differs from sample to sample; the remaining error of a prior is the same in all samples.
    """
    variances = np.zeros(3)
    if sensor.electronics is not None:
        variances[:2] = sensor.electronics.pointing**2
        variances[2] = (sensor.electronics.power_noise * sensor.beam.power) ** 2
    return np.minimum(variances * information, 1.0)


def chance_of(sensor: Sensor, plan: Plan) -> Chance:
    """Limits of the residuals for the poses of a plan."""
    none = count_checks(0, plan.free, plan.weights) - plan.limits.eight
    return Chance(none, widening_of(sensor))


#: Largest number of plans that are cached with a sensor.
MAX_PLANS = 16


def find_plan(sensor: Sensor, knowledge: Knowledge, method: str, shape: tuple[int, ...]) -> Plan:
    """Return `make_plan`, from a cache where the priors are plain numbers, for live loops."""
    if not (is_plain(knowledge.beam, 2) and is_plain(knowledge.power, 1)):
        return make_plan(sensor, knowledge, method, shape)
    plans: dict[tuple[Knowledge, str], Plan] = sensor.__dict__.setdefault("_plans", {})
    plan = plans.get((knowledge, method))
    if plan is None:
        if len(plans) >= MAX_PLANS:
            plans.clear()
        plan = plans[knowledge, method] = make_plan(sensor, knowledge, method)
    return plan


def is_plain(knowledge: object, count: int) -> bool:
    """Whether knowledge is a word, or a prior of plain numbers with `count` means in a tuple."""
    if not isinstance(knowledge, Prior):
        return True
    mean = knowledge.mean
    means = mean if isinstance(mean, tuple) and count > 1 else (mean,)
    plain = all(isinstance(number, float) for number in (*means, knowledge.sigma))
    return plain and len(means) == count


def start_states(
    sensor: Sensor, start: str | ArrayLike, plan: Plan, values: Floats, shape: tuple[int, ...]
) -> Floats:
    """The states (1 or n, 9) from which the estimates start, with the power.

    start: argument of `facets.solve`.  values: (n, 9) readings.  shape: their leading shape. An
    unknown power starts from the measured light. A state where diffraction leaves the model without
    a reading is replaced by zero, because no step leads away from it. Raises `InputError` for
    another `start`.
    """
    unknown_power = plan.weights[2] == 0 and plan.free[-1] == 8
    if not isinstance(start, str):
        states = as_vectors(start, 8, "start")
        if states.shape != (*shape, 8):
            try:
                states = np.broadcast_to(states, (*shape, 8))
            except ValueError as error:
                raise InputError(f"start does not fit the readings: {error}") from None
        starts = np.empty((len(values), 9))
        starts[:, :8] = states.reshape(-1, 8)
        if sensor.light.wavelength > 0:
            states = starts[:, :8]
            has_nan = np.isnan(readings(sensor, states)).any(axis=1)
            is_unlit = np.isfinite(states).all(axis=1) & has_nan
            starts[is_unlit, :8] = 0.0
            starts[is_unlit, :2] = plan.means[is_unlit if len(plan.means) > 1 else 0, :2]
        starts[:, 8] = plan.means[:, 2]
        if len(plan.free) < 8 or plan.free[7] != 7 or plan.free[6] != 6:
            starts[:, 6:8] = plan.means[:, :2]
    elif start in ("zero", "previous"):
        starts = np.zeros((len(values) if unknown_power else len(plan.means), 9))
        starts[:, 6:] = plan.means
        starts[:, :2] = plan.means[:, :2]  # The detectors have light only near the beam.
    else:
        raise InputError(f'start is {start!r}; allowed: "zero", "previous" or states (..., 8)')
    if unknown_power:
        with np.errstate(over="ignore", invalid="ignore"):  # Corrupted readings can be any number.
            total = np.nansum(values[:, 2::3], axis=1)
        starts[:, 8] = np.where(np.isfinite(total) & (total > 0), total, starts[:, 8])
    return starts


def is_previous(start: object) -> bool:
    """Whether each sample starts from the solution of the last converged one."""
    return isinstance(start, str) and start == "previous"


def make_problem(
    plan: Plan, starts: Floats, question: Question, previous: bool = False
) -> problem.FitProblem:
    """Make the input of compiled code from a plan.

    starts: from `start_states`.  previous: see `is_previous`.
    """
    if question.max_steps < 1:
        raise InputError(f"max_steps is {question.max_steps}; allowed: 1 or more")
    is_paper = question.method == "paper"
    accepts = question.accept_unchecked or is_paper
    return problem.FitProblem(
        means=plan.means,
        weight=plan.weights,
        free=plan.free,
        starts=starts,
        previous=previous,
        max_steps=question.max_steps,
        damped=not is_paper,
        accept_unchecked=accepts,
        limits=plan.limits,
        least_redundancy=-1.0 if accepts else plan.least_redundancy,
    )


def sigmas_of(sensor: Sensor, values: Floats) -> Floats:
    """The standard deviations of readings (n, 9), in the form of `problem.Readings`."""
    return np.empty((0, 9)) if sensor.electronics is None else standard_deviations(sensor, values)
