"""The sensor's parameters from readings of a motion that a reference knows, wholly or in part.

A bundle adjustment: the sensor's parameters, the corrections of its detectors and where the mirror
stands on the reference are common to all samples; what the reference leaves open of each pose
belongs to its sample, and is eliminated from the normal equations there (Schur complement), so that
any number of samples costs one small system. All derivatives are closed.

The frame is the reference's: its axes are those of the world, whose origin lies on the beam and at
the apex's height while the reference is at zero. So nothing is left that could not be told in
principle; what the motion at hand does not tell, `identify` says in words.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .correction import NAMES, OF_ONE, coefficients, corrected, slopes
from .errors import InputError
from .model import jacobian, parameter_jacobian, parameters, readings, sensor_with
from .noise import standard_deviations
from .optics.parameters import PARAMETERS
from .sensor import MONOMIALS, Calibration, Correction, Sensor

Floats = NDArray[np.float64]

#: Where the mirror is on the reference: the apex from its pivot; and from the beam while at zero.
MOUNTING = ("lever.x", "lever.y", "lever.z", "apex.x", "apex.y")
ALL = (*PARAMETERS, *NAMES, *MOUNTING)
#: Steps at most, and the step, in standard uncertainties, at which it ends.
STEPS, SMALL = 40, 1e-3


class Data(NamedTuple):
    """raw: (n, 9) as the detectors gave them.  pose: (n, 6) by the reference, mm and rad.

    sigma: (6,) its standard uncertainty; infinite where it does not measure an axis, whose column
    then is where to look first.  beam: (n, 2) mm.
    """

    raw: Floats
    pose: Floats
    sigma: Floats
    beam: Floats

    def part(self, rows: NDArray[np.bool_]) -> Data:
        return Data(self.raw[rows], self.pose[rows], self.sigma, self.beam[rows])


@dataclass(frozen=True)
class Choice:
    """What is to be found: names out of `ALL`, and what is known of each before, 1 sigma."""

    names: tuple[str, ...]
    sigma: Floats

    @property
    def places(self) -> NDArray[np.int64]:
        return np.array([ALL.index(name) for name in self.names])


@dataclass(frozen=True)
class Fit:
    """What was found.

    sensor: the calibrated one.  values: (p) of the names, in mm, rad, mW and shares.
    covariance: (p, p).  open: (n, 6) what was found of the poses beside the reference's.
    left: (n, 9) residuals in standard deviations of the readings.  weights: (n, 9) below 1 for
    outliers.  information: (p, p) from the data alone.  steps: that it took.  ended: in time.
    """

    sensor: Sensor
    choice: Choice
    values: Floats
    covariance: Floats
    mounting: Floats
    open: Floats
    left: Floats
    weights: Floats
    information: Floats
    steps: int
    ended: bool

    @property
    def uncertainty(self) -> Floats:
        return np.sqrt(np.diag(self.covariance))


class Turned(NamedTuple):
    """Rotations (n, 3, 3) of roll, pitch and yaw, and their derivatives by each (n, 3, 3, 3)."""

    matrix: Floats
    slopes: Floats


def turned(angles: Floats) -> Turned:
    """R = Rz(yaw) Ry(pitch) Rx(roll) of angles (n, 3)."""
    c, s, zero, one = np.cos(angles), np.sin(angles), np.zeros(len(angles)), np.ones(len(angles))

    def matrix(rows: list[list[Floats]]) -> Floats:
        return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)

    def about(axis: int, cos: Floats, sin: Floats, fixed: Floats) -> Floats:
        if axis == 0:
            return matrix([[fixed, zero, zero], [zero, cos, -sin], [zero, sin, cos]])
        if axis == 1:
            return matrix([[cos, zero, sin], [zero, fixed, zero], [-sin, zero, cos]])
        return matrix([[cos, -sin, zero], [sin, cos, zero], [zero, zero, fixed]])

    turn = [about(i, c[:, i], s[:, i], one) for i in range(3)]
    slope = [about(i, -s[:, i], c[:, i], zero) for i in range(3)]
    whole = turn[2] @ turn[1] @ turn[0]
    by = (turn[2] @ turn[1] @ slope[0], turn[2] @ slope[1] @ turn[0], slope[2] @ turn[1] @ turn[0])
    return Turned(whole, np.stack(by, axis=1))


def states_of(data: Data, opening: Floats, mounting: Floats) -> Floats:
    """The mirror's states (n, 8): the reference's poses and what it left open, carried over."""
    pose = data.pose + opening
    lever, apex = mounting[:3], mounting[3:]
    state = np.concatenate([pose, data.beam], axis=1)
    state[:, :3] += (turned(pose[:, 3:]).matrix - np.eye(3)) @ lever
    state[:, :2] += apex
    return state


class Linear(NamedTuple):
    """Residuals (n, 9) over their sigmas, and what lowers them: by each common unknown (n, 9, p),
    by each pose's own (n, 9, 6) in units of um and urad."""

    residual: Floats
    common: Floats
    own: Floats


OWN_UNITS = np.array([1e-3] * 3 + [1e-6] * 3)


def linear(sensor: Sensor, data: Data, opening: Floats, values: Floats, choice: Choice) -> Linear:
    """The model at some values of `ALL`; a reading that is not there weighs nothing."""
    mounting = values[-len(MOUNTING) :]
    state = states_of(data, opening, mounting)
    turn = turned(state[:, 3:6])
    left = residuals(sensor, data.raw, state)
    by_state = jacobian(sensor, state)
    own = by_state[:, :, :6].copy()
    moved = np.einsum("ncij,j->nic", turn.slopes, mounting[:3])
    own[:, :, 3:] += by_state[:, :, :3] @ moved
    every = np.empty((len(state), 9, len(ALL)))
    every[:, :, : len(PARAMETERS)] = parameter_jacobian(sensor, state)
    every[:, :, len(PARAMETERS) : -len(MOUNTING)] = -slopes(sensor, data.raw)
    every[:, :, -5:-2] = by_state[:, :, :3] @ (turn.matrix - np.eye(3))
    every[:, :, -2:] = by_state[:, :, :2]
    sigma = standard_deviations(sensor, corrected(sensor, data.raw))[:, :, None]
    common, own = every[:, :, choice.places] / sigma, own * OWN_UNITS / sigma
    known = np.isfinite(left) & np.isfinite(common).all(axis=2) & np.isfinite(own).all(axis=2)
    for part in (left, common, own):
        part[~known] = 0.0
    return Linear(left, common, own)


def residuals(sensor: Sensor, raw: Floats, state: Floats) -> Floats:
    """(n, 9) in standard deviations of the readings."""
    seen = corrected(sensor, raw)
    over: Floats = (seen - readings(sensor, state)) / standard_deviations(sensor, seen)
    return over


class Normal(NamedTuple):
    """Normal equations without the poses' own unknowns, and the way back to those.

    matrix: (p, p), side: (p,) of the data alone.  back: (n, 6, p + 1), own = back[p] - back[:p] x.
    """

    matrix: Floats
    side: Floats
    back: Floats


def eliminated(found: Linear, weights: Floats, opening: Floats, sigma: Floats) -> Normal:
    """Takes what belongs to each pose out of the normal equations.

    opening: (n, 6) where the poses are now, beside the reference.  sigma: (6,) of the reference.
    """
    with np.errstate(divide="ignore"):
        known = np.where(np.isfinite(sigma), OWN_UNITS / sigma, 0.0) ** 2
    common, own = found.common * weights[:, :, None], found.own * weights[:, :, None]
    left = found.residual * weights
    inner = np.swapaxes(own, 1, 2) @ own
    inner += np.diag(known + 1e-18)
    across = np.swapaxes(own, 1, 2) @ common
    pull = (np.swapaxes(own, 1, 2) @ left[:, :, None])[:, :, 0] - known * opening / OWN_UNITS
    back = np.linalg.solve(inner, np.concatenate([across, pull[:, :, None]], axis=2))
    size = common.shape[2]
    rows, column = common.reshape(-1, size), left.ravel()
    flat = across.reshape(-1, size)
    matrix = rows.T @ rows - flat.T @ back[:, :, :size].reshape(-1, size)
    side = rows.T @ column - flat.T @ back[:, :, size].ravel()
    return Normal((matrix + matrix.T) / 2, side, back)


def opened(data: Data, sensor: Sensor) -> Floats:
    """Where the poses are beside the reference, to begin with: what the nominal sensor solves."""
    from .solver import solve

    opening = np.zeros_like(data.pose)
    free = np.isinf(data.sigma)
    if free.any():
        found = solve(sensor, corrected(sensor, data.raw), beam="free", covariance=False)
        solved = found.ok[:, None] & free
        opening = np.where(solved, found.state[:, :6] - data.pose, 0.0)
    return opening


def fit(sensor: Sensor, data: Data, choice: Choice, robust: float | None = 3.0) -> Fit:
    """The most probable values of what is chosen, by Gauss-Newton steps, damped where needed.

    robust: residuals beyond so many standard deviations weigh less (Huber); None: all the same.
    Raises `InputError` where there is too little to fit.
    """
    if len(data.raw) < 2 or not len(choice.names):
        raise InputError("a calibration needs two samples and one parameter, at least")
    values = np.concatenate([parameters(sensor), coefficients(sensor), np.zeros(len(MOUNTING))])
    start, places = values.copy(), choice.places
    opening = opened(data, sensor)
    now, weights = sensor, np.ones_like(data.raw)
    prior = 1 / choice.sigma**2
    damping, ended, steps = 0.0, False, 0
    level = cost(now, data, opening, values, choice, start, robust)
    while steps < STEPS and not ended:
        steps += 1
        found = linear(now, data, opening, values, choice)
        weights = huber(found.residual, robust)
        normal = eliminated(found, weights, opening, data.sigma)
        matrix = normal.matrix + np.diag(prior)
        side = normal.side - prior * (values - start)[places]
        while True:
            step = np.linalg.solve(matrix + damping * np.diag(np.diag(matrix)), side)
            tried = values.copy()
            tried[places] += step
            own = normal.back[:, :, -1] - normal.back[:, :, :-1] @ step
            wider = opening + own * OWN_UNITS
            try:
                then = assigned(sensor, tried)
                new = cost(then, data, wider, tried, choice, start, robust)
            except InputError:
                new = np.inf
            if new <= level * (1 + 1e-12) or damping > 1e6:
                break
            damping = max(10 * damping, 1e-3)
        spread = np.sqrt(np.diag(np.linalg.inv(matrix)))
        ended = bool((np.abs(step) < SMALL * spread).all()) and damping <= 1e6
        values, opening, now, level = tried, wider, then, new
        damping = damping / 10 if damping > 1e-3 else 0.0
    found = linear(now, data, opening, values, choice)
    weights = huber(found.residual, robust)
    normal = eliminated(found, weights, opening, data.sigma)
    covariance: Floats = np.linalg.inv(normal.matrix + np.diag(prior)).astype(float)
    known = calibrated(now, choice, covariance)
    return Fit(known, choice, values[places], covariance, values[-len(MOUNTING) :], opening,
               found.residual, weights**2, normal.matrix, steps, ended)  # fmt: skip


def huber(residual: Floats, limit: float | None) -> Floats:
    """Root of the weight of each residual."""
    if limit is None:
        return np.ones_like(residual)
    size = np.maximum(np.abs(residual), 1e-300)
    return np.sqrt(np.minimum(1.0, limit / size))


def cost(
    sensor: Sensor, data: Data, opening: Floats, values: Floats, choice: Choice, start: Floats,
    robust: float | None,
) -> float:  # fmt: skip
    """What is made small: Huber's loss of the readings, and squares of what was known before."""
    left = np.nan_to_num(residuals(sensor, data.raw, states_of(data, opening, values[-5:])))
    size = np.abs(left)
    loss = size**2
    if robust is not None:
        loss = np.where(size > robust, 2 * robust * size - robust**2, loss)
    with np.errstate(divide="ignore"):
        beside = opening / np.where(np.isfinite(data.sigma), data.sigma, np.inf)
    before = (values - start)[choice.places] / choice.sigma
    return float(loss.sum() + (beside**2).sum() + (before**2).sum())


def assigned(sensor: Sensor, values: Floats) -> Sensor:
    """The sensor with values of `ALL`."""
    made = sensor_with(sensor, values[: len(PARAMETERS)].tolist())
    parts = values[len(PARAMETERS) : -len(MOUNTING)].reshape(3, len(OF_ONE)).tolist()
    count = len(MONOMIALS)
    psds = [
        replace(psd, correction=Correction(power, dark, tuple(rest[:count]), tuple(rest[count:])))
        for psd, (power, dark, *rest) in zip(made.psds, parts, strict=True)
    ]
    return replace(made, psds=(psds[0], psds[1], psds[2]))


def calibrated(sensor: Sensor, choice: Choice, covariance: Floats) -> Sensor:
    """The sensor with the uncertainty of what was found of it, less where the mirror was."""
    kept = [n for n, name in enumerate(choice.names) if name not in MOUNTING]
    part = covariance[np.ix_(kept, kept)]
    names = tuple(choice.names[n] for n in kept)
    return replace(sensor, calibration=Calibration(names, tuple(map(tuple, part.tolist()))))
