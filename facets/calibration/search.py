"""The search for the effects that the data need, in stages.

The normal equations at a fit, with columns for every candidate, predict the fall of chi-square
for each of them. The same sums without a fifth of the samples at a time show how well a fit to the
rest predicts that fifth (cross-validation). An effect is accepted where both speak for it.

The stages of `search`:

1. Add the effects that a key requires.
2. Add the best of the others repeatedly, first with the noise raised to the size of the plain
   fit's residuals, then with the true noise.
3. Explain the scatter from sample to sample.
4. Remove outliers that larger residuals had hidden, and settle the last fit.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..core.sensor import Sensor
from ..core.units import Floats
from ..model.arrays import EFFECTS
from .alternatives.alternative import MIN_ADDED_FALL, chance_of
from .alternatives.scatter import (
    BEAM_SCATTER,
    NO_SCATTER,
    Scatter,
    fit_steady_laser,
    fit_with_scatter,
)
from .candidates import (
    POLARISATIONS,
    Candidate,
    add_candidate,
    add_coating,
    candidates,
    effects_without_columns,
)
from .fitting.bundle_adjustment import (
    Data,
    Linear,
    Normal,
    deviations,
    eliminate_own_unknowns,
    linearise_model,
    own_sigma,
)
from .fitting.fit import NORMAL_MEDIAN, Fit, StoppingRule, fit, prior_information
from .fitting.samples import LEAST_WEIGHT, exclude_outliers
from .fitting.unknowns import PLACE, Choice, assign_values, values_of

if TYPE_CHECKING:
    from ..core.calibrate import Calibrate


#: Number of parts of the samples; each part in turn is predicted from the others.
FOLDS = 5
#: A candidate is accepted if chance explains its fall of chi-square with at most this probability,
#: and if the cross-validated chi-square falls by at least this much.
CHANCE, LEAST_GAIN = 1e-4, 4.0


class Decision(NamedTuple):
    """The decision on a candidate.

    key, words: see `Effect`.  unknowns: number of its unknowns.  fall: decrease of chi-square by
    the candidate, with all that were accepted before.  error: cross-validated error of a reading
    with the candidate, in standard deviations.  accepted: whether it is in the fit.  why: the
    reason in words.
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

    matrix: (f, p, p), side: (f, p), level: (f,).  prior: (p, p), prior_side: (p,), prior_level: the
    terms that the prior adds to the sum over the parts.
    """

    names: tuple[str, ...]
    matrix: Floats
    side: Floats
    level: Floats
    prior: Floats
    prior_side: Floats
    prior_level: float


def fold_equations(sensor: Sensor, data: Data, result: Fit, chosen: Choice) -> FoldEquations:
    """The equations at the values of a fit, for all unknowns of a wider choice."""
    values = values_for(sensor, result)
    at = assign_values(sensor, values)
    data = data._replace(noise=deviations(sensor, data))
    model, sigma = (
        linearise_model(at, data, result.own_values, values, chosen),
        own_sigma(data, chosen),
    )
    weights, parts = np.sqrt(result.weights), list[Normal]()
    weights[result.weights < LEAST_WEIGHT] = 0.0  # otherwise the largest outlier would decide
    for n in range(FOLDS):
        rows = slice(n, None, FOLDS)
        part = Linear(model.residual[rows], model.common[rows], model.by_own[rows])
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
    """The values (ALL,) of a fit for a sensor whose coating was added after that fit."""
    every, nominal = result.all_values.copy(), values_of(sensor)
    for name in ("coating.n", "coating.k", "light.polarization"):
        if name in EFFECTS and name not in result.choice.names:
            every[PLACE[name]] = nominal[PLACE[name]]
    return every


def start_values(sensor: Sensor, result: Fit, wider: Choice) -> Floats:
    """The values (ALL,) at which a fit with a wider choice begins, from those of a fit."""
    every = values_for(sensor, result)
    if ROLLOFF_WIDTH in wider.names and not every[PLACE[ROLLOFF_WIDTH]]:
        every[PLACE[ROLLOFF_WIDTH]] = ROLLOFF_WIDTH_START_MM
    return every


class Prediction(NamedTuple):
    """Chi-square after a linear step: of all samples, fitted together, and of all parts, each
    predicted from the others (cross-validated)."""

    fitted: float
    predicted: float


def predict(equations: FoldEquations, names: Iterable[str]) -> Prediction:
    """Predict chi-square with these unknowns by the linear model."""
    at = np.array([equations.names.index(name) for name in names])
    square = np.ix_(at, at)
    matrix, side = equations.matrix.sum(axis=0)[square], equations.side.sum(axis=0)[at]
    side = side + equations.prior_side[at]
    prior = equations.prior[square]
    after = equations.level.sum() + equations.prior_level
    after -= side @ np.linalg.solve(matrix + prior, side)
    predicted = 0.0
    folds = zip(equations.matrix, equations.side, equations.level, strict=True)
    for fold_matrix, fold_side, level in folds:
        held, aim = fold_matrix[square], fold_side[at]
        step = np.linalg.solve(matrix - held + prior, side - aim)
        predicted += level - 2 * aim @ step + step @ held @ step
    return Prediction(float(after), float(predicted))


def rank_candidates(
    sensor: Sensor, data: Data, result: Fit, several: list[Candidate]
) -> list[Decision]:
    """Decisions on candidates, the best first, each with the better ones in the fit."""
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
            decide(candidate, len(choice.names) - len(chosen.names), result, before, prediction)
            for candidate, choice, prediction in zip(remaining, wider, after, strict=True)
        ]
        good = [n for n, row in enumerate(tried) if row.accepted]
        if not good:
            return decisions + tried
        best = max(good, key=lambda n: tried[n].fall / max(tried[n].unknowns, 1) ** 0.5)
        if group := remaining[best].effect.rivals:
            rivals = [n for n in good if remaining[n].effect.rivals == group]
            worth = {n: tried[n].fall - 2 * tried[n].unknowns for n in rivals}  # Akaike
            best = next(n for n in rivals if worth[n] > max(worth.values()) - MIN_ADDED_FALL)
        decisions.append(tried[best])
        chosen, before = wider[best], after[best]
        del remaining[best]
    return decisions


def coatings(sensor: Sensor) -> list[Sensor]:
    """The coated sensors with which a fit may begin, one for each of `POLARISATIONS`."""
    return list(dict.fromkeys(add_coating(sensor, turn) for turn in POLARISATIONS))


def best_coating(
    sensor: Sensor, data: Data, result: Fit, wide: Choice
) -> tuple[Sensor, FoldEquations]:
    """The coated sensor whose polarisation is predicted to have the lowest chi-square, and its
    equations."""
    tried = [(option, fold_equations(option, data, result, wide)) for option in coatings(sensor)]
    return min(tried, key=lambda option: predict(option[1], wide.names).fitted)


def cross_validated_error(chi_square: float, result: Fit) -> float:
    """The error of a reading that was not fitted, in standard deviations."""
    count = float((result.weights == 1).sum())
    if np.isinf(result.choice.power):
        count -= len(result.residuals)
    return float(np.sqrt(max(chi_square, 0.0) / max(count, 1.0)))


def decide(
    candidate: Candidate, count: int, result: Fit, before: Prediction, after: Prediction
) -> Decision:
    """Decide on a candidate.

    count: number of its unknowns.  before, after: chi-square without and with the candidate.
    """
    fall = before.fitted - after.fitted
    chance, gain = chance_of(fall, count), before.predicted - after.predicted
    error = cross_validated_error(after.predicted, result)
    row = Decision(
        candidate.key, candidate.effect.words, count, fall, error, True, "the data call for it"
    )
    if chance < CHANCE and gain > LEAST_GAIN:
        return row
    why = "within chance" if chance >= CHANCE else "does not predict what was left out"
    return row._replace(accepted=False, why=why)


def add_cheap_candidates(every: list[Candidate], chosen: Choice) -> Choice:
    """Add all candidates except a coating, a spline and a moving beam to a choice."""
    for candidate in every:
        if not (candidate.effect.tried_last or candidate.effect.beam):
            chosen = add_candidate(chosen, candidate)
    return chosen


def reachable_chi_square(sensor: Sensor, data: Data, plain: Fit, every: list[Candidate]) -> float:
    """Chi-square per reading with all cheap candidates, fitted or cross-validated, whichever is
    larger, as the linear model at the plain fit predicts it."""
    wide = add_cheap_candidates(every, plain.choice)
    after = predict(fold_equations(sensor, data, plain, wide), wide.names)
    return max(after) / max(float((plain.weights == 1).sum()), 1.0)


#: Ratio of the plain fit's residuals to the noise, to which the noise is raised at first where the
#: ratio is larger, because errors of the linear model would look like effects.
RAISED_TO = 3.0
#: Largest number of times that the laser's steadiness is estimated and the candidates are tried.
ROUNDS = 4
#: An intermediate fit ends after this many steps, or where another lowers chi-square by less.
INTERMEDIATE = StoppingRule(steps=12, fall=0.3)
#: Width of the roll-off at the beginning of a fit, mm: at zero it has no derivative.
ROLLOFF_WIDTH, ROLLOFF_WIDTH_START_MM = "rolloff.width", 0.03
#: Candidates are added together if their falls of chi-square are at least this fraction of the
#: largest: the linear model is not accurate enough for the others until the large ones are added.
TOGETHER_FRACTION = 0.1
REQUESTED = "asked for"


@dataclass(frozen=True)
class SearchState:
    """The result of the search so far.

    sensor: the sensor with which the last fit began.  data: samples with the noise of the present
    stage.  candidates: all candidates.  fit: the last fit.  rows: the decision on each candidate by
    its key.  refused: keys that are not tried again at this stage.  outliers: rows that were
    removed.  scatter: causes and sizes of the scatter from sample to sample.
    """

    sensor: Sensor
    data: Data
    settings: Calibrate
    candidates: list[Candidate]
    fit: Fit
    rows: dict[str, Decision]
    refused: frozenset[str]
    outliers: list[int]
    scatter: Scatter

    @property
    def accepted_keys(self) -> set[str]:
        """The keys of the effects that were accepted."""
        return {key for key, row in self.rows.items() if row.accepted}

    def fit_again(self) -> Fit:
        """Continue the last fit until it settles, with the present sensor and data."""
        robust = self.settings.outliers
        return fit(self.sensor, self.data, self.fit.choice, robust, self.fit)


@dataclass(frozen=True)
class EffectSearch:
    """The result of the search for effects.

    sensor: the sensor with which the last fit began.  plain: the fit without candidates.  fit: the
    fit with the accepted candidates.  error: the cross-validated error of the plain fit.  rows: the
    decision on each candidate.  data: the samples of the last fit.  outliers: rows that were
    removed.  scatter: causes and sizes of the scatter from sample to sample.  accepted: the
    accepted candidates.
    """

    sensor: Sensor
    plain: Fit
    fit: Fit
    error: float
    rows: list[Decision]
    data: Data
    outliers: list[int]
    scatter: Scatter
    accepted: list[Candidate]


def search(
    sensor: Sensor, data: Data, settings: Calibrate, plain: Fit, outliers: list[int] | None = None
) -> EffectSearch:
    """Extend the plain fit by all effects that the data or the keys require.

    outliers: rows that were removed before.
    """
    noisy = raise_noise(sensor, data, plain)
    state = first_state(sensor, noisy, settings, plain, outliers or [])
    state = add_requested_effects(state)
    state = add_all(state)
    if noisy is not data:
        state = add_all(use_true_noise(state, data))
    state = explain_scatter(state)
    state = exclude_late_outliers(state)
    settled = state.fit_again()
    plain_equations = fold_equations(sensor, data, plain, plain.choice)
    predicted = predict(plain_equations, plain.choice.names).predicted
    return EffectSearch(state.sensor, plain, settled, cross_validated_error(predicted, plain),
                  ordered_decisions(state), state.data, state.outliers, state.scatter,
                  [part for part in state.candidates
                   if part.key in state.accepted_keys])  # fmt: skip


def ordered_decisions(state: SearchState) -> list[Decision]:
    """The decisions in the order of the candidates, followed by those on effects for which the
    table has no columns."""
    order = [candidate.key for candidate in state.candidates]
    rows = sorted(state.rows.values(), key=lambda row: order.index(row.key))
    return rows + [
        Decision(effect.key, effect.words, 0, np.nan, np.nan, False, effect.missing)
        for effect in effects_without_columns(state.candidates, state.settings)
    ]


# ---- the stages


def raise_noise(sensor: Sensor, data: Data, plain: Fit) -> Data:
    """Raise the noise so that the plain fit's residuals are at most a few times the noise.

    With fine detectors, real light leaves residuals of a hundred times their noise.
    """
    size = NORMAL_MEDIAN * float(np.median(np.abs(plain.residuals[np.isfinite(data.raw)])))
    if size < 2 * RAISED_TO:
        return data
    return data._replace(noise=deviations(sensor, data) * (size / RAISED_TO))


def first_state(
    sensor: Sensor, data: Data, settings: Calibrate, plain: Fit, outliers: list[int]
) -> SearchState:
    """The state at the beginning, with the decisions on unknowns of the plain fit alone."""
    every = candidates(sensor, data, settings)
    why = "without it no fit settles"
    rows = {
        candidate.key: Decision(
            candidate.key, candidate.effect.words, len(candidate.sigma), np.nan, np.nan, True, why
        )
        for candidate in every
        if candidate.sigma and set(candidate.sigma) <= set(plain.choice.names)
    }
    return SearchState(
        sensor, data, settings, every, plain, rows, frozenset(), outliers, NO_SCATTER
    )


def add_requested_effects(state: SearchState) -> SearchState:
    """Add the effects that are on in `calibrate.effects`."""
    for candidate in state.candidates:
        if state.settings.effects.get(candidate.key) == "on" and candidate.key not in state.rows:
            row, *_ = rank_candidates(state.sensor, state.data, state.fit, [candidate])
            state = add_candidates(state, [candidate], [row._replace(why=REQUESTED)])
    return state


def add_all(state: SearchState) -> SearchState:
    """Add all candidates that the data need.

    The laser's jitter is estimated again after each round, because effects may explain what was
    attributed to it; if it changes, the data may need other candidates.
    """
    for _ in range(ROUNDS):
        adds = True
        while adds:
            state, adds = add_best(state)
        before = state.fit
        steady = fit_steady_laser(state.sensor, state.data, before, state.settings.outliers)
        if steady is before:
            break
        state = replace(state, fit=steady, refused=frozenset())
    return state


def add_best(state: SearchState) -> tuple[SearchState, bool]:
    """Add the best of the remaining candidates, and return whether any was accepted.

    Candidates that are tried last are tried one by one, after the others.
    """
    done = state.accepted_keys | state.refused
    rest = [
        candidate
        for candidate in state.candidates
        if not candidate.effect.beam and candidate.key not in done
    ]
    groups = [[candidate for candidate in rest if not candidate.effect.tried_last]]
    groups += [[candidate] for candidate in rest if candidate.effect.tried_last]
    for group in groups:
        tried = rank_candidates(state.sensor, state.data, state.fit, group)
        rows = state.rows | {row.key: row._replace(accepted=False) for row in tried}
        state = replace(state, rows=rows)
        good = [row for row in tried if row.accepted]
        if good:
            largest = max(row.fall for row in good)
            together = [row for row in good if row.fall > TOGETHER_FRACTION * largest]
            keys = {row.key for row in together}
            chosen = [candidate for candidate in group if candidate.key in keys]
            return add_candidates(state, chosen, together), True
    return state, False


def add_candidates(
    state: SearchState, several: list[Candidate], rows: list[Decision]
) -> SearchState:
    """Fit again with candidates; keep the previous fit if the new one gains nothing.

    An intermediate fit need not settle, because it may do so once other candidates are added.
    """
    sensor, wider = state.sensor, state.fit.choice
    for candidate in several:
        wider = add_candidate(wider, candidate)
    if any(candidate.effect.coated for candidate in several):
        sensor, _ = best_coating(sensor, state.data, state.fit, wider)
    start = replace(state.fit, all_values=start_values(sensor, state.fit, wider))
    better = fit(sensor, state.data, wider, state.settings.outliers, start,
                 INTERMEDIATE)  # fmt: skip
    fall = state.fit.loss - better.loss
    gains = chance_of(fall, max(sum(row.unknowns for row in rows), 1)) <= CHANCE
    state = record_decisions(state, rows, fall, gains)
    if gains or any(row.why == REQUESTED for row in rows):
        return replace(state, sensor=sensor, fit=better)
    return state


def record_decisions(
    state: SearchState, rows: list[Decision], fall: float, gains: bool
) -> SearchState:
    """The state with the decisions on candidates after a fit with them.

    gains: whether the fall of chi-square is beyond chance.
    """
    decided, refused = dict(state.rows), set(state.refused)
    for row in rows:
        if gains or row.why == REQUESTED:
            alone = len(rows) == 1
            decided[row.key] = row._replace(fall=fall if alone else row.fall, accepted=True)
        else:
            refused.add(row.key)
            decided[row.key] = row._replace(fall=fall, accepted=False, why="gains nothing in a fit")
    return replace(state, rows=decided, refused=frozenset(refused))


def use_true_noise(state: SearchState, data: Data) -> SearchState:
    """Continue with the true noise, once the large effects have been added."""
    state = replace(state, data=data, refused=frozenset())
    return replace(state, fit=state.fit_again())


def explain_scatter(state: SearchState) -> SearchState:
    """Find the likeliest cause of the scatter from sample to sample, and fit with it."""
    moving = [candidate for candidate in state.candidates if candidate.effect.beam]
    data, result, scatter = fit_with_scatter(
        state.sensor, state.data, state.fit, state.settings.outliers, bool(moving)
    )
    rows = dict(state.rows)
    for candidate in (
        candidate for candidate in moving if candidate.key not in state.accepted_keys
    ):
        accepted, why = BEAM_SCATTER in scatter.causes, "nothing is left to explain"
        if scatter.causes:
            why = "the data call for it" if accepted else "something else is likelier"
        count = 2 * len(state.data.raw) * accepted
        fall = state.fit.loss - result.loss if accepted else 0.0
        rows[candidate.key] = Decision(
            candidate.key, candidate.effect.words, count, fall, np.nan, accepted, why
        )
    return replace(state, data=data, fit=result, scatter=scatter, rows=rows)


def exclude_late_outliers(state: SearchState) -> SearchState:
    """Remove outliers that the residuals of the earlier fits had hidden."""
    excluded = state.outliers
    data, result, more = exclude_outliers(
        state.sensor, state.data, state.fit, state.settings.outliers, len(excluded)
    )
    return replace(state, data=data, fit=result, outliers=sorted([*excluded, *more]))
