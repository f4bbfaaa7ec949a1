"""Light with a curved wavefront, as seen from its source and on a detector's image.

From the source, the mirror's edges look straight, so that mass and centroid of the light on a facet
are those of a wedge (`apparent_scene`). The ray through the centroid is traced to the detector's
image in the facet (`detector_image`). The landing point of a ray is a ratio of two linear functions
of its place in the beam. Half the second derivative of this ratio, contracted with the light's
covariance, is the distance of the spot's centroid from the landing point of that ray
(`curvature_shift`). All functions take any number type.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ..scalars.dispatch import Number
from .forward import Geometry, LitFacet, Scene, project_to_sigmas
from .rays import reflect
from .vectors import (
    Matrix,
    Plane,
    Vector,
    add,
    combine,
    dot,
    dot2,
    rotate,
    subtract,
    unit_vector,
)


def back_projection(geometry: Geometry, at: Scene) -> tuple[Any, Any, Any, Any]:
    """The matrix (xx, xy, yx, yy) that projects vectors across the beam from the height of the apex
    back to the height of the beam's place."""
    xx, xy, yx, yy = geometry.light.bend
    height = dot(subtract(at.apex, at.place), geometry.direction)
    a, b, c, d = height * xx + 1, height * xy, height * yx, height * yy + 1
    size = a * d - b * c
    return d / size, -b / size, -c / size, a / size


def apply(matrix: tuple[Any, Any, Any, Any], x: Plane) -> Plane:
    """The product of a matrix (xx, xy, yx, yy) and a vector of the plane."""
    return matrix[0] * x[0] + matrix[1] * x[1], matrix[2] * x[0] + matrix[3] * x[1]


def apparent_scene(geometry: Geometry, at: Scene) -> Scene:
    """The scene with apex and edges as seen from the source of a curved wavefront."""
    back = back_projection(geometry, at)
    q = apply(back, at.q)
    bent = apply(geometry.light.bend, q)
    sides = (
        apparent_edge(geometry, back, bent, at.edges[0]),
        apparent_edge(geometry, back, bent, at.edges[1]),
        apparent_edge(geometry, back, bent, at.edges[2]),
    )
    return at._replace(q=q, sides=sides)


def apparent_edge(
    geometry: Geometry, back: tuple[Any, Any, Any, Any], bent: Plane, edge: Vector
) -> Plane:
    """The direction of an edge as seen from the light's source, in sigmas."""
    along = dot(edge, geometry.direction)
    x, y = project_to_sigmas(geometry, edge)
    return unit_vector(apply(back, (x - along * bent[0], y - along * bent[1])))


class DetectorImage(NamedTuple):
    """The mirror image of a detector in its facet, and the beam in the frame of this image.

    The frame has its origin at the image's centre, and its axes along the image's normal, y and z.

    axes: of the image, in the world.  halves: half sizes of its sensitive area, mm.  start: place
    of the beam, mm.  direction: of the beam.  spread, fan: as in `Geometry` and `Light`.  path:
    distance of the image's plane from the apex along the beam, mm.
    """

    axes: Matrix
    halves: Plane
    start: Vector
    direction: Vector
    spread: tuple[Vector, Vector]
    fan: tuple[Vector, Vector]
    path: Number


def detector_image(facet: LitFacet) -> DetectorImage:
    """The image of a facet's detector in the facet, as rays across the beam see it."""
    geometry, at, normal, (x, y, z) = facet.geometry, facet.at, facet.normal, facet.axes
    axes = reflect(x, normal), reflect(y, normal), reflect(z, normal)
    # Measured from the image's centre.
    apex = reflect(subtract(at.apex, facet.centre), normal)
    direction = rotate(axes, geometry.direction)
    spread, fan = geometry.spread, geometry.light.fan
    return DetectorImage(
        axes=axes,
        halves=geometry.light.options.halves[facet.k],
        start=rotate(axes, add(apex, subtract(at.place, at.apex))),
        direction=direction,
        spread=(rotate(axes, spread[0]), rotate(axes, spread[1])),
        fan=(rotate(axes, fan[0]), rotate(axes, fan[1])),
        path=-dot(apex, axes[0]) / direction[0],
    )


class Ray(NamedTuple):
    """One ray to a detector's image.

    height: distance of its start from the image's plane, mm.  facing: component of its direction
    along the plane's normal.  slopes: along the image's y and z per distance along the normal.
    spot: landing point (psi, zeta), mm.
    """

    height: Number
    facing: Number
    slopes: Plane
    spot: Plane


def trace_ray(image: DetectorImage, x: Plane) -> Ray:
    """The ray through the place x of the beam, in sigmas."""
    start = add(image.start, combine(x[0], image.spread[0], x[1], image.spread[1]))
    direction = add(image.direction, combine(x[0], image.fan[0], x[1], image.fan[1]))
    facing = direction[0]
    inverse = 1 / facing
    slopes = direction[1] * inverse, direction[2] * inverse
    spot = start[1] - start[0] * slopes[0], start[2] - start[0] * slopes[1]
    return Ray(start[0], facing, slopes, spot)


def curvature_shift(image: DetectorImage, ray: Ray, shift: tuple[Any, Any, Any]) -> Plane:
    """The mean of the landing points minus the landing point of the mean ray, mm.

    shift: one minus the light's covariance, in sigmas, as xx, xy, yy.
    """
    (first, second), (x, y) = image.fan, image.spread
    inverse = 1 / ray.facing
    turn = first[0] * inverse, second[0] * inverse
    lever = ray.height * turn[0] - x[0], ray.height * turn[1] - y[0]
    a, b, c = 1 - shift[0], -shift[1], 1 - shift[2]
    weights = a * lever[0] + b * lever[1], b * lever[0] + c * lever[1]
    of_psi = (
        first[1] * inverse - ray.slopes[0] * turn[0],
        second[1] * inverse - ray.slopes[0] * turn[1],
    )
    of_zeta = (
        first[2] * inverse - ray.slopes[1] * turn[0],
        second[2] * inverse - ray.slopes[1] * turn[1],
    )
    return dot2(of_psi, weights), dot2(of_zeta, weights)
