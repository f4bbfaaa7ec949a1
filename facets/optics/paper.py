"""The irradiance on the detectors as the paper prints it, Eq. (7) to (9), for comparison.

Eq. (8) measures the distance from the beam's image along y and z as if the two were independent.
The ellipse in which an oblique sub-beam cuts the detector also has a cross term. Without it, the
irradiance is exact only where the sub-beam is level or in the plane of x and z. In suitable units
of y and z this irradiance is a normal distribution, so that the integrals between the images of the
mirror's edges are those of `wedge`, in floats.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from ..core.errors import InputError
from ..core.units import Floats
from .forward import Geometry, LitFacet, Path, mirror_facets, path, scene
from .rays import flight, hit, land
from .vectors import Plane, Vector, add, cross2, dot, rotate, unit_vector
from .wedge import sides, wedges


def printed_reading(facet: LitFacet, ray: Path, sigma: float) -> tuple[float, float, float]:
    """Eq. (9): centroid (psi, zeta), mm, and power, mW, of the irradiance of Eq. (7) and (8).
    sigma: standard deviation of the round beam, mm."""
    at, axes, centre, leaving = facet.at, facet.axes, facet.centre, ray.leaving
    x, y, z = rotate(axes, leaving)
    units = sigma * sqrt(1 + (y / x) ** 2), sigma * sqrt(1 + (z / x) ** 2)

    def place(start: Vector) -> Plane:
        """The landing point (psi, zeta) on the detector, mm, of a ray from a point on the facet."""
        return land(start, leaving, flight(start, leaving, centre, axes), centre, axes)

    beam = place(hit(at.place, facet.geometry.direction, at.apex, facet.normal))

    def scaled_place(start: Vector) -> Plane:
        """The landing point from that of the beam's axis, in the standard deviations of Eq. (8)."""
        psi, zeta = place(start)
        return (psi - beam[0]) / units[0], (zeta - beam[1]) / units[1]

    q = scaled_place(at.apex)
    ends = [scaled_place(add(at.apex, edge)) for edge in facet.edges]
    first, second = (unit_vector((end[0] - q[0], end[1] - q[1])) for end in ends)
    if cross2(first, second) < 0:  # a mirror flips the wedge
        first, second = second, first
    begin, end = sides(q, (first, second))
    ((mass, centroid, _, _),) = wedges(q, ((first, second, begin, end),))
    power = facet.geometry.power * mass * units[0] * units[1] / sigma**2
    power *= x / sqrt(x * x + y * y + z * z)
    return beam[0] + units[0] * centroid[0], beam[1] + units[1] * centroid[1], power


def paper_readings(geometry: Geometry, states: Floats) -> Floats:
    """Readings (n, 9) at states (n, 8) by the paper's irradiance; NaN where the exact ones are.
    Raises `InputError` for a beam that is not round."""
    sigma, other = (sqrt(dot(axis, axis)) for axis in geometry.spread)
    if not np.isclose(sigma, other, rtol=1e-12):
        raise InputError("the paper's irradiance needs a round beam; make both diameters equal")
    out = np.full((len(states), 9), np.nan)
    for n, state in enumerate(states):
        at = scene(geometry, tuple(state.tolist()))
        for k, facet in enumerate(mirror_facets(geometry, at)):
            ray = path(facet)
            if -ray.incidence > 0 and ray.facing > 0 and ray.length > 0:
                out[n, 3 * k : 3 * k + 3] = printed_reading(facet, ray, sigma)
    return out
