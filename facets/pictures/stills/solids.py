"""Closed surfaces of machined parts: turned, milled from a plate, and with a window.

A shape is made in a frame of its own and moved to its place by `Solid.move`. Lengths mm.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ...core.units import Floats

#: Number of points around a turned part.
ROUND = 48


class Solid(NamedTuple):
    """Points (n, 3) and faces as lists of their numbers, counter-clockwise seen from outside."""

    points: Floats
    faces: list[list[int]]

    def move(self, origin: Any, axes: Any) -> Solid:
        """Move from a frame whose axes are the rows of `axes` and whose origin is `origin`."""
        return Solid(np.asarray(origin, float) + self.points @ np.asarray(axes, float), self.faces)


def join(solids: Sequence[Solid]) -> Solid:
    starts = np.cumsum([0, *(len(solid.points) for solid in solids)])
    faces = [
        [int(start) + n for n in face]
        for start, solid in zip(starts, solids, strict=False)
        for face in solid.faces
    ]
    return Solid(np.concatenate([solid.points for solid in solids]), faces)


def stack(rings: Sequence[Floats], closed: bool = True) -> Solid:
    """Join rings of equally many points (m, 3), counter-clockwise from above and from the lowest to
    the highest, by bands; with a floor and, if closed, a lid."""
    count = len(rings[0])
    faces = [list(range(count))[::-1]]
    for level in range(len(rings) - 1):
        low, high = level * count, (level + 1) * count
        faces += [
            [low + n, low + (n + 1) % count, high + (n + 1) % count, high + n] for n in range(count)
        ]
    if closed:
        faces.append([(len(rings) - 1) * count + n for n in range(count)])
    return Solid(np.concatenate(rings), faces)


def ring_at_height(outline: Floats, z: float) -> Floats:
    return np.column_stack([outline, np.full(len(outline), z)])


def revolve(profile: Sequence[tuple[float, float]], count: int = ROUND) -> Solid:
    """Revolve a profile of (radius, z), ascending, about z."""
    angle = 2 * np.pi * np.arange(count) / count
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return stack([ring_at_height(max(radius, 1e-6) * circle, z) for radius, z in profile])


def tube(profile: Sequence[tuple[float, float]], count: int = ROUND) -> Solid:
    """Revolve a closed profile of (radius, z), counter-clockwise with z up, about z, with a
    bore."""
    angle = 2 * np.pi * np.arange(count) / count
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    points = np.concatenate([ring_at_height(radius * circle, z) for radius, z in profile])
    faces = []
    for level in range(len(profile)):
        low, high = level * count, (level + 1) % len(profile) * count
        faces += [
            [low + n, low + (n + 1) % count, high + (n + 1) % count, high + n] for n in range(count)
        ]
    return Solid(points, faces)


def hollow_cylinder(
    outer: float, inner: float, low: float, high: float, bevel: float = 0.0
) -> Solid:
    return tube(
        [(inner, low), (outer - bevel, low), (outer, low + bevel), (outer, high - bevel),
         (outer - bevel, high), (inner, high)]
    )  # fmt: skip


def cylinder(radius: float, low: float, high: float, bevel: float = 0.0) -> Solid:
    """Make a cylinder about z with edges bevelled by `bevel`."""
    if bevel == 0:
        return revolve([(radius, low), (radius, high)])
    return revolve(
        [
            (radius - bevel, low),
            (radius, low + bevel),
            (radius, high - bevel),
            (radius - bevel, high),
        ]
    )


def rectangle(width: float, height: float, corner: float = 0.0, count: int = 5) -> Floats:
    """The outline of a rectangle about the origin, its corners rounded; (n, 2)."""
    if corner <= 0:
        plain: Floats = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * [width / 2, height / 2]
        return plain
    turn = np.linspace(0, np.pi / 2, count)
    quarter = corner * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    parts = []
    for n, (x, y) in enumerate([(1, 1), (-1, 1), (-1, -1), (1, -1)]):
        c, s = np.cos(n * np.pi / 2), np.sin(n * np.pi / 2)
        middle = np.array([x * (width / 2 - corner), y * (height / 2 - corner)])
        parts.append(middle + quarter @ np.array([[c, s], [-s, c]]))
    return np.concatenate(parts)


def slab(outline: Floats, low: float, high: float, bevel: float = 0.0) -> Solid:
    """Make a plate with the convex outline (n, 2) from z = low to high, with bevelled edges."""
    if bevel == 0:
        return stack([ring_at_height(outline, low), ring_at_height(outline, high)])
    size = np.abs(outline).max(axis=0)
    inner = outline * (1 - bevel / size)
    return stack(
        [
            ring_at_height(inner, low),
            ring_at_height(outline, low + bevel),
            ring_at_height(outline, high - bevel),
            ring_at_height(inner, high),
        ]
    )


def frame(outer: Floats, inner: Floats, low: float, high: float) -> Solid:
    """Make a plate with a window: outlines of equally many points (n, 2)."""
    count = len(outer)
    rings = [ring_at_height(outer, low), ring_at_height(outer, high), ring_at_height(inner, high),
             ring_at_height(inner, low)]  # fmt: skip
    faces = []
    for level in range(4):
        first, second = level * count, (level + 1) % 4 * count
        faces += [
            [first + n, first + (n + 1) % count, second + (n + 1) % count, second + n]
            for n in range(count)
        ]
    return Solid(np.concatenate(rings), faces)


def rod(start: Any, end: Any, radius: float, count: int = 24) -> Solid:
    start, end = np.asarray(start, float), np.asarray(end, float)
    length = float(np.linalg.norm(end - start))
    along = (end - start) / length
    aside = np.cross(along, (1.0, 0, 0) if abs(along[0]) < 0.7 else (0, 1.0, 0))
    aside /= np.linalg.norm(aside)
    axes = [aside, np.cross(along, aside), along]
    return revolve([(radius, 0), (radius, length)], count).move(start, axes)
