"""Which effects the data call for: each tried beside the plain fit, then taken or left.

The normal equations at the fit, with a column for every candidate, say at once by how much
chi-square would fall if a candidate were let in. The same sums, made without a fifth of the
samples at a time, say how well what was found without them predicts them (cross-validation).
A candidate is taken where both speak for it; then everything is fitted again, and so on.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..core.names import DETECTORS
from ..core.sensor import Sensor
from ..core.units import Floats
from ..model.arrays import EFFECTS
from ..model.kinds import lit_kind
from .bundle_adjustment import Data, Linear, Normal, deviations, eliminated, linear, own_sigma
from .fit import NORMAL_MEDIAN, Fit, fit, prior_information
from .laser import steadied
from .outliers import LEAST_WEIGHT, without_outliers
from .scatter import NOTHING, Scatter, explained
from .spline import SPLINE
from .table import bends
from .unknowns import BACKLASH, DELAY, OF_DRIFT, PLACE, SKEW, Choice, assigned, values_of

if TYPE_CHECKING:
    from ..core.calibrate import Calibrate


#: Samples are left out by so many parts in turn.
FOLDS = 5
#: A candidate is taken where its fall of chi-square has at most this chance without it, and the
#: cross-validated chi-square falls by this much at least.
CHANCE, BETTER = 1e-4, 4.0


@dataclass(frozen=True)
class Candidate:
    """key: of `calibrate.effects`.  words: what it is.  sigma: its unknowns, known before.

    beam: how far the beam moves from sample to sample, mm.  coated: it needs a coating in the
    sensor to begin with.
    """

    key: str
    words: str
    sigma: dict[str, float]
    beam: float = 0.0
    coated: bool = False


class Row(NamedTuple):
    """What became of a candidate.  fall: of chi-square, beside what was taken before it.

    error: the cross-validated error of a reading in standard deviations, with it.
    taken: whether it is in the fit; why: in words.
    """

    key: str
    words: str
    unknowns: int
    fall: float
    error: float
    taken: bool
    why: str


#: Sizes that the effects of light have on a bench, 1 sigma, in 1/mm, mm, mm^2, mW and rad.
SIZES = {
    "curvature": ("a wavefront that is not flat", {"light.curvature": 1e-3}),
    "diffraction": ("diffraction at the facets' edges", {"light.wavelength": 1e-3}),
    "rolloff": ("edges that are rolled off", {".rolloff": 3e-4, "rolloff.width": 0.05}),
    "strips": ("strips lost along the edges", {"strip_": 0.03}),
    "tip": ("a tip worn flat", {"tip.area": 0.01}),
    "background": ("background light on the detectors", {"background_": 3e-3}),
    "coating": ("a coating's reflectance, and polarised light", {"light.polarization": 1.0}),
}
#: Effects of the run.
WORDS = {
    "backlash": "a reference with backlash",
    "delay": "a reference that is late or early",
    "channel_skew": "channels read one after the other",
    "time_drift": "a beam, detectors drifting with time",
    "temperature_drift": "a beam, detectors drifting with heat",
}
#: The plain fit's residuals over the noise, to which larger ones are brought at first.
BLUR = 3.0
#: How often at most the laser's steadiness is asked for, and the candidates again.
ROUNDS = 4
#: By how much detectors are bent beyond third order, mm, 1 sigma.
BENT = 1e-2
#: How far apart a converter may read its channels, s, 1 sigma.
SKEWED = 1e-4
#: Half the play of a reference's axes, mm and rad, 1 sigma.
PLAY = (2e-3, 2e-3, 2e-3, 1e-5, 1e-5, 1e-5)
#: A fit on the way ends after so many steps, or where another is worth less than this.
WAY_STEPS, WAY_ENOUGH = 12, 0.3
#: Over which width edges are rolled off, mm, where a fit begins: at none it has no way but up.
WIDTH, ROUNDED = "rolloff.width", 0.03
#: Aluminium at 633 nm, where a coating is tried that no key gives.
ALUMINIUM = (1.37, 7.62)


def candidates(sensor: Sensor, data: Data | None, settings: Calibrate) -> list[Candidate]:
    """All that the model and the columns of the table allow to be tried; of no table, those of
    light and detectors."""
    found = []
    for key, (words, sizes) in SIZES.items():
        sigma = {
            name: 3.0 if name.startswith("background") and not name.endswith("power") else size
            for part, size in sizes.items()
            for name in EFFECTS
            if part in name
        }
        if sigma and not sensor.apertures.cut:  # the model has one or the other
            found.append(Candidate(key, words, sigma, coated=key == "coating"))
    if "bend_um" not in settings.before:
        sigma = {name: size for k in DETECTORS for name, size in bends(k, 0.03).items()}
        found.append(Candidate("bend", "detectors bent in second and third order", sigma))
    if not any(psd.correction.grid for psd in sensor.psds):  # a table that was given stays
        sigma = {name: size for k in DETECTORS for name, size in bends(k, 0.03).items()}
        sigma |= dict.fromkeys(SPLINE, BENT)
        found.append(Candidate("spline", "detectors bent beyond third order", sigma))
    if data is not None and data.velocity is not None:
        found.append(Candidate("delay", WORDS["delay"], {DELAY: 0.01}))
        skew = dict.fromkeys(SKEW[1:], SKEWED)  # beside A: what all have is the reference's delay
        found.append(Candidate("channel_skew", WORDS["channel_skew"], skew))
    if data is not None and data.approach is not None and data.approach.any():
        play = dict(zip(BACKLASH, PLAY, strict=True))
        found.append(Candidate("backlash", WORDS["backlash"],
                               {name: play[name] for n, name in enumerate(BACKLASH)
                                if np.isfinite(data.sigma[n])}))  # fmt: skip
    for n, key in enumerate(("time_drift", "temperature_drift")):
        if data is not None and data.clock is not None and np.ptp(data.clock[:, n]) > 0:
            cause = key.partition("_")[0]
            sizes = {f"{cause}.{what}": 0.005 for what in OF_DRIFT}
            found.append(Candidate(key, WORDS[key], sizes))
    found.append(Candidate("beam_moves", "a beam that moves from sample to sample", {}, beam=0.01))
    return [one for one in found if settings.effects.get(one.key, "auto") != "off"]


#: What the table must have for a candidate to be tried.
NEEDS = {
    "delay": "no time_s of a motion",
    "channel_skew": "no time_s of a motion",
    "time_drift": "no time_s",
    "temperature_drift": "no temperature_c",
}


def tried_kinds(sensor: Sensor, settings: Calibrate) -> list[str]:
    """The kinds of light, see `model.kinds.LIT`, whose effects are tried."""
    light = [one for one in candidates(sensor, None, settings) if one.key in SIZES]
    return list({lit_kind(with_coating(sensor) if one.coated else sensor) for one in light})


def untold(every: list[Candidate], settings: Calibrate) -> list[Row]:
    """Candidates that the table at hand can not carry, and why."""
    there = {one.key for one in every}
    return [
        Row(key, WORDS[key], 0, np.nan, np.nan, False, why)
        for key, why in NEEDS.items()
        if key not in there and settings.effects.get(key, "auto") != "off"
    ]


def with_candidate(chosen: Choice, one: Candidate) -> Choice:
    return replace(chosen.and_also(one.sigma), beam=max(chosen.beam, one.beam))


#: Where the light's polarisation is tried, rad: half a turn is a whole period.
POLARISATIONS = (np.pi / 4, np.pi / 2, 3 * np.pi / 4, 0.0)


def with_coating(sensor: Sensor, turn: float = POLARISATIONS[0]) -> Sensor:
    """A sensor whose facets are coated, with light that may be polarised."""
    light = sensor.light
    if light.index is not None and light.polarization is not None:
        return sensor
    index = light.index or ALUMINIUM
    turn = turn if light.polarization is None else light.polarization
    return replace(sensor, light=replace(light, index=index, polarization=turn))


# ---- what each would bring, at the fit as it is


class Sums(NamedTuple):
    """Normal equations of each fifth of the samples, over all names of a choice.

    matrix: (f, p, p), side: (f, p), level: (f,).  prior: (p, p), pull: (p,) its own side, before:
    its own level.
    """

    names: tuple[str, ...]
    matrix: Floats
    side: Floats
    level: Floats
    prior: Floats
    pull: Floats
    before: float


def sums(sensor: Sensor, data: Data, found: Fit, chosen: Choice) -> Sums:
    """At the values of a fit, by all names of a wider choice."""
    values = values_for(sensor, found)
    at = assigned(sensor, values)
    data = data._replace(noise=deviations(sensor, data))
    there, own = linear(at, data, found.open, values, chosen), own_sigma(data, chosen)
    weights, parts = np.sqrt(found.weights), list[Normal]()
    weights[found.weights < LEAST_WEIGHT] = 0.0  # else what jumps decides, by the size of its jump
    for n in range(FOLDS):
        rows = slice(n, None, FOLDS)
        part = Linear(there.residual[rows], there.common[rows], there.own[rows])
        parts.append(eliminated(part, weights[rows], found.open[rows], own))
    prior = prior_information(chosen)
    before = (values - values_of(sensor))[chosen.places]
    return Sums(
        chosen.names,
        np.array([part.matrix for part in parts]),
        np.array([part.side for part in parts]),
        np.array([part.level for part in parts]),
        prior,
        -prior @ before,
        float(before @ prior @ before),
    )


def expected(given: Sums, names: Iterable[str]) -> tuple[float, float]:
    """With some of the names, as the linear model has them: chi-square after a step of these, and
    cross-validated chi-square."""
    at = np.array([given.names.index(name) for name in names])
    square = np.ix_(at, at)
    matrix, side = given.matrix.sum(axis=0)[square], given.side.sum(axis=0)[at]
    side = side + given.pull[at]
    prior = given.prior[square]
    after = given.level.sum() + given.before - side @ np.linalg.solve(matrix + prior, side)
    left = 0.0
    for part, aim, level in zip(given.matrix, given.side, given.level, strict=True):
        there, here = part[square], aim[at]
        step = np.linalg.solve(matrix - there + prior, side - here)
        left += level - 2 * here @ step + step @ there @ step
    return float(after), float(left)


def chance_of(fall: float, count: int) -> float:
    """Of a fall at least as large where the candidate is nothing."""
    from scipy.special import chdtrc

    return float(chdtrc(count, max(fall, 0.0)))


def values_for(sensor: Sensor, found: Fit) -> Floats:
    """Where a fit was, for a sensor that may have a coating since."""
    every, nominal = found.every.copy(), values_of(sensor)
    for name in ("coating.n", "coating.k", "light.polarization"):
        if name in EFFECTS and name not in found.choice.names:
            every[PLACE[name]] = nominal[PLACE[name]]
    return every


def worths(sensor: Sensor, data: Data, found: Fit, rest: list[Candidate]) -> list[Row]:
    """What each candidate would bring beside a fit and beside those that bring more, and whether
    that speaks for it; the best first."""
    if not rest:
        return []
    wide = found.choice
    for one in rest:
        wide = with_candidate(wide, one)
    coated = any(one.coated for one in rest)
    without = sums(sensor, data, found, found.choice if coated else wide)
    given = best_coating(sensor, data, found, wide)[1] if coated else without
    chosen, before = found.choice, expected(without, found.choice.names)
    rows, left = list[Row](), list(rest)
    while left:
        wider = [with_candidate(chosen, one) for one in left]
        after = [expected(given, choice.names) for choice in wider]
        tried = [
            judged(one, len(choice.names) - len(chosen.names), found, before, level)
            for one, choice, level in zip(left, wider, after, strict=True)
        ]
        good = [n for n, row in enumerate(tried) if row.taken]
        if not good:
            return rows + tried
        best = max(good, key=lambda n: tried[n].fall / max(tried[n].unknowns, 1) ** 0.5)
        rows.append(tried[best])
        chosen, before = wider[best], after[best]
        del left[best]
    return rows


def best_coating(sensor: Sensor, data: Data, found: Fit, wide: Choice) -> tuple[Sensor, Sums]:
    """The coated sensor whose polarisation promises the lowest chi-square, and its sums."""
    coated = list(dict.fromkeys(with_coating(sensor, turn) for turn in POLARISATIONS))
    tried = [(one, sums(one, data, found, wide)) for one in coated]
    return min(tried, key=lambda one: expected(one[1], wide.names)[0])


def error_of(left: float, found: Fit) -> float:
    """The error of a reading that a fit has not seen, over its noise, of all of chi-square."""
    count = float((found.weights == 1).sum())
    if np.isinf(found.choice.power):
        count -= len(found.left)
    return float(np.sqrt(max(left, 0.0) / max(count, 1.0)))


def judged(
    one: Candidate,
    count: int,
    found: Fit,
    before: tuple[float, float],
    after: tuple[float, float],
) -> Row:
    """count: of its unknowns.  before, after: chi-square and cross-validated chi-square without
    and with it."""
    fall = before[0] - after[0]
    chance, better = chance_of(fall, count), before[1] - after[1]
    error = error_of(after[1], found)
    if chance < CHANCE and better > BETTER:
        return Row(one.key, one.words, count, fall, error, True, "the data call for it")
    why = "within chance" if chance >= CHANCE else "does not predict what was left out"
    return Row(one.key, one.words, count, fall, error, False, why)


@dataclass(frozen=True)
class Search:
    """sensor: from which the last fit began.  plain: the fit without candidates.  found: with what
    was taken.  error: the plain fit's cross-validated one.  rows: what became of each candidate.
    data: what was fitted in the end.  outliers: rows that were taken out.  scatter: what scatters.
    """

    sensor: Sensor
    plain: Fit
    found: Fit
    error: float
    rows: list[Row]
    data: Data
    outliers: list[int]
    scatter: Scatter


ASKED = "asked for"
#: Candidates are taken together down to this share of what the best brings: the linear model of
#: the others is good to no more, until what is large has been taken.
CLEAR = 0.1


class Searcher:
    """Takes candidates, those that bring most first, and fits again."""

    def __init__(
        self, sensor: Sensor, data: Data, settings: Calibrate, plain: Fit, outliers: list[int]
    ) -> None:
        self.sensor, self.data, self.settings = sensor, data, settings
        self.plain = self.found = plain
        self.every = candidates(sensor, data, settings)
        self.rows: dict[str, Row] = {}
        self.refused: set[str] = set()
        self.outliers, self.scatter = outliers, NOTHING
        for one in self.every:
            if one.sigma and set(one.sigma) <= set(plain.choice.names):
                why = "without it no fit settles"
                row = Row(one.key, one.words, len(one.sigma), np.nan, np.nan, True, why)
                self.rows[one.key] = row

    def taken(self) -> set[str]:
        return {key for key, row in self.rows.items() if row.taken}

    def take(self, several: list[Candidate], rows: list[Row]) -> bool:
        """Fits again with candidates; stays with what was, where that gains nothing.

        What has not settled on the way may do so once others are taken: that is asked at the end.
        """
        sensor, wider = self.sensor, self.found.choice
        for one in several:
            wider = with_candidate(wider, one)
        if any(one.coated for one in several):
            sensor, _ = best_coating(sensor, self.data, self.found, wider)
        every = values_for(sensor, self.found)
        if WIDTH in wider.names and not every[PLACE[WIDTH]]:
            every[PLACE[WIDTH]] = ROUNDED
        start = replace(self.found, every=every)
        robust = self.settings.outliers
        better = fit(sensor, self.data, wider, robust, start, WAY_STEPS, WAY_ENOUGH)
        fall = self.found.loss - better.loss
        gains = chance_of(fall, max(sum(row.unknowns for row in rows), 1)) <= CHANCE
        alone = len(rows) == 1
        for row in rows:
            if gains or row.why == ASKED:
                self.rows[row.key] = row._replace(fall=fall if alone else row.fall, taken=True)
            else:
                self.refused.add(row.key)
                why = "gains nothing in a fit"
                self.rows[row.key] = row._replace(fall=fall, taken=False, why=why)
        if not gains and all(row.why != ASKED for row in rows):
            return False
        self.sensor, self.found = sensor, better
        return True

    def ask(self) -> None:
        """Takes what a key asks for."""
        for one in self.every:
            if self.settings.effects.get(one.key) == "on" and one.key not in self.rows:
                row, *_ = worths(self.sensor, self.data, self.found, [one])
                self.take([one], [row._replace(why=ASKED)])

    def step(self) -> bool:
        """Takes what is good of what is left, if any is."""
        done = self.taken() | self.refused
        rest = [one for one in self.every if not one.beam and one.key not in done]
        late = [one.key for one in self.every if one.coated or one.key == "spline"]
        for keys in (None, *late):  # what costs most is tried last: a coating, at several angles
            group = [
                one for one in rest if (one.key not in late if keys is None else one.key == keys)
            ]
            tried = worths(self.sensor, self.data, self.found, group)
            self.rows |= {row.key: row._replace(taken=False) for row in tried}
            good = [row for row in tried if row.taken]
            if good:
                first = max(row.fall for row in good)
                together = [row for row in good if row.fall > CLEAR * first]
                self.take([one for one in group if one.key in {r.key for r in together}], together)
                return True
        return False

    def steady(self) -> bool:
        """Asks again how steady the laser was, now that less of what moves is taken for it; whether
        that changed, and with it what the data may call for."""
        before = self.found
        self.found = steadied(self.sensor, self.data, before, self.settings.outliers)
        if self.found is before:
            return False
        self.refused.clear()
        return True

    def run(self) -> None:
        """Takes all that is good."""
        for _ in range(ROUNDS):
            while self.step():
                pass
            if not self.steady():
                break

    def sharpen(self, data: Data) -> None:
        """Goes on with the noise as it is, once what is large has been taken."""
        self.data, start = data, self.found
        robust = self.settings.outliers
        self.found = fit(self.sensor, data, start.choice, robust, start)
        self.refused.clear()

    def finish(self) -> None:
        """Lets the fit settle, which was cut short on the way."""
        start = self.found
        self.found = fit(self.sensor, self.data, start.choice, self.settings.outliers, start)

    def screen(self) -> None:
        """Takes out samples that jump by less than what was missed before was large."""
        robust, gone = self.settings.outliers, self.outliers
        self.data, self.found, more = without_outliers(
            self.sensor, self.data, self.found, robust, len(gone)
        )
        self.outliers = sorted([*gone, *more])

    def explain_scatter(self) -> None:
        """Takes what scatters from sample to sample for what is likeliest, and fits with that."""
        moving = [one for one in self.every if one.beam]
        before = self.found
        self.data, self.found, self.scatter = explained(
            self.sensor, self.data, before, self.settings.outliers, bool(moving)
        )
        for one in (one for one in moving if one.key not in self.taken()):
            taken, why = "beam" in self.scatter.causes, "nothing is left to explain"
            if self.scatter.causes:
                why = "the data call for it" if taken else "something else is likelier"
            count = 2 * len(self.data.raw) * taken
            fall = before.loss - self.found.loss if taken else 0.0
            self.rows[one.key] = Row(one.key, one.words, count, fall, np.nan, taken, why)


def beyond_chance(found: Fit) -> float:
    """By how much chi-square for each degree of freedom is above what chance allows; 0 if not."""
    chance = 4 * float(np.sqrt(2 / max(found.freedom, 1.0)))
    return max(0.0, found.reduced - 1 - chance)


def blurred(sensor: Sensor, data: Data, plain: Fit) -> Data:
    """The samples with a noise that leaves the plain fit's residuals at a few times that.

    Where detectors are so fine that real light leaves residuals of a hundred times their noise, a
    linear model's own error looks like an effect.
    """
    size = NORMAL_MEDIAN * float(np.median(np.abs(plain.left[np.isfinite(data.raw)])))
    if size < 2 * BLUR:
        return data
    return data._replace(noise=deviations(sensor, data) * (size / BLUR))


def with_all(sensor: Sensor, data: Data | None, settings: Calibrate, chosen: Choice) -> Choice:
    """A choice with all candidates beside, but for a coating and a beam that moves."""
    for one in candidates(sensor, data, settings):
        late = one.coated or one.beam or one.key == "spline"
        chosen = chosen if late else with_candidate(chosen, one)
    return chosen


def promised(sensor: Sensor, data: Data, settings: Calibrate, plain: Fit) -> float:
    """Chi-square for each reading, or its cross-validated one if that is larger, that all
    candidates together would leave, as the linear model at the plain fit has it."""
    wide = with_all(sensor, data, settings, plain.choice)
    after = expected(sums(sensor, data, plain, wide), wide.names)
    return max(after) / max(float((plain.weights == 1).sum()), 1.0)


def search(
    sensor: Sensor, data: Data, settings: Calibrate, plain: Fit, outliers: list[int] | None = None
) -> Search:
    """From the plain fit to the one with all that the data or the keys call for.

    outliers: rows that were taken out before.
    """
    whole = sums(sensor, data, plain, plain.choice)
    left = expected(whole, plain.choice.names)[1]
    searcher = Searcher(sensor, blurred(sensor, data, plain), settings, plain, outliers or [])
    searcher.ask()
    searcher.run()
    if searcher.data is not data:
        searcher.sharpen(data)
        searcher.run()
    searcher.explain_scatter()
    searcher.screen()
    searcher.finish()
    order = [one.key for one in searcher.every]
    rows = sorted(searcher.rows.values(), key=lambda row: order.index(row.key))
    rows += untold(searcher.every, settings)
    error = error_of(left, plain)
    return Search(searcher.sensor, plain, searcher.found, error, rows, searcher.data,
                  searcher.outliers, searcher.scatter)  # fmt: skip
