"""The results of estimates: states, statuses, covariances."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..core.names import STATE_COLUMNS, STATE_UNITS
from ..core.units import Floats
from ..files.frame_table import make_frame
from . import problem
from .plan import Chance
from .problem import CHECKS, COVARIANCE, ITERATIONS, LIMIT, RESIDUAL, STATUS, USED
from .result import (
    DETECTOR_BITS,
    UncertainResult,
    covariance_columns,
    uncertainty_columns,
    worded_columns,
)
from .result import LABELS as LABELS
from .result import Status as Status
from .uncertainty import UncertaintyParts

if TYPE_CHECKING:
    from pandas import DataFrame


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

    def columns(self) -> dict[str, Any]:
        """The solution as columns of numbers: state, status, the bits of the detectors used,
        residual, power, uncertainties, and `misfit`: 1 where the residual is beyond chance."""
        columns: dict[str, Any] = {
            name: self.state[..., i] / STATE_UNITS[i] for i, name in enumerate(STATE_COLUMNS)
        }
        columns["status"] = self.status
        columns["used"] = (self.used @ DETECTOR_BITS).astype(np.uint8)
        columns["residual"] = self.residual
        columns["power_mw"] = self.power
        if self.covariance is not None:
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
    """A solution without any pose, with one status.  has_parts: whether uncertainties have."""
    unknown = np.full((count, 8, 8), np.nan)
    part = unknown if has_parts else None
    return Solution(
        state=np.full((count, 8), np.nan),
        status=np.full(count, status, np.int8),
        power=np.full(count, np.nan),
        used=np.zeros((count, 3), bool),
        iterations=np.zeros(count, np.int32),
        residual=np.full(count, np.nan),
        checks=np.zeros(count, np.int8),
        limit=np.full(count, np.inf),
        covariance=unknown,
        noise_covariance=part,
        calibration_covariance=part,
        calibration_degrees_of_freedom=np.full(count, np.nan) if has_parts else None,
    )


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
    checks = chance.checks(results.used)
    return Solution(
        state=results.states[:, :8].reshape(*shape, 8),
        status=results.status.reshape(shape),
        power=results.states[:, 8].reshape(shape),
        used=results.used.reshape(*shape, 3),
        iterations=results.steps.reshape(shape),
        residual=results.residuals.reshape(shape),
        checks=checks.reshape(shape),
        limit=chance.limits(checks).reshape(shape),
        covariance=results.covariances.reshape(*shape, 8, 8)
        if results.covariances.shape[1]
        else None,
        noise_covariance=None if parts is None else parts.noise.reshape(*shape, 8, 8),
        calibration_covariance=None if parts is None else parts.calibration.reshape(*shape, 8, 8),
        calibration_degrees_of_freedom=(
            None if parts is None else np.full(shape, parts.degrees_of_freedom)
        ),
    )


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
    "covariance": lambda numbers: (
        numbers[..., COVARIANCE:].reshape(*numbers.shape[:-1], 8, 8)
        if numbers.shape[-1] > COVARIANCE
        else None
    ),
    "noise_covariance": lambda numbers: None,
    "calibration_covariance": lambda numbers: None,
    "calibration_degrees_of_freedom": lambda numbers: None,
}


def results_of(numbers: Floats) -> problem.Results:
    """The numbers of a `LazySolution` as results, whose floats are parts of them."""
    rows = numbers.reshape(-1, numbers.shape[-1])
    fields = Solution(*(make(rows) for make in FIELDS.values()))
    return problem.Results(
        states=rows[:, :9],
        used=fields.used,
        status=fields.status,
        steps=fields.iterations,
        residuals=fields.residual,
        covariances=np.empty((0, 0, 0)) if fields.covariance is None else fields.covariance,
    )


class LazySolution(Solution):
    """The solution of one reading or of a few, made of the numbers that blocks left.

    A field is made when it is first asked for: to make all nine takes as long as the estimate, and
    a loop asks for two or three.
    """

    @classmethod
    def from_numbers(cls, numbers: Floats, parts: UncertaintyParts | None = None) -> LazySolution:
        """numbers: (..., n).  Numbers and parts are its own."""
        lazy = object.__new__(cls)
        lazy.__dict__["_numbers"] = numbers
        if parts is not None:
            shape = numbers.shape[:-1]
            freedom = np.full(shape, parts.degrees_of_freedom)
            lazy.__dict__["noise_covariance"] = parts.noise.reshape(*shape, 8, 8)
            lazy.__dict__["calibration_covariance"] = parts.calibration.reshape(*shape, 8, 8)
            lazy.__dict__["calibration_degrees_of_freedom"] = freedom
        return lazy

    def __getattr__(self, name: str) -> Any:
        if name not in FIELDS or "_numbers" not in self.__dict__:
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        made = self.__dict__[name] = FIELDS[name](self._numbers)
        return made

    def plain(self) -> Solution:
        return Solution(*(getattr(self, name) for name in (*FIELDS, "index")))

    def __repr__(self) -> str:
        return repr(self.plain())

    def __reduce__(self) -> Any:
        """A copy is a plain `Solution`."""
        return Solution, tuple(vars(self.plain()).values())
