"""Accuracy and repeatability of positioning, as ISO 230-2 defines them, and their uncertainties.

Deviations x[i, d, j] are those of run j from the target position i, approached in the positive (d =
0) or the negative direction (d = 1); NaN where there was no run. The definitions are those of
clause 3 of ISO 230-2:2014, which applies to linear and rotary axes alike.

All quantities but the mean reversal error are seminorms of x: they scale with it, and Q(x + e) <=
Q(x) + Q(e). The measured quantity therefore differs from that of the true deviations by no more
than Q(e), e being the errors of the measurement. Where the axis errs by much more than the sensor,
the difference is far smaller, and is nearly linear in e. Both cases are covered by drawing e from
its joint distribution and taking the 95.45 % quantile (coverage factor 2) of |Q(t + e) - Q(t)|.
Here t are deviations near the true ones: the measured ones less the estimated contribution of e.

Functions of deviations x (..., targets, 2, runs) return quantities (...) in the unit of x, and NaN
where no number is defined.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..core import Floats
from ..estimation import finite_means

#: Coverage probability of expanded uncertainties: that of a coverage factor of 2.
COVERAGE = 0.9545
#: Number of runs in each direction in the standard's test (ISO 230-2:2014, 5.3).
STANDARD_RUNS = 5


class Quantity(NamedTuple):
    """A quantity of a test with its expanded uncertainty (k = 2); NaN if it is not defined."""

    name: str
    symbol: str
    value: float
    expanded: float


def unidirectional_means(x: Floats) -> Floats:
    """Mean unidirectional positioning deviations (..., m, 2) of deviations (..., m, 2, n)."""
    return finite_means(x)


def standard_deviations_of_runs(x: Floats) -> Floats:
    """Estimators s of the unidirectional repeatability (..., m, 2); NaN for fewer than two runs."""
    there = np.isfinite(x)
    count = there.sum(axis=-1)
    squares = np.where(there, (x - finite_means(x)[..., None]) ** 2, 0.0).sum(axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        deviation: Floats = np.sqrt(np.where(count > 1, squares / (count - 1), np.nan))
    return deviation


def reversals(x: Floats) -> Floats:
    """Reversal errors B_i (..., m): positive less negative direction; NaN if one is missing."""
    means = unidirectional_means(x)
    difference: Floats = means[..., 0] - means[..., 1]
    return difference


def bidirectional_means(x: Floats) -> Floats:
    """Mean bidirectional positioning deviations (..., m); NaN if one direction is missing."""
    means: Floats = unidirectional_means(x).sum(axis=-1) / 2
    return means


def largest(values: Floats) -> Floats:
    """The largest number along the last axis, without missing ones; NaN if all are missing."""
    most: Floats = np.fmax.reduce(values, axis=-1)
    return most


def extent(low: Floats, high: Floats) -> Floats:
    """The largest of `high` less the smallest of `low`, over the last axis."""
    size: Floats = largest(high) + largest(-low)
    return size


def join_directions(values: Floats) -> Floats:
    """Positions and directions (..., m, 2) on one axis; NaN throughout if one direction is
    missing."""
    has = np.asarray(np.isfinite(values).any(axis=-2).all(axis=-1))
    flat = values.reshape(*values.shape[:-2], -1)
    return np.where(has[..., None], flat, np.nan)


def bidirectional_repeatability(x: Floats) -> Floats:
    """R: the largest of 2 s+ + 2 s- + |B|, 4 s+ and 4 s- over the positions."""
    s = standard_deviations_of_runs(x)
    joint = 2 * s.sum(axis=-1) + np.abs(reversals(x))
    there = np.isfinite(joint).any(axis=-1)
    candidates = np.concatenate([joint, 4 * s[..., 0], 4 * s[..., 1]], axis=-1)
    return np.where(there, largest(candidates), np.nan)


def accuracy(x: Floats, direction: int | None = None) -> Floats:
    """A: from the lowest mean - 2 s to the highest mean + 2 s, of one direction or of both."""
    means, s = unidirectional_means(x), standard_deviations_of_runs(x)
    low, high = means - 2 * s, means + 2 * s
    if direction is None:
        return extent(join_directions(low), join_directions(high))
    return extent(low[..., direction], high[..., direction])


def systematic_error(x: Floats, direction: int | None = None) -> Floats:
    """E: the range of the unidirectional means, of one direction or of both."""
    means = unidirectional_means(x)
    chosen = join_directions(means) if direction is None else means[..., direction]
    return extent(chosen, chosen)


def mean_bidirectional_error(x: Floats) -> Floats:
    """M: the range of the bidirectional means."""
    means = bidirectional_means(x)
    return extent(means, means)


#: Name, symbol and formula of each quantity of an axis.
QUANTITIES: tuple[tuple[str, str, Callable[[Floats], Floats]], ...] = (
    ("reversal error", "B", lambda x: largest(np.abs(reversals(x)))),
    ("mean reversal error", "B_mean", lambda x: finite_means(reversals(x))),
    (
        "repeatability in the positive direction",
        "R_up",
        lambda x: 4 * largest(standard_deviations_of_runs(x)[..., 0]),
    ),
    (
        "repeatability in the negative direction",
        "R_down",
        lambda x: 4 * largest(standard_deviations_of_runs(x)[..., 1]),
    ),
    ("bidirectional repeatability", "R", bidirectional_repeatability),
    ("systematic error in the positive direction", "E_up", lambda x: systematic_error(x, 0)),
    ("systematic error in the negative direction", "E_down", lambda x: systematic_error(x, 1)),
    ("bidirectional systematic error", "E", systematic_error),
    ("mean bidirectional error", "M", mean_bidirectional_error),
    ("accuracy in the positive direction", "A_up", lambda x: accuracy(x, 0)),
    ("accuracy in the negative direction", "A_down", lambda x: accuracy(x, 1)),
    ("bidirectional accuracy", "A", accuracy),
)


def evaluate_positioning(x: Floats, errors: Floats) -> list[Quantity]:
    """Compute the quantities of ISO 230-2 with their expanded uncertainties.

    Parameters
    ----------
    x
        Measured deviations, (m, 2, n): target positions, directions (positive, negative) and runs;
        mm or rad, NaN where there is no run.
    errors
        Draws of the errors of these measurements from their joint distribution, (draws, m, 2, n).

    Returns
    -------
    list of Quantity
        B, the mean reversal error, R, E, M and A, the unidirectional ones among them.

    Examples
    --------
    >>> import numpy as np
    >>> from facets.axis_tests.positioning import evaluate_positioning
    >>> x = np.array([[[0.0, 2.0], [4.0, 4.0]], [[3.0, 5.0], [5.0, 7.0]]])  # two targets, two runs
    >>> found = {q.symbol: q.value for q in evaluate_positioning(x, np.zeros((1, 2, 2, 2)))}
    >>> found["B"], found["E"], found["M"]
    (3.0, 5.0, 2.5)
    """
    near = remove_noise(x, errors)
    disturbed = near + errors
    quantities = []
    for name, symbol, formula in QUANTITIES:
        off = np.abs(formula(disturbed) - formula(near))
        expanded = np.quantile(off, COVERAGE) if np.isfinite(off).all() else np.nan
        quantities.append(Quantity(name, symbol, float(formula(x)), float(expanded)))
    return quantities


def components(x: Floats) -> list[Floats]:
    """Split deviations (..., m, 2, n) into parts of this shape that add up to them.

    The parts are the mean line of the bidirectional means, the distances from it, the mean
    reversal, its changes, and the scatter of the runs.
    """
    means = unidirectional_means(x)
    middle, half = finite_means(means), np.nan_to_num(reversals(x)) / 2
    count = x.shape[-3]
    design = np.stack([np.ones(count), np.arange(count) - (count - 1) / 2])
    there = np.isfinite(middle).all(axis=tuple(range(middle.ndim - 1)))
    fit = np.linalg.pinv(design[:, there].T).T @ design
    line = np.nan_to_num(middle[..., there]) @ fit
    level = np.broadcast_to(half.mean(axis=-1, keepdims=True), half.shape)
    signs = np.array([1.0, -1.0])
    parts = [line, middle - line]
    wide = [part[..., None] * np.ones(2) for part in parts]
    wide += [level[..., None] * signs, (half - level)[..., None] * signs]
    spread = [np.broadcast_to(part[..., None], x.shape) for part in wide]
    return [*spread, x - sum(spread)]  # its first part may hold a constant, which no formula sees


def remove_noise(x: Floats, errors: Floats) -> Floats:
    """Estimate the true deviations (m, 2, n) from measured ones.

    The mean square of each component is reduced by the one that the errors (draws, m, 2, n) exceed
    in one draw of a hundred.
    """
    nearer = np.zeros_like(x)
    for part, noise in zip(components(x), components(errors), strict=True):
        there = np.isfinite(part)
        power = np.mean(part[there] ** 2)
        chance = np.quantile(np.mean(noise[:, there] ** 2, axis=1), 0.99)
        nearer += np.sqrt(max(0.0, 1 - chance / power) if power > 0 else 0.0) * part
    return nearer
