"""Fit the sensor's parameters to readings of a motion of which a reference measures all or some
axes.

The reference defines the frames: its axes at zero are the world's axes, whose origin lies on the
beam at the apex's height at that time, and the axes that it moves are the mirror's. Thus every
parameter can be determined in principle; `motions` lists parameters that a motion leaves open.

The most probable values minimise

    chi^2 = sum ((reading - model) / sigma)^2 + sum ((unknown - before) / sigma_before)^2

over the common unknowns and each sample's own (Levenberg-Marquardt on the normal equations from
which the latter are eliminated). The fit has settled when another step would lower chi-square by
less than `StoppingRule.fall`: every value is then within 0.03 standard uncertainties of the
optimum. With a limit on the size of steps instead, the fit would follow the weakest direction
forever.

Shapes and units are as in `bundle_adjustment`; matrices (p, p) and vectors (p,) belong to the p
unknowns of the fit's choice, in their order.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ...core.errors import InputError
from ...core.names import DETECTORS
from ...core.sensor import Calibration, Sensor, Thermal
from ...core.small_matrices import one_thread
from ...core.units import Floats
from ...detectors.calibrated import TEMPERATURE
from ...detectors.correction import correct
from ...estimation.solver import solve
from .bundle_adjustment import (
    OWN_COUNT,
    OWN_UNITS,
    Data,
    Linear,
    Normal,
    deviations,
    eliminate_own_unknowns,
    linearise_model,
    own_sigma,
    residuals,
)
from .unknowns import (
    ALL,
    APEX,
    MOUNT,
    OF_SENSOR,
    PLACE,
    Choice,
    assign_values,
    block,
    fold_derivatives,
    fold_mount,
    values_of,
)

#: Damping beyond which no step lowers chi-square.
MAX_DAMPING = 1e10
#: Ratio of residuals (r.m.s.) to noise above which the model does not describe the samples.
MISFIT_SIGMAS = 1.3
#: Lower bounds of unknowns that cannot be negative, mm; a roll-off without a width has no
#: derivative.
LOWER_BOUNDS_MM = {"rolloff.width": 1e-3, "light.wavelength": 0.0}
#: The names of the detectors' gains.
GAINS = tuple(f"correction_{letter}.power" for letter in DETECTORS)
#: Ratio of the standard deviation to the median of absolute values, of a normal distribution.
NORMAL_MEDIAN = 1.4826


class StoppingRule(NamedTuple):
    """The end of a fit: after a number of steps, or when another step would lower chi-square by
    less than `fall`."""

    steps: int = 60
    fall: float = 1e-3


#: The rule of a fit that settles.
SETTLED = StoppingRule()


@dataclass(frozen=True)
class Fit:
    """The result of a fit.

    sensor: the calibrated sensor.  choice: the unknowns.  values: (p,) values of the unknowns, in
    mm, rad, mW and fractions.  covariance: (p, p) of these values, from the noise of readings and
    reference alone.  all_values: the fitted values of all names in `ALL`.  own_values: (n, 9) the
    values of each sample's own unknowns: its pose relative to the reference's, the relative change
    of the laser's power, the beam's position.  residuals: (n, 9) in standard deviations of the
    readings.  weights: (n, 9) of the readings, below 1 for outliers.  redundancy: (n, 9) variance
    of each residual over its reading's variance, from 0 (unchecked) to 1 (fully checked by other
    readings).  loss: the minimised sum.  chi_square, freedom: chi-square and degrees of freedom of
    the readings without outliers.  limit: residual, in standard deviations, beyond which a reading
    is an outlier.  steps: number of steps.  ended: whether the fit settled.  cause: why it did not
    settle, else empty.
    """

    sensor: Sensor
    choice: Choice
    values: Floats
    covariance: Floats
    all_values: Floats
    own_values: Floats
    residuals: Floats
    weights: Floats
    redundancy: Floats
    loss: float
    chi_square: float
    freedom: float
    limit: float
    steps: int
    ended: bool
    cause: str

    @property
    def uncertainty(self) -> Floats:
        """The standard uncertainties (p,) of the unknowns, from `covariance`."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def apex(self) -> Floats:
        """Position (3,) of the apex relative to the beam while the reference is at zero, mm."""
        return self.all_values[block(APEX)]

    @property
    def reduced_chi_square(self) -> float:
        """Chi-square per degree of freedom; its expectation is 1 if model and noise are right."""
        return self.chi_square / max(self.freedom, 1.0)

    @property
    def excess(self) -> float:
        """Excess of `reduced_chi_square` over 1 and four of its standard deviations, or 0."""
        four_sigmas = 4 * float(np.sqrt(2 / max(self.freedom, 1.0)))
        return max(0.0, self.reduced_chi_square - 1 - four_sigmas)


def solve_open_axes(data: Data, sensor: Sensor) -> Floats:
    """Initial guess (n, 9) of the samples' own unknowns.

    Axes that the reference does not measure are solved with the nominal sensor; others are zero.
    """
    own_values = np.zeros((len(data.pose), OWN_COUNT))
    free = np.isinf(data.sigma)
    if free.any():
        solution = solve(sensor, correct(sensor, data.raw), beam="free", covariance=False)
        solved = solution.converged[:, None] & free
        own_values[:, :6] = np.where(solved, solution.state[:, :6] - data.pose, 0.0)
    return own_values


@dataclass(frozen=True)
class Guess:
    """Values during a fit, and the sensor that they make.

    values: of `ALL`.  own_values: (n, 9) of the samples' own unknowns.  residual: (n, 9) in
    standard deviations of the readings.
    """

    sensor: Sensor
    values: Floats
    own_values: Floats
    residual: Floats

    @property
    def mean_power_values(self) -> Floats:
        """The values (ALL,), with the samples' mean power as the laser's power."""
        values = self.values.copy()
        values[PLACE["beam.power"]] *= 1 + float(self.own_values[:, 6].mean())
        return values


class Task:
    """The samples, the unknowns and the prior of a fit."""

    def __init__(self, sensor: Sensor, data: Data, choice: Choice, robust: float | None) -> None:
        if len(data.raw) < 2 or not len(choice.names):
            raise InputError("a calibration needs two samples and one parameter, at least")
        # If the noise followed the gains, the fit would enlarge it to lower chi-square.
        self.data = data._replace(noise=deviations(sensor, data))
        self.nominal, self.choice, self.robust = sensor, choice, robust
        self.start = values_of(sensor)
        self.prior = prior_information(choice)
        self.bounds = np.array([LOWER_BOUNDS_MM.get(name, -np.inf) for name in choice.names])
        self.own_sigma = own_sigma(data, choice)
        self.is_known = self.own_sigma == 0

    def guess(self, values: Floats, own_values: Floats) -> Guess:
        """Evaluate the residuals at some values; raise `InputError` if the values define no
        possible sensor, or a laser without power."""
        sensor = assign_values(self.nominal, values)
        own_values = np.where(self.is_known, 0.0, own_values)
        if (own_values[:, 6] <= -0.9).any():
            raise InputError("a laser of no power")
        return Guess(sensor, values, own_values, residuals(sensor, self.data, own_values, values))

    def outlier_limit(self, at: Guess) -> float:
        """Residual, in standard deviations, beyond which a reading has less weight; larger if most
        residuals exceed the noise."""
        if self.robust is None:
            return np.inf
        sizes = np.abs(at.residual[np.isfinite(self.data.raw)])
        middle = float(np.median(sizes)) if sizes.size else 0.0
        return self.robust * max(1.0, NORMAL_MEDIAN * middle)

    def cost(self, at: Guess, limit: float) -> float:
        """Huber's loss of the residuals plus the squared deviations from the prior."""
        size = np.abs(at.residual)
        loss = size**2
        if np.isfinite(limit):
            loss = np.where(size > limit, 2 * limit * size - limit**2, loss)
        has_prior = np.isfinite(self.own_sigma) & ~self.is_known
        own_offset = at.own_values[:, has_prior] / self.own_sigma[has_prior]
        offset = (at.values - self.start)[self.choice.places]
        return float(loss.sum() + (own_offset**2).sum() + offset @ self.prior @ offset)

    def linearise(self, at: Guess, limit: float) -> tuple[Linear, Floats, Normal]:
        """The linearised model, the square roots (n, 9) of the readings' weights, and the normal
        equations. limit: see `huber_roots`."""
        model = linearise_model(at.sensor, self.data, at.own_values, at.values, self.choice)
        weights = huber_roots(model.residual, limit)
        return model, weights, eliminate_own_unknowns(model, weights, at.own_values, self.own_sigma)


class Descent(Task):
    """The steps of a fit from a guess to its end."""

    def add_prior(self, at: Guess, normal: Normal) -> tuple[Floats, Floats]:
        """The matrix (p, p) and the right side (p,) of the normal equations with the prior."""
        side = normal.side - self.prior @ (at.values - self.start)[self.choice.places]
        return normal.matrix + self.prior, side

    def take_step(self, at: Guess, normal: Normal, step: Floats) -> Guess | None:
        """The guess after a step (p,), limited by the lower bounds; None if no sensor is possible
        there."""
        values, places = at.values.copy(), self.choice.places
        is_beyond = values[places] + step < self.bounds
        if is_beyond.any():
            step = np.where(is_beyond, self.bounds - values[places], step)
        values[places] = np.where(is_beyond, self.bounds, values[places] + step)
        own_step = normal.back[:, :, -1] - normal.back[:, :, :-1] @ step
        with suppress(InputError):
            return self.guess(values, at.own_values + own_step * OWN_UNITS)
        return None

    def hold_at_bounds(self, at: Guess, matrix: Floats, side: Floats) -> tuple[Floats, Floats]:
        """The normal equations (p, p) and (p,) in which unknowns that would leave their bounds are
        held."""
        held = (at.values[self.choice.places] <= self.bounds) & (side < 0)
        if not held.any():
            return matrix, side
        free = ~held
        return np.where(free[:, None] & free, matrix, np.diag(np.diag(matrix))), side * free

    def settle(self, at: Guess, rule: StoppingRule) -> tuple[Guess, int, str]:
        """Take steps until another gains nothing.

        Return the last guess, the number of steps, and the cause if the fit did not settle, else an
        empty string. Damping is in units of the prior uncertainties: it keeps weak directions,
        along which the model is non-linear, within their tolerances, and hardly changes strong
        ones.
        """
        damping, growth = 0.0, 10.0
        scale = np.diag(1 / self.choice.sigma**2)
        for steps in range(1, rule.steps + 1):
            limit = self.outlier_limit(at)
            _, _, normal = self.linearise(at, limit)
            matrix, side = self.hold_at_bounds(at, *self.add_prior(at, normal))
            worth = float(side @ np.linalg.solve(matrix, side))
            if worth < rule.fall and normal.fall < rule.fall * len(self.data.raw):
                return at, steps - 1, ""
            level, better = self.cost(at, limit), None
            while damping < MAX_DAMPING:
                heavy = matrix + damping * scale
                step: Floats = np.linalg.solve(heavy, side).astype(float)
                tried = self.take_step(at, normal, step)
                if tried is not None and (now := self.cost(tried, limit)) < level:
                    better = tried
                    break
                damping, growth = max(damping * growth, 0.1), growth * 2
            if better is None:  # also if the gain is below rounding
                return (
                    at,
                    steps,
                    "" if worth < 1e-6 * level + 0.1 else self.describe_deadlock(worth),
                )
            damping, growth = damping / 10 if damping > 0.1 else 0.0, 10.0
            at, fell = better, level - now
            if fell < 1e-9 * level + rule.fall and worth < 10 * rule.fall:
                return at, steps, ""
        return at, rule.steps, self.describe_remaining_moves(at, matrix, side, worth)

    def describe_deadlock(self, worth: float) -> str:
        """Describe why a fit ended without a step that lowers chi-square.  worth: the predicted
        decrease."""
        return (
            f"no step from here lowers chi-square, though {worth:.3g} could be gained: the model "
            "does not describe these readings; look for a wrong sign, unit, order of detectors or "
            "configuration"
        )

    def describe_remaining_moves(
        self, at: Guess, matrix: Floats, side: Floats, worth: float
    ) -> str:
        """Describe the unknowns along which the fit still moves, and the remedy.

        If most of the gain belongs to the prior and the residuals are noise, the samples determine
        these unknowns too weakly. If the residuals exceed the noise, the fit also moves along such
        unknowns, but their cause is another one: holding these unknowns would not help.
        """
        size = float(np.sqrt(np.mean(at.residual[np.isfinite(self.data.raw)] ** 2)))
        step = np.linalg.solve(matrix, side)
        large = np.argsort(-np.abs(step) / self.choice.sigma)[:3]
        names = ", ".join(self.choice.names[n] for n in large)
        by_prior, total = step @ self.prior @ step, step @ matrix @ step
        if by_prior > total / 2 and size < MISFIT_SIGMAS:
            remedy = (
                "the samples hardly determine these; take samples that move more, or hold their "
                "values (null in calibrate.before)"
            )
        else:
            remedy = (
                f"these are not the cause (the residuals are {size:.3g} times the noise): the "
                "model does not describe these readings; look for a wrong column, for outliers, or "
                "for something that moved"
            )
        return f"chi-square still falls by {worth:.3g} a step, mostly along {names}: {remedy}"

    def conclusion(self, at: Guess, steps: int, cause: str) -> Fit:
        """The result of the fit at its last guess.

        cause: why it did not settle, else empty. If the values define no possible sensor, the
        result has the nominal sensor and that cause.
        """
        limit = self.outlier_limit(at)
        model, weights, normal = self.linearise(at, limit)
        matrix, _ = self.add_prior(at, normal)
        covariance: Floats = np.linalg.inv(matrix).astype(float)
        redundancy = redundancies(model, weights, normal, covariance)
        chi_square, freedom = self.chi_square(at, limit, redundancy)
        try:
            sensor = calibrated_sensor(self, at, normal, covariance, freedom)
        except InputError as error:  # Facets rotated with the mount may not form a pyramid.
            sensor, cause = self.nominal, f"the fitted values make no sensor ({error})"
        return Fit(
            sensor=sensor,
            choice=self.choice,
            values=at.values[self.choice.places],
            covariance=covariance,
            all_values=at.values,
            own_values=at.own_values,
            residuals=model.residual,
            weights=weights**2,
            redundancy=redundancy,
            loss=self.cost(at, np.inf if self.robust is None else self.robust),
            chi_square=chi_square,
            freedom=freedom,
            limit=limit,
            steps=steps,
            ended=not cause,
            cause=cause,
        )

    def chi_square(self, at: Guess, limit: float, redundancy: Floats) -> tuple[float, float]:
        """Chi-square without the outliers, corrected for the truncation, and its degrees of
        freedom.

        redundancy: (n, 9), see `redundancies`.
        """
        is_inside = np.isfinite(self.data.raw) & (np.abs(at.residual) <= limit)
        variance = cut_variance(self.robust) if limit == self.robust else 1.0
        chi_square = float((at.residual[is_inside] ** 2).sum()) / variance
        return chi_square, float(redundancy[is_inside].sum())


@one_thread
def fit(
    sensor: Sensor,
    data: Data,
    choice: Choice,
    robust: float | None = 3.0,
    start: Fit | None = None,
    rule: StoppingRule = SETTLED,
) -> Fit:
    """Find the most probable values of the chosen unknowns.

    robust: residuals beyond this many standard deviations have less weight (Huber); the limit grows
    if most residuals exceed the noise. None: equal weights.  start: an earlier fit to the same
    samples, as the initial guess.  rule: end of the fit. Raises `InputError` for too few samples or
    unknowns. `Fit.cause` states why a fit did not settle.
    """
    task = Descent(sensor, data, choice, robust)
    if start is None:
        at = task.guess(task.start, solve_open_axes(data, sensor))
    else:
        at = task.guess(start.all_values, start.own_values)
    return task.conclusion(*task.settle(at, rule))


#: Standard uncertainty of the detectors' common gain, which is 1 by convention.
GAIN_CONVENTION_SIGMA = 1e-5


def prior_information(choice: Choice) -> Floats:
    """Prior information (p, p): on each unknown, or jointly on some, and on the detectors' common
    gain.

    The common gain and the laser's power are interchangeable; without the convention, smaller gains
    would reduce the noise of the corrected powers and with it chi-square.
    """
    matrix = np.diag(1 / choice.sigma**2)
    if choice.joint is not None:
        inside = [n for n, name in enumerate(choice.names) if name in choice.joint.names]
        information = invert_covariance(np.array(choice.joint.covariance))
        places = [choice.joint.names.index(choice.names[n]) for n in inside]
        matrix[np.ix_(inside, inside)] = information[np.ix_(places, places)]
    gains = [n for n, name in enumerate(choice.names) if name in GAINS]
    if len(gains) == len(GAINS) and (np.isinf(choice.power) or "beam.power" in choice.names):
        matrix[np.ix_(gains, gains)] += 1 / (len(gains) * GAIN_CONVENTION_SIGMA) ** 2
    return matrix


def invert_covariance(matrix: Floats) -> Floats:
    """Invert a covariance (p, p) whose parameters differ in size by many orders of magnitude."""
    scale = np.sqrt(np.diag(matrix))
    inverse: Floats = np.linalg.inv(matrix / np.outer(scale, scale)) / np.outer(scale, scale)
    return (inverse + inverse.T) / 2


def huber_roots(residual: Floats, limit: float) -> Floats:
    """Square roots of Huber's weights of residuals in standard deviations, of their shape: 1 up to
    the limit, smaller beyond it."""
    if not np.isfinite(limit):
        return np.ones_like(residual)
    size = np.maximum(np.abs(residual), limit)
    weights: Floats = np.sqrt(limit / size)
    return weights


def cut_variance(limit: float | None) -> float:
    """Variance of a standard normal deviate truncated at +-limit; 1 without a limit."""
    if limit is None:
        return 1.0
    from scipy.special import ndtr

    density = np.exp(-(limit**2) / 2) / np.sqrt(2 * np.pi)
    return float(1 - 2 * limit * density / (2 * ndtr(limit) - 1))


def redundancies(model: Linear, weights: Floats, normal: Normal, covariance: Floats) -> Floats:
    """The fraction (n, 9), from 0 to 1, of each reading's variance that remains in its residual.

    The sample's own unknowns and the common ones absorb the rest.
    """
    size = covariance.shape[0]
    common, by_own = model.common * weights[:, :, None], model.by_own * weights[:, :, None]
    free = np.diagonal(normal.inner, axis1=1, axis2=2) < 1e17
    by_own = by_own * free[:, None, :]
    absorbed = (by_own @ np.linalg.inv(normal.inner) * by_own).sum(axis=2)
    reduced = common - by_own @ normal.back[:, :, :size]
    absorbed += (reduced @ covariance * reduced).sum(axis=2)
    remaining: Floats = np.clip(1 - absorbed, 0.0, 1.0)
    return remaining


# ---- from the fit to the sensor that is written


def calibrated_sensor(
    task: Task, at: Guess, normal: Normal, covariance: Floats, freedom: float
) -> Sensor:
    """The calibrated sensor with the covariance of its parameters and its degrees of freedom, see
    `joint_freedom`.

    The power is the mean over the samples if each has its own. The facets include the mirror's
    rotation on the reference; the mirror's position there and the drifts are no part of the sensor.
    """
    names, values = list(task.choice.names), at.values
    if np.isinf(task.choice.power):
        covariance = add_mean_power(task, at, normal, covariance)
        values = at.mean_power_values
        names.append("beam.power")
    calibration = sensor_covariance(names, values, covariance)
    calibration = replace(calibration, degrees_of_freedom=joint_freedom(task, freedom))
    sensor = assign_values(task.nominal, fold_mount(values))
    thermal = thermal_of(values, task.data.temperature)
    return replace(sensor, calibration=calibration, thermal=thermal)


def sensor_covariance(names: list[str], values: Floats, covariance: Floats) -> Calibration:
    """The part of the unknowns' covariance (p, p) that belongs to the sensor."""
    names, covariance = fold(names, values, covariance)
    places = [n for n, name in enumerate(names) if name in OF_SENSOR or name in TEMPERATURE]
    part = covariance[np.ix_(places, places)]
    return Calibration(tuple(names[n] for n in places), tuple(map(tuple, part.tolist())))


def joint_freedom(task: Task, freedom: float) -> float | None:
    """The degrees of freedom of the residuals, or of the joint prior covariance if it has fewer;
    None if those of the prior are unknown."""
    prior = task.choice.joint
    if prior is None:
        return max(freedom, 1.0)
    before = prior.degrees_of_freedom
    return None if before is None else max(min(freedom, before), 1.0)


def thermal_of(values: Floats, temperature: float | None) -> Thermal:
    """The sensor's temperature coefficients from values (ALL,), zero without a temperature or a
    fitted dependence.

    temperature: mean of the samples, degrees Celsius, which becomes the reference temperature.
    """
    if temperature is None or not values[block(TEMPERATURE)].any():
        return Thermal()
    beam_x, beam_y, *places = values[block(TEMPERATURE)].tolist()
    return Thermal(temperature, (beam_x, beam_y), tuple(places))


def add_mean_power(task: Task, at: Guess, normal: Normal, covariance: Floats) -> Floats:
    """The covariance (p + 1, p + 1) with the mean of the laser's power over the samples, mW, as the
    last unknown."""
    size, power = len(covariance), at.values[PLACE["beam.power"]]
    slope = -normal.back[:, 6, :size].mean(axis=0) * OWN_UNITS[6] * power
    variance = np.linalg.inv(normal.inner)[:, 6, 6].sum() / len(at.own_values) ** 2
    out = np.empty((size + 1, size + 1))
    out[:size, :size] = covariance
    out[size, :size] = out[:size, size] = covariance @ slope
    out[size, size] = slope @ covariance @ slope + variance * (OWN_UNITS[6] * power) ** 2
    return out


def fold(names: list[str], values: Floats, covariance: Floats) -> tuple[list[str], Floats]:
    """Names and covariance (p, p) after the mirror's rotation is merged into the facets.

    values: (ALL,) at which the merger is linearised.
    """
    if set(MOUNT).isdisjoint(names):
        return names, covariance
    changed, sources, slope = fold_derivatives(values)
    facets = [ALL[n] for n in changed]
    rest = [name for name in names if name not in facets]
    transform = np.zeros((len(facets) + len(rest), len(names)))
    for n, name in enumerate(names):
        if PLACE[name] in sources:
            transform[:6, n] = slope[:, sources.index(PLACE[name])]
        if name in rest:
            transform[6 + rest.index(name), n] = 1.0
    return facets + rest, transform @ covariance @ transform.T
