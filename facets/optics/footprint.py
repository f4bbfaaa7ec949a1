"""How far a spot reaches: the image of the light on a facet inside the beam's 1/e^2 circle.

The light on a facet is a wedge of the beam; cut at the circle it is a piece of pie, and a landing
coordinate is linear over it. So its extremes lie at the pie's corners, or where the arc runs along
the coordinate: the arc of the paper's Fig. 2. For floats.
"""

from __future__ import annotations

from math import inf, nan, sqrt

from .forward import Geometry, Path, Scene, reading
from .rays import gradient_of_shift, slanted
from .vectors import Vector, dot
from .wedge import Plane

#: The 1/e^2 radius in sigmas.
RADIUS = 2.0


def inside(point: Plane, q: Plane, u1: Plane, u2: Plane) -> bool:
    """Whether a point lies in the wedge at q between the sides u1 and u2."""
    x, y = point[0] - q[0], point[1] - q[1]
    return u1[0] * y - u1[1] * x >= 0 and x * u2[1] - y * u2[0] >= 0


def reach(slope: Plane, q: Plane, u1: Plane, u2: Plane) -> float:
    """The largest slope . x over the wedge inside the circle; -inf where that is empty."""
    most = -inf
    if q[0] * q[0] + q[1] * q[1] <= RADIUS * RADIUS:
        most = slope[0] * q[0] + slope[1] * q[1]
    for u in (u1, u2):
        a, h = q[0] * u[0] + q[1] * u[1], q[0] * u[1] - q[1] * u[0]
        if abs(h) > RADIUS:
            continue
        half = sqrt(RADIUS * RADIUS - h * h)
        for s in (-a - half, -a + half):
            if s > 0:
                most = max(most, slope[0] * (q[0] + s * u[0]) + slope[1] * (q[1] + s * u[1]))
    size = sqrt(slope[0] * slope[0] + slope[1] * slope[1])
    if size > 0:
        extreme = (RADIUS * slope[0] / size, RADIUS * slope[1] / size)
        if inside(extreme, q, u1, u2):
            most = max(most, RADIUS * size)
    return most


def extent(
    sensor: Geometry, at: Scene, k: int, along: Vector, centre: float
) -> tuple[float, float]:
    """The least and largest of one landing coordinate over the footprint on detector k, mm.

    along: the coordinate's slanted axis; centre: its value at the centroid. NaN where no light
    inside the circle meets the facet.
    """
    shift = gradient_of_shift(along, sensor.direction, at.normals[k])
    slope = (dot(shift, sensor.spread[0]), dot(shift, sensor.spread[1]))
    back = (-slope[0], -slope[1])
    u1, u2 = at.sides[k], at.sides[(k + 1) % 3]
    most, least = reach(slope, at.q, u1, u2), -reach(back, at.q, u1, u2)
    if most < least:
        return nan, nan
    centroid = at.moments[k][1]
    origin = centre - slope[0] * centroid[0] - slope[1] * centroid[1]
    return origin + least, origin + most


def footprint(sensor: Geometry, at: Scene, k: int, ray: Path) -> tuple[float, float, float, float]:
    """(least psi, largest psi, least zeta, largest zeta) of the spot on detector k, mm."""
    psi, zeta, _ = reading(sensor, at, k, ray)
    x, y, z = sensor.axes[k]
    left, right = extent(sensor, at, k, slanted(y, ray.leaving, x), psi)
    low, high = extent(sensor, at, k, slanted(z, ray.leaving, x), zeta)
    return left, right, low, high
