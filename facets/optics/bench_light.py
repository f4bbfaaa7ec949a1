"""Readings under the light of a bench, for any number type whose `moments` a scene holds.

Its wavefront may be curved (`curved_light`); the mirror's edges diffract, roll off or are lost, and
its tip is worn (`edge_light`); a coating reflects by incidence; other light comes from elsewhere.
Where more light is lost than there is, or the numbers are so large that first orders say so, the
readings are NaN.
"""

from __future__ import annotations

from typing import Any

from ..scalars.dispatch import Number, defined, pi
from .curved_light import bowed, curved, mirrored, ray_at, unbent
from .edge_light import Sum, at_point, beyond, push, step_across, streak, worn
from .effects import reflectances
from .forward import Geometry, Scene, Three, placed, shone_on
from .vectors import Vector, add, combine, cross, dot
from .wedge import Plane


def reflectance(geometry: Geometry, normal: Vector, direction: Vector) -> Number:
    """What a facet reflects, over what it does of unpolarised light at 45 degrees; by Fresnel."""
    light = geometry.light
    if not light.options.coated:
        return direction[0] * 0 + 1
    s, p = reflectances(light.coating, -dot(direction, normal))
    if not light.options.polarised:
        return (s + p) / light.plain
    across = cross(direction, normal)
    amplitude = dot(across, light.field)
    share = amplitude * amplitude / dot(across, across)
    return 2 * (share * s + (1 - share) * p) / light.plain


def with_background(spot: Plane, power: Number, other: Three) -> Three:
    """(psi, zeta, power) of a spot and other light, of given power and place."""
    whole = power + other[0]
    inverse = 1 / whole
    return (
        (spot[0] * power + other[0] * other[1]) * inverse,
        (spot[1] * power + other[0] * other[2]) * inverse,
        whole,
    )


def reading(
    geometry: Geometry, at: Scene, back: tuple[Any, Any, Any, Any], steps: Three, k: int
) -> Three:
    """Of detector k: (psi, zeta, power), mm and mW. NaN as in `forward.reading`."""
    following = (k + 1) % 3
    light = geometry.light
    image = mirrored(geometry, at, k)
    mass, centroid, moved = worn(geometry, at, back, steps, k)
    ray = ray_at(image, centroid)
    bow = bowed(image, ray, at.moments[k][2])
    centre = ray.spot[0] + bow[0], ray.spot[1] + bow[1]
    zero = mass * 0
    total = Sum(zero, (zero, zero))
    first, second = light.rolloff[k]
    step, after = steps[k], steps[following]
    circle = 2 * pi(mass)
    scatter = light.wavelength * image.path / (circle * circle)
    one, other = streak(image, step, scatter), streak(image, after, scatter)
    total = push(geometry, at, image, k, k, step, one, first, moved, total)
    total = push(geometry, at, image, k, following, after, other, -second, moved, total)
    total = beyond(geometry, image, one, centre, total)
    total = beyond(geometry, image, other, centre, total)
    streaks = one, other
    total = at_point(geometry, at, back, image, k, (step, after), streaks, scatter, centre, total)
    rest = defined(mass - total.lost, mass - total.lost, mass, ray.facing)
    share = 1 / rest
    spot = centre[0] + total.moment[0] * share, centre[1] + total.moment[1] * share
    bend = combine(centroid[0], light.fan[0], centroid[1], light.fan[1])
    direction = add(geometry.direction, bend)
    power = geometry.power * rest * reflectance(geometry, at.normals[k], direction)
    psi, zeta, whole = with_background(spot, power, light.background[k])
    incidence = -dot(direction, at.normals[k])
    return (
        defined(psi, incidence, ray.facing, image.path),
        defined(zeta, incidence, ray.facing, image.path),
        defined(whole, incidence, ray.facing, image.path),
    )


def readings_in(geometry: Geometry, at: Scene) -> tuple[Three, Three, Three]:
    """(psi, zeta, power) of detectors A, B and C in a scene from `curved` with the light in it."""
    back = unbent(geometry, at)
    steps = (
        step_across(geometry, at, back, 0),
        step_across(geometry, at, back, 1),
        step_across(geometry, at, back, 2),
    )
    return (
        reading(geometry, at, back, steps, 0),
        reading(geometry, at, back, steps, 1),
        reading(geometry, at, back, steps, 2),
    )


def scene(geometry: Geometry, state: tuple[Any, ...]) -> Scene:
    return shone_on(curved(geometry, placed(geometry, state)))


def readings(geometry: Geometry, state: tuple[Any, ...]) -> tuple[Three, Three, Three]:
    """Eq. (1) under the light of a bench: (psi, zeta, power) of detectors A, B and C."""
    return readings_in(geometry, scene(geometry, state))
