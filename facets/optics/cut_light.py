"""Readings of light that is cut, falls on a coating and on detectors that see other light.

Collimated light falls on all of a flat facet under one angle, so that a coating takes a share of a
spot's power, whatever is cut, and leaves its place; other light is added at the detector. What else
`edge_light` knows happens at edges, which apertures move or hide, and does not go with them.
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
    """What detector k reads of a spot of (psi, zeta, power) before coating and other light."""
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
    """The same of one detector, whose bare spot has `values` and, by the state, `rows`."""
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
    """How much more a facet reflects, per radian that it turns about an axis."""
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
