"""Readings under real light, for any number type whose `moments` a scene holds.

The wavefront may be curved (`curved_light`) and the profile not Gaussian (`profile`). The mirror's
edges diffract, roll off or reflect nothing, and its tip is worn (`edge_light`). The reflectance of
a coating depends on the angle of incidence, and background light is added. Readings are NaN where
the losses exceed the light, or the effects are too large for a first-order treatment.
"""

from __future__ import annotations

from typing import Any

from ..scalars.dispatch import Number, holds_anywhere, nan_unless_positive, pi, select
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
    ImagedSpot,
    add_apex_loss,
    add_rolloff,
    add_streak_loss,
    edge_step,
    edge_streak,
    light_after_wear,
)
from .effects import reflectances
from .forward import Geometry, LitFacet, Scene, Three, dark_scene, illuminate, mirror_facets
from .profile import apply_profile
from .vectors import Plane, Vector, add, combine, cross, dot


def reflectance(geometry: Geometry, normal: Vector, direction: Vector) -> Number:
    """The reflectance of a facet by Fresnel's equations, relative to the reflectance of unpolarised
    light at 45 degrees."""
    light, options, unit = geometry.light, geometry.light.options, direction[0] * 0 + 1
    if not holds_anywhere(options.coated):
        return unit
    s, p = reflectances(light.coating, -dot(direction, normal))
    mean = (s + p) / light.plain
    if not holds_anywhere(options.polarised):
        return select(options.coated, mean, unit)
    across = cross(direction, normal)
    amplitude = dot(across, light.field)
    fraction = amplitude * amplitude / dot(across, across)
    polarised = 2 * (fraction * s + (1 - fraction) * p) / light.plain
    return select(options.coated, select(options.polarised, polarised, mean), unit)


def add_background(spot: Plane, power: Number, other: Three) -> Three:
    """The reading (psi, zeta, power) of a spot together with background light.

    other: power (mW) and place (mm) of the background light.
    """
    total = power + other[0]
    inverse = 1 / total
    return (
        (spot[0] * power + other[0] * other[1]) * inverse,
        (spot[1] * power + other[0] * other[2]) * inverse,
        total,
    )


def reading(facet: LitFacet, back: tuple[Any, Any, Any, Any], steps: Three) -> Three:
    """The reading (psi, zeta, power) of a facet's detector, mm and mW.

    back: from `back_projection`.  steps: from `edge_step`, for each of the mirror's edges.

    NaN as in `forward.reading`, and where the edges' diffraction would take half of the light or
    more. `edge_light` is of first order in that fraction, and would give a plausible place far
    inside the detector for a spot on the detector's edge.
    """
    geometry, light = facet.geometry, facet.geometry.light
    image = detector_image(facet)
    both = steps[facet.k], steps[(facet.k + 1) % 3]
    mass, centroid, moved = light_after_wear(facet, back, both)
    ray = trace_ray(image, centroid)
    bow = curvature_shift(image, ray, facet.moments[2])
    centre = ray.spot[0] + bow[0], ray.spot[1] + bow[1]
    zero = mass * 0
    total = EdgeEffects(zero, (zero, zero))
    circle = 2 * pi(mass)
    scatter = light.wavelength * image.path / (circle * circle)
    spot = ImagedSpot(facet, image, centre, scatter)
    streaks = edge_streak(spot, both[0]), edge_streak(spot, both[1])
    total = add_rolloff(spot, streaks[0], moved, 0, total)
    total = add_rolloff(spot, streaks[1], moved, 1, total)
    total = add_streak_loss(spot, streaks[0], total)
    total = add_streak_loss(spot, streaks[1], total)
    total = add_apex_loss(spot, streaks, back, total)
    rest = mass - total.lost
    rest = nan_unless_positive(rest, rest - total.lost, mass - FAINT, ray.facing)
    inverse = 1 / rest
    place = centre[0] + total.moment[0] * inverse, centre[1] + total.moment[1] * inverse
    bend = combine(centroid[0], light.fan[0], centroid[1], light.fan[1])
    direction = add(geometry.direction, bend)
    power = geometry.power * rest * reflectance(geometry, facet.normal, direction)
    psi, zeta, detected = add_background(place, power, light.background[facet.k])
    incidence = -dot(direction, facet.normal)
    return (
        nan_unless_positive(psi, incidence, ray.facing, image.path),
        nan_unless_positive(zeta, incidence, ray.facing, image.path),
        nan_unless_positive(detected, incidence, ray.facing, image.path),
    )


def scene_readings(geometry: Geometry, at: Scene) -> tuple[Three, Three, Three]:
    """The readings (psi, zeta, power) of detectors A, B and C in a scene from `apparent_scene` with
    its light."""
    back = back_projection(geometry, at)
    at = apply_profile(geometry, at)
    steps = (
        edge_step(geometry, at, back, 0),
        edge_step(geometry, at, back, 1),
        edge_step(geometry, at, back, 2),
    )
    a, b, c = mirror_facets(geometry, at)
    return reading(a, back, steps), reading(b, back, steps), reading(c, back, steps)


def scene(geometry: Geometry, state: tuple[Any, ...]) -> Scene:
    """The scene at a state with its light, as seen from the light's source."""
    return illuminate(apparent_scene(geometry, dark_scene(geometry, state)))
