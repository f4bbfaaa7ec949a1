"""The linearised bundle adjustment: states of a mirror on a reference, and derivatives by all
unknowns.

The sensor's parameters, the corrections of its detectors, the effects of real light and the
mirror's place on the reference are common to all samples. Each sample has its own unknowns: the
part of its pose that the reference does not measure and, where they change, the laser's power and
the beam's position. They are eliminated from the normal equations (Schur complement), so that any
number of samples needs one small system. All derivatives are closed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.names import FINE_UNITS
from ...core.rigid_body import (
    angle_axes,
    angle_rates,
    cross_matrix,
    rotation_angles,
    rotation_matrix,
)
from ...core.sensor import Sensor
from ...core.units import Floats
from ...detectors.correction import NAMES, correct, correction_slopes
from ...detectors.noise import standard_deviations
from ...detectors.temperature import PLACES
from ...model.arrays import EFFECTS, effect_jacobian, readings, state_slopes
from ...model.beam_shape import SHAPE
from .unknowns import (
    ALL,
    BACKLASH,
    CLOCKS,
    DELAY,
    DRIFTS,
    GEOMETRY,
    LAG,
    MOUNTING,
    OF_DRIFT,
    PLACE,
    POWER_DRIFT,
    SKEW,
    SPLINE,
    Choice,
    block,
    sensor_derivatives,
    spline_slopes,
    values_of,
)

__all__ = ["ALL", "MOUNTING", "Choice", "values_of"]


#: Number of a sample's own unknowns: the pose, the laser's power and the beam's position.
OWN_COUNT = 9
#: Their units: um and urad of the pose, a thousandth of the power, um of the beam.
OWN_UNITS = np.array([*FINE_UNITS[:6], 1e-3, 1e-3, 1e-3])
#: What is clear, such as a step of the reference, is so many times its standard uncertainty; what
#: counts in readings or poses is this share of their noise.
CLEAR_SIGMAS, LEAST_COUNTED = 4.0, 0.3
#: Residual, in standard deviations, of a reading for which the model has no value.
MISSING_RESIDUAL = 1e4


Rows = NDArray[np.bool_] | NDArray[np.int64] | slice


class Moves(NamedTuple):
    """How the reference moved about each sample, in the order of the rows.

    approach: (n, 6) the signs of each axis's last step; 0 where none is known.  last: (n, 6) by how
    much it moved since the row before.  before: (n, 9) the readings of that row.  following: (n, 6)
    by how much it moves to the row behind.  bend: (n, 6) the second difference of its poses there,
    by the two rows on both sides alone.
    """

    approach: Floats
    last: Floats
    before: Floats
    following: Floats
    bend: Floats

    def part(self, rows: Rows) -> Moves:
        return Moves(*(column[rows] for column in self))


class Data(NamedTuple):
    """The samples of a calibration.  raw: (n, 9) as the detectors gave them.  pose: (n, 6) by the
    reference, mm and rad.

    sigma: (6,) its standard uncertainty; infinite for an axis that it does not measure, whose
    column then holds the initial guess. beam: (n, 2) mm. velocity, acceleration: (n, 6) in mm, rad
    and s. clock: (n, 3) by `CLOCKS`: time in half runs from -1 to 1, temperature less its mean, K,
    and one of `pasts` or zero. pasts: (n, m) by how much things that follow the temperature late,
    or that a thermometer follows, are warmer than it, K. noise: (n, 9) standard
    deviations of the readings, which then follow no unknown. slow: (n, 5) polynomials for the
    laser's power over the run. moves: from row to row. rows: (n,)
    number of rows of the table in a sample's mean; None where each sample is one row. number: (n,)
    the table's row, from 1, or the number of the stand where rows were averaged. temperature: the
    mean one, degrees Celsius.
    """

    raw: Floats
    pose: Floats
    sigma: Floats
    beam: Floats
    velocity: Floats | None = None
    acceleration: Floats | None = None
    clock: Floats | None = None
    pasts: Floats | None = None
    noise: Floats | None = None
    slow: Floats | None = None
    moves: Moves | None = None
    rows: Floats | None = None
    number: NDArray[np.int64] | None = None
    temperature: float | None = None

    def part(self, rows: Rows) -> Data:
        kept = {
            name: value[rows]
            for name, value in self._asdict().items()
            if value is not None and name not in ("sigma", "temperature", "moves")
        }
        return self._replace(**kept, moves=self.moves and self.moves.part(rows))

    def follow(self, n: int) -> Data:
        """The samples in which something follows the temperature by one of `pasts`."""
        clock = None
        if self.clock is not None and self.pasts is not None:
            clock = np.column_stack([self.clock[:, :-1], self.pasts[:, n]])
        return self._replace(clock=clock)


def pose_of(data: Data, own_values: Floats, values: Floats) -> Floats:
    """The reference's pose of each sample (n, 6), with the delay and the sample's own part added
    and backlash and lag subtracted."""
    pose: Floats = data.pose + own_values[:, :6]
    if data.moves is not None:
        pose = pose - values[block(BACKLASH)] * data.moves.approach
        pose = pose - values[block(LAG)] * data.moves.last
    if data.velocity is not None:
        late = values[PLACE[DELAY]]
        pose = pose + late * velocity_after(data, late / 2)
    return pose


def velocity_after(data: Data, late: float) -> Floats:
    """The velocities (n, 6) at a time after that of the samples, s; of a motion in time."""
    assert data.velocity is not None
    if data.acceleration is None or not late:
        return data.velocity
    later: Floats = data.velocity + late * data.acceleration
    return later


def states_of(data: Data, own_values: Floats, values: Floats) -> Floats:
    """The mirror's states (n, 8), from the reference's poses and the samples' own unknowns.

    own_values: (n, 9).  values: values of all names in `ALL`.
    """
    pose = pose_of(data, own_values, values)
    lever, apex, mount = values[block(MOUNTING)].reshape(3, 3)
    turn = rotation_matrix(pose[:, 3:])
    state = np.concatenate([pose, data.beam + own_values[:, 7:]], axis=1)
    state[:, :3] += (turn - np.eye(3)) @ lever + apex
    if mount.any():
        state[:, 3:6] = rotation_angles(turn @ rotation_matrix(mount))
    state[:, 6:] += drift(data, values)[:, :2]
    return state


def drift(data: Data, values: Floats) -> Floats:
    """Drifts (n, 8) of the beam's position and of the readings by the clock, mm."""
    if data.clock is None:
        return np.zeros((len(data.raw), len(OF_DRIFT)))
    each: Floats = data.clock @ values[block(DRIFTS)].reshape(len(CLOCKS), len(OF_DRIFT))
    return each


def relative_power(data: Data, own_values: Floats, values: Floats) -> Floats:
    """The laser's power (n,) relative to `beam.power`."""
    power: Floats = 1 + own_values[:, 6]
    return power if data.slow is None else power + data.slow @ values[block(POWER_DRIFT)]


def add_power_polynomials(data: Data) -> Data:
    """Add Legendre polynomials of time, or of the rows' order, for the laser's power."""
    there = data.clock is not None and data.clock[:, 0].any()
    time = data.clock[:, 0] if there else np.linspace(-1, 1, len(data.raw))  # type: ignore[index]
    count = len(POWER_DRIFT)
    return data._replace(slow=np.polynomial.legendre.legvander(time, count)[:, 1:])


def add_approach(data: Data) -> Data:
    """Add each axis's last step and next one, its direction, and the readings before it; the rows
    are in the order of the motion."""
    step = np.diff(data.pose, axis=0, prepend=data.pose[:1])
    sign = np.where(np.abs(step) > CLEAR_SIGMAS * data.sigma, np.sign(step), 0.0)
    last = np.where(sign != 0, np.arange(len(sign))[:, None], 0)
    latest = np.maximum.accumulate(last, axis=0)
    bend = np.zeros(step.shape)
    pose = data.pose
    bend[2:-2] = (pose[4:] + pose[:-4] - pose[3:-1] - pose[1:-3]) / 3
    return data._replace(moves=Moves(
        approach=np.take_along_axis(sign, latest, axis=0),
        last=step,
        before=np.concatenate([data.raw[:1], data.raw[:-1]]),
        following=np.concatenate([step[1:], np.zeros((1, 6))]),
        bend=bend,
    ))  # fmt: skip


def predict_readings(
    sensor: Sensor, data: Data, own_values: Floats, values: Floats, state: Floats
) -> Floats:
    """The readings (n, 9) of perfect detectors at states (n, 8), with each sample's own power."""
    seen = readings(sensor, state)
    add_skew(seen, sensor, data, own_values, values)
    seen[:, 2::3] *= relative_power(data, own_values, values)[:, None]
    seen[:, PLACES] += drift(data, values)[:, 2:]
    return seen


def add_skew(seen: Floats, sensor: Sensor, data: Data, own_values: Floats, values: Floats) -> None:
    """Replace the readings of detectors that are read later than the stated time by those at that
    later time."""
    if data.velocity is None:
        return
    for k, name in enumerate(SKEW):
        if values[PLACE[name]]:
            later = values.copy()
            later[PLACE[DELAY]] += values[PLACE[name]]
            state = states_of(data, own_values, later)
            part = slice(3 * k, 3 * k + 3)
            seen[:, part] = readings(sensor, state)[:, part]


class Linear(NamedTuple):
    """Residuals (n, 9) in standard deviations, and their negative derivatives: by each common
    unknown (n, 9, p), and by each sample's own (n, 9, 9) in `OWN_UNITS`."""

    residual: Floats
    common: Floats
    own: Floats


def deviations(sensor: Sensor, data: Data) -> Floats:
    """Standard deviations (n, 9) of the readings."""
    if data.noise is not None:
        return data.noise
    sigma: Floats = standard_deviations(sensor, correct(sensor, data.raw))
    return sigma


def linearise_model(
    sensor: Sensor, data: Data, own_values: Floats, values: Floats, choice: Choice
) -> Linear:
    """The model linearised at values of `ALL`; a missing reading has zero weight."""
    own_values = pad_own_values(own_values)
    state = states_of(data, own_values, values)
    predicted = predict_readings(sensor, data, own_values, values, state)
    sigma = deviations(sensor, data)
    residual = (correct(sensor, data.raw) - predicted) / sigma
    by_state = state_slopes(sensor, state)
    power = relative_power(data, own_values, values)[:, None, None]
    by_state[:, 2::3] *= power
    turning = Turning.from_pose(pose_of(data, own_values, values), values[block(MOUNTING)], state)
    by_own = own_columns(by_state, turning, predicted, power[:, 0])
    columns = sensor_columns(sensor, data.raw, state, power, choice)
    columns[:, :, block(MOUNTING)] = mounting_columns(by_state, turning)
    add_run(columns, data, by_own, by_state, values[PLACE[DELAY]])
    common = columns[:, :, choice.places] / sigma[:, :, None]
    by_own = by_own * OWN_UNITS / sigma[:, :, None]
    is_finite = (
        np.isfinite(residual) & np.isfinite(common).all(axis=2) & np.isfinite(by_own).all(axis=2)
    )
    for part in (residual, common, by_own):
        part[~is_finite] = 0.0
    return Linear(residual, common, by_own)


def sensor_columns(
    sensor: Sensor, raw: Floats, state: Floats, power: Floats, choice: Choice
) -> Floats:
    """The derivatives of the readings by `ALL` (n, 9, p), in which those by the sensor's own
    parameters are filled in; without columns of splines where the choice has none.

    power: (n, 1, 1) of the laser, relative to `beam.power`.
    """
    is_bent = any(name in SPLINE for name in choice.names)
    columns = np.zeros((len(state), 9, len(ALL) if is_bent else block(SPLINE).start))
    columns[:, :, block((*GEOMETRY, *SHAPE))] = sensor_derivatives(sensor, state)
    if any(name in EFFECTS for name in choice.names):
        columns[:, :, block(EFFECTS)] = effect_columns(sensor, state, choice)
    columns[:, 2::3] *= power
    columns[:, :, block(NAMES)] = -correction_slopes(sensor, raw)
    if is_bent:
        columns[:, :, block(SPLINE)] = -spline_slopes(sensor, raw)
    return columns


def effect_columns(sensor: Sensor, state: Floats, choice: Choice) -> Floats:
    """The derivatives by the effects of a choice.

    NaN where a diverging fit makes a sensor without derivatives, such as a beam without width.
    """
    try:
        return effect_jacobian(sensor, state, names=list(choice.names))
    except ZeroDivisionError:
        return np.full((len(state), 9, len(EFFECTS)), np.nan)


class Turning(NamedTuple):
    """The derivatives of the mirror's state by the reference's pose: each (n, 3, 3).

    matrix: the reference's rotation.  lever: the apex's shift by the reference's angles.  angles:
    the mirror's angles by the reference's.  mount: the mirror's angles by the mount's.
    """

    matrix: Floats
    lever: Floats
    angles: Floats
    mount: Floats

    @classmethod
    def from_pose(cls, pose: Floats, mounting: Floats, state: Floats) -> Turning:
        lever, _, mount = mounting.reshape(3, 3)
        turn, turn_axes = rotation_matrix(pose[:, 3:]), angle_axes(pose[:, 3:])
        arm = turn @ lever
        rates = angle_rates(state[:, 3:6])
        return cls(
            turn,
            -cross_matrix(arm) @ turn_axes,
            rates @ turn_axes,
            rates @ turn @ angle_axes(mount),
        )


def own_columns(by_state: Floats, turning: Turning, seen: Floats, light: Floats) -> Floats:
    """The derivatives of the readings by each sample's own unknowns (n, 9, 9), per mm, rad and
    share."""
    columns = np.zeros((len(by_state), 9, OWN_COUNT))
    columns[:, :, :3] = by_state[:, :, :3]
    columns[:, :, 3:6] = by_state[:, :, :3] @ turning.lever + by_state[:, :, 3:6] @ turning.angles
    columns[:, 2::3, 6] = seen[:, 2::3] / light
    columns[:, :, 7:] = by_state[:, :, 6:]
    return columns


def mounting_columns(by_state: Floats, turning: Turning) -> Floats:
    """The derivatives of the readings by `MOUNTING` (n, 9, 9)."""
    return np.concatenate(
        [
            by_state[:, :, :3] @ (turning.matrix - np.eye(3)),
            by_state[:, :, :3],
            by_state[:, :, 3:6] @ turning.mount,
        ],
        axis=2,
    )


def add_run(every: Floats, data: Data, by_own: Floats, by_state: Floats, late: float) -> None:
    """Fill the columns of changes over the run: the laser, the delay, the last step, the drifts."""
    if data.slow is not None:
        every[:, :, block(POWER_DRIFT)] = by_own[:, :, 6:7] * data.slow[:, None, :]
    if data.velocity is not None:
        moving = np.einsum("nij,nj->ni", by_own[:, :, :6], velocity_after(data, late))
        every[:, :, PLACE[DELAY]] = moving
        for k, name in enumerate(SKEW):
            every[:, 3 * k : 3 * k + 3, PLACE[name]] = moving[:, 3 * k : 3 * k + 3]
    if data.moves is not None:
        every[:, :, block(BACKLASH)] = -by_own[:, :, :6] * data.moves.approach[:, None, :]
        every[:, :, block(LAG)] = -by_own[:, :, :6] * data.moves.last[:, None, :]
    if data.clock is not None:
        every[:, :, block(DRIFTS)] = drift_columns(data.clock, by_state)


def drift_columns(clock: Floats, by_state: Floats) -> Floats:
    """The columns (n, 9, 24) of `DRIFTS`, by the derivatives (n, 9, 8) by the mirror's states."""
    by_drift = np.zeros((len(by_state), 9, len(OF_DRIFT)))
    by_drift[:, :, :2] = by_state[:, :, 6:]
    by_drift[:, PLACES, np.arange(2, len(OF_DRIFT))] = 1.0
    each: Floats = clock[:, None, :, None] * by_drift[:, :, None, :]
    return each.reshape(*by_drift.shape[:2], -1)


def pad_own_values(own_values: Floats) -> Floats:
    """Append zeros of power and beam to own values (n, 6) of poses alone: (n, 9)."""
    missing = OWN_COUNT - own_values.shape[1]
    return own_values if not missing else np.pad(own_values, ((0, 0), (0, missing)))


def residuals(sensor: Sensor, data: Data, own_values: Floats, values: Floats) -> Floats:
    """Residuals (n, 9) in standard deviations; 0 without a reading, `MISSING_RESIDUAL` without a
    model."""
    state = states_of(data, own_values, values)
    seen = predict_readings(sensor, data, own_values, values, state)
    over: Floats = (correct(sensor, data.raw) - seen) / deviations(sensor, data)
    over[~np.isfinite(over)] = MISSING_RESIDUAL
    over[~np.isfinite(data.raw)] = 0.0
    return over


class Normal(NamedTuple):
    """Normal equations without the samples' own unknowns, and the solution for those.

    matrix: (p, p), side: (p,) of the data alone.  back: (n, 9, p + 1), own unknowns = back[p] -
    back[:p] x.  inner: (n, 9, 9) the information on the samples' own unknowns, including the prior.
    fall: by how much a step of the samples' own unknowns lowers chi-square.  level: chi-square
    after that step.
    """

    matrix: Floats
    side: Floats
    back: Floats
    inner: Floats
    fall: float
    level: float


def own_sigma(data: Data, choice: Choice) -> Floats:
    """Prior standard uncertainties (9,) of a sample's own unknowns, mm, rad and shares."""
    return np.array([*data.sigma, choice.power, choice.beam, choice.beam])


def own_information(sigma: Floats) -> Floats:
    """Information (9,) in `OWN_UNITS`; bounded for unknowns that are known exactly."""
    with np.errstate(divide="ignore"):
        known = np.where(np.isfinite(sigma), OWN_UNITS / sigma, 0.0) ** 2
    bounded: Floats = np.minimum(known, 1e18)
    return bounded


def eliminate_own_unknowns(
    model: Linear, weights: Floats, own_values: Floats, sigma: Floats
) -> Normal:
    """Eliminate each sample's own unknowns from the normal equations.

    own_values: (n, 9) present values of the samples' own unknowns.  sigma: (9,) their prior
    uncertainties, or (6,) those of the reference alone with constant power and beam.
    """
    own_values = pad_own_values(own_values)
    known = own_information(np.pad(sigma, (0, OWN_COUNT - len(sigma))))
    common, by_own = model.common * weights[:, :, None], model.own * weights[:, :, None]
    by_own = by_own * (known < 1e18)
    residual = model.residual * weights
    inner = np.swapaxes(by_own, 1, 2) @ by_own
    inner += np.diag(known + 1e-18)
    across = np.swapaxes(by_own, 1, 2) @ common
    beside = np.where(known < 1e18, own_values / OWN_UNITS, 0.0)
    pull = (np.swapaxes(by_own, 1, 2) @ residual[:, :, None])[:, :, 0] - known * beside
    back = np.linalg.solve(inner, np.concatenate([across, pull[:, :, None]], axis=2))
    size = common.shape[2]
    rows, column = common.reshape(-1, size), residual.ravel()
    flat = across.reshape(-1, size)
    matrix = rows.T @ rows - flat.T @ back[:, :, :size].reshape(-1, size)
    side = rows.T @ column - flat.T @ back[:, :, size].ravel()
    fall = float((pull * back[:, :, size]).sum())
    level = float(column @ column + (known * beside**2).sum()) - fall
    return Normal((matrix + matrix.T) / 2, side, back, inner, fall, level)
