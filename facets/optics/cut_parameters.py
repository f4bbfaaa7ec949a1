"""The derivatives of a cut sub-beam's reading by the sensor's parameters.

For each parameter a copy of the sensor carries an imaginary part h in it. The imaginary part of a
length that is computed with this copy is h times the length's derivative, without cancellation. The
lengths are the displacements of the outline's sides (as in `cut`) and of the centroid's landing
point.
"""

from __future__ import annotations

from ..scalars.dispatch import STEP, Number
from .forward import Geometry, Scene, Three
from .limits import (
    AT_MINUS_Y,
    AT_MINUS_Z,
    AT_PLUS_Y,
    KIND,
    RIM,
    gradient_per_sigma,
    limit,
    limit_direction,
)
from .rays import flight, gradient_of_shift, hit, land, reflect, slant
from .region import DISTANCE, FIRST, LENGTH, NORMAL, SECOND, Array
from .vectors import Plane, Vector, add, combine, dot, subtract


def incidence(geometry: Geometry, at: Scene, k: int, x: Plane) -> Vector:
    """The point at which the ray through x, in sigmas, meets facet k."""
    offset = combine(x[0], geometry.spread[0], x[1], geometry.spread[1])
    return hit(add(at.place, offset), geometry.direction, at.apex, at.normals[k])


def landing(geometry: Geometry, at: Scene, k: int, x: Plane) -> tuple[Number, Number]:
    """The point at which the ray through x lands on detector k: (psi, zeta), mm."""
    start, leaving = incidence(geometry, at, k, x), reflect(geometry.direction, at.normals[k])
    length = flight(start, leaving, geometry.centres[k], geometry.axes[k])
    return land(start, leaving, length, geometry.centres[k], geometry.axes[k])


def clearance(geometry: Geometry, at: Scene, k: int, kind: int, x: Plane) -> Number:
    """The distance of the ray through x from a limit, mm, up to a constant."""
    if kind <= RIM:
        point = subtract(incidence(geometry, at, k, x), at.apex)
        return dot(point, limit_direction(geometry, at, k, kind))
    psi, zeta = landing(geometry, at, k, x)
    coordinate = psi if kind <= AT_PLUS_Y else zeta
    return coordinate if kind in (AT_MINUS_Y, AT_MINUS_Z) else -coordinate


def cut_parameter_slopes(
    geometry: Geometry, at: Scene, varied: Geometry, moved: Scene, k: int, sides: Array, count: int
) -> Three:
    """The derivatives of (psi, zeta, power) of detector k by one parameter.

    at: of `sensor`, with the light as cut.  varied: the copy of the sensor in which the parameter
    carries STEP.  moved: of `varied`, without light.  sides, count: from `cut.passing_light`.
    """
    mass, centroid, _, _ = at.moments[k]
    beam, normal = geometry.direction, at.normals[k]
    x, y, z = geometry.axes[k]
    leaving = reflect(beam, normal)
    to_psi = gradient_per_sigma(geometry, gradient_of_shift(slant(y, leaving, x), beam, normal))
    to_zeta = gradient_per_sigma(geometry, gradient_of_shift(slant(z, leaving, x), beam, normal))
    landed = landing(varied, moved, k, centroid)
    psi, zeta = landed[0].imag / STEP, landed[1].imag / STEP
    power = mass * varied.power.imag / STEP
    for j in range(count):
        length, first, second = sides[j, LENGTH], sides[j, FIRST], sides[j, SECOND]
        if length == 0:
            continue
        kind = int(sides[j, KIND])
        size = limit(geometry, at, k, kind).size * STEP
        nx, ny, distance = sides[j, NORMAL], sides[j, NORMAL + 1], sides[j, DISTANCE]
        foot = (distance * nx, distance * ny)
        speed = clearance(varied, moved, k, kind, foot).imag / size
        on = clearance(varied, moved, k, kind, (foot[0] - ny, foot[1] + nx)).imag / size
        zeroth = speed * length + (on - speed) * first
        further = speed * first + (on - speed) * second
        dx, dy = foot[0] - centroid[0], foot[1] - centroid[1]
        swept_x, swept_y = dx * zeroth - ny * further, dy * zeroth + nx * further
        psi += (to_psi[0] * swept_x + to_psi[1] * swept_y) / mass
        zeta += (to_zeta[0] * swept_x + to_zeta[1] * swept_y) / mass
        power += geometry.power * zeroth
    return psi, zeta, power
