"""Samples, the results of their estimates (states, statuses, covariances), and table columns."""

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

#: The bit of each detector in a column `used`; detector boards use the same bits.
DETECTOR_BITS = np.array([1, 2, 4])


class Status(IntEnum):
    """Result of the estimate of one reading; only a converged one has a pose.

    UNCHECKED: there are only as many usable numbers as unknowns, so that a corrupted reading would
    cause an undetected error; `solve(..., accept_unchecked=True)` returns such a pose. AMBIGUOUS:
    another pose has the same reading. Only live samples can be SKIPPED or SATURATED. SKIPPED: the
    sample was recorded but not solved, because the run was late; a replay solves it. SATURATED: a
    converter was at the end of its range, so that the reading is not finite.
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


#: Words for the statuses, by number.
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
        """The squares of `uncertainty`; None without a covariance."""
        return None if self.covariance is None else diagonal(self.covariance)

    @property
    def uncertainty(self) -> Floats:
        """Combined standard uncertainty of each component: (..., 8) of a state, (..., 6) of an
        object's pose; mm and rad."""
        root: Floats = np.sqrt(self.require_covariance(self.variance))
        return root

    @property
    def noise_uncertainty(self) -> Floats:
        """The part of `uncertainty` due to the noise of the readings; mm and rad.

        A mean over n samples of one pose has this part divided by sqrt(n). Raises `InputError` if
        the sensor has no calibration covariance.
        """
        return root_of_diagonal(self.require_part(self.noise_covariance))

    @property
    def calibration_uncertainty(self) -> Floats:
        """The part of `uncertainty` due to the calibration; mm and rad.

        A mean over samples has the same part. Raises `InputError` if the sensor has no calibration
        covariance.
        """
        return root_of_diagonal(self.require_part(self.calibration_covariance))

    @property
    def degrees_of_freedom(self) -> Floats:
        """Effective degrees of freedom of `uncertainty`, by Welch and Satterthwaite.

        Noise and priors count as known, with infinitely many degrees of freedom. NaN if the
        calibration's degrees of freedom are unknown, because the configuration has no
        `sensor.calibration.degrees_of_freedom`.
        """
        variance = self.uncertainty**2
        freedom: Floats = np.full(variance.shape, np.inf)
        if self.calibration_covariance is not None:
            part = diagonal(self.calibration_covariance)
            part_freedom = np.asarray(self.calibration_degrees_of_freedom, float)[..., None]
            freedom = effective_degrees_of_freedom(variance, part, part_freedom)
        freedom[np.isnan(variance)] = np.nan
        return freedom

    def coverage_factor(self, probability: float = 0.95) -> Floats:
        """Coverage factor of each component's interval; NaN without a pose.

        It is the quantile of Student's t distribution for `degrees_of_freedom`, or of the normal
        distribution if these are infinite or unknown.
        """
        factor = coverage_factor(probability, self.degrees_of_freedom)
        factor[np.isnan(self.uncertainty)] = np.nan
        return factor

    def expanded_uncertainty(self, probability: float = 0.95) -> Floats:
        """Expanded uncertainty of each component; mm and rad.

        It is `coverage_factor` times `uncertainty`: with this probability, the true value differs
        from the estimate by no more.

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
            raise InputError("no covariance: solve was called with covariance=False")
        return numbers

    def require_part(self, covariance: Floats | None) -> Floats:
        """Return a part of the covariance.  Raises `InputError` if there are no parts."""
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
    """Replace the numbers in the columns `status` and `used` by words and detectors' letters."""
    letters = np.array(DETECTORS)
    words = {
        "status": np.array([LABELS.get(number, "") for number in range(max(LABELS) + 1)]),
        "used": np.array(["".join(letters[(n & DETECTOR_BITS) > 0]) for n in range(8)]),
    }
    return columns | {name: words[name][columns[name]] for name in words if name in columns}


#: Parts of an uncertainty with columns of their own if the sensor has a calibration.
UNCERTAINTY_PARTS = ("noise", "calibration")


def uncertainty_columns(result: UncertainResult, prefix: str = "") -> dict[str, Floats]:
    """Standard uncertainties of a solution, or of poses of an object, as columns u_tx_mm, ...; with
    a calibration also their parts, u_noise_tx_mm, ... and u_calibration_tx_mm, ...

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
    """Expanded uncertainties as columns expanded_tx_mm, ..., with their coverage factors k_tx, ...

    With a calibration there are also the degrees of freedom, degrees_of_freedom_tx, ..., NaN if
    unknown.  probability: of the coverage.  prefix: of the pose's names, such as object_.
    """
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
    """The covariances of poses as 21 columns: cov_tx_tx_mm2, ..., cov_yaw_yaw_mrad2."""
    covariance = result.require_covariance(result.covariance)
    return {
        name: covariance[..., i, j] / (STATE_UNITS[i] * STATE_UNITS[j])
        for name, (i, j) in covariance_entries(prefix).items()
    }


def frame_like(source: Any, sizes: Floats) -> Any:
    """Return standard uncertainties (..., 8), as a data frame if their `source` is one."""
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
        (...) power of the beam, mW.
    used
        (..., 3) whether each detector took part.
    iterations
        (...) number of steps of the estimate.
    residual
        (...) root of the remaining weighted sum of squares, in standard deviations.
    checks
        (...) degrees of freedom of the residual: the number of readings and priors in excess of the
        unknowns; 0 for an unchecked pose.
    limit
        (...) the residual that noise alone exceeds once in 10,000; infinite without checks.
    covariance
        (..., 8, 8) covariance of the state, or None if not requested; zero for known components.
        It contains the noise of the readings, the priors of beam and power, and the calibration.
    noise_covariance
        (..., 8, 8) the part of `covariance` due to the noise of the readings; None if the sensor
        has no calibration covariance (`Sensor.calibration`).
    calibration_covariance
        (..., 8, 8) the part of `covariance` due to the calibration; None likewise.
    calibration_degrees_of_freedom
        (...) of that part (`Calibration.degrees_of_freedom`), NaN if unknown; None likewise.
    index
        The index of the readings' data frame; None for other readings.

    Notes
    -----
    Noise differs between samples: a mean over n samples of one pose has its variance divided by n.
    The errors of the calibration are the same in every sample, so that they remain in a mean. This
    also holds for the part of the priors, which is `covariance` minus the two parts. The
    calibration's part of a difference of two poses is much smaller; see
    `facets.difference_uncertainty`.

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
        """Whether each reading has a pose: (...)."""
        return np.equal(self.status, problem.CONVERGED)

    @property
    def misfit(self) -> NDArray[np.bool_]:
        """Whether each reading has a pose with a residual beyond `limit`: (...).

        The numbers of such a reading contradict each other or the model of the sensor. The pose's
        error may be far larger than its stated uncertainty.
        """
        return np.greater(self.residual, self.limit)

    @property
    def ok(self) -> NDArray[np.bool_]:
        """Whether each reading has a pose that is no misfit: (...).

        One in 10,000 correct poses is marked as a misfit by chance. `facets.unseen_errors` bounds
        the error that one corrupted number can cause in a pose that is `ok`; with a free beam, the
        positions of the spots have no redundancy.
        """
        return self.converged & ~self.misfit

    @property
    def summary(self) -> str:
        """Number of poses, number of poses that are `ok`, the root mean square of the residuals
        relative to the stated noise, and the indices of the first misfits."""
        checks, ok = np.asarray(self.checks, float)[self.converged], np.count_nonzero(self.ok)
        squares = np.square(self.residual[self.converged])
        ratio = np.sqrt(squares.sum() / checks.sum()) if checks.any() else np.nan
        text = (
            f"{count_text(np.size(self.status), 'pose')}, {ok:,} ok, residual {ratio:.2f} of 1.00 "
            "expected"
        )
        misfits = np.flatnonzero(self.misfit).tolist()
        return f"{text}; the first misfits: {misfits[:5]}" if misfits else text

    def columns(self) -> dict[str, Any]:
        """Columns of numbers, in the units of tables: state, status, the bits of the used
        detectors, residual, power, uncertainties, and `misfit`, 1 for a residual beyond its limit.
        """
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
            Whether to add the covariance of each pose, as the 21 columns cov_tx_tx_mm2, ..., which
            `facets.transform` reads.

        Returns
        -------
        DataFrame
            One row for each reading, with the index of the readings if they were a data frame: the
            state in mm and mrad, status, standard uncertainties. `attrs["units"]` has the units of
            the columns.

        Examples
        --------
        >>> import numpy as np, facets
        >>> sensor = facets.Sensor()
        >>> poses = facets.solve(sensor, facets.readings(sensor, np.zeros((3, 8)))).to_frame()
        >>> poses.status.tolist(), poses.attrs["units"]["roll_mrad"]
        (['converged', 'converged', 'converged'], 'mrad')
        """
        covariances = covariance_columns(self) if covariance else {}
        return make_frame(worded_columns(self.columns()) | covariances, index=self.index)


def empty_solution(count: int, status: int, has_parts: bool) -> Solution:
    """Make a solution of `count` readings with one status and no pose.

    has_parts: whether the covariance has parts.
    """
    numbers = np.full((count, COVARIANCE + len(problem.KEPT_ENTRIES)), np.nan)
    numbers[:, STATUS:RESIDUAL] = numbers[:, CHECKS] = 0.0
    numbers[:, STATUS], numbers[:, LIMIT] = status, np.inf
    unknown = np.full((count, 8, 8), np.nan)
    parts = UncertaintyParts(unknown, unknown, unknown, np.nan) if has_parts else None
    return LazySolution.from_fields({"numbers": numbers}, parts)


def root_of_covariance(covariance: Floats) -> Floats:
    """Matrix (..., n, n) whose product with its transpose is the covariance (..., n, n)."""
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
    """Make a solution from results, with the leading `shape` of the readings.

    chance: limits of the residuals.  parts: covariances, if the sensor has a calibration.
    """
    checks, entries = chance.checks(results.used), results.covariances
    fields = {
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
    return LazySolution.from_fields(fields, parts)


#: Functions that compute each field of a `LazySolution` from its numbers.
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
    """The numbers of a `LazySolution` as results, whose floats are views of the numbers."""
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


#: Lock for the computation of a field of a `LazySolution`.
COMPUTING = RLock()


class LazySolution(Solution):
    """A solution whose fields are computed when they are first read.

    Computing all fields of one reading takes as long as its estimate, and a loop reads two or
    three. For many readings only the covariances are lazy: their `KEPT_ENTRIES` take half the
    memory.

    numbers: (..., n) the rows that blocks wrote for one reading or a few.  entries: (..., 36)
    entries of the covariances; (..., 0) without.
    """

    numbers: Floats
    entries: Floats

    @classmethod
    def from_fields(cls, fields: dict[str, Any], parts: UncertaintyParts | None) -> LazySolution:
        """Make a solution from some of its fields, and `numbers` or `entries`.

        parts: covariances with their parts, if the sensor has a calibration.
        """
        lazy = object.__new__(cls)
        lazy.__dict__.update(fields)
        if parts is not None:
            shape = lazy.status.shape
            lazy.__dict__.update(
                covariance=parts.total.reshape(*shape, 8, 8),
                noise_covariance=parts.noise.reshape(*shape, 8, 8),
                calibration_covariance=parts.calibration.reshape(*shape, 8, 8),
                calibration_degrees_of_freedom=np.full(shape, parts.degrees_of_freedom),
            )
        return lazy

    def __getattr__(self, name: str) -> Any:
        computed = vars(self)
        with COMPUTING:
            if name in computed:  # Another thread has computed it.
                return computed[name]
            if name == "covariance":
                entries = self.entries
                value = problem.unpack_covariances(entries) if entries.shape[-1] else None
                del computed["entries"]  # to store the covariances only once
            elif name in FIELDS and "numbers" in computed:
                value = FIELDS[name](self.numbers)
            else:
                raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
            computed[name] = value
            return value

    @property
    def variance(self) -> Floats | None:
        with COMPUTING:
            if "covariance" in vars(self):
                return super().variance
            return self.entries[..., :8] if self.entries.shape[-1] else None


#: Status of a malformed row.
UNPARSABLE = "unparsable"


@check_arguments
@dataclass(frozen=True)
class Samples:
    """Readings that are solved together, with the other measured data of each sample.

    Attributes
    ----------
    readings
        (n, 9) of one instant each (`align`), as the detectors gave them; mm and mW.
    numbers
        (n,) numbers of the samples; by default from 1.
    time
        (n,) s; None if unknown.
    temperature
        (n,) degrees Celsius, NaN for a missing value; None without a thermometer.
    place
        (n, 2) measured position of the beam, mm, without `solve.beam_offset_um` and without the
        shift by the temperature; a sample with NaN has no pose. None: the origin.
    place_sigma
        Standard uncertainty of `place`, mm; infinite: the beam is free. None: as the
        configuration's `solve` states.
    saturated
        (n,) whether a converter was at the end of its range; None if unknown.
    ends
        Row after the last one of each piece in which samples of a run came; None for one piece.
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
    """The estimate of samples.

    knowledge: prior knowledge of beam and power.  exact: (n, 9) the corrected readings that were
    solved, of perfect detectors at the reference temperature; NaN where the beam's position is
    missing.
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
        (n,) whether a sample belongs to the zero and has a pose that fits its readings.
    object
        The columns (n,) of the measured object, of displacements from a zero, and of covariances
        and expanded uncertainties, by name; see `Measurement`.
    """

    solution: Solution
    members: Booleans
    object: dict[str, Floats] = field(default_factory=dict)

    def columns(self) -> dict[str, Any]:
        """Columns of numbers of the poses, without the samples' measured data."""
        return self.solution.columns() | self.object


def detectors_of(used: ArrayLike) -> Booleans:
    """Whether each detector took part (n, 3), from a column `used` of bits or letters."""
    column = np.asarray(used)
    if column.dtype.kind in "iu":
        return np.asarray(column[:, None] & DETECTOR_BITS > 0)
    words = column.astype(str)
    return np.stack([np.char.find(words, letter) >= 0 for letter in DETECTORS], axis=1)


def common_detectors(used: Booleans) -> Booleans:
    """Whether each detector (3,) took part in all samples (n, 3); if fewer than two did, whether it
    is one of the two that took part in most samples."""
    common = np.asarray(used.all(axis=0))
    if common.sum() < 2:
        common = np.arange(3) != int(np.argmin(used.sum(axis=0)))
    return common
