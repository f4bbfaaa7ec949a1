"""Closed surfaces of machined parts: turned, milled from a plate, and with a window; lengths mm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ...core.units import Floats
from .materials import MATERIALS, Material

#: Number of points around a turned part.
ROUND = 48


class Solid(NamedTuple):
    """Points (n, 3) and faces as lists of their numbers, counter-clockwise seen from outside."""

    points: Floats
    faces: list[list[int]]

    def move(self, *place: float) -> Solid:
        return Solid(self.points + np.array(place), self.faces)


@dataclass(frozen=True)
class RigPart:
    """A piece of the rig. assembly: "head", "laser", "detector a", ..., "frame"."""

    name: str
    assembly: str
    material: Material
    solid: Solid


@dataclass(frozen=True)
class PartFrame:
    """A frame in which parts of an assembly are made, with the unit of their lengths, mm.

    The rows of `axes` are its axes in the world.
    """

    assembly: str
    unit: float
    origin: Any = (0.0, 0.0, 0.0)
    axes: Any = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))

    def part(self, name: str, material: str, *solids: Solid) -> RigPart:
        points, faces = join(solids)
        places = np.asarray(self.origin) + self.unit * points @ np.asarray(self.axes)
        return RigPart(name, self.assembly, MATERIALS[material], Solid(places, faces))


def join(solids: Sequence[Solid]) -> Solid:
    starts = np.cumsum([0, *(len(solid.points) for solid in solids)])
    faces = [
        [int(start) + n for n in face]
        for start, solid in zip(starts, solids, strict=False)
        for face in solid.faces
    ]
    return Solid(np.concatenate([solid.points for solid in solids]), faces)


def bands(rings: Sequence[Floats], loop: bool = False) -> Solid:
    """Join rings of equally many points (m, 3) by bands; `loop`: also the last to the first."""
    count, levels = len(rings[0]), len(rings)
    faces = [
        [low + n, low + (n + 1) % count, high + (n + 1) % count, high + n]
        for level in range(levels if loop else levels - 1)
        for low, high in [(level * count, (level + 1) % levels * count)]
        for n in range(count)
    ]
    return Solid(np.concatenate(rings), faces)


def stack(rings: Sequence[Floats], closed: bool = True) -> Solid:
    """Join rings, counter-clockwise from above and from the lowest to the highest, with a floor
    and, if closed, a lid."""
    points, sides = bands(rings)
    count = len(rings[0])
    lid = [list(range(len(points) - count, len(points)))] if closed else []
    return Solid(points, [list(range(count))[::-1], *sides, *lid])


def ring_at_height(outline: Floats, z: float) -> Floats:
    return np.column_stack([outline, np.full(len(outline), z)])


def revolve(profile: Sequence[tuple[float, float]], bore: bool = False) -> Solid:
    """Revolve a profile of (radius, z), ascending, about z; with a bore, one that is closed and
    counter-clockwise with z up."""
    angle = 2 * np.pi * np.arange(ROUND) / ROUND
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    rings = [ring_at_height(max(radius, 1e-6) * circle, z) for radius, z in profile]
    return bands(rings, loop=True) if bore else stack(rings)


def profile_of(radius: float, low: float, high: float, bevel: float) -> list[tuple[float, float]]:
    """The profile (radius, z) of a cylinder with bevelled edges."""
    if bevel == 0:
        return [(radius, low), (radius, high)]
    small = radius - bevel
    return [(small, low), (radius, low + bevel), (radius, high - bevel), (small, high)]


def cylinder(radius: float, low: float, high: float, bevel: float = 0.0) -> Solid:
    return revolve(profile_of(radius, low, high, bevel))


def hollow_cylinder(outer: float, inner: float, low: float, high: float, bevel: float) -> Solid:
    return revolve([(inner, low), *profile_of(outer, low, high, bevel), (inner, high)], bore=True)


def rectangle(width: float, height: float, corner: float = 0.0) -> Floats:
    """The outline of a rectangle about the origin, its corners rounded; (n, 2)."""
    turn = np.linspace(0, np.pi / 2, 5 if corner else 1)
    quarters = [turn + n * np.pi / 2 for n in range(4)]
    middles = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) * (
        np.array([width, height]) / 2 - corner
    )
    arcs = [
        middle + corner * np.stack([np.cos(quarter), np.sin(quarter)], axis=-1)
        for middle, quarter in zip(middles, quarters, strict=True)
    ]
    return np.concatenate(arcs)


def slab(outline: Floats, low: float, high: float, bevel: float = 0.0) -> Solid:
    """Make a plate with the convex outline (n, 2) from z = low to high, with bevelled edges."""
    if bevel == 0:
        return stack([ring_at_height(outline, low), ring_at_height(outline, high)])
    inner = outline * (1 - bevel / np.abs(outline).max(axis=0))
    return stack(
        [
            ring_at_height(inner, low),
            ring_at_height(outline, low + bevel),
            ring_at_height(outline, high - bevel),
            ring_at_height(inner, high),
        ]
    )


def window_frame(outer: Floats, inner: Floats, low: float, high: float) -> Solid:
    """Make a plate with a window: outlines of equally many points (n, 2)."""
    corners = ((outer, low), (outer, high), (inner, high), (inner, low))
    return bands([ring_at_height(outline, z) for outline, z in corners], loop=True)
