"""Samples, and the poses that are solved from them, with their columns in tables and recordings."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..core.arguments import check_arguments
from ..core.names import DETECTORS, POSE, STATE_COLUMNS, STATE_UNITS
from ..core.units import Booleans, Floats, Integers, unit_of
from .solution import LABELS, Solution, UncertainResult

if TYPE_CHECKING:
    from ..core.knowledge import Knowledge
    from .object_pose import ObjectPose

#: The status of a row that is not numbers.
UNPARSABLE = "unparsable"
#: The bit of each detector in a column `used`; a detector board has the same bits.
DETECTOR_BITS = np.array([1, 2, 4])


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
    """

    readings: Floats
    numbers: Integers = field(default_factory=lambda: np.empty(0, np.int64))
    time: Floats | None = None
    temperature: Floats | None = None
    place: Floats | None = None
    place_sigma: float | None = None
    saturated: Booleans | None = None

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
        return solution_columns(self.solution) | self.object


def solution_columns(solution: Solution) -> dict[str, Any]:
    """A solution as columns of numbers: state, status, the bits of the detectors used, residual,
    power, uncertainties, and `misfit`: 1 where the residual is beyond chance."""
    columns: dict[str, Any] = {
        name: solution.state[:, i] / STATE_UNITS[i] for i, name in enumerate(STATE_COLUMNS)
    }
    columns["status"] = solution.status
    columns["used"] = (solution.used @ DETECTOR_BITS).astype(np.uint8)
    columns["residual"] = solution.residual
    columns["power_mw"] = solution.power
    columns |= uncertainty_columns(solution)
    return columns | {"misfit": solution.misfit.astype(np.uint8)}


def worded_columns(columns: dict[str, Any]) -> dict[str, Any]:
    """Columns with the status in words, and the letters of the detectors used."""
    letters = np.array(DETECTORS)
    words = {
        "status": np.array([LABELS.get(number, "") for number in range(max(LABELS) + 1)]),
        "used": np.array(["".join(letters[(n & DETECTOR_BITS) > 0]) for n in range(8)]),
    }
    return columns | {name: words[name][columns[name]] for name in words if name in columns}


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
        f"u_{part}{prefix}{name}": size[:, i] / STATE_UNITS[i]
        for part, size in sizes.items()
        for i, name in enumerate(STATE_COLUMNS[: size.shape[1]])
    }


def expanded_columns(
    result: UncertainResult, probability: float, prefix: str = ""
) -> dict[str, Floats]:
    """Expanded uncertainties as columns, expanded_tx_mm, ..., with their coverage factors k_tx,
    ...; with a calibration also the degrees of freedom, degrees_of_freedom_tx, ..., NaN where
    unknown.  prefix: of the pose's names, such as object_."""
    sizes = result.expanded_uncertainty(probability)
    names = STATE_COLUMNS[: sizes.shape[1]]
    numbers = {"k": result.coverage_factor(probability)}
    if result.calibration_covariance is not None:
        numbers["degrees_of_freedom"] = result.degrees_of_freedom
    columns = {
        f"expanded_{prefix}{name}": sizes[:, i] / STATE_UNITS[i] for i, name in enumerate(names)
    }
    return columns | {
        f"{kind}_{prefix}{name.partition('_')[0]}": values[:, i]
        for kind, values in numbers.items()
        for i, name in enumerate(names)
    }


def covariance_columns(result: UncertainResult, prefix: str = "") -> dict[str, Floats]:
    """The covariance of poses as 21 columns, those on and above its diagonal: cov_tx_tx_mm2,
    cov_tx_roll_mm_mrad, ..., cov_yaw_yaw_mrad2."""
    assert result.covariance is not None
    columns = {}
    for i, j in zip(*np.triu_indices(6), strict=True):
        unit_i, unit_j = (unit_of(POSE[k]).unit for k in (i, j))
        unit = f"{unit_i}2" if unit_i == unit_j else f"{unit_i}_{unit_j}"
        scale = STATE_UNITS[i] * STATE_UNITS[j]
        columns[f"cov_{prefix}{POSE[i]}_{POSE[j]}_{unit}"] = result.covariance[:, i, j] / scale
    return columns


def result_columns(
    result: ObjectPose, prefix: str, covariance: bool, coverage: float | None = None
) -> dict[str, Floats]:
    """Poses of an object as columns with their standard uncertainties, and on request their
    covariances and expanded uncertainties."""
    columns = {
        f"{prefix}{name}": result.pose[:, i] / STATE_UNITS[i]
        for i, name in enumerate(STATE_COLUMNS[:6])
    }
    columns |= uncertainty_columns(result, prefix)
    columns |= covariance_columns(result, prefix) if covariance else {}
    return columns | ({} if coverage is None else expanded_columns(result, coverage, prefix))
