"""Samples, the results of their estimates (states, statuses, covariances), and their columns."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import IntEnum
from threading import RLock
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.arguments import check_arguments, index_of
from ..core.errors import InputError
from ..core.names import DETECTORS, STATE_COLUMNS, STATE_UNITS, covariance_entries, state_columns
from ..core.notebook import show_shortly
from ..core.plain_numbers import count_text
from ..core.units import Booleans, Floats, Integers
from ..files.frame_table import make_frame
from . import problem
from .plan import Chance
from .problem import CHECKS, COVARIANCE, ITERATIONS, LIMIT, RESIDUAL, STATUS, USED
from .uncertainty import UncertaintyParts, coverage_factor, effective_degrees_of_freedom

if TYPE_CHECKING:
    from pandas import DataFrame

    from ..core.knowledge import Knowledge

#: The bit of each detector in a column `used`; a detector board has the same bits.
DETECTOR_BITS = np.array([1, 2, 4])


class Status(IntEnum):
    """How the estimate of one reading ended. Only a converged one has a pose.

    UNCHECKED: there are as many usable readings as unknowns, so that a wrong reading also gives a
    pose and nothing shows the error; `solve(..., accept_unchecked=True)` gives it. AMBIGUOUS:
    another pose gives the same reading. Of live samples only: SKIPPED: it was recorded and not
    solved, since the run had fallen behind; a replay solves it. SATURATED: a converter was at its
    end, so that the reading is not finite.
    """

    CONVERGED = problem.CONVERGED
    MAX_STEPS = problem.MAX_STEPS
    SINGULAR = problem.SINGULAR
    OUT_OF_RANGE = problem.OUT_OF_RANGE
    NO_LIGHT = problem.NO_LIGHT
    NON_FINITE = problem.NON_FINITE
    STALLED = problem.STALLED
    UNCHECKED = problem.UNCHECKED
    AMBIGUOUS = problem.AMBIGUOUS
    SKIPPED = 64
    SATURATED = 66

    @property
    def label(self) -> str:
        return self.name.lower().replace("_", " ")


#: The words of each status, by its number.
LABELS = {status.value: status.label for status in Status}


class UncertainResult:
    """Standard uncertainties of a result with a covariance, and their parts.

    A subclass has the attributes `covariance`, `noise_covariance`, `calibration_covariance` and
    `calibration_degrees_of_freedom`, as `Solution` describes them.
    """

    covariance: Floats | None
    noise_covariance: Floats | None
    calibration_covariance: Floats | None
    calibration_degrees_of_freedom: Floats | None

    @property
    def variance(self) -> Floats | None:
        """The square of `uncertainty`; None without a covariance."""
        return None if self.covariance is None else diagonal(self.covariance)

    @property
    def uncertainty(self) -> Floats:
        """Combined standard uncertainty of each component: (..., 8) of a state, (..., 6) of an
        object's pose; mm and rad."""
        root: Floats = np.sqrt(self.require_covariance(self.variance))
        return root

    @property
    def noise_uncertainty(self) -> Floats:
        """The part of `uncertainty` by the noise of the readings; mm and rad.

        A mean over n samples of one pose has 1 / sqrt(n) of it. Raises `InputError` where the
        sensor has no calibration covariance.
        """
        return root_of_diagonal(self.require_part(self.noise_covariance))

    @property
    def calibration_uncertainty(self) -> Floats:
        """The part of `uncertainty` by the calibration; mm and rad.

        A mean over samples keeps it. Raises `InputError` where the sensor has no calibration
        covariance.
        """
        return root_of_diagonal(self.require_part(self.calibration_covariance))

    @property
    def degrees_of_freedom(self) -> Floats:
        """Effective degrees of freedom of `uncertainty`, by Welch and Satterthwaite.

        Noise and priors count as known, with infinitely many. NaN where those of the calibration
        are unknown, as in configurations that hold no `sensor.calibration.degrees_of_freedom`.
        """
        variance = self.uncertainty**2
        freedom: Floats = np.full(variance.shape, np.inf)
        if self.calibration_covariance is not None:
            part = diagonal(self.calibration_covariance)
            known = np.asarray(self.calibration_degrees_of_freedom, float)[..., None]
            freedom = effective_degrees_of_freedom(variance, part, known)
        freedom[np.isnan(variance)] = np.nan
        return freedom

    def coverage_factor(self, probability: float = 0.95) -> Floats:
        """Coverage factor of each component's interval; NaN without a pose.

        The quantile of Student's t distribution for `degrees_of_freedom`; of the normal
        distribution where these are infinite or unknown.
        """
        factor = coverage_factor(probability, self.degrees_of_freedom)
        factor[np.isnan(self.uncertainty)] = np.nan
        return factor

    def expanded_uncertainty(self, probability: float = 0.95) -> Floats:
        """Expanded uncertainty of each component; mm and rad.

        `coverage_factor` times `uncertainty`: the true value lies within it of the estimate with
        this probability.

        Examples
        --------
        >>> import numpy as np, facets
        >>> known = facets.Calibration(("psd_a.height",), ((1e-4,),), degrees_of_freedom=5)
        >>> sensor = facets.Sensor(calibration=known)  # known to 10 um, from a short calibration
        >>> solution = facets.solve(sensor, facets.readings(sensor, np.zeros(8)), beam="known")
        >>> k, within = solution.coverage_factor()[2], 1e3 * solution.expanded_uncertainty()[2]
        >>> f"k {k:.2f}, z within {within:.1f} um"
        'k 2.35, z within 8.6 um'
        """
        return self.coverage_factor(probability) * self.uncertainty

    def require_covariance(self, numbers: Floats | None) -> Floats:
        """Return the covariance, or `numbers` that follow from it."""
        if numbers is None:
            raise InputError("no covariance: it was left out by solve(..., covariance=False)")
        return numbers

    def require_part(self, covariance: Floats | None) -> Floats:
        if covariance is None:
            raise InputError(
                "the uncertainty has no parts: the sensor has no calibration covariance, or solve "
                "was called with covariance=False; facets.mean_uncertainty and "
                "facets.difference_uncertainty take a sensor without one, too"
            )
        return covariance


def diagonal(covariance: Floats) -> Floats:
    """Variances (..., m) of a covariance (..., m, m)."""
    return np.diagonal(covariance, axis1=-2, axis2=-1)


def root_of_diagonal(covariance: Floats) -> Floats:
    """Standard uncertainties (..., m) of a covariance (..., m, m)."""
    root: Floats = np.sqrt(diagonal(covariance))
    return root


def worded_columns(columns: dict[str, Any]) -> dict[str, Any]:
    """Columns with the status in words, and the letters of the detectors used."""
    letters = np.array(DETECTORS)
    words = {
        "status": np.array([LABELS.get(number, "") for number in range(max(LABELS) + 1)]),
        "used": np.array(["".join(letters[(n & DETECTOR_BITS) > 0]) for n in range(8)]),
    }
    return columns | {name: words[name][columns[name]] for name in words if name in columns}


#: The parts of an uncertainty that a table has beside the whole where a calibration is known.
UNCERTAINTY_PARTS = ("noise", "calibration")


def uncertainty_columns(result: UncertainResult, prefix: str = "") -> dict[str, Floats]:
    """Standard uncertainties of a solution, or of poses of an object, as columns: u_tx_mm, ...;
    with a calibration also the parts of these, u_noise_tx_mm, ... and u_calibration_tx_mm, ...

    prefix: of the pose's names, such as object_.
    """
    sizes = {"": result.uncertainty}
    if result.calibration_covariance is not None:
        sizes |= {f"{part}_": getattr(result, f"{part}_uncertainty") for part in UNCERTAINTY_PARTS}
    columns: dict[str, Floats] = {}
    for part, size in sizes.items():
        columns |= state_columns(size, f"u_{part}{prefix}")
    return columns


def expanded_columns(
    result: UncertainResult, probability: float, prefix: str = ""
) -> dict[str, Floats]:
    """Expanded uncertainties as columns, expanded_tx_mm, ..., with their coverage factors k_tx,
    ...; with a calibration also the degrees of freedom, degrees_of_freedom_tx, ..., NaN where
    unknown.  prefix: of the pose's names, such as object_."""
    sizes = result.expanded_uncertainty(probability)
    names = STATE_COLUMNS[: sizes.shape[-1]]
    numbers = {"k": result.coverage_factor(probability)}
    if result.calibration_covariance is not None:
        numbers["degrees_of_freedom"] = result.degrees_of_freedom
    return state_columns(sizes, f"expanded_{prefix}") | {
        f"{kind}_{prefix}{name.partition('_')[0]}": values[..., i]
        for kind, values in numbers.items()
        for i, name in enumerate(names)
    }


def covariance_columns(result: UncertainResult, prefix: str = "") -> dict[str, Floats]:
    """The covariance of poses as 21 columns: cov_tx_tx_mm2, ..., cov_yaw_yaw_mrad2."""
    covariance = result.require_covariance(result.covariance)
    return {
        name: covariance[..., i, j] / (STATE_UNITS[i] * STATE_UNITS[j])
        for name, (i, j) in covariance_entries(prefix).items()
    }


def frame_like(source: Any, sizes: Floats) -> Any:
    """Standard uncertainties (..., 8) of states; as a data frame where these were one."""
    index = index_of(source)
    if index is None:
        return sizes
    return make_frame(state_columns(sizes, "u_"), index=index)


@show_shortly
@dataclass(frozen=True)
class Solution(UncertainResult):
    """Estimated states, one for each reading; (...) is the leading shape of the readings.

    Attributes
    ----------
    state
        (..., 8) mm, rad, NaN where not converged.
    status
        (...) of `Status`.
    power
        (...) of the beam, mW.
    used
        (..., 3) the detectors that took part.
    iterations
        (...) steps of the estimate.
    residual
        (...) root of the weighted sum of squares left, in sigmas.
    checks
        (...) degrees of freedom of the residual: by how many numbers, those of the detectors used
        and the priors, exceed the unknowns; 0 where nothing checks the pose.
    limit
        (...) the residual that noise alone exceeds once in 10,000; infinite without checks.
    covariance
        (..., 8, 8) of the state, or None where it was not requested; zero for what was known.
        It holds the noise of the readings, the priors of beam and power, and the calibration.
    noise_covariance
        (..., 8, 8) the part of `covariance` by the noise of the readings; None where the sensor has
        no calibration covariance (`Sensor.calibration`).
    calibration_covariance
        (..., 8, 8) the part of `covariance` by the calibration; None likewise.
    calibration_degrees_of_freedom
        (...) of that part (`Calibration.degrees_of_freedom`), NaN where unknown; None likewise.
    index
        The index of the readings' data frame; None where they were none.

    Notes
    -----
    Noise differs from sample to sample, so that a mean over n samples of one pose has 1 / n of its
    variance. The calibration errs by the same in every sample, so that a mean keeps its part, and
    likewise that of the priors, which is `covariance` less the two parts. A difference of two poses
    has far less of the calibration's part: see `facets.difference_uncertainty`.

    Examples
    --------
    >>> import numpy as np, facets
    >>> known = facets.Calibration(("psd_a.height",), ((1e-6,),))  # 1 um, as a standard uncertainty
    >>> sensor = facets.Sensor(calibration=known)
    >>> solution = facets.solve(sensor, facets.readings(sensor, np.zeros(8)), beam="known")
    >>> parts = solution.noise_uncertainty, solution.calibration_uncertainty, solution.uncertainty
    >>> [f"{1e3 * part[2]:.2f} um of z" for part in parts]
    ['1.50 um of z', '0.33 um of z', '1.54 um of z']
    """

    state: Floats
    status: NDArray[np.int8]
    power: Floats
    used: NDArray[np.bool_]
    iterations: NDArray[np.int32]
    residual: Floats
    checks: NDArray[np.int8]
    limit: Floats
    covariance: Floats | None
    noise_covariance: Floats | None = None
    calibration_covariance: Floats | None = None
    calibration_degrees_of_freedom: Floats | None = None
    index: Any = None

    @property
    def converged(self) -> NDArray[np.bool_]:
        """Whether there is a pose: (...)."""
        return np.equal(self.status, problem.CONVERGED)

    @property
    def misfit(self) -> NDArray[np.bool_]:
        """Whether there is a pose with a residual beyond `limit`: (...).

        The numbers of such a reading contradict each other or the model of the sensor. The pose may
        be wrong by far more than its stated uncertainty.
        """
        return np.greater(self.residual, self.limit)

    @property
    def ok(self) -> NDArray[np.bool_]:
        """Whether there is a pose and its residual is no misfit: (...).

        One in 10,000 right poses is marked as a misfit by chance. `facets.unseen_errors` bounds the
        error of a pose that is `ok` by one wrong number: with a free beam nothing checks the places
        of the spots.
        """
        return self.converged & ~self.misfit

    @property
    def summary(self) -> str:
        """The numbers of poses, of those that are `ok`, and the residual (root mean square) over
        that of the stated noise."""
        checks, ok = np.asarray(self.checks, float)[self.converged], np.count_nonzero(self.ok)
        squares = np.square(self.residual[self.converged])
        ratio = np.sqrt(squares.sum() / checks.sum()) if checks.any() else np.nan
        return (
            f"{count_text(np.size(self.status), 'pose')}, {ok:,} ok, residual {ratio:.2f} of 1.00 "
            "expected"
        )

    def columns(self) -> dict[str, Any]:
        """The solution as columns of numbers: state, status, the bits of the detectors used,
        residual, power, uncertainties, and `misfit`: 1 where the residual is beyond chance."""
        columns = state_columns(self.state)
        columns["status"] = self.status
        columns["used"] = (self.used @ DETECTOR_BITS).astype(np.uint8)
        columns["residual"] = self.residual
        columns["power_mw"] = self.power
        if self.variance is not None:
            columns |= uncertainty_columns(self)
        return columns | {"misfit": self.misfit.astype(np.uint8)}

    def to_frame(self, covariance: bool = False) -> DataFrame:
        """Make a data frame of pandas with the columns of a table of poses.

        Parameters
        ----------
        covariance
            Whether the covariance of each pose is added, as the 21 columns cov_tx_tx_mm2, ..., from
            which `facets.transform` takes it.

        Returns
        -------
        DataFrame
            One row for each reading, with the index of the readings where these were a data frame:
            the state in mm and mrad, status, standard uncertainties. `attrs["units"]` has the units
            of the columns.

        Examples
        --------
        >>> import numpy as np, facets
        >>> sensor = facets.Sensor()
        >>> poses = facets.solve(sensor, facets.readings(sensor, np.zeros((3, 8)))).to_frame()
        >>> poses.status.tolist(), poses.attrs["units"]["roll_mrad"]
        (['converged', 'converged', 'converged'], 'mrad')
        """
        more = covariance_columns(self) if covariance else {}
        return make_frame(worded_columns(self.columns()) | more, index=self.index)


def empty_solution(count: int, status: int, has_parts: bool) -> Solution:
    """A solution without any pose, with one status.  has_parts: whether the covariance is given by
    its parts as well."""
    numbers = np.full((count, COVARIANCE + len(problem.KEPT_ENTRIES)), np.nan)
    numbers[:, STATUS:RESIDUAL] = numbers[:, CHECKS] = 0.0
    numbers[:, STATUS], numbers[:, LIMIT] = status, np.inf
    unknown = np.full((count, 8, 8), np.nan)
    parts = UncertaintyParts(unknown, unknown, unknown, np.nan) if has_parts else None
    return LazySolution.from_fields({"numbers": numbers}, parts)


def root_of_covariance(covariance: Floats) -> Floats:
    """A matrix (..., n, n) whose product with its transpose is a covariance."""
    scale = np.sqrt(np.maximum(np.diagonal(covariance, axis1=-2, axis2=-1), 1e-300))
    values, vectors = np.linalg.eigh(covariance / scale[..., :, None] / scale[..., None, :])
    root: Floats = scale[..., :, None] * vectors * np.sqrt(np.maximum(values, 0))[..., None, :]
    return root


def solution(
    results: problem.Results,
    shape: tuple[int, ...],
    chance: Chance,
    parts: UncertaintyParts | None = None,
) -> Solution:
    """The solution of results, in the leading `shape` of the readings."""
    checks, entries = chance.checks(results.used), results.covariances
    known = {
        "state": results.states[:, :8].reshape(*shape, 8),
        "status": results.status.reshape(shape),
        "power": results.states[:, 8].reshape(shape),
        "used": results.used.reshape(*shape, 3),
        "iterations": results.steps.reshape(shape),
        "residual": results.residuals.reshape(shape),
        "checks": checks.reshape(shape),
        "limit": chance.limits(checks).reshape(shape),
        "entries": entries.reshape(*shape, entries.shape[1]),
    }
    return LazySolution.from_fields(known, parts)


#: How a field of a `LazySolution` is made of its numbers.
FIELDS: dict[str, Callable[[Floats], Any]] = {
    "state": lambda numbers: numbers[..., :8],
    "status": lambda numbers: numbers[..., STATUS].astype(np.int8),
    "power": lambda numbers: numbers[..., 8],
    "used": lambda numbers: numbers[..., USED:RESIDUAL] > 0,
    "iterations": lambda numbers: numbers[..., ITERATIONS].astype(np.int32),
    "residual": lambda numbers: numbers[..., RESIDUAL],
    "checks": lambda numbers: numbers[..., CHECKS].astype(np.int8),
    "limit": lambda numbers: numbers[..., LIMIT],
    "entries": lambda numbers: numbers[..., COVARIANCE:],
}


def results_of(numbers: Floats) -> problem.Results:
    """The numbers of a `LazySolution` as results, whose floats are parts of them."""
    rows = numbers.reshape(-1, numbers.shape[-1])
    fields = {name: make(rows) for name, make in FIELDS.items()}
    return problem.Results(
        states=rows[:, :9],
        used=fields["used"],
        status=fields["status"],
        steps=fields["iterations"],
        residuals=fields["residual"],
        covariances=fields["entries"],
    )


#: Held by the thread that makes a field of a `LazySolution`.
MAKING = RLock()


class LazySolution(Solution):
    """A solution whose fields are made when they are first asked for.

    To make all of one reading takes as long as the estimate, and a loop asks for two or three. Of
    many readings only the covariances are left, whose `KEPT_ENTRIES` take half the memory.

    numbers: those that blocks left for one reading or a few (..., n).  entries: (..., 36) of the
    covariances; (..., 0) without.
    """

    numbers: Floats
    entries: Floats

    @classmethod
    def from_fields(cls, known: dict[str, Any], parts: UncertaintyParts | None) -> LazySolution:
        """known: some fields, and `numbers` or `entries`.  parts: of the covariances, if they have
        some."""
        lazy = object.__new__(cls)
        lazy.__dict__.update(known)
        if parts is not None:
            shape = lazy.status.shape
            lazy.__dict__.update(
                covariance=parts.whole.reshape(*shape, 8, 8),
                noise_covariance=parts.noise.reshape(*shape, 8, 8),
                calibration_covariance=parts.calibration.reshape(*shape, 8, 8),
                calibration_degrees_of_freedom=np.full(shape, parts.degrees_of_freedom),
            )
        return lazy

    def __getattr__(self, name: str) -> Any:
        known = vars(self)
        with MAKING:
            if name in known:  # another thread has made it meanwhile
                return known[name]
            if name == "covariance":
                entries = self.entries
                made = problem.unpack_covariances(entries) if entries.shape[-1] else None
                del known["entries"]  # twice the memory
            elif name in FIELDS and "numbers" in known:
                made = FIELDS[name](self.numbers)
            else:
                raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
            known[name] = made
            return made

    @property
    def variance(self) -> Floats | None:
        with MAKING:
            if "covariance" in vars(self):
                return super().variance
            return self.entries[..., :8] if self.entries.shape[-1] else None


#: The status of a row that is not numbers.
UNPARSABLE = "unparsable"


@check_arguments
@dataclass(frozen=True)
class Samples:
    """Readings that are solved together, and what was measured beside each of them.

    Attributes
    ----------
    readings
        (n, 9) of one instant each (`align`), as the detectors gave them; mm and mW.
    numbers
        (n,) numbers of the samples; by default from 1.
    time
        (n,) s; None where it is not known.
    temperature
        (n,) degrees Celsius, NaN where it is missing; None without a thermometer.
    place
        (n, 2) the beam's measured place, mm, without `solve.beam_offset_um` and without its shift
        by the temperature; a sample whose place is NaN gets no pose. None: at the origin.
    place_sigma
        Standard uncertainty of `place`, mm; infinite: the beam is free. None: what the
        configuration's `solve` says of the beam.
    saturated
        (n,) whether a converter was at its end; None where that is not known.
    ends
        The ends of the pieces in which samples of a run came, if these are several.
    """

    readings: Floats
    numbers: Integers = field(default_factory=lambda: np.empty(0, np.int64))
    time: Floats | None = None
    temperature: Floats | None = None
    place: Floats | None = None
    place_sigma: float | None = None
    saturated: Booleans | None = None
    ends: Integers | None = None

    def __post_init__(self) -> None:
        if not len(self.numbers):
            object.__setattr__(self, "numbers", 1 + np.arange(len(self.readings)))


class SampleEstimate(NamedTuple):
    """Samples that were solved.

    knowledge: what was known of the beam.  exact: the readings (n, 9) that were solved, those of
    perfect detectors at the reference temperature; NaN where the beam's place is missing.
    """

    solution: Solution
    knowledge: Knowledge
    exact: Floats


@show_shortly
@dataclass(frozen=True)
class Poses:
    """The poses of some samples.

    Attributes
    ----------
    solution
        The solution of each sample.
    members
        (n,) whether a sample belongs to the zero, with a pose that fits its readings.
    object
        The columns (n,) of the measured object, of displacements from a zero, and of covariances
        and expanded uncertainties, by name; see `Measurement`.
    """

    solution: Solution
    members: Booleans
    object: dict[str, Floats] = field(default_factory=dict)

    def columns(self) -> dict[str, Any]:
        """The poses as columns of numbers, without what was measured beside them."""
        return self.solution.columns() | self.object


def detectors_of(used: ArrayLike) -> Booleans:
    """Whether each detector took part (n, 3), by a column `used`: bits, or letters."""
    column = np.asarray(used)
    if column.dtype.kind in "iu":
        return np.asarray(column[:, None] & DETECTOR_BITS > 0)
    words = column.astype(str)
    return np.stack([np.char.find(words, letter) >= 0 for letter in DETECTORS], axis=1)


def common_detectors(used: Booleans) -> Booleans:
    """The detectors (3,) that took part in all of some samples (n, 3); where these are fewer than
    two, the two that took part in most of them."""
    common = np.asarray(used.all(axis=0))
    if common.sum() < 2:
        common = np.arange(3) != int(np.argmin(used.sum(axis=0)))
    return common
