"""The sensor's 30 parameters, and the derivatives of the readings with respect to them.

The order, `PARAMETERS`: the beam's power, diameters, rotation and tilts; inclination and azimuth of
facets A, B, C; radius, azimuth, height, roll, pitch, yaw of detectors A, B, C. Units mm, rad, mW.
"""

from __future__ import annotations

from typing import Any

from ..scalars.dispatch import Number, cos, sin
from .forward import Geometry, Path, Scene, path, reading
from .gradient import Gradient, gradient_of_angle, gradients, in_world
from .rays import gradient_of_beam, slanted
from .vectors import (
    Vector,
    add,
    combine,
    cross,
    dot,
    rotate,
    rotation,
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


def turn_of_beam(
    geometry: Geometry, at: Scene, k: int, ray: Path, along: Vector, gradient: Gradient
) -> Vector:
    """One reading's gradient with respect to a turn of the beam and its cross-section.

    along: the slanted axis of a landing coordinate; the zero vector for the power.
    """
    reach = dot(subtract(ray.start, ray.origin), geometry.direction)
    aim = gradient_of_beam(along, geometry.direction, at.normals[k], reach, ray.length)
    offset, apex = subtract(ray.origin, at.place), subtract(at.apex, at.place)
    turn = add(cross(geometry.direction, aim), cross(offset, gradient.origin))
    # turning the beam's axes turns what is seen along it the other way
    turn = add(turn, cross(in_world(geometry, gradient.q), apex))
    return subtract(turn, turn_of_edges(geometry, at, k, gradient))


def turn_of_edges(geometry: Geometry, at: Scene, k: int, gradient: Gradient) -> Vector:
    first, second = at.edges[k], at.edges[(k + 1) % 3]
    return combine(
        gradient.first,
        cross(first, gradient_of_angle(geometry, first)),
        gradient.second,
        cross(second, gradient_of_angle(geometry, second)),
    )


def by_sigmas(at: Scene, k: int, gradient: Gradient) -> tuple[Number, Number]:
    """One reading's derivatives with respect to the logarithms of the beam's two sigmas."""
    first, second = at.sides[k], at.sides[(k + 1) % 3]
    shear = gradient.first * first[0] * first[1] + gradient.second * second[0] * second[1]
    centroid = at.moments[k][1]
    return (
        gradient.centroid[0] * centroid[0] - gradient.q[0] * at.q[0] + shear,
        gradient.centroid[1] * centroid[1] - gradient.q[1] * at.q[1] - shear,
    )


def by_beam(
    geometry: Geometry,
    at: Scene,
    k: int,
    ray: Path,
    along: Vector,
    gradient: Gradient,
    of_power: Number,
    parameters: tuple[Any, ...],
) -> tuple[Any, ...]:
    """One reading's derivatives with respect to the beam's six parameters."""
    x, y = by_sigmas(at, k, gradient)
    turn = turn_of_beam(geometry, at, k, ray, along, gradient)
    tilt_x, tilt_y, _ = rotation_axes(parameters[5], parameters[5] * 0)
    return (
        of_power,
        x / parameters[1],
        y / parameters[2],
        -dot(turn, geometry.direction),
        dot(turn, tilt_x),
        dot(turn, tilt_y),
    )


def by_normals(geometry: Geometry, at: Scene, k: int, gradient: Gradient) -> tuple[Any, Any, Any]:
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


def by_facet(
    gradient: Vector, inclination: Number, azimuth: Number, turn: tuple[Any, Any, Any]
) -> tuple[Number, Number]:
    """Derivatives by a facet's inclination and azimuth. turn: the mirror's rotation, by rows."""
    ci, si = cos(inclination), sin(inclination)
    ca, sa = cos(azimuth), sin(azimuth)
    tipped = rotate(turn, (ci * ca, ci * sa, -si))
    swung = rotate(turn, (-si * sa, si * ca, si * 0))
    return dot(gradient, tipped), dot(gradient, swung)


def by_psd(
    geometry: Geometry,
    k: int,
    along: Vector,
    landing: tuple[Any, Any],
    psd: tuple[Any, ...],
) -> tuple[Any, ...]:
    """A landing coordinate's derivatives with respect to its detector's six parameters.

    along: its slanted axis; landing: (psi, zeta) of the same spot.
    """
    _, azimuth, _, _, pitch, yaw = psd
    ca, sa = cos(azimuth), sin(azimuth)
    _, y, z = geometry.axes[k]
    turn = cross(along, combine(landing[0], y, landing[1], z))
    roll_axis, pitch_axis, yaw_axis = rotation_axes(pitch, azimuth + yaw)
    moved = scale(-1, along)
    sideways = psd[0] * (ca * moved[1] - sa * moved[0])
    return (
        ca * moved[0] + sa * moved[1],
        sideways + dot(turn, yaw_axis),
        moved[2],
        dot(turn, roll_axis),
        dot(turn, pitch_axis),
        dot(turn, yaw_axis),
    )


def by_parameters(
    geometry: Geometry,
    parameters: tuple[Any, ...],
    at: Scene,
    k: int,
    ray: Path,
    landing: tuple[Any, Any],
    along: Vector,
    gradient: Gradient,
    of_power: Number,
    mirror: tuple[Any, Any, Any],
) -> tuple[Any, ...]:
    """One reading of detector k: its derivatives by beam (6), facets (6) and detector k (6).

    along: the landing coordinate's slanted axis, zero for the power. of_power: the derivative by
    the beam's power. mirror: the mirror's rotation, by rows.
    """
    of_beam = by_beam(geometry, at, k, ray, along, gradient, of_power, parameters)
    of_a, of_b, of_c = by_normals(geometry, at, k, gradient)
    start = 12 + 6 * k
    return (
        of_beam,
        by_facet(of_a, parameters[6], parameters[7], mirror),
        by_facet(of_b, parameters[8], parameters[9], mirror),
        by_facet(of_c, parameters[10], parameters[11], mirror),
        by_psd(
            geometry,
            k,
            along,
            landing,
            (
                parameters[start],
                parameters[start + 1],
                parameters[start + 2],
                parameters[start + 3],
                parameters[start + 4],
                parameters[start + 5],
            ),
        ),
    )


def detector_by_parameters(
    geometry: Geometry, parameters: tuple[Any, ...], state: tuple[Any, ...], at: Scene, k: int
) -> tuple[tuple[Any, Any, Any], tuple[Any, ...]]:
    """(psi, zeta, power) of detector k, and what `by_parameters` gives for each."""
    ray = path(geometry, at, k)
    psi, zeta, power = reading(geometry, at, k, ray)
    of_psi, of_zeta, of_power = gradients(geometry, at, k, ray)
    x, y, z = geometry.axes[k]
    mirror = rotation(state[3], state[4], state[5])
    mass = at.moments[k][0]
    zero = mass * 0
    nothing = (zero, zero, zero)
    along_y, along_z = slanted(y, ray.leaving, x), slanted(z, ray.leaving, x)
    spot = (psi, zeta)
    return (psi, zeta, power), (
        by_parameters(geometry, parameters, at, k, ray, spot, along_y, of_psi, zero, mirror),
        by_parameters(geometry, parameters, at, k, ray, spot, along_z, of_zeta, zero, mirror),
        by_parameters(geometry, parameters, at, k, ray, spot, nothing, of_power, mass, mirror),
    )
