"""Attribution of the scatter from sample to sample to its causes, by one likelihood.

A sample errs by the noise of its readings, by the reference's error of its pose, and by the beam's
position and the laser's power. With the common unknowns x and the prior of these, the readings of
sample i have the variance

    V_i = D_i + sum_k theta_k z_ik z_ik' + Z_i (C - B) Z_i'

where D is the noise, z_ik are the derivatives of the readings by one of the sample's own unknowns,
and C is a covariance of the six places. C is either the covariance of the places relative to their
noise (B = 1), or one in addition to their noise, in um^2 (B = 0). The variances theta maximise the
likelihood of the residuals with x free (restricted likelihood). Each is multiplied repeatedly by
the root of the ratio of its observed to its expected square, (sum (z' P y)^2) / (sum z' P z), and C
by the corresponding geometric mean of matrices. This never lowers the likelihood and never crosses
zero. The same likelihood shows how steady the laser was: with an unknown power for each sample,
three powers determine only two ratios, which hardly separate the detectors' gains from the apex's
position.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from itertools import combinations
from typing import NamedTuple

import numpy as np

from ...core.errors import InputError
from ...core.names import POSE, READING_COLUMNS
from ...core.sensor import Sensor
from ...core.small_matrices import one_thread
from ...core.units import Floats
from ..fitting.bundle_adjustment import CLEAR_SIGMAS, OWN_UNITS, Data, deviations, own_sigma
from ..fitting.fit import NORMAL_MEDIAN, Fit, Task, fit, huber_roots
from ..fitting.samples import LEAST_WEIGHT
from ..fitting.unknowns import DELAY, MOUNTING, PLACE, POWER_DRIFT, Choice, block, values_of
from .alternative import MIN_ADDED_FALL, REPORT_PROBABILITY, RIVAL_FACTOR, Alternative, chance_of

#: Quantities that may scatter: the reference's six axes, the laser's power, the beam's position,
#: the readings of places and of powers in addition to their noise, and the time of the reference.
PLACES, POWERS, CLOCK = "places", "powers", "clock"
NAMES = (*POSE, "power", "beam", PLACES, POWERS, CLOCK)
#: The index in `NAMES` of each column of a sample: the pose, the power, the beam's two coordinates,
#: six places, three powers and the time.
OF_COLUMN = np.array([*range(6), 6, 7, 7, *[8] * 6, *[9] * 3, 10])
#: The places' covariance, its number of values, and the unit of places, mm.
TOGETHER, TOGETHER_COUNT, PLACE_UNIT_MM = "together", 21, 1e-3
#: Number of samples per value of a covariance; with fewer it would describe single jumps.
SAMPLES_EACH = 5
PLACE_READINGS = [0, 1, 3, 4, 6, 7]
#: The unit of the time's scatter, s.
CLOCK_UNIT_S = 1e-3
#: Whether two of the six places are of different detectors.
IS_BETWEEN = np.arange(6) // 2 != np.arange(6)[:, None] // 2
#: Causes that are distinguished. The laser's power may always scatter.
SCATTER = {
    part.key: part
    for part in (
        Alternative(
            "reference_scatter", "reference",
            "the reference, or a mirror that vibrates against it",
            measurement="measure the mirror at rest with facets noise", variance=POSE,
        ),
        Alternative(
            "clock_scatter", "time", "times that jitter", measurement="move at half the speed",
            variance=(CLOCK,),
        ),
        Alternative(
            "beam_scatter", "light", "a beam that moves",
            measurement="let the mirror rest and look at all three spots", variance=("beam",),
        ),
        Alternative(
            "detector_scatter", "detectors", "the detectors",
            measurement="measure with facets noise, also in the dark", variance=(PLACES, POWERS),
        ),
        Alternative(
            "supply_scatter", "electronics", "a supply that the detectors share",
            measurement="let the mirror rest, and see by facets noise what the detectors have "
            "in common",
            variance=(TOGETHER, POWERS),
        ),
    )
}  # fmt: skip
BEAM_SCATTER, REFERENCE_SCATTER = "beam_scatter", "reference_scatter"
CLOCK_SCATTER = "clock_scatter"
DETECTOR_SCATTER, SUPPLY_SCATTER = "detector_scatter", "supply_scatter"
#: Places of different detectors scatter together if their correlation is clear and above this.
LEAST_CORRELATION = 0.3
#: One column alone errs if it explains this fraction of the chi-square of samples, of this many or
#: more.
MOST_OF_ERROR, LEAST_ERRING = 0.9, 3
#: Standard uncertainty of an axis that the reference does not measure, in `OWN_UNITS`.
UNMEASURED_SIGMA = 1e4
#: Maximum number of steps of the sizes; a step that lowers -2 log L by less than this is the last.
MAX_SIZE_STEPS, LEAST_FALL = 40, 0.3
#: Causes of scatter are looked for if chi-square exceeds its mean by this many standard deviations.
DOUBT_SIGMAS = 2.0
#: Above this chi-square per degree of freedom, or with an unknown this many prior standard
#: uncertainties from its prior, the model is wrong, and a larger scatter would only hide that.
WORST_CHI_SQUARE, FAR_SIGMAS = 9.0, 8.0


class Together(NamedTuple):
    """The covariance (6, 6) of places in addition to their noise, in um^2 or relative to it."""

    matrix: Floats = np.zeros((6, 6))
    is_absolute: bool = False


NONE_TOGETHER = Together()


class Likelihood:
    """The likelihood of the readings as a function of the sizes of the scatter, with the model
    linearised at a fit."""

    def __init__(self, task: Task, result: Fit) -> None:
        at = task.guess(result.all_values, result.own_values)
        part, roots, _ = task.linearise(at, task.outlier_limit(at))
        weights = roots**2
        good = np.isfinite(task.data.raw) & (weights >= LEAST_WEIGHT)
        by_own = part.by_own * good[:, :, None]
        self.common = part.common * good[:, :, None]
        self.residual = (part.residual * good) + (by_own @ (at.own_values / OWN_UNITS)[:, :, None])[
            :, :, 0
        ]
        self.noise = np.where(good, 1 / np.maximum(weights, LEAST_WEIGHT), 1.0)
        self.own = by_own
        assert task.data.noise is not None
        by_um = np.where(good, PLACE_UNIT_MM / task.data.noise, 0.0)
        self.by_um = (by_um[:, :, None] * np.eye(9))[:, :, PLACE_READINGS]
        noise = np.sqrt(self.noise * good)
        self.columns = scatter_columns(by_own, noise, task.data.velocity)
        self.prior = task.prior
        self.before = (at.values - task.start)[task.choice.places]

    def place_columns(self, is_absolute: bool) -> Floats:
        """The columns (n, 9, 6) of the places, in readings' standard deviations per um if
        `is_absolute`, else per noise; see `Together`."""
        return self.by_um if is_absolute else self.columns[:, :, 9:15]

    @property
    def place_noise(self) -> Floats:
        """The median noise (6,) of places, um."""
        each = self.by_um[:, PLACE_READINGS, range(6)]
        noise: Floats = 1 / np.nanmedian(np.where(each, each, np.nan), axis=0)
        return noise

    def variance(self, priors: Floats, sizes: Floats, together: Together = NONE_TOGETHER) -> Floats:
        """Variances (n, 9, 9) of the readings.  priors: (9,) prior variances of a sample's own
        unknowns, in `OWN_UNITS`.  sizes: (11,), variances that are added."""
        variances = sizes[OF_COLUMN]
        variances[:9] += priors
        out: Floats = (self.columns * variances) @ np.swapaxes(self.columns, 1, 2)
        out[:, range(9), range(9)] += self.noise
        if together.matrix.any():
            places = self.place_columns(together.is_absolute)
            out += places @ together.matrix @ np.swapaxes(places, 1, 2)
        return out

    def restrict(
        self, priors: Floats, sizes: Floats, together: Together = NONE_TOGETHER
    ) -> RestrictedLikelihood:
        """The restricted likelihood, with the common unknowns free; arguments as for `variance`."""
        variance = self.variance(priors, sizes, together)
        inverse: Floats = np.asarray(np.linalg.inv(variance), dtype=float)
        weighted = inverse @ self.common
        size = self.common.shape[2]
        matrix = self.common.reshape(-1, size).T @ weighted.reshape(-1, size) + self.prior
        aim = (inverse @ self.residual[:, :, None])[:, :, 0]
        side = self.common.reshape(-1, size).T @ aim.ravel() - self.prior @ self.before
        step = np.linalg.solve(matrix, side)
        level = float((self.residual * aim).sum() + self.before @ self.prior @ self.before)
        unlikely = (
            np.linalg.slogdet(variance)[1].sum() + np.linalg.slogdet(matrix)[1]
            + level - side @ step
        )  # fmt: skip
        return RestrictedLikelihood(
            float(unlikely), matrix, inverse, weighted, aim - weighted @ step
        )

    def squares(self, at: RestrictedLikelihood, columns: Floats) -> tuple[Floats, Floats]:
        """The observed and the expected squares and products (k, k) of columns (n, 9, k)."""
        turned = np.swapaxes(columns, 1, 2)
        pulled = (turned @ at.pulled[:, :, None])[:, :, 0]
        across = np.swapaxes(turned @ at.weighted, 0, 1)
        absorbed = np.tensordot(across @ np.linalg.inv(at.matrix), across, axes=((1, 2), (1, 2)))
        return pulled.T @ pulled, (turned @ at.inverse @ columns).sum(axis=0) - absorbed

    def likeliest(
        self, priors: Floats, names: tuple[str, ...], start: Floats, is_absolute: bool = False
    ) -> Sizes:
        """The likeliest sizes of some names, from a start (11,); the others remain constant.

        is_absolute: see `Together`.  Each step multiplies by the cube of the factor, or by the
        factor if that is more likely.
        """
        free, sizes = np.array([name in names for name in NAMES]), start.copy()
        free_columns = np.flatnonzero(free[OF_COLUMN])
        columns = self.columns[:, :, free_columns]
        additional = partial(Together, is_absolute=is_absolute)
        base = np.zeros((6, 6)) if is_absolute else np.eye(6)
        matrix, has_matrix = base, TOGETHER in names
        if has_matrix:
            columns = np.concatenate([columns, self.place_columns(is_absolute)], axis=2)
            matrix = base + is_absolute * np.diag(FIRST_NOISE_FRACTION * self.place_noise**2)
        at = self.restrict(priors, sizes, additional(matrix - base))
        for _ in range(MAX_SIZE_STEPS):
            observed, expected = self.squares(at, columns)
            sums = [
                np.bincount(OF_COLUMN[free_columns], np.diag(both)[: len(free_columns)], len(NAMES))
                for both in (observed, expected)
            ]
            factor = np.where(free, np.sqrt(sums[0] / np.maximum(sums[1], 1e-300)), 1.0)
            matrices = [matrix] * 4
            if has_matrix:
                matrices = geometric_means(matrix, observed, expected)
            times = 3
            following = self.restrict(priors, sizes * factor**3, additional(matrices[3] - base))
            if following.unlikely > at.unlikely:
                times = 1
                following = self.restrict(priors, sizes * factor, additional(matrices[1] - base))
            sizes, matrix = sizes * factor**times, matrices[times]
            at, fall = following, at.unlikely - following.unlikely
            if fall < LEAST_FALL:
                break
        return Sizes(at.unlikely, sizes, additional(matrix - base))

    def is_together(self, priors: Floats, start: Floats) -> bool:
        """Whether places of different detectors are correlated beyond chance; arguments as for
        `variance`."""
        observed, expected = self.squares(self.restrict(priors, start), self.place_columns(False))
        size = np.sqrt(np.maximum(np.diag(expected), 1e-300))
        excess = (observed - expected) / size / size[:, None] * np.sqrt(len(self.residual))
        return chance_of(float((excess[IS_BETWEEN] ** 2).sum()) / 2, 12) < REPORT_PROBABILITY


def scatter_columns(by_own: Floats, noise: Floats, velocity: Floats | None) -> Floats:
    """Columns (n, 9, 19) of the quantities of each sample that may scatter; see `OF_COLUMN`."""
    diagonal = (noise[:, :, None] * np.eye(9))[:, :, [*PLACE_READINGS, 2, 5, 8]]
    late = np.zeros((len(by_own), 6, 1))
    if velocity is not None:
        late[:, :, 0] = CLOCK_UNIT_S * velocity / OWN_UNITS[:6]
    return np.concatenate([by_own, diagonal, by_own[:, :, :6] @ late], axis=2)


def erring_column(sensor: Sensor, data: Data, result: Fit) -> str | None:
    """The axis of the reference, or the reading, whose error alone explains most of the excluded
    samples; None if there is none, or too few samples."""
    if len(data.raw) < LEAST_ERRING:
        return None
    count, width = len(data.raw), result.own_values.shape[1]
    at_prior = replace(result, own_values=np.zeros((count, width)))
    like = Likelihood(Task(sensor, data, result.choice, None), at_prior)
    priors = prior_variances(data, result.choice)
    inverse = np.linalg.inv(like.variance(priors, np.zeros(len(NAMES))))
    columns = np.concatenate([like.own[:, :, :6], np.broadcast_to(np.eye(9), (count, 9, 9))], 2)
    weighted = inverse @ columns
    square = np.maximum((weighted * columns).sum(axis=1), 1e-300)
    fall = (weighted * like.residual[:, :, None]).sum(axis=1) ** 2 / square
    level = ((inverse @ like.residual[:, :, None])[:, :, 0] * like.residual).sum(axis=1)
    erring = (fall > MOST_OF_ERROR * level[:, None]).sum(axis=0)
    best = int(np.argmax(erring))
    if erring[best] < max(LEAST_ERRING, count / 2):
        return None
    return (*POSE, *READING_COLUMNS)[best]


def geometric_mean(covariance: Floats, observed: Floats, expected: Floats) -> Floats:
    """The covariance X with X E X = C O C, all (m, m), for a covariance C and the observed and
    expected squares O and E."""
    smallest = 1e-9 * np.trace(expected) * np.eye(len(expected))
    root = np.linalg.cholesky(expected + smallest)
    level, ways = np.linalg.eigh(root.T @ covariance @ observed @ covariance @ root)
    half = np.linalg.solve(root.T, ways * np.maximum(level, 0.0) ** 0.25)
    mean: Floats = half @ half.T
    return mean


def geometric_means(matrix: Floats, observed: Floats, expected: Floats) -> list[Floats]:
    """A covariance (m, m) of the last m columns, and its values after one, two and three steps."""
    last, every = np.s_[-len(matrix) :, -len(matrix) :], [matrix]
    for _ in range(3):
        every.append(geometric_mean(every[-1], observed[last], expected[last]))
    return every


class RestrictedLikelihood(NamedTuple):
    """The likelihood of the readings with the common unknowns free.

    unlikely: -2 log L, but for a constant.  matrix: (p, p) information on the common unknowns.
    inverse: (n, 9, 9) inverse variances of the readings.  weighted: (n, 9, p) these times the
    common columns.  pulled: P y.
    """

    unlikely: float
    matrix: Floats
    inverse: Floats
    weighted: Floats
    pulled: Floats


class Sizes(NamedTuple):
    """Sizes of the scatter.

    unlikely: -2 log L, except for a constant.  variances: (11,) by `NAMES`, in `OWN_UNITS`; of
    places and powers relative to the readings' noise.  together: the places' covariance in addition
    to their noise.
    """

    unlikely: float
    variances: Floats
    together: Together

    def scatter(
        self, causes: tuple[str, ...], others: tuple[str, ...], fall: float, like: Likelihood
    ) -> Scatter:
        """The scatter of these sizes; no noise is smaller than the stated one. fall: the decrease
        of -2 log L."""
        matrix, noise = self.together.matrix, like.place_noise
        covariance = matrix + (np.diag(noise**2) if self.together.is_absolute else np.eye(6))
        size = np.sqrt(np.diag(covariance))
        limit = max(LEAST_CORRELATION, CLEAR_SIGMAS / np.sqrt(len(like.residual)))
        is_shared = np.abs((covariance / size / size[:, None])[IS_BETWEEN]).max() > limit
        level, ways = np.linalg.eigh(matrix)
        more = self.together._replace(matrix=(ways * np.maximum(level, 0.0)) @ ways.T)
        sizes = np.sqrt(self.variances) * UNITS
        return Scatter(causes, others, sizes, more, noise, fall, bool(is_shared))


# ---- the likeliest causes, and the fit with their scatter


class Scatter(NamedTuple):
    """The scatter from sample to sample and its causes.

    causes: out of `SCATTER`, those that explain the scatter together; none if there is none.
    others: causes each of which could explain it alone as well.  sizes: (11,) by `NAMES`, standard
    deviations in addition to the priors, in mm, rad and fractions; of readings relative to their
    noise.  together: the covariance of the places in addition to their noise.  noise: the median
    noise (6,) of places, um.  fall: of -2 log L by the causes.  is_shared: whether the places of
    different detectors scatter together.
    """

    causes: tuple[str, ...]
    others: tuple[str, ...]
    sizes: Floats
    together: Together = NONE_TOGETHER
    noise: Floats = np.ones(6)
    fall: float = 0.0
    is_shared: bool = False

    @property
    def places(self) -> Floats:
        """The covariance (6, 6) of the places in addition to their noise, relative to it."""
        unit = self.noise if self.together.is_absolute else np.ones(6)
        separate = self.size_of(PLACES) ** 2 * np.eye(6)
        covariance: Floats = self.together.matrix / unit / unit[:, None] + separate
        return covariance

    @property
    def cross_covariance(self) -> Together:
        """The covariance of different places, in um^2 or relative to their total noise; zero on the
        diagonal."""
        matrix = self.together.matrix - np.diag(np.diag(self.together.matrix))
        if not self.together.is_absolute:
            size = np.sqrt(1 + np.diag(self.places))
            matrix = matrix / size / size[:, None]
        return self.together._replace(matrix=matrix)

    def total_noise(self, noise: Floats) -> Floats:
        """The noise (n, 9) of readings with their scatter."""
        total: Floats = noise * np.hypot(1.0, self.size_of(POWERS))
        unit = PLACE_UNIT_MM if self.together.is_absolute else noise[:, PLACE_READINGS]
        correlated = unit * np.sqrt(np.diag(self.together.matrix))
        separate = noise[:, PLACE_READINGS] * np.hypot(1.0, self.size_of(PLACES))
        total[:, PLACE_READINGS] = np.hypot(separate, correlated)
        return total

    def size_of(self, name: str) -> float:
        """The standard deviation of one of `NAMES`; mm, rad, s, or a fraction."""
        return float(self.sizes[NAMES.index(name)])


#: The units of `NAMES`: mm, rad, fractions and s.
UNITS = np.array([*OWN_UNITS[:8], 1.0, 1.0, CLOCK_UNIT_S])
NO_SCATTER = Scatter((), (), np.zeros(len(NAMES)))


def is_doubtful(result: Fit) -> bool:
    """Whether chi-square is larger than chance allows."""
    return bool(
        result.reduced_chi_square - 1 > DOUBT_SIGMAS * np.sqrt(2 / max(result.freedom, 1.0))
    )


def covariance_factor(result: Fit) -> float:
    """The factor by which a fit's covariance is widened: chi-square per degree of freedom if that
    is larger than chance allows."""
    return result.reduced_chi_square if is_doubtful(result) else 1.0


def far_unknowns(sensor: Sensor, result: Fit, far: float = FAR_SIGMAS) -> list[tuple[str, float]]:
    """Unknowns that end more than `far` prior standard uncertainties from their prior, with that
    number, the farthest first; empty if none does."""
    distances = np.abs(result.values - values_of(sensor)[result.choice.places])
    named = zip(result.choice.names, (distances / result.choice.sigma).tolist(), strict=True)
    free = (*MOUNTING, DELAY)  # these do not belong to the sensor
    off = [(name, size) for name, size in named if name not in free and size > far]
    return sorted(off, key=lambda pair: -pair[1])


def prior_variances(data: Data, chosen: Choice) -> Floats:
    """Prior variances (9,) of a sample's own unknowns in `OWN_UNITS`: those of the reference, and
    zero for a beam and a power whose scatter is estimated."""
    sigma = own_sigma(data, chosen)
    sigma[6] = sigma[6] if np.isinf(sigma[6]) else 0.0
    sigma[7:] = 0.0
    with np.errstate(over="ignore"):
        variances: Floats = np.minimum((sigma / OWN_UNITS) ** 2, UNMEASURED_SIGMA**2)
    return variances


class SizeProblem(NamedTuple):
    """The sizes of the scatter at a fit, as unknowns.

    like: the likelihood of the readings.  priors: (9,) prior variances of a sample's own unknowns.
    causes: the names that may scatter in these samples, by cause.  start: (11,) the fit's sizes.
    always: names whose sizes are estimated with any cause.
    """

    like: Likelihood
    priors: Floats
    causes: dict[str, tuple[str, ...]]
    start: Floats
    always: tuple[str, ...]

    def sizes(self, causes: tuple[str, ...]) -> Sizes:
        """The likeliest sizes if only these causes scatter; -2 log L increases by 2 for each value
        of a covariance (Akaike)."""
        names = dict.fromkeys(name for key in causes for name in self.causes[key])
        start = self.start.copy()
        for n in (NAMES.index(name) for name in names if name in NAMES):
            square = (self.like.columns[:, :, n == OF_COLUMN] ** 2).sum()
            start[n] = FIRST_NOISE_FRACTION * len(self.like.residual) / max(square, 1e-300)
        forms = (False, True) if TOGETHER in names else (False,)
        every = [self.like.likeliest(self.priors, (*self.always, *names), start, form)
                 for form in forms]  # fmt: skip
        best = min(every, key=lambda sizes: sizes.unlikely)
        return best._replace(unlikely=best.unlikely + self.cost(causes))

    @property
    def start_unlikely(self) -> float:
        """-2 log L with the fit's sizes."""
        return self.like.restrict(self.priors, self.start).unlikely

    @property
    def several(self) -> list[tuple[str, ...]]:
        """The sets of causes that may act together."""
        return [
            keys for count in range(1, len(self.causes) + 1)
            for keys in combinations(self.causes, count)
            if not {DETECTOR_SCATTER, SUPPLY_SCATTER} <= set(keys)
        ]  # fmt: skip

    def cost(self, causes: tuple[str, ...]) -> float:
        """The penalty in -2 log L for the values of the covariance that some causes need."""
        return 2 * TOGETHER_COUNT * (SUPPLY_SCATTER in causes)


def size_problem(task: Task, result: Fit, beam: bool) -> SizeProblem:
    """Set up the sizes of the scatter at a fit.  beam: whether the beam may scatter."""
    measured = tuple(name for name, s in zip(POSE, task.data.sigma, strict=True) if np.isfinite(s))
    causes = {key: part.variance for key, part in SCATTER.items()}
    causes |= {REFERENCE_SCATTER: measured} | ({} if beam else {BEAM_SCATTER: ()})
    causes |= {CLOCK_SCATTER: ()} if task.data.velocity is None else {}
    few = len(task.data.raw) < SAMPLES_EACH * TOGETHER_COUNT
    causes |= {SUPPLY_SCATTER: ()} if few else {}
    start, jitters = np.zeros(len(NAMES)), 0 < task.choice.power < np.inf
    if jitters:
        start[NAMES.index("power")] = (task.choice.power / OWN_UNITS[6]) ** 2
    return SizeProblem(
        Likelihood(task, result),
        prior_variances(task.data, task.choice),
        {key: names for key, names in causes.items() if names},
        start,
        ("power",) if jitters else (),
    )


def estimate_scatter(problem: SizeProblem) -> Scatter:
    """Choose one cause if it is nearly as likely as the best combination, else two, and so on.

    The covariance of the places includes the detectors' sizes, so the two are never combined.
    """
    several, tried = problem.several, dict[tuple[str, ...], Sizes]()

    def likeliest(count: int) -> tuple[str, ...]:
        """The set of this many causes with the highest likelihood."""
        tried.update((keys, problem.sizes(keys)) for keys in several if len(keys) == count)
        return min((k for k in tried if len(k) == count), key=lambda keys: tried[keys].unlikely)

    most = max(map(len, several))
    best = likeliest(most)
    for count in range(1, most):
        causes, lowest = likeliest(count), min(sizes.unlikely for sizes in tried.values())
        if tried[causes].unlikely < lowest + MIN_ADDED_FALL:
            best = causes
            break
    likely = tried[best].unlikely + 2 * np.log(RIVAL_FACTOR)
    singles = [keys for keys, sizes in tried.items() if len(keys) == 1 and sizes.unlikely < likely]
    others = tuple(keys[0] for keys in singles if keys != best)
    fall = problem.start_unlikely - tried[best].unlikely + problem.cost(best)
    return tried[best].scatter(best, others, fall, problem.like)


def add_scatter(data: Data, chosen: Choice, scatter: Scatter) -> tuple[Data, Choice]:
    """Add the scatter to the prior uncertainties of samples and choice; returns both."""
    assert data.noise is not None
    late = 0.0 if data.velocity is None else np.sqrt((data.velocity**2).mean(axis=0))
    further = np.hypot(scatter.sizes[:6], scatter.size_of(CLOCK) * late)
    power = scatter.size_of("power") if 0 < chosen.power < np.inf else chosen.power
    return (
        data._replace(sigma=np.hypot(data.sigma, further), noise=scatter.total_noise(data.noise)),
        replace(
            chosen, power=max(power, JITTERS[0]) if power else power, beam=scatter.size_of("beam")
        ),
    )


#: First value of a size, as the fraction of the readings' variance that it adds.
FIRST_NOISE_FRACTION = 0.3


@one_thread
def fit_with_scatter(
    sensor: Sensor, data: Data, result: Fit, robust: float | None, beam: bool
) -> tuple[Data, Fit, Scatter]:
    """Return the samples with their scatter, the fit to them, and the causes.

    All remain unchanged if chi-square is within chance and no noises are correlated, or if scatter
    cannot be the cause.
    """
    if result.reduced_chi_square > WORST_CHI_SQUARE or far_unknowns(sensor, result):
        return data, result, NO_SCATTER
    bare = data._replace(noise=deviations(sensor, data))
    problem = size_problem(Task(sensor, bare, result.choice, robust), result, beam)
    together = problem.like.is_together(problem.priors, problem.start)
    if not (is_doubtful(result) or result.choice.beam or together):
        return data, result, NO_SCATTER

    def fit_again(scatter: Scatter, before: Fit) -> tuple[Data, Fit]:
        scattered, chosen = add_scatter(bare, before.choice, scatter)
        return scattered, fit(sensor, scattered, chosen, robust, before)

    scatter = estimate_scatter(problem)
    data, result = fit_again(scatter, result)
    problem = size_problem(Task(sensor, bare, result.choice, robust), result, beam)
    sizes = problem.sizes(scatter.causes)  # the fit has changed the weights
    scatter = sizes.scatter(*scatter[:2], scatter.fall, problem.like)
    data, result = fit_again(scatter, result)
    if BEAM_SCATTER in scatter.causes and mean_inflation(result) > LONG_WALK:
        wider = scatter.sizes * np.where(np.array(NAMES) == "beam", WALK_FACTOR, 1.0)
        data, result = fit_again(scatter._replace(sizes=wider), result)
    return data, result, scatter


#: The positions of a beam that walks are correlated, so that their mean is known less well than
#: that of independent ones. If its standard deviation is larger by the first factor, the beam's
#: scatter is increased by the second. With a larger one the powers would not determine x and y.
LONG_WALK, WALK_FACTOR = 2.0, 2.0


def mean_inflation(result: Fit) -> float:
    """The standard deviation of the mean of the beam's positions, relative to that of independent
    positions."""
    place = result.own_values[:, 7:] - result.own_values[:, 7:].mean(axis=0)
    correlation = float((place[1:] * place[:-1]).sum() / max((place**2).sum(), 1e-300))
    correlation = min(max(correlation, 0.0), 0.999)
    return float(np.sqrt((1 + correlation) / (1 - correlation)))


#: Relative jitters of the power that are tried; with a larger one, the powers of samples are free.
JITTERS = np.geomspace(5e-5, 0.02, 14)
#: The largest jitter is chosen whose -2 log L exceeds the minimum by less than this, one standard
#: deviation, since a jitter that is too small makes poses look better known than they are.
ONE_SIGMA_FALL = 1.0
#: A fit is not repeated for a jitter that changes by less than this factor.
SAME_JITTER_FACTOR = 1.25
#: The least power of a sample with which a fit begins, as a fraction of the mean.
LEAST_POWER_FRACTION = 0.5
#: Prior standard uncertainty of the slow drift, as a fraction of the power.
DRIFT_SIGMA = 0.3


@one_thread
def fit_steady_laser(sensor: Sensor, data: Data, result: Fit, robust: float | None) -> Fit:
    """Fit again with a laser that drifts slowly and has the jitter that the data show.

    Returns the same fit if the jitter is as assumed, or if the laser jumps.
    """
    if data.slow is None or not result.choice.power:
        return result
    start = result if np.isfinite(result.choice.power) else add_slow_drift(data, result)
    jitter = estimate_jitter(Task(sensor, data, start.choice, robust), start)
    before = result.choice.power
    if jitter is None or max(jitter, before) < SAME_JITTER_FACTOR * min(jitter, before):
        return result
    steady = fit(sensor, data, replace(start.choice, power=jitter), robust, start)
    return steady if steady.ended else result


def add_slow_drift(data: Data, result: Fit) -> Fit:
    """Convert a fit with one power for each sample to one with a slow drift, without fitting again.
    Raises `InputError` if the mean power would not be positive."""
    assert data.slow is not None
    rows = np.column_stack([np.ones(len(data.slow)), data.slow])
    ways, residual, jitter = robust_drift(rows, result.own_values[:, 6])
    level = result.all_values[PLACE["beam.power"]]
    if level * (1 + ways[0]) <= 0:
        raise InputError(
            f"the fit puts the laser's mean power at {level * (1 + ways[0]):.4g} mW, so these "
            f"{len(rows)} samples do not determine it; take more samples, over a wider range of "
            "poses, and see what the motion does not determine"
        )
    priors = {"beam.power": DRIFT_SIGMA * level} | dict.fromkeys(POWER_DRIFT, DRIFT_SIGMA)
    every, own_values = result.all_values.copy(), result.own_values.copy()
    every[PLACE["beam.power"]] *= 1 + ways[0]
    every[block(POWER_DRIFT)] = ways[1:] / (1 + ways[0])
    own_values[:, 6] = np.maximum(residual / (1 + ways[0]), LEAST_POWER_FRACTION - 1)
    wide = replace(result.choice.add_unknowns(priors), power=jitter)
    return replace(result, choice=wide, all_values=every, own_values=own_values)


def robust_drift(rows: Floats, power: Floats) -> tuple[Floats, Floats, float]:
    """Fit powers (n,) by columns (n, q), except for outliers; return the amounts (q,), the
    residuals (n,) and their standard deviation."""
    weight: Floats = np.ones(len(rows))
    for _ in range(5):
        fitted, *_ = np.linalg.lstsq(rows * weight[:, None], power * weight, rcond=None)
        ways: Floats = np.asarray(fitted, dtype=float)
        residual = power - rows @ ways
        jitter = max(float(JITTERS[0]), NORMAL_MEDIAN * float(np.median(np.abs(residual))))
        weight = huber_roots(residual / jitter, 3.0)
    return ways, residual, jitter


def estimate_jitter(task: Task, start: Fit) -> float | None:
    """The largest jitter, as a fraction of the power, that is about as likely as the best one; None
    if all of `JITTERS` are too small."""
    priors = prior_variances(task.data, task.choice)
    priors[7:] = (task.choice.beam / OWN_UNITS[7]) ** 2
    unlikely = jitter_likelihoods(Likelihood(task, start), priors)
    good = np.flatnonzero(unlikely < unlikely.min() + ONE_SIGMA_FALL)
    return None if good[-1] == len(JITTERS) - 1 else float(JITTERS[good[-1]])


def jitter_likelihoods(like: Likelihood, priors: Floats) -> Floats:
    """-2 log L (jitters,) of each of `JITTERS`, up to a constant.  priors: see
    `Likelihood.variance`."""
    unlikely = np.empty(len(JITTERS))
    for n, jitter in enumerate(JITTERS.tolist()):
        priors[6] = (jitter / OWN_UNITS[6]) ** 2
        unlikely[n] = like.restrict(priors, np.zeros(len(NAMES))).unlikely
    return unlikely
