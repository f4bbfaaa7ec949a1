"""Alternatives: possible causes of a fit's residuals, described as data."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...core.names import POSE
from ...core.units import Floats

if TYPE_CHECKING:
    from ..fitting.bundle_adjustment import Data

#: With fewer free columns than this, the unknowns and priors explain the whole alternative.
MIN_FREE_COLUMNS = 0.1
#: Alternatives less likely by chance than this are reported.
REPORT_PROBABILITY = 1e-5
#: An alternative up to this many times less likely than the best one cannot be excluded.
RIVAL_FACTOR = 20.0
#: The least fall of chi-square, or of -2 log L, for which one more cause is added to others.
MIN_ADDED_FALL = 10.0
#: Number of screened trials that are then evaluated exactly.
EXACT_TRIALS = 4
#: Maximum number of rows that a sentence lists.
MAX_LISTED_ROWS = 12
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
#: Groups of alternatives that remain with the sensor.
SENSOR_GROUPS = ("light", "facets", "detectors", "electronics")
#: Changes of a component during a calibration, as verbs, by key.
CHANGE_VERBS = {
    "jumped": "jumped",
    "drifted": "drifted",
    "oscillated": "oscillated",
    "warmed": "followed the temperature",
}
#: Changes that end with the calibration run, or that the sensor's temperature coefficients
#: describe in later poses.
NOT_PERSISTENT = ("jumped", "drifted", "warmed")


class Finding(NamedTuple):
    """A result of the checks, in words.

    bad: whether it forbids to use the calibration.  words: full sentences.  causes: the keys of the
    alternatives that it names, more than one if the samples cannot distinguish them.
    """

    bad: bool
    words: str
    causes: tuple[str, ...] = ()


class Trace(NamedTuple):
    """The part of the residuals that an alternative would explain.

    key: of the alternative.  fall: the decrease of chi-square by `free` columns that the unknowns
    do not explain, the largest of a number of trials; log_trials: the logarithm of that number.
    columns: (n, 9, q) in standard deviations of the readings.  amounts: (q,) of the columns, in
    the units of the alternative.  at: the best trial: the rows before which it began and ended, a
    period in rows or mm, a place in mm, a frequency; empty without trials.  prior: prior
    information on the amounts.  is_partial: whether directions that the unknowns nearly explain
    were excluded.
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
        """Minus the logarithm of the probability of such a fall if the alternative is absent."""
        return -log_chance(self.fall, self.free) - self.log_trials

    @property
    def effect(self) -> Floats:
        """The effect (n, 9) on the readings, in their standard deviations."""
        effect: Floats = self.columns @ self.amounts
        return effect


def chance_of(fall: float, count: float) -> float:
    """Probability that columns without an effect lower chi-square by this fall or more."""
    from scipy.special import chdtrc

    return float(chdtrc(count, max(fall, 0.0)))


def log_chance(fall: float, count: float) -> float:
    """Logarithm of `chance_of`, also where that underflows."""
    from scipy.special import gammaln

    if count < MIN_FREE_COLUMNS:  # the unknowns explain all columns
        return 0.0
    chance = chance_of(fall, count)
    if chance > 1e-290:
        return float(np.log(chance))
    half = fall / 2
    return float(-half + (count / 2 - 1) * np.log(half) - gammaln(count / 2))


def no_size(trace: Trace, remainder: Any) -> str:
    """The empty size of an alternative that states none."""
    return ""


@dataclass(frozen=True)
class Alternative:
    """A possible cause of the residuals.

    key: its name.  group: out of `GROUPS`.  words: the cause, as a clause.  remedy: the action to
    take, in the imperative.  measurement: one that distinguishes it from others, in the imperative.

    It acts in one of three ways.  By columns: `test` takes a `Remainder` and returns the part of
    the residuals that they explain, and `size` describes that in words.  `in_use` returns other
    columns that apply when poses are measured, in another motion or state.  By a `change` of the
    samples that undoes it.  Or by a larger `variance` of quantities, by name.

    refuses: whether a calibration with it is never to be trusted; without, only if it moves the
    poses by more than is stated.  general: whether it represents its group as a whole, so that
    other members are named in preference to it.
    """

    key: str
    group: str
    words: str
    remedy: str = ""
    measurement: str = ""
    test: Callable[[Any], Trace] | None = None
    size: Callable[[Trace, Any], str] = no_size
    in_use: Callable[[Any], Floats] | None = None
    change: Callable[[Data], Data] | None = None
    variance: tuple[str, ...] = ()
    refuses: bool = False
    general: bool = False

    @property
    def persists(self) -> bool:
        """Whether it remains with the sensor, and so affects every pose that is solved with it."""
        return self.group in SENSOR_GROUPS and not self.key.endswith(NOT_PERSISTENT)


def capitalise(words: str) -> str:
    """The words with a capital first letter; the others are not changed."""
    return words[:1].upper() + words[1:]


def describe_pose(sizes: Floats) -> str:
    """List a pose's sizes (6,), mm and rad, that are a fifth of the largest of their kind or
    more."""
    listed = list[str]()
    for axes, factor, unit in ((slice(0, 3), 1e3, "um"), (slice(3, 6), 1e6, "urad")):
        largest = np.abs(sizes[axes]).max()
        listed += [
            f"{factor * size:.2g} {unit} in {name}"
            for name, size in zip(POSE[axes], sizes[axes].tolist(), strict=True)
            if abs(size) > 0.2 * largest
        ]
    return ", ".join(listed)


def describe_rivals(alternatives: Iterable[Alternative], clauses: Iterable[str]) -> str:
    """Sentences on alternatives that the samples cannot distinguish: their group if they share one,
    what they are, and the measurements that distinguish them."""
    rivals = list(alternatives)
    groups = list(dict.fromkeys(rival.group for rival in rivals))
    group = f"It lies in {GROUPS[groups[0]]}, and these" if len(groups) == 1 else "These"
    measurements = dict.fromkeys(rival.measurement for rival in rivals if rival.measurement)
    advice = f" To distinguish them: {'; '.join(measurements)}." if measurements else ""
    return f"{group} samples cannot tell which it is: {'; or '.join(clauses)}.{advice}"
