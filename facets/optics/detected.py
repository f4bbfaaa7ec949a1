"""Readings of any sensor: in one step where nothing is cut, else detector by detector.

`workspace`, (3, limits.MOST, limits.COLUMNS), is memory for the sides of the three outlines.
"""

from __future__ import annotations

from typing import Any

from . import bench_light
from .cut import is_always_cut, linearise_cut, passing_light
from .forward import Geometry, Scene, Three, dark_scene, illuminate, replace_light, scene_readings
from .forward import scene as uncut_scene
from .gradient import edge_turns, linearise_detector
from .region import Array
from .vectors import Matrix, rotation_axes


def cut_scene(
    geometry: Geometry, state: tuple[Any, ...], workspace: Array
) -> tuple[Scene, tuple[int, int, int]]:
    """The scene of a sensor at a state with cut light, and the number of sides that cut each
    sub-beam."""
    at = dark_scene(geometry, state)
    if not is_always_cut(geometry):
        at = illuminate(at)
    a, on_a = passing_light(geometry, at, 0, workspace[0])
    b, on_b = passing_light(geometry, at, 1, workspace[1])
    c, on_c = passing_light(geometry, at, 2, workspace[2])
    return replace_light(at, at.integrals, (on_a, on_b, on_c)), (a, b, c)


def scene(geometry: Geometry, state: tuple[Any, ...], workspace: Array) -> Scene:
    """The scene of a sensor at a state, with the light that reaches the detectors."""
    if geometry.openings.cut:
        return cut_scene(geometry, state, workspace)[0]
    return uncut_scene(geometry, state)


def readings(
    geometry: Geometry, state: tuple[Any, ...], workspace: Array
) -> tuple[Three, Three, Three]:
    """Eq. (1): (psi, zeta, power) of detectors A, B and C at a state of Eq. (3)."""
    if geometry.light.options.on:
        return bench_light.readings(geometry, state)
    return scene_readings(geometry, scene(geometry, state, workspace))


def linearise_where_cut(
    geometry: Geometry, state: tuple[Any, ...], workspace: Array
) -> tuple[tuple[Three, Three], tuple[Three, Three], tuple[Three, Three]]:
    """Readings and Jacobian at a state, for detectors A, B and C, as `gradient.linearise`."""
    at, counts = cut_scene(geometry, state, workspace)
    turns, axes = edge_turns(geometry, at), rotation_axes(state[4], state[5])
    return (
        linearise_detector_where_cut(geometry, at, 0, workspace, counts, turns, axes),
        linearise_detector_where_cut(geometry, at, 1, workspace, counts, turns, axes),
        linearise_detector_where_cut(geometry, at, 2, workspace, counts, turns, axes),
    )


def linearise_detector_where_cut(
    geometry: Geometry,
    at: Scene,
    k: int,
    workspace: Array,
    counts: tuple[int, int, int],
    turns: Three,
    axes: Matrix,
) -> tuple[Three, Three]:
    if counts[k] > 0:
        return linearise_cut(geometry, at, k, workspace[k], counts[k], axes)
    return linearise_detector(geometry, at, k, turns, axes)
