"""Lengths that limit the light, over the beam's cross-section: where a sub-beam lands, and how far
from the mirror's axis it meets a facet."""

from __future__ import annotations

from ..scalars.dispatch import nan_unless_positive, sqrt
from .forward import Geometry, Scene
from .rays import flight, hit, land, reflect
from .vectors import Plane, Vector, dot, rotate


def gradient_per_sigma(geometry: Geometry, origin: Vector) -> Plane:
    """A gradient with respect to a ray's origin as one over the cross-section, per sigma."""
    return dot(origin, geometry.spread[0]), dot(origin, geometry.spread[1])


def central_landing(geometry: Geometry, at: Scene, k: int) -> tuple[Vector, Plane]:
    """The direction of the beam's central ray after an unbounded facet k, and its landing point on
    detector k, mm; NaN if it never gets there."""
    beam, normal, centre, axes = (
        geometry.direction,
        at.normals[k],
        geometry.centres[k],
        geometry.axes[k],
    )
    leaving = reflect(beam, normal)
    start = hit(at.place, beam, at.apex, normal)
    length = flight(start, leaving, centre, axes)
    psi, zeta = land(start, leaving, length, centre, axes)
    clear = -dot(beam, normal), dot(leaving, axes[0]), length
    return leaving, (nan_unless_positive(psi, *clear), nan_unless_positive(zeta, *clear))


def outward_direction(geometry: Geometry, at: Scene, k: int) -> Vector:
    """The direction perpendicular to the mirror's axis in which facet k faces."""
    x, y, z = geometry.normals[k]
    size = sqrt(x * x + y * y)
    return rotate(at.turn, (x / size, y / size, z * 0))
