"""The sensor's parameters from readings of a motion that a reference knows, wholly or in part.

The frame is the reference's: its axes are those of the world, whose origin lies on the beam and at
the apex's height while the reference is at zero. So nothing is left that could not be told in
principle; what the motion at hand does not tell, `identify` says in words.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.sensor import MONOMIALS, Calibration, Sensor
from ..detectors.correction import OF_ONE, corrected
from ..estimation.solver import solve
from ..model.arrays import sensor_with
from ..optics.parameters import PARAMETERS
from .bundle_adjustment import (
    MOUNTING,
    OWN_UNITS,
    Choice,
    Data,
    Linear,
    Normal,
    eliminated,
    linear,
    residuals,
    states_of,
    values_of,
)

Floats = NDArray[np.float64]

#: Steps at most; the step, in standard uncertainties, at which it ends; damping that leads nowhere.
STEPS, SMALL, STUCK = 40, 1e-3, 1e6


@dataclass(frozen=True)
class Fit:
    """What was found.

    sensor: the calibrated one.  values: (p) of the names, in mm, rad, mW and shares.
    covariance: (p, p).  open: (n, 6) what was found of the poses beside the reference's.
    left: (n, 9) residuals in standard deviations of the readings.  weights: (n, 9) below 1 for
    outliers.  steps: that it took.  ended: in time.
    """

    sensor: Sensor
    choice: Choice
    values: Floats
    covariance: Floats
    mounting: Floats
    open: Floats
    left: Floats
    weights: Floats
    steps: int
    ended: bool

    @property
    def uncertainty(self) -> Floats:
        return np.sqrt(np.diag(self.covariance))


def opened(data: Data, sensor: Sensor) -> Floats:
    """Where the poses are beside the reference, to begin with: what the nominal sensor solves."""
    opening = np.zeros_like(data.pose)
    free = np.isinf(data.sigma)
    if free.any():
        found = solve(sensor, corrected(sensor, data.raw), beam="free", covariance=False)
        solved = found.ok[:, None] & free
        opening = np.where(solved, found.state[:, :6] - data.pose, 0.0)
    return opening


@dataclass(frozen=True)
class Guess:
    """Where a fit is.  values: of `ALL`.  opening: (n, 6).  level: what is made small, there."""

    sensor: Sensor
    values: Floats
    opening: Floats
    level: float


class Task:
    """What is to be fitted to what."""

    def __init__(self, sensor: Sensor, data: Data, choice: Choice, robust: float | None) -> None:
        if len(data.raw) < 2 or not len(choice.names):
            raise InputError("a calibration needs two samples and one parameter, at least")
        self.nominal, self.data, self.choice, self.robust = sensor, data, choice, robust
        self.start = values_of(sensor)
        self.prior = 1 / choice.sigma**2

    def guess(self, values: Floats, opening: Floats) -> Guess:
        """Raises `InputError` where the values make no sensor."""
        sensor = assigned(self.nominal, values)
        return Guess(sensor, values, opening, self.cost(sensor, values, opening))

    def cost(self, sensor: Sensor, values: Floats, opening: Floats) -> float:
        """Huber's loss of the readings, and squares of what was known before."""
        state = states_of(self.data, opening, values[-len(MOUNTING) :])
        size = np.abs(np.nan_to_num(residuals(sensor, self.data.raw, state)))
        loss = size**2
        if self.robust is not None:
            limit = self.robust
            loss = np.where(size > limit, 2 * limit * size - limit**2, loss)
        known = np.isfinite(self.data.sigma)
        beside = opening[:, known] / self.data.sigma[known]
        before = (values - self.start)[self.choice.places] / self.choice.sigma
        return float(loss.sum() + (beside**2).sum() + (before**2).sum())

    def linearised(self, at: Guess) -> tuple[Linear, Floats, Normal]:
        """The model there, the roots of the readings' weights, and the normal equations."""
        found = linear(at.sensor, self.data, at.opening, at.values, self.choice)
        weights = huber(found.residual, self.robust)
        return found, weights, eliminated(found, weights, at.opening, self.data.sigma)

    def improved(self, at: Guess, damping: float) -> tuple[Guess, float, float]:
        """A guess that is no worse, the step to it in standard uncertainties, and the damping."""
        _, _, normal = self.linearised(at)
        matrix = normal.matrix + np.diag(self.prior)
        side = normal.side - self.prior * (at.values - self.start)[self.choice.places]
        spread = np.sqrt(np.diag(np.linalg.inv(matrix)))
        while damping < STUCK:
            step = np.linalg.solve(matrix + damping * np.diag(np.diag(matrix)), side)
            values = at.values.copy()
            values[self.choice.places] += step
            own = normal.back[:, :, -1] - normal.back[:, :, :-1] @ step
            with suppress(InputError):  # no sensor: a smaller step is one
                tried = self.guess(values, at.opening + own * OWN_UNITS)
                if tried.level <= at.level * (1 + 1e-12):
                    return tried, float((np.abs(step) / spread).max()), damping
            damping = max(10 * damping, 1e-3)
        return at, np.inf, damping

    def told(self, at: Guess, steps: int, ended: bool) -> Fit:
        found, weights, normal = self.linearised(at)
        covariance: Floats = np.linalg.inv(normal.matrix + np.diag(self.prior)).astype(float)
        return Fit(
            sensor=calibrated(at.sensor, self.choice, covariance),
            choice=self.choice,
            values=at.values[self.choice.places],
            covariance=covariance,
            mounting=at.values[-len(MOUNTING) :],
            open=at.opening,
            left=found.residual,
            weights=weights**2,
            steps=steps,
            ended=ended,
        )


def fit(sensor: Sensor, data: Data, choice: Choice, robust: float | None = 3.0) -> Fit:
    """The most probable values of what is chosen, by Gauss-Newton steps, damped where needed.

    robust: residuals beyond so many standard deviations weigh less (Huber); None: all the same.
    Raises `InputError` where there is too little to fit.
    """
    task = Task(sensor, data, choice, robust)
    now = task.guess(task.start, opened(data, sensor))
    damping, size, steps = 0.0, np.inf, 0
    while size > SMALL and steps < STEPS and damping < STUCK:
        now, size, damping = task.improved(now, damping)
        steps += 1
        if damping < STUCK:
            damping = damping / 10 if damping > 1e-3 else 0.0
    return task.told(now, steps, size <= SMALL)


def huber(residual: Floats, limit: float | None) -> Floats:
    """Root of the weight of each residual."""
    if limit is None:
        return np.ones_like(residual)
    size = np.maximum(np.abs(residual), 1e-300)
    return np.sqrt(np.minimum(1.0, limit / size))


def assigned(sensor: Sensor, values: Floats) -> Sensor:
    """The sensor with values of `ALL`."""
    made = sensor_with(sensor, values[: len(PARAMETERS)].tolist())
    parts = values[len(PARAMETERS) : -len(MOUNTING)].reshape(3, len(OF_ONE)).tolist()
    count = len(MONOMIALS)
    psds = [
        replace(psd, correction=replace(
            psd.correction, power=power, dark=dark, y=tuple(rest[:count]), z=tuple(rest[count:])
        ))
        for psd, (power, dark, *rest) in zip(made.psds, parts, strict=True)
    ]  # fmt: skip
    return replace(made, psds=(psds[0], psds[1], psds[2]))


def calibrated(sensor: Sensor, choice: Choice, covariance: Floats) -> Sensor:
    """The sensor with the uncertainty of what was found of it, less where the mirror was."""
    kept = [n for n, name in enumerate(choice.names) if name not in MOUNTING]
    part = covariance[np.ix_(kept, kept)]
    names = tuple(choice.names[n] for n in kept)
    return replace(sensor, calibration=Calibration(names, tuple(map(tuple, part.tolist()))))
