"""The search for the effects that the data need, in stages.

The stages of `search`: add the effects that a key requires; add the best of the others repeatedly,
first with the noise raised to the size of the plain fit's residuals, then with the true noise;
explain the scatter from sample to sample; remove outliers that were hidden before; and settle the
last fit.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..core.sensor import Sensor
from .bundle_adjustment import Data, deviations
from .candidates import Candidate, add_candidate, candidates, effects_without_columns
from .fit import NORMAL_MEDIAN, Fit, StoppingRule, fit
from .laser import fit_steady_laser
from .linear_prediction import (
    CHANCE,
    Decision,
    best_coating,
    chance_of,
    cross_validated_error,
    fold_equations,
    predict,
    rank_candidates,
    values_for,
)
from .outliers import exclude_outliers
from .scatter import NO_SCATTER, Scatter, fit_with_scatter
from .unknowns import PLACE

if TYPE_CHECKING:
    from ..core.calibrate import Calibrate

#: The plain fit's residuals over the noise, to which larger ones are brought at first: a linear
#: model's own error would look like an effect.
RAISED_TO = 3.0
#: How often at most the laser's steadiness is estimated anew, and the candidates tried again.
ROUNDS = 4
#: An intermediate fit ends after this many steps, or where another lowers chi-square by less.
INTERMEDIATE = StoppingRule(steps=12, fall=0.3)
#: Width over which edges are rolled off, mm, where a fit begins: at zero it has no derivative.
ROLLOFF_WIDTH, ROLLOFF_WIDTH_START_MM = "rolloff.width", 0.03
#: Candidates are added together down to this share of what the best brings: the linear model is
#: not accurate enough for the others until what is large has been added.
TOGETHER_SHARE = 0.1
REQUESTED = "asked for"


@dataclass(frozen=True)
class SearchState:
    """The result of the search so far.

    sensor: from which the last fit began.  data: with the noise of the present stage.  candidates:
    all of them.  fit: the last fit.  rows: the decision on each candidate by its key.  refused:
    keys that are not tried again at this stage.  outliers: rows that were removed.  scatter: causes
    and sizes of the scatter.
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
        return {key for key, row in self.rows.items() if row.accepted}

    def fit_again(self) -> Fit:
        """Continue the last fit until it settles, with the present sensor and data."""
        robust = self.settings.outliers
        return fit(self.sensor, self.data, self.fit.choice, robust, self.fit)


@dataclass(frozen=True)
class EffectSearch:
    """The result of the search for effects.

    sensor: from which the last fit began.  plain: the fit without candidates.  fit: the fit with
    the accepted candidates.  error: the cross-validated error of the plain fit.  rows: the decision
    on each candidate.  data: the samples that were fitted last.  outliers: rows that were removed.
    scatter: causes and sizes of the scatter from sample to sample.
    """

    sensor: Sensor
    plain: Fit
    fit: Fit
    error: float
    rows: list[Decision]
    data: Data
    outliers: list[int]
    scatter: Scatter


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
    left_out = predict(plain_equations, plain.choice.names).left_out
    return EffectSearch(state.sensor, plain, settled, cross_validated_error(left_out, plain),
                  ordered_decisions(state), state.data, state.outliers, state.scatter)  # fmt: skip


def ordered_decisions(state: SearchState) -> list[Decision]:
    """The decisions in the order of the candidates, followed by effects for which the table has no
    columns."""
    order = [candidate.key for candidate in state.candidates]
    rows = sorted(state.rows.values(), key=lambda row: order.index(row.key))
    return rows + [
        Decision(effect.key, effect.words, 0, np.nan, np.nan, False, effect.missing)
        for effect in effects_without_columns(state.candidates, state.settings)
    ]


# ---- the stages


def raise_noise(sensor: Sensor, data: Data, plain: Fit) -> Data:
    """Raise the noise so that the plain fit's residuals are a few times the noise.

    Detectors may be so fine that real light leaves residuals of a hundred times their noise.
    """
    size = NORMAL_MEDIAN * float(np.median(np.abs(plain.residuals[np.isfinite(data.raw)])))
    if size < 2 * RAISED_TO:
        return data
    return data._replace(noise=deviations(sensor, data) * (size / RAISED_TO))


def first_state(
    sensor: Sensor, data: Data, settings: Calibrate, plain: Fit, outliers: list[int]
) -> SearchState:
    """The state before any decision but those on unknowns of the plain fit."""
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

    The laser's jitter is estimated again after each round, because less of the residuals is then
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
    """Add the best of the remaining candidates, and return whether any was good.

    Expensive candidates are tried one by one, after the others.
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
            together = [row for row in good if row.fall > TOGETHER_SHARE * largest]
            keys = {row.key for row in together}
            chosen = [candidate for candidate in group if candidate.key in keys]
            return add_candidates(state, chosen, together), True
    return state, False


def add_candidates(
    state: SearchState, several: list[Candidate], rows: list[Decision]
) -> SearchState:
    """Fit again with candidates; keep the previous fit if the new one gains nothing.

    An intermediate fit need not settle, because it may do so once others are added.
    """
    sensor, wider = state.sensor, state.fit.choice
    for candidate in several:
        wider = add_candidate(wider, candidate)
    if any(candidate.effect.coated for candidate in several):
        sensor, _ = best_coating(sensor, state.data, state.fit, wider)
    every = values_for(sensor, state.fit)
    if ROLLOFF_WIDTH in wider.names and not every[PLACE[ROLLOFF_WIDTH]]:
        every[PLACE[ROLLOFF_WIDTH]] = ROLLOFF_WIDTH_START_MM
    start = replace(state.fit, all_values=every)
    better = fit(sensor, state.data, wider, state.settings.outliers, start,
                 INTERMEDIATE)  # fmt: skip
    fall = state.fit.loss - better.loss
    gains = chance_of(fall, max(sum(row.unknowns for row in rows), 1)) <= CHANCE
    decided, refused = dict(state.rows), set(state.refused)
    for row in rows:
        if gains or row.why == REQUESTED:
            alone = len(rows) == 1
            decided[row.key] = row._replace(fall=fall if alone else row.fall, accepted=True)
        else:
            refused.add(row.key)
            decided[row.key] = row._replace(fall=fall, accepted=False, why="gains nothing in a fit")
    state = replace(state, rows=decided, refused=frozenset(refused))
    if gains or any(row.why == REQUESTED for row in rows):
        return replace(state, sensor=sensor, fit=better)
    return state


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
        accepted, why = "beam" in scatter.causes, "nothing is left to explain"
        if scatter.causes:
            why = "the data call for it" if accepted else "something else is likelier"
        count = 2 * len(state.data.raw) * accepted
        fall = state.fit.loss - result.loss if accepted else 0.0
        rows[candidate.key] = Decision(
            candidate.key, candidate.effect.words, count, fall, np.nan, accepted, why
        )
    return replace(state, data=data, fit=result, scatter=scatter, rows=rows)


def exclude_late_outliers(state: SearchState) -> SearchState:
    """Remove samples whose jumps were smaller than the model's error before."""
    gone = state.outliers
    data, result, more = exclude_outliers(
        state.sensor, state.data, state.fit, state.settings.outliers, len(gone)
    )
    return replace(state, data=data, fit=result, outliers=sorted([*gone, *more]))
