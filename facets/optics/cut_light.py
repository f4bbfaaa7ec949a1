"""Readings of cut light on coated facets and on detectors with background light.

All rays of collimated light meet a flat facet at one angle, so that a coating reduces the power of
a spot and does not move it; background light is added at the detector. The other effects of
`edge_light` happen at edges, which apertures move or hide, and cannot be combined with them.
"""

from __future__ import annotations

from typing import Any

from ..scalars.dispatch import STEP
from .bench_gradient import add_background_to_rows
from .bench_light import add_background, reflectance
from .detected import cut_scene, linearise_where_cut
from .forward import Geometry, Scene, Three, scene_readings
from .region import Array
from .vectors import Vector, cross, rotation_axes


def readings(
    geometry: Geometry, state: tuple[Any, ...], workspace: Array
) -> tuple[Three, Three, Three]:
    """Eq. (1): (psi, zeta, power) of detectors A, B and C. workspace: as in `detected`."""
    at = cut_scene(geometry, state, workspace)[0]
    a, b, c = scene_readings(geometry, at)
    return (
        read_spot(geometry, at, 0, a),
        read_spot(geometry, at, 1, b),
        read_spot(geometry, at, 2, c),
    )


def read_spot(geometry: Geometry, at: Scene, k: int, values: Three) -> Three:
    """The reading of detector k from the spot's (psi, zeta, power), with coating and background
    light."""
    power = values[2] * reflectance(geometry, at.normals[k], geometry.direction)
    return add_background((values[0], values[1]), power, geometry.light.background[k])


def linearise(
    geometry: Geometry, state: tuple[Any, ...], workspace: Array
) -> tuple[tuple[Three, Three], tuple[Three, Three], tuple[Three, Three]]:
    """Readings and Jacobian at a state, as `gradient.linearise`."""
    at = cut_scene(geometry, state, workspace)[0]
    a, b, c = linearise_where_cut(geometry, state, workspace)
    axes = rotation_axes(state[4], state[5])
    return (
        linearise_detector(geometry, at, 0, axes, a[0], a[1]),
        linearise_detector(geometry, at, 1, axes, b[0], b[1]),
        linearise_detector(geometry, at, 2, axes, c[0], c[1]),
    )


def linearise_detector(
    geometry: Geometry, at: Scene, k: int, axes: Three, values: Three, rows: Three
) -> tuple[Three, Three]:
    """Readings and Jacobian of one detector. values, rows: those of its spot alone."""
    share = reflectance(geometry, at.normals[k], geometry.direction)
    roll, pitch, yaw = axes
    turns = (
        reflectance_slope(geometry, at.normals[k], roll),
        reflectance_slope(geometry, at.normals[k], pitch),
        reflectance_slope(geometry, at.normals[k], yaw),
    )
    of_psi, of_zeta, of_power = rows
    bare = values[2]
    power = (
        share * of_power[0],
        share * of_power[1],
        share * of_power[2],
        share * of_power[3] + bare * turns[0],
        share * of_power[4] + bare * turns[1],
        share * of_power[5] + bare * turns[2],
        share * of_power[6],
        share * of_power[7],
    )
    whole = read_spot(geometry, at, k, values)
    return whole, add_background_to_rows(
        whole, geometry.light.background[k], of_psi, of_zeta, power
    )


def reflectance_slope(geometry: Geometry, normal: Vector, axis: Vector) -> float:
    """The derivative of a facet's reflectance by its rotation about an axis, per radian."""
    x, y, z = cross(axis, normal)
    carries = (
        complex(normal[0], STEP * x),
        complex(normal[1], STEP * y),
        complex(normal[2], STEP * z),
    )
    beam = geometry.direction
    direction = complex(beam[0], 0), complex(beam[1], 0), complex(beam[2], 0)
    slope: float = reflectance(geometry, carries, direction).imag / STEP
    return slope
