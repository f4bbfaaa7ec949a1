"""The sensor's 30 parameters, and the derivatives of the readings with respect to them.

The order, `PARAMETERS`: the beam's power, diameters, rotation and tilts; inclination and azimuth of
facets A, B, C; radius, azimuth, height, roll, pitch, yaw of detectors A, B, C. Units mm, rad, mW.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ..scalars.dispatch import Number, cos, sin
from .forward import Geometry, LitFacet, Path, Three, mirror_facets, path, reading, scene
from .gradient import Gradient, gradient_in_world, gradient_of_angle, gradients
from .rays import gradient_of_beam
from .vectors import (
    Vector,
    add,
    combine,
    cross,
    dot,
    rotate,
    rotation_axes,
    scale,
    subtract,
)

BEAM = ("power", "diameter_x", "diameter_y", "rotation", "tilt_x", "tilt_y")
FACET = ("inclination", "azimuth")
PSD = ("radius", "azimuth", "height", "roll", "pitch", "yaw")
PARAMETERS = (
    *(f"beam.{name}" for name in BEAM),
    *(f"facet_{letter}.{name}" for letter in "abc" for name in FACET),
    *(f"psd_{letter}.{name}" for letter in "abc" for name in PSD),
)


class Axes(NamedTuple):
    """The derivatives of the sensor's vectors by its parameters.

    diameters: of the beam, mm.  tilts: the axes about which its two tilts turn it, in the world.
    facets: for each, the derivatives of its normal by inclination and azimuth, in the mirror's
    frame.  psds: for each, the derivatives of its centre by radius and azimuth, and the axes of its
    roll, pitch and yaw, in the world.
    """

    diameters: tuple[Any, Any]
    tilts: tuple[Vector, Vector]
    facets: Three
    psds: Three


def parameter_axes(parameters: tuple[Any, ...]) -> Axes:
    tilt_x, tilt_y, _ = rotation_axes(parameters[5], parameters[5] * 0)
    a, b, c = (axes_of_facet(*parameters[k : k + 2]) for k in (6, 8, 10))
    d, e, f = (axes_of_psd(parameters[k : k + 6]) for k in (12, 18, 24))
    return Axes((parameters[1], parameters[2]), (tilt_x, tilt_y), (a, b, c), (d, e, f))


def axes_of_facet(inclination: Number, azimuth: Number) -> tuple[Vector, Vector]:
    ci, si = cos(inclination), sin(inclination)
    ca, sa = cos(azimuth), sin(azimuth)
    return (ci * ca, ci * sa, -si), (-si * sa, si * ca, si * 0)


def axes_of_psd(psd: tuple[Any, ...]) -> tuple[Vector, Vector, Vector, Vector, Vector]:
    radius, azimuth, _, _, pitch, yaw = psd
    ca, sa = cos(azimuth), sin(azimuth)
    roll_axis, pitch_axis, yaw_axis = rotation_axes(pitch, azimuth + yaw)
    zero = radius * 0
    return (ca, sa, zero), (-radius * sa, radius * ca, zero), roll_axis, pitch_axis, yaw_axis


def beam_turn_gradient(facet: LitFacet, ray: Path, gradient: Gradient) -> Vector:
    """One reading's gradient with respect to a turn of the beam and its cross-section."""
    geometry, at = facet.geometry, facet.at
    reach = dot(subtract(ray.start, ray.origin), geometry.direction)
    aim = gradient_of_beam(gradient.along, geometry.direction, facet.normal, reach, ray.length)
    offset, apex = subtract(ray.origin, at.place), subtract(at.apex, at.place)
    turn = add(cross(geometry.direction, aim), cross(offset, gradient.origin))
    # Rotating the beam's axes rotates everything seen along it in the opposite direction.
    turn = add(turn, cross(gradient_in_world(geometry, gradient.q), apex))
    return subtract(turn, edge_turn_gradient(facet, gradient))


def edge_turn_gradient(facet: LitFacet, gradient: Gradient) -> Vector:
    """One reading's gradient with respect to a turn of the mirror's edges about the apex."""
    first, second = facet.edges
    return combine(
        gradient.first,
        cross(first, gradient_of_angle(facet.geometry, first)),
        gradient.second,
        cross(second, gradient_of_angle(facet.geometry, second)),
    )


def sigma_derivatives(facet: LitFacet, gradient: Gradient) -> tuple[Number, Number]:
    """One reading's derivatives with respect to the logarithms of the beam's two sigmas."""
    first, second = facet.sides
    shear = gradient.first * first[0] * first[1] + gradient.second * second[0] * second[1]
    centroid, q = facet.moments[1], facet.at.q
    return (
        gradient.centroid[0] * centroid[0] - gradient.q[0] * q[0] + shear,
        gradient.centroid[1] * centroid[1] - gradient.q[1] * q[1] - shear,
    )


def beam_derivatives(
    facet: LitFacet, axes: Axes, ray: Path, gradient: Gradient, of_power: Number
) -> tuple[Any, ...]:
    """One reading's derivatives with respect to the beam's six parameters."""
    x, y = sigma_derivatives(facet, gradient)
    turn = beam_turn_gradient(facet, ray, gradient)
    return (
        of_power,
        x / axes.diameters[0],
        y / axes.diameters[1],
        -dot(turn, facet.geometry.direction),
        dot(turn, axes.tilts[0]),
        dot(turn, axes.tilts[1]),
    )


def normal_gradients(facet: LitFacet, gradient: Gradient) -> tuple[Any, Any, Any]:
    """One reading's gradients with respect to the normals of facets A, B and C, in the world."""
    normals, normal, k = facet.at.normals, facet.normal, facet.k
    first = scale(gradient.first, gradient_of_angle(facet.geometry, facet.edges[0]))
    second = scale(gradient.second, gradient_of_angle(facet.geometry, facet.edges[1]))
    of_edges = add(cross(normals[(k + 2) % 3], first), cross(second, normals[(k + 1) % 3]))
    of_normal = add(of_edges, gradient.normal)
    of_before, of_after = cross(first, normal), cross(normal, second)
    if k == 0:
        return of_normal, of_after, of_before
    if k == 1:
        return of_before, of_normal, of_after
    return of_after, of_before, of_normal


def facet_derivatives(
    gradient: Vector, changes: tuple[Vector, Vector], turn: tuple[Any, Any, Any]
) -> tuple[Number, Number]:
    """One reading's derivatives with respect to a facet's inclination and azimuth.

    gradient: with respect to the facet's normal, in the world.  changes: of that normal, see
    `Axes.facets`.  turn: the mirror's rotation, by rows.
    """
    return dot(gradient, rotate(turn, changes[0])), dot(gradient, rotate(turn, changes[1]))


def psd_derivatives(
    facet: LitFacet, along: Vector, landing: tuple[Any, Any], changes: tuple[Any, ...]
) -> tuple[Any, ...]:
    """A landing coordinate's derivatives with respect to its detector's six parameters.

    along: its slanted axis.  landing: (psi, zeta) of the same spot.  changes: of the detector, see
    `Axes.psds`.
    """
    _, y, z = facet.axes
    outwards, around, roll_axis, pitch_axis, yaw_axis = changes
    turn = cross(along, combine(landing[0], y, landing[1], z))
    moved = scale(-1, along)
    yawed = dot(turn, yaw_axis)
    return (
        dot(moved, outwards),
        dot(moved, around) + yawed,
        moved[2],
        dot(turn, roll_axis),
        dot(turn, pitch_axis),
        yawed,
    )


def parameter_row(
    facet: LitFacet,
    axes: Axes,
    ray: Path,
    landing: tuple[Any, Any],
    gradient: Gradient,
    of_power: Number,
) -> tuple[Any, ...]:
    """The derivatives of one reading of a facet's detector, in the order of `PARAMETERS`.

    landing: (psi, zeta) of its spot.  of_power: the derivative by the beam's power.
    """
    of_normals = normal_gradients(facet, gradient)
    of_facets = [facet_derivatives(of_normals[j], axes.facets[j], facet.at.turn) for j in range(3)]
    of_psds: list[tuple[Any, ...]] = [(0.0,) * 6] * 3
    of_psds[facet.k] = psd_derivatives(facet, gradient.along, landing, axes.psds[facet.k])
    of_beam = beam_derivatives(facet, axes, ray, gradient, of_power)
    return (*of_beam, *(each for some in (*of_facets, *of_psds) for each in some))


def linearise_detector(facet: LitFacet, axes: Axes) -> tuple[Three, Three]:
    """Return (psi, zeta, power) of a facet's detector and the thirty derivatives of each."""
    ray = path(facet)
    psi, zeta, power = reading(facet, ray)
    of_psi, of_zeta, of_power = gradients(facet, ray)
    mass = facet.moments[0]
    zero, spot = mass * 0, (psi, zeta)
    return (psi, zeta, power), (
        parameter_row(facet, axes, ray, spot, of_psi, zero),
        parameter_row(facet, axes, ray, spot, of_zeta, zero),
        parameter_row(facet, axes, ray, spot, of_power, mass),
    )


def linearise(
    geometry: Geometry, axes: Axes, state: tuple[Any, ...]
) -> tuple[tuple[Three, Three], tuple[Three, Three], tuple[Three, Three]]:
    """Readings at a state and their derivatives by the parameters, for detectors A, B and C; for
    ideal light without apertures."""
    a, b, c = mirror_facets(geometry, scene(geometry, state))
    return linearise_detector(a, axes), linearise_detector(b, axes), linearise_detector(c, axes)
