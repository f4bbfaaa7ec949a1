"""The range of the mirror's place as a solid about its point, with what ends it on every side."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..characterization.ranges import CAUSES, exits
from ..core.rules import Rules
from ..core.sensor import Sensor
from ..core.units import Floats, Integers

#: Rays from pole to pole and around.
LATITUDES, LONGITUDES = 30, 48
#: How far is looked, mm.
FAR = 30.0
#: A colour for each of `CAUSES`, and for a side on which nothing ends the range.
COLOURS = ("#E8B13A", "#C978B8", "#5FB7E5", "#C9CF5A", "#8C96A3")
#: Why a range ends, and where nothing ends it.
REASONS = (*CAUSES, "further than is looked")


@dataclass(frozen=True)
class RangeSolid:
    """points: (n, 3) of the boundary, mm.  faces: of four points.  causes: of each face, numbers of
    `REASONS`."""

    points: Floats
    faces: Integers
    causes: Integers

    @property
    def extent(self) -> Floats:
        """Lowest and highest x, y and z, (2, 3), mm."""
        return np.array([self.points.min(axis=0), self.points.max(axis=0)])


def range_solid(sensor: Sensor, rules: Rules) -> RangeSolid:
    """Where the mirror may go without turning, as seen from rest; mm."""
    axes = rays_along(np.concatenate([-np.eye(3), np.eye(3)]))
    reach = exits(sensor, rules, np.zeros(6), axes, 1e-4).distance * FAR
    size = np.maximum(reach[:3], reach[3:])
    polar = np.linspace(0, np.pi, LATITUDES + 1)
    around = 2 * np.pi * np.arange(LONGITUDES) / LONGITUDES
    ring = np.stack([np.cos(around), np.sin(around)], axis=-1)
    grid = np.concatenate(
        [np.column_stack([np.sin(t) * ring, np.full(LONGITUDES, np.cos(t))]) for t in polar]
    )
    rays = rays_along(grid * size)
    found = exits(sensor, rules, np.zeros(6), rays, 1e-5)
    points = found.distance[:, None] * rays[:, :3]
    faces = np.array(
        [
            [a * LONGITUDES + n, (a + 1) * LONGITUDES + n,
             (a + 1) * LONGITUDES + (n + 1) % LONGITUDES, a * LONGITUDES + (n + 1) % LONGITUDES]
            for a in range(LATITUDES)
            for n in range(LONGITUDES)
        ]
    )  # fmt: skip
    causes = np.where(found.cause < 0, len(CAUSES), found.cause)
    votes = np.array([(causes[faces] == n).sum(axis=1) for n in range(len(REASONS))])
    return RangeSolid(points, faces, votes.argmax(axis=0))


def rays_along(ways: Floats) -> Floats:
    """Rays (n, 6) of the length `FAR` in directions (n, 3) of the mirror's place."""
    rays = np.zeros((len(ways), 6))
    rays[:, :3] = FAR * ways / np.linalg.norm(ways, axis=1, keepdims=True)
    return rays
