"""The sensor's 30 parameters, and the derivatives of the readings with respect to them.

The order, `PARAMETERS`: the beam's power, diameters, rotation and tilts; inclination and azimuth of
facets A, B, C; radius, azimuth, height, roll, pitch, yaw of detectors A, B, C. Units mm, rad, mW.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ..scalars.dispatch import Number, cos, sin
from .forward import Geometry, Path, Scene, Three, path, reading, scene
from .gradient import Gradient, gradient_in_world, gradient_of_angle, gradients
from .rays import gradient_of_beam, slant
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


def beam_turn_gradient(
    geometry: Geometry, at: Scene, k: int, ray: Path, along: Vector, gradient: Gradient
) -> Vector:
    """One reading's gradient with respect to a turn of the beam and its cross-section.

    along: the slanted axis of a landing coordinate; the zero vector for the power.
    """
    reach = dot(subtract(ray.start, ray.origin), geometry.direction)
    aim = gradient_of_beam(along, geometry.direction, at.normals[k], reach, ray.length)
    offset, apex = subtract(ray.origin, at.place), subtract(at.apex, at.place)
    turn = add(cross(geometry.direction, aim), cross(offset, gradient.origin))
    # Rotating the beam's axes rotates everything seen along it in the opposite direction.
    turn = add(turn, cross(gradient_in_world(geometry, gradient.q), apex))
    return subtract(turn, edge_turn_gradient(geometry, at, k, gradient))


def edge_turn_gradient(geometry: Geometry, at: Scene, k: int, gradient: Gradient) -> Vector:
    first, second = at.edges[k], at.edges[(k + 1) % 3]
    return combine(
        gradient.first,
        cross(first, gradient_of_angle(geometry, first)),
        gradient.second,
        cross(second, gradient_of_angle(geometry, second)),
    )


def sigma_derivatives(at: Scene, k: int, gradient: Gradient) -> tuple[Number, Number]:
    """One reading's derivatives with respect to the logarithms of the beam's two sigmas."""
    first, second = at.sides[k], at.sides[(k + 1) % 3]
    shear = gradient.first * first[0] * first[1] + gradient.second * second[0] * second[1]
    centroid = at.moments[k][1]
    return (
        gradient.centroid[0] * centroid[0] - gradient.q[0] * at.q[0] + shear,
        gradient.centroid[1] * centroid[1] - gradient.q[1] * at.q[1] - shear,
    )


def beam_derivatives(
    geometry: Geometry,
    at: Scene,
    k: int,
    ray: Path,
    along: Vector,
    gradient: Gradient,
    of_power: Number,
    axes: Axes,
) -> tuple[Any, ...]:
    """One reading's derivatives with respect to the beam's six parameters."""
    x, y = sigma_derivatives(at, k, gradient)
    turn = beam_turn_gradient(geometry, at, k, ray, along, gradient)
    return (
        of_power,
        x / axes.diameters[0],
        y / axes.diameters[1],
        -dot(turn, geometry.direction),
        dot(turn, axes.tilts[0]),
        dot(turn, axes.tilts[1]),
    )


def normal_gradients(
    geometry: Geometry, at: Scene, k: int, gradient: Gradient
) -> tuple[Any, Any, Any]:
    """One reading's gradients with respect to the normals of facets A, B and C, in the world."""
    before, after = (k + 2) % 3, (k + 1) % 3
    normal = at.normals[k]
    first = scale(gradient.first, gradient_of_angle(geometry, at.edges[k]))
    second = scale(gradient.second, gradient_of_angle(geometry, at.edges[after]))
    own = add(cross(at.normals[before], first), cross(second, at.normals[after]))
    own = add(own, gradient.normal)
    of_before, of_after = cross(first, normal), cross(normal, second)
    if k == 0:
        return own, of_after, of_before
    if k == 1:
        return of_before, own, of_after
    return of_after, of_before, own


def facet_derivatives(
    gradient: Vector, own: tuple[Vector, Vector], turn: tuple[Any, Any, Any]
) -> tuple[Number, Number]:
    """Derivatives by a facet's inclination and azimuth. own: of `Axes.facets`.  turn: the mirror's
    rotation, by rows."""
    return dot(gradient, rotate(turn, own[0])), dot(gradient, rotate(turn, own[1]))


def psd_derivatives(
    geometry: Geometry, k: int, along: Vector, landing: tuple[Any, Any], own: tuple[Any, ...]
) -> tuple[Any, ...]:
    """A landing coordinate's derivatives with respect to its detector's six parameters.

    along: its slanted axis.  landing: (psi, zeta) of the same spot.  own: of `Axes.psds`.
    """
    _, y, z = geometry.axes[k]
    outwards, around, roll_axis, pitch_axis, yaw_axis = own
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
    geometry: Geometry,
    axes: Axes,
    at: Scene,
    k: int,
    ray: Path,
    landing: tuple[Any, Any],
    along: Vector,
    gradient: Gradient,
    of_power: Number,
) -> tuple[Any, ...]:
    """The derivatives of one reading of detector k, in the order of `PARAMETERS`.

    along: the landing coordinate's slanted axis, zero for the power. of_power: the derivative by
    the beam's power.
    """
    of_normals = normal_gradients(geometry, at, k, gradient)
    of_facets = [facet_derivatives(of_normals[j], axes.facets[j], at.turn) for j in range(3)]
    of_psds: list[tuple[Any, ...]] = [(0.0,) * 6] * 3
    of_psds[k] = psd_derivatives(geometry, k, along, landing, axes.psds[k])
    of_beam = beam_derivatives(geometry, at, k, ray, along, gradient, of_power, axes)
    return (*of_beam, *(each for some in (*of_facets, *of_psds) for each in some))


def linearise_detector(geometry: Geometry, axes: Axes, at: Scene, k: int) -> tuple[Three, Three]:
    """Return (psi, zeta, power) of detector k and the thirty derivatives of each."""
    ray = path(geometry, at, k)
    psi, zeta, power = reading(geometry, at, k, ray)
    of_psi, of_zeta, of_power = gradients(geometry, at, k, ray)
    x, y, z = geometry.axes[k]
    mass = at.moments[k][0]
    zero = mass * 0
    nothing = (zero, zero, zero)
    along_y, along_z = slant(y, ray.leaving, x), slant(z, ray.leaving, x)
    spot = (psi, zeta)
    return (psi, zeta, power), (
        parameter_row(geometry, axes, at, k, ray, spot, along_y, of_psi, zero),
        parameter_row(geometry, axes, at, k, ray, spot, along_z, of_zeta, zero),
        parameter_row(geometry, axes, at, k, ray, spot, nothing, of_power, mass),
    )


def linearise(
    geometry: Geometry, axes: Axes, state: tuple[Any, ...]
) -> tuple[tuple[Three, Three], tuple[Three, Three], tuple[Three, Three]]:
    """Readings at a state and their derivatives by the parameters, for detectors A, B and C; for
    ideal light without apertures."""
    at = scene(geometry, state)
    return (
        linearise_detector(geometry, axes, at, 0),
        linearise_detector(geometry, axes, at, 1),
        linearise_detector(geometry, axes, at, 2),
    )
