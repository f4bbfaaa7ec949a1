"""Readings under real light, for any number type whose `moments` a scene holds.

The wavefront may be curved (`curved_light`) and the profile not Gaussian (`profile`); the mirror's
edges diffract, roll off or reflect nothing, and its tip is worn (`edge_light`); a coating reflects
by incidence; background light is added. Where the losses exceed the light, or the effects are too
large for first order, the readings are NaN.
"""

from __future__ import annotations

from typing import Any

from ..scalars.dispatch import Number, nan_unless_positive, pi
from .curved_light import (
    apparent_scene,
    back_projection,
    curvature_shift,
    detector_image,
    trace_ray,
)
from .edge_light import (
    FAINT,
    EdgeEffects,
    add_apex_loss,
    add_rolloff,
    add_streak_loss,
    edge_step,
    edge_streak,
    light_after_wear,
)
from .effects import reflectances
from .forward import Geometry, Scene, Three, dark_scene, illuminate
from .profile import apply_profile
from .vectors import Plane, Vector, add, combine, cross, dot


def reflectance(geometry: Geometry, normal: Vector, direction: Vector) -> Number:
    """The reflectance of a facet, relative to that of unpolarised light at 45 degrees; by
    Fresnel."""
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


def add_background(spot: Plane, power: Number, other: Three) -> Three:
    """The reading (psi, zeta, power) of a spot and background light of given power and place."""
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
    """Of detector k: (psi, zeta, power), mm and mW.

    NaN as in `forward.reading`, and where the edges' diffraction would take half of the light or
    more: `edge_light` is of first order in that share, and there gives a plausible place far inside
    of the detector for a spot on its edge.
    """
    following = (k + 1) % 3
    light = geometry.light
    image = detector_image(geometry, at, k)
    mass, centroid, moved = light_after_wear(geometry, at, back, steps, k)
    ray = trace_ray(image, centroid)
    bow = curvature_shift(image, ray, at.moments[k][2])
    centre = ray.spot[0] + bow[0], ray.spot[1] + bow[1]
    zero = mass * 0
    total = EdgeEffects(zero, (zero, zero))
    first, second = light.rolloff[k]
    step, after = steps[k], steps[following]
    circle = 2 * pi(mass)
    scatter = light.wavelength * image.path / (circle * circle)
    one, other = edge_streak(image, step, scatter), edge_streak(image, after, scatter)
    total = add_rolloff(geometry, at, image, k, k, step, one, first, moved, total)
    total = add_rolloff(geometry, at, image, k, following, after, other, -second, moved, total)
    total = add_streak_loss(geometry, image, one, centre, total)
    total = add_streak_loss(geometry, image, other, centre, total)
    streaks = one, other
    total = add_apex_loss(
        geometry, at, back, image, k, (step, after), streaks, scatter, centre, total
    )
    rest = mass - total.lost
    rest = nan_unless_positive(rest, rest - total.lost, mass - FAINT, ray.facing)
    share = 1 / rest
    spot = centre[0] + total.moment[0] * share, centre[1] + total.moment[1] * share
    bend = combine(centroid[0], light.fan[0], centroid[1], light.fan[1])
    direction = add(geometry.direction, bend)
    power = geometry.power * rest * reflectance(geometry, at.normals[k], direction)
    psi, zeta, whole = add_background(spot, power, light.background[k])
    incidence = -dot(direction, at.normals[k])
    return (
        nan_unless_positive(psi, incidence, ray.facing, image.path),
        nan_unless_positive(zeta, incidence, ray.facing, image.path),
        nan_unless_positive(whole, incidence, ray.facing, image.path),
    )


def scene_readings(geometry: Geometry, at: Scene) -> tuple[Three, Three, Three]:
    """(psi, zeta, power) of detectors A, B and C in a scene from `curved` with the light in it."""
    back = back_projection(geometry, at)
    at = apply_profile(geometry, at)
    steps = (
        edge_step(geometry, at, back, 0),
        edge_step(geometry, at, back, 1),
        edge_step(geometry, at, back, 2),
    )
    return (
        reading(geometry, at, back, steps, 0),
        reading(geometry, at, back, steps, 1),
        reading(geometry, at, back, steps, 2),
    )


def scene(geometry: Geometry, state: tuple[Any, ...]) -> Scene:
    return illuminate(apparent_scene(geometry, dark_scene(geometry, state)))


def readings(geometry: Geometry, state: tuple[Any, ...]) -> tuple[Three, Three, Three]:
    """Eq. (1) under the light of a bench: (psi, zeta, power) of detectors A, B and C."""
    return scene_readings(geometry, scene(geometry, state))
