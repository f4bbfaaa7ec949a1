"""Three-vectors as tuples of scalars, of any number type.

Lengths are in mm and angles in rad, unless a caller's docstring says otherwise.
"""

from __future__ import annotations

from typing import Any

from ..scalars.dispatch import Number, atan2, cos, sin, sqrt, turn_together

Vector = tuple[Any, Any, Any]
Plane = tuple[Any, Any]
Matrix = tuple[Vector, Vector, Vector]


def dot(a: Vector, b: Vector) -> Number:
    """The scalar product of two vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vector, b: Vector) -> Vector:
    """The vector product a x b."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


def add(a: Vector, b: Vector) -> Vector:
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def subtract(a: Vector, b: Vector) -> Vector:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def scale(k: Number, a: Vector) -> Vector:
    return (k * a[0], k * a[1], k * a[2])


def combine(k: Number, a: Vector, m: Number, b: Vector) -> Vector:
    """k a + m b."""
    return (k * a[0] + m * b[0], k * a[1] + m * b[1], k * a[2] + m * b[2])


def rotate(matrix: Matrix, a: Vector) -> Vector:
    """matrix a, the matrix given by its rows."""
    return (dot(matrix[0], a), dot(matrix[1], a), dot(matrix[2], a))


def columns(matrix: Matrix) -> Matrix:
    """The three columns of a matrix given by its rows: the axes of a rotated frame."""
    x, y, z = matrix
    return ((x[0], y[0], z[0]), (x[1], y[1], z[1]), (x[2], y[2], z[2]))


def rotation(roll: Number, pitch: Number, yaw: Number) -> Matrix:
    """The rotation matrix Rz(yaw) Ry(pitch) Rx(roll) of angles in rad, by its rows."""
    turn_together(roll, pitch, yaw)
    cr, sr = cos(roll), sin(roll)
    cp, sp = cos(pitch), sin(pitch)
    cy, sy = cos(yaw), sin(yaw)
    return (
        (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
        (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
        (-sp, cp * sr, cp * cr),
    )


def rotation_axes(pitch: Number, yaw: Number) -> Matrix:
    """The world axes about which small changes of roll, pitch and yaw turn a frame."""
    cp, sp = cos(pitch), sin(pitch)
    cy, sy = cos(yaw), sin(yaw)
    zero = cp - cp
    return ((cy * cp, sy * cp, -sp), (-sy, cy, zero), (zero, zero, zero + 1))


def cross2(a: Plane, b: Plane) -> Number:
    """The cross product of two vectors of a plane, a scalar."""
    return a[0] * b[1] - a[1] * b[0]


def dot2(a: Plane, b: Plane) -> Number:
    """The scalar product of two vectors of a plane."""
    return a[0] * b[0] + a[1] * b[1]


def angle_between(a: Plane, b: Plane) -> Number:
    """The angle from a to b, counter-clockwise, between minus and plus half a turn."""
    return atan2(cross2(a, b), dot2(a, b))


def unit_vector(v: Plane) -> Plane:
    """A vector of the plane divided by its length."""
    norm = sqrt(v[0] * v[0] + v[1] * v[1])
    return v[0] / norm, v[1] / norm
