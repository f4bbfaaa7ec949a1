"""What an alternative is: one of the things that could explain the residuals of a fit, as data."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...core.names import POSE
from ...core.units import Floats

if TYPE_CHECKING:
    from ..fitting.bundle_adjustment import Data

#: Of fewer columns than this nothing is left beside the unknowns and what was known before.
MIN_COUNT = 0.1
#: The chance below which something is told.
TOLD_CHANCE = 1e-5
#: What is so many times less likely than another thing cannot be excluded.
APART_CHANCE = 20.0
#: The fall of chi-square, or of -2 log L, that is worth one more thing beside others.
WORTH_MORE = 10.0
#: Of many trials that are screened, so many are made in earnest.
LAST_TRIALS = 4
#: How many rows a sentence lists.
MOST_ROWS_LISTED = 12
#: The groups of alternatives, in words.
GROUPS = {
    "light": "the light",
    "facets": "the mirror's facets",
    "detectors": "the detectors",
    "electronics": "the electronics",
    "reference": "the reference",
    "time": "the clocks",
    "environment": "the surroundings",
    "table": "the table",
}
#: The groups of what stays with the sensor.
OF_SENSOR = ("light", "facets", "detectors", "electronics")
#: How something moved during a calibration, as a verb, by key.
COURSES = {
    "jumped": "jumped",
    "drifted": "drifted",
    "oscillated": "oscillated",
    "warmed": "followed the temperature",
}
#: What goes on in no later pose, or as the sensor's own temperature coefficients have it.
OF_RUN = ("jumped", "drifted", "warmed")


class Finding(NamedTuple):
    """A finding.  bad: whether it forbids to use the calibration.  words: a whole sentence.
    causes: the keys of the alternatives that it names, more than one where the samples cannot tell
    which."""

    bad: bool
    words: str
    causes: tuple[str, ...] = ()


class Trace(NamedTuple):
    """The part of the residuals that an alternative would explain.

    key: of the alternative.  fall: of chi-square, by `free` columns beside those of the unknowns,
    the largest of a number of trials, whose logarithm is `log_trials`.  columns: (n, 9, q) in
    standard deviations of the readings.  amounts: (q,) of the columns, in the units of the
    alternative.  at: the place of the best trial: the rows behind which it began and ended, a
    period in rows or mm, a place in mm; empty without trials.  prior: information on the amounts
    before.  is_partial: whether directions that the unknowns nearly explain were left out.
    """

    key: str
    fall: float
    free: float
    columns: Floats
    amounts: Floats
    log_trials: float = 0.0
    at: tuple[float, ...] = ()
    prior: Floats | float = 0.0
    is_partial: bool = False

    @property
    def score(self) -> float:
        """Minus the logarithm of the chance of such a fall where the alternative is absent."""
        return -log_chance(self.fall, self.free) - self.log_trials

    @property
    def effect(self) -> Floats:
        """What it does to the readings (n, 9), in their standard deviations."""
        whole: Floats = self.columns @ self.amounts
        return whole


def chance_of(fall: float, count: float) -> float:
    """Probability of a fall of chi-square at least as large by a number of idle columns."""
    from scipy.special import chdtrc

    return float(chdtrc(count, max(fall, 0.0)))


def log_chance(fall: float, count: float) -> float:
    """The logarithm of `chance_of`, also where that is below the least number."""
    from scipy.special import gammaln

    if count < MIN_COUNT:  # the unknowns explain all columns
        return 0.0
    chance = chance_of(fall, count)
    if chance > 1e-290:
        return float(np.log(chance))
    half = fall / 2
    return float(-half + (count / 2 - 1) * np.log(half) - gammaln(count / 2))


def no_size(trace: Trace, remainder: Any) -> str:
    return ""


@dataclass(frozen=True)
class Alternative:
    """One of the things that could explain the residuals.

    key: its name.  group: out of `GROUPS`.  words: what is wrong, a clause.  remedy: what to do, an
    imperative.  apart: the measurement that tells it from others, an imperative.

    It acts in one of three ways: by columns, whose `test` of a `Remainder` gives the part of the
    residuals that they explain, `size` that in words, and `in_use` the columns that they are when
    poses are measured, where that is another motion or another state; by a `change` of the samples,
    which undoes it; or by a larger `variance` of what may scatter, by name.

    refuses: whether a calibration with it is never to be trusted; others forbid the use only where
    they move the poses by more than is stated.  general: whether it stands for its whole group, so
    that its members are named before it.
    """

    key: str
    group: str
    words: str
    remedy: str = ""
    apart: str = ""
    test: Callable[[Any], Trace] | None = None
    size: Callable[[Trace, Any], str] = no_size
    in_use: Callable[[Any], Floats] | None = None
    change: Callable[[Data], Data] | None = None
    variance: tuple[str, ...] = ()
    refuses: bool = False
    general: bool = False

    @property
    def persists(self) -> bool:
        """Whether it stays with the sensor, and so acts on every pose that is solved with it."""
        return self.group in OF_SENSOR and not self.key.endswith(OF_RUN)


def capitalise(words: str) -> str:
    return words[:1].upper() + words[1:]


def describe_pose(sizes: Floats) -> str:
    """Those of a pose's six sizes, mm and rad, that are a fifth of the largest of their kind, or
    more."""
    told = []
    for axes, factor, unit in ((slice(0, 3), 1e3, "um"), (slice(3, 6), 1e6, "urad")):
        largest = np.abs(sizes[axes]).max()
        told += [
            f"{factor * size:.2g} {unit} in {name}"
            for name, size in zip(POSE[axes], sizes[axes].tolist(), strict=True)
            if abs(size) > 0.2 * largest
        ]
    return ", ".join(told)


def describe_rivals(alternatives: Iterable[Alternative], clauses: Iterable[str]) -> str:
    """Sentences on several alternatives that the samples cannot tell apart: where they lie, which
    they are, and what would tell."""
    several = list(alternatives)
    groups = list(dict.fromkeys(alternative.group for alternative in several))
    where = f"It lies in {GROUPS[groups[0]]}, and these" if len(groups) == 1 else "These"
    apart = list(dict.fromkeys(part.apart for part in several if part.apart))
    tell = f" To tell them apart: {'; '.join(apart)}." if apart else ""
    return f"{where} samples cannot tell which it is: {'; or '.join(clauses)}.{tell}"
