"""From readings to the mirror's pose: weighted least squares on all that is known."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import estimate
from .errors import InputError
from .model import Floats, as_rows, packed
from .sensor import Sensor


class Status(IntEnum):
    """How the estimate of one reading ended. Only a converged one has a pose."""

    CONVERGED = estimate.CONVERGED
    MAX_STEPS = estimate.MAX_STEPS
    SINGULAR = estimate.SINGULAR
    OUT_OF_RANGE = estimate.OUT_OF_RANGE
    NO_LIGHT = estimate.NO_LIGHT
    NON_FINITE = estimate.NON_FINITE

    @property
    def label(self) -> str:
        return self.name.lower().replace("_", " ")


@dataclass(frozen=True)
class Prior:
    """What is known before the reading: a Gaussian of the given mean and standard deviation.

    For the beam, mean (..., 2) and sigma (a number or one each) of bx, by in mm; for the power,
    mean and sigma in mW. sigma 0: known exactly; infinite: not known at all.
    """

    mean: ArrayLike
    sigma: ArrayLike

    def __post_init__(self) -> None:
        sigma = np.asarray(self.sigma, dtype=float)
        if not (sigma >= 0).all():
            raise InputError(f"a prior's sigma is {self.sigma}; allowed: 0 or more")
        if not np.isfinite(np.asarray(self.mean, dtype=float)).all():
            raise InputError(f"a prior's mean is {self.mean}; allowed: finite numbers")


@dataclass(frozen=True)
class Solution:
    """Estimated states, one for each reading; (...) is the leading shape of the readings.

    state: (..., 8) mm, rad, NaN where not converged.  status: (...) of `Status`.
    power: (...) of the beam, mW.  used: (..., 3) the detectors that took part.
    iterations: (...).  residual: (...) root of the weighted sum of squares left, in sigmas.
    covariance: (..., 8, 8) of the state, or None where not asked for; zero for what was known.
    """

    state: Floats
    status: NDArray[np.int8]
    power: Floats
    used: NDArray[np.bool_]
    iterations: NDArray[np.int32]
    residual: Floats
    covariance: Floats | None

    @property
    def ok(self) -> NDArray[np.bool_]:
        """Where the estimate converged: (...)."""
        return self.status == Status.CONVERGED

    @property
    def uncertainty(self) -> Floats:
        """Standard uncertainty of each component of the state: (..., 8), mm and rad."""
        if self.covariance is None:
            raise InputError("no covariance: it was left out by solve(..., covariance=False)")
        root: Floats = np.sqrt(np.diagonal(self.covariance, axis1=-2, axis2=-1))
        return root


NAMED_BEAM = {"free": Prior((0.0, 0.0), np.inf), "known": Prior((0.0, 0.0), 0.0)}


def prior_of_beam(beam: str | Prior) -> Prior:
    if isinstance(beam, Prior):
        return beam
    if beam not in NAMED_BEAM:
        raise InputError(f'beam is {beam!r}; allowed: "free", "known" or a facets.Prior')
    return NAMED_BEAM[beam]


def prior_of_power(power: str | Prior, sensor: Sensor) -> Prior:
    if isinstance(power, Prior):
        return power
    sigma = {"known": 0.0, "unknown": np.inf}.get(power)
    if sigma is None:
        raise InputError(f'power is {power!r}; allowed: "known", "unknown" or a facets.Prior')
    return Prior(sensor.beam.power, sigma)


def given(
    place: Prior, light: Prior, rows: int, shape: tuple[int, ...]
) -> tuple[Floats, Floats]:
    """Means (n or 1, 3) and sigmas (3,) of bx, by and the power."""
    try:
        where, amount = np.asarray(place.mean, float), np.asarray(light.mean, float)
        if where.shape[:-1] or amount.shape:
            where = np.broadcast_to(where, (*shape, 2)).reshape(rows, 2)
            amount = np.broadcast_to(amount, shape).reshape(rows)
        means = np.empty((max(where.size // 2, 1), 3))
        means[:, :2], means[:, 2] = where, amount
        sigmas = np.empty(3)
        sigmas[:2], sigmas[2] = place.sigma, light.sigma
    except ValueError as error:
        raise InputError(f"a prior does not fit readings of shape {shape}: {error}") from None
    return means, sigmas


def starting(
    start: str | ArrayLike, means: Floats, values: Floats, sigmas: Floats, shape: tuple[int, ...]
) -> Floats:
    """Where each estimate starts (n or 1, 9): the priors' means, else zero and the light seen."""
    rows = means
    unknown_power = sigmas[2] == np.inf
    if unknown_power or not isinstance(start, str):
        rows = np.broadcast_to(means, (len(values), 3))
    starts = np.zeros((len(rows), 9))
    starts[:, 6:] = rows
    if unknown_power:
        seen = np.nansum(values[:, 2::3], axis=1)
        starts[:, 8] = np.where(np.isfinite(seen) & (seen > 0), seen, rows[:, 2])
    if isinstance(start, str):
        if start not in ("zero", "previous"):
            raise InputError(f'start is {start!r}; allowed: "zero", "previous" or states (..., 8)')
        return starts
    try:
        states = np.broadcast_to(np.asarray(start, float), (*shape, 8)).reshape(-1, 8)
    except ValueError as error:
        raise InputError(f"start does not fit readings of shape {shape}: {error}") from None
    known = sigmas[:2] == 0
    starts[:, :6] = states[:, :6]
    starts[:, 6:8] = np.where(known, starts[:, 6:8], states[:, 6:8])
    return starts


def judged_by(sensor: Sensor, eight: bool) -> estimate.Limits:
    noise = sensor.noise
    known: estimate.Limits | None = sensor.__dict__.get("_limits")
    if known is None:
        known = sensor.__dict__["_limits"] = estimate.Limits(
            noise=np.array([noise.position, noise.at_power, noise.power]),
            half_sizes=np.array([[psd.size_y / 2, psd.size_z / 2] for psd in sensor.psds]),
            eight=False,
        )
    return known._replace(eight=True) if eight else known


def solve(
    sensor: Sensor,
    readings: ArrayLike,
    *,
    beam: Literal["free", "known"] | Prior = "free",
    power: Literal["known", "unknown"] | Prior = "known",
    start: Literal["zero", "previous"] | ArrayLike = "zero",
    method: Literal["least-squares", "paper"] = "least-squares",
    max_steps: int = 50,
    covariance: bool = True,
) -> Solution:
    """The mirror's pose and the beam's place from the detectors' readings.

    Weighted least squares on all nine readings, weights from the sensor's noise, by Gauss-Newton
    steps that are damped where they do not help.

    readings: (..., 9) as `facets.readings` gives them. A detector with a NaN, without light or with
    a spot past its edge is left out where the rest is enough.
    beam: its place is "free", "known" to be (0, 0), or has a `Prior` in mm.
    power: "known" as the sensor's, "unknown", or a `Prior` in mW.
    start: "zero", "previous" (the last converged sample before), or states (..., 8).
    method: "paper" is Newton's method on eight readings, without the power of C (section 2.3 of the
    paper): no weights, no damping, the beam free and its power known.

    Bad arguments raise `InputError`; a reading that cannot be solved gets a status and NaN.
    """
    values, shape = as_rows(readings, 9, "readings")
    paper = method == "paper"
    if method not in ("least-squares", "paper"):
        raise InputError(f'method is {method!r}; allowed: "least-squares", "paper"')
    if paper and not (beam == "free" and power == "known"):
        raise InputError('method="paper" has the beam "free" and the power "known"')
    if max_steps < 1:
        raise InputError(f"max_steps is {max_steps}; allowed: 1 or more")
    means, sigmas = given(
        prior_of_beam(beam), prior_of_power(power, sensor), len(values), shape
    )
    starts = starting(start, means, values, sigmas, shape)
    free = np.concatenate([np.arange(6), 6 + np.flatnonzero(sigmas > 0)])
    with np.errstate(divide="ignore"):
        prior_weight = np.where(sigmas > 0, 1 / sigmas, 0.0)
    n = len(values)
    states, left = np.empty((n, 9)), np.empty(n)
    used, status, steps = np.empty((n, 3), bool), np.empty(n, np.int8), np.empty(n, np.int32)
    covariances = np.zeros((n if covariance else 0, 8, 8))
    from .kernels import invert

    invert(
        packed(sensor), values, judged_by(sensor, paper), means, prior_weight, free, starts,
        isinstance(start, str) and start == "previous", max_steps, not paper,
        states, used, status, steps, left, covariances,
    )  # fmt: skip
    return Solution(
        state=states[:, :8].reshape(*shape, 8),
        status=status.reshape(shape),
        power=states[:, 8].reshape(shape),
        used=used.reshape(*shape, 3),
        iterations=steps.reshape(shape),
        residual=left.reshape(shape),
        covariance=covariances.reshape(*shape, 8, 8) if covariance else None,
    )
