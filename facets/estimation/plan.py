"""The plan of an estimate, made once for a sensor: unknowns, priors, starts, limits of residuals.

The numbers of a reading and the priors in excess of the unknowns check the pose. The squared
residual of a right model follows the chi-square distribution with so many degrees of freedom; noise
alone leaves more than the limit with a chance of `FALSE_ALARM_RATE`.
"""

from __future__ import annotations

from math import hypot
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.arguments import as_floats
from ..core.errors import InputError
from ..core.knowledge import Knowledge, Prior, Question
from ..core.sensor import Psd, Sensor
from ..core.units import Floats
from ..detectors.calibrated import MISFIT, MODEL_ERROR
from ..detectors.noise import least_light, other_light, power_floor, standard_deviations
from ..model.arrays import as_vectors, readings, spot_size
from . import problem

#: The chance that the residual of a right pose is beyond its limit.
FALSE_ALARM_RATE = 1e-4
#: The residuals, in standard deviations, that noise exceeds at FALSE_ALARM_RATE with 0 to 9
#: degrees of freedom. Numbers, because the library that has the distribution loads slowly.
LIMITS = np.array([
    np.inf, 3.8905918864130937, 4.291932052578694, 4.594291399787372, 4.848993962152442,
    5.073936534787943, 5.277910688521919, 5.466031824754125, 5.641598000678736, 5.806888016740519,
])  # fmt: skip


def count_checks(detectors: int, free: NDArray[np.int64], weights: Floats) -> int:
    """The number of readings of the detectors and priors in excess of the unknowns.

    free: numbers of the unknowns.  weights: (3,) of the priors of bx, by and the power.
    """
    priors = sum(bool(weights[c - 6] > 0) for c in free.tolist() if c >= 6)
    return 3 * detectors + priors - len(free)


class Chance(NamedTuple):
    """The limits of residuals for one request.

    none: `count_checks` without a detector.  widening: see `widening_of`.
    """

    none: int
    widening: float

    def checks(self, used: NDArray[np.bool_]) -> NDArray[np.int8]:
        """The number of redundant readings of each pose (...), from the detectors used (..., 3)."""
        if used.all():  # counting takes longer than a step of the estimate
            return np.full(used.shape[:-1], max(9 + self.none, 0), np.int8)
        count = np.maximum(3 * np.count_nonzero(used, axis=-1) + self.none, 0)
        return np.asarray(count, np.int8)

    def limits(self, checks: NDArray[np.int8]) -> Floats:
        """The residuals (...) that noise alone hardly exceeds; infinite without redundancy."""
        return np.asarray(self.widening * LIMITS.take(checks))

    @property
    def limit(self) -> float:
        """The limit of a pose from all three detectors."""
        return float(self.widening * LIMITS[max(9 + self.none, 0)])


def widening_of(sensor: Sensor) -> float:
    """The factor by which a calibrated sensor's residuals exceed the noise."""
    known = sensor.calibration
    if known is None or not any(name in (*MISFIT, *MODEL_ERROR) for name in known.names):
        return 1.0
    kept: float | None = sensor.__dict__.get("_widening")
    if kept is None:
        kept = sensor.__dict__["_widening"] = measure_widening(sensor)
    return kept


#: A state at rest, in a batch of one: all batches have the same code, single states another.
REST = np.zeros((1, 8))


def measure_widening(sensor: Sensor) -> float:
    assert sensor.calibration is not None
    (noise,), known = standard_deviations(sensor, readings(sensor, REST)), sensor.calibration
    missed = {name: known.covariance[n][n] for n, name in enumerate(known.names)}
    over = [
        sum(missed.get(name, 0.0) for name in names) / s**2
        for *names, s in zip(MISFIT, MODEL_ERROR, noise, strict=True)
    ]
    return float(np.sqrt(1 + np.nanmax(over)))


class Plan(NamedTuple):
    """The unknowns and priors of an estimate, in the form of `problem.FitProblem` and
    `ScreeningLimits`.

    means: (1 or n, 3) of bx, by and the power.  weights: (3,).  free: numbers of the unknowns.
    least_redundancy: below which nothing checks a pose; below 0 where a prior is mostly the laser's
    own jitter, which differs from sample to sample and so checks a pose as the noise of a reading.
    """

    means: Floats
    weights: Floats
    free: NDArray[np.int64]
    limits: problem.ScreeningLimits
    least_redundancy: float


def prior_means(place: Prior, light: Prior, shape: tuple[int, ...]) -> Floats:
    """The prior means of bx, by and the power: (1, 3), or (n, 3) if they differ by reading."""
    where, amount = as_floats(place.mean, "mean"), as_floats(light.mean, "mean")
    shape = shape if where.shape[:-1] or amount.shape else ()
    try:
        means = np.empty((*shape, 3))
        means[..., :2], means[..., 2] = where, amount
    except ValueError as error:
        raise InputError(f"a prior does not fit readings of shape {shape}: {error}") from None
    return means.reshape(-1, 3)


def find_limits(sensor: Sensor, eight: bool) -> problem.ScreeningLimits:
    """The screening limits of a sensor's readings, cached because a live loop needs them often."""
    kept: dict[bool, problem.ScreeningLimits] = sensor.__dict__.setdefault("_limits", {})
    if eight not in kept:
        kept[eight] = make_limits(sensor, eight)
    return kept[eight]


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
    """The lowest and the highest psi and zeta that count, mm.  cut: of `edge_cut_width`."""
    y, z = psd.size_y / 2 - cut, psd.size_z / 2 - cut
    low_y, high_y, low_z, high_z = psd.usable
    return (max(-y, low_y), min(y, high_y), max(-z, low_z), min(z, high_z))


def edge_cut_width(sensor: Sensor) -> float:
    """Distance to an edge within which the edge cuts the spot, mm.

    The centroid of a cut spot hardly moves with the spot.
    """
    return spot_size(sensor) / 2 if sensor.apertures.detectors else 0.0


def make_plan(
    sensor: Sensor, knowledge: Knowledge, method: str = "least-squares", shape: tuple[int, ...] = ()
) -> Plan:
    """shape: of the readings, for priors with a mean for each of them."""
    paper = method == "paper"
    if paper and knowledge != Knowledge():
        raise InputError('method="paper" has the beam "free" and the power "known"')
    place, light = knowledge.beam_prior, knowledge.power_prior(sensor.beam.power)
    sigmas = np.empty(3)
    try:
        sigmas[:2], sigmas[2] = as_floats(place.sigma, "sigma"), as_floats(light.sigma, "sigma")
    except ValueError:
        raise InputError(
            "a prior has too many sigmas; allowed: one number, or two for the beam's place"
        ) from None
    free = np.concatenate([np.arange(6), 6 + np.flatnonzero(sigmas > 0)])
    with np.errstate(divide="ignore"):
        weights = np.where(sigmas > 0, 1 / sigmas, 0.0)
    least = -1.0 if (jitter_share(sensor, weights**2) > 0.5).any() else problem.MIN_REDUNDANCY
    return Plan(prior_means(place, light, shape), weights, free, find_limits(sensor, paper), least)


def jitter_share(sensor: Sensor, before: Floats) -> Floats:
    """The share (3,) of the priors' variances that the laser's pointing jitter and power noise are.

    before: (3,) one over these variances of bx, by and the power, 0 where there is no prior. These
    errors of a prior differ from sample to sample; the rest of it is the same in all.
    """
    variances = np.zeros(3)
    if sensor.electronics is not None:
        variances[:2] = sensor.electronics.pointing**2
        variances[2] = (sensor.electronics.power_noise * sensor.beam.power) ** 2
    return np.minimum(variances * before, 1.0)


def chance_of(sensor: Sensor, todo: Plan) -> Chance:
    """The limits of residuals for the poses of a plan."""
    none = count_checks(0, todo.free, todo.weights) - todo.limits.eight
    return Chance(none, widening_of(sensor))


#: The most plans that are kept with a sensor.
MAX_PLANS = 16


def find_plan(sensor: Sensor, knowledge: Knowledge, method: str, shape: tuple[int, ...]) -> Plan:
    """`make_plan` with a cache, for live loops."""
    if not (is_plain(knowledge.beam, 2) and is_plain(knowledge.power, 1)):
        return make_plan(sensor, knowledge, method, shape)
    plans: dict[tuple[Knowledge, str], Plan] = sensor.__dict__.setdefault("_plans", {})
    plan = plans.get((knowledge, method))
    if plan is None:
        if len(plans) >= MAX_PLANS:
            plans.clear()
        plan = plans[knowledge, method] = make_plan(sensor, knowledge, method)
    return plan


def is_plain(known: object, count: int) -> bool:
    """Whether knowledge is a word, or a prior of plain numbers with `count` means in a tuple."""
    if not isinstance(known, Prior):
        return True
    means = known.mean if isinstance(known.mean, tuple) and count > 1 else (known.mean,)
    plain = all(isinstance(number, float) for number in (*means, known.sigma))
    return plain and len(means) == count


def start_states(
    sensor: Sensor, start: str | ArrayLike, todo: Plan, values: Floats, shape: tuple[int, ...]
) -> Floats:
    """The starts of the estimates: (1 or n, 9), with the prior means.

    An unknown power starts from the measured light. A given state at which diffraction leaves the
    model without a reading, so that no step leads away from it, is replaced by zero.
    """
    unknown_power = todo.weights[2] == 0 and todo.free[-1] == 8
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
            here = starts[:, :8]
            blind = np.isfinite(here).all(axis=1) & np.isnan(readings(sensor, here)).any(axis=1)
            starts[blind, :8] = 0.0
            starts[blind, :2] = todo.means[blind if len(todo.means) > 1 else 0, :2]
        starts[:, 8] = todo.means[:, 2]
        if len(todo.free) < 8 or todo.free[7] != 7 or todo.free[6] != 6:
            starts[:, 6:8] = todo.means[:, :2]
    elif start in ("zero", "previous"):
        starts = np.zeros((len(values) if unknown_power else len(todo.means), 9))
        starts[:, 6:] = todo.means
        starts[:, :2] = todo.means[:, :2]  # there is light to read only near the beam
    else:
        raise InputError(f'start is {start!r}; allowed: "zero", "previous" or states (..., 8)')
    if unknown_power:
        with np.errstate(over="ignore", invalid="ignore"):  # a spoilt reading can be anything
            seen = np.nansum(values[:, 2::3], axis=1)
        starts[:, 8] = np.where(np.isfinite(seen) & (seen > 0), seen, starts[:, 8])
    return starts


def is_previous(start: object) -> bool:
    """Whether each sample starts where the last converged one ended."""
    return isinstance(start, str) and start == "previous"


def make_problem(
    plan: Plan, starts: Floats, question: Question, previous: bool = False
) -> problem.FitProblem:
    """A plan as compiled code takes it.

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
    """The readings' standard deviations as `problem.Readings` has them."""
    return np.empty((0, 9)) if sensor.electronics is None else standard_deviations(sensor, values)
