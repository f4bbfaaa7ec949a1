"""Causes: the alternatives that explain the residuals of a fit, and those that may be named.

The best alternative is added to the fit's unknowns, then the best of the remaining residuals, and
so on. Each is then compared with all others in its place: those that it does not beat by more than
chance are its rivals, and only their group is named. The probability of each is multiplied by the
number of alternatives and of their trials.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
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

#: Maximum number of causes that are reported.
MAX_CAUSES = 4
#: An effect with less than this probability of chance is likely, and its error is a part of the
#: uncertainty.
LIKELY_PROBABILITY = 0.05
#: A score below this fraction of the likeliest cause's may be due to that one's linear model.
LEAST_SCORE_FRACTION = 0.03
#: An alternative is beaten if it is `RIVAL_FACTOR` times less likely, and if its score is lower by
#: this many standard deviations of the difference between samples. It must also be lower by this
#: fraction of the better score, which is the error of a linear model of large effects.
RIVAL_SIGMAS, RIVAL_FRACTION = 2.0, 0.05
#: A chi-square per reading above this is not due to light that effects describe, unless by their
#: linear model. Alternatives that explain this fraction of it, up to this many, are undone before
#: effects are tried.
LARGE_CHI_SQUARE, LARGE_FRACTION, MAX_LARGE_CAUSES = 4.0, 0.4, 2
#: The least ratio of the residuals' noise to the stated noise that counts.
NOISY = 1.1
#: An effect in the powers that is not light must exceed the model's accuracy by this factor.
POWER_FACTOR = 4.0
#: Shifts of poses, relative to the stated uncertainty, above which a cause forbids to use the
#: result. The first is for a cause that remains with the sensor. Another one is undone, and its
#: shift is a part of the uncertainty.
MAX_SHIFT, MAX_UNDONE_SHIFT = 1.0, 4.0
#: A pose is unknown if its variance is this many times the median.
WORST_VARIANCE = 100.0
#: Unknowns of a run that do not belong to the sensor, by the beginnings of their names.
RUN_UNKNOWNS = ("lever.", "apex.", "reference.", "backlash.", "lag.", "time.",
                "temperature.", "past.")  # fmt: skip


@dataclass(frozen=True)
class Cause:
    """An alternative, or several rivals, that explain a part of the residuals.

    traces: of the likeliest alternative, then of its rivals.  remainder: the residuals in addition
    to the other causes.  shift: by which it moves the poses, relative to the stated uncertainty.
    chances: the probability of each alternative if it is one of them.
    """

    traces: tuple[Trace, ...]
    remainder: Remainder
    shift: float
    chances: tuple[float, ...] = (1.0,)

    @property
    def alternatives(self) -> tuple[Alternative, ...]:
        """The alternatives of the traces, in their order, the likeliest first."""
        return tuple(BY_KEY[trace.key] for trace in self.traces)

    @property
    def clauses(self) -> list[str]:
        """Each alternative in words, with its size."""
        pairs = zip(self.alternatives, self.traces, strict=True)
        return [f"{part.words} {part.size(trace, self.remainder)}".strip() for part, trace in pairs]

    @property
    def best(self) -> Trace:
        """The trace of the likeliest alternative."""
        return self.traces[0]

    @property
    def lasting_misfit(self) -> Floats:
        """The mean square (9, 9) of its effect on readings when poses are measured, mm and mW, by
        the alternatives that remain with the sensor, each weighted by its probability."""
        rest, square = self.remainder, np.zeros((9, 9))
        count = np.sqrt(np.maximum(rest.is_read.sum(axis=0), 1))
        for part, trace, chance in zip(self.alternatives, self.traces, self.chances, strict=True):
            if part.persists:
                effect = np.nan_to_num(trace_in_use(rest, trace).effect * rest.noise) / count
                square += chance * effect.T @ effect
        return square

    @property
    def size(self) -> float:
        """The r.m.s. effect on the readings that no unknown absorbs, relative to their noise."""
        effect = self.remainder.visible_effect(self.best) / self.remainder.noise
        return float(np.sqrt((effect[self.remainder.is_read] ** 2).mean()))

    @property
    def is_most(self) -> bool:
        """Whether it explains most of the residuals alone, and does not represent a group."""
        is_large = self.best.fall > LARGE_FRACTION * self.remainder.chi_square
        return is_large and not self.alternatives[0].general

    @property
    def is_small(self) -> bool:
        """Whether the cause shifts poses by too little to refuse a calibration."""
        most = MAX_SHIFT if self.alternatives[0].persists else MAX_UNDONE_SHIFT
        return self.shift <= most

    @property
    def refuses(self) -> bool:
        """Whether the calibration must be refused: because of the kind of cause, or its size."""
        return self.alternatives[0].refuses or not self.is_small


def trace_in_use(remainder: Remainder, trace: Trace) -> Trace:
    """The trace with the columns that apply when poses are measured."""
    in_use = BY_KEY[trace.key].in_use
    return trace._replace(columns=in_use(remainder)) if in_use else trace


def undo_causes(data: Data, causes: list[Cause]) -> Data:
    """Samples without the effects of causes on their readings, except of a cause that represents a
    group, since it could be anything."""
    raw, numbers = data.raw.copy(), row_numbers(data)
    for cause in causes:
        if cause.alternatives[0].general:
            continue
        fitted = cause.remainder.row_numbers
        rows = np.searchsorted(fitted, numbers).clip(max=len(fitted) - 1)
        effect = np.nan_to_num(cause.best.effect * cause.remainder.noise)[rows]
        raw -= effect * (fitted[rows] == numbers)[:, None]
    return data._replace(raw=raw)


def restore_readings(data: Data, original: Data) -> Data:
    """Samples with the readings of the same rows of other samples."""
    rows = np.searchsorted(row_numbers(original), row_numbers(data))
    return data._replace(raw=original.raw[rows])


def raise_noise(remainder: Remainder, robust: float | None, together: Together) -> Remainder:
    """The remainder with the noise of each reading raised to that of most residuals.

    With a noise that is stated too small, anything that follows a few residuals would explain it.
    """
    residuals = np.where(remainder.is_read, np.abs(remainder.residuals), np.nan)
    size = np.nan_to_num(np.maximum(NORMAL_MEDIAN * median(residuals), 1.0), nan=1.0)
    if (size < NOISY).all():
        return remainder
    data = remainder.data._replace(noise=remainder.noise * size)
    return Remainder(remainder.nominal, data, remainder.fit, robust, together)


@one_thread
def find_large_causes(remainder: Remainder) -> list[Cause]:
    """The causes that explain most of residuals which are many times the noise."""
    limit, rest = LARGE_CHI_SQUARE * float(remainder.is_read.sum()), remainder
    chosen = list[Trace]()
    while len(chosen) < MAX_LARGE_CAUSES and rest.chi_square > limit:
        traces = clear_traces(rest)
        keys = [trace.key for trace in chosen]  # a cause that returns is its linear model's error
        if not traces or traces[0].fall < LARGE_FRACTION * rest.chi_square or traces[0].key in keys:
            break
        chosen.append(traces[0])
        rest = remainder.extend_by(chosen)
    return [Cause((trace,), remainder, 0.0) for trace in chosen]


@one_thread
def find_causes(remainder: Remainder) -> list[Cause]:
    """The causes that the residuals show beyond chance, the likeliest first."""
    chosen = list[Trace]()
    while len(chosen) < MAX_CAUSES:
        traces = clear_traces(remainder.extend_by(chosen))
        if not traces or traces[0].score < LEAST_SCORE_FRACTION * (
            chosen[0].score if chosen else 0.0
        ):
            break
        chosen.append(traces[0])
    extended = [remainder.extend_by([part for part in chosen if part is not trace])
                for trace in chosen]  # fmt: skip
    return [cause for cause in map(likeliest_cause, extended) if cause]


def likeliest_cause(remainder: Remainder) -> Cause | None:
    """The likeliest alternative and its rivals; None if the remainder shows none."""
    traces = clear_traces(remainder)
    if not traces:
        return None
    best, *others = rivals(traces, remainder)
    odds = np.array([1.0, *(odds_against(best, part, remainder) for part in others)])
    completed = tuple(complete_if_moving(remainder, trace) for trace in (best, *others))
    chances = tuple((odds / odds.sum()).tolist())
    return Cause(completed, remainder, pose_shift(remainder, completed[0]), chances)


@one_thread
def unsaid_shift(remainder: Remainder) -> Floats:
    """The shift of the fit's unknowns (p,) by the likeliest alternative outside the sensor that is
    likely, but too uncertain to be reported; zero if there is none."""
    others = [part for part in ALTERNATIVES if part.group not in SENSOR_GROUPS]
    likely = clear_traces(remainder, others, LIKELY_PROBABILITY)
    if not likely:
        return np.zeros(len(remainder.fit.values))
    return remainder.shift_of_unknowns(complete_if_moving(remainder, likely[0]))


def clear_traces(
    remainder: Remainder,
    alternatives: Sequence[Alternative] = ALTERNATIVES,
    chance: float = REPORT_PROBABILITY,
) -> list[Trace]:
    """The alternatives beyond chance whose effects exceed the model's error, in the order of
    `sort_traces`."""
    limit = float(np.log(len(ALTERNATIVES) / chance))
    tried = (clear_trace(remainder, alternative, limit) for alternative in alternatives)
    return sort_traces(list(filter(None, tried)), remainder)


def sort_traces(several: list[Trace], remainder: Remainder) -> list[Trace]:
    """Sort traces, the likeliest first, and those that represent a group after its members."""
    traces = sorted(several, key=lambda trace: -trace.score)
    specific = [trace for trace in traces if not is_general(trace)]
    is_specific = specific and not beats(traces[0], specific[0], remainder)
    return sorted(traces, key=is_general) if is_specific else traces


def is_general(trace: Trace) -> bool:
    """Whether its alternative represents a group."""
    return BY_KEY[trace.key].general


def clear_trace(remainder: Remainder, alternative: Alternative, limit: float) -> Trace | None:
    """The trace of an alternative; None if its score is not above a limit, its effect invisible, or
    no such light in the model."""
    assert alternative.test is not None
    try:
        trace = alternative.test(remainder)
    except InputError:  # the sensor's model has no such light
        return None
    if trace.score <= limit:
        return None
    # unknowns that come nearer to their priors are no evidence of the samples
    trace = trace._replace(fall=float(sample_falls(remainder, trace).sum()))
    return trace if trace.score > limit and is_visible(remainder, trace) else None


def is_visible(remainder: Remainder, trace: Trace) -> bool:
    """Whether the effect on the readings exceeds the accuracy of the model of real light. Powers
    show little of effects that are not light."""
    if not any(name in EFFECTS for name in remainder.fit.choice.names):
        return True
    effect = np.where(remainder.is_read, remainder.visible_effect(trace), 0.0)
    count = np.maximum(remainder.is_read.sum(axis=0), 1)
    size = np.sqrt((effect**2).sum(axis=0) / count) / model_accuracy(remainder.data)
    if BY_KEY[trace.key].group not in ("light", "facets"):
        size[2::3] /= POWER_FACTOR
    return bool((size > 1).any())


def odds_against(better: Trace, other: Trace, remainder: Remainder) -> float:
    """The odds of an alternative against a better one.

    The difference of their scores counts relative to the one at which the other is beaten, which
    includes the scatter of the samples and the error of a linear model.
    """
    differences = sample_falls(remainder, better) - sample_falls(remainder, other)
    sigma = float(np.sqrt(len(differences)) * differences.std()) / 2
    beaten = max(np.log(RIVAL_FACTOR), RIVAL_SIGMAS * sigma, RIVAL_FRACTION * better.score)
    return float(RIVAL_FACTOR ** ((other.score - better.score) / beaten))


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
    """Alternatives outside the light that explain as much as unknowns of the beam's cross-section,
    the likeliest first, and whether the best of them beats these unknowns."""
    bare = drop_unknowns(remainder, names)
    shape = score_columns(bare, "shape", unknown_columns(remainder, names))
    others = [
        trace for trace in clear_traces(bare)
        if BY_KEY[trace.key].group != "light" and not is_general(trace)
        and not beats(shape, trace, bare)
    ]  # fmt: skip
    return others, bool(others) and beats(others[0], shape, bare)


def complete_if_moving(remainder: Remainder, trace: Trace) -> Trace:
    """Return the completed trace if the completion moves the poses by the sensor's own parameters;
    another position of the mirror on the reference moves none."""
    completed = complete_trace(remainder, trace)
    difference = trace._replace(amounts=completed.amounts - trace.amounts)
    slopes = pose_slopes(remainder)
    moved = shifted_poses(remainder, slopes, difference)
    relative = np.sqrt((moved**2).mean(axis=0) / slopes.variance)
    return completed if relative.max() > LEAST_COUNTED else trace


def pose_shift(remainder: Remainder, trace: Trace) -> float:
    """The r.m.s. shift of solved poses by an alternative, relative to their stated uncertainty, in
    the worst axis, with the beam known and the power unknown."""
    slopes = pose_slopes(remainder)
    moved, across = shifted_poses(remainder, slopes, trace), slopes.by_unknowns
    size = across.shape[2]
    covariance = remainder.covariance[:size, :size]
    stated = np.einsum("nip,pq,niq->i", across, covariance, across, optimize=True) / len(across)
    return float(np.sqrt((moved**2).mean(axis=0) / (slopes.variance + stated)).max())


class PoseSlopes(NamedTuple):
    """The derivatives of solved poses, in `OWN_UNITS`.

    is_known: the samples (n,) whose readings fix their pose.  by_readings: (m, 6, 9) of these, in
    standard deviations.  by_unknowns: (m, 6, p) by the fit's unknowns that belong to the sensor.
    variance: (6,) of one pose by its readings.
    """

    is_known: Booleans
    by_readings: Floats
    by_unknowns: Floats
    variance: Floats


def pose_slopes(remainder: Remainder) -> PoseSlopes:
    """Derivatives of single poses by the readings and by the sensor's unknowns; samples whose pose
    is poorly known are excluded."""
    like = remainder.likelihood
    names = remainder.fit.choice.names
    of_sensor = np.array([not name.startswith(RUN_UNKNOWNS) for name in names])
    by_pose = like.own[:, :, :7]
    inner = np.linalg.inv(np.swapaxes(by_pose, 1, 2) @ by_pose + 1e-9 * np.eye(7))
    gain = (inner @ np.swapaxes(by_pose, 1, 2))[:, :6]
    each = np.diagonal(inner, axis1=1, axis2=2)[:, :6]
    size = each.max(axis=1)
    is_known = size <= WORST_VARIANCE * np.median(size)
    by_unknowns = (gain @ (like.common * of_sensor))[is_known]
    return PoseSlopes(is_known, gain[is_known], by_unknowns, each[is_known].mean(axis=0))


def shifted_poses(remainder: Remainder, slopes: PoseSlopes, trace: Trace) -> Floats:
    """The shifts of solved poses (m, 6) by an alternative.

    One that remains with the sensor acts on every reading; another one, by the unknowns that it
    would have moved.
    """
    used = trace_in_use(remainder, trace)
    if not BY_KEY[trace.key].persists:
        return slopes.by_unknowns @ remainder.shift_of_unknowns(used)
    error = (used.effect * remainder.is_read)[slopes.is_known]
    moved: Floats = (slopes.by_readings @ error[:, :, None])[:, :, 0]
    return moved
