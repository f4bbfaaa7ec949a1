"""Lengths that limit the light, over the beam's cross-section: where a sub-beam lands, and how far
from the mirror's axis it meets a facet."""

from __future__ import annotations

from ..scalars.dispatch import nan_unless_positive, sqrt
from .forward import Geometry, LitFacet
from .rays import flight, hit, land, reflect
from .vectors import Plane, Vector, dot, rotate


def gradient_per_sigma(geometry: Geometry, origin: Vector) -> Plane:
    """A gradient with respect to a ray's origin as one over the cross-section, per sigma."""
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
