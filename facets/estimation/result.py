"""Statuses and uncertainties of the results of estimates, and their columns in tables."""

from __future__ import annotations

from enum import IntEnum
from typing import Any

import numpy as np

from ..core.arguments import index_of
from ..core.errors import InputError
from ..core.names import DETECTORS, STATE_COLUMNS, STATE_UNITS, covariance_entries
from ..core.units import Floats
from ..files.frame_table import make_frame
from . import problem
from .uncertainty import coverage_factor, effective_degrees_of_freedom

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
    def uncertainty(self) -> Floats:
        """Combined standard uncertainty of each component: (..., 8) of a state, (..., 6) of an
        object's pose; mm and rad."""
        return root_of_diagonal(self.require_covariance())

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
            part = np.diagonal(self.calibration_covariance, axis1=-2, axis2=-1)
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

    def require_covariance(self) -> Floats:
        if self.covariance is None:
            raise InputError("no covariance: it was left out by solve(..., covariance=False)")
        return self.covariance

    def require_part(self, covariance: Floats | None) -> Floats:
        if covariance is None:
            raise InputError(
                "the uncertainty has no parts: the sensor has no calibration covariance, or solve "
                "was called with covariance=False; facets.mean_uncertainty and "
                "facets.difference_uncertainty take a sensor without one, too"
            )
        return covariance


def root_of_diagonal(covariance: Floats) -> Floats:
    """Standard uncertainties (..., m) of a covariance (..., m, m)."""
    root: Floats = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
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
    return {
        f"u_{part}{prefix}{name}": size[..., i] / STATE_UNITS[i]
        for part, size in sizes.items()
        for i, name in enumerate(STATE_COLUMNS[: size.shape[-1]])
    }


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
    columns = {
        f"expanded_{prefix}{name}": sizes[..., i] / STATE_UNITS[i] for i, name in enumerate(names)
    }
    return columns | {
        f"{kind}_{prefix}{name.partition('_')[0]}": values[..., i]
        for kind, values in numbers.items()
        for i, name in enumerate(names)
    }


def covariance_columns(result: UncertainResult, prefix: str = "") -> dict[str, Floats]:
    """The covariance of poses as 21 columns: cov_tx_tx_mm2, ..., cov_yaw_yaw_mrad2."""
    covariance = result.require_covariance()
    return {
        name: covariance[..., i, j] / (STATE_UNITS[i] * STATE_UNITS[j])
        for name, (i, j) in covariance_entries(prefix).items()
    }


def frame_like(source: Any, sizes: Floats) -> Any:
    """Standard uncertainties (..., 8) of states; as a data frame where these were one."""
    index = index_of(source)
    if index is None:
        return sizes
    columns = {f"u_{name}": sizes[..., i] / STATE_UNITS[i] for i, name in enumerate(STATE_COLUMNS)}
    return make_frame(columns, index=index)
