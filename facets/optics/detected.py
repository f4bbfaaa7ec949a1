"""What the detectors read of any sensor: plain where nothing is cut, else detector by detector.

`room`, (3, limits.MOST, limits.COLUMNS), is memory for the sides of the three outlines.
"""

from __future__ import annotations

from typing import Any

from . import bench_light
from .cut import always_cut, linearised_cut, outline
from .forward import Geometry, Scene, Three, placed, readings_of, shone_on, with_light
from .forward import scene as uncut_scene
from .gradient import linearised as linearised_uncut
from .gradient import linearised_detector, turns_of_edges
from .region import Array
from .vectors import Matrix, rotation_axes


def cut_scene(
    sensor: Geometry, state: tuple[Any, ...], room: Array
) -> tuple[Scene, tuple[int, int, int]]:
    """A sensor at a state with the light as cut, and how many sides cut each sub-beam."""
    at = placed(sensor, state)
    if not always_cut(sensor):
        at = shone_on(at)
    a, on_a = outline(sensor, at, 0, room[0])
    b, on_b = outline(sensor, at, 1, room[1])
    c, on_c = outline(sensor, at, 2, room[2])
    return with_light(at, at.integrals, (on_a, on_b, on_c)), (a, b, c)


def scene(sensor: Geometry, state: tuple[Any, ...], room: Array) -> Scene:
    """A sensor at a state, with the light that reaches the detectors."""
    if sensor.openings.cut:
        return cut_scene(sensor, state, room)[0]
    return uncut_scene(sensor, state)


def readings(sensor: Geometry, state: tuple[Any, ...], room: Array) -> tuple[Three, Three, Three]:
    """Eq. (1): (psi, zeta, power) of detectors A, B and C at a state of Eq. (3)."""
    if sensor.light.options.on:
        return bench_light.readings(sensor, state)
    return readings_of(sensor, scene(sensor, state, room))


def linearised(
    sensor: Geometry, state: tuple[Any, ...], room: Array
) -> tuple[tuple[Three, Three], tuple[Three, Three], tuple[Three, Three]]:
    """Readings and Jacobian at a state, for detectors A, B and C.

    Each is ((psi, zeta, power), (eight derivatives of each)); mm, mW, rad. NaN as in `reading`.
    """
    if sensor.light.options.on:
        return bench_light.linearised(sensor, state)
    if not sensor.openings.cut:
        return linearised_uncut(sensor, state)
    return linearised_where_cut(sensor, state, room)


def linearised_where_cut(
    sensor: Geometry, state: tuple[Any, ...], room: Array
) -> tuple[tuple[Three, Three], tuple[Three, Three], tuple[Three, Three]]:
    """`linearised` of a sensor whose light is cut."""
    at, counts = cut_scene(sensor, state, room)
    turns, axes = turns_of_edges(sensor, at), rotation_axes(state[4], state[5])
    return (
        linearised_one(sensor, at, 0, room, counts, turns, axes),
        linearised_one(sensor, at, 1, room, counts, turns, axes),
        linearised_one(sensor, at, 2, room, counts, turns, axes),
    )


def linearised_one(
    sensor: Geometry,
    at: Scene,
    k: int,
    room: Array,
    counts: tuple[int, int, int],
    turns: Three,
    axes: Matrix,
) -> tuple[Three, Three]:
    if counts[k] > 0:
        return linearised_cut(sensor, at, k, room[k], counts[k], axes)
    return linearised_detector(sensor, at, k, turns, axes)
