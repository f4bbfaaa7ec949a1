"""The sensor at a state, and the places of its light, from the model's own rays.

Light means the light inside the beam's 1/e^2 circle. A sub-beam begins on its facet, as the piece
of that circle between the facet's edges, and ends on its detector, as the spot. All its points lie
on rays of `optics.rays`, so that a drawing agrees with `facets.readings`. Lengths in mm, world
frame.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...core.sensor import Sensor
from ...core.units import Floats
from ...model.arrays import geometry_of
from ...optics.forward import Geometry, Scene, dark_scene, mirror_edges
from ...optics.rays import flight, hit, reflect
from ...optics.vectors import combine, rotate

#: Radius of the 1/e^2 circle, standard deviations.
CIRCLE = 2.0
#: Numbers of points across a facet's angle and from the apex outward.
ANGLES, RADII = 49, 25
#: Radius of a drawn mirror that has no rim, mm.
RIM_MM = 5.0


@dataclass(frozen=True)
class SpotLight:
    """The light on a detector, with places (psi, zeta) in the detector's frame, mm.

    grid: places (RADII, ANGLES, 2) of the light; empty without light.  light: irradiance there.
    apex, beam: images of the apex, Q, and of the beam's centre, S.  circle: image of the 1/e^2
    circle, (n, 2).
    """

    grid: Floats
    light: Floats
    apex: Floats
    beam: Floats
    circle: Floats


def array(vector: Any) -> Floats:
    """Convert a vector of arrays to an array (..., 3)."""
    return np.stack(np.broadcast_arrays(*vector), axis=-1).astype(float)


@dataclass(frozen=True)
class PosedSensor:
    """A sensor at a state."""

    sensor: Sensor
    geometry: Geometry
    at: Scene

    @classmethod
    def from_state(cls, sensor: Sensor, state: Floats) -> PosedSensor:
        geometry = geometry_of(sensor)
        numbers = [float(x) for x in state]
        return cls(sensor, geometry, dark_scene(geometry, tuple(numbers)))

    def facet_points(self, k: int, cross: Floats) -> Any:
        """Return where rays meet facet k's plane.

        cross: their places (..., 2) across the beam, standard deviations.
        """
        spread = self.geometry.spread
        aside = combine(cross[..., 0], spread[0], cross[..., 1], spread[1])
        start = tuple(p + a for p, a in zip(self.at.place, aside, strict=True))
        return hit(start, self.geometry.direction, self.at.apex, self.at.normals[k])

    def detector_points(self, k: int, cross: Floats) -> Any:
        """Return where rays at places `cross` meet detector k after facet k."""
        start = self.facet_points(k, cross)
        leaving = reflect(self.geometry.direction, self.at.normals[k])
        axes = self.geometry.axes[k]
        length = flight(start, leaving, self.geometry.centres[k], axes)
        return tuple(s + length * d for s, d in zip(start, leaving, strict=True))

    def flat(self, k: int, places: Floats) -> Floats:
        """Convert points (..., 3) on detector k to (psi, zeta)."""
        offset = places - np.array(self.geometry.centres[k])
        return np.asarray(offset @ np.array(self.geometry.axes[k])[1:].T)

    def sides(self, k: int) -> tuple[Floats, Floats, Floats]:
        """Return the apex and the two edges of facet k across the beam, standard deviations."""
        at = self.at
        return np.array(at.q), np.array(at.sides[k]), np.array(at.sides[(k + 1) % 3])


def cut(posed: PosedSensor, k: int) -> Floats:
    """Return places (RADII, ANGLES, 2) of the light on facet k across the beam.

    Unit: standard deviations. In each direction from the apex the places lie inside the circle. The
    array is empty without light.
    """
    q, first, second = posed.sides(k)
    low = np.arctan2(first[1], first[0])
    high = low + np.arctan2(first[0] * second[1] - first[1] * second[0], first @ second)
    for _ in range(2):  # the second time across those directions only that meet the circle
        angle = np.linspace(low, high, ANGLES)
        u = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        along = u @ q
        square = along**2 - q @ q + CIRCLE**2
        root = np.sqrt(np.maximum(square, 0))
        near, far = np.maximum(-along - root, 0), np.maximum(-along + root, 0)
        lit = (square > 0) & (far > 0)
        if lit.sum() < 2:
            return np.empty((0, 0, 2))
        low, high = angle[lit][[0, -1]]
    distance = near + np.linspace(0, 1, RADII)[:, None] * (far - near)
    grid: Floats = q + distance[..., None] * u
    return grid


def rims(posed: PosedSensor, k: int) -> Floats:
    """Return the rim of sub-beam k on its facet and on its detector, (2, n, 3).

    It runs outward along one edge of the facet, across, and back; n is 0 without light.
    """
    grid = cut(posed, k)
    if not len(grid):
        return np.empty((2, 0, 3))
    parts = [grid[:, 0], grid[-1, 1:], grid[::-1, -1][1:], grid[0, ::-1][1:-1]]
    rim = np.concatenate(parts)
    return np.array([array(posed.facet_points(k, rim)), array(posed.detector_points(k, rim))])


def rim_of(sensor: Sensor) -> float:
    return min(sensor.apertures.rim, RIM_MM)


def mirror(posed: PosedSensor) -> Floats:
    """Return the corners of the three facets, (3, 3, 3): the apex, and two on the rim."""
    turn, apex = posed.at.turn, np.array(posed.at.apex)
    edges = np.array([rotate(turn, edge) for edge in mirror_edges(posed.geometry.normals)])
    falls = -edges @ np.array([row[2] for row in turn])
    feet = apex + edges * rim_of(posed.sensor) / falls[:, None]
    return np.array([[apex, feet[k], feet[(k + 1) % 3]] for k in range(3)])


def spot(posed: PosedSensor, k: int) -> SpotLight:
    """Compute the light on detector k, as in Fig. 2 of the paper."""
    turn = np.linspace(0, 2 * np.pi, 181)
    circle = CIRCLE * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    cross = cut(posed, k)
    grid, *places = (
        posed.flat(k, array(posed.detector_points(k, part)))
        for part in (cross, np.array(posed.at.q), np.zeros(2), circle)
    )
    return SpotLight(grid, np.exp(-(cross**2).sum(axis=-1) / 2), *places)
