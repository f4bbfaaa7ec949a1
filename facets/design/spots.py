"""Clearances of spots from their detectors' edges, and of light from the mirror's rim, on arrays.

A landing coordinate is linear over a facet. The light inside the beam's 1/e^2 ellipse therefore
lands farthest out at a point of the ellipse itself or at a corner of the part of it that lies on
the facet. Each corner is a constraint of its own, because the largest of them has a kink where
another corner becomes the largest.
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
    """Yield, for each detector (0 to 2) and axis (0: y, 1: z), the coordinate at which the beam's
    central ray lands, mm, and its change per sigma across the beam."""
    for facet in mirror_facets(fixed, at):
        start = hit(at.place, fixed.direction, at.apex, facet.normal)
        leaving = reflect(fixed.direction, facet.normal)
        length = flight(start, leaving, facet.centre, facet.axes)
        centre = land(start, leaving, length, facet.centre, facet.axes)
        for axis, slope in enumerate(collimated_slopes(facet)):
            yield facet.k, axis, centre[axis], slope


def ellipse_clearances(fixed: Geometry, at: Scene, sizes: Any) -> list[Any]:
    """The 12 clearances of the complete ellipse's image from each detector's edges at -y, +y, -z,
    +z, mm.  sizes: sides of the square detectors, mm."""
    clearances = []
    for k, _, centre, slope in landings(fixed, at):
        reach = RADIUS * sqrt(dot2(slope, slope))
        clearances += [sizes[k] / 2 + centre - reach, sizes[k] / 2 - centre - reach]
    return clearances


def corner_clearances(fixed: Geometry, at: Scene, sizes: Any) -> dict[tuple[int, int], list[Any]]:
    """Clearances, mm, of the points of a facet's light that can land farthest out, by detector and
    edge (-y, +y, -z, +z).

    The points are the tip, the crossings of the facet's edges with the ellipse, and the farthest
    point of the arc.  sizes: of each detector along y and z, mm.  The tip must be inside the
    ellipse; see `tip_clearance`.
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
    points = corners(at.q, at.sides[k], at.sides[(k + 1) % 3], RADIUS)
    return [points[n][1] for n in (0, 2, 4)]


def tip_clearance(at: Scene) -> Any:
    """A value that is positive if the mirror's tip is inside the ellipse."""
    return 1 - dot2(at.q, at.q) / (RADIUS * RADIUS)


def rim_clearances(fixed: Geometry, at: Scene, rim: float) -> list[Any]:
    """The clearance of each facet's light inside the ellipse from the mirror's rim, over the rim's
    radius."""
    clearances = []
    for facet in mirror_facets(fixed, at):
        along = slant(outward_direction(facet), fixed.direction, facet.normal)
        slope = gradient_per_sigma(fixed, along)
        out = dot(subtract(at.place, at.apex), along)
        clearances.append(1 - (out + RADIUS * sqrt(dot2(slope, slope))) / rim)
    return clearances
