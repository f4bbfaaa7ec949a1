"""Withdraw converged poses with a cut spot or a second solution, and solve unlikely poses again.

Only sensors that can have such poses are examined. The centroid of a spot that the detector's edge
cuts hardly moves with the spot, so that the stated uncertainty would be wrong. If the determinant
of Eq. (11) changes its sign within the range, the readings fold: two states, on opposite sides of
the fold, have the same readings.
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
#: Function that estimates some rows again, from starts (n, 9).
Repeat = Callable[[Rows, Floats], Results]

#: Number of states at which the sign of the determinant is computed.
SAMPLE_COUNT = 128
#: Number of poses that are examined together; each takes about 30 kB.
PART = 1000
#: Largest offset of the apex from the beam, and of the beam from its nominal position, at these
#: states, as a fraction of the smallest beam diameter.
OFFSET_FRACTION = 0.3
#: Distances at which a fold is sought, in the longest component of the direction, um or urad.
DISTANCES = np.geomspace(10, 1e5, 25)
#: Distances at which the search for the other solution starts, relative to the fold's distance.
START_DISTANCES = (2.0, 1.3, 4.0)
#: Two solutions count as different if they differ by more than this, in standard uncertainties.
SEPARATE_SIGMAS = 3.0
#: A pose is ambiguous if a fold is nearer than this, in standard uncertainties: the other solution
#: is then about twice as far, and estimates can hardly separate the two.
NEAREST_FOLD_SIGMAS = 5.0


#: A pose under real light may be a wrong minimum if it took more steps than this, and if its
#: residual is above this fraction of its limit; the right minimum usually takes fewer steps.
UNLIKELY_STEPS, LEAST_RESIDUAL = 12, 0.7
#: Distance from such a pose at which another solution is sought, in standard uncertainties.
OTHER_START_SIGMAS = 15.0
#: The other solution replaces the pose if its residual is below this fraction of the pose's.
CLEARLY_LESS = 0.7


def are_unlikely(results: Results, limits: Floats) -> NDArray[np.bool_]:
    """Whether each pose (n,) under real light may be a wrong minimum, although its residual is
    within its limit (n,)."""
    residuals = results.residuals
    unlikely: NDArray[np.bool_] = (
        (results.status == CONVERGED)
        & (results.steps > UNLIKELY_STEPS)
        & (residuals > LEAST_RESIDUAL * limits)
        & (residuals <= limits)
    )
    return unlikely


def replace_unlikely(
    sensor: Sensor, plan: Plan, chance: Chance, results: Results, repeat: Repeat
) -> None:
    """Replace unlikely poses in `results` by other solutions with a clearly lower residual.

    Under real light the sum of squares of a small beam has several minima. The others are sought on
    both sides of the pose, along the direction that the readings determine least.
    """
    rows = np.flatnonzero(are_unlikely(results, chance.limits(chance.checks(results.used))))
    if not len(rows):
        return
    free, states = plan.free[plan.free < 8], results.states[rows]
    propagation = propagate(sensor, None, states[:, :8].copy(), results.used[rows], plan)
    covariance = propagation.statistical[:, free[:, None], free]
    size = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    _, directions = np.linalg.eigh(covariance / size[:, :, None] / size[:, None, :])
    for distance in (OTHER_START_SIGMAS, -OTHER_START_SIGMAS):
        start = states.copy()
        start[:, free] += distance * size * directions[:, :, -1]
        other = repeat(rows, start)
        better = other.residuals < CLEARLY_LESS * results.residuals[rows]
        put_rows(results, rows[better], Results(*(part[better] for part in other)))


def is_doubtful(sensor: Sensor, free: NDArray[np.int64]) -> bool:
    """Whether a sensor can have poses that must be withdrawn.  free: numbers of the unknowns."""
    return sensor.apertures.detectors or (6 in free and has_fold(sensor))


def has_fold(sensor: Sensor) -> bool:
    """Whether the determinant of Eq. (11) has both signs within the range, for uncut light; cached
    per sensor."""
    folds: bool | None = sensor.__dict__.get("_has_fold")
    if folds is None:
        bare = Sensor(beam=sensor.beam, facets=sensor.facets, psds=sensor.psds)
        signs = determinant_signs(bare, sample_states(sensor))
        folds = sensor.__dict__["_has_fold"] = bool((signs < 0).any() and (signs > 0).any())
    return folds


def sample_states(sensor: Sensor) -> Floats:
    """States (n, 8) about rest, over the range in which spots stay on their detectors; the same in
    each call."""
    states: Floats = np.array(sample_sizes(sensor)) * unit_samples()
    states[:, :2] += states[:, 6:]
    return states


def unit_samples() -> Floats:
    """Random states (n, 8) with components from -1 to 1; the same in each call."""
    return np.random.default_rng(1).uniform(-1, 1, (SAMPLE_COUNT, 8))


def sample_sizes(sensor: Sensor) -> tuple[float, ...]:
    """Half widths (8,) of the box of `sample_states`; mm and rad."""
    half = min(min(psd.size_y, psd.size_z) / 2 for psd in sensor.psds)
    distance = max(hypot(psd.radius, psd.height) for psd in sensor.psds)
    across = OFFSET_FRACTION * min(sensor.beam.diameter_x, sensor.beam.diameter_y)
    turn = half / (2 * distance)
    return (across, across, half, turn, turn, turn, across, across)


def determinant_signs(sensor: Sensor, states: Floats) -> Floats:
    """The sign of the determinant of Eq. (11) at states (n, 8); 0 where a detector has no light.

    The determinant is that of the derivatives of the first eight readings.
    """
    matrices = derivatives(sensor, states)[:, :8]
    lit = np.isfinite(matrices).all(axis=(1, 2))
    signs = np.zeros(len(states))
    signs[lit] = np.linalg.slogdet(matrices[lit])[0]
    return signs


def withdraw_doubtful(
    sensor: Sensor, free: NDArray[np.int64], chance: Chance, results: Results, repeat: Repeat
) -> None:
    """Replace converged poses in `results` that cannot be trusted by NaN and a status."""
    if sensor.apertures.detectors:
        refuse(results, cut_spots(sensor, results), OUT_OF_RANGE)
    if 6 in free and has_fold(sensor):
        refuse(results, second_solutions(sensor, chance, results, repeat), AMBIGUOUS)


def refuse(results: Results, rows: Rows, status: int) -> None:
    """Give rows a status and NaN for their poses."""
    results.status[rows] = status
    results.states[rows] = results.residuals[rows] = results.covariances[rows] = np.nan


def cut_spots(sensor: Sensor, results: Results) -> Rows:
    """The rows of poses with a spot, on a detector that was used, that the edge cuts."""
    rows = np.flatnonzero(results.status == CONVERGED)
    inside = (margins(sensor, results.states[rows, :8].copy())[..., :4] >= 0).all(axis=2)
    cut: NDArray[np.bool_] = (results.used[rows] & ~inside).any(axis=1)
    return rows[cut]


def second_solutions(sensor: Sensor, chance: Chance, results: Results, repeat: Repeat) -> Rows:
    """The rows of poses with a second solution whose residual is within its limit."""
    rows = np.flatnonzero((results.status == CONVERGED) & results.used.all(axis=1))
    parts = [rows[first : first + PART] for first in range(0, len(rows), PART)]
    doubtful = [second_solutions_of(sensor, chance, results, part, repeat) for part in parts]
    return np.concatenate([rows[:0], *doubtful])


def second_solutions_of(
    sensor: Sensor, chance: Chance, results: Results, rows: Rows, repeat: Repeat
) -> Rows:
    """Select from `rows` the poses with a second solution; see `second_solutions`."""
    states = results.states[rows, :8].copy()
    sigmas = standard_deviations(sensor, readings(sensor, states))
    matrices = derivatives(sensor, states) * FINE_UNITS / sigmas[:, :, None]
    _, values, directions = np.linalg.svd(np.nan_to_num(matrices))
    weakest, answer = directions[:, -1], values[:, -1]
    largest = np.abs(weakest).max(axis=1, keepdims=True)
    step = weakest / largest * FINE_UNITS
    doubtful = np.zeros(len(rows), bool)
    for side in (1.0, -1.0):
        fold = side * fold_distance(sensor, states, side * step)
        lost = np.isfinite(fold)
        doubtful |= np.abs(fold) * answer / largest[:, 0] < NEAREST_FOLD_SIGMAS
        for distance in START_DISTANCES:
            open_rows = np.flatnonzero(np.isfinite(fold) & ~doubtful)
            if not len(open_rows):
                break
            start = results.states[rows[open_rows]].copy()
            start[:, :8] += distance * fold[open_rows, None] * step[open_rows]
            other = repeat(rows[open_rows], start)
            difference = (other.states[:, :8] - states[open_rows]) / FINE_UNITS
            separation = np.abs((difference * weakest[open_rows]).sum(axis=1)) * answer[open_rows]
            doubtful[open_rows] = (other.residuals <= chance.limit) & (separation > SEPARATE_SIGMAS)
            lost[open_rows] &= np.isnan(other.residuals)
        doubtful |= lost  # no estimate converged there, so that a second solution is not excluded
    return rows[doubtful]


def fold_distance(sensor: Sensor, states: Floats, direction: Floats) -> Floats:
    """The distances (n,) along directions (n, 8) at which the determinant's sign changes; NaN if it
    does not."""
    line = states[:, None] + DISTANCES[:, None] * direction[:, None]
    signs = determinant_signs(sensor, line.reshape(-1, 8)).reshape(len(states), -1)
    changed = signs * determinant_signs(sensor, states)[:, None] < 0
    first = DISTANCES[changed.argmax(axis=1)]
    return np.where(changed.any(axis=1), first, np.nan)
