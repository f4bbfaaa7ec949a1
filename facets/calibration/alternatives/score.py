"""How much an alternative would explain of a fit's residuals: one score for all of them.

What a score is: `remainder`. The best of several courses, of two states, and of each sample.
"""

from __future__ import annotations

import numpy as np

from ...core.units import Booleans, Floats, Integers
from .alternative import LAST_TRIALS, WORTH_MORE, Trace
from .remainder import LEAST_OWN_SHARE, Remainder

#: A step has at least this number of samples on both sides.
STEP_MARGIN = 8
#: How often sizes and states of something that switches are found in turn.
SWITCH_ROUNDS = 6
#: Of what switches more often than in this share of the samples nobody would say so.
MOST_SWITCHES = 0.08


def score_columns(
    remainder: Remainder,
    key: str,
    columns: Floats,
    sigma: Floats | float = np.inf,
    least: float = LEAST_OWN_SHARE,
) -> Trace:
    """The fall that columns (n, 9, q) bring.  sigma: prior standard uncertainty of their
    amounts.  least: share of the square of a direction that is left beside the unknowns."""
    columns = remainder.readable(columns)
    whole, matrix, side = remainder.equations(columns)
    prior = np.broadcast_to(np.asarray(sigma, dtype=float) ** -2.0, side.shape)
    fall, amounts, count = falls_of(whole[None], matrix[None], side[None], prior, least)
    is_partial = least > LEAST_OWN_SHARE
    return Trace(key, float(fall[0]), float(count[0]), columns, amounts[0], 0.0, (), prior,
                 is_partial)  # fmt: skip


def complete_trace(remainder: Remainder, trace: Trace) -> Trace:
    """A trace whose score left directions out that the unknowns nearly explain, with the
    amounts of the fewest columns that explain as much: these move the unknowns, too."""
    if not trace.is_partial:
        return trace
    _, matrix, side = remainder.equations(trace.columns)
    matrix = matrix + np.diag(np.broadcast_to(trace.prior, side.shape))
    chosen, amounts, fall = list[int](), np.zeros(len(side)), 0.0
    while len(chosen) < len(side):
        falls = np.zeros(len(side))
        for n in set(range(len(side))) - set(chosen):
            at = [*chosen, n]
            falls[n] = side[at] @ np.linalg.solve(matrix[np.ix_(at, at)], side[at])
        if falls.max() < fall + WORTH_MORE:
            break
        chosen.append(int(np.argmax(falls)))
        fall = falls[chosen[-1]]
    amounts[chosen] = np.linalg.solve(matrix[np.ix_(chosen, chosen)], side[chosen])
    return trace._replace(amounts=amounts)


def score_courses(
    remainder: Remainder, key: str, columns: Floats, courses: Floats, sigma: Floats | float = np.inf
) -> Trace:
    """The best of several courses (m, n, w): the columns (n, 9, q) times the w functions of the
    rows, or of the mirror's place, of one of them.  sigma: prior standard uncertainty of the
    amounts (q,)."""
    columns, trials = remainder.readable(columns), len(courses)
    prior = np.broadcast_to(np.asarray(sigma, dtype=float) ** -2.0, columns.shape[2:])
    if not courses.any() or not columns.any():
        return Trace(key, 0.0, 0.0, columns, np.zeros(columns.shape[2]), 0.0, (0.0,))
    if courses.shape[2] > 1 and trials > LAST_TRIALS:
        kept = screen_courses(remainder, columns, courses)
        trace = compare_courses(remainder, key, columns, courses[kept], prior)
        return trace._replace(log_trials=float(np.log(trials)), at=(float(kept[int(trace.at[0])]),))
    return compare_courses(remainder, key, columns, courses, prior)


def screen_courses(remainder: Remainder, columns: Floats, courses: Floats) -> Integers:
    """The numbers of the best courses, by what they would explain if no unknown took up any of
    it."""
    turned = np.swapaxes(columns, 1, 2)
    pulled = (turned @ remainder.pulled[:, :, None])[:, :, 0]
    squares = np.einsum("nqi,nij,njq->nq", turned, remainder.inverse, columns)
    sides = np.einsum("mnw,nq->mwq", courses, pulled, optimize=True)
    whole = np.einsum("mnw,nq->mwq", courses**2, squares, optimize=True)
    falls = (sides**2 / np.maximum(whole, 1e-300)).sum(axis=(1, 2))
    return np.argsort(-falls)[:LAST_TRIALS]


def compare_courses(
    remainder: Remainder, key: str, columns: Floats, courses: Floats, prior: Floats
) -> Trace:
    """The best of a few courses; see `test_courses`."""
    trials, rows, ways = courses.shape
    size, unknowns = columns.shape[2] * ways, remainder.matrix.shape[0]
    turned = np.swapaxes(columns, 1, 2)
    pulled = (turned @ remainder.pulled[:, :, None])[:, :, 0]
    weighted = (turned @ remainder.weighted).reshape(rows, -1)
    squares = (turned @ remainder.inverse @ columns).reshape(rows, -1)
    count = columns.shape[2]
    flat = np.swapaxes(courses, 1, 2).reshape(-1, rows)
    sides = np.swapaxes((flat @ pulled).reshape(trials, ways, count), 1, 2).reshape(-1, size)
    each = (flat @ weighted).reshape(trials, ways, count, unknowns)
    across = np.swapaxes(each, 1, 2).reshape(trials, size, unknowns)
    pairs = (courses[:, :, :, None] * courses[:, :, None, :]).reshape(trials, rows, -1)
    whole = np.swapaxes(pairs, 1, 2).reshape(-1, rows) @ squares
    whole = whole.reshape(trials, ways, ways, count, count)
    whole = whole.transpose(0, 3, 1, 4, 2).reshape(trials, size, size)
    matrix = whole - across @ remainder.covariance @ np.swapaxes(across, 1, 2)
    fall, amounts, free = falls_of(whole, matrix, sides, np.repeat(prior, ways))
    best = int(np.argmax(fall))
    chosen = columns[:, :, :, None] * courses[best][:, None, None, :]
    return Trace(key, float(fall[best]), float(free[best]), chosen.reshape(rows, 9, size),
                 amounts[best], float(np.log(trials)), (float(best),),
                 np.repeat(prior, ways))  # fmt: skip


def score_switching(
    remainder: Remainder, columns: Floats, step: Trace, sigma: Floats | float = np.inf
) -> tuple[Trace, Booleans]:
    """The best of two states between which columns (n, 9, q) switch at any rows.

    step: the best of one step, which is one of the two courses from which the search begins.
    Sizes and states are found in turn; each switch costs the choice of its row. Returns
    the states (n,), too.
    """
    columns, count = remainder.readable(columns), len(columns)
    turned = np.swapaxes(columns, 1, 2)
    squares = turned @ remainder.inverse @ columns
    sides = (turned @ remainder.pulled[:, :, None])[:, :, 0]
    first: Booleans = np.arange(count) >= step.at[0]
    best, best_state = step, first
    for state in (first, leading_state(squares, sides)):
        for _ in range(SWITCH_ROUNDS):
            if not STEP_MARGIN <= state.sum() <= count - STEP_MARGIN:
                break
            switches = np.flatnonzero(np.diff(state.astype(int))) + 1
            if len(switches) > MOST_SWITCHES * count:  # that is noise
                break
            trace = score_columns(remainder, step.key, columns * state[:, None, None], sigma)
            cost = len(switches) * float(np.log(count))
            trace = trace._replace(log_trials=cost, at=tuple(switches.astype(float)))
            if trace.score > best.score:
                best, best_state = trace, state
            own = np.einsum("nij,i,j->n", squares, trace.amounts, trace.amounts)
            gain = 2 * sides @ trace.amounts + (2 * state.mean() - 1) * own
            following = likeliest_states(gain, 2 * np.log(count))
            if (following == state).all():
                break
            state = following
    return best, best_state


def sample_falls(remainder: Remainder, trace: Trace) -> Floats:
    """By how much chi-square of each sample (n,) falls."""
    part = remainder.project(remainder.readable(trace.columns), trace.amounts)
    moved = (remainder.variance @ part[:, :, None])[:, :, 0]
    falls: Floats = (2 * remainder.residuals * part - moved * part).sum(axis=1)
    return falls


def falls_of(
    whole: Floats,
    matrix: Floats,
    side: Floats,
    prior: Floats | None = None,
    least: float = LEAST_OWN_SHARE,
) -> tuple[Floats, Floats, Floats]:
    """Falls (m,), amounts (m, q) and numbers of columns (m,) that the unknowns do not explain.

    whole: (m, q, q) the columns' squares; matrix: the same beside the unknowns; side: (m, q);
    prior: (q,) what is known before of the amounts, which counts as part of a column that the
    unknowns explain.
    """
    size = np.diagonal(whole, axis1=1, axis2=2) + (0.0 if prior is None else prior)
    scale = np.sqrt(np.maximum(size, 1e-300))
    known = np.zeros_like(matrix) if prior is None else np.diag(prior)
    alone = matrix / scale[:, :, None] / scale[:, None, :]
    level, ways = np.linalg.eigh(alone + known / scale[:, :, None] / scale[:, None, :])
    aim = (np.swapaxes(ways, 1, 2) @ (side / scale)[:, :, None])[:, :, 0]
    share = np.einsum("mij,mik,mkj->mj", ways, alone, ways)
    free = share / np.maximum(level, 1e-300)
    is_free = share > least
    level = np.where(is_free, level, 1.0)
    step = np.where(is_free, aim / level, 0.0)
    amounts = (ways @ step[:, :, None])[:, :, 0] / scale
    return (step * aim).sum(axis=1), amounts, (free * is_free).sum(axis=1)


def leading_state(squares: Floats, sides: Floats) -> Booleans:
    """On which side of zero each sample (n,) lies along the direction in which the amounts of some
    columns scatter most.

    squares: (n, q, q) of the columns in a sample; sides: (n, q).
    """
    mean = squares.mean(axis=0)
    level, ways = np.linalg.eigh(sides.T @ sides / len(sides))
    aim = np.linalg.lstsq(mean, ways[:, -1] * np.sqrt(max(level[-1], 0.0)), rcond=None)[0]
    return np.asarray(sides @ aim > 0)


def likeliest_states(gain: Floats, cost: float) -> Booleans:
    """The states (n,) of largest sum of gains where a state is on, less a cost for each switch."""
    off, on, came = 0.0, 0.0, np.zeros((len(gain), 2), bool)
    for n, value in enumerate(gain.tolist()):
        came[n] = on - cost > off, on > off - cost
        off, on = max(off, on - cost), max(on, off - cost) + value
    states, is_on = np.zeros(len(gain), bool), on > off
    for n in range(len(gain) - 1, -1, -1):
        states[n] = is_on
        is_on = bool(came[n, int(is_on)])
    return states
