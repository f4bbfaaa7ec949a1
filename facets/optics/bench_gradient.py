"""Derivatives of the readings by forward differentiation of their formulas (`scalars.dual`).

Under real light these derivatives are exact. Only the light on a facet is not differentiated in
this way, because it has closed derivatives (`light_with_slope`). An iteration can use a faster
Jacobian, which neglects changes of the edges' effects (`linearise_nearly`).

A derivative is a number, or an array by all variables, in the units of `forward` per unit of its
variable: mm, rad, mW or a fraction.
"""

from __future__ import annotations

from typing import Any

from ..scalars.dispatch import Number, maximum, select
from ..scalars.dual import Dual, value_and_slope
from .bench_light import scene, scene_readings
from .central import Side
from .curved_light import apparent_scene, apply, back_projection
from .forward import (
    Geometry,
    LitFacet,
    Scene,
    Three,
    dark_scene,
    mirror_facets,
    path,
    replace_light,
    scene_readings as ideal_readings,
)
from .gradient import Gradient, edge_turns, gradients, state_row
from .profile import apply_profile, moment_slopes
from .vectors import Matrix, Plane, Vector, add, combine, cross2, dot, dot2, rotation_axes, subtract
from .wedge import Moments, Pair, closed_moments, turn_derivative

#: A number's derivatives by the eight components of a state.
Row = tuple[Any, ...]

#: Fraction of the beam's light on a facet below which rounding hides the change of the light's
#: covariance, which is then set to zero.
DIM = 0.01


def side_with_slope(q: Plane, u: Plane, side: Side) -> Side:
    """One of the integrals of `wedge.sides`, with the derivatives that q and u carry.

    With a = q.u and h = q x u: dL = -f da - h L dh, dK = -L da - h K dh, dJ = -2 K da - h J dh.
    """
    a, h = dot2(q, u), cross2(q, u)
    length, first, second, swept = side
    density = first + a.real * length
    da, dh = a.imag, h.real * h.imag
    return (
        Dual(length, -density * da - length * dh),
        Dual(first, -length * da - first * dh),
        Dual(second, -2 * first * da - second * dh),
        Dual(swept, 0.0),
    )


def angle_slope(u: Plane) -> Number:
    """The rate at which a unit vector that carries a derivative turns, rad."""
    return u[0].real * u[1].imag - u[1].real * u[0].imag


def moments_with_slope(
    q: Plane, pair: Pair, integrals: tuple[Side, Side], moments: Moments
) -> Moments:
    """The moments of one of `wedge.wedges`, with the derivatives that q and the pair carry.

    integrals, moments: their values, without derivatives.
    """
    mass, (cx, cy), (pxx, pxy, pyy), _ = moments
    of_mass, of_x, of_y = wedge_slopes(q, pair[:2], integrals, moments)
    light_mass, x, y = Dual(mass, of_mass), Dual(cx, of_x), Dual(cy, of_y)
    of_xx, of_xy, of_yy = covariance_slope(q, pair, light_mass)
    shift = Dual(pxx, of_xx), Dual(pxy, of_xy), Dual(pyy, of_yy)
    return light_mass, (x, y), shift, (x - q[0], y - q[1])


def wedge_slopes(
    q: Plane, sides: tuple[Plane, Plane], integrals: tuple[Side, Side], moments: Moments
) -> Three:
    """The derivatives of a wedge's mass and centroid, by the variables of q and the sides.

    integrals, moments: without derivatives.
    """
    mass, (cx, cy), (pxx, pxy, pyy), from_point = moments
    (u1, u2), (real1, real2) = sides, integrals
    qx, qy, turn1, turn2 = q[0].imag, q[1].imag, angle_slope(u1), angle_slope(u2)
    mass1, (x1, y1) = turn_derivative((u1[0].real, u1[1].real), real1, mass, from_point)
    mass2, (x2, y2) = turn_derivative((u2[0].real, u2[1].real), real2, mass, from_point)
    return (
        -mass * (cx * qx + cy * qy) - mass1 * turn1 + mass2 * turn2,
        pxx * qx + pxy * qy - x1 * turn1 + x2 * turn2,
        pxy * qx + pyy * qy - y1 * turn1 + y2 * turn2,
    )


def covariance_slope(q: Plane, pair: Pair, mass: Number) -> Three:
    """The derivative of one minus the light's covariance, as xx, xy, yy; 0 where the mass of the
    light is below DIM."""
    lit, some = mass.real > DIM, Dual(maximum(mass.real, DIM), mass.imag)
    xx, xy, yy = (each.imag for each in closed_moments(q, *pair, some)[2])
    return select(lit, xx, 0.0), select(lit, xy, 0.0), select(lit, yy, 0.0)


def light_with_slope(to: Scene, at: Scene) -> Scene:
    """Add the light to the scene `to`, whose numbers carry derivatives.

    at: the scene of the same state with its light, without derivatives.
    """
    q, (u0, u1, u2), (r0, r1, r2) = to.q, to.sides, at.integrals
    s0, s1, s2 = side_with_slope(q, u0, r0), side_with_slope(q, u1, r1), side_with_slope(q, u2, r2)
    on_a = moments_with_slope(q, (u0, u1, s0, s1), (r0, r1), at.moments[0])
    on_b = moments_with_slope(q, (u1, u2, s1, s2), (r1, r2), at.moments[1])
    on_c = moments_with_slope(q, (u2, u0, s2, s0), (r2, r0), at.moments[2])
    return replace_light(to, (s0, s1, s2), (on_a, on_b, on_c))


def reading_slopes(
    geometry: Geometry, state: tuple[Any, ...], at: Scene
) -> tuple[Three, Three, Three]:
    """The readings' derivatives by the variables by which geometry or state carry derivatives.

    at: the scene with its light from `bench_light.scene`, without derivatives.
    """
    a, b, c = scene_readings(
        geometry, light_with_slope(apparent_scene(geometry, dark_scene(geometry, state)), at)
    )
    return slopes_of_detector(a), slopes_of_detector(b), slopes_of_detector(c)


def ideal_slopes(
    geometry: Geometry, state: tuple[Any, ...], at: Scene
) -> tuple[Three, Three, Three]:
    """The derivatives of `reading_slopes` under ideal light.

    at: the scene from `forward.scene`, without derivatives.
    """
    a, b, c = ideal_readings(geometry, light_with_slope(dark_scene(geometry, state), at))
    return slopes_of_detector(a), slopes_of_detector(b), slopes_of_detector(c)


def slopes_of_detector(values: Three) -> Three:
    """The derivatives of psi, zeta and power; 0 for one that depends on no variable."""
    return (
        value_and_slope(values[0])[1],
        value_and_slope(values[1])[1],
        value_and_slope(values[2])[1],
    )


def linearise_nearly(
    geometry: Geometry, state: tuple[Any, ...]
) -> tuple[tuple[Three, Three], tuple[Three, Three], tuple[Three, Three]]:
    """Exact readings, and a Jacobian that neglects changes of the edges' effects.

    It is for the steps of an iteration and for uncertainties, and some ten times faster than exact
    derivatives. It is exact for a curved wavefront, and accurate to some per cent where spots are
    near the edge of a detector.
    """
    at = scene(geometry, state)
    back = back_projection(geometry, at)
    values = scene_readings(geometry, at)
    at = apply_profile(geometry, at)
    whitening = apparent_axes(geometry, at, back)
    turns = edge_turns(geometry._replace(whitening=whitening), at)
    axes = rotation_axes(state[4], state[5])
    a, b, c = mirror_facets(geometry, at)
    return (
        (values[0], approximate_rows(a, whitening, turns, axes, values[0])),
        (values[1], approximate_rows(b, whitening, turns, axes, values[1])),
        (values[2], approximate_rows(c, whitening, turns, axes, values[2])),
    )


def apparent_axes(
    geometry: Geometry, at: Scene, back: tuple[Any, Any, Any, Any]
) -> tuple[Vector, Vector]:
    """The rows of the matrix that converts a small step of the apex to the step of q, in sigmas,
    and an edge to its direction as seen from the light's source."""
    bent = apply(geometry.light.bend, at.q)
    x = combine(1, geometry.whitening[0], -bent[0], geometry.direction)
    y = combine(1, geometry.whitening[1], -bent[1], geometry.direction)
    return combine(back[0], x, back[1], y), combine(back[2], x, back[3], y)


def approximate_rows(
    facet: LitFacet, whitening: tuple[Vector, Vector], turns: Three, axes: Matrix, values: Three
) -> Three:
    """The derivatives of a detector's readings by the state, with constant effects of the edges.

    whitening: from `apparent_axes`.  turns, axes: as for `state_row`.  values: the readings.

    They are the derivatives under a beam whose rays are all parallel to the ray of the centroid.
    Diverging rays land as parallel rays do that are further apart, by the divergence over the path.
    """
    geometry, light = facet.geometry, facet.geometry.light
    background = light.background[facet.k]
    mass, centroid, _, _ = facet.moments
    power = (values[2] - background[0]) / mass
    bend = combine(centroid[0], light.fan[0], centroid[1], light.fan[1])
    direction = add(geometry.direction, bend)
    parallel = geometry._replace(direction=direction, power=power, whitening=whitening)
    ray = path(facet._replace(geometry=parallel))
    reach = dot(subtract(ray.start, ray.origin), direction) + ray.length
    spread = (
        combine(1, geometry.spread[0], reach, light.fan[0]),
        combine(1, geometry.spread[1], reach, light.fan[1]),
    )
    facet_lit = facet._replace(geometry=parallel._replace(spread=spread))
    of_psi, of_zeta, of_power = gradients(facet_lit, ray)
    if light.options.profiled:
        decline, slopes = moment_slopes(facet)
        of_psi, of_zeta = apex_gradient(of_psi, slopes), apex_gradient(of_zeta, slopes)
        of_power = of_power._replace(q=(-power * mass * decline[0], -power * mass * decline[1]))
    return add_background_to_rows(
        values,
        background,
        state_row(facet_lit, of_psi, turns, axes),
        state_row(facet_lit, of_zeta, turns, axes),
        state_row(facet_lit, of_power, turns, axes),
    )


def apex_gradient(gradient: Gradient, slopes: tuple[Any, Any, Any, Any]) -> Gradient:
    """The gradient of a landing coordinate where the beam is not Gaussian.

    slopes: of the centroid, see `moment_slopes`.
    """
    (x, y), (xx, xy, yx, yy) = gradient.centroid, slopes
    return gradient._replace(q=(x * xx + y * yx, x * xy + y * yy))


def add_background_to_rows(
    values: Three, other: Three, of_psi: Row, of_zeta: Row, of_power: Row
) -> Three:
    """The eight derivatives of each of a detector's readings, from those of its spot alone.

    values: (psi, zeta, power) including the background light.  other: power and place of the
    background.
    """
    inverse = 1 / values[2]
    fraction = (values[2] - other[0]) * inverse
    pull = other[0] * inverse / (values[2] - other[0])
    return (
        add_background_to_row(of_psi, of_power, fraction, (values[0] - other[1]) * pull),
        add_background_to_row(of_zeta, of_power, fraction, (values[1] - other[2]) * pull),
        of_power,
    )


def add_background_to_row(of_place: Row, of_power: Row, fraction: Number, lever: Number) -> Row:
    """Scale the derivatives of a place, and add those by the spot's power.

    fraction: of the detected power in the spot.  lever: derivative of the place by the spot's
    power, mm/mW.
    """
    a, b, c, d, e, f, g, h = of_place
    p, q, r, s, t, u, v, w = of_power
    return (
        fraction * a + lever * p,
        fraction * b + lever * q,
        fraction * c + lever * r,
        fraction * d + lever * s,
        fraction * e + lever * t,
        fraction * f + lever * u,
        fraction * g + lever * v,
        fraction * h + lever * w,
    )
