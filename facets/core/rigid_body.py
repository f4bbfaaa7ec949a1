"""Rigid-body motions: rotations as roll, pitch and yaw, the pose of an object on the mirror, and
their derivatives.

A rotation is R = Rz(yaw) Ry(pitch) Rx(roll). With the mirror at the pose (t, R), a point p fixed to
it has the position t + R p, and axes with the orientation Q have the orientation R Q. Components
of arrays are last: poses (..., 6) are tx, ty, tz, roll, pitch, yaw in mm and rad.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite, pi

import numpy as np

from .arguments import check_arguments
from .axis_keys import MAX_LENGTH_MM
from .errors import InputError
from .keys import FieldSource, Key, Values, declare, key
from .units import Floats

Three = tuple[float, float, float]
#: Largest pitch of an object's axes on the mirror, since roll and yaw are not unique at 90 degrees.
MAX_PITCH_DEG = 80.0
#: Roll and yaw are NaN if the cosine of an object's pitch is below this.
LEAST_COSINE = 0.01
_ANGLES = tuple(
    Key(f"{name}_deg", 0.0, meaning, "deg", float, {"ge": -largest, "le": largest})
    for name, largest, meaning in (
        ("roll", 180.0, "rotation of the object's axes about the mirror's x"),
        ("pitch", MAX_PITCH_DEG, "rotation about the mirror's y, after the roll; to go beyond the "
         "limit, name the object's axes in another order"),
        ("yaw", 180.0, "rotation about the mirror's z, last"),
    )
)  # fmt: skip


def _read_angles(values: Values) -> tuple[float, ...]:
    return tuple(key.read(values[key.name]) for key in _ANGLES)


@check_arguments
@dataclass(frozen=True)
class MeasuredObject:
    """The point of interest of the measured object and the object's axes, fixed to the mirror.

    Attributes
    ----------
    point
        x, y and z of the point relative to the apex, in the mirror's frame, mm.
    orientation
        Roll, pitch and yaw of the object's axes in the mirror's frame, rad; the pitch between -80
        and 80 degrees.

    Examples
    --------
    >>> import facets
    >>> facets.MeasuredObject(point=(0, 0, 50)).orientation
    (0.0, 0.0, 0.0)
    """

    point: Three = key(
        "point_mm",
        (0.0, 0.0, 0.0),
        "point whose pose is computed: x, y and z relative to the apex, in the mirror's frame",
        ge=-MAX_LENGTH_MM,
        le=MAX_LENGTH_MM,
    )
    orientation: Three = declare(FieldSource(_ANGLES, _read_angles))

    def __post_init__(self) -> None:
        limits = (MAX_LENGTH_MM,) * 3, (pi, np.radians(MAX_PITCH_DEG), pi)
        for name, most in zip(("point", "orientation"), limits, strict=True):
            values = getattr(self, name)
            for value, limit in zip(values, most, strict=True):
                if not (isfinite(value) and abs(value) <= limit * (1 + 1e-12)):
                    raise InputError(
                        f"{name} of the object is {tuple(values)}; allowed: numbers up to "
                        f"{', '.join(f'{bound:.4g}' for bound in most)} (mm, rad) in magnitude"
                    )

    @property
    def text(self) -> str:
        """The point and the orientation in words, for the provenance of files."""
        place = ", ".join(f"{value:.10g}" for value in self.point)
        angles = ", ".join(f"{np.degrees(value):.10g}" for value in self.orientation)
        return (
            f"point {place} mm, orientation {angles} deg (roll, pitch, yaw) in the mirror's frame"
        )


#: The mirror itself: its apex and its own axes.
MIRROR = MeasuredObject()


def rotation_matrix(angles: Floats) -> Floats:
    """Rotation matrices (..., 3, 3) of roll, pitch and yaw (..., 3)."""
    (cr, cp, cy), (sr, sp, sy) = (np.moveaxis(f(angles), -1, 0) for f in (np.cos, np.sin))
    rows = (
        (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
        (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
        (-sp, cp * sr, cp * cr),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def rotation_angles(matrix: Floats, near: Three = MIRROR.orientation) -> Floats:
    """Roll, pitch and yaw (..., 3) of rotation matrices (..., 3, 3), rad.

    near: angles within half a turn of which roll and yaw are returned, rad. Both are NaN within
    0.6 degrees of a pitch of 90 or -90 degrees.
    """
    cosine = np.hypot(matrix[..., 0, 0], matrix[..., 1, 0])
    pitch = np.arctan2(-matrix[..., 2, 0], cosine)
    pole = np.where(cosine < LEAST_COSINE, np.nan, 0.0)
    roll = np.arctan2(matrix[..., 2, 1], matrix[..., 2, 2]) + pole
    yaw = np.arctan2(matrix[..., 1, 0], matrix[..., 0, 0]) + pole
    turns = (2 * pi * np.round((angle - about) / (2 * pi)) for angle, about in
             ((roll, near[0]), (yaw, near[2])))  # fmt: skip
    return np.stack([roll - next(turns), pitch, yaw - next(turns)], axis=-1)


def angle_axes(angles: Floats) -> Floats:
    """Axes in the world, as columns (..., 3, 3), about which small changes of roll, pitch and yaw
    rotate a frame.  angles: (..., 3) rad."""
    (_, cp, cy), (_, sp, sy) = (np.moveaxis(f(angles), -1, 0) for f in (np.cos, np.sin))
    zero = np.zeros_like(cp)
    columns = ((cy * cp, sy * cp, -sp), (-sy, cy, zero), (zero, zero, zero + 1))
    return np.stack([np.stack(column, axis=-1) for column in columns], axis=-1)


def angle_rates(angles: Floats) -> Floats:
    """Derivatives (..., 3, 3) of roll, pitch and yaw by a small rotation in the world, the inverse
    of `angle_axes`.  angles: (..., 3) rad."""
    (_, cp, cy), (_, sp, sy) = (np.moveaxis(f(angles), -1, 0) for f in (np.cos, np.sin))
    zero = np.zeros_like(cp)
    rows = ((cy / cp, sy / cp, zero), (-sy, cy, zero), (cy * sp / cp, sy * sp / cp, zero + 1))
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def cross_matrix(vectors: Floats) -> Floats:
    """Matrices (..., 3, 3) whose product with a vector b is the cross product of `vectors` (..., 3)
    with b."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    zero = np.zeros_like(x)
    rows = ((zero, -z, y), (z, zero, -x), (-y, x, zero))
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def _apply(matrix: Floats, vectors: Floats) -> Floats:
    """Products (..., 3) of matrices (..., 3, 3) with vectors (..., 3)."""
    product: Floats = (matrix @ vectors[..., None])[..., 0]
    return product


def _join(translation: Floats, angles: Floats, blocks: tuple[tuple[Floats, Floats], ...]) -> Floats:
    """Assemble derivatives (..., 6, 6) of a pose by the mirror's pose.

    translation, angles: (..., 3) of the pose.  blocks: derivatives (..., 3, 3) of the position by
    translation and angles, and of the rotation, as a small rotation in the world.
    """
    (by_place, by_turn), (_, turn) = blocks
    out = np.zeros((*np.broadcast_shapes(translation.shape, angles.shape)[:-1], 6, 6))
    out[..., :3, :3], out[..., :3, 3:] = by_place, by_turn
    out[..., 3:, 3:] = angle_rates(angles) @ turn
    return out


def object_poses(poses: Floats, body: MeasuredObject) -> tuple[Floats, Floats]:
    """Absolute poses (..., 6) of an object at mirror poses (..., 6), and their derivatives
    (..., 6, 6) by the mirror's pose.

    Roll and yaw lie within half a turn of the angles in the object's orientation.
    """
    turn, axes = rotation_matrix(poses[..., 3:]), angle_axes(poses[..., 3:])
    arm = _apply(turn, np.array(body.point, dtype=float))
    angles = rotation_angles(
        turn @ rotation_matrix(np.array(body.orientation, dtype=float)), body.orientation
    )
    place = poses[..., :3] + arm
    eye = np.eye(3)
    slopes = _join(place, angles, ((eye, -cross_matrix(arm) @ axes), (eye, axes)))
    return np.concatenate([place, angles], axis=-1), slopes


def object_displacements(
    poses: Floats, zero: Floats, body: MeasuredObject
) -> tuple[Floats, Floats, Floats]:
    """Displacements (..., 6) of an object from its pose at the mirror pose `zero`, in the object's
    axes there, and their derivatives (..., 6, 6) by the mirror's pose and by `zero`.

    poses, zero: mirror poses (..., 6), broadcast. The displacement is the rigid-body motion
    D = X0^-1 X from the object's pose X0 to X.
    """
    point, orientation = (
        np.array(body.point, dtype=float),
        rotation_matrix(np.array(body.orientation)),
    )
    turn, axes = rotation_matrix(poses[..., 3:]), angle_axes(poses[..., 3:])
    turn_zero, axes_zero = rotation_matrix(zero[..., 3:]), angle_axes(zero[..., 3:])
    arm, arm_zero = _apply(turn, point), _apply(turn_zero, point)
    back = np.swapaxes(turn_zero @ orientation, -1, -2)
    shift = (poses[..., :3] - zero[..., :3]) + (arm - arm_zero)
    place, angles = _apply(back, shift), rotation_angles(back @ turn @ orientation)
    by_turn = -back @ cross_matrix(arm) @ axes
    by_turn_zero = back @ cross_matrix(arm_zero + shift) @ axes_zero
    slopes = _join(place, angles, ((back, by_turn), (back, back @ axes)))
    slopes_zero = _join(place, angles, ((-back, by_turn_zero), (back, -back @ axes_zero)))
    return np.concatenate([place, angles], axis=-1), slopes, slopes_zero


def displacement_slopes(poses: Floats, body: MeasuredObject) -> Floats:
    """Derivatives (..., 6, 6) of an object's displacement from its pose at the mirror's zero, by
    the mirror's pose (..., 6); see `object_displacements`."""
    return object_displacements(poses, np.zeros(6), body)[1]


def mirror_poses(displacements: Floats, body: MeasuredObject) -> Floats:
    """Mirror poses (..., 6) at which an object has displacements (..., 6) from its pose at the
    mirror's zero: the inverse of `object_displacements` there."""
    orientation = rotation_matrix(np.array(body.orientation))
    point = np.array(body.point, dtype=float)
    turn = orientation @ rotation_matrix(displacements[..., 3:]) @ orientation.T
    place = point + _apply(orientation, displacements[..., :3]) - _apply(turn, point)
    return np.concatenate([place, rotation_angles(turn)], axis=-1)
