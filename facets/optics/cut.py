"""Readings and their derivatives under light that apertures cut.

Light is limited by a facet's edges, tip and rim, and by its detector's edges. Each limit is
described by a length that is positive where light passes. This length is linear over the beam's
cross-section, because facets and detectors are flat and the rays of a sub-beam are parallel. It is
therefore zero on a line, which is a side of the lit `region`. Outlines always have the same number
of sides; a side that cuts nothing is too far away to have an effect.

The derivatives of a cut spot's power and centroid follow from the motion of the sides
(`region.slopes_of_region`), which is found by forward differentiation of their formulas.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ..scalars.dispatch import Number, log, select, sqrt, where_any
from ..scalars.dual import Dual, value_and_slope
from .bench_gradient import slopes_of_detector, wedge_slopes
from .bench_light import add_background, reflectance
from .footprint import central_landing, gradient_per_sigma, outward_direction
from .forward import (
    Geometry,
    LitFacet,
    Scene,
    Three,
    dark_scene,
    illuminate,
    mirror_facets,
    replace_light,
    scene_readings as bare_readings,
)
from .rays import gradient_of_shift, slant
from .region import FAR, NO_SPANS, SideLine, region, slopes_of_region
from .vectors import Plane, Vector, cross, dot, subtract

#: A side beyond which the beam has less than exp(-NEGLIGIBLE_EXPONENT) = 4e-18 of the facet's
#: light cuts nothing.
NEGLIGIBLE_EXPONENT = 40.0
#: Lower bounds of the light whose logarithm is taken, and of the distance of a side from the beam's
#: centre, so that neither is zero.
MIN_LIGHT, MIN_DISTANCE = 1e-300, 1e-300
#: A limit larger than this, mm, is no limit.
BOUNDLESS = 1e100


class CutLight(NamedTuple):
    """The light of one facet that reaches its detector.

    cut: 1 where a side or the beam's aperture cuts it, else 0.  mass, centroid: as in
    `wedge.wedges`.  spans: moments along the sides, see `region.region`.
    """

    cut: Any
    mass: Any
    centroid: Plane
    spans: tuple[Three, ...]


def outline(facet: LitFacet) -> tuple[SideLine, ...]:
    """The sides of a facet's light: its first and second edge, tip, rim, and the detector's edges
    at -y, +y, -z and +z. A side without a limit, except the tip, is infinitely far."""
    geometry, at = facet.geometry, facet.at
    tip, rim = geometry.openings.tip, geometry.openings.rim
    along = slant(outward_direction(facet), geometry.direction, facet.normal)
    value, slope = dot(subtract(at.place, at.apex), along), gradient_per_sigma(geometry, along)
    leaving, (psi, zeta) = central_landing(facet)
    half_y, half_z = geometry.openings.halves[facet.k]
    on_y = landing_slope(facet, leaving, 1)
    on_z = landing_slope(facet, leaving, 2)
    return (
        edge_line(facet, 0),
        edge_line(facet, 1),
        limit_line(value - tip, slope, 1.0),
        limit_line(rim - value, slope, -1.0),
        limit_line(half_y + psi, on_y, 1.0),
        limit_line(half_y - psi, on_y, -1.0),
        limit_line(half_z + zeta, on_z, 1.0),
        limit_line(half_z - zeta, on_z, -1.0),
    )


def edge_line(facet: LitFacet, which: int) -> SideLine:
    """The line of one of a facet's two edges, shifted inward by half the gap.

    which: 0 for the edge where the facet begins, 1 for the edge where it ends.
    """
    geometry, q, sense = facet.geometry, facet.at.q, 1.0 - 2.0 * which
    (x, y), along = facet.sides[which], facet.edges[which]
    inward = cross(facet.normal, along)
    slope = gradient_per_sigma(geometry, slant(inward, geometry.direction, facet.normal))
    size = sqrt((slope[0] * slope[0] + slope[1] * slope[1]) / dot(along, along))
    away = geometry.openings.gap / (2 * size)
    return SideLine(sense * (q[0] * y - q[1] * x) - away, sense * y, -sense * x)


def landing_slope(facet: LitFacet, leaving: Vector, axis: int) -> Plane:
    """The gradient of a landing coordinate over the beam's cross-section, mm per sigma."""
    geometry, axes = facet.geometry, facet.axes
    along = slant(axes[axis], leaving, axes[0])
    return gradient_per_sigma(geometry, gradient_of_shift(along, geometry.direction, facet.normal))


def limit_line(value: Number, slope: Plane, sense: float) -> SideLine:
    """The side on which value + sense slope . x = 0.

    value: the limit's length at the beam's centre, mm.  slope: its gradient, mm per sigma.
    """
    inverse = 1 / sqrt(slope[0] * slope[0] + slope[1] * slope[1])
    return SideLine(value * inverse, -sense * slope[0] * inverse, -sense * slope[1] * inverse)


def limited_line(line: SideLine, is_there: Any, depth: Number) -> SideLine:
    """The side if it cuts light, else a side that is too far away to cut any.

    is_there: whether the limit exists.  depth: square of the distance, in sigmas, beyond which the
    beam has negligible light.
    """
    d = line.distance
    near = is_there & ((d <= 0) | (d * d < depth))
    return SideLine(select(near, select(abs(d) > 0, d, MIN_DISTANCE), FAR), line.x, line.y)


def passing_light(facet: LitFacet) -> CutLight:
    """The light of a facet that reaches its detector.  facet: with all of its light, uncut."""
    mass, centroid, _, _ = facet.moments
    openings, sides = facet.geometry.openings, outline(facet)
    half_y, half_z = openings.halves[facet.k]
    depth = 2 * (NEGLIGIBLE_EXPONENT - log(select(mass > MIN_LIGHT, mass, MIN_LIGHT)))
    limits = (
        limited_line(sides[2], openings.tip > 0, depth),
        limited_line(sides[3], openings.rim < BOUNDLESS, depth),
        limited_line(sides[4], half_y < BOUNDLESS, depth),
        limited_line(sides[5], half_y < BOUNDLESS, depth),
        limited_line(sides[6], half_z < BOUNDLESS, depth),
        limited_line(sides[7], half_z < BOUNDLESS, depth),
    )
    cut = select((openings.gap > 0) | (openings.radius * openings.radius < depth), 1.0, 0.0)
    for line in limits:
        cut = select(line.distance < FAR, 1.0, cut)
    edges = [limited_line(side, half_y > 0, FAR * FAR) for side in sides[:2]]
    mass, centroid, spans = where_any(
        cut > 0, (mass, centroid, NO_SPANS), region, (*edges, *limits), openings.radius
    )
    return CutLight(cut, mass, centroid, spans)


def cut_scene(geometry: Geometry, state: tuple[Any, ...]) -> tuple[Scene, Three]:
    """The scene of a sensor at a state with uncut light, and the passing light of each facet."""
    at = illuminate(dark_scene(geometry, state))
    a, b, c = mirror_facets(geometry, at)
    return at, (passing_light(a), passing_light(b), passing_light(c))


def scene_readings(geometry: Geometry, scene: tuple[Scene, Three]) -> tuple[Three, Three, Three]:
    """The readings in a scene from `cut_scene`, with coated facets and background light if there
    are any.

    All rays of collimated light meet a flat facet at one angle, so that a coating moves no spot.
    """
    at, lights = scene
    light: Any = geometry.light
    moments: Any = tuple((each.mass, each.centroid, None, None) for each in lights)
    a, b, c = bare_readings(geometry, replace_light(at, at.integrals, moments))
    if light is None or not light.options.on:
        return a, b, c
    on_a, on_b, on_c = mirror_facets(geometry, at)
    return read_spot(on_a, a), read_spot(on_b, b), read_spot(on_c, c)


def read_spot(facet: LitFacet, values: Three) -> Three:
    """The reading of a spot with the facet's coating and the background light.

    values: the reading without these.
    """
    geometry = facet.geometry
    power = values[2] * reflectance(geometry, facet.normal, geometry.direction)
    return add_background((values[0], values[1]), power, geometry.light.background[facet.k])


def reading_slopes(
    geometry: Geometry, state: tuple[Any, ...], plain: tuple[Scene, Three]
) -> tuple[Three, Three, Three]:
    """The readings' derivatives by the variables by which geometry or state carry derivatives.

    plain: the scene from `cut_scene`, without derivatives.
    """
    at, (scene, lights) = dark_scene(geometry, state), plain
    to_a, to_b, to_c = mirror_facets(geometry, at)
    at_a, at_b, at_c = mirror_facets(geometry, scene)
    carrying = (
        light_with_slope(to_a, at_a, lights[0]),
        light_with_slope(to_b, at_b, lights[1]),
        light_with_slope(to_c, at_c, lights[2]),
    )
    a, b, c = scene_readings(geometry, (at, carrying))
    return slopes_of_detector(a), slopes_of_detector(b), slopes_of_detector(c)


def light_with_slope(to: LitFacet, at: LitFacet, light: CutLight) -> CutLight:
    """The passing light of a facet, with the derivatives that the facet `to` carries.

    at, light: the same facet and its passing light, without derivatives.
    """
    uncut = wedge_slopes(to.at.q, to.sides, at.integrals, at.moments)
    slopes = []
    for line, span in zip(outline(to), light.spans, strict=True):
        (d, of_d), (x, of_x) = value_and_slope(line.distance), value_and_slope(line.x)
        y, of_y = value_and_slope(line.y)
        alive = abs(span[0]) > 0
        turn = select(alive, x * of_y - y * of_x, 0.0)
        slopes.append((select(alive, d, 0.0), x, y, select(alive, of_d, 0.0), turn))
    m, x, y = where_any(
        light.cut > 0,
        uncut,
        slopes_of_region,
        tuple(slopes),
        light.spans,
        light.mass,
        light.centroid,
    )
    centroid = Dual(light.centroid[0], x), Dual(light.centroid[1], y)
    return CutLight(light.cut, Dual(light.mass, m), centroid, light.spans)
