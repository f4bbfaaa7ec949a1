"""Which alternatives explain what a fit leaves, one beside another, and which of them may be named.

The best alternative is taken beside the fit's unknowns, then the best of what is left, and so on.
Each is then compared with all others in its place: those that it does not beat by more than chance
are its rivals, and only their group is named. The number of alternatives and of their trials counts
as so many chances.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from ...core.errors import InputError
from ...core.small_matrices import one_thread
from ...core.units import Booleans, Floats
from ...estimation.dwells import median
from ...model.arrays import EFFECTS
from ..fitting.bundle_adjustment import LEAST_COUNTED, Data
from ..fitting.fit import NORMAL_MEDIAN
from ..fitting.samples import model_accuracy, row_numbers
from .alternative import (
    EXACT_TRIALS,
    REPORT_PROBABILITY,
    RIVAL_FACTOR,
    SENSOR_GROUPS,
    Alternative,
    Trace,
)
from .columns import unknown_columns
from .entries import ALTERNATIVES, BY_KEY
from .remainder import Remainder, drop_unknowns
from .scatter import Together
from .score import complete_trace, sample_falls, score_columns

#: How many causes are told at most.
MOST_CAUSES = 4
#: The chance below which a thing is likely, and its error is part of the uncertainty.
LIKELY_CHANCE = 0.05
#: What has less than this share of the likeliest cause's score may come of its linear model.
LEAST_SHARE = 0.03
#: An alternative is beaten where it is `RIVAL_FACTOR` times less likely, by so many standard
#: deviations of the difference between samples, and by this share of the better one's score, which
#: a linear model of large errors is wrong by.
APART_SIGMAS, APART_SHARE = 2.0, 0.05
#: Residuals of more than this chi-square a reading come of no light that effects describe but for
#: their linear model; what explains this share of them is undone before effects are tried.
LARGE_CHI_SQUARE, LARGE_SHARE, MOST_LARGE = 4.0, 0.4, 2
#: The least ratio of the noise that residuals have to the stated one that counts.
NOISY = 1.1
#: How many times larger than the model's accuracy an effect in the powers is, of what is no light.
POWER_FACTOR = 4.0
#: Steps that are not told from steady light, which no effect has yet.
LIKE_STEADY_LIGHT = ("lamp.jumped", "dark.jumped")
#: What moves the poses by more than this share of what is stated forbids the use: what stays with
#: the sensor, and what does not, which is undone and of which the uncertainty has the shift.
MOST_SHIFT, MOST_UNDONE_SHIFT = 1.0, 4.0
#: A pose is not known where its variance is so many times that of most.
WORST_VARIANCE = 100.0
#: Unknowns of a run that are no part of the sensor.
RUN_UNKNOWNS = ("lever.", "apex.", "reference.", "backlash.", "lag.", "time.",
                "temperature.", "past.")  # fmt: skip


@dataclass(frozen=True)
class Cause:
    """What explains a part of the residuals.

    traces: of the likeliest alternative, and of its rivals; the first comes first.  remainder: the
    residuals beside the other causes.  shift: by how much it moves the poses, over what is stated.
    chances: how likely each of the alternatives is, if it is one of them.
    """

    traces: tuple[Trace, ...]
    remainder: Remainder
    shift: float
    chances: tuple[float, ...] = (1.0,)

    @property
    def alternatives(self) -> tuple[Alternative, ...]:
        return tuple(BY_KEY[trace.key] for trace in self.traces)

    @property
    def clauses(self) -> list[str]:
        """What is wrong by each of them, with its size."""
        pairs = zip(self.alternatives, self.traces, strict=True)
        return [f"{part.words} {part.size(trace, self.remainder)}".strip() for part, trace in pairs]

    @property
    def best(self) -> Trace:
        return self.traces[0]

    @property
    def lasting_misfit(self) -> Floats:
        """The mean square (9, 9) of what it may do to readings when poses are measured, mm and mW:
        by those of its alternatives that stay with the sensor, as likely as each is."""
        rest, whole = self.remainder, np.zeros((9, 9))
        count = np.sqrt(np.maximum(rest.is_read.sum(axis=0), 1))
        for part, trace, chance in zip(self.alternatives, self.traces, self.chances, strict=True):
            if part.persists:
                effect = np.nan_to_num(trace_in_use(rest, trace).effect * rest.noise) / count
                whole += chance * effect.T @ effect
        return whole

    @property
    def size(self) -> float:
        """The r.m.s. of what it does to the readings and no unknown takes up, over their noise."""
        effect = self.remainder.visible_effect(self.best) / self.remainder.noise
        return float(np.sqrt((effect[self.remainder.is_read] ** 2).mean()))

    @property
    def is_most(self) -> bool:
        """Whether it explains most of the residuals by itself, and stands for no group."""
        is_large = self.best.fall > LARGE_SHARE * self.remainder.chi_square
        return is_large and not self.alternatives[0].general

    @property
    def is_small(self) -> bool:
        most = MOST_SHIFT if self.alternatives[0].persists else MOST_UNDONE_SHIFT
        return self.shift <= most

    @property
    def refuses(self) -> bool:
        return self.alternatives[0].refuses or not self.is_small


def trace_in_use(remainder: Remainder, trace: Trace) -> Trace:
    """The trace with the columns that it has when poses are measured."""
    in_use = BY_KEY[trace.key].in_use
    return trace._replace(columns=in_use(remainder)) if in_use else trace


def undo_causes(data: Data, causes: list[Cause]) -> Data:
    """Samples without what causes do to their readings; what stands for a group is left, since it
    could be anything."""
    raw, numbers = data.raw.copy(), row_numbers(data)
    for cause in causes:
        if cause.alternatives[0].general:
            continue
        known = cause.remainder.row_numbers
        rows = np.searchsorted(known, numbers).clip(max=len(known) - 1)
        effect = np.nan_to_num(cause.best.effect * cause.remainder.noise)[rows]
        raw -= effect * (known[rows] == numbers)[:, None]
    return data._replace(raw=raw)


def restore_readings(data: Data, original: Data) -> Data:
    """Samples with the readings that the same rows of others have."""
    rows = np.searchsorted(row_numbers(original), row_numbers(data))
    return data._replace(raw=original.raw[rows])


def raise_noise(remainder: Remainder, robust: float | None, together: Together) -> Remainder:
    """The remainder with the noise of each reading that most residuals have, where that is larger
    than the stated one: else whatever follows a few of them would explain the noise."""
    left = np.where(remainder.is_read, np.abs(remainder.residuals), np.nan)
    size = np.nan_to_num(np.maximum(NORMAL_MEDIAN * median(left), 1.0), nan=1.0)
    if (size < NOISY).all():
        return remainder
    data = remainder.data._replace(noise=remainder.noise * size)
    return Remainder(remainder.nominal, data, remainder.fit, robust, together)


@one_thread
def steps_as_changes(remainder: Remainder) -> list[Alternative]:
    """What jumped once, by residuals in which nothing else is sure, as changes that undo it; the
    likeliest first."""
    steps = []
    for trace in clear_traces(remainder):
        cause = Cause((trace,), remainder, 0.0)
        part = cause.alternatives[0]
        if part.refuses and part.key not in LIKE_STEADY_LIGHT and len(trace.at) == 1:
            change = partial(undo_causes, causes=[cause])
            steps.append(replace(part, words=cause.clauses[0], change=change))
    return steps[:EXACT_TRIALS]


@one_thread
def find_large_causes(remainder: Remainder) -> list[Cause]:
    """The causes that explain most of residuals which are many times the noise."""
    least, rest = LARGE_CHI_SQUARE * float(remainder.is_read.sum()), remainder
    chosen = list[Trace]()
    while len(chosen) < MOST_LARGE and rest.chi_square > least:
        traces = clear_traces(rest)
        known = [trace.key for trace in chosen]  # the rest of one is what its linear model misses
        if not traces or traces[0].fall < LARGE_SHARE * rest.chi_square or traces[0].key in known:
            break
        chosen.append(traces[0])
        rest = remainder.extend_by(chosen)
    return [Cause((trace,), remainder, 0.0) for trace in chosen]


@one_thread
def find_causes(remainder: Remainder) -> list[Cause]:
    """The causes that the residuals call for beyond chance; the likeliest first."""
    chosen = list[Trace]()
    while len(chosen) < MOST_CAUSES:
        traces = clear_traces(remainder.extend_by(chosen))
        if not traces or traces[0].score < LEAST_SHARE * (chosen[0].score if chosen else 0.0):
            break
        chosen.append(traces[0])
    beside = [remainder.extend_by([part for part in chosen if part is not trace])
              for trace in chosen]  # fmt: skip
    return [cause for cause in map(likeliest_cause, beside) if cause]


def likeliest_cause(remainder: Remainder) -> Cause | None:
    """The likeliest alternative and its rivals beside the other causes; None where these explain
    it."""
    traces = clear_traces(remainder)
    if not traces:
        return None
    best, *others = rivals(traces, remainder)
    odds = np.array([1.0, *(odds_against(best, part, remainder) for part in others)])
    whole = tuple(whole_trace(remainder, trace) for trace in (best, *others))
    chances = tuple((odds / odds.sum()).tolist())
    return Cause(whole, remainder, pose_shift(remainder, whole[0]), chances)


@one_thread
def unsaid_shift(remainder: Remainder) -> Floats:
    """By how much the likeliest thing beside the sensor would have moved the unknowns of the fit
    (p,), where it is likely and not sure enough to be told; else zero."""
    beside = [part for part in ALTERNATIVES if part.group not in SENSOR_GROUPS]
    likely = clear_traces(remainder, beside, LIKELY_CHANCE)
    if not likely:
        return np.zeros(len(remainder.fit.values))
    return remainder.shift_of_unknowns(whole_trace(remainder, likely[0]))


def clear_traces(
    remainder: Remainder,
    alternatives: Sequence[Alternative] = ALTERNATIVES,
    chance: float = REPORT_PROBABILITY,
) -> list[Trace]:
    """The alternatives beyond a chance whose effect is larger than the model's own error; the
    likeliest first, those that stand for a group behind its members."""
    limit = float(np.log(len(ALTERNATIVES) / chance))
    tried = (clear_trace(remainder, alternative, limit) for alternative in alternatives)
    return sort_traces(list(filter(None, tried)), remainder)


def sort_traces(several: list[Trace], remainder: Remainder) -> list[Trace]:
    """The likeliest first, those that stand for a group behind its members."""
    traces = sorted(several, key=lambda trace: -trace.score)
    specific = [trace for trace in traces if not is_general(trace)]
    is_specific = specific and not beats(traces[0], specific[0], remainder)
    return sorted(traces, key=is_general) if is_specific else traces


def is_general(trace: Trace) -> bool:
    """Whether it stands for its whole group."""
    return BY_KEY[trace.key].general


def clear_trace(remainder: Remainder, alternative: Alternative, limit: float) -> Trace | None:
    """The trace of an alternative whose score is beyond a limit, and what it does visible."""
    assert alternative.test is not None
    try:
        trace = alternative.test(remainder)
    except InputError:  # the sensor's model has no such light
        return None
    if trace.score <= limit:
        return None
    # what unknowns gain by being nearer to what was known before says nothing of the samples
    trace = trace._replace(fall=float(sample_falls(remainder, trace).sum()))
    return trace if trace.score > limit and is_visible(remainder, trace) else None


def is_visible(remainder: Remainder, trace: Trace) -> bool:
    """Whether the readings show more of an effect than the model of real light errs by; of what is
    no light, the powers show little."""
    if not any(name in EFFECTS for name in remainder.fit.choice.names):
        return True
    effect = np.where(remainder.is_read, remainder.visible_effect(trace), 0.0)
    count = np.maximum(remainder.is_read.sum(axis=0), 1)
    size = np.sqrt((effect**2).sum(axis=0) / count) / model_accuracy(remainder.data)
    if BY_KEY[trace.key].group not in ("light", "facets"):
        size[2::3] /= POWER_FACTOR
    return bool((size > 1).any())


def odds_against(better: Trace, other: Trace, remainder: Remainder) -> float:
    """How much less likely than an alternative another one is, as far as the scatter of the samples
    and a linear model can tell: the scores' difference counts by what is the least to beat it."""
    apart = sample_falls(remainder, better) - sample_falls(remainder, other)
    sigma = float(np.sqrt(len(apart)) * apart.std()) / 2
    least = max(np.log(RIVAL_FACTOR), APART_SIGMAS * sigma, APART_SHARE * better.score)
    return float(RIVAL_FACTOR ** ((other.score - better.score) / least))


def beats(better: Trace, other: Trace, remainder: Remainder) -> bool:
    """Whether an alternative is likelier than another by more than chance and linearity allow."""
    return odds_against(better, other, remainder) < 1 / RIVAL_FACTOR


def rivals(traces: list[Trace], remainder: Remainder) -> list[Trace]:
    """The likeliest alternative, and those that it does not beat."""
    best = traces[0]
    return [best] + [
        trace for trace in traces[1:]
        if not is_general(trace) and not beats(best, trace, remainder)
    ]  # fmt: skip


def rivals_of_shape(remainder: Remainder, names: tuple[str, ...]) -> tuple[list[Trace], bool]:
    """What is no light and explains as well what unknowns of the beam's cross-section explain, the
    likeliest first; and whether that beats them."""
    bare = drop_unknowns(remainder, names)
    shape = score_columns(bare, "shape", unknown_columns(remainder, names))
    others = [
        trace for trace in clear_traces(bare)
        if BY_KEY[trace.key].group != "light" and not is_general(trace)
        and not beats(shape, trace, bare)
    ]  # fmt: skip
    return others, bool(others) and beats(others[0], shape, bare)


def whole_trace(remainder: Remainder, trace: Trace) -> Trace:
    """The trace, complete where that moves the poses by the sensor's own parameters; another place
    of the mirror on the reference moves none."""
    whole = complete_trace(remainder, trace)
    apart = trace._replace(amounts=whole.amounts - trace.amounts)
    slopes = pose_slopes(remainder)
    moved = shifted_poses(remainder, slopes, apart)
    over = np.sqrt((moved**2).mean(axis=0) / slopes.variance)
    return whole if over.max() > LEAST_COUNTED else trace


def pose_shift(remainder: Remainder, trace: Trace) -> float:
    """By how much an alternative moves solved poses, r.m.s., over their stated uncertainty; the
    worst axis, the beam known and the power unknown."""
    slopes = pose_slopes(remainder)
    moved, across = shifted_poses(remainder, slopes, trace), slopes.by_unknowns
    size = across.shape[2]
    covariance = remainder.covariance[:size, :size]
    stated = np.einsum("nip,pq,niq->i", across, covariance, across, optimize=True) / len(across)
    return float(np.sqrt((moved**2).mean(axis=0) / (slopes.variance + stated)).max())


class PoseSlopes(NamedTuple):
    """The derivatives of solved poses, in `OWN_UNITS`.

    known: the samples (n,) whose readings fix their pose.  by_readings: (m, 6, 9) of these, in
    standard deviations.  by_unknowns: (m, 6, p) by the fit's unknowns that belong to the sensor.
    variance: (6,) of one pose by its readings.
    """

    known: Booleans
    by_readings: Floats
    by_unknowns: Floats
    variance: Floats


def pose_slopes(remainder: Remainder) -> PoseSlopes:
    like = remainder.likelihood
    names = remainder.fit.choice.names
    kept = np.array([not name.startswith(RUN_UNKNOWNS) for name in names])
    by_pose = like.own[:, :, :7]
    inner = np.linalg.inv(np.swapaxes(by_pose, 1, 2) @ by_pose + 1e-9 * np.eye(7))
    gain = (inner @ np.swapaxes(by_pose, 1, 2))[:, :6]
    each = np.diagonal(inner, axis1=1, axis2=2)[:, :6]
    size = each.max(axis=1)
    known = size <= WORST_VARIANCE * np.median(size)
    by_unknowns = (gain @ (like.common * kept))[known]
    return PoseSlopes(known, gain[known], by_unknowns, each[known].mean(axis=0))


def shifted_poses(remainder: Remainder, slopes: PoseSlopes, trace: Trace) -> Floats:
    """By how much an alternative moves solved poses (m, 6).

    What stays with the sensor acts on every reading; what does not, by the unknowns that it would
    have moved.
    """
    used = trace_in_use(remainder, trace)
    if not BY_KEY[trace.key].persists:
        return slopes.by_unknowns @ remainder.shift_of_unknowns(used)
    error = (used.effect * remainder.is_read)[slopes.known]
    moved: Floats = (slopes.by_readings @ error[:, :, None])[:, :, 0]
    return moved
