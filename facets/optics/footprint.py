"""How far a spot reaches: the image of the light on a facet inside the beam's 1/e^2 circle, or
inside the beam's aperture where that is smaller.

The light on a facet is a wedge of the beam; cut at the circle it is a piece of pie, and a landing
coordinate is linear over it. So its extremes lie at the pie's corners, or where the arc runs along
the coordinate: the arc of the paper's Fig. 2. For floats, and numbers that write machine code.
"""

from __future__ import annotations

from math import inf, nan, sqrt
from typing import Any

from ..scalars.dispatch import Number
from .curved_light import detector_image, trace_ray
from .forward import Geometry, Scene
from .limits import central_landing, gradient_per_sigma, outward_direction
from .rays import gradient_of_shift, reflect, slant
from .vectors import dot, subtract
from .wedge import Plane

#: The 1/e^2 radius in sigmas.
FOOTPRINT_RADIUS_SIGMAS = 2.0


def inside(point: Plane, q: Plane, u1: Plane, u2: Plane) -> bool:
    """Whether a point lies in the wedge at q between the sides u1 and u2."""
    x, y = point[0] - q[0], point[1] - q[1]
    return bool(u1[0] * y - u1[1] * x >= 0 and x * u2[1] - y * u2[0] >= 0)


def reach(slope: Plane, q: Plane, u1: Plane, u2: Plane, radius: float) -> float:
    """The largest slope . x over the wedge inside the circle; -inf where that is empty."""
    most = -inf
    if q[0] * q[0] + q[1] * q[1] <= radius * radius:
        most = slope[0] * q[0] + slope[1] * q[1]
    for u in (u1, u2):
        a, h = q[0] * u[0] + q[1] * u[1], q[0] * u[1] - q[1] * u[0]
        if abs(h) > radius:
            continue
        half = sqrt(radius * radius - h * h)
        for s in (-a - half, -a + half):
            if s > 0:
                most = max(most, slope[0] * (q[0] + s * u[0]) + slope[1] * (q[1] + s * u[1]))
    size = sqrt(slope[0] * slope[0] + slope[1] * slope[1])
    if size > 0:
        extreme = (radius * slope[0] / size, radius * slope[1] / size)
        if inside(extreme, q, u1, u2):
            most = max(most, radius * size)
    return most


def extent(
    geometry: Geometry, at: Scene, k: int, slope: Plane, centre: Number
) -> tuple[Number, Number]:
    """The least and largest of one length over the footprint of facet k, mm.

    slope: the length's change a sigma across the beam; centre: its value for the beam's central
    ray. NaN where no light inside the circle meets the facet.
    """
    u1, u2 = at.sides[k], at.sides[(k + 1) % 3]
    return between(slope, at.q, u1, u2, geometry.openings.radius, centre)


def between(
    slope: Plane, q: Plane, u1: Plane, u2: Plane, opening: Number, centre: Number
) -> tuple[Number, Number]:
    """`extent` of the wedge at q between the sides u1 and u2. opening: the beam's, in sigmas."""
    if hasattr(centre, "writer"):
        return between_straight(slope, q, u1, u2, opening, centre)
    return between_float(slope, q, u1, u2, opening, centre)


def between_float(
    slope: Plane, q: Plane, u1: Plane, u2: Plane, opening: float, centre: float
) -> tuple[float, float]:
    radius = min(FOOTPRINT_RADIUS_SIGMAS, opening)
    back = (-slope[0], -slope[1])
    most, least = reach(slope, q, u1, u2, radius), -reach(back, q, u1, u2, radius)
    if most < least:
        return nan, nan
    return centre + least, centre + most


def between_straight(
    slope: Plane, q: Plane, u1: Plane, u2: Plane, opening: Number, centre: Any
) -> tuple[Number, Number]:
    """The same without branches, for numbers that write machine code."""
    code: Any = centre.writer
    radius = code.select(
        code.compare("<", opening, FOOTPRINT_RADIUS_SIGMAS), opening, FOOTPRINT_RADIUS_SIGMAS
    )
    back = (-slope[0], -slope[1])
    most = reach_straight(code, slope, q, u1, u2, radius)
    least = -reach_straight(code, back, q, u1, u2, radius)
    empty = code.compare("<", most, least)
    return code.select(empty, nan, centre + least), code.select(empty, nan, centre + most)


def reach_straight(code: Any, slope: Plane, q: Plane, u1: Plane, u2: Plane, radius: Any) -> Any:
    """`reach` without branches."""
    square = radius * radius
    found: Any = code.select(
        code.compare("<=", q[0] * q[0] + q[1] * q[1], square),
        slope[0] * q[0] + slope[1] * q[1],
        -inf,
    )

    def at_most(here: Any, value: Any) -> Any:
        return code.select(here & code.compare(">", value, found), value, found)

    for u in (u1, u2):
        a, h = q[0] * u[0] + q[1] * u[1], q[0] * u[1] - q[1] * u[0]
        rest: Any = square - h * h
        crossed = code.compare(">=", rest, 0.0)
        half = code.function("sqrt", code.select(crossed, rest, 0.0))
        for s in (-a - half, -a + half):
            along = slope[0] * (q[0] + s * u[0]) + slope[1] * (q[1] + s * u[1])
            found = at_most(crossed & code.compare(">", s, 0.0), along)
    size: Any = code.function("sqrt", slope[0] * slope[0] + slope[1] * slope[1])
    x, y = radius * slope[0] / size - q[0], radius * slope[1] / size - q[1]
    within = code.compare(">=", u1[0] * y - u1[1] * x, 0.0)
    within = within & code.compare(">=", x * u2[1] - y * u2[0], 0.0)
    return at_most(within & code.compare(">", size, 0.0), radius * size)


def curved_slopes(geometry: Geometry, at: Scene, k: int) -> tuple[Plane, Plane]:
    """How psi and zeta change a sigma across a beam whose wavefront is curved, mm."""
    image = detector_image(geometry, at, k)
    middle = trace_ray(image, (0.0, 0.0)).spot
    right, up = (
        trace_ray(image, (1.0, 0.0)).spot,
        trace_ray(image, (0.0, 1.0)).spot,
    )
    return (
        (right[0] - middle[0], up[0] - middle[0]),
        (right[1] - middle[1], up[1] - middle[1]),
    )


def collimated_slopes(geometry: Geometry, at: Scene, k: int) -> tuple[Plane, Plane]:
    """How psi and zeta change a sigma across a collimated beam, mm."""
    beam, normal = geometry.direction, at.normals[k]
    x, y, z = geometry.axes[k]
    leaving = reflect(beam, normal)
    along_y, along_z = slant(y, leaving, x), slant(z, leaving, x)
    return (
        gradient_per_sigma(geometry, gradient_of_shift(along_y, beam, normal)),
        gradient_per_sigma(geometry, gradient_of_shift(along_z, beam, normal)),
    )


def footprint(
    geometry: Geometry, at: Scene, k: int, across: tuple[Plane, Plane]
) -> tuple[Number, Number, Number, Number, Number]:
    """(least psi, largest psi, least zeta, largest zeta) of the spot on detector k, and how far
    from the mirror's axis its light meets facet k at most; mm. NaN as `extent` and `reading`.

    across: from `collimated_slopes`, or from `curved_slopes` where the wavefront is curved.
    """
    beam, normal = geometry.direction, at.normals[k]
    _, (psi, zeta) = central_landing(geometry, at, k)
    left, right = extent(geometry, at, k, across[0], psi)
    low, high = extent(geometry, at, k, across[1], zeta)
    away = slant(outward_direction(geometry, at, k), beam, normal)
    _, out = extent(
        geometry, at, k, gradient_per_sigma(geometry, away), dot(subtract(at.place, at.apex), away)
    )
    return left, right, low, high, out + (psi - psi)  # NaN where psi is
