"""Withdraw converged poses with a cut spot or a second solution; seek unlikely ones anew.

Only sensors that can have such poses take time for this. The centroid of a spot that is cut by the
detector's edge hardly moves with the spot, so that the stated uncertainty is wrong. And where the
determinant of Eq. (11) changes its sign between states that the sensor can be in, the readings
fold, and states on both sides of the fold read the same.
"""

from __future__ import annotations

from collections.abc import Callable
from math import hypot

import numpy as np
from numpy.typing import NDArray

from ..core.names import FINE_UNITS
from ..core.sensor import Sensor
from ..core.units import Floats
from ..detectors.noise import standard_deviations
from ..model.arrays import derivatives, margins, readings
from .plan import Chance, Plan
from .problem import AMBIGUOUS, CONVERGED, OUT_OF_RANGE, Results, put_rows
from .uncertainty import propagate

Rows = NDArray[np.intp]
#: Estimates some rows anew from states (n, 9).
Again = Callable[[Rows, Floats], Results]

#: States on which the determinant's sign is looked at.
SAMPLE_COUNT = 128
#: Poses that are looked at together: about 30 kB each.
PART = 1000
#: Of the smallest beam diameter: how far the apex then is off the beam along x and y, and the beam
#: off its place.
OFFSET_SHARE = 0.3
#: Distances at which the fold is looked for, of the longest component of the direction, um or urad.
DISTANCES = np.geomspace(10, 1e5, 25)
#: Where the other solution is looked for: in distances of the fold.
START_DISTANCES = (2.0, 1.3, 4.0)
#: Solutions farther apart than this are two, in standard uncertainties.
SEPARATE_SIGMAS = 3.0
#: A fold nearer than this, in standard uncertainties: the other solution is about twice as far, and
#: between them hardly any step of the estimate finds its way.
NEAR = 5.0


#: Steps of an estimate above which, and share of the residual's limit above which a pose under real
#: light may be a wrong minimum; a right one is reached in fewer steps.
WANDERED, LEAST_RESIDUAL = 12, 0.7
#: How far from such a pose another one is sought, in standard uncertainties.
OTHER_START = 15.0
#: Share of its residual below which the other pose replaces it.
CLEARLY_LESS = 0.7


def are_unlikely(results: Results, limits: Floats) -> NDArray[np.bool_]:
    """Whether each pose under real light may be a wrong minimum, though its residual is within its
    limit (n,)."""
    residuals = results.residuals
    unlikely: NDArray[np.bool_] = (
        (results.status == CONVERGED)
        & (results.steps > WANDERED)
        & (residuals > LEAST_RESIDUAL * limits)
        & (residuals <= limits)
    )
    return unlikely


def replace_unlikely(
    sensor: Sensor, plan: Plan, chance: Chance, results: Results, again: Again
) -> None:
    """Replace unlikely poses by those with a clearly lower residual that estimates find from both
    sides, along the direction that the readings determine least.

    Under real light the least squares of a small beam have other minima than the right one.
    """
    rows = np.flatnonzero(are_unlikely(results, chance.limits(chance.checks(results.used))))
    if not len(rows):
        return
    free, here = plan.free[plan.free < 8], results.states[rows]
    spread = propagate(sensor, None, here[:, :8].copy(), results.used[rows], plan)
    covariance = spread.statistical[:, free[:, None], free]
    size = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    _, directions = np.linalg.eigh(covariance / size[:, :, None] / size[:, None, :])
    for side in (OTHER_START, -OTHER_START):
        start = here.copy()
        start[:, free] += side * size * directions[:, :, -1]
        other = again(rows, start)
        better = other.residuals < CLEARLY_LESS * results.residuals[rows]
        put_rows(results, rows[better], Results(*(part[better] for part in other)))


def is_doubtful(sensor: Sensor, free: NDArray[np.int64]) -> bool:
    """Whether a sensor can have poses to withdraw.  free: numbers of the unknowns."""
    return sensor.apertures.detectors or (6 in free and has_fold(sensor))


def has_fold(sensor: Sensor) -> bool:
    """Whether the determinant of Eq. (11) has both signs where nothing cuts the light; found once
    a sensor."""
    kept: bool | None = sensor.__dict__.get("_has_fold")
    if kept is None:
        bare = Sensor(beam=sensor.beam, facets=sensor.facets, psds=sensor.psds)
        signs = determinant_signs(bare, sample_states(sensor))
        kept = sensor.__dict__["_has_fold"] = bool((signs < 0).any() and (signs > 0).any())
    return kept


def sample_states(sensor: Sensor) -> Floats:
    """States (n, 8) about rest, as far as spots can go on their detectors; always the same."""
    states: Floats = np.array(sample_sizes(sensor)) * unit_samples()
    states[:, :2] += states[:, 6:]
    return states


def unit_samples() -> Floats:
    return np.random.default_rng(1).uniform(-1, 1, (SAMPLE_COUNT, 8))


def sample_sizes(sensor: Sensor) -> tuple[float, ...]:
    """Half widths of the states on which the determinant's sign is looked at; mm and rad."""
    half = min(min(psd.size_y, psd.size_z) / 2 for psd in sensor.psds)
    distance = max(hypot(psd.radius, psd.height) for psd in sensor.psds)
    across = OFFSET_SHARE * min(sensor.beam.diameter_x, sensor.beam.diameter_y)
    turn = half / (2 * distance)
    return (across, across, half, turn, turn, turn, across, across)


def determinant_signs(sensor: Sensor, states: Floats) -> Floats:
    """The sign of the determinant of Eq. (11), without the last power, at states (n, 8); 0 where a
    detector has no light."""
    matrices = derivatives(sensor, states)[:, :8]
    lit = np.isfinite(matrices).all(axis=(1, 2))
    signs = np.zeros(len(states))
    signs[lit] = np.linalg.slogdet(matrices[lit])[0]
    return signs


def withdraw_doubtful(
    sensor: Sensor, free: NDArray[np.int64], chance: Chance, results: Results, again: Again
) -> None:
    """Give converged poses that cannot be trusted a status, and NaN."""
    if sensor.apertures.detectors:
        refuse(results, cut_spots(sensor, results), OUT_OF_RANGE)
    if 6 in free and has_fold(sensor):
        refuse(results, second_solutions(sensor, chance, results, again), AMBIGUOUS)


def refuse(results: Results, rows: Rows, status: int) -> None:
    results.status[rows] = status
    results.states[rows] = results.residuals[rows] = results.covariances[rows] = np.nan


def cut_spots(sensor: Sensor, results: Results) -> Rows:
    """The poses with a used spot that reaches past its detector's edge."""
    rows = np.flatnonzero(results.status == CONVERGED)
    inside = (margins(sensor, results.states[rows, :8].copy())[..., :4] >= 0).all(axis=2)
    cut: NDArray[np.bool_] = (results.used[rows] & ~inside).any(axis=1)
    return rows[cut]


def second_solutions(sensor: Sensor, chance: Chance, results: Results, again: Again) -> Rows:
    """The poses with a second solution whose residual is within chance."""
    rows = np.flatnonzero((results.status == CONVERGED) & results.used.all(axis=1))
    parts = [rows[first : first + PART] for first in range(0, len(rows), PART)]
    doubtful = [second_solutions_of(sensor, chance, results, part, again) for part in parts]
    return np.concatenate([rows[:0], *doubtful])


def second_solutions_of(
    sensor: Sensor, chance: Chance, results: Results, rows: Rows, again: Again
) -> Rows:
    """The poses among some `rows` with a second solution; see `second_solutions`."""
    here = results.states[rows, :8].copy()
    sigmas = standard_deviations(sensor, readings(sensor, here))
    matrices = derivatives(sensor, here) * FINE_UNITS / sigmas[:, :, None]
    _, values, directions = np.linalg.svd(np.nan_to_num(matrices))
    weakest, answer = directions[:, -1], values[:, -1]
    largest = np.abs(weakest).max(axis=1, keepdims=True)
    step = weakest / largest * FINE_UNITS
    doubtful = np.zeros(len(rows), bool)
    for side in (1.0, -1.0):
        fold = side * fold_distance(sensor, here, side * step)
        lost = np.isfinite(fold)
        doubtful |= np.abs(fold) * answer / largest[:, 0] < NEAR
        for share in START_DISTANCES:
            some = np.flatnonzero(np.isfinite(fold) & ~doubtful)
            if not len(some):
                break
            start = results.states[rows[some]].copy()
            start[:, :8] += share * fold[some, None] * step[some]
            other = again(rows[some], start)
            off = (other.states[:, :8] - here[some]) / FINE_UNITS
            apart = np.abs((off * weakest[some]).sum(axis=1)) * answer[some]
            doubtful[some] = (other.residuals <= chance.limit) & (apart > SEPARATE_SIGMAS)
            lost[some] &= np.isnan(other.residuals)
        doubtful |= lost  # no estimate from there ends: nothing tells that there is no other
    return rows[doubtful]


def fold_distance(sensor: Sensor, states: Floats, direction: Floats) -> Floats:
    """The distance along a direction at which the determinant's sign changes (n,); NaN if it does
    not."""
    line = states[:, None] + DISTANCES[:, None] * direction[:, None]
    there = determinant_signs(sensor, line.reshape(-1, 8)).reshape(len(states), -1)
    changed = there * determinant_signs(sensor, states)[:, None] < 0
    first = DISTANCES[changed.argmax(axis=1)]
    return np.where(changed.any(axis=1), first, np.nan)
