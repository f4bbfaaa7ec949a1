"""How much each candidate effect would lower chi-square, predicted without fitting it.

The normal equations at a fit, with a column for every candidate, say at once by how much
chi-square would fall if a candidate were added. The same sums, made without a fifth of the samples
at a time, say how well a fit to the rest predicts that fifth (cross-validation). An effect is
accepted where both speak for it.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..core.sensor import Sensor
from ..core.units import Floats
from ..model.arrays import EFFECTS
from .bundle_adjustment import (
    Data,
    Linear,
    Normal,
    deviations,
    eliminate_own_unknowns,
    linearise_model,
    own_sigma,
)
from .candidates import POLARISATIONS, Candidate, add_candidate, add_coating, candidates
from .fit import Fit, prior_information
from .outliers import LEAST_WEIGHT
from .unknowns import PLACE, Choice, assign_values, values_of

if TYPE_CHECKING:
    from ..core.calibrate import Calibrate

#: Number of parts of the samples; each part in turn is predicted from the others.
FOLDS = 5
#: A candidate is accepted where its fall of chi-square has at most this probability without it,
#: and where the cross-validated chi-square falls by at least this much.
CHANCE, LEAST_GAIN = 1e-4, 4.0


class Decision(NamedTuple):
    """What became of a candidate.

    unknowns: their number.  fall: of chi-square, beside what was accepted before.  error: the
    cross-validated error of a reading in standard deviations, with the candidate.  accepted:
    whether it is in the fit.  why: the reason in words.
    """

    key: str
    words: str
    unknowns: int
    fall: float
    error: float
    accepted: bool
    why: str


class FoldEquations(NamedTuple):
    """Normal equations of each fifth of the samples, over all names of a choice.

    matrix: (f, p, p), side: (f, p), level: (f,).  prior: (p, p), prior_side: (p,), prior_level:
    what the prior adds to the sum of the parts.
    """

    names: tuple[str, ...]
    matrix: Floats
    side: Floats
    level: Floats
    prior: Floats
    prior_side: Floats
    prior_level: float


def fold_equations(sensor: Sensor, data: Data, result: Fit, chosen: Choice) -> FoldEquations:
    """The equations at the values of a fit, for all names of a wider choice."""
    values = values_for(sensor, result)
    at = assign_values(sensor, values)
    data = data._replace(noise=deviations(sensor, data))
    model, sigma = (
        linearise_model(at, data, result.own_values, values, chosen),
        own_sigma(data, chosen),
    )
    weights, parts = np.sqrt(result.weights), list[Normal]()
    weights[result.weights < LEAST_WEIGHT] = 0.0  # else the largest jump would decide
    for n in range(FOLDS):
        rows = slice(n, None, FOLDS)
        part = Linear(model.residual[rows], model.common[rows], model.own[rows])
        parts.append(eliminate_own_unknowns(part, weights[rows], result.own_values[rows], sigma))
    prior = prior_information(chosen)
    before = (values - values_of(sensor))[chosen.places]
    return FoldEquations(
        chosen.names,
        np.array([part.matrix for part in parts]),
        np.array([part.side for part in parts]),
        np.array([part.level for part in parts]),
        prior,
        -prior @ before,
        float(before @ prior @ before),
    )


def values_for(sensor: Sensor, result: Fit) -> Floats:
    """The values of a fit, for a sensor that may have received a coating since."""
    every, nominal = result.all_values.copy(), values_of(sensor)
    for name in ("coating.n", "coating.k", "light.polarization"):
        if name in EFFECTS and name not in result.choice.names:
            every[PLACE[name]] = nominal[PLACE[name]]
    return every


class Prediction(NamedTuple):
    """Chi-square after a linear step, of the samples in the fit and of those left out of it."""

    fitted: float
    left_out: float


def predict(equations: FoldEquations, names: Iterable[str]) -> Prediction:
    """Predict chi-square with some of the names by the linear model."""
    at = np.array([equations.names.index(name) for name in names])
    square = np.ix_(at, at)
    matrix, side = equations.matrix.sum(axis=0)[square], equations.side.sum(axis=0)[at]
    side = side + equations.prior_side[at]
    prior = equations.prior[square]
    after = equations.level.sum() + equations.prior_level
    after -= side @ np.linalg.solve(matrix + prior, side)
    left_out = 0.0
    folds = zip(equations.matrix, equations.side, equations.level, strict=True)
    for fold_matrix, fold_side, level in folds:
        here, aim = fold_matrix[square], fold_side[at]
        step = np.linalg.solve(matrix - here + prior, side - aim)
        left_out += level - 2 * aim @ step + step @ here @ step
    return Prediction(float(after), float(left_out))


def chance_of(fall: float, count: int) -> float:
    """Probability of a fall of chi-square at least as large by `count` idle unknowns."""
    from scipy.special import chdtrc

    return float(chdtrc(count, max(fall, 0.0)))


def rank_candidates(
    sensor: Sensor, data: Data, result: Fit, several: list[Candidate]
) -> list[Decision]:
    """Decisions on candidates, the best first: what each would gain beside a fit and the better
    candidates, and whether it is accepted."""
    if not several:
        return []
    wide = result.choice
    for candidate in several:
        wide = add_candidate(wide, candidate)
    coated = any(candidate.effect.coated for candidate in several)
    without = fold_equations(sensor, data, result, result.choice if coated else wide)
    equations = best_coating(sensor, data, result, wide)[1] if coated else without
    chosen, before = result.choice, predict(without, result.choice.names)
    decisions, remaining = list[Decision](), list(several)
    while remaining:
        wider = [add_candidate(chosen, candidate) for candidate in remaining]
        after = [predict(equations, choice.names) for choice in wider]
        tried = [
            decide(candidate, len(choice.names) - len(chosen.names), result, before, there)
            for candidate, choice, there in zip(remaining, wider, after, strict=True)
        ]
        good = [n for n, row in enumerate(tried) if row.accepted]
        if not good:
            return decisions + tried
        best = max(good, key=lambda n: tried[n].fall / max(tried[n].unknowns, 1) ** 0.5)
        if group := remaining[best].effect.rivals:
            rivals = [n for n in good if remaining[n].effect.rivals == group]
            best = max(rivals, key=lambda n: tried[n].fall - 2 * tried[n].unknowns)  # Akaike
        decisions.append(tried[best])
        chosen, before = wider[best], after[best]
        del remaining[best]
    return decisions


def best_coating(
    sensor: Sensor, data: Data, result: Fit, wide: Choice
) -> tuple[Sensor, FoldEquations]:
    """The coated sensor whose polarisation promises the lowest chi-square, and its equations."""
    coated = list(dict.fromkeys(add_coating(sensor, turn) for turn in POLARISATIONS))
    tried = [(option, fold_equations(option, data, result, wide)) for option in coated]
    return min(tried, key=lambda option: predict(option[1], wide.names).fitted)


def cross_validated_error(chi_square: float, result: Fit) -> float:
    """The error of a reading that was not fitted, over its noise."""
    count = float((result.weights == 1).sum())
    if np.isinf(result.choice.power):
        count -= len(result.residuals)
    return float(np.sqrt(max(chi_square, 0.0) / max(count, 1.0)))


def decide(
    candidate: Candidate, count: int, result: Fit, before: Prediction, after: Prediction
) -> Decision:
    """Decide on a candidate.  count: number of its unknowns.  before, after: chi-square without and
    with it."""
    fall = before.fitted - after.fitted
    chance, gain = chance_of(fall, count), before.left_out - after.left_out
    error = cross_validated_error(after.left_out, result)
    row = Decision(
        candidate.key, candidate.effect.words, count, fall, error, True, "the data call for it"
    )
    if chance < CHANCE and gain > LEAST_GAIN:
        return row
    why = "within chance" if chance >= CHANCE else "does not predict what was left out"
    return row._replace(accepted=False, why=why)


def add_cheap_candidates(
    sensor: Sensor, data: Data | None, settings: Calibrate, chosen: Choice
) -> Choice:
    """Add all candidates except a coating, a spline and a moving beam to a choice."""
    for candidate in candidates(sensor, data, settings):
        if not (candidate.effect.tried_last or candidate.effect.beam):
            chosen = add_candidate(chosen, candidate)
    return chosen


def reachable_chi_square(sensor: Sensor, data: Data, settings: Calibrate, plain: Fit) -> float:
    """Chi-square for each reading, or its cross-validated one if that is larger, that all
    candidates together would leave, as the linear model at the plain fit has it."""
    wide = add_cheap_candidates(sensor, data, settings, plain.choice)
    after = predict(fold_equations(sensor, data, plain, wide), wide.names)
    return max(after) / max(float((plain.weights == 1).sum()), 1.0)
