"""A bundle adjustment, linearised: the mirror carried by a reference, and what each unknown does.

The sensor's parameters, the corrections of its detectors and where the mirror stands on the
reference are common to all samples; what the reference leaves open of each pose belongs to its
sample, and is eliminated from the normal equations there (Schur complement), so that any number of
samples costs one small system. All derivatives are closed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.names import FINE_UNITS
from ..core.sensor import Sensor
from ..detectors.correction import NAMES, coefficients, corrected, slopes
from ..detectors.noise import standard_deviations
from ..model.arrays import jacobian, parameter_jacobian, parameters, readings
from ..optics.parameters import PARAMETERS

Floats = NDArray[np.float64]

#: Where the mirror is on the reference: the apex from its pivot; and from the beam while at zero.
MOUNTING = ("lever.x", "lever.y", "lever.z", "apex.x", "apex.y")
ALL = (*PARAMETERS, *NAMES, *MOUNTING)


def values_of(sensor: Sensor) -> Floats:
    """Of `ALL`, as the sensor is thought to be, the apex on the pivot and on the beam."""
    return np.concatenate([parameters(sensor), coefficients(sensor), np.zeros(len(MOUNTING))])


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


OWN_UNITS = np.array(FINE_UNITS[:6])


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
