"""Readings of light that is cut, falls on a coating and on detectors that see other light.

Collimated light falls on all of a flat facet under one angle, so that a coating takes a share of a
spot's power, whatever is cut, and leaves its place; other light is added at the detector. What else
`edge_light` knows happens at edges, which apertures move or hide, and does not go with them.
"""

from __future__ import annotations

from typing import Any

from ..scalars.dispatch import STEP
from .bench_gradient import drawn
from .bench_light import reflectance, with_background
from .detected import cut_scene, linearised_where_cut
from .forward import Geometry, Scene, Three, readings_of
from .region import Array
from .vectors import Vector, cross, rotation_axes


def readings(
    geometry: Geometry, state: tuple[Any, ...], workspace: Array
) -> tuple[Three, Three, Three]:
    """Eq. (1): (psi, zeta, power) of detectors A, B and C. workspace: as in `detected`."""
    at = cut_scene(geometry, state, workspace)[0]
    a, b, c = readings_of(geometry, at)
    return lit(geometry, at, 0, a), lit(geometry, at, 1, b), lit(geometry, at, 2, c)


def lit(geometry: Geometry, at: Scene, k: int, values: Three) -> Three:
    """What detector k reads of a spot of (psi, zeta, power) before coating and other light."""
    power = values[2] * reflectance(geometry, at.normals[k], geometry.direction)
    return with_background((values[0], values[1]), power, geometry.light.background[k])


def linearised(
    geometry: Geometry, state: tuple[Any, ...], workspace: Array
) -> tuple[tuple[Three, Three], tuple[Three, Three], tuple[Three, Three]]:
    """Readings and Jacobian at a state, as `gradient.linearised`."""
    at = cut_scene(geometry, state, workspace)[0]
    a, b, c = linearised_where_cut(geometry, state, workspace)
    axes = rotation_axes(state[4], state[5])
    return (
        linearised_one(geometry, at, 0, axes, a[0], a[1]),
        linearised_one(geometry, at, 1, axes, b[0], b[1]),
        linearised_one(geometry, at, 2, axes, c[0], c[1]),
    )


def linearised_one(
    geometry: Geometry, at: Scene, k: int, axes: Three, values: Three, rows: Three
) -> tuple[Three, Three]:
    """The same of one detector, whose bare spot has `values` and, by the state, `rows`."""
    share = reflectance(geometry, at.normals[k], geometry.direction)
    roll, pitch, yaw = axes
    turns = (
        of_turn(geometry, at.normals[k], roll),
        of_turn(geometry, at.normals[k], pitch),
        of_turn(geometry, at.normals[k], yaw),
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
    whole = lit(geometry, at, k, values)
    return whole, drawn(whole, geometry.light.background[k], of_psi, of_zeta, power)


def of_turn(geometry: Geometry, normal: Vector, axis: Vector) -> float:
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
