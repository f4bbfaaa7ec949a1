"""Footprint of a spot: the image of the light on a facet inside the beam's 1/e^2 circle, or inside
the beam's aperture if that is smaller.

The light on a facet is a wedge of the beam. Inside the circle it is a sector, over which a landing
coordinate is linear. Its extremes are therefore at the sector's corners, or at the point of the arc
at which the coordinate is stationary: the arc of the paper's Fig. 2. The functions take floats, and
numbers that write code.
"""

from __future__ import annotations

from math import inf, nan
from typing import Any

from ..scalars.dispatch import Number, nan_unless_positive, select, sqrt
from .curved_light import apparent_scene, detector_image, trace_ray
from .forward import Geometry, LitFacet, dark_scene, mirror_facets
from .rays import flight, gradient_of_shift, hit, land, reflect, slant
from .vectors import Plane, Vector, cross2, dot, dot2, rotate, subtract

#: The 1/e^2 radius in sigmas.
FOOTPRINT_RADIUS_SIGMAS = 2.0


def gradient_per_sigma(geometry: Geometry, origin: Vector) -> Plane:
    """Convert a gradient with respect to a ray's origin to one over the cross-section, per
    sigma."""
    return dot(origin, geometry.spread[0]), dot(origin, geometry.spread[1])


def central_landing(facet: LitFacet) -> tuple[Vector, Plane]:
    """The direction of the beam's central ray after an unbounded facet, and its landing point on
    the detector, mm; NaN if it never gets there."""
    beam, normal, centre, axes = facet.geometry.direction, facet.normal, facet.centre, facet.axes
    leaving = reflect(beam, normal)
    start = hit(facet.at.place, beam, facet.at.apex, normal)
    length = flight(start, leaving, centre, axes)
    psi, zeta = land(start, leaving, length, centre, axes)
    clear = -dot(beam, normal), dot(leaving, axes[0]), length
    return leaving, (nan_unless_positive(psi, *clear), nan_unless_positive(zeta, *clear))


def outward_direction(facet: LitFacet) -> Vector:
    """The direction perpendicular to the mirror's axis in which a facet faces."""
    x, y, z = facet.geometry.normals[facet.k]
    size = sqrt(x * x + y * y)
    return rotate(facet.at.turn, (x / size, y / size, z * 0))


def corners(q: Plane, u1: Plane, u2: Plane, radius: Number) -> list[tuple[Any, Plane]]:
    """The possible corners of the wedge inside the circle, each after the condition that it exists:
    the tip, and the points at which each side enters and leaves the circle."""
    square = radius * radius
    places = [(q[0] * q[0] + q[1] * q[1] <= square, q)]
    for u in (u1, u2):
        a, h = dot2(q, u), cross2(q, u)
        rest = square - h * h
        crosses = rest >= 0
        half = sqrt(select(crosses, rest, 0.0))
        for s in (-a - half, -a + half):
            places.append((crosses & (s > 0), (q[0] + s * u[0], q[1] + s * u[1])))
    return places


def arc_reach(
    slope: Plane, q: Plane, u1: Plane, u2: Plane, radius: Number
) -> tuple[Number, Number, Number]:
    """The largest slope . x on the circle, and two numbers, of the first and of the second side,
    which are not negative where this point of the circle lies in the wedge."""
    size = sqrt(slope[0] * slope[0] + slope[1] * slope[1])
    top = radius * slope[0] / size - q[0], radius * slope[1] / size - q[1]
    return radius * size, cross2(u1, top), cross2(top, u2)


def extent(facet: LitFacet, slope: Plane, centre: Number) -> tuple[Number, Number]:
    """The minimum and the maximum of a length over the footprint of a facet's light, mm.

    slope: the length's change per sigma across the beam.  centre: its value for the beam's central
    ray, mm. NaN where no light inside the circle meets the facet.
    """
    q, (u1, u2), opening = facet.at.q, facet.sides, facet.geometry.openings.radius
    radius = select(opening < FOOTPRINT_RADIUS_SIGMAS, opening, FOOTPRINT_RADIUS_SIGMAS)
    ends = []
    for sign in (1, -1):
        facing, most = (sign * slope[0], sign * slope[1]), -inf
        for exists, corner in corners(q, u1, u2, radius):
            there = facing[0] * corner[0] + facing[1] * corner[1]
            most = select(exists & (there > most), there, most)
        arc, before, after = arc_reach(facing, q, u1, u2, radius)
        on_facet = (before >= 0) & (after >= 0) & (arc > 0)
        ends.append(select(on_facet & (arc > most), arc, most))
    highest, lowest = ends[0], -ends[1]
    empty = highest < lowest
    return select(empty, nan, centre + lowest), select(empty, nan, centre + highest)


def curved_slopes(facet: LitFacet) -> tuple[Plane, Plane]:
    """The changes of psi and zeta per sigma across a beam with a curved wavefront, mm."""
    image = detector_image(facet)
    middle = trace_ray(image, (0.0, 0.0)).spot
    right, up = (
        trace_ray(image, (1.0, 0.0)).spot,
        trace_ray(image, (0.0, 1.0)).spot,
    )
    return (
        (right[0] - middle[0], up[0] - middle[0]),
        (right[1] - middle[1], up[1] - middle[1]),
    )


def collimated_slopes(facet: LitFacet) -> tuple[Plane, Plane]:
    """The changes of psi and zeta per sigma across a collimated beam, mm."""
    geometry, normal = facet.geometry, facet.normal
    x, y, z = facet.axes
    leaving = reflect(geometry.direction, normal)
    along_y, along_z = slant(y, leaving, x), slant(z, leaving, x)
    return (
        gradient_per_sigma(geometry, gradient_of_shift(along_y, geometry.direction, normal)),
        gradient_per_sigma(geometry, gradient_of_shift(along_z, geometry.direction, normal)),
    )


def footprints(geometry: Geometry, state: tuple[Number, ...]) -> Any:
    """The five numbers of `footprint` for each spot at a state: (3, 5)."""
    at, spread = dark_scene(geometry, state), collimated_slopes
    if geometry.light.options.on:
        at, spread = apparent_scene(geometry, at), curved_slopes
    return tuple(footprint(facet, spread(facet)) for facet in mirror_facets(geometry, at))


def footprint(
    facet: LitFacet, across: tuple[Plane, Plane]
) -> tuple[Number, Number, Number, Number, Number]:
    """The footprint of a facet's spot: lowest and highest psi, lowest and highest zeta, and the
    largest distance from the mirror's axis at which its light meets the facet; mm.

    NaN as in `extent` and `reading`.

    across: from `collimated_slopes`, or from `curved_slopes` where the wavefront is curved.
    """
    geometry, at = facet.geometry, facet.at
    _, (psi, zeta) = central_landing(facet)
    low_psi, high_psi = extent(facet, across[0], psi)
    low_zeta, high_zeta = extent(facet, across[1], zeta)
    away = slant(outward_direction(facet), geometry.direction, facet.normal)
    slope = gradient_per_sigma(geometry, away)
    _, out = extent(facet, slope, dot(subtract(at.place, at.apex), away))
    return low_psi, high_psi, low_zeta, high_zeta, out + (psi - psi)  # NaN where psi is NaN
