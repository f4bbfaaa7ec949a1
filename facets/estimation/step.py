"""The damped Gauss-Newton iteration behind `facets.solve`: one step over numbers of any kind.

No branch depends on a number, so that the text runs over floats as over numbers that write code;
its loop (`block_code`, and `solver.js` of a rig's page) calls `step` until the status ends it. A
step of a state that has ended changes nothing.

The unknowns are the eight components of the state and the beam's power; `free` lists those that are
question for. A step of the beam's place takes the mirror along: what the readings tell of it then
hardly depends on what they tell of the mirror's place in the beam, and the equations keep their
digits. Every row is in units of its standard deviation, so that the sum of squares is a chi-square.
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
    UNCHECKED,
    Form,
    Scales,
)

#: The status of a state that has not ended.
GOING = -1
#: The first damping of a step that does not help, by how much it changes from step to step, and
#: below which it ends.
FIRST_DAMPING, DAMPING_FACTOR, MIN_DAMPING = 1e-3, 10, 1e-6
#: A sum of squares that is none.
HUGE = 1e300

#: Gives for a state and the power (9,) what each detector reads, and the derivatives of each number
#: by the free unknowns.
Linearise = Callable[[Sequence[Any]], Sequence[tuple[Sequence[Any], Sequence[Sequence[Any]]]]]


class WeightedReading(NamedTuple):
    """A reading, and what is asked of it.

    values, weights: (9,) mm, mW and 1/sigma; weights of a detector that is
    left out are 0.  means: (3,) of bx, by and the power.  scales: what all readings share.  small:
    the sum of squares that rounding of the readings alone can make.
    """

    form: Form
    values: Sequence[Any]
    weights: Sequence[Any]
    means: Sequence[Any]
    scales: Scales
    small: Any


class State(NamedTuple):
    """The state of an estimate between two steps.

    here: (9,) the best state and power so far.  end, gain, factor: where the last step leads, the
    solution if it has converged; by how much it lessens the sum of squares; and the factor of its
    equations.  normal, cost, dark: of `equations` here.  earlier: the sum of squares `since`
    steps ago.  blind: 1 where without damping the readings determine no step.  again: 1 where
    `here` is to be tried once more, 0 where the end is.
    """

    here: Any
    end: Any
    gain: Any
    factor: Any
    normal: Any
    cost: Any
    dark: Any
    earlier: Any
    since: Any
    damping: Any
    blind: Any
    steps: Any
    again: Any
    status: Any


def detector_fault(numbers: Sequence[Any], least: Any, usable: Sequence[Any]) -> Any:
    """What is wrong with the numbers of a detector; CONVERGED where nothing is.

    They are not finite, the power is under the least that counts, or the place is past the edge,
    where there can be no light, or in a part of the area that is not usable.
    """
    psi, zeta, light = numbers
    inside = (psi >= usable[0]) & (psi <= usable[1]) & (zeta >= usable[2]) & (zeta <= usable[3])
    lit = select(light > least, select(inside, CONVERGED, OUT_OF_RANGE), NO_LIGHT)
    finite = (abs(psi) < inf) & (abs(zeta) < inf) & (abs(light) < inf)
    return select(finite, lit, NON_FINITE)


def ask(
    form: Form,
    values: Sequence[Any],
    weights: Sequence[Any],
    means: Sequence[Any],
    scales: Scales,
) -> tuple[WeightedReading, Any, list[Any]]:
    """The question of a reading, the status with which it begins, and for each detector 1 where it
    takes part.

    weights: the reading's own, or any numbers.  A detector with a fault is left out.
    """
    kept: list[Any] = []
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
        place = numbers[2] / (noise[0] * noise[1])
        for i, usual in enumerate((place, place, 1 / noise[2])):
            weight = select(has_own_weights, weights[3 * k + i], usual)
            if i == 2 and k == 2:
                weight = select(scales.eight > 0, 0.0, weight)
            kept.append(select(sound, weight, 0.0))
        off, dim = scales.rounding[0] * kept[-3], scales.rounding[1] * kept[-1]
        small = small + 2 * (off * off) + dim * dim
    status = select((fault > AMBIGUOUS) | (checks > -0.5), GOING, fault)
    bare = (checks < 0.5) & (checks > -0.5) & (scales.accepts < 0.5)
    status = select(bare, UNCHECKED, status)
    return WeightedReading(form, values, kept, means, scales, small), status, used


def begin(start: Sequence[Any], form: Form, status: Any) -> State:
    """The state before the first step."""
    size, here, zero = len(form.free), tuple(start), 0.0
    triangle = tuple(tuple(zero for _ in range(i + 1)) for i in range(size))
    return State(
        here=here, end=here, gain=zero, factor=triangle,
        normal=(triangle, tuple(zero for _ in triangle)) if form.keeps_equations else (),
        cost=zero, dark=zero, earlier=zero, since=zero, damping=zero, blind=zero, steps=zero,
        again=1.0, status=status,
    )  # fmt: skip


def unknown_slopes(vectors: Geometry, detectors: Any, free: Sequence[int]) -> Any:
    """The detectors' readings with their derivatives by the free unknowns.

    detectors: the readings with their derivatives by the state.  The beam's place takes the mirror
    along.
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
    x: Sequence[Any], question: WeightedReading, linearise: Linearise
) -> tuple[Any, Any, Any]:
    """J'J with J'r, the sum of squares, and 1 where a detector that
    reads light would have none."""
    rows: list[Any] = []
    residuals: list[Any] = []
    dark: Any = 0.0
    for k, (values, derivatives) in enumerate(linearise(x)):
        used = question.weights[3 * k] > 0
        dark = select(used, select(values[2] > question.scales.light[1][k], dark, 1.0), dark)
        for i, (value, row) in enumerate(zip(values, derivatives, strict=True), 3 * k):
            weight = question.weights[i]
            rows.append([select(used, weight * each, 0.0) for each in row])
            residuals.append(select(used, weight * (question.values[i] - value), 0.0))
    matrix, right = linear_algebra.normal_equations([*zip(*rows, strict=True)], residuals)
    cost: Any = 0.0
    for residual in residuals:
        cost = cost + residual * residual
    for j, c in enumerate(question.form.free):
        if c > 5:
            weight = question.scales.weight[c - 6]
            residual = weight * (question.means[c - 6] - x[c])
            matrix[j][j] = matrix[j][j] + weight * weight
            right[j] = right[j] + weight * residual
            cost = cost + residual * residual
    return (tuple(tuple(row) for row in matrix), tuple(right)), cost, dark


def step(state: State, question: WeightedReading, linearise: Linearise) -> State:
    """Judges what was tried, and finds what to try next.

    A step that is refused is made again from the best so far, with more damping; where equations
    are not kept, they are first made once more.
    """
    at = select_each(state.again > 0.5, state.here, state.end)
    normal, cost, dark = equations(at, question, linearise)
    going = ready = state.status < CONVERGED
    judged, better = compare_end(state, at, cost, dark, question)
    if question.form.keeps_equations:
        normal = select_each(better, normal, state.normal)
        judged = judged._replace(normal=normal)
    else:
        ready = better
    return move(count_step(judged, ready & going, question), ready, normal, question)


def compare_end(
    state: State, at: Any, cost: Any, dark: Any, question: WeightedReading
) -> tuple[State, Any]:
    """The best state so far, whether what was tried is better, and how much to damp the next step.

    A change within rounding is accepted; a step from light into the dark is not.
    """
    going, small, damped = state.status < CONVERGED, question.small, question.scales.damped > 0
    bold = (state.steps < 0.5) | (question.scales.damped < 0.5)  # accepts any number
    rise = cost - (state.cost + small)
    within = (rise < 0) | (rise * rise < 4 * state.cost * small)  # cost < (root + root)**2
    lit = (state.dark > 0.5) | (dark < 0.5)
    better = going & ((bold & (cost < HUGE)) | (within & lit))
    here, cost, dark = select_each(better, (at, cost, dark), (state.here, state.cost, state.dark))
    fresh = going & (state.again < 0.5)
    less = select(state.damping > MIN_DAMPING, state.damping / DAMPING_FACTOR, 0.0)
    more = select(state.damping > 0, state.damping * DAMPING_FACTOR, FIRST_DAMPING)
    stuck = fresh & damped & (dark > 0.5) & (state.steps > MAX_DARK_STEPS - 0.5)
    status = select(state.steps > question.scales.most_steps - 0.5, MAX_STEPS, GOING)
    status = select(stuck, STALLED, status)
    worse = select(bold, OUT_OF_RANGE, select(state.damping > MAX_DAMPING, STALLED, status))
    judged = state._replace(
        here=here, cost=cost, dark=dark,
        damping=select(fresh, select(better, less, more), state.damping),
        blind=select(fresh & better, 0.0, state.blind),
        status=select(going, select(better, status, worse), state.status),
    )  # fmt: skip
    return judged, better


def count_step(state: State, ready: Any, question: WeightedReading) -> State:
    """Stalled where the sum of squares has hardly fallen in PROGRESS_INTERVAL_STEPS steps."""
    going = ready & (state.status < CONVERGED)
    since = state.since + select(going, 1.0, 0.0)
    due = going & (since > PROGRESS_INTERVAL_STEPS - 0.5)
    earlier = select(state.steps < 0.5, state.cost, state.earlier)
    slow = due & (question.scales.damped > 0) & (state.cost > MAX_COST_SHARE * earlier)
    return state._replace(
        steps=state.steps + select(going, 1.0, 0.0),
        since=select(due, 0.0, since),
        earlier=select(due, state.cost, earlier),
        status=select(slow, STALLED, state.status),
    )


def move(state: State, ready: Any, normal: Any, question: WeightedReading) -> State:
    """The next step, unless the estimate ends.

    It is the last one where it changes less than rounding can, unless the damping alone has made it
    so short.
    """
    damping, held = state.damping, state.damping > 0
    factor, sure = linear_algebra.factorise(normal[0], damping)
    steps, gain = linear_algebra.solution(factor, normal[1])
    end = list(state.here)
    for c, change in zip(question.form.free, steps, strict=True):
        end[c] = end[c] + change
        if c in (6, 7):
            end[c - 6] = end[c - 6] + change
    goes = ready & (state.status < CONVERGED)
    short = gain < question.small
    last = select(held, select(state.blind > 0.5, SINGULAR, GOING), CONVERGED)
    lost = select(held | (question.scales.damped < 0.5), SINGULAR, GOING)
    return state._replace(
        end=tuple(end),
        gain=gain,
        factor=factor,
        damping=select(goes, select(sure, select(short, 0.0, damping), FIRST_DAMPING), damping),
        blind=select(goes, select(sure, state.blind, 1.0), state.blind),
        again=select(goes & sure, select(short, 1.0, 0.0), 1.0),
        status=select(goes, select(sure, select(short, last, GOING), lost), state.status),
    )


def redundancy_of(end: State, question: WeightedReading, used: Sequence[Any]) -> Any:
    """The redundancy of the readings at a state that has converged: their number, plus the
    fraction of beam and power that the priors determine, minus the number of unknowns."""
    free = question.form.free
    redundancy = 3 * (used[0] + used[1] + used[2]) - question.scales.eight - len(free)
    variances = linear_algebra.inverse([row[6:] for row in end.factor[6:]])
    for j, c in enumerate(free[6:]):
        weight = question.scales.weight[c - 6]
        redundancy = redundancy + weight * weight * variances[j][j]
    return redundancy


def final_status(end: State, question: WeightedReading, used: Sequence[Any]) -> Any:
    """The status of an estimate: UNCHECKED where the readings have hardly any redundancy."""
    if len(question.form.free) == 6:
        return end.status
    bare = redundancy_of(end, question, used) < question.scales.least_redundancy
    return select((end.status < 0.5) & (end.status > -0.5) & bare, UNCHECKED, end.status)


def residual_of(end: State) -> Any:
    """The residual of a state that has converged, in standard deviations."""
    left = end.cost - end.gain
    return sqrt(select(left > 0, left, 0.0))


def covariance_of(factor: linear_algebra.Triangle, free: Sequence[int]) -> list[list[Any]]:
    """The covariance (8, 8) of the state, from the factor of the equations of the free unknowns."""
    steps = linear_algebra.inverse(factor)
    covariance = [[0.0 for _ in range(8)] for _ in range(8)]
    for i, a in enumerate(free):
        for j, b in enumerate(free):
            if max(a, b) < 8:
                covariance[a][b] = steps[i][j]
    if 6 in free:  # the mirror's place is that in the beam and the beam's, added
        for c in (6, 7):
            for b in range(8):
                covariance[c - 6][b] = covariance[c - 6][b] + covariance[c][b]
            for a in range(8):
                covariance[a][c - 6] = covariance[a][c - 6] + covariance[a][c]
    return covariance
