"""Closed surfaces of machined parts: turned, cut from a plate, with a window; lengths in mm."""

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
    """Points (n, 3), and faces as lists of point numbers, counter-clockwise from outside."""

    points: Floats
    faces: list[list[int]]

    def move(self, *place: float) -> Solid:
        return Solid(self.points + np.array(place), self.faces)


@dataclass(frozen=True)
class RigPart:
    """A part of the rig.

    assembly: group that moves or is shown together: "head", "laser", "detector a", "frame", ...
    """

    name: str
    assembly: str
    material: Material
    solid: Solid


@dataclass(frozen=True)
class PartFrame:
    """A frame in which parts of an assembly are made.

    unit: unit of their lengths, mm.  axes: the frame's axes in the world, by rows.
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
    """Join rings (m, 3) of equally many points by bands; with `loop`, in a closed loop."""
    count, levels = len(rings[0]), len(rings)
    faces = [
        [low + n, low + (n + 1) % count, high + (n + 1) % count, high + n]
        for level in range(levels if loop else levels - 1)
        for low, high in [(level * count, (level + 1) % levels * count)]
        for n in range(count)
    ]
    return Solid(np.concatenate(rings), faces)


def stack(rings: Sequence[Floats], closed: bool = True) -> Solid:
    """Join rings by bands and close them by a floor and, if `closed`, a lid.

    rings: (m, 3), counter-clockwise from above, the lowest first.
    """
    points, sides = bands(rings)
    count = len(rings[0])
    lid = [list(range(len(points) - count, len(points)))] if closed else []
    return Solid(points, [list(range(count))[::-1], *sides, *lid])


def ring_at_height(outline: Floats, z: float) -> Floats:
    return np.column_stack([outline, np.full(len(outline), z)])


def revolve(profile: Sequence[tuple[float, float]], bore: bool = False) -> Solid:
    """Revolve a profile about z.

    profile: (radius, z), ascending; with a bore it is closed and counter-clockwise with z up.
    """
    angle = 2 * np.pi * np.arange(ROUND) / ROUND
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    rings = [ring_at_height(max(radius, 1e-6) * circle, z) for radius, z in profile]
    return bands(rings, loop=True) if bore else stack(rings)


def profile_of(radius: float, low: float, high: float, bevel: float) -> list[tuple[float, float]]:
    """Return the profile (radius, z) of a cylinder with bevelled edges."""
    if bevel == 0:
        return [(radius, low), (radius, high)]
    small = radius - bevel
    return [(small, low), (radius, low + bevel), (radius, high - bevel), (small, high)]


def cylinder(radius: float, low: float, high: float, bevel: float = 0.0) -> Solid:
    return revolve(profile_of(radius, low, high, bevel))


def hollow_cylinder(outer: float, inner: float, low: float, high: float, bevel: float) -> Solid:
    return revolve([(inner, low), *profile_of(outer, low, high, bevel), (inner, high)], bore=True)


def rectangle(width: float, height: float, corner: float = 0.0) -> Floats:
    """Return the outline (n, 2) of a rectangle about the origin with rounded corners."""
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
    sizes = np.abs(outline).max(axis=0)
    return stack(
        [
            ring_at_height(outline * (1 + (inset - 1) / sizes), z)
            for inset, z in profile_of(1.0, low, high, bevel)
        ]
    )


def window_frame(outer: Floats, inner: Floats, low: float, high: float) -> Solid:
    """Make a plate with a window; both outlines (n, 2) have equally many points."""
    corners = ((outer, low), (outer, high), (inner, high), (inner, low))
    return bands([ring_at_height(outline, z) for outline, z in corners], loop=True)
