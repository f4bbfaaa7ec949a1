"""What the detectors read of any sensor: plain where nothing is cut, else detector by detector.

`workspace`, (3, limits.MOST, limits.COLUMNS), is memory for the sides of the three outlines.
"""

from __future__ import annotations

from typing import Any

from . import bench_light
from .cut import always_cut, linearised_cut, outline
from .forward import Geometry, Scene, Three, placed, readings_of, shone_on, with_light
from .forward import scene as uncut_scene
from .gradient import linearised_detector, turns_of_edges
from .region import Array
from .vectors import Matrix, rotation_axes


def cut_scene(
    geometry: Geometry, state: tuple[Any, ...], workspace: Array
) -> tuple[Scene, tuple[int, int, int]]:
    """A sensor at a state with the light as cut, and how many sides cut each sub-beam."""
    at = placed(geometry, state)
    if not always_cut(geometry):
        at = shone_on(at)
    a, on_a = outline(geometry, at, 0, workspace[0])
    b, on_b = outline(geometry, at, 1, workspace[1])
    c, on_c = outline(geometry, at, 2, workspace[2])
    return with_light(at, at.integrals, (on_a, on_b, on_c)), (a, b, c)


def scene(geometry: Geometry, state: tuple[Any, ...], workspace: Array) -> Scene:
    """A sensor at a state, with the light that reaches the detectors."""
    if geometry.openings.cut:
        return cut_scene(geometry, state, workspace)[0]
    return uncut_scene(geometry, state)


def readings(
    geometry: Geometry, state: tuple[Any, ...], workspace: Array
) -> tuple[Three, Three, Three]:
    """Eq. (1): (psi, zeta, power) of detectors A, B and C at a state of Eq. (3)."""
    if geometry.light.options.on:
        return bench_light.readings(geometry, state)
    return readings_of(geometry, scene(geometry, state, workspace))


def linearised_where_cut(
    geometry: Geometry, state: tuple[Any, ...], workspace: Array
) -> tuple[tuple[Three, Three], tuple[Three, Three], tuple[Three, Three]]:
    """Readings and Jacobian at a state, for detectors A, B and C, as `gradient.linearised`."""
    at, counts = cut_scene(geometry, state, workspace)
    turns, axes = turns_of_edges(geometry, at), rotation_axes(state[4], state[5])
    return (
        linearised_one(geometry, at, 0, workspace, counts, turns, axes),
        linearised_one(geometry, at, 1, workspace, counts, turns, axes),
        linearised_one(geometry, at, 2, workspace, counts, turns, axes),
    )


def linearised_one(
    geometry: Geometry,
    at: Scene,
    k: int,
    workspace: Array,
    counts: tuple[int, int, int],
    turns: Three,
    axes: Matrix,
) -> tuple[Three, Three]:
    if counts[k] > 0:
        return linearised_cut(geometry, at, k, workspace[k], counts[k], axes)
    return linearised_detector(geometry, at, k, turns, axes)
