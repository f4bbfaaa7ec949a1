"""The sensor at a state as bodies in space, made from the model's own rays.

Light means the light inside the beam's 1/e^2 circle. A sub-beam begins on its facet as a piece of
that circle cut out by the facet's edges and ends on its detector as the spot; every point of it is
on a ray of `optics.rays`, so that the drawing agrees with `facets.readings`. Lengths mm, world
frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.names import DETECTORS
from ...core.sensor import Sensor
from ...core.units import Floats
from ...model.arrays import geometry_of
from ...optics.forward import Geometry, Scene, dark_scene, mirror_edges
from ...optics.rays import flight, hit, reflect
from ...optics.vectors import combine, rotate

#: The 1/e^2 circle in sigmas.
CIRCLE = 2.0
#: Numbers of points across a facet's angle, and from the apex outward.
ANGLES, RADII = 49, 25
#: Radius of a drawn mirror that has no rim, mm.
RIM_MM = 5.0


@dataclass(frozen=True)
class Body:
    """A surface: points (n, 3), faces as lists of their numbers.

    kind: "mirror", "beam", "sub-beam", "detector", "spot".  light: (n,) irradiance over the beam's
    largest, where it is shown.
    """

    name: str
    kind: str
    points: Floats
    faces: Sequence[Sequence[int]]
    light: Floats | None = None


@dataclass(frozen=True)
class SpotLight:
    """The light on a detector, in its frame: (psi, zeta), mm.

    grid: (RADII, ANGLES, 2) the light's places, light: their irradiance; empty where none of the
    circle's light falls.  apex: Q, beam: S, image of the beam's centre, circle: (n, 2) of its rim.
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
class Stand:
    """A sensor and its mirror's place, from which every body is made."""

    sensor: Sensor
    geometry: Geometry
    at: Scene

    @classmethod
    def from_state(cls, sensor: Sensor, state: Floats) -> Stand:
        geometry = geometry_of(sensor)
        numbers = [float(x) for x in state]
        return cls(sensor, geometry, dark_scene(geometry, tuple(numbers)))

    def incoming(self, cross: Floats) -> Any:
        """Return the origins of rays at places (..., 2) across the beam, sigmas."""
        x, y = cross[..., 0], cross[..., 1]
        spread = combine(x, self.geometry.spread[0], y, self.geometry.spread[1])
        return tuple(p + s for p, s in zip(self.at.place, spread, strict=True))

    def facet_points(self, k: int, cross: Floats) -> Any:
        return hit(self.incoming(cross), self.geometry.direction, self.at.apex, self.at.normals[k])

    def detector_points(self, k: int, cross: Floats) -> Any:
        """Return where rays at places across the beam land on detector k by way of facet k."""
        start = self.facet_points(k, cross)
        leaving = reflect(self.geometry.direction, self.at.normals[k])
        axes = self.geometry.axes[k]
        length = flight(start, leaving, self.geometry.centres[k], axes)
        return tuple(s + length * d for s, d in zip(start, leaving, strict=True))

    def flat(self, k: int, places: Floats) -> Floats:
        """Convert points (..., 3) on detector k to (psi, zeta)."""
        apart = places - np.array(self.geometry.centres[k])
        axes = np.array(self.geometry.axes[k])
        return np.stack([apart @ axes[1], apart @ axes[2]], axis=-1)


def reflect_points(points: Floats, apex: Floats, normal: Floats) -> Floats:
    """Reflect points (..., 3) in the plane of a facet.

    This folds a point of a sub-beam back to its ray's place without the mirror.
    """
    folded: Floats = points - 2 * ((points - apex) @ normal)[..., None] * normal
    return folded


def is_in_wedge(stand: Stand, k: int, cross: Floats) -> NDArray[np.bool_]:
    """Return which places (..., 2) across the beam, sigmas, are on facet k."""
    first, second = (np.array(stand.at.sides[n], float) for n in (k, (k + 1) % 3))
    apart = cross - np.array(stand.at.q, float)
    after = first[0] * apart[..., 1] - first[1] * apart[..., 0] > 0
    before = apart[..., 0] * second[1] - apart[..., 1] * second[0] > 0
    within: NDArray[np.bool_] = after & before
    return within


def cut(stand: Stand, k: int) -> Floats:
    """Return the light on facet k across the beam, sigmas: (RADII, ANGLES, 2), or an empty array.

    Along each direction from the apex the points lie inside the circle.
    """
    q = np.array(stand.at.q)
    first, second = (np.array(stand.at.sides[n]) for n in (k, (k + 1) % 3))
    start = np.arctan2(first[1], first[0])
    opening = np.arctan2(first[0] * second[1] - first[1] * second[0], first @ second)
    angle = start + np.linspace(0, 1, ANGLES) * opening
    u = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    along = u @ q
    square = along**2 - q @ q + CIRCLE**2
    root = np.sqrt(np.maximum(square, 0))
    near, far = np.maximum(-along - root, 0), np.maximum(-along + root, 0)
    lit = (square > 0) & (far > 0)
    if lit.sum() < 2:
        return np.empty((0, 0, 2))
    if not lit.all():  # only some directions meet the circle: as many points across those
        ends = np.flatnonzero(lit)
        return cut_between(q, angle[ends[0]], angle[ends[-1]])
    return grid_of(q, u, near, far)


def cut_between(q: Floats, low: float, high: float) -> Floats:
    angle = np.linspace(low, high, ANGLES)
    u = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    along = u @ q
    root = np.sqrt(np.maximum(along**2 - q @ q + CIRCLE**2, 0))
    return grid_of(q, u, np.maximum(-along - root, 0), np.maximum(-along + root, 0))


def grid_of(q: Floats, u: Floats, near: Floats, far: Floats) -> Floats:
    share = np.linspace(0, 1, RADII)[:, None]
    distance = near + share * (far - near)
    grid: Floats = q + distance[..., None] * u
    return grid


def irradiance(cross: Floats) -> Floats:
    """The irradiance over the beam's largest, at places across it in sigmas."""
    light: Floats = np.exp(-(cross**2).sum(axis=-1) / 2)
    return light


def quads(rows: int, columns: int) -> list[list[int]]:
    """The faces of a grid of points."""
    return [
        [r * columns + c, r * columns + c + 1, (r + 1) * columns + c + 1, (r + 1) * columns + c]
        for r in range(rows - 1)
        for c in range(columns - 1)
    ]


def outline(grid: Floats) -> Floats:
    """Return the rim of a grid (RADII, ANGLES, ...): out along one edge, across, and back."""
    parts = [grid[:, 0], grid[-1, 1:], grid[::-1, -1][1:], grid[0, ::-1][1:-1]]
    return np.concatenate(parts)


def rim_of(sensor: Sensor) -> float:
    return min(sensor.apertures.rim, RIM_MM)


def mirror(stand: Stand) -> list[Body]:
    """Make the three facets, from the apex down their edges to the rim."""
    turn = stand.at.turn
    body = [rotate(turn, edge) for edge in mirror_edges(stand.geometry.normals)]
    axis = np.array([row[2] for row in turn])
    apex = np.array(stand.at.apex)
    feet = []
    for edge in body:
        down = np.array(edge)
        feet.append(apex + down * (rim_of(stand.sensor) / -(down @ axis)))
    return [
        Body(f"facet {name}", "mirror", np.array([apex, feet[k], feet[(k + 1) % 3]]), [[0, 1, 2]])
        for k, name in enumerate(DETECTORS)
    ]


def beam(stand: Stand, length: float) -> Body | None:
    """Make the incoming beam's 1/e^2 surface, from `length` above the mirror down to the facets."""
    rims = []
    for k in range(3):
        cross = cut(stand, k)
        if len(cross):
            far = cross[-1]
            rims.append((far, array(stand.facet_points(k, far))))
    if not rims:
        return None
    cross = np.concatenate([part for part, _ in rims])
    feet = np.concatenate([part for _, part in rims])
    back = -np.array(stand.geometry.direction)
    tops = feet + ((length - feet[:, 2]) / back[2])[:, None] * back
    count = len(cross)
    points = np.concatenate([feet, tops])
    faces = [[n, (n + 1) % count, count + (n + 1) % count, count + n] for n in range(count)]
    return Body("beam", "beam", points, faces)


def sub_beam(stand: Stand, k: int, share: float = 1.0) -> Body | None:
    """Make the wedge-shaped body from facet k to its detector, or over a share of the way."""
    cross = cut(stand, k)
    if not len(cross):
        return None
    rim = outline(cross)
    start, end = array(stand.facet_points(k, rim)), array(stand.detector_points(k, rim))
    points = np.concatenate([start, start + share * (end - start)])
    count = len(rim)
    faces = [[n, (n + 1) % count, count + (n + 1) % count, count + n] for n in range(count)]
    return Body(f"sub-beam {DETECTORS[k]}", "sub-beam", points, faces)


def detector(stand: Stand, k: int) -> Body:
    """Make the sensitive area of detector k."""
    psd = stand.sensor.psds[k]
    centre, axes = np.array(stand.geometry.centres[k]), np.array(stand.geometry.axes[k])
    corners = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    points = [
        centre + y * psd.size_y / 2 * axes[1] + z * psd.size_z / 2 * axes[2] for y, z in corners
    ]
    return Body(f"PSD {DETECTORS[k]}", "detector", np.array(points), [[0, 1, 2, 3]])


#: Distance of a drawn spot in front of its detector, mm, without which the two would intersect.
SPOT_OFFSET_MM = 0.02


def spot_body(stand: Stand, k: int) -> Body | None:
    """Make the body of the light on detector k."""
    cross = cut(stand, k)
    if not len(cross):
        return None
    points = array(stand.detector_points(k, cross)).reshape(-1, 3)
    points = points - SPOT_OFFSET_MM * np.array(stand.geometry.axes[k][0])
    faces = quads(*cross.shape[:2])
    return Body(f"spot {DETECTORS[k]}", "spot", points, faces, irradiance(cross).ravel())


def spot(stand: Stand, k: int) -> SpotLight:
    """Compute the image on detector k that Fig. 2 of the paper shows."""
    cross = cut(stand, k)
    turn = np.linspace(0, 2 * np.pi, 181)
    circle = CIRCLE * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    places = [
        stand.flat(k, array(stand.detector_points(k, part)))
        for part in (np.array(stand.at.q), np.zeros(2), circle)
    ]
    if not len(cross):
        return SpotLight(np.empty((0, 0, 2)), np.empty((0, 0)), *places)
    grid = stand.flat(k, array(stand.detector_points(k, cross)))
    return SpotLight(grid, irradiance(cross), *places)


def rig(sensor: Sensor, state: Floats) -> list[Body]:
    stand = Stand.from_state(sensor, state)
    bodies: list[Body | None] = [*mirror(stand), beam(stand, stand.at.apex[2] + 120)]
    for k in range(3):
        bodies += [sub_beam(stand, k), detector(stand, k), spot_body(stand, k)]
    return [body for body in bodies if body is not None]
