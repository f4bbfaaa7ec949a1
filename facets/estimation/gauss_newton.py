"""One reading, one estimate: the damped Gauss-Newton iteration behind `facets.solve`.

Text for `kernels`, which compiles it; it runs as plain Python too. The unknowns are the eight
components of the state and the beam's power; `free` lists those that are asked for. Every row is in
units of its standard deviation, so that the sum of squares is a chi-square.
"""

from __future__ import annotations

from math import isfinite
from typing import Any, NamedTuple

from ..optics.detected import linearised
from ..optics.forward import Geometry, by_power, with_power
from .least_squares import back_substitute, covariance_of, triangularise

Array = Any

CONVERGED, MAX_STEPS, SINGULAR, OUT_OF_RANGE, NO_LIGHT, NON_FINITE = range(6)

#: Converged when the next step would move the fit by less than this, in sigmas, squared.
SMALL = 1e-12
#: A detector with less light than this, in standard deviations of its power, is left out: the noise
#: of its spot's place, which goes as 1 / power, is then no Gaussian that a weight could stand for.
FAINTEST = 10.0
#: Rounding of a computed reading, relative to the detector's distance or to the power.
ROUNDING = 4e-15
UNKNOWNS = 9
ROWS = 9 + 3 + UNKNOWNS


class Problem(NamedTuple):
    """What is known beside the readings.

    mean, weight: (3,) prior of bx, by (mm) and power (mW), weight = 1/sigma, 0 where there is none.
    free: (n,) numbers of the unknowns that are asked for, ascending.
    damped: whether a step that does not help is shortened (Levenberg-Marquardt), or accepted.
    """

    mean: Array
    weight: Array
    free: Array
    max_steps: int
    damped: bool


class Limits(NamedTuple):
    """What a reading is judged by.

    noise: (3,) a centroid's sigma (mm) at a power (mW), and a power's sigma (mW).
    half_sizes: (3, 2) of the detectors' sensitive areas, mm.  eight: leave out the last power.
    """

    noise: Array
    half_sizes: Array
    eight: bool


class Room(NamedTuple):
    """Memory that every estimate of a batch uses again."""

    here: Array
    there: Array
    work: Array
    step: Array
    trial: Array
    inverse: Array
    outlines: Array


def judge(values: Array, limits: Limits, weights: Array, used: Array) -> int:
    """Fills weights (9,) = 1/sigma and used (3,) for one reading; returns what is wrong, if any.

    A detector is left out, with weight 0, where a number of it is not finite, where its power is
    under FAINTEST sigmas of the noise, and where its place is past its edge, where there can be
    no light.
    """
    status = CONVERGED
    for k in range(3):
        psi, zeta, power = values[3 * k], values[3 * k + 1], values[3 * k + 2]
        fault = CONVERGED
        if not (isfinite(psi) and isfinite(zeta) and isfinite(power)):
            fault = NON_FINITE
        elif not power > FAINTEST * limits.noise[2]:
            fault = NO_LIGHT
        elif abs(psi) > limits.half_sizes[k, 0] or abs(zeta) > limits.half_sizes[k, 1]:
            fault = OUT_OF_RANGE
        used[k] = fault == CONVERGED
        place = power / (limits.noise[0] * limits.noise[1]) if used[k] else 0.0
        weights[3 * k] = weights[3 * k + 1] = place
        weights[3 * k + 2] = 1 / limits.noise[2] if used[k] else 0.0
        if fault != CONVERGED and (status == CONVERGED or fault < status):
            status = fault
    if limits.eight:
        weights[8] = 0.0
    return status


def enough(used: Array, problem: Problem, eight: bool) -> bool:
    """Whether the detectors left and the priors are as many as the unknowns."""
    rows = -1 if eight else 0
    for k in range(3):
        rows += 3 if used[k] else 0
    for c in problem.free:
        if c >= 6 and problem.weight[c - 6] > 0:
            rows += 1
    return rows >= len(problem.free)


def evaluate(
    sensor: Geometry,
    x: Array,
    values: Array,
    weights: Array,
    problem: Problem,
    matrix: Array,
    outlines: Array,
) -> tuple[float, int]:
    """Fills weighted Jacobian and residuals at x; returns their sum of squares and the row count.

    x: (9,) state and power.  values, weights: (9,) reading and 1/sigma; 0 leaves a reading out.
    outlines: memory, see `optics.detected`.
    """
    columns = len(problem.free)
    sensor = with_power(sensor, x[8])
    state = (x[0], x[1], x[2], x[3], x[4], x[5], x[6], x[7])
    detectors = linearised(sensor, state, outlines)
    total = 0.0
    row = 0
    for k in range(3):
        computed, derivatives = detectors[k]
        for i in range(3):
            weight = weights[3 * k + i]
            if not weight > 0:
                continue
            derivative = derivatives[i]
            for j in range(columns):
                c = problem.free[j]
                if c < 8:
                    matrix[row, j] = weight * derivative[c]
                else:
                    matrix[row, j] = weight * by_power(sensor, computed, k, i)
            rest = weight * (values[3 * k + i] - computed[i])
            matrix[row, columns] = rest
            total += rest * rest
            row += 1
    for j in range(columns):
        c = problem.free[j]
        if c < 6 or not problem.weight[c - 6] > 0:
            continue
        for i in range(columns):
            matrix[row, i] = 0.0
        matrix[row, j] = problem.weight[c - 6]
        rest = problem.weight[c - 6] * (problem.mean[c - 6] - x[c])
        matrix[row, columns] = rest
        total += rest * rest
        row += 1
    return total, row


def damp(matrix: Array, work: Array, rows: int, columns: int, damping: float) -> int:
    """Copies `matrix` to `work` and adds a row for each unknown that holds it back."""
    for i in range(rows):
        for j in range(columns + 1):
            work[i, j] = matrix[i, j]
    if damping == 0:
        return rows
    for j in range(columns):
        square = 0.0
        for i in range(rows):
            square += matrix[i, j] * matrix[i, j]
        for i in range(columns + 1):
            work[rows + j, i] = 0.0
        work[rows + j, j] = (damping * square) ** 0.5
    return rows + columns


def rounding_floor(sensor: Geometry, weights: Array) -> float:
    """The sum of squares that rounding of the readings alone can make."""
    total = SMALL
    for k in range(3):
        centre = sensor.centres[k]
        distance2 = centre[0] * centre[0] + centre[1] * centre[1] + centre[2] * centre[2]
        square = weights[3 * k] ** 2 + weights[3 * k + 1] ** 2
        total += ROUNDING * ROUNDING * square * distance2
        total += (ROUNDING * weights[3 * k + 2] * sensor.power) ** 2
    return total


def estimate(
    sensor: Geometry,
    x: Array,
    values: Array,
    weights: Array,
    problem: Problem,
    room: Room,
    covariance: Array,
) -> tuple[int, int, float]:
    """Improves x (9,) in place until the weighted sum of squares is least.

    Returns (status, steps, sum of squares left). covariance: (9, 9), of the free unknowns, in the
    order of `free`; may be empty, and is then not computed. On failure x is not to be used.
    """
    columns = len(problem.free)
    here, there = room.here, room.there
    small = rounding_floor(sensor, weights)
    cost, rows = evaluate(sensor, x, values, weights, problem, here, room.outlines)
    if not cost < 1e300:
        return OUT_OF_RANGE, 0, cost
    damping = 0.0
    for steps in range(1, problem.max_steps + 1):
        high = damp(here, room.work, rows, columns, damping)
        if not triangularise(room.work, high, columns):
            if not problem.damped or damping > 0:
                return SINGULAR, steps, cost
            damping = 1e-3
            continue
        back_substitute(room.work, columns, room.step)
        gain = 0.0
        for j in range(columns):
            gain += room.work[j, columns] ** 2
        if gain < small and damping > 0:  # held back by the damping, not arrived
            damping = 0.0
            continue
        for c in range(UNKNOWNS):
            room.trial[c] = x[c]
        for j in range(columns):
            room.trial[problem.free[j]] += room.step[j]
        if gain < small:
            for c in range(UNKNOWNS):
                x[c] = room.trial[c]
            if len(covariance) > 0:
                covariance_of(room.work, columns, room.inverse, covariance)
            return CONVERGED, steps, max(cost - gain, 0.0)
        trial_cost, _ = evaluate(sensor, room.trial, values, weights, problem, there, room.outlines)
        # a step that changes no more than rounding can is no worse
        slack = small + 2 * (cost * small) ** 0.5
        if trial_cost < cost + slack or (not problem.damped and trial_cost < 1e300):
            for c in range(UNKNOWNS):
                x[c] = room.trial[c]
            here, there = there, here
            cost = trial_cost
            damping = damping / 10 if damping > 1e-6 else 0.0
        elif not problem.damped:
            return OUT_OF_RANGE, steps, cost
        elif damping > 1e12:
            break
        else:
            damping = 10 * damping if damping > 0 else 1e-3
    return MAX_STEPS, problem.max_steps, cost
