"""Ranges, Jacobians and resolutions as columns of tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..core.names import POSE, state_columns
from ..core.units import Floats, ascii_unit, unit_of
from .outlines import Boundary
from .pose_density import AVERAGING_TIMES, FREQUENCIES, PoseDensity
from .propagation import PropagationResult
from .ranges import CAUSES
from .resolution import Resolution
from .singularity import Survey


def cause_of(number: int) -> str:
    """The cause that ends a range, in words; "nowhere" for -1, if the search found no end."""
    return CAUSES[number] if number >= 0 else "nowhere"


def outline_columns(boundaries: Sequence[Boundary]) -> dict[str, Any]:
    """Outlines of ranges, one row for each point; places in the units of their axes' names."""
    keys = ("axis_1", "axis_2", "value_1", "value_2", "ends_where")
    rows: dict[str, list[Any]] = {key: [] for key in keys}
    for boundary in boundaries:
        factors = [unit_of(name).factor for name in boundary.axes]
        what = "" if boundary.object is None else "displacement_"
        names = [f"{what}{name}_{unit_of(name).unit}" for name in boundary.axes]
        for point, cause in zip(boundary.points * factors, boundary.causes, strict=True):
            for key, value in zip(rows, (*names, *point, cause_of(cause)), strict=True):
                rows[key].append(value)
    return {key: np.array(column) for key, column in rows.items()}


def resolution_columns(
    resolutions: Sequence[Resolution],
    densities: Sequence[PoseDensity],
    coverage: float | None = None,
) -> dict[str, Any]:
    """Resolutions, one row for each estimator and axis; um and urad.  densities: of the noise of
    each estimator.  coverage: probability of expanded uncertainties, with their coverage factors,
    or None for none."""
    rows = [resolution_row(row, i) for row in resolutions for i in range(len(POSE))]
    columns = {key: np.array([row[key] for row in rows]) for key in rows[0]}
    columns |= noise_columns(densities)
    if coverage is not None:
        places = zip(*(row.coverage(coverage) for row in resolutions), strict=True)
        for place, numbers in zip(("at_rest", "worst", "worst_in_box"), places, strict=True):
            freedom, factor = (np.concatenate(part) for part in zip(*numbers, strict=True))
            columns[f"expanded_{place}"] = factor * columns[f"u_{place}"]
            columns |= {f"k_{place}": factor, f"degrees_of_freedom_{place}": freedom}
    return columns


def noise_columns(densities: Sequence[PoseDensity]) -> dict[str, Floats]:
    """Amplitude densities and Allan deviations, one row for each estimator and axis; um/sqrt(Hz)
    and urad/sqrt(Hz), um and urad."""
    fine = np.array([unit_of(name).fine_factor for name in POSE])
    return {
        f"density_{name}_per_rthz": np.concatenate([fine * d.amplitude(f) for d in densities])
        for name, f in FREQUENCIES.items()
    } | {
        f"allan_{name}": np.concatenate([fine * d.allan_deviation(tau) for d in densities])
        for name, tau in AVERAGING_TIMES.items()
    }


def resolution_row(row: Resolution, i: int) -> dict[str, Any]:
    """The row of the axis i of a table of resolutions, um and urad."""
    unit = unit_of(POSE[i])
    shares = {
        f"share_of_{s.replace(' ', '_')}": row.shares[i, n] for n, s in enumerate(row.sources)
    }
    return {
        "estimator": ascii_unit(row.how.name),
        "axis": POSE[i] if row.object is None else f"displacement_{POSE[i]}",
        "unit": ascii_unit(unit.fine_unit),
        "u_at_rest": unit.fine_factor * row.nominal[i],
        "u_worst": unit.fine_factor * row.worst[i],
        "u_expanded_worst": 2 * unit.fine_factor * row.worst[i],
        "u_worst_in_box": unit.fine_factor * row.worst_in_box[i],
        **shares,
        **state_columns(row.worst_state[i], "worst_at_"),
        **state_columns(row.box_state[i], "worst_in_box_at_"),
    }


def trial_columns(results: dict[str, PropagationResult]) -> dict[str, Any]:
    """The results of trials, one row for each pose and axis; um and urad.

    Ends of intervals are relative to the estimate, which is the pose of the readings without noise.
    """
    rows = [
        trial_row(number, where, result, i)
        for number, (where, result) in enumerate(results.items(), start=1)
        for i in range(len(POSE))
    ]
    return {key: np.array([row[key] for row in rows]) for key in rows[0]}


def trial_row(number: int, where: str, result: PropagationResult, i: int) -> dict[str, Any]:
    """The row of the axis i in a table of trials, um and urad. number, where: of the pose."""
    unit, linear = unit_of(POSE[i]), result.linear
    factor, place = unit.fine_factor, linear.pose[0, i]
    digits, undecided = result.validate()
    return {
        "pose": number,
        "where": where,
        **state_columns(result.state),
        "axis": f"displacement_{POSE[i]}" if linear.is_displacement else POSE[i],
        "unit": ascii_unit(unit.fine_unit),
        "u_linear": factor * linear.uncertainty[0, i],
        "k_linear": linear.coverage_factor(result.probability)[0, i],
        "expanded_linear": factor * linear.expanded_uncertainty(result.probability)[0, i],
        "u_trials": factor * np.sqrt(result.covariance[i, i]),
        "mean_trials": factor * (result.mean[i] - place),
        "symmetric_low": factor * (result.symmetric.low[i] - place),
        "symmetric_high": factor * (result.symmetric.high[i] - place),
        "error_of_ends": factor * result.symmetric.errors[i].max(),
        "agrees_to_digits": digits[i],
        "needs_more_trials": int(undecided[i]),
        "trials": result.count,
        "without_pose": sum(result.trials.failures.values()),
        "far": result.far,
        "region_factor_linear": result.linear_region_factor,
        "region_factor_trials": result.region_factor,
        "region_probability_linear": result.linear_region_probability,
    }


def density_columns(survey: Survey) -> dict[str, Any]:
    """Classes of apex offset and determinant that hold states."""
    offsets, levels = survey.edges[0], survey.edges[1]
    i, j = np.nonzero(survey.counts)
    return {
        "apex_offset_from_mm": offsets[i],
        "apex_offset_to_mm": offsets[i + 1],
        "determinant_from": levels[j],
        "determinant_to": levels[j + 1],
        "states": survey.counts[i, j].astype(int),
    }
