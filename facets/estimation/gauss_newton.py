"""One reading, one estimate: the damped Gauss-Newton iteration of `step`, with loops and arrays.

The page of a rig runs it, as JavaScript. The unknowns are the eight components of the state and the
beam's power; `free` lists those that are asked for. Every row is in units of its standard
deviation, so that the sum of squares is a chi-square.

A step of the beam's place takes the mirror along: what the readings tell of it then hardly depends
on what they tell of the mirror's place in the beam, and the equations keep their digits.

A step solves the normal equations J'J step = J'r by Cholesky's method. Where a pivot tells that no
digits are left (`normal_equations.factorise`), the readings do not tell the step.
"""

from __future__ import annotations

from math import isfinite, nan, sqrt

from .normal_equations import LAST, covariance_of, factorise, multiply, solve_cholesky
from .problem import (
    COLUMNS,
    CONVERGED,
    COVARIANCE,
    FACTOR,
    FOUND,
    HERE,
    INVERSE,
    MAX_COST_SHARE,
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
    THERE,
    TRIAL,
    UNCHECKED,
    UNKNOWNS,
    VECTORS,
    WEIGHTS,
    Array,
    CompiledModel,
    FitProblem,
    Readings,
    Results,
    ScreeningLimits,
    Workspace,
)

#: What to do with a step, beside the statuses with which an estimate ends: see `check_gain`.
TRY, REDAMP = -1, -2


def evaluate_model(model: CompiledModel, x: Array, found: Array, outlines: Array) -> None:
    """Fills found (10, 10) at x (9,), a state and the power, as the page does.

    In text the model's address is a function.
    """
    model.address(x, found)


def detector_fault(k: int, psi: float, zeta: float, power: float, limits: ScreeningLimits) -> int:
    """What is wrong with the numbers of a detector; CONVERGED where nothing is.

    They are not finite, the power is under the least that counts, or the place is past the edge,
    where there can be no light.
    """
    if not (isfinite(psi) and isfinite(zeta) and isfinite(power)):
        return NON_FINITE
    if not power > limits.light[0, k]:
        return NO_LIGHT
    if abs(psi) > limits.half_sizes[k, 0] or abs(zeta) > limits.half_sizes[k, 1]:
        return OUT_OF_RANGE
    return CONVERGED


def screen_reading(values: Array, limits: ScreeningLimits, weights: Array, used: Array) -> int:
    """Fill weights (9,) = 1/sigma and used (3,) for one reading; return the fault, if any.

    A detector with a fault is left out, with weight 0.
    """
    status = CONVERGED
    for k in range(3):
        power = values[3 * k + 2]
        fault = detector_fault(k, values[3 * k], values[3 * k + 1], power, limits)
        used[k] = fault == CONVERGED
        place = power / (limits.noise[0] * limits.noise[1]) if used[k] else 0.0
        weights[3 * k] = weights[3 * k + 1] = place
        weights[3 * k + 2] = 1 / limits.noise[2] if used[k] else 0.0
        if fault != CONVERGED and (status == CONVERGED or fault < status):
            status = fault
    if limits.eight:
        weights[8] = 0.0
    return status


def count_checks(used: Array, problem: FitProblem, eight: bool) -> int:
    """The number of readings of the used detectors and priors in excess of the unknowns."""
    rows = -1 if eight else 0
    for k in range(3):
        rows += 3 if used[k] else 0
    for c in problem.free:
        if c >= 6 and problem.weight[c - 6] > 0:
            rows += 1
    return rows - len(problem.free)


def slope_by(found: Array, row: int, c: int) -> float:
    """The derivative of a reading by an unknown; the beam's place takes the mirror along."""
    if c == 6 or c == 7:
        return found[1 + row, c] + found[1 + row, c - 6]  # type: ignore[no-any-return]
    return found[1 + row, c]  # type: ignore[no-any-return]


def weigh_columns(values: Array, free: Array, layers: Array) -> float:
    """Fills the layer COLUMNS from FOUND; returns the sum of squares of the residuals.

    A reading with weight 0 is left out: its numbers are zero.
    """
    total = 0.0
    for row in range(9):
        weight = layers[VECTORS, WEIGHTS, row]
        residual = 0.0
        if weight > 0:
            residual = weight * (values[row] - layers[FOUND, 0, row])
            for j in range(len(free)):
                layers[COLUMNS, j, row] = weight * slope_by(layers[FOUND], row, free[j])
        else:
            for j in range(len(free)):
                layers[COLUMNS, j, row] = 0.0
        layers[COLUMNS, LAST, row] = residual
        total += residual * residual
    return total


def is_dark(layers: Array, limits: ScreeningLimits) -> bool:
    """Whether a detector that reads light would have none at this state."""
    for k in range(3):
        lit = layers[FOUND, 0, 3 * k + 2] > limits.light[1, k]
        if layers[VECTORS, WEIGHTS, 3 * k] > 0 and not lit:
            return True
    return False


def evaluate(
    model: CompiledModel,
    x: Array,
    values: Array,
    problem: FitProblem,
    mean: Array,
    memory: Workspace,
    normal: int,
) -> float:
    """Fills a layer's normal equations at x (9,), a state and the power.

    Returns the sum of squares.
    """
    layers = memory.layers
    evaluate_model(model, x, layers[FOUND], memory.outlines)
    total = weigh_columns(values, problem.free, layers)
    columns = len(problem.free)
    multiply(layers, COLUMNS, normal, columns)
    for j in range(columns):
        c = problem.free[j]
        if c >= 6 and problem.weight[c - 6] > 0:
            weight = problem.weight[c - 6]
            residual = weight * (mean[c - 6] - x[c])
            layers[normal, j, j] += weight * weight
            layers[normal, LAST, j] += weight * residual
            total += residual * residual
    return total


def rounding_floor(limits: ScreeningLimits, weights: Array) -> float:
    """The sum of squares that rounding of the readings alone can make."""
    total = NEGLIGIBLE_GAIN
    for k in range(3):
        total += 2 * (limits.rounding[0] * weights[3 * k]) ** 2
        total += (limits.rounding[1] * weights[3 * k + 2]) ** 2
    return total


def check_gain(gain: float, small: float, damping: float, is_blind: bool, is_damped: bool) -> int:
    """Decide on a step: TRY it, change the damping first (REDAMP), or end.

    It is the last one (CONVERGED) where it changes less than rounding can, unless the damping alone
    has made it so short. is_blind: without damping the readings determine no step here.
    """
    if gain < 0:
        return REDAMP if is_damped and damping == 0 else SINGULAR
    if not gain < small:
        return TRY
    if damping == 0:
        return CONVERGED
    return SINGULAR if is_blind else REDAMP


def add_step(x: Array, free: Array, layers: Array, end: Array) -> None:
    """Fills end (9,) with where the step of the layer FACTOR leads from x (9,)."""
    copy_state(x, end)
    for j in range(len(free)):
        c = free[j]
        end[c] += layers[FACTOR, LAST, j]
        if c == 6 or c == 7:
            end[c - 6] += layers[FACTOR, LAST, j]


def copy_state(source: Array, target: Array) -> None:
    for c in range(UNKNOWNS):
        target[c] = source[c]


def is_accepted(
    trial_cost: float, cost: float, small: float, was_dark: bool, is_dark: bool, is_damped: bool
) -> bool:
    """Whether to accept a step.

    A change within rounding is accepted; a step from light into the dark is not.
    """
    slack = small + 2 * sqrt(cost * small)
    if trial_cost < cost + slack and (was_dark or not is_dark):
        return True
    return not is_damped and trial_cost < 1e300


def change_damping(damping: float, is_better: bool) -> float:
    """Reduce the damping after a step that helped, increase it after another."""
    if is_better:
        return damping / 10 if damping > 1e-6 else 0.0
    return 10 * damping if damping > 0 else 1e-3


def is_slow(cost: float, earlier: float, is_damped: bool) -> bool:
    """Whether the sum of squares has hardly fallen since PROGRESS_INTERVAL_STEPS steps ago."""
    return is_damped and cost > MAX_COST_SHARE * earlier


def is_stuck(dark: bool, steps: int, is_damped: bool) -> bool:
    """Whether an estimate that began in the dark has not found the light in time."""
    return dark and is_damped and steps >= MAX_DARK_STEPS


def estimate(
    model: CompiledModel,
    x: Array,
    values: Array,
    limits: ScreeningLimits,
    problem: FitProblem,
    mean: Array,
    memory: Workspace,
) -> tuple[int, int, float]:
    """Improves x (9,) in place until the weighted sum of squares is least.

    Returns (status, steps, sum of squares at the end). Where converged, the layer FACTOR gives the
    covariance of the free unknowns. On failure x is not to be used.
    """
    layers, damped, columns = memory.layers, problem.damped, len(problem.free)
    trial, here, there = layers[VECTORS, TRIAL], HERE, THERE
    small = rounding_floor(limits, layers[VECTORS, WEIGHTS])
    cost = evaluate(model, x, values, problem, mean, memory, here)
    if not cost < 1e300:
        return OUT_OF_RANGE, 0, cost
    dark = is_dark(layers, limits)
    damping, earlier, blind = 0.0, cost, False
    for steps in range(1, problem.max_steps + 1):
        if steps % PROGRESS_INTERVAL_STEPS == 0:
            if is_slow(cost, earlier, damped):
                return STALLED, steps, cost
            earlier = cost
        gain = -1.0
        if factorise(layers, here, FACTOR, columns, damping):
            gain = solve_cholesky(layers, here, FACTOR, columns)
        action = check_gain(gain, small, damping, blind, damped)
        if action == SINGULAR:
            return SINGULAR, steps, cost
        if action == REDAMP:
            blind = blind or gain < 0
            damping = 1e-3 if gain < 0 else 0.0
            continue
        add_step(x, problem.free, layers, trial)
        if action == CONVERGED:
            copy_state(trial, x)
            return CONVERGED, steps, max(cost - gain, 0.0)
        trial_cost = evaluate(model, trial, values, problem, mean, memory, there)
        into_the_dark = is_dark(layers, limits)
        better = is_accepted(trial_cost, cost, small, dark, into_the_dark, damped)
        if better:
            copy_state(trial, x)
            here, there = there, here
            cost, dark, blind = trial_cost, into_the_dark, False
        elif not damped:
            return OUT_OF_RANGE, steps, cost
        elif damping > MAX_DAMPING:
            return STALLED, steps, cost
        damping = change_damping(damping, better)
        if is_stuck(dark, steps, damped):
            return STALLED, steps, cost
    return MAX_STEPS, problem.max_steps, cost


def set_start(x: Array, near: Array, free: Array, known: Array) -> None:
    """Start x (9,): the unknowns in `free` from `near`, the others from `known`."""
    done = 0
    for c in range(UNKNOWNS):
        if done < len(free) and free[done] == c:
            x[c] = near[c]
            done += 1
        else:
            x[c] = known[c]


def clear_result(results: Results, n: int) -> None:
    """Set the numbers of a failed estimate to NaN."""
    results.residuals[n] = nan
    for c in range(UNKNOWNS):
        results.states[n, c] = nan
    if len(results.covariances) > 0:
        for i in range(8):
            for j in range(8):
                results.covariances[n, i, j] = nan


def apply_sigmas(sigmas: Array, weights: Array) -> None:
    """Weights from standard deviations, for the readings that `screen_reading` took."""
    for i in range(9):
        if weights[i] > 0:
            weights[i] = 1 / sigmas[i]


def put_covariance(layers: Array, free: Array, covariances: Array, n: int) -> None:
    """The covariance of the free unknowns, put at their places in that of the state; the rest of
    it is zero."""
    covariance_of(layers, FACTOR, INVERSE, COVARIANCE, len(free))
    for i in range(8):
        for j in range(8):
            covariances[n, i, j] = 0.0
    for i in range(len(free)):
        for j in range(len(free)):
            if free[i] < 8 and free[j] < 8:
                covariances[n, free[i], free[j]] = layers[COVARIANCE, i, j]
    for c in range(2):  # the mirror's place is that in the beam and the beam's, added
        for j in range(8):
            covariances[n, c, j] += covariances[n, c + 6, j]
        for j in range(8):
            covariances[n, j, c] += covariances[n, j, c + 6]


def estimate_each(
    model: CompiledModel,
    readings: Readings,
    limits: ScreeningLimits,
    problem: FitProblem,
    results: Results,
    memory: Workspace,
) -> None:
    """Estimates the states of `results` from `readings`; see the types in `problem`."""
    free, means, starts = problem.free, problem.means, problem.starts
    weights = memory.layers[VECTORS, WEIGHTS]
    last = -1
    for n in range(len(readings.values)):
        values, x, mean = readings.values[n], results.states[n], means[n % len(means)]
        start = starts[n % len(starts)]
        status = screen_reading(values, limits, weights, results.used[n])
        steps, cost = 0, 0.0
        if len(readings.sigmas) > 0:
            apply_sigmas(readings.sigmas[n], weights)
        checks = count_checks(results.used[n], problem, limits.eight)
        if checks == 0 and not problem.accept_unchecked:
            status = UNCHECKED
        elif status == CONVERGED or checks >= 0:
            warm = problem.previous and last >= 0
            for again in range(2 if warm else 1):  # the last sample may be far: from the start
                set_start(x, results.states[last] if warm and again == 0 else start, free, start)
                status, more, cost = estimate(model, x, values, limits, problem, mean, memory)
                steps += more
                if status == CONVERGED:
                    break
        results.status[n], results.steps[n] = status, steps
        if status == CONVERGED:
            last = n
            results.residuals[n] = sqrt(cost)
            if len(results.covariances) > 0:
                put_covariance(memory.layers, free, results.covariances, n)
        else:
            clear_result(results, n)
