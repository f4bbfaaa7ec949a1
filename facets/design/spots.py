"""Clearances of spots from their detectors' edges, and of light from the mirror's rim, on arrays.

A landing coordinate is linear over a facet, so that the light inside the beam's 1/e^2 ellipse lands
farthest out on the ellipse itself, or, as only a piece of it lies on the facet, at a corner of that
piece. Each corner is a constraint of its own, since the largest of them changes its slope where one
takes over from another.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ..optics.footprint import (
    FOOTPRINT_RADIUS_SIGMAS,
    arc_reach,
    collimated_slopes,
    corners,
    gradient_per_sigma,
    outward_direction,
)
from ..optics.forward import Geometry, Scene, mirror_facets
from ..optics.rays import flight, hit, land, reflect, slant
from ..optics.vectors import Plane, dot, dot2, subtract
from ..scalars.dispatch import select, sqrt

#: Radius, in sigmas, of the light that has to stay on the detectors and on the mirror.
RADIUS = FOOTPRINT_RADIUS_SIGMAS


def landings(fixed: Geometry, at: Scene) -> Iterator[tuple[int, int, Any, Plane]]:
    """Yield each detector (0 to 2) and axis (y, z) with the place where the beam's central ray
    lands, mm, and its change with a sigma across the beam."""
    for facet in mirror_facets(fixed, at):
        start = hit(at.place, fixed.direction, at.apex, facet.normal)
        leaving = reflect(fixed.direction, facet.normal)
        length = flight(start, leaving, facet.centre, facet.axes)
        centre = land(start, leaving, length, facet.centre, facet.axes)
        for axis, slope in enumerate(collimated_slopes(facet)):
            yield facet.k, axis, centre[axis], slope


def ellipse_clearances(fixed: Geometry, at: Scene, sizes: Any) -> list[Any]:
    """Clearances of the whole ellipse's image from each detector's edges at -y, +y, -z, +z, mm: 12.

    sizes: of the detectors, square, mm.
    """
    clearances = []
    for k, _, centre, slope in landings(fixed, at):
        reach = RADIUS * sqrt(dot2(slope, slope))
        clearances += [sizes[k] / 2 + centre - reach, sizes[k] / 2 - centre - reach]
    return clearances


def corner_clearances(fixed: Geometry, at: Scene, sizes: Any) -> dict[tuple[int, int], list[Any]]:
    """Clearances by detector and edge (-y, +y, -z, +z) of a facet's candidates for the farthest
    light, mm: the tip, the points where the facet's edges leave the ellipse, and the arc's farthest
    point.

    sizes: of each detector along y and z, mm.  The tip is inside the ellipse; see `tip_clearance`.
    """
    clearances = {}
    outermost = [corner_points(at, k) for k in range(3)]
    for k, axis, centre, slope in landings(fixed, at):
        tip, first, second = (dot2(slope, point) for point in outermost[k])
        for side, sign in enumerate((-1, 1)):
            facing = (sign * slope[0], sign * slope[1])
            farthest, before, after = arc_reach(
                facing, at.q, at.sides[k], at.sides[(k + 1) % 3], RADIUS
            )
            # if the arc's farthest place is off the facet, use the end of that edge
            arc = select(before < 0, sign * first, select(after < 0, sign * second, farthest))
            clearances[k, 2 * axis + side] = [
                sizes[k][axis] / 2 - sign * centre - reach
                for reach in (sign * tip, sign * first, sign * second, arc)
            ]
    return clearances


def corner_points(at: Scene, k: int) -> list[Plane]:
    """The corners of the light on facet k inside the ellipse: tip and far ends of both edges."""
    every = corners(at.q, at.sides[k], at.sides[(k + 1) % 3], RADIUS)
    return [every[n][1] for n in (0, 2, 4)]


def tip_clearance(at: Scene) -> Any:
    """A value that is positive where the mirror's tip is inside the ellipse."""
    return 1 - dot2(at.q, at.q) / (RADIUS * RADIUS)


def rim_clearances(fixed: Geometry, at: Scene, rim: float) -> list[Any]:
    """Clearances of the light inside the ellipse from the mirror's rim by facet, over the rim."""
    clearances = []
    for facet in mirror_facets(fixed, at):
        along = slant(outward_direction(facet), fixed.direction, facet.normal)
        slope = gradient_per_sigma(fixed, along)
        out = dot(subtract(at.place, at.apex), along)
        clearances.append(1 - (out + RADIUS * sqrt(dot2(slope, slope))) / rim)
    return clearances
