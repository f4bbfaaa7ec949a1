"""The damped Gauss-Newton iteration behind `facets.solve`: one step over numbers of any kind.

No branch depends on a number, so that the same text works for floats and for numbers that write
code. A loop (in `block_code`, and in `solver.js` of a rig's page) calls `step` until the status is
no longer GOING; a step from an ended state changes nothing.

The unknowns are the eight components of the state and the beam's power; `free` lists the unknowns
that are estimated. A step of the beam's position moves the mirror by the same amount, so that the
beam's position and the mirror's position in the beam are nearly uncorrelated and the equations lose
no digits. Every row is in units of its standard deviation: the sum of squares is a chi-square.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import inf
from typing import Any, NamedTuple

from ..optics.forward import Geometry, power_derivative
from ..scalars import linear_algebra
from ..scalars.dispatch import select, select_each, sqrt
from .problem import (
    AMBIGUOUS,
    CONVERGED,
    MAX_COST_FRACTION,
    MAX_DAMPING,
    MAX_DARK_STEPS,
    MAX_STEPS,
    NEGLIGIBLE_GAIN,
    NO_LIGHT,
    NON_FINITE,
    OUT_OF_RANGE,
    PROGRESS_INTERVAL_STEPS,
    SINGULAR,
    STALLED,
    UNCHECKED,
    Form,
    Scales,
)

#: The status of an estimate that has not ended.
GOING = -1
#: The damping after the first refused step, the factor by which it changes from step to step, and
#: the value below which it becomes zero.
FIRST_DAMPING, DAMPING_FACTOR, MIN_DAMPING = 1e-3, 10, 1e-6
#: A sum of squares above this is an overflow.
HUGE = 1e300

#: Function that computes each detector's reading at a state with the power (9,), and derivatives of
#: each of its numbers by the free unknowns.
Linearise = Callable[[Sequence[Any]], Sequence[tuple[Sequence[Any], Sequence[Sequence[Any]]]]]


class WeightedReading(NamedTuple):
    """A reading with its weights and prior means.

    values: (9,) mm and mW.  weights: (9,) 1/sigma; 0 for a detector that is excluded.  means: (3,)
    prior means of bx, by, mm, and the power, mW.  scales: the numbers that all readings have in
    common.  small: the sum of squares that rounding of the readings alone can cause.
    """

    form: Form
    values: Sequence[Any]
    weights: Sequence[Any]
    means: Sequence[Any]
    scales: Scales
    small: Any


class State(NamedTuple):
    """The state of an estimate between two steps.

    best: (9,) the state and power with the least sum of squares so far.  trial: (9,) the end of the
    last step, which is the solution if the estimate has converged.  gain: the decrease of the sum
    of squares that the step predicts.  factor: the Cholesky factor of its equations.
    normal, cost, has_dark_detector: the results of `equations` at `best`.  earlier: the sum of
    squares `since` steps ago.  is_singular: 1 if the readings determine no step without damping,
    else 0.  must_reevaluate: 1 if `best` is evaluated next, 0 if `trial` is.
    """

    best: Any
    trial: Any
    gain: Any
    factor: Any
    normal: Any
    cost: Any
    has_dark_detector: Any
    earlier: Any
    since: Any
    damping: Any
    is_singular: Any
    steps: Any
    must_reevaluate: Any
    status: Any


def detector_fault(numbers: Sequence[Any], least_power: Any, usable: Sequence[Any]) -> Any:
    """The fault of a detector's three numbers, as a status; CONVERGED for usable numbers.

    NON_FINITE, NO_LIGHT for a power below `least_power`, or OUT_OF_RANGE for a position past the
    detector's edge or outside its usable area.
    """
    psi, zeta, light = numbers
    inside = (psi >= usable[0]) & (psi <= usable[1]) & (zeta >= usable[2]) & (zeta <= usable[3])
    lit = select(light > least_power, select(inside, CONVERGED, OUT_OF_RANGE), NO_LIGHT)
    finite = (abs(psi) < inf) & (abs(zeta) < inf) & (abs(light) < inf)
    return select(finite, lit, NON_FINITE)


def screen_reading(
    form: Form,
    values: Sequence[Any],
    weights: Sequence[Any],
    means: Sequence[Any],
    scales: Scales,
) -> tuple[WeightedReading, Any, list[Any]]:
    """Weigh a reading and exclude its faulty detectors.

    weights: (9,) the reading's own weights; any numbers if it has none.

    Returns the weighted reading, the status with which its estimate begins, and for each detector 1
    if it takes part, else 0.
    """
    weighed: list[Any] = []
    used: list[Any] = []
    fault: Any = inf
    checks, small = scales.checks, NEGLIGIBLE_GAIN
    noise, has_own_weights = scales.noise, scales.weighed > 0
    for k in range(3):
        numbers = values[3 * k : 3 * k + 3]
        detector_status = detector_fault(numbers, scales.light[0][k], scales.usable[k])
        sound = detector_status < 0.5
        used.append(select(sound, 1.0, 0.0))
        detector_status = select(sound, inf, detector_status)
        fault = select(detector_status < fault, detector_status, fault)
        checks = checks + 3 * used[k]
        position = numbers[2] / (noise[0] * noise[1])
        for i, default in enumerate((position, position, 1 / noise[2])):
            weight = select(has_own_weights, weights[3 * k + i], default)
            if i == 2 and k == 2:
                weight = select(scales.eight > 0, 0.0, weight)
            weighed.append(select(sound, weight, 0.0))
        shift, change = scales.rounding[0] * weighed[-3], scales.rounding[1] * weighed[-1]
        small = small + 2 * (shift * shift) + change * change
    status = select((fault > AMBIGUOUS) | (checks > -0.5), GOING, fault)
    has_no_checks = (checks < 0.5) & (checks > -0.5) & (scales.accepts < 0.5)
    status = select(has_no_checks, UNCHECKED, status)
    return WeightedReading(form, values, weighed, means, scales, small), status, used


def first_state(start: Sequence[Any], form: Form, status: Any) -> State:
    """The state before the first step."""
    size, best, zero = len(form.free), tuple(start), 0.0
    triangle = tuple(tuple(zero for _ in range(i + 1)) for i in range(size))
    return State(
        best=best, trial=best, gain=zero, factor=triangle,
        normal=(triangle, tuple(zero for _ in triangle)) if form.keeps_equations else (),
        cost=zero, has_dark_detector=zero, earlier=zero, since=zero, damping=zero,
        is_singular=zero, steps=zero, must_reevaluate=1.0, status=status,
    )  # fmt: skip


def unknown_slopes(vectors: Geometry, detectors: Any, free: Sequence[int]) -> Any:
    """The detectors' readings with their derivatives by the free unknowns.

    detectors: the readings with their derivatives by the state. Derivatives by the beam's position
    are for a common motion of beam and mirror.
    """
    detectors_slopes: list[Any] = []
    for k, (values, derivatives) in enumerate(detectors):
        rows = []
        for i, row in enumerate(derivatives):
            slopes = [row[c] + row[c - 6] if c > 5 else row[c] for c in free if c < 8]
            if 8 in free:
                slopes.append(power_derivative(vectors, values, k, i))
            rows.append(slopes)
        detectors_slopes.append((values, rows))
    return detectors_slopes


def equations(
    x: Sequence[Any], reading: WeightedReading, linearise: Linearise
) -> tuple[Any, Any, Any]:
    """The normal equations at a state: J'J with J'r, the sum of squares, and 1 if the model has no
    light on a detector that reads light, else 0."""
    rows: list[Any] = []
    residuals: list[Any] = []
    has_dark: Any = 0.0
    for k, (values, derivatives) in enumerate(linearise(x)):
        used = reading.weights[3 * k] > 0
        is_lit = values[2] > reading.scales.light[1][k]
        has_dark = select(used, select(is_lit, has_dark, 1.0), has_dark)
        for i, (value, row) in enumerate(zip(values, derivatives, strict=True), 3 * k):
            weight = reading.weights[i]
            rows.append([select(used, weight * slope, 0.0) for slope in row])
            residuals.append(select(used, weight * (reading.values[i] - value), 0.0))
    matrix, right = linear_algebra.normal_equations([*zip(*rows, strict=True)], residuals)
    cost: Any = 0.0
    for residual in residuals:
        cost = cost + residual * residual
    for j, c in enumerate(reading.form.free):
        if c > 5:
            weight = reading.scales.weight[c - 6]
            residual = weight * (reading.means[c - 6] - x[c])
            matrix[j][j] = matrix[j][j] + weight * weight
            right[j] = right[j] + weight * residual
            cost = cost + residual * residual
    return (tuple(tuple(row) for row in matrix), tuple(right)), cost, has_dark


def step(state: State, reading: WeightedReading, linearise: Linearise) -> State:
    """Accept or refuse the trial state, and compute the next one.

    A refused step is repeated from the best state with more damping. If the form does not store the
    equations of the best state, they are first evaluated once more.
    """
    evaluated = select_each(state.must_reevaluate > 0.5, state.best, state.trial)
    normal, cost, has_dark = equations(evaluated, reading, linearise)
    going = ready = state.status < CONVERGED
    judged, better = compare_with_best(state, evaluated, cost, has_dark, reading)
    if reading.form.keeps_equations:
        normal = select_each(better, normal, state.normal)
        judged = judged._replace(normal=normal)
    else:
        ready = better
    return propose_step(count_step(judged, ready & going, reading), ready, normal, reading)


def compare_with_best(
    state: State, evaluated: Any, cost: Any, has_dark: Any, reading: WeightedReading
) -> tuple[State, Any]:
    """Compare the evaluated state with the best one, and set the damping of the next step.

    An increase of the sum of squares within rounding is accepted; a step after which a detector has
    no light is refused. Returns the state, and whether the evaluated one was accepted.
    """
    going, small, damped = state.status < CONVERGED, reading.small, reading.scales.damped > 0
    accepts_any = (state.steps < 0.5) | (reading.scales.damped < 0.5)
    rise = cost - (state.cost + small)
    within = (rise < 0) | (rise * rise < 4 * state.cost * small)  # cost < (root + root)**2
    keeps_light = (state.has_dark_detector > 0.5) | (has_dark < 0.5)
    better = going & ((accepts_any & (cost < HUGE)) | (within & keeps_light))
    old = state.best, state.cost, state.has_dark_detector
    best, cost, has_dark = select_each(better, (evaluated, cost, has_dark), old)
    fresh = going & (state.must_reevaluate < 0.5)
    less = select(state.damping > MIN_DAMPING, state.damping / DAMPING_FACTOR, 0.0)
    more = select(state.damping > 0, state.damping * DAMPING_FACTOR, FIRST_DAMPING)
    stuck = fresh & damped & (has_dark > 0.5) & (state.steps > MAX_DARK_STEPS - 0.5)
    status = select(state.steps > reading.scales.most_steps - 0.5, MAX_STEPS, GOING)
    status = select(stuck, STALLED, status)
    worse = select(accepts_any, OUT_OF_RANGE, select(state.damping > MAX_DAMPING, STALLED, status))
    judged = state._replace(
        best=best, cost=cost, has_dark_detector=has_dark,
        damping=select(fresh, select(better, less, more), state.damping),
        is_singular=select(fresh & better, 0.0, state.is_singular),
        status=select(going, select(better, status, worse), state.status),
    )  # fmt: skip
    return judged, better


def count_step(state: State, ready: Any, reading: WeightedReading) -> State:
    """Count a step; the status becomes STALLED if the sum of squares has hardly fallen in
    PROGRESS_INTERVAL_STEPS steps."""
    going = ready & (state.status < CONVERGED)
    since = state.since + select(going, 1.0, 0.0)
    due = going & (since > PROGRESS_INTERVAL_STEPS - 0.5)
    earlier = select(state.steps < 0.5, state.cost, state.earlier)
    slow = due & (reading.scales.damped > 0) & (state.cost > MAX_COST_FRACTION * earlier)
    return state._replace(
        steps=state.steps + select(going, 1.0, 0.0),
        since=select(due, 0.0, since),
        earlier=select(due, state.cost, earlier),
        status=select(slow, STALLED, state.status),
    )


def propose_step(state: State, ready: Any, normal: Any, reading: WeightedReading) -> State:
    """Compute the next step from the best state, unless the estimate ends.

    The estimate ends with a step whose gain is below rounding, unless the damping is the cause of
    the small gain.
    """
    damping, held = state.damping, state.damping > 0
    factor, is_definite = linear_algebra.factorise(normal[0], damping)
    steps, gain = linear_algebra.solution(factor, normal[1])
    trial = list(state.best)
    for c, change in zip(reading.form.free, steps, strict=True):
        trial[c] = trial[c] + change
        if c in (6, 7):
            trial[c - 6] = trial[c - 6] + change
    going = ready & (state.status < CONVERGED)
    short = gain < reading.small
    last = select(held, select(state.is_singular > 0.5, SINGULAR, GOING), CONVERGED)
    lost = select(held | (reading.scales.damped < 0.5), SINGULAR, GOING)
    shortened = select(is_definite, select(short, 0.0, damping), FIRST_DAMPING)
    return state._replace(
        trial=tuple(trial),
        gain=gain,
        factor=factor,
        damping=select(going, shortened, damping),
        is_singular=select(going, select(is_definite, state.is_singular, 1.0), state.is_singular),
        must_reevaluate=select(going & is_definite, select(short, 1.0, 0.0), 1.0),
        status=select(going, select(is_definite, select(short, last, GOING), lost), state.status),
    )


def redundancy_of(end: State, reading: WeightedReading, used: Sequence[Any]) -> Any:
    """The redundancy at a converged state: the number of readings, plus the fraction of beam and
    power that the priors determine, minus the number of unknowns."""
    free = reading.form.free
    redundancy = 3 * (used[0] + used[1] + used[2]) - reading.scales.eight - len(free)
    variances = linear_algebra.inverse([row[6:] for row in end.factor[6:]])
    for j, c in enumerate(free[6:]):
        weight = reading.scales.weight[c - 6]
        redundancy = redundancy + weight * weight * variances[j][j]
    return redundancy


def final_status(end: State, reading: WeightedReading, used: Sequence[Any]) -> Any:
    """The status of an estimate that has ended; UNCHECKED if it converged with hardly any
    redundancy."""
    if len(reading.form.free) == 6:
        return end.status
    unchecked = redundancy_of(end, reading, used) < reading.scales.least_redundancy
    return select((end.status < 0.5) & (end.status > -0.5) & unchecked, UNCHECKED, end.status)


def residual_of(end: State) -> Any:
    """The residual of a state that has converged, in standard deviations."""
    remaining = end.cost - end.gain
    return sqrt(select(remaining > 0, remaining, 0.0))


def covariance_of(factor: linear_algebra.Triangle, free: Sequence[int]) -> list[list[Any]]:
    """The covariance (8, 8) of the state, from the factor of the equations of the free unknowns."""
    steps = linear_algebra.inverse(factor)
    covariance = [[0.0 for _ in range(8)] for _ in range(8)]
    for i, a in enumerate(free):
        for j, b in enumerate(free):
            if max(a, b) < 8:
                covariance[a][b] = steps[i][j]
    if 6 in free:  # The mirror's position is the sum of its position in the beam and the beam's.
        for c in (6, 7):
            for b in range(8):
                covariance[c - 6][b] = covariance[c - 6][b] + covariance[c][b]
            for a in range(8):
                covariance[a][c - 6] = covariance[a][c - 6] + covariance[a][c]
    return covariance
