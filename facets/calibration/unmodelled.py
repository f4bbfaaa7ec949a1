"""Causes that a fit has no unknowns for, found in what its residuals follow, by a score test.

A cause is known by what it does to the readings: columns C beside the columns X of the unknowns.
With the readings' variance V and the residuals y, chi-square would fall by

    s' M^-1 s,    s = C' P y,    M = C' P C,    P = V^-1 - V^-1 X (X' V^-1 X + prior)^-1 X' V^-1

if the columns were unknowns, too; where the cause is absent, this fall has the distribution of
chi-square. Where a period or a time is searched for, the chance of the largest fall is multiplied
by the number of trials. The likeliest cause is the one whose fall has the smallest chance.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.names import DETECTORS
from ..core.sensor import Sensor
from ..core.units import Floats
from ..model.arrays import EFFECTS, effect_jacobian, readings
from .bundle_adjustment import (
    OWN_UNITS,
    Data,
    evaluate_turned_mirror,
    own_sigma,
    relative_power,
    states_of,
)
from .fit import Fit, Task
from .outliers import row_numbers
from .scatter import NAMES, UNMEASURED_SIGMA, Likelihood
from .small_matrices import one_thread
from .unknowns import assign_values

#: A direction of columns that the unknowns explain but for this share of its square is left out.
LEAST_OWN_SHARE = 1e-6
#: The chance of a fall below which its cause is reported.
LEAST_CHANCE = 1e-6
#: Causes whose chances differ by less than this factor cannot be told apart.
APART_CHANCE = 20.0


class Trace(NamedTuple):
    """The part of the residuals that a cause would explain.

    fall: of chi-square, by this number of columns, the largest of a number of trials.  amounts: of
    the columns, in the units of the cause.  size: r.m.s. of what the powers follow, in their
    standard deviations.  at: the period in mm, or the sample of a step; 0 for a drift.
    """

    cause: str
    fall: float
    columns: int
    amounts: Floats
    size: float
    trials: int = 1
    at: float = 0.0

    @property
    def log_chance(self) -> float:
        """Logarithm of the chance of such a fall where the cause is absent."""
        return log_chance(self.fall, self.columns) + float(np.log(self.trials))


def log_chance(fall: float, count: int) -> float:
    """Logarithm of the chance that chi-square of a number of columns is larger than a fall."""
    from scipy.special import chdtrc, gammaln

    if count == 0:  # the unknowns explain all columns
        return 0.0
    chance = float(chdtrc(count, max(fall, 0.0)))
    if chance > 1e-290:
        return float(np.log(chance))
    half = fall / 2
    return float(-half + (count / 2 - 1) * np.log(half) - gammaln(count / 2))


class Remainder:
    """The residuals of a fit and their likelihood, in which further columns are tested."""

    def __init__(self, sensor: Sensor, data: Data, result: Fit, robust: float | None) -> None:
        task = Task(sensor, data, result.choice, robust)
        assert task.data.noise is not None
        self.data, self.fit, self.noise = task.data, result, task.data.noise
        self.likelihood = Likelihood(task, result)
        with np.errstate(over="ignore"):
            known = np.minimum(
                (own_sigma(task.data, result.choice) / OWN_UNITS) ** 2, UNMEASURED_SIGMA**2
            )
        self.restricted = self.likelihood.restrict(known, np.zeros(len(NAMES)))
        self.covariance = np.linalg.inv(self.restricted.matrix)
        self.is_read = (self.likelihood.own != 0).any(axis=2)
        self.sensor = assign_values(sensor, result.all_values)
        self.state = states_of(task.data, result.own_values, result.all_values)
        self.light = np.nan_to_num(task.data.raw[:, 2::3] / self.noise[:, 2::3])

    def test(self, cause: str, columns: Floats, least: float = LEAST_OWN_SHARE) -> Trace:
        """The fall that columns (n, 9, q) bring, in standard deviations of the readings."""
        whole, matrix, side = self.equations(columns)
        fall, amounts, count = falls_of(whole[None], matrix[None], side[None], least)
        return Trace(cause, float(fall[0]), int(count[0]), amounts[0],
                     self.size(fall[0] - count[0]))  # fmt: skip

    def second_moment(self, columns: Floats, sigma: float) -> float:
        """The expectation of the sum of squares of columns' amounts, of which each was known to be
        zero within `sigma` before the samples."""
        _, matrix, side = self.equations(columns)
        covariance = np.linalg.inv(matrix + np.eye(len(matrix)) / sigma**2)
        amounts = covariance @ side
        return float(amounts @ amounts + np.trace(covariance))

    def equations(self, columns: Floats) -> tuple[Floats, Floats, Floats]:
        """The squares of columns (n, 9, q), the matrix M and the vector s of the score test (see
        the beginning of this file): (q, q), (q, q), (q,)."""
        columns = np.nan_to_num(columns) * self.is_read[:, :, None]
        flat, at = columns.reshape(-1, columns.shape[2]), self.restricted
        across = at.weighted.reshape(len(flat), -1).T @ flat
        whole = flat.T @ (at.inverse @ columns).reshape(flat.shape)
        matrix = whole - across.T @ self.covariance @ across
        return whole, matrix, flat.T @ at.pulled.ravel()

    def size(self, excess: float) -> float:
        """The r.m.s. over the powers, in their standard deviations, of a part of the residuals that
        lowers chi-square by `excess`."""
        return float(np.sqrt(max(float(excess), 0.0) / max(float((self.light > 0).sum()), 1.0)))

    def test_waves(self, cause: str, waves: Floats, powers: list[int], periods: Floats) -> Trace:
        """The best of waves (n, m, 2) that the powers of some detectors follow, each detector with
        its own amplitude and phase.  periods: (m,) of the waves."""
        at, chosen = self.restricted, 3 * np.array(powers) + 2
        light = (self.light * self.is_read[:, 2::3])[:, powers]
        count, size = waves.shape[1], 2 * len(powers)
        sides, across = np.empty((count, size)), np.empty((count, at.matrix.shape[0], size))
        whole = np.empty((count, size, size))
        each, flat = np.ascontiguousarray(np.swapaxes(waves, 0, 1)), waves.reshape(len(waves), -1)
        turned = np.swapaxes(each, 1, 2)
        for i, column in enumerate(chosen):
            part = slice(2 * i, 2 * i + 2)
            sides[:, part] = turned @ (light[:, i] * at.pulled[:, column])
            weighted = at.weighted[:, column] * light[:, i : i + 1]
            across[:, :, part] = np.moveaxis((weighted.T @ flat).reshape(-1, count, 2), 0, 1)
            for j, other_column in enumerate(chosen):
                weight = light[:, i] * light[:, j] * at.inverse[:, column, other_column]
                whole[:, part, 2 * j : 2 * j + 2] = (turned * weight) @ each
        matrix = whole - np.swapaxes(across, 1, 2) @ self.covariance @ across
        fall, amounts, columns = falls_of(whole, matrix, sides)
        best = int(np.argmax(fall))
        return Trace(cause, float(fall[best]), int(columns[best]), amounts[best],
                     self.size(fall[best] - size), count, float(periods[best]))  # fmt: skip

    def test_steps(self, cause: str, columns: Floats) -> Trace:
        """The best of steps: the columns (n, 9, q) act on all samples behind one of them."""
        columns, at = np.nan_to_num(columns) * self.is_read[:, :, None], self.restricted

        def sum_behind(values: Floats) -> Floats:
            return np.cumsum(values[::-1], axis=0)[::-1][STEP_MARGIN:-STEP_MARGIN]

        turned = np.swapaxes(columns, 1, 2)
        sides = sum_behind((turned @ at.pulled[:, :, None])[:, :, 0])
        whole = sum_behind(turned @ at.inverse @ columns)
        across = np.swapaxes(sum_behind(turned @ at.weighted), 1, 2)
        matrix = whole - np.swapaxes(across, 1, 2) @ self.covariance @ across
        fall, amounts, count = falls_of(whole, matrix, sides)
        best = int(np.argmax(fall))
        size = self.size(fall[best] - count[best])
        return Trace(cause, float(fall[best]), int(count[best]), amounts[best], size,
                     len(fall), best + STEP_MARGIN)  # fmt: skip


def falls_of(
    whole: Floats, matrix: Floats, side: Floats, least: float = LEAST_OWN_SHARE
) -> tuple[Floats, Floats, Floats]:
    """Falls (m,), amounts (m, q) and numbers of columns (m,) that the unknowns do not explain.

    whole: (m, q, q) the columns' squares; matrix: the same beside the unknowns; side: (m, q).
    """
    scale = np.sqrt(np.maximum(np.diagonal(whole, axis1=1, axis2=2), 1e-300))
    level, ways = np.linalg.eigh(matrix / scale[:, :, None] / scale[:, None, :])
    aim = (np.swapaxes(ways, 1, 2) @ (side / scale)[:, :, None])[:, :, 0]
    is_free = level > least
    level = np.where(is_free, level, 1.0)
    step = np.where(is_free, aim / level, 0.0)
    amounts = (ways @ step[:, :, None])[:, :, 0] / scale
    return (step * aim).sum(axis=1), amounts, is_free.sum(axis=1)


# ---- light that is not that of the model

#: Powers of x and y up to which the powers may follow the mirror's place.
DEGREE = 4
SHAPE, CHIP, GHOST, MODES = "shape", "chip", "ghost", "modes"
FRINGES, WINDOW = "fringes", "window"
#: Periods in mm, and directions, of fringes across the beam; longer ones are no fringes over a
#: motion of half a millimetre.
FRINGE_PERIODS_MM, FRINGE_DIRECTIONS = np.geomspace(0.12, 0.6, 14), 12
#: Numbers of periods over the motion at which fringes of a detector's window are searched for.
WINDOW_PERIODS = np.arange(2.0, 22.0, 0.5)
#: A step of the beam for differences of high order, in its standard deviations.
DIFFERENCE = 0.25


def shape_of_powers(remainder: Remainder) -> Trace:
    """Test how much of the powers' residuals is a smooth function of the mirror's x and y.

    What scatters follows nothing; light of another shape than the model's does, also where a beam
    or a power of each sample's own takes up most of it.
    """
    place = remainder.data.pose[:, :2] + remainder.fit.own_values[:, :2]
    place = place - np.median(place, axis=0)
    x, y = (place / np.abs(place).max(axis=0).clip(1e-12)).T
    rows = np.column_stack([x**a * y**b for a in range(DEGREE + 1) for b in range(DEGREE + 1 - a)
                            if a + b > 1])  # fmt: skip
    return remainder.test(SHAPE, power_columns(remainder, rows))


def power_columns(remainder: Remainder, rows: Floats) -> Floats:
    """Columns (n, 9, 3 q) in which each power follows functions (n, q) by itself."""
    count = rows.shape[1]
    columns = np.zeros((len(rows), 9, 3 * count))
    for k in range(3):
        columns[:, 3 * k + 2, k * count : (k + 1) * count] = rows * remainder.light[:, k : k + 1]
    return columns


def chip_columns(remainder: Remainder) -> Floats:
    """The columns of an area broken off the tip of each facet, by mm^2: each facet lights its own
    detector."""
    slopes = effect_jacobian(remainder.sensor, remainder.state, names=("tip.area",))
    whole = slopes[:, :, EFFECTS.index("tip.area")] / remainder.noise
    columns = np.zeros((*whole.shape, 3))
    for k in range(3):
        columns[:, 3 * k : 3 * k + 3, k] = whole[:, 3 * k : 3 * k + 3]
    return columns


def profile_columns(remainder: Remainder, order: int) -> Floats:
    """What the Hermite functions of one order do in the beam's profile, for each unit of the power.

    A profile G (1 + sum c_n He_n) has the power and the first moments of the Gaussian beam G,
    differentiated n times by the beam's place.
    """
    sensor = remainder.sensor
    sigma = float(np.sqrt(sensor.beam.diameter_x * sensor.beam.diameter_y)) / 4
    moments = {}
    for i in range(-2, 3):
        for j in range(-2, 3):
            state = remainder.state.copy()
            state[:, 6:] += np.array([i, j]) * DIFFERENCE * sigma
            moments[i, j] = moments_of(evaluate_turned_mirror(
                sensor, remainder.data, state, readings
            ))  # fmt: skip
    here = evaluate_turned_mirror(sensor, remainder.data, remainder.state, readings)
    light = relative_power(remainder.data, remainder.fit.own_values, remainder.fit.all_values)
    columns = np.empty((*here.shape, order + 1))
    for n in range(order + 1):
        slope = np.zeros_like(here)
        for i, weight in STENCILS[order - n].items():
            for j, other_weight in STENCILS[n].items():
                slope += weight * other_weight * moments[i, j] / DIFFERENCE**order
        column = np.empty_like(here)
        column[:, 2::3] = slope[:, 2::3] * light[:, None]
        for m in (0, 1):
            column[:, m::3] = (slope[:, m::3] - here[:, m::3] * slope[:, 2::3]) / here[:, 2::3]
        columns[:, :, n] = column / remainder.noise
    return columns


#: Central differences by order: the weights of the values at steps of one.
STENCILS: tuple[dict[int, float], ...] = (
    {0: 1.0},
    {-1: -0.5, 1: 0.5},
    {-1: 1.0, 0: -2.0, 1: 1.0},
    {-2: -0.5, -1: 1.0, 1: -1.0, 2: 0.5},
    {-2: 1.0, -1: -4.0, 0: 6.0, 1: -4.0, 2: 1.0},
)


def moments_of(reading: Floats) -> Floats:
    """Readings (n, 9) with each place multiplied by its power."""
    moments = reading.copy()
    for m in (0, 1):
        moments[:, m::3] *= reading[:, 2::3]
    return moments


#: The root of the sum of squares of the third-order Hermite numbers of another beam, for each unit
#: of its share of the power, where it is nearly two standard deviations aside.
ORDER_3_PER_SHARE = 1.45


@one_thread
def uneven_share(remainder: Remainder, share: float) -> float:
    """The share of the power that a second beam beside the first may have, r.m.s.

    share: what was known before the samples. The uneven part of the profile, of third order, tells
    of such a beam; that of first order would be another position of the whole beam.
    """
    sigma = ORDER_3_PER_SHARE * share / 2  # each of four numbers
    square = remainder.second_moment(profile_columns(remainder, 3), sigma)
    return float(np.sqrt(square)) / ORDER_3_PER_SHARE


def find_fringes(remainder: Remainder) -> Trace:
    """Fringes that stand in the beam: the light at the apex follows the mirror's place in it."""
    sensor = remainder.sensor
    sigma = float(np.sqrt(sensor.beam.diameter_x * sensor.beam.diameter_y)) / 4
    place = remainder.state[:, :2] - remainder.state[:, 6:]
    envelope = np.exp(-(place**2).sum(axis=1) / 2 / sigma**2)
    angle = np.arange(FRINGE_DIRECTIONS) * np.pi / FRINGE_DIRECTIONS
    along = place @ np.array([np.cos(angle), np.sin(angle)])
    phase = (2 * np.pi * along[:, :, None] / FRINGE_PERIODS_MM).reshape(len(place), -1)
    waves = np.stack([np.cos(phase), np.sin(phase)], axis=-1) * envelope[:, None, None]
    periods = np.tile(FRINGE_PERIODS_MM, FRINGE_DIRECTIONS)
    return remainder.test_waves(FRINGES, waves, [0, 1, 2], periods)


def find_window_fringes(remainder: Remainder) -> Trace:
    """Fringes of one detector's window: its power is periodic in the spot's place, or in z."""
    traces = list[Trace]()
    for k in range(3):
        raw = np.nan_to_num(remainder.data.raw[:, 3 * k : 3 * k + 2])
        for values in (raw[:, 0], raw[:, 1], remainder.state[:, 2]):
            span = max(float(np.ptp(values)), 1e-12)
            phase = 2 * np.pi * values[:, None] * WINDOW_PERIODS / span
            waves = np.stack([np.cos(phase), np.sin(phase)], axis=-1)
            trace = remainder.test_waves(WINDOW, waves, [k], span / WINDOW_PERIODS)
            traces.append(trace._replace(cause=f"{WINDOW}_{DETECTORS[k]}"))
    best = min(traces, key=lambda trace: trace.log_chance)
    return best._replace(trials=best.trials * len(traces))


#: The causes by which light may be another than the model's, each with its test. A test raises
#: `InputError` where the sensor's model has no such light.
LIGHT_TESTS: tuple[Callable[[Remainder], Trace], ...] = (
    shape_of_powers,
    lambda remainder: remainder.test(CHIP, chip_columns(remainder)),
    lambda remainder: remainder.test(GHOST, profile_columns(remainder, 3)),
    lambda remainder: remainder.test(MODES, profile_columns(remainder, 4)),
    find_fringes,
    find_window_fringes,
)


# ---- a reference that is not what it is said to be

REFERENCE = "reference"
#: Errors of the reference that the mirror's place on it explains but for this share are left out.
SEATING_OWN_SHARE = 1e-3


def reference_errors(remainder: Remainder) -> Trace:
    """Test how much of the residuals is an error of the reference that its own coordinates give: of
    second order at most, as by scales, an Abbe offset or a bow."""
    pose = remainder.data.pose / np.abs(remainder.data.pose).max(axis=0).clip(1e-12)
    pairs = [pose[:, i] * pose[:, j] for i in range(6) for j in range(i + 1)]
    terms = np.column_stack([pose, *pairs])
    by_pose = remainder.likelihood.own[:, :, :6]
    columns = by_pose[:, :, :, None] * terms[:, None, None, :]
    return remainder.test(REFERENCE, columns.reshape(*by_pose.shape[:2], -1), SEATING_OWN_SHARE)


# ---- something that was loose: a step at a time that nobody knows

#: A step has at least this number of samples on both sides.
STEP_MARGIN = 8
#: A slow drift is a polynomial of this degree over the run; what follows it better is no step.
DRIFT_DEGREE = 5
BEAM, SEAT = "the beam", "the mirror on the reference"


def step_columns(remainder: Remainder) -> dict[str, Floats]:
    """The columns of each thing that may move at once, by mm, rad and shares."""
    count, columns = len(remainder.noise), dict[str, Floats]()
    for k, letter in enumerate(DETECTORS):
        place, gain = np.zeros((count, 9, 2)), np.zeros((count, 9, 1))
        for m in (0, 1):
            place[:, 3 * k + m, m] = 1 / remainder.noise[:, 3 * k + m]
        gain[:, 3 * k + 2, 0] = remainder.light[:, k]
        columns[f"detector {letter.upper()}"] = place
        columns[f"the gain of detector {letter.upper()}"] = gain
    by_own = remainder.likelihood.own / OWN_UNITS
    columns[SEAT], columns[BEAM] = by_own[:, :, :6], by_own[:, :, 7:]
    return columns


@one_thread
def find_changes(remainder: Remainder) -> list[Trace]:
    """Steps and slow drifts that the residuals follow beyond chance; the likeliest first."""
    if len(remainder.noise) < 4 * STEP_MARGIN:
        return []
    time = np.linspace(-1, 1, len(remainder.noise))
    slow = np.polynomial.legendre.legvander(time, DRIFT_DEGREE)[:, 1:]
    traces = list[Trace]()
    for cause, columns in step_columns(remainder).items():
        drifts = (columns[:, :, :, None] * slow[:, None, None, :]).reshape(*columns.shape[:2], -1)
        traces += [remainder.test_steps(cause, columns), remainder.test(cause, drifts)]
    beyond = [trace for trace in traces if trace.log_chance < np.log(LEAST_CHANCE)]
    return sorted(beyond, key=lambda trace: trace.log_chance)


def find_steps(remainder: Remainder) -> list[Trace]:
    """Steps, the likeliest first; none where a slow drift explains the residuals better."""
    changes = find_changes(remainder)
    return [trace for trace in changes if trace.at] if changes and changes[0].at else []


def undo_step(data: Data, step: Trace, first: int) -> Data:
    """Samples as if a step had not been: those from a row's number on are moved back."""
    rows: NDArray[np.bool_] = row_numbers(data) >= first
    raw, pose, beam = data.raw.copy(), data.pose.copy(), data.beam.copy()
    if step.cause == SEAT:
        pose[rows] += step.amounts
    elif step.cause == BEAM:
        beam[rows] += step.amounts
    else:
        k = DETECTORS.index(step.cause[-1].lower())
        if "gain" in step.cause:
            raw[rows, 3 * k + 2] /= 1 + step.amounts[0]
        else:
            raw[rows, 3 * k : 3 * k + 2] -= step.amounts
    return data._replace(raw=raw, pose=pose, beam=beam)


# ---- all of it


class Unmodelled(NamedTuple):
    """What the residuals of a fit follow that it has no unknowns for.

    light: causes in the light, the likeliest first.  reference: errors of the reference, tested on
    the same residuals.  powers: the median of a power over its standard deviation.  changes: steps
    and drifts, the likeliest first.  rows: the samples' numbers.
    """

    light: list[Trace]
    reference: Trace
    powers: float
    changes: list[Trace]
    rows: NDArray[np.int64]

    @property
    def shape(self) -> Trace:
        """The general test: of powers by polynomials of x and y."""
        return next(trace for trace in self.light if trace.cause == SHAPE)


@one_thread
def find_causes(remainder: Remainder) -> Unmodelled:
    """Test the causes that a fit has no unknowns for on its residuals."""
    light = list[Trace]()
    for test in LIGHT_TESTS:
        try:
            light.append(test(remainder))
        except InputError:
            continue
    powers = remainder.light[remainder.light > 0]
    return Unmodelled(
        sorted(light, key=lambda trace: trace.log_chance),
        reference_errors(remainder),
        float(np.median(powers)) if powers.size else 1.0,
        find_changes(remainder),
        row_numbers(remainder.data),
    )
