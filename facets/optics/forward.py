"""From the mirror's pose to the detectors' readings: the paper's chain, exact, from top to bottom.

The beam is collimated and the facets are flat, so that all rays of one sub-beam have the same
direction. The map from the beam's cross-section to a detector is therefore affine, and maps the
centroid of the light on a facet to the centroid of the spot. Each reading needs the light in one
wedge of the beam (`wedge`) and the landing point of one ray (`rays`), and no integral over the
detector.

All functions take any number type. Vectors are tuples in the world frame, mm. Angles are in rad,
powers in mW, and q, centroids and other places in the beam's cross-section in sigmas. A reading
(psi, zeta, power) is in mm and mW; it is NaN if the light does not meet the facet or the detector.
"""

from __future__ import annotations

from math import inf
from typing import Any, NamedTuple

from ..scalars.dispatch import Number, cos, nan_unless_positive, sin
from .central import Side
from .effects import IDEAL, Light, LightEffects, build_light
from .rays import flight, hit, land, reflect
from .vectors import (
    Matrix,
    Plane,
    Vector,
    add,
    columns,
    combine,
    cross,
    dot,
    rotate,
    rotation,
    scale,
    subtract,
    unit_vector,
)
from .wedge import Moments, sides, wedges

Three = tuple[Any, Any, Any]

#: The sensor's 30 parameters in their order, of the beam, of each facet and of each detector; mm,
#: rad, mW.
BEAM = ("power", "diameter_x", "diameter_y", "rotation", "tilt_x", "tilt_y")
FACET = ("inclination", "azimuth")
PSD = ("radius", "azimuth", "height", "roll", "pitch", "yaw")
PARAMETERS = (
    *(f"beam.{name}" for name in BEAM),
    *(f"facet_{letter}.{name}" for letter in "abc" for name in FACET),
    *(f"psd_{letter}.{name}" for letter in "abc" for name in PSD),
)


class Openings(NamedTuple):
    """The apertures; they cut no light if `cut` is false.

    radius: of the beam's aperture, in sigmas.  tip, rim: distances of the mirror's tip and rim from
    its axis, mm.  gap: width lost along each edge, mm.  halves: half sizes of each detector's area
    along y and z, mm.
    """

    cut: bool
    radius: float
    tip: float
    rim: float
    gap: float
    halves: Three


OPEN = Openings(False, inf, 0.0, inf, 0.0, ((inf, inf), (inf, inf), (inf, inf)))


class Geometry(NamedTuple):
    """A sensor at rest, as vectors; from `build_geometry`.

    direction: of the beam.  power: mW.  spread: the beam's two cross-section axes times their
    sigma, mm.  whitening: the same axes divided by sigma, so that whitening . r is in sigmas, 1/mm.
    normals: of the facets, in the mirror's frame.  centres: of the detectors, mm.  axes: of each
    detector, its x, y and z in the world.  openings: the apertures.  light: the deviations from
    ideal light.
    """

    direction: Vector
    power: Number
    spread: tuple[Vector, Vector]
    whitening: tuple[Vector, Vector]
    normals: Three
    centres: Three
    axes: Three
    openings: Openings = OPEN
    light: Light = IDEAL


def beam_axes(rotation_about_beam: Number, tilt_x: Number, tilt_y: Number) -> Matrix:
    """The beam's cross-section axes and the direction back to the laser, in the world."""
    tilted = columns(rotation(tilt_x, tilt_y, tilt_x * 0))
    c, s = cos(rotation_about_beam), sin(rotation_about_beam)
    return combine(c, tilted[0], s, tilted[1]), combine(c, tilted[1], -s, tilted[0]), tilted[2]


def facet_normal(inclination: Number, azimuth: Number) -> Vector:
    """The outward unit normal of a facet, in the mirror's frame."""
    return sin(inclination) * cos(azimuth), sin(inclination) * sin(azimuth), cos(inclination)


def psd_centre(radius: Number, azimuth: Number, height: Number) -> Vector:
    """The centre of a detector in cylindrical coordinates, mm."""
    return radius * cos(azimuth), radius * sin(azimuth), height


def sub_beam_height(radius: Number, inclination: Number) -> Number:
    """The height above the apex of a facet's sub-beam at a distance `radius` from the axis, for a
    vertical beam; mm."""
    return radius / (sin(2 * inclination) / cos(2 * inclination))


def psd_axes(azimuth: Number, roll: Number, pitch: Number, yaw: Number) -> Matrix:
    """A detector's x, y and z axes: outward, sideways and up, then rotated."""
    return columns(rotation(roll, pitch, azimuth + yaw))


def build_geometry(
    parameters: tuple[Any, ...], openings: Openings = OPEN, effects: LightEffects | None = None
) -> Geometry:
    """The vectors of a sensor from its 30 parameters, mm, rad and mW, in the order of `PARAMETERS`.

    effects: the deviations from ideal light; None for ideal light.
    """
    power, diameter_x, diameter_y, turn, tilt_x, tilt_y = parameters[:6]
    facets = [parameters[k : k + 2] for k in (6, 8, 10)]
    psds = [parameters[k : k + 6] for k in (12, 18, 24)]
    x, y, back = beam_axes(turn, tilt_x, tilt_y)
    sigma_x, sigma_y = diameter_x / 4, diameter_y / 4
    a, b, c = (facet_normal(*facet) for facet in facets)
    centre_a, centre_b, centre_c = (psd_centre(*psd[:3]) for psd in psds)
    axes_a, axes_b, axes_c = (psd_axes(psd[1], *psd[3:]) for psd in psds)
    spread = scale(sigma_x, x), scale(sigma_y, y)
    whitening = scale(1 / sigma_x, x), scale(1 / sigma_y, y)
    light = IDEAL
    if effects is not None:
        level = beam_axes(turn * 0, tilt_x, tilt_y)
        light = build_light(effects, mirror_edges((a, b, c)), level[:2], spread, whitening)
    return Geometry(
        direction=scale(-1, back),
        power=power,
        spread=spread,
        whitening=whitening,
        normals=(a, b, c),
        centres=(centre_a, centre_b, centre_c),
        axes=(axes_a, axes_b, axes_c),
        openings=openings,
        light=light,
    )


def replace_power(geometry: Geometry, power: Number) -> Geometry:
    """The vectors of a sensor with another beam power, mW."""
    return geometry._replace(power=power)


def power_derivative(geometry: Geometry, values: Three, k: int, i: int) -> Number:
    """The derivative of number i of detector k's (psi, zeta, power), `values`, by the beam's power.

    A place depends on it where background light of power B at c_B falls on the detector: d psi / dP
    = (psi - c_B) B / (power P).
    """
    other = geometry.light.background[k]
    if i == 2:
        return (values[2] - other[0]) / geometry.power
    if other[0] == 0:
        return values[i] * 0
    return (values[i] - other[1 + i]) * other[0] / (values[2] * geometry.power)


def mirror_edges(normals: Three) -> Three:
    """The mirror's edges ca, ab, bc from the apex down (not of unit length).

    Edge number k is where facet k begins, counter-clockwise seen from above, so that facet k lies
    between edges k and k + 1.
    """
    a, b, c = normals
    return cross(a, c), cross(b, a), cross(c, b)


def project_to_sigmas(geometry: Geometry, v: Vector) -> Plane:
    """A vector of the world as seen along the beam, in units of the beam's sigma."""
    return dot(geometry.whitening[0], v), dot(geometry.whitening[1], v)


class Scene(NamedTuple):
    """A sensor at a state of Eq. (3): the pose of its mirror and the light on its facets.

    apex, place: positions of the mirror's apex and of the beam's centre at z = 0, mm.
    turn: the mirror's rotation, by rows.
    normals, edges: of the facets, in the world.
    q: the apex seen along the beam, from its centre, in sigmas.
    sides: the direction of each edge in that plane.  integrals: of each edge, see `wedge.sides`.
    moments: of the light on each facet, see `wedge.wedges`.
    """

    apex: Vector
    place: Vector
    turn: Matrix
    normals: Three
    edges: Three
    q: Plane
    sides: Three
    integrals: Three
    moments: Three


def scene(geometry: Geometry, state: tuple[Any, ...]) -> Scene:
    """The scene at a state of Eq. (3) with its light."""
    return illuminate(dark_scene(geometry, state))


def dark_scene(geometry: Geometry, state: tuple[Any, ...]) -> Scene:
    """The scene without light: its integrals and moments are zero."""
    tx, ty, tz, roll, pitch, yaw, bx, by = state
    apex, place = (tx, ty, tz), (bx, by, bx * 0)
    turn = rotation(roll, pitch, yaw)
    a, b, c = geometry.normals
    normals = rotate(turn, a), rotate(turn, b), rotate(turn, c)
    edge = mirror_edges(normals)
    q = project_to_sigmas(geometry, subtract(apex, place))
    u0 = unit_vector(project_to_sigmas(geometry, edge[0]))
    u1 = unit_vector(project_to_sigmas(geometry, edge[1]))
    u2 = unit_vector(project_to_sigmas(geometry, edge[2]))
    zero = tx * 0
    no_moments = zero, (zero, zero), (zero, zero, zero), (zero, zero)
    no_integrals = zero, zero, zero, zero
    sides = u0, u1, u2
    return Scene(
        apex,
        place,
        turn,
        normals,
        edge,
        q,
        sides,
        (no_integrals, no_integrals, no_integrals),
        (no_moments, no_moments, no_moments),
    )


def illuminate(at: Scene) -> Scene:
    """The scene with its light, without apertures."""
    q, (u0, u1, u2) = at.q, at.sides
    s0, s1, s2 = sides(q, at.sides)
    a, b, c = wedges(q, ((u0, u1, s0, s1), (u1, u2, s1, s2), (u2, u0, s2, s0)))
    return replace_light(at, (s0, s1, s2), (a, b, c))


def replace_light(at: Scene, integrals: Three, moments: Three) -> Scene:
    """The scene with other integrals and moments of its light."""
    return at._replace(integrals=integrals, moments=moments)


class LitFacet(NamedTuple):
    """One facet of a mirror at a state, its light, and the detector to which it reflects.

    geometry, at: the sensor and its scene.  k: number of the facet and of its detector.
    normal: of the facet, in the world.  edges: where the facet begins and where it ends,
    counter-clockwise seen from above.  sides, integrals: of these two edges, as in `Scene`.
    moments: of the light on the facet.  centre, axes: of the detector.
    """

    geometry: Geometry
    at: Scene
    k: int
    normal: Vector
    edges: tuple[Vector, Vector]
    sides: tuple[Plane, Plane]
    integrals: tuple[Side, Side]
    moments: Moments
    centre: Vector
    axes: Matrix


def mirror_facets(geometry: Geometry, at: Scene) -> tuple[LitFacet, LitFacet, LitFacet]:
    """The facets A, B and C in the light of a scene."""
    return (
        mirror_facet(geometry, at, 0),
        mirror_facet(geometry, at, 1),
        mirror_facet(geometry, at, 2),
    )


def mirror_facet(geometry: Geometry, at: Scene, k: int) -> LitFacet:
    """The facet k (0 to 2) in the light of a scene."""
    following = (k + 1) % 3
    return LitFacet(
        geometry=geometry,
        at=at,
        k=k,
        normal=at.normals[k],
        edges=(at.edges[k], at.edges[following]),
        sides=(at.sides[k], at.sides[following]),
        integrals=(at.integrals[k], at.integrals[following]),
        moments=at.moments[k],
        centre=geometry.centres[k],
        axes=geometry.axes[k],
    )


class Path(NamedTuple):
    """The central ray of a sub-beam: through `origin` in the beam, from `start` on the facet along
    `leaving` to its detector at the distance `length`; mm. `incidence`: beam . normal."""

    origin: Vector
    start: Vector
    leaving: Vector
    incidence: Number
    facing: Number
    length: Number


def path(facet: LitFacet) -> Path:
    """The path, mm, of the ray that carries the light's centroid from a facet to its detector.
    It is meaningless if the facet does not face the beam; `reading` is then NaN."""
    geometry, at, normal = facet.geometry, facet.at, facet.normal
    centroid = facet.moments[1]
    offset = combine(centroid[0], geometry.spread[0], centroid[1], geometry.spread[1])
    origin = add(at.place, offset)
    start = hit(origin, geometry.direction, at.apex, normal)
    leaving = reflect(geometry.direction, normal)
    return Path(
        origin=origin,
        start=start,
        leaving=leaving,
        incidence=dot(geometry.direction, normal),
        facing=dot(leaving, facet.axes[0]),
        length=flight(start, leaving, facet.centre, facet.axes),
    )


def reading(facet: LitFacet, ray: Path) -> Three:
    """The reading (psi, zeta, power) of a facet's detector, mm and mW; Eq. (9).

    NaN where the facet does not face the beam or its sub-beam does not get to the detector's plane.
    """
    psi, zeta = land(ray.start, ray.leaving, ray.length, facet.centre, facet.axes)
    power = facet.geometry.power * facet.moments[0]
    return (
        nan_unless_positive(psi, -ray.incidence, ray.facing, ray.length),
        nan_unless_positive(zeta, -ray.incidence, ray.facing, ray.length),
        nan_unless_positive(power, -ray.incidence, ray.facing, ray.length),
    )


def readings(geometry: Geometry, state: tuple[Any, ...]) -> tuple[Three, Three, Three]:
    """Eq. (1): (psi, zeta, power) of detectors A, B and C at a state of Eq. (3), nothing cut."""
    return scene_readings(geometry, scene(geometry, state))


def scene_readings(geometry: Geometry, at: Scene) -> tuple[Three, Three, Three]:
    """The readings (psi, zeta, power) of detectors A, B and C in a scene with its light."""
    a, b, c = mirror_facets(geometry, at)
    return reading(a, path(a)), reading(b, path(b)), reading(c, path(c))
