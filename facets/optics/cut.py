"""Light that apertures cut: readings, and what derivatives need.

Each limit of the light - a facet's edges, tip and rim, and its detector's edges - is a length that
is positive where light passes, and linear over the beam's cross-section, because facets and
detectors are flat and the rays of a sub-beam parallel. So it is zero on a line, a side of `region`.
Outlines always have the same sides; one that cuts nothing lies too far away to count.

The derivatives of a cut spot's power and centroid follow from how its sides move (`region.Span`);
how these move follows from the text of the sides, run with numbers that carry derivatives.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ..scalars.dispatch import Number, log, select, sqrt, where_any
from ..scalars.dual import Dual, value_and_slope
from .bench_gradient import slopes_of_detector, wedge_slopes
from .bench_light import add_background, reflectance
from .forward import Geometry, Scene, Three, dark_scene, illuminate, replace_light
from .forward import scene_readings as bare_readings
from .limits import central_landing, gradient_per_sigma, outward_direction
from .rays import gradient_of_shift, slant
from .region import FAR, NO_SPANS, SideLine, region, slopes_of_region
from .vectors import Plane, Vector, cross, dot, subtract

#: A side beyond which the beam has less than exp(-NEGLIGIBLE_EXPONENT) of the facet's light cuts
#: nothing: 4e-18.
NEGLIGIBLE_EXPONENT = 40.0
#: The least light whose logarithm is taken, and the distance of a side that passes the centre.
LEAST_LIGHT, HAIR = 1e-300, 1e-300
#: A limit beyond this is none.
BOUNDLESS = 1e100


class CutLight(NamedTuple):
    """The light of one facet that reaches its detector.

    cut: 1 where a side or the beam's aperture cuts it, else 0.  mass, centroid: see `wedge.wedge`.
    spans: of the sides, see `region.region`.
    """

    cut: Any
    mass: Any
    centroid: Plane
    spans: tuple[Three, ...]


def outline(geometry: Geometry, at: Scene, k: int) -> tuple[SideLine, ...]:
    """The sides of facet k's light: its first and second edge, tip, rim, and the detector's edges
    at -y, +y, -z and +z; infinitely far where there is no such limit, except for the tip."""
    tip, rim = geometry.openings.tip, geometry.openings.rim
    along = slant(outward_direction(geometry, at, k), geometry.direction, at.normals[k])
    value, slope = dot(subtract(at.place, at.apex), along), gradient_per_sigma(geometry, along)
    leaving, (psi, zeta) = central_landing(geometry, at, k)
    half_y, half_z = geometry.openings.halves[k]
    on_y = landing_slope(geometry, at, k, leaving, 1)
    on_z = landing_slope(geometry, at, k, leaving, 2)
    return (
        edge_line(geometry, at, k, 0),
        edge_line(geometry, at, k, 1),
        limit_line(value - tip, slope, 1.0),
        limit_line(rim - value, slope, -1.0),
        limit_line(half_y + psi, on_y, 1.0),
        limit_line(half_y - psi, on_y, -1.0),
        limit_line(half_z + zeta, on_z, 1.0),
        limit_line(half_z - zeta, on_z, -1.0),
    )


def edge_line(geometry: Geometry, at: Scene, k: int, number: int) -> SideLine:
    """One of a facet's two edges, half the gap inside."""
    edge, sense = (k + number) % 3, 1.0 - 2.0 * number
    (x, y), along = at.sides[edge], at.edges[edge]
    inward = cross(at.normals[k], along)
    slope = gradient_per_sigma(geometry, slant(inward, geometry.direction, at.normals[k]))
    size = sqrt((slope[0] * slope[0] + slope[1] * slope[1]) / dot(along, along))
    away = geometry.openings.gap / (2 * size)
    return SideLine(sense * (at.q[0] * y - at.q[1] * x) - away, sense * y, -sense * x)


def landing_slope(geometry: Geometry, at: Scene, k: int, leaving: Vector, axis: int) -> Plane:
    """How a landing coordinate changes over the beam's cross-section, mm a sigma."""
    axes = geometry.axes[k]
    along = slant(axes[axis], leaving, axes[0])
    return gradient_per_sigma(geometry, gradient_of_shift(along, geometry.direction, at.normals[k]))


def limit_line(value: Number, slope: Plane, sense: float) -> SideLine:
    """The side where value + sense slope . x = 0.  value: of the limit at the beam's centre, mm."""
    share = 1 / sqrt(slope[0] * slope[0] + slope[1] * slope[1])
    return SideLine(value * share, -sense * slope[0] * share, -sense * slope[1] * share)


def limited_line(line: SideLine, is_there: Any, depth: Number) -> SideLine:
    """A side, or one too far away to count: where there is none, or none nearer than `depth`, a
    square of a distance."""
    d = line.distance
    near = is_there & ((d <= 0) | (d * d < depth))
    return SideLine(select(near, select(abs(d) > 0, d, HAIR), FAR), line.x, line.y)


def passing_light(geometry: Geometry, at: Scene, k: int) -> CutLight:
    """The light of facet k that reaches its detector.  at: as if nothing were cut."""
    mass, centroid, _, _ = at.moments[k]
    openings, sides = geometry.openings, outline(geometry, at, k)
    half_y, half_z = openings.halves[k]
    depth = 2 * (NEGLIGIBLE_EXPONENT - log(select(mass > LEAST_LIGHT, mass, LEAST_LIGHT)))
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
    found = where_any(
        cut > 0, (mass, centroid, NO_SPANS), region, (*edges, *limits), openings.radius
    )
    return CutLight(cut, found[0], found[1], found[2])


def cut_scene(geometry: Geometry, state: tuple[Any, ...]) -> tuple[Scene, Three]:
    """The scene of a sensor at a state, nothing cut, and the light of each facet."""
    at = illuminate(dark_scene(geometry, state))
    lights = (
        passing_light(geometry, at, 0),
        passing_light(geometry, at, 1),
        passing_light(geometry, at, 2),
    )
    return at, lights


def readings(geometry: Geometry, state: tuple[Any, ...]) -> tuple[Three, Three, Three]:
    """Eq. (1): (psi, zeta, power) of detectors A, B and C at a state of Eq. (3)."""
    return scene_readings(geometry, cut_scene(geometry, state))


def scene_readings(geometry: Geometry, found: tuple[Scene, Three]) -> tuple[Three, Three, Three]:
    """The readings of what `cut_scene` gives."""
    return spots_of(geometry, *found)


def spots_of(geometry: Geometry, at: Scene, lights: Three) -> tuple[Three, Three, Three]:
    """The readings of the light that gets to the detectors, on coated facets and beside other
    light where there is such: all rays of collimated light meet a flat facet at one angle, so that
    a coating moves no spot."""
    light: Any = geometry.light
    moments: Any = tuple((each.mass, each.centroid, None, None) for each in lights)
    a, b, c = bare_readings(geometry, replace_light(at, at.integrals, moments))
    if light is None or not light.options.on:
        return a, b, c
    return (
        read_spot(geometry, at, 0, a),
        read_spot(geometry, at, 1, b),
        read_spot(geometry, at, 2, c),
    )


def read_spot(geometry: Geometry, at: Scene, k: int, values: Three) -> Three:
    power = values[2] * reflectance(geometry, at.normals[k], geometry.direction)
    return add_background((values[0], values[1]), power, geometry.light.background[k])


def reading_slopes(
    geometry: Geometry, state: tuple[Any, ...], plain: tuple[Scene, Three]
) -> tuple[Three, Three, Three]:
    """The readings' derivatives by the variables of which geometry or state carry derivatives.

    plain: from `cut_scene`, without these.
    """
    at, (scene, lights) = dark_scene(geometry, state), plain
    carrying = (
        light_with_slope(geometry, at, scene, lights, 0),
        light_with_slope(geometry, at, scene, lights, 1),
        light_with_slope(geometry, at, scene, lights, 2),
    )
    a, b, c = spots_of(geometry, at, carrying)
    return slopes_of_detector(a), slopes_of_detector(b), slopes_of_detector(c)


def light_with_slope(geometry: Geometry, to: Scene, at: Scene, lights: Three, k: int) -> CutLight:
    """The light of facet k with the derivatives that the scene `to` carries."""
    light, following = lights[k], (k + 1) % 3
    sides = to.sides[k], to.sides[following]
    integrals = at.integrals[k], at.integrals[following]
    uncut = wedge_slopes(to.q, sides, integrals, at.moments[k])
    slopes = []
    for line, span in zip(outline(geometry, to, k), light.spans, strict=True):
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
