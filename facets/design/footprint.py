"""How near a spot comes to its detector's edges, on arrays: all of its light inside the
1/e^2 circle, exactly, as `characterization.ranges` has it.

The light on a facet is a piece of pie: a landing coordinate, linear over it, is largest at the
mirror's tip, where one of the facet's edges leaves the circle, or where the circle itself runs
along the coordinate, if that lies on the facet. Each is a constraint of its own, since the largest
of them changes its slope where one takes over from another.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..optics.forward import Geometry, Scene, dark_scene
from ..optics.rays import gradient_of_shift, reflect, slant
from ..optics.vectors import Plane, dot

#: The 1/e^2 radius, in sigmas.
RADIUS = 2


def reaches(slope: Plane, q: Plane, u1: Plane, u2: Plane) -> list[Any]:
    """Of slope . x over the wedge at q between the sides u1 and u2, inside the circle: at the tip,
    where each side leaves the circle, and along the arc. The tip is inside."""
    ends = []
    for u in (u1, u2):
        a, h = q[0] * u[0] + q[1] * u[1], q[0] * u[1] - q[1] * u[0]
        s = np.sqrt(RADIUS * RADIUS - h * h) - a
        ends.append(slope[0] * (q[0] + s * u[0]) + slope[1] * (q[1] + s * u[1]))
    size = np.sqrt(slope[0] * slope[0] + slope[1] * slope[1])
    x, y = RADIUS * slope[0] / size - q[0], RADIUS * slope[1] / size - q[1]
    past_first, past_second = u1[0] * y - u1[1] * x < 0, x * u2[1] - y * u2[0] < 0
    # where the arc's place has left the facet by an edge, it is that edge's end
    arc = np.where(past_first, ends[0], np.where(past_second, ends[1], RADIUS * size))
    return [slope[0] * q[0] + slope[1] * q[1], *ends, arc]


def edge_clearances(fixed: Geometry, state: Any, sizes: Any) -> dict[tuple[int, int], list[Any]]:
    """By detector and edge (-y, +y, -z, +z): from each of `reaches` to the edge, mm.

    sizes: of each detector along y and z, mm.
    """
    at: Scene = dark_scene(fixed, state)
    found = {}
    for k in range(3):
        normal, (x, y, z) = at.normals[k], fixed.axes[k]
        leaving = reflect(fixed.direction, normal)
        centre = tuple(p - c for p, c in zip(at.apex, fixed.centres[k], strict=True))
        offset = tuple(b - t for b, t in zip(at.place, at.apex, strict=True))
        u1, u2 = at.sides[k], at.sides[(k + 1) % 3]
        for n, axis in enumerate((y, z)):
            along = slant(axis, leaving, x)
            shift = gradient_of_shift(along, fixed.direction, normal)
            middle = dot(along, centre) + dot(shift, offset)
            slope = tuple(dot(shift, spread) for spread in fixed.spread)
            for side, sign in enumerate((-1, 1)):
                facing = (sign * slope[0], sign * slope[1])
                found[k, 2 * n + side] = [
                    sizes[k][n] / 2 - sign * middle - reach
                    for reach in reaches(facing, at.q, u1, u2)
                ]
    return found


def tip_clearance(fixed: Geometry, state: Any) -> Any:
    """Positive where the mirror's tip is inside the 1/e^2 circle, which `reaches` takes for so."""
    q = dark_scene(fixed, state).q
    return 1 - (q[0] * q[0] + q[1] * q[1]) / (RADIUS * RADIUS)
