"""Linearise the bundle adjustment of readings of a mirror on a reference.

The sensor's parameters, the corrections of its detectors, the effects of real light and the
mirror's position on the reference are common to all samples. Each sample has its own unknowns: the
part of its pose that the reference does not measure and, if they change, the laser's power and the
beam's position. The latter are eliminated from the normal equations (Schur complement), so that the
remaining system is small for any number of samples. All derivatives are in closed form.

Shapes and units, for n samples: `values` (ALL,) belong to the names in `unknowns.ALL`, in mm, rad,
mW, s and fractions. `own_values` (n, 9) belong to the samples' own unknowns, in mm, rad and
fractions of the power. Derivatives (n, 9, unknowns) are derivatives of the readings in mm and mW;
in `Linear` they and the residuals are divided by the readings' standard deviations.
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
)

#: Number of a sample's own unknowns: the pose, the laser's power and the beam's position.
OWN_COUNT = 9
#: Units of a sample's own unknowns: um and urad of the pose, a thousandth of the power, um of the
#: beam.
OWN_UNITS = np.array([*FINE_UNITS[:6], 1e-3, 1e-3, 1e-3])
#: A quantity, such as a step of the reference, is significant above this many of its standard
#: uncertainties.
CLEAR_SIGMAS = 4.0
#: An effect on readings or poses matters above this fraction of their noise.
LEAST_COUNTED = 0.3
#: Residual, in standard deviations, of a reading for which the model has no value.
MISSING_RESIDUAL = 1e4


Rows = NDArray[np.bool_] | NDArray[np.int64] | slice


class Moves(NamedTuple):
    """The reference's motion around each sample, in the order of the rows.

    approach: (n, 6) the sign of each axis's last significant step; 0 before the first one.  last:
    (n, 6) the step from the previous row, mm and rad.  before: (n, 9) the readings of the previous
    row.  following: (n, 6) the step to the next row.  bend: (n, 6) the second difference of the
    poses, estimated from the two rows on either side, without the row itself.
    """

    approach: Floats
    last: Floats
    before: Floats
    following: Floats
    bend: Floats

    def part(self, rows: Rows) -> Moves:
        """The motion around some of the samples."""
        return Moves(*(column[rows] for column in self))


class Data(NamedTuple):
    """The samples of a calibration.

    raw: (n, 9) readings as the detectors gave them.  pose: (n, 6) the reference's pose, mm and rad.
    sigma: (6,) the reference's standard uncertainty; infinite for an axis that it does not measure,
    whose column of `pose` then holds the initial guess.  beam: (n, 2) the beam's position, mm.
    velocity, acceleration: (n, 6) of the reference, in mm, rad and s.  clock: (n, 3) in the order
    of `CLOCKS`: time from -1 to 1 over the run, temperature minus its mean, K, and one of `pasts`,
    or zero.  pasts: (n, m) regressors of a delayed temperature, of parts or of the thermometer, K.
    noise: (n, 9) standard deviations of the readings; None to compute them from the readings.
    slow: (n, 5) polynomials over the run for the laser's power.  moves: the motion from row to row.
    rows: (n,) number of the table's rows in the mean of a sample; None if each sample is one row.
    number: (n,) number of the table's row, from 1, or of the dwell if rows were averaged.
    temperature: mean temperature, degrees Celsius.
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
        """The samples of some rows; `sigma` and `temperature`, which all rows share, remain."""
        columns = {
            name: value[rows]
            for name, value in self._asdict().items()
            if value is not None and name not in ("sigma", "temperature", "moves")
        }
        return self._replace(**columns, moves=self.moves and self.moves.part(rows))

    def follow(self, n: int) -> Data:
        """The samples whose clock has column n of `pasts`."""
        clock = None
        if self.clock is not None and self.pasts is not None:
            clock = np.column_stack([self.clock[:, :-1], self.pasts[:, n]])
        return self._replace(clock=clock)


def pose_of(data: Data, own_values: Floats, values: Floats) -> Floats:
    """Pose of the mirror's mount at each sample (n, 6), mm and rad.

    It is the reference's pose plus the sample's own part and the motion during the delay, minus
    backlash and lag.
    """
    pose: Floats = data.pose + own_values[:, :6]
    if data.moves is not None:
        pose = pose - values[block(BACKLASH)] * data.moves.approach
        pose = pose - values[block(LAG)] * data.moves.last
    if data.velocity is not None:
        late = values[PLACE[DELAY]]
        pose = pose + late * velocity_after(data, late / 2)
    return pose


def velocity_after(data: Data, late: float) -> Floats:
    """The velocities (n, 6) of a motion in time, `late` seconds after each sample."""
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
    """Drifts (n, 8) of the beam's position and of positions on the detectors, mm."""
    if data.clock is None:
        return np.zeros((len(data.raw), len(OF_DRIFT)))
    drifts: Floats = data.clock @ values[block(DRIFTS)].reshape(len(CLOCKS), len(OF_DRIFT))
    return drifts


def relative_power(data: Data, own_values: Floats, values: Floats) -> Floats:
    """The laser's power (n,) relative to `beam.power`."""
    power: Floats = 1 + own_values[:, 6]
    return power if data.slow is None else power + data.slow @ values[block(POWER_DRIFT)]


def add_power_polynomials(data: Data) -> Data:
    """Add Legendre polynomials of time, or of the rows' order, for the laser's power."""
    has_time = data.clock is not None and data.clock[:, 0].any()
    time = data.clock[:, 0] if has_time else np.linspace(-1, 1, len(data.raw))  # type: ignore[index]
    count = len(POWER_DRIFT)
    return data._replace(slow=np.polynomial.legendre.legvander(time, count)[:, 1:])


def add_approach(data: Data) -> Data:
    """Add the reference's motion from row to row (`Moves`); the rows are in the order of the
    motion."""
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
    predicted = readings(sensor, state)
    add_skew(predicted, sensor, data, own_values, values)
    predicted[:, 2::3] *= relative_power(data, own_values, values)[:, None]
    predicted[:, PLACES] += drift(data, values)[:, 2:]
    return predicted


def add_skew(
    predicted: Floats, sensor: Sensor, data: Data, own_values: Floats, values: Floats
) -> None:
    """Recompute the predicted readings of detectors that are read later than the stated time, in
    place."""
    if data.velocity is None:
        return
    for k, name in enumerate(SKEW):
        if values[PLACE[name]]:
            later = values.copy()
            later[PLACE[DELAY]] += values[PLACE[name]]
            state = states_of(data, own_values, later)
            part = slice(3 * k, 3 * k + 3)
            predicted[:, part] = readings(sensor, state)[:, part]


class Linear(NamedTuple):
    """Residuals (n, 9) in standard deviations, and their negative derivatives: by each common
    unknown (n, 9, p), and by each sample's own (n, 9, 9) in `OWN_UNITS`."""

    residual: Floats
    common: Floats
    by_own: Floats


def deviations(sensor: Sensor, data: Data) -> Floats:
    """Standard deviations (n, 9) of the readings."""
    if data.noise is not None:
        return data.noise
    sigma: Floats = standard_deviations(sensor, correct(sensor, data.raw))
    return sigma


def linearise_model(
    sensor: Sensor, data: Data, own_values: Floats, values: Floats, choice: Choice
) -> Linear:
    """Linearise the model at values of `ALL`; a missing reading has zero residual and
    derivatives."""
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
    """Derivatives of the readings by `ALL` (n, 9, p), of which only the columns of the sensor's own
    parameters are filled in; without columns of splines if the choice has none.

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
    """Derivatives (n, 9, EFFECTS) of the readings by the effects of a choice; zero for others.

    NaN if a diverging fit makes a sensor without derivatives, such as a beam without width.
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
        """Compute the derivatives at poses (n, 6) of the mount.

        mounting: (9,) values of `MOUNTING`.  state: (n, 8) of the mirror.
        """
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


def own_columns(by_state: Floats, turning: Turning, predicted: Floats, power: Floats) -> Floats:
    """The derivatives (n, 9, 9) of the predicted readings by each sample's own unknowns, per mm,
    rad and relative power.

    power: (n, 1) of the laser, relative to `beam.power`.
    """
    columns = np.zeros((len(by_state), 9, OWN_COUNT))
    columns[:, :, :3] = by_state[:, :, :3]
    columns[:, :, 3:6] = by_state[:, :, :3] @ turning.lever + by_state[:, :, 3:6] @ turning.angles
    columns[:, 2::3, 6] = predicted[:, 2::3] / power
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


def add_run(columns: Floats, data: Data, by_own: Floats, by_state: Floats, late: float) -> None:
    """Fill in the columns (n, 9, ALL) of changes over the run: the laser's power, delays, backlash,
    lag and drifts.

    late: the reference's delay, s.
    """
    if data.slow is not None:
        columns[:, :, block(POWER_DRIFT)] = by_own[:, :, 6:7] * data.slow[:, None, :]
    if data.velocity is not None:
        moving = np.einsum("nij,nj->ni", by_own[:, :, :6], velocity_after(data, late))
        columns[:, :, PLACE[DELAY]] = moving
        for k, name in enumerate(SKEW):
            columns[:, 3 * k : 3 * k + 3, PLACE[name]] = moving[:, 3 * k : 3 * k + 3]
    if data.moves is not None:
        columns[:, :, block(BACKLASH)] = -by_own[:, :, :6] * data.moves.approach[:, None, :]
        columns[:, :, block(LAG)] = -by_own[:, :, :6] * data.moves.last[:, None, :]
    if data.clock is not None:
        columns[:, :, block(DRIFTS)] = drift_columns(data.clock, by_state)


def drift_columns(clock: Floats, by_state: Floats) -> Floats:
    """Derivatives (n, 9, 24) of the readings by `DRIFTS`.  by_state: (n, 9, 8) by the state."""
    by_drift = np.zeros((len(by_state), 9, len(OF_DRIFT)))
    by_drift[:, :, :2] = by_state[:, :, 6:]
    by_drift[:, PLACES, np.arange(2, len(OF_DRIFT))] = 1.0
    slopes: Floats = clock[:, None, :, None] * by_drift[:, :, None, :]
    return slopes.reshape(*by_drift.shape[:2], -1)


def pad_own_values(own_values: Floats) -> Floats:
    """Append zeros of power and beam to own values (n, 6) of poses alone: (n, 9)."""
    missing = OWN_COUNT - own_values.shape[1]
    return own_values if not missing else np.pad(own_values, ((0, 0), (0, missing)))


def residuals(sensor: Sensor, data: Data, own_values: Floats, values: Floats) -> Floats:
    """Residuals (n, 9) in standard deviations; 0 for a missing reading, `MISSING_RESIDUAL` if the
    model has no value for an existing one."""
    state = states_of(data, own_values, values)
    predicted = predict_readings(sensor, data, own_values, values, state)
    ratio: Floats = (correct(sensor, data.raw) - predicted) / deviations(sensor, data)
    ratio[~np.isfinite(ratio)] = MISSING_RESIDUAL
    ratio[~np.isfinite(data.raw)] = 0.0
    return ratio


class Normal(NamedTuple):
    """Normal equations after elimination of the samples' own unknowns.

    matrix: (p, p) and side: (p,) of the data, without the prior of the common unknowns x.  back:
    (n, 9, p + 1); the step of the samples' own unknowns is back[p] - back[:p] x.  inner: (n, 9, 9)
    information on the samples' own unknowns, with their prior.  fall: decrease of chi-square by a
    step of the samples' own unknowns alone.  level: chi-square after that step.
    """

    matrix: Floats
    side: Floats
    back: Floats
    inner: Floats
    fall: float
    level: float


def own_sigma(data: Data, choice: Choice) -> Floats:
    """Prior standard uncertainties (9,) of a sample's own unknowns: mm, rad and relative power."""
    return np.array([*data.sigma, choice.power, choice.beam, choice.beam])


def own_information(sigma: Floats) -> Floats:
    """Prior information (9,), per `OWN_UNITS` squared; bounded for unknowns known exactly."""
    with np.errstate(divide="ignore"):
        information = np.where(np.isfinite(sigma), OWN_UNITS / sigma, 0.0) ** 2
    bounded: Floats = np.minimum(information, 1e18)
    return bounded


def eliminate_own_unknowns(
    model: Linear, weights: Floats, own_values: Floats, sigma: Floats
) -> Normal:
    """Eliminate each sample's own unknowns from the normal equations.

    weights: (n, 9) square roots of the readings' weights.  own_values: (n, 9) present values of the
    samples' own unknowns.  sigma: (9,) their prior uncertainties; (6,) if power and beam are
    constant.
    """
    own_values = pad_own_values(own_values)
    prior = own_information(np.pad(sigma, (0, OWN_COUNT - len(sigma))))
    common, by_own = model.common * weights[:, :, None], model.by_own * weights[:, :, None]
    by_own = by_own * (prior < 1e18)
    residual = model.residual * weights
    inner = np.swapaxes(by_own, 1, 2) @ by_own
    inner += np.diag(prior + 1e-18)
    across = np.swapaxes(by_own, 1, 2) @ common
    offset = np.where(prior < 1e18, own_values / OWN_UNITS, 0.0)
    pull = (np.swapaxes(by_own, 1, 2) @ residual[:, :, None])[:, :, 0] - prior * offset
    back = np.linalg.solve(inner, np.concatenate([across, pull[:, :, None]], axis=2))
    size = common.shape[2]
    rows, column = common.reshape(-1, size), residual.ravel()
    flat = across.reshape(-1, size)
    matrix = rows.T @ rows - flat.T @ back[:, :, :size].reshape(-1, size)
    side = rows.T @ column - flat.T @ back[:, :, size].ravel()
    fall = float((pull * back[:, :, size]).sum())
    level = float(column @ column + (prior * offset**2).sum()) - fall
    return Normal((matrix + matrix.T) / 2, side, back, inner, fall, level)
