"""Scores of alternatives: how much of a fit's residuals each would explain; see `remainder`."""

from __future__ import annotations

import numpy as np

from ...core.units import Booleans, Floats, Integers
from .alternative import EXACT_TRIALS, MIN_ADDED_FALL, Trace
from .remainder import LEAST_FREE_FRACTION, Remainder

#: A step has at least this number of samples on both sides.
STEP_MARGIN = 8
#: Number of rounds in which the amounts and the states of a switch are found in turn.
SWITCH_ROUNDS = 6
#: A switch at more than this fraction of the samples is noise.
MOST_SWITCHES = 0.08


def score_columns(
    remainder: Remainder,
    key: str,
    columns: Floats,
    sigma: Floats | float = np.inf,
    threshold: float = LEAST_FREE_FRACTION,
) -> Trace:
    """Score columns (n, 9, q).

    sigma: prior standard uncertainty of their amounts.  threshold: directions of which the unknowns
    leave less than this fraction of the square are excluded.
    """
    columns = remainder.readable(columns)
    square, matrix, side = remainder.equations(columns)
    prior = np.broadcast_to(np.asarray(sigma, dtype=float) ** -2.0, side.shape)
    fall, amounts, count = falls_of(square[None], matrix[None], side[None], prior, threshold)
    is_partial = threshold > LEAST_FREE_FRACTION
    return Trace(key, float(fall[0]), float(count[0]), columns, amounts[0], 0.0, (), prior,
                 is_partial)  # fmt: skip


def complete_trace(remainder: Remainder, trace: Trace) -> Trace:
    """Return a trace that excludes directions which the unknowns nearly explain with the amounts of
    the fewest columns that explain as much: these move the unknowns, too."""
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
        if falls.max() < fall + MIN_ADDED_FALL:
            break
        chosen.append(int(np.argmax(falls)))
        fall = falls[chosen[-1]]
    amounts[chosen] = np.linalg.solve(matrix[np.ix_(chosen, chosen)], side[chosen])
    return trace._replace(amounts=amounts)


def score_bases(
    remainder: Remainder, key: str, columns: Floats, bases: Floats, sigma: Floats | float = np.inf
) -> Trace:
    """Score columns (n, 9, q) times the basis functions of the best candidate.

    bases: (m, n, w), m candidates of w functions of the row or of the mirror's position.  sigma:
    prior standard uncertainty of the amounts (q,).
    """
    columns, trials = remainder.readable(columns), len(bases)
    prior = np.broadcast_to(np.asarray(sigma, dtype=float) ** -2.0, columns.shape[2:])
    if not bases.any() or not columns.any():
        return Trace(key, 0.0, 0.0, columns, np.zeros(columns.shape[2]), 0.0, (0.0,))
    if bases.shape[2] > 1 and trials > EXACT_TRIALS:
        screened = screen_bases(remainder, columns, bases)
        trace = compare_bases(remainder, key, columns, bases[screened], prior)
        best = float(screened[int(trace.at[0])])
        return trace._replace(log_trials=float(np.log(trials)), at=(best,))
    return compare_bases(remainder, key, columns, bases, prior)


def screen_bases(remainder: Remainder, columns: Floats, bases: Floats) -> Integers:
    """The indices of at most EXACT_TRIALS candidates that would explain most if no unknown absorbed
    any of it, the best first. columns: (n, 9, q). bases: (m, n, w)."""
    turned = np.swapaxes(columns, 1, 2)
    pulled = (turned @ remainder.pulled[:, :, None])[:, :, 0]
    row_squares = np.einsum("nqi,nij,njq->nq", turned, remainder.inverse, columns)
    sides = np.einsum("mnw,nq->mwq", bases, pulled, optimize=True)
    squares = np.einsum("mnw,nq->mwq", bases**2, row_squares, optimize=True)
    falls = (sides**2 / np.maximum(squares, 1e-300)).sum(axis=(1, 2))
    return np.argsort(-falls)[:EXACT_TRIALS]


def compare_bases(
    remainder: Remainder, key: str, columns: Floats, bases: Floats, prior: Floats
) -> Trace:
    """Score all candidates exactly, and return the best; see `score_bases`. prior: prior
    information (q,) on the amounts."""
    trials, rows, ways = bases.shape
    size, unknowns = columns.shape[2] * ways, remainder.matrix.shape[0]
    turned = np.swapaxes(columns, 1, 2)
    pulled = (turned @ remainder.pulled[:, :, None])[:, :, 0]
    weighted = (turned @ remainder.weighted).reshape(rows, -1)
    row_squares = (turned @ remainder.inverse @ columns).reshape(rows, -1)
    count = columns.shape[2]
    flat = np.swapaxes(bases, 1, 2).reshape(-1, rows)
    sides = np.swapaxes((flat @ pulled).reshape(trials, ways, count), 1, 2).reshape(-1, size)
    each = (flat @ weighted).reshape(trials, ways, count, unknowns)
    across = np.swapaxes(each, 1, 2).reshape(trials, size, unknowns)
    pairs = (bases[:, :, :, None] * bases[:, :, None, :]).reshape(trials, rows, -1)
    squares = np.swapaxes(pairs, 1, 2).reshape(-1, rows) @ row_squares
    squares = squares.reshape(trials, ways, ways, count, count)
    squares = squares.transpose(0, 3, 1, 4, 2).reshape(trials, size, size)
    matrix = squares - across @ remainder.covariance @ np.swapaxes(across, 1, 2)
    fall, amounts, free = falls_of(squares, matrix, sides, np.repeat(prior, ways))
    best = int(np.argmax(fall))
    chosen = columns[:, :, :, None] * bases[best][:, None, None, :]
    return Trace(key, float(fall[best]), float(free[best]), chosen.reshape(rows, 9, size),
                 amounts[best], float(np.log(trials)), (float(best),),
                 np.repeat(prior, ways))  # fmt: skip


def score_switching(
    remainder: Remainder, columns: Floats, step: Trace, sigma: Floats | float = np.inf
) -> tuple[Trace, Booleans]:
    """Score columns (n, 9, q) that switch between two states at any rows.

    step: the best single step, with which one of two searches begins.  Amounts and states are found
    in turn; each switch counts as the choice of its row.  Returns the states (n,), too.
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
            square = np.einsum("nij,i,j->n", squares, trace.amounts, trace.amounts)
            gain = 2 * sides @ trace.amounts + (2 * state.mean() - 1) * square
            following = likeliest_states(gain, 2 * np.log(count))
            if (following == state).all():
                break
            state = following
    return best, best_state


def sample_falls(remainder: Remainder, trace: Trace) -> Floats:
    """The fall (n,) of each sample's chi-square."""
    part = remainder.project(remainder.readable(trace.columns), trace.amounts)
    moved = (remainder.variance @ part[:, :, None])[:, :, 0]
    falls: Floats = (2 * remainder.residuals * part - moved * part).sum(axis=1)
    return falls


def falls_of(
    squares: Floats,
    matrix: Floats,
    side: Floats,
    prior: Floats | None = None,
    threshold: float = LEAST_FREE_FRACTION,
) -> tuple[Floats, Floats, Floats]:
    """Falls (m,), amounts (m, q) and numbers of columns (m,) that the unknowns do not explain.

    squares: (m, q, q) of the columns.  matrix: these less what the unknowns explain.  side: (m, q).
    prior: prior information (q,) on the amounts, which counts as a part of a column that the
    unknowns explain.  threshold: see `score_columns`.
    """
    size = np.diagonal(squares, axis1=1, axis2=2) + (0.0 if prior is None else prior)
    scale = np.sqrt(np.maximum(size, 1e-300))
    information = np.zeros_like(matrix) if prior is None else np.diag(prior)
    scaled = matrix / scale[:, :, None] / scale[:, None, :]
    level, ways = np.linalg.eigh(scaled + information / scale[:, :, None] / scale[:, None, :])
    aim = (np.swapaxes(ways, 1, 2) @ (side / scale)[:, :, None])[:, :, 0]
    fraction = np.einsum("mij,mik,mkj->mj", ways, scaled, ways)
    free = fraction / np.maximum(level, 1e-300)
    is_free = fraction > threshold
    level = np.where(is_free, level, 1.0)
    step = np.where(is_free, aim / level, 0.0)
    amounts = (ways @ step[:, :, None])[:, :, 0] / scale
    return (step * aim).sum(axis=1), amounts, (free * is_free).sum(axis=1)


def leading_state(squares: Floats, sides: Floats) -> Booleans:
    """The side of zero on which each sample (n,) lies along the direction in which the amounts of
    columns scatter most.

    squares: (n, q, q) of the columns in a sample.  sides: (n, q).
    """
    mean = squares.mean(axis=0)
    level, ways = np.linalg.eigh(sides.T @ sides / len(sides))
    aim = np.linalg.lstsq(mean, ways[:, -1] * np.sqrt(max(level[-1], 0.0)), rcond=None)[0]
    return np.asarray(sides @ aim > 0)


def likeliest_states(gain: Floats, cost: float) -> Booleans:
    """The states (n,) with the largest sum of gains of samples whose state is on, less a cost for
    each switch."""
    off, on, came = 0.0, 0.0, np.zeros((len(gain), 2), bool)
    for n, value in enumerate(gain.tolist()):
        came[n] = on - cost > off, on > off - cost
        off, on = max(off, on - cost), max(on, off - cost) + value
    states, is_on = np.zeros(len(gain), bool), on > off
    for n in range(len(gain) - 1, -1, -1):
        states[n] = is_on
        is_on = bool(came[n, int(is_on)])
    return states
