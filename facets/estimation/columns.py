"""Poses as the columns of tables, recordings and publications."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..core.names import DETECTORS, POSE, STATE_COLUMNS, STATE_UNITS
from ..core.units import Floats, unit_of
from .object_pose import ObjectPose
from .solution import LABELS, Solution, UncertainResult

UNPARSABLE = "unparsable"
#: The bit of each detector in the number of those that were used, as a board has it, too.
DETECTOR_BITS = np.array([1, 2, 4])


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


def in_words(columns: dict[str, Any]) -> dict[str, Any]:
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
        one, other = (unit_of(POSE[k]).unit for k in (i, j))
        unit = f"{one}2" if one == other else f"{one}_{other}"
        scale = STATE_UNITS[i] * STATE_UNITS[j]
        columns[f"cov_{prefix}{POSE[i]}_{POSE[j]}_{unit}"] = result.covariance[:, i, j] / scale
    return columns


def result_columns(
    found: ObjectPose, prefix: str, covariance: bool, coverage: float | None = None
) -> dict[str, Floats]:
    """Poses of an object as columns with their standard uncertainties, and on request their
    covariances and expanded uncertainties."""
    columns = {
        f"{prefix}{name}": found.pose[:, i] / STATE_UNITS[i]
        for i, name in enumerate(STATE_COLUMNS[:6])
    }
    columns |= uncertainty_columns(found, prefix)
    columns |= covariance_columns(found, prefix) if covariance else {}
    return columns | ({} if coverage is None else expanded_columns(found, coverage, prefix))
