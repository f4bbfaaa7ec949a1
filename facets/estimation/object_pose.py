"""Transform the mirror's pose to the measured object's pose, with its covariance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.arguments import as_floats, check_arguments, index_of, require_plausible
from ..core.errors import InputError
from ..core.names import STATE_UNITS, TEMPERATURE_COLUMN, covariance_entries, state_columns
from ..core.notebook import show_shortly
from ..core.rigid_body import MIRROR, MeasuredObject, object_displacements, object_poses
from ..core.units import Booleans, Floats
from ..files.columns import pack_covariances
from ..files.frame_table import make_frame
from ..model.arrays import as_rows
from .differences import common_fractions, covariance_of_sum
from .solution import (
    Solution,
    UncertainResult,
    covariance_columns,
    expanded_columns,
    uncertainty_columns,
)
from .uncertainty import carry, propagate, slices_of
from .zero import ZeroPose

if TYPE_CHECKING:
    from pandas import DataFrame


@show_shortly
@dataclass(frozen=True)
class ObjectPose(UncertainResult):
    """Poses of an object, or its displacements from a zero; from `facets.transform`.

    Attributes
    ----------
    pose
        (..., 6) x, y, z, roll, pitch, yaw; mm, rad; NaN if the mirror's pose is unknown. An
        absolute pose is in the world frame, a displacement in the object's axes at the zero.
    status
        (...) of `facets.Status`, as in the solution; None if plain states were transformed.
    covariance
        (..., 6, 6) of the pose, or None if the solution has none.
    noise_covariance, calibration_covariance
        (..., 6, 6) its parts, as in `facets.Solution`.
    is_displacement
        Whether `pose` is a displacement from a zero.
    calibration_degrees_of_freedom
        (...) as in `facets.Solution`.
    index
        The index of the data frame from which the poses came; None for other input.
    """

    pose: Floats
    status: NDArray[np.int8] | None
    covariance: Floats | None
    noise_covariance: Floats | None
    calibration_covariance: Floats | None
    is_displacement: bool
    calibration_degrees_of_freedom: Floats | None = None
    index: Any = None

    def columns(
        self, prefix: str, covariance: bool = False, coverage: float | None = None
    ) -> dict[str, Floats]:
        """Columns of the poses with their standard uncertainties, in the units of tables.

        prefix: of the names, such as object_.  covariance: whether to add the covariances.
        coverage: probability of the expanded uncertainties that are added, if any.
        """
        columns: dict[str, Floats] = state_columns(self.pose, prefix)
        if self.covariance is None:
            return columns
        columns |= uncertainty_columns(self, prefix)
        columns |= covariance_columns(self, prefix) if covariance else {}
        return columns | ({} if coverage is None else expanded_columns(self, coverage, prefix))

    def to_frame(self) -> DataFrame:
        """Make a data frame of pandas with the columns of a table of poses.

        Returns
        -------
        DataFrame
            One row for each pose, with the index of the data frame from which the poses came: the
            columns object_tx_mm, ... or displacement_tx_mm, ..., and their standard uncertainties.
            `attrs["units"]` has the units of the columns.
        """
        prefix = "displacement_" if self.is_displacement else "object_"
        return make_frame(self.columns(prefix), index=self.index)


@check_arguments
def transform(
    solution: Solution | ArrayLike,
    object: MeasuredObject | None = None,
    zero: ZeroPose | ArrayLike | None = None,
    *,
    members: ArrayLike | None = None,
    temperature: ArrayLike | None = None,
) -> ObjectPose:
    """Compute the pose of an object on the mirror, or its displacement from a zero.

    Parameters
    ----------
    solution
        A solution, or states (..., 8) or poses (..., 6) of the mirror; mm and rad, world frame. A
        data frame may contain the columns of a covariance (`--covariance`).
    object
        The point of interest and the object's axes, such as `Config.object`; None: the apex and
        the mirror's own axes.
    zero
        The reference pose of the mirror for displacements: a `ZeroPose` from `facets.zero_pose`,
        or an exact state (8,) or pose (6,). None: absolute poses.
    members
        (...) whether each pose is one of the samples of the zero, so that both have the same noise;
        none by default.
    temperature
        (...) degrees Celsius, for a zero and a sensor with `Sensor.thermal`.

    Returns
    -------
    ObjectPose
        Poses (..., 6), with covariances (..., 6, 6) if the solution has them. A data frame's
        covariances are used unless the zero is a `ZeroPose`. `to_frame()` converts the poses to a
        data frame. NaN where the mirror's pose is NaN. Within 0.6 degrees of a pitch of 90 degrees
        roll and yaw are not unique: they and the uncertainties of all angles are NaN. Roll and yaw
        of an absolute pose lie within half a turn of the object's orientation.

    Raises
    ------
    InputError
        If an argument has a wrong shape or value, or the zero comes from another sensor.

    Notes
    -----
    With the mirror at t, R, the point p and the orientation Q, the absolute pose is t + R p, R Q.
    The displacement is the rigid-body motion X0^-1 X from the object's pose X0 at the zero, not a
    difference of components. The covariance is A S A', with A the exact derivatives of the motion
    and S the covariance of the mirror's pose. It includes correlations: a point 50 mm from the apex
    moves by 50 um for each mrad. The covariance of a displacement counts the errors that the two
    poses have in common once: those of the calibration, and the noise of the `members`.

    Examples
    --------
    >>> import numpy as np, facets
    >>> sensor = facets.Sensor()
    >>> solution = facets.solve(sensor, facets.readings(sensor, np.zeros(8)), beam="known")
    >>> tip = facets.transform(solution, facets.MeasuredObject(point=(0, 0, 50)))
    >>> [f"{1e3 * u:.2f} um" for u in (solution.uncertainty[0], tip.uncertainty[0])]  # of x
    ['0.07 um', '0.20 um']
    """
    body = MIRROR if object is None else object
    states, used, status, parts = unpack(solution, not isinstance(zero, ZeroPose))
    rows, shape = as_rows(states, 6 if states.shape[-1:] == (6,) else 8, "solution")
    if zero is None:
        pose, slopes = object_poses(rows[:, :6], body)
    else:
        start = zero.state if isinstance(zero, ZeroPose) else as_floats(zero, "zero", 6)
        if start.shape not in ((6,), (8,)):
            raise InputError(f"zero has shape {start.shape}; needed: (6,) or (8,), one pose")
        pose, slopes, slopes_zero = object_displacements(rows[:, :6], start[:6], body)
    if isinstance(zero, ZeroPose) and parts.total is not None:
        is_member = as_row(members, len(rows), "members", 0.0) > 0
        warmer = as_row(temperature, len(rows), "temperature", np.nan)
        require_plausible(warmer, TEMPERATURE_COLUMN, "temperature")
        warmer = np.nan_to_num(warmer - zero.sensor.thermal.reference)
        poses = MeasuredPoses(rows, used.reshape(-1, 3), parts)
        parts = displacement_covariance(poses, zero, (slopes, slopes_zero), is_member, warmer)
    else:
        parts = CovarianceParts(
            *(None if p is None else carry(slopes, p[POSE_BLOCK]) for p in parts)
        )
    total, noise, calibration = (None if p is None else p.reshape(*shape, 6, 6) for p in parts)
    freedom = getattr(solution, "calibration_degrees_of_freedom", None)
    return ObjectPose(
        pose.reshape(*shape, 6), status, total, noise, calibration, zero is not None, freedom,
        solution.index if isinstance(solution, Solution) else index_of(solution),
    )  # fmt: skip


class CovarianceParts(NamedTuple):
    """Covariances (n, m, m), and their parts due to noise and calibration; None if unknown."""

    total: Floats | None
    noise: Floats | None
    calibration: Floats | None


class MeasuredPoses(NamedTuple):
    """States (n, 8), whether each detector took part (n, 3), and covariances (n, 8, 8)."""

    states: Floats
    used: Booleans
    covariances: CovarianceParts


#: The part of covariances (n, 8, 8) that belongs to the pose.
POSE_BLOCK = np.s_[:, :6, :6]


def displacement_covariance(
    poses: MeasuredPoses,
    zero: ZeroPose,
    slopes: tuple[Floats, Floats],
    members: Booleans,
    warmer: Floats,
) -> CovarianceParts:
    """The covariances (n, 6, 6) of displacements from a zero.

    slopes: (n, 6, 6) derivatives of the displacements by the mirror's pose and by the zero.
    members: (n,) whether a pose is a sample of the zero, so that the zero contains its errors.
    warmer: (n,) temperature above the calibration's reference, K.
    """
    parameters, (total, noise, calibration) = zero.sensor.calibration, poses.covariances
    assert total is not None
    if (parameters is None) != (calibration is None):
        raise InputError(
            "the solution and the zero come from different sensors: only one has a calibration "
            "covariance; compute the zero with the sensor of the solution"
        )

    by_pose, by_zero = slopes
    single, count = zero.propagation.noise[0, :6, :6], zero.samples
    priors = zero.propagation.statistical[0, :6, :6] - single

    def combine(covariance: Floats, prior: Floats) -> Floats:
        """Propagate the noise and the priors of poses and zero to displacements.

        A sample of the zero is part of the zero's mean, and its priors have the same errors.
        """
        outside = carry(by_pose, covariance[POSE_BLOCK]) + carry(by_zero, single / count + prior)
        rest = carry(by_zero, single * (count - 1) / count**2)
        within = carry(by_pose + by_zero / count, single) + rest + carry(by_pose + by_zero, prior)
        return np.where(members[:, None, None], within, outside)

    if parameters is None or noise is None or calibration is None:
        return CovarianceParts(combine(total, priors), None, None)
    by_calibration = np.empty((len(total), 6, 6))
    for part in slices_of(len(total)):
        states, plan = poses.states[part], zero.plan
        other = propagate(zero.sensor, parameters, states, poses.used[part], plan, warmer[part])
        ends = [
            by[part] @ end.slopes[:, :6]
            for by, end in zip(slopes, (other, zero.propagation), strict=True)
            if end.slopes is not None
        ]
        pairs = (zero.propagation, other), (zero.state[None], states)
        fractions = common_fractions(parameters, *pairs)
        fractions[members[part]] = 1.0
        fractions *= zero.same_calibration
        by_calibration[part] = covariance_of_sum(parameters, (ends[1], ends[0]), fractions)
    return CovarianceParts(
        combine(total - calibration, priors) + by_calibration,
        combine(noise, np.zeros_like(priors)),
        by_calibration,
    )


def unpack(
    solution: Solution | ArrayLike, is_framed: bool = False
) -> tuple[Floats, Any, Any, CovarianceParts]:
    """Unpack a solution, or plain states, to states (..., 8 or 6), the used detectors (..., 3),
    statuses and covariances (n, 8, 8).

    is_framed: whether to read the covariances in a data frame.
    """
    if not isinstance(solution, Solution):
        total = framed_covariance(solution) if is_framed else None
        states = as_floats(solution, "solution", 6)
        return states, None, None, CovarianceParts(total, None, None)
    covariances = solution.covariance, solution.noise_covariance, solution.calibration_covariance
    parts = (None if part is None else part.reshape(-1, 8, 8) for part in covariances)
    return solution.state, solution.used, solution.status, CovarianceParts(*parts)


def framed_covariance(values: Any) -> Floats | None:
    """The covariances (n, 6, 6) in the columns of a data frame, mm and rad; None without them."""
    entries = covariance_entries()
    if index_of(values) is None or not entries.keys() <= set(values.columns):
        return None
    packed = pack_covariances({name: values[name] for name in entries})["cov_pose"]
    covariance: Floats = packed * np.outer(STATE_UNITS[:6], STATE_UNITS[:6])
    return covariance


def as_row(values: ArrayLike | None, count: int, what: str, default: float) -> Floats:
    """Convert an argument with one number for each pose to (n,); `default` without argument."""
    if values is None:
        return np.full(count, default)
    row = as_floats(np.asarray(values, dtype=float), what).reshape(-1)
    if len(row) != count:
        raise InputError(f"{what} has {len(row)} values; needed: {count}, one for each pose")
    return row
