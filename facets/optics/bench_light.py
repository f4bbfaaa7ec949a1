"""Readings under the light of a bench: a curved wavefront, edges that diffract, roll off or are
lost, a worn tip, a coating that reflects by incidence, and other light.

Seen from where the light comes from, the mirror's edges are straight for a curved wavefront too, so
mass and centroid of the light on a facet stay those of a wedge (`curved`). The ray through the
centroid is followed to the detector's image in the facet (`mirrored`), where its landing point is a
ratio of two linear functions of the place in the beam; half its second derivative, contracted with
the light's covariance, moves the centroid from there (`bowed`).

What happens at an edge is told by the light along it (`Edge`). Diffraction spreads, at the distance
s across the edge from where the edge's own light lands, the share a / s^2 a mm with
a = wavelength x path x light / 4 pi^2 (Fresnel's far field of an edge). What falls beyond the
detector's sensitive area is lost, and what lies on it unequally far to both sides moves the
centroid:

    dP = -sum a (1/S+ + 1/S-)
    c' = c - sum a [(x_e - c)(1/S+ + 1/S-) + v ln(S-/S+)] / (P + dP)

To second order in the spot's size over S, an edge's light is as wide as it is (`Streak`), and the
facet's point, where both edges end, spreads light of its own (`at_point`).

A surface that rolls off by a depth d sends the strip's light outward: the spot moves by
2 d cos(incidence) path x light / P across the edge. A lost strip moves the wedge's point inward,
and with it where the surface begins to roll off. Where more light is lost than there is, or the
numbers are so large that these first orders say so, the readings are NaN.

All functions take any number type whose `moments` a scene holds; `carried` gives those of complex
numbers, whose imaginary parts carry a derivative. Masses are shares of the beam's power.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ..scalars.dispatch import Number, defined, larger, log, pi, sqrt
from .effects import reflectances
from .forward import Geometry, Scene, Three, in_sigmas, path, placed, shone_on, unit, with_light
from .gradient import by_state, gradients, turns_of_edges
from .vectors import (
    Matrix,
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
from .wedge import Moments, Plane, Side, moments_closed, turned

#: A number's derivatives by the eight components of a state.
Row = tuple[Any, ...]


def cross2(a: Plane, b: Plane) -> Number:
    return a[0] * b[1] - a[1] * b[0]


def dot2(a: Plane, b: Plane) -> Number:
    return a[0] * b[0] + a[1] * b[1]


def unbent(geometry: Geometry, at: Scene) -> tuple[Any, Any, Any, Any]:
    """What carries vectors across the beam at the apex's height back to the height of its place."""
    xx, xy, yx, yy = geometry.light.bend
    height = dot(subtract(at.apex, at.place), geometry.direction)
    a, b, c, d = height * xx + 1, height * xy, height * yx, height * yy + 1
    size = a * d - b * c
    return d / size, -b / size, -c / size, a / size


def applied(matrix: tuple[Any, Any, Any, Any], x: Plane) -> Plane:
    return matrix[0] * x[0] + matrix[1] * x[1], matrix[2] * x[0] + matrix[3] * x[1]


def curved(geometry: Geometry, at: Scene) -> Scene:
    """The scene with apex and edges as seen from where a curved wavefront's light comes from."""
    back = unbent(geometry, at)
    q = applied(back, at.q)
    bent = applied(geometry.light.bend, q)
    sides = (
        seen_edge(geometry, back, bent, at.edges[0]),
        seen_edge(geometry, back, bent, at.edges[1]),
        seen_edge(geometry, back, bent, at.edges[2]),
    )
    return Scene(
        at.apex, at.place, at.turn, at.normals, at.edges, q, sides, at.integrals, at.moments
    )


def seen_edge(
    geometry: Geometry, back: tuple[Any, Any, Any, Any], bent: Plane, edge: Vector
) -> Plane:
    """The direction, in sigmas, of an edge as the light sees it."""
    along = dot(edge, geometry.direction)
    x, y = in_sigmas(geometry, edge)
    return unit(applied(back, (x - along * bent[0], y - along * bent[1])))


class Image(NamedTuple):
    """A detector as seen in its facet, and the beam in the image's own frame: along its normal, y
    and z, from its centre; mm.

    axes: of the image, in the world.  halves: of its sensitive area.  start: the beam's place.
    direction: of the beam.  spread, fan: as in geometry and light.  path: from the apex on.
    """

    axes: Matrix
    halves: Plane
    start: Vector
    direction: Vector
    spread: tuple[Vector, Vector]
    fan: tuple[Vector, Vector]
    path: Number


def reflected(v: Vector, normal: Vector) -> Vector:
    return combine(1, v, -2 * dot(v, normal), normal)


def mirrored(geometry: Geometry, at: Scene, k: int) -> Image:
    normal, (x, y, z) = at.normals[k], geometry.axes[k]
    axes = reflected(x, normal), reflected(y, normal), reflected(z, normal)
    apex = reflected(subtract(at.apex, geometry.centres[k]), normal)  # from the image's centre
    direction = rotate(axes, geometry.direction)
    spread, fan = geometry.spread, geometry.light.fan
    return Image(
        axes=axes,
        halves=geometry.light.options.halves[k],
        start=rotate(axes, add(apex, subtract(at.place, at.apex))),
        direction=direction,
        spread=(rotate(axes, spread[0]), rotate(axes, spread[1])),
        fan=(rotate(axes, fan[0]), rotate(axes, fan[1])),
        path=-dot(apex, axes[0]) / direction[0],
    )


class Ray(NamedTuple):
    """One ray, straight on to a detector's image: how far it starts in front of the image's plane,
    its direction along the plane's normal, the slopes with which it meets the plane, and where:
    (psi, zeta), mm."""

    height: Number
    facing: Number
    slopes: Plane
    spot: Plane


def ray_at(image: Image, x: Plane) -> Ray:
    """The ray through the place x of the beam, in sigmas."""
    start = add(image.start, combine(x[0], image.spread[0], x[1], image.spread[1]))
    direction = add(image.direction, combine(x[0], image.fan[0], x[1], image.fan[1]))
    facing = direction[0]
    inverse = 1 / facing
    slopes = direction[1] * inverse, direction[2] * inverse
    spot = start[1] - start[0] * slopes[0], start[2] - start[0] * slopes[1]
    return Ray(start[0], facing, slopes, spot)


def bowed(image: Image, ray: Ray, shift: tuple[Any, Any, Any]) -> Plane:
    """How far the light's mean landing point lies from the landing point of its mean, mm.

    shift: one less the light's covariance, in sigmas, as xx, xy, yy.
    """
    (first, second), (x, y) = image.fan, image.spread
    inverse = 1 / ray.facing
    turn = first[0] * inverse, second[0] * inverse
    lever = ray.height * turn[0] - x[0], ray.height * turn[1] - y[0]
    a, b, c = 1 - shift[0], -shift[1], 1 - shift[2]
    weights = a * lever[0] + b * lever[1], b * lever[0] + c * lever[1]
    of_psi = (
        first[1] * inverse - ray.slopes[0] * turn[0],
        second[1] * inverse - ray.slopes[0] * turn[1],
    )
    of_zeta = (
        first[2] * inverse - ray.slopes[1] * turn[0],
        second[2] * inverse - ray.slopes[1] * turn[1],
    )
    return dot2(of_psi, weights), dot2(of_zeta, weights)


class Step(NamedTuple):
    """A step of one mm across an edge, into the facet that begins there, and the edge's own light.

    world: the step.  away: how far it leads away from the edge as the light sees it, in sigmas.
    sine: between beam and edge.  light: that the step sweeps over, a share of the beam's, 1/mm.
    far, middle: of the edge's own light, from the apex and its place, in sigmas.  along, fan: a
    sigma along the edge, mm, and by how much a ray's direction changes over it; in the world.
    spread: the variance of the edge's light along it, in sigmas squared.  blur: 1 - a f / L, that
    of the waves that make it up (`streak`).
    """

    world: Vector
    away: Number
    sine: Number
    light: Number
    far: Number
    middle: Plane
    along: Vector
    fan: Vector
    spread: Number
    blur: Number


def step_across(geometry: Geometry, at: Scene, back: tuple[Any, Any, Any, Any], edge: int) -> Step:
    along = at.edges[edge]
    across = cross(along, geometry.direction)
    square = dot(across, across)
    size = sqrt(square)
    step = scale(1 / size, across)
    u, (length, first, second, _) = at.sides[edge], at.integrals[edge]
    away = cross2(u, applied(back, in_sigmas(geometry, step)))
    far = first / length
    middle = at.q[0] + far * u[0], at.q[1] + far * u[1]
    fan = geometry.light.fan
    height = dot2(at.q, u)
    waves = 1 - height * (far + height)
    return Step(
        world=step,
        away=away,
        sine=sqrt(square / dot(along, along)),
        light=length * away,
        far=far,
        middle=middle,
        along=combine(u[0], geometry.spread[0], u[1], geometry.spread[1]),
        fan=combine(u[0], fan[0], u[1], fan[1]),
        spread=second / length - far * far,
        blur=larger(waves, waves * 0),
    )


def worn(
    geometry: Geometry, at: Scene, back: tuple[Any, Any, Any, Any], steps: Three, k: int
) -> tuple[Number, Plane, Plane]:
    """Mass and centroid of the light on facet k less what strips along its edges and the tip lose,
    and by how much the strips move its point, in sigmas.

    A strip moves an edge inward by w, and both move the facet's point by d:
    mass (1 - C.d - (d.P d - (C.d)^2) / 2) and C + P d, with centroid C and P one less the
    covariance.
    """
    mass, centroid, (pxx, pxy, pyy), _ = at.moments[k]
    following = (k + 1) % 3
    first, second = at.sides[k], at.sides[following]
    facing = -dot(geometry.direction, at.normals[k])
    inward1 = geometry.light.strips[k] * facing / (2 * steps[k].sine)
    inward2 = geometry.light.strips[following] * facing / (2 * steps[following].sine)
    across1 = inward1 * steps[k].away
    across2 = inward2 * steps[following].away
    inverse = 1 / cross2(first, second)
    d = (
        (across2 * first[0] + across1 * second[0]) * inverse,
        (across2 * first[1] + across1 * second[1]) * inverse,
    )
    pd = pxx * d[0] + pxy * d[1], pxy * d[0] + pyy * d[1]
    step = dot2(centroid, d)
    left = mass * (1 - step - (dot2(d, pd) - step * step) / 2)
    lost, place = at_tip(geometry, at, back, k)
    rest = left - lost
    moved = centroid[0] + pd[0], centroid[1] + pd[1]
    share = 1 / rest
    centroid = (
        (left * moved[0] - lost * place[0]) * share,
        (left * moved[1] - lost * place[1]) * share,
    )
    return rest, centroid, d


def at_tip(
    geometry: Geometry, at: Scene, back: tuple[Any, Any, Any, Any], k: int
) -> tuple[Number, Plane]:
    """The share of the beam that facet k loses at the worn tip, and its centroid in sigmas.

    It gets of the tip's area what lies between its edges, seen along the mirror's axis; its light
    is told by the density at the apex and its slope there.
    """
    light = geometry.light
    length, first, _, _ = at.integrals[k]
    density = first + dot2(at.q, at.sides[k]) * length
    axis = at.turn[0][2], at.turn[1][2], at.turn[2][2]
    size = back[0] * back[3] - back[1] * back[2]
    area = -dot(axis, geometry.direction) * light.tip * light.tip_shares[k]
    offset = applied(back, in_sigmas(geometry, rotate(at.turn, light.tip_offsets[k])))
    lost = density * (1 - dot2(at.q, offset)) * area * size * light.density
    return lost, (at.q[0] + offset[0], at.q[1] + offset[1])


class Sum(NamedTuple):
    """What the edges add up to: light lost beyond the detector (a share of the beam), what that and
    the light's unequal spread do to the first moment of place, and roll-off's part of it."""

    lost: Number
    moment: Plane


class Streak(NamedTuple):
    """The light that an edge spreads to both sides, as it lies on a detector's image.

    share: a, of the a / s^2 at s steps across the edge; mm.  spot: where the edge's own light
    lands.  v: a step.  wide: the standard deviation of the light along the edge; mm.
    """

    share: Number
    spot: Plane
    v: Plane
    wide: Plane


def seen_from(ray: Ray, image: Image, v: Vector) -> Plane:
    """What a step v across the light, in the world, is on the image."""
    level, across, up = rotate(image.axes, v)
    return across - level * ray.slopes[0], up - level * ray.slopes[1]


def streak(image: Image, step: Step, scatter: Number) -> Streak:
    """What an edge spreads. scatter: wavelength x path / 4 pi^2, mm^2.

    The light along an edge lands where its rays do, and each part of it is as wide as the waves
    make it that such a short piece lets through: their variances add up. That of a piece which ends
    at the apex has no bound, since its ends diffract; `at_point` has these, and what is left is
    Hadamard's finite part, (wavelength x path / 4 pi sigma)^2 (1 - a f / L), with the density f at
    the apex.
    """
    ray = ray_at(image, step.middle)
    own, landed = dot(step.along, step.along), combine(1, step.along, image.path, step.fan)
    inverse = 1 / own
    waves = pi(own) * scatter * inverse
    wide = sqrt(step.spread * dot(landed, landed) * inverse + waves * waves * step.blur)
    along = seen_from(ray, image, step.along)
    return Streak(
        share=scatter * step.light,
        spot=ray.spot,
        v=seen_from(ray, image, step.world),
        wide=(wide * along[0], wide * along[1]),
    )


def beyond(geometry: Geometry, image: Image, light: Streak, centre: Plane, total: Sum) -> Sum:
    """`total` and what a streak loses beyond the detector's sensitive area.

    It counts as two lines, one standard deviation to both sides of its middle.  centre: the spot's,
    mm.
    """
    (x, y), v, wide, nearest = light.spot, light.v, light.wide, geometry.light.options.nearest
    ahead, behind = rates((x + wide[0], y + wide[1]), v, image.halves, nearest)
    ahead2, behind2 = rates((x - wide[0], y - wide[1]), v, image.halves, nearest)
    half = light.share / 2
    one, other = half * (ahead + behind), half * (ahead2 + behind2)
    missing, lopsided = one + other, one - other
    lean = half * log(ahead * ahead2 / (behind * behind2))
    return Sum(
        total.lost + missing,
        (
            total.moment[0] - (x - centre[0]) * missing - wide[0] * lopsided - v[0] * lean,
            total.moment[1] - (y - centre[1]) * missing - wide[1] * lopsided - v[1] * lean,
        ),
    )


def at_point(
    geometry: Geometry,
    at: Scene,
    back: tuple[Any, Any, Any, Any],
    image: Image,
    k: int,
    steps: tuple[Step, Step],
    streaks: tuple[Streak, Streak],
    scatter: Number,
    centre: Plane,
    total: Sum,
) -> Sum:
    """`total` and what facet k's point loses beyond the detector, where both edges end.

    With s and t steps of the two streaks from where the apex's own ray lands, the point's waves are
    A / s^2 t^2 on an area of ds dt, A = (wavelength x path / 4 pi^2)^2 x density at the apex / sine
    between the edges. The finite part of its integral over the sensitive area is a sum over the
    area's four sides, of lines alpha s + beta t = gamma, and its corners:

        J = sum over corners of (alpha beta' - alpha' beta) / gamma gamma'
            - sum over sides of alpha beta / gamma^2 [ln |t / s|]
        first moments: - sum over sides of (beta v1 + alpha v2) / gamma [ln |t / s|]

    with [] from a side's one end to its other. Over the whole plane it is nothing, so that what is
    lost is -J. A streak that runs through a corner is as wide there as it is.
    """
    one, other = streaks
    length, first, _, _ = at.integrals[k]
    q = at.q
    size = back[0] * back[3] - back[1] * back[2]
    density = (first + dot2(q, at.sides[k]) * length) * size * geometry.light.density
    sine = dot(cross(steps[0].world, steps[1].world), geometry.direction)
    amount = -scatter * scatter * density / sine
    spot = ray_at(image, q).spot
    v, w = one.v, other.v
    turn = cross2(v, w)
    widths = dot2(one.wide, one.wide), dot2(other.wide, other.wide)
    (y, z), nearest = image.halves, geometry.light.options.nearest
    y1, z1, y0, z0 = y - spot[0], z - spot[1], -y - spot[0], -z - spot[1]
    a, b = corner(v, w, widths, y1, z0), corner(v, w, widths, y1, z1)
    c, d = corner(v, w, widths, y0, z1), corner(v, w, widths, y0, z0)
    up = log(b[0] * a[1] / (b[1] * a[0]))
    over = log(c[0] * b[1] / (c[1] * b[0]))
    down = log(d[0] * c[1] / (d[1] * c[0]))
    least = nearest + spot[0] * 0
    y1, z1, y0, z0 = larger(y1, least), larger(z1, least), larger(-y0, least), larger(-z0, least)
    level, upright = y1 * y0, z1 * z0
    each = 1 / (2 * level * upright)
    right, left, top, bottom = (
        y0 * upright * each,
        y1 * upright * each,
        z0 * level * each,
        z1 * level * each,
    )  # half of one over the distance
    on_right, on_top, on_left = right * up, top * over, left * down
    on_bottom = -bottom * (up + over + down)
    whole = 2 * turn * (right + left) * (top + bottom)
    whole -= v[0] * w[0] * (right * on_right + left * on_left)
    whole -= v[1] * w[1] * (top * on_top + bottom * on_bottom)
    sideways, upward = on_right - on_left, on_top - on_bottom
    missing = -2 * amount * whole
    lean = (
        amount * (2 * v[0] * w[0] * sideways + (w[1] * v[0] + v[1] * w[0]) * upward),
        amount * ((w[0] * v[1] + v[0] * w[1]) * sideways + 2 * v[1] * w[1] * upward),
    )
    return Sum(
        total.lost + missing,
        (
            total.moment[0] - (spot[0] - centre[0]) * missing - lean[0],
            total.moment[1] - (spot[1] - centre[1]) * missing - lean[1],
        ),
    )


def corner(v: Plane, w: Plane, widths: Plane, x: Number, y: Number) -> Plane:
    """The squares of t and s of a corner (x, y) from where the apex's ray lands, as s v + t w.

    widths: the squares of both streaks' standard deviations, mm^2.
    """
    s, t = x * w[1] - y * w[0], v[0] * y - v[1] * x
    return t * t + widths[0], s * s + widths[1]


def push(
    geometry: Geometry,
    at: Scene,
    image: Image,
    k: int,
    edge: int,
    step: Step,
    light: Streak,
    depth: Number,
    moved: Plane,
    total: Sum,
) -> Sum:
    """`total` and where an edge of facet k that rolls off sends its light.

    depth: mm, positive for the facet that begins at the edge where it falls off; its negative for
    the one that ends there.  moved: by how much lost strips move the facet's point, in sigmas.
    """
    facing = -dot(geometry.direction, at.normals[k])
    width = geometry.light.rolloff_width * facing / step.sine
    mean = strip_mean(at, k, edge, step, moved, width)
    far = -2 * depth * facing * image.path * step.light * mean
    return Sum(total.lost, (total.moment[0] + light.v[0] * far, total.moment[1] + light.v[1] * far))


def strip_mean(at: Scene, k: int, edge: int, step: Step, moved: Plane, width: Number) -> Number:
    """The light along a strip of facet k beside its edge, over the light along the edge itself.

    moved: where the strip begins, from the apex, in sigmas.  width: of the strip, across the beam,
    mm.  With D from there to where its inner side begins, along the other edge, and the light
    L(a, h) along a line from q, a = q.u, h = q x u: the mean of 1 + (dL.x + x.d2L x / 2) / L over x
    from `moved` to `moved` + D.
    """
    u = at.sides[edge]
    if edge == k:
        w = at.sides[(k + 1) % 3]
        far = width * step.away / cross2(u, w)
    else:
        w = at.sides[k]
        far = width * step.away / cross2(w, u)
    a, h = dot2(at.q, u), cross2(at.q, u)
    wide, deep = far * dot2(w, u), far * cross2(w, u)
    along, across = dot2(moved, u) + wide / 2, cross2(moved, u) + deep / 2
    ratio = step.far + a
    rise = -ratio * along - h * across
    bow = a * ratio * (along * along + wide * wide / 12)
    bow += 2 * h * ratio * (along * across + wide * deep / 12)
    bow += (h * h - 1) * (across * across + deep * deep / 12)
    return 1 + rise + bow / 2


def rates(spot: Plane, v: Plane, halves: Plane, nearest: Number) -> tuple[Number, Number]:
    """One over how many steps v lead from a spot to the window's edge, ahead and behind."""
    least = nearest + spot[0] * 0
    right, left = larger(halves[0] - spot[0], least), larger(halves[0] + spot[0], least)
    above, below = larger(halves[1] - spot[1], least), larger(halves[1] + spot[1], least)
    level, upright = right * left, above * below
    whole = 1 / (level * upright)  # one division for all four
    x, y = v[0] * upright * whole, v[1] * level * whole
    return (
        larger(larger(x * left, -x * right), larger(y * below, -y * above)),
        larger(larger(-x * left, x * right), larger(-y * below, y * above)),
    )


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


#: With less light than this on a facet, how its covariance changes is lost to rounding, and counts
#: for nothing.
DIM = 0.01


def carried_side(q: Plane, u: Plane, side: Side) -> Side:
    """What `wedge.side` gives, with the derivative that q and u carry in their imaginary parts.

    With a = q.u and h = q x u: dL = -f da - h L dh, dK = -L da - h K dh, dJ = -2 K da - h J dh.
    """
    a, h = dot2(q, u), cross2(q, u)
    length, first, second, swept = side
    density = first + a.real * length
    da, dh = a.imag, h.real * h.imag
    return (
        complex(length, -density * da - length * dh),
        complex(first, -length * da - first * dh),
        complex(second, -2 * first * da - second * dh),
        complex(swept, 0),
    )


def turn_of(u: Plane) -> float:
    """By how much a complex unit vector turns."""
    turn: float = u[0].real * u[1].imag - u[1].real * u[0].imag
    return turn


def carried_moments(
    q: Plane, u1: Plane, u2: Plane, side1: Side, side2: Side, real1: Side, real2: Side,
    moments: Moments,
) -> Moments:  # fmt: skip
    """What `wedge.wedge` gives, likewise. side1, side2: carried; real1, real2, moments: plain."""
    mass, (cx, cy), (pxx, pxy, pyy), from_point = moments
    qx, qy, turn1, turn2 = q[0].imag, q[1].imag, turn_of(u1), turn_of(u2)
    mass1, (x1, y1) = turned((u1[0].real, u1[1].real), real1, mass, from_point)
    mass2, (x2, y2) = turned((u2[0].real, u2[1].real), real2, mass, from_point)
    of_mass = -mass * (cx * qx + cy * qy) - mass1 * turn1 + mass2 * turn2
    of_x = pxx * qx + pxy * qy - x1 * turn1 + x2 * turn2
    of_y = pxy * qx + pyy * qy - y1 * turn1 + y2 * turn2
    whole, x, y = complex(mass, of_mass), complex(cx, of_x), complex(cy, of_y)
    shift = complex(pxx, 0), complex(pxy, 0), complex(pyy, 0)
    if mass > DIM:
        again = moments_closed(q, u1, u2, side1, side2, whole)[2]
        shift = (
            complex(pxx, again[0].imag),
            complex(pxy, again[1].imag),
            complex(pyy, again[2].imag),
        )
    return whole, (x, y), shift, (x - q[0], y - q[1])


def carried(to: Scene, at: Scene) -> Scene:
    """The scene `to`, of complex numbers that carry a derivative, with its light.

    at: the same with plain numbers, in which the light has been found.
    """
    q, (u0, u1, u2), (r0, r1, r2) = to.q, to.sides, at.integrals
    s0, s1, s2 = carried_side(q, u0, r0), carried_side(q, u1, r1), carried_side(q, u2, r2)
    on_a = carried_moments(q, u0, u1, s0, s1, r0, r1, at.moments[0])
    on_b = carried_moments(q, u1, u2, s1, s2, r1, r2, at.moments[1])
    on_c = carried_moments(q, u2, u0, s2, s0, r2, r0, at.moments[2])
    return with_light(to, (s0, s1, s2), (on_a, on_b, on_c))


#: The imaginary part of what is varied: so small that its square is nothing.
STEP = 1e-30


def varied(geometry: Geometry, state: tuple[Any, ...], at: Scene) -> tuple[Three, Three, Three]:
    """The readings' derivatives by what carries STEP in geometry or state.

    at: the plain scene with its light, from `scene`.
    """
    a, b, c = readings_in(geometry, carried(curved(geometry, placed(geometry, state)), at))
    return carries(a), carries(b), carries(c)


def carries(values: Three) -> Three:
    return values[0].imag / STEP, values[1].imag / STEP, values[2].imag / STEP


def by_component(
    geometry: Geometry, state: tuple[Any, ...], at: Scene, component: int
) -> tuple[Three, Three, Three]:
    """The readings' derivatives by one component of the state."""
    tx, ty, tz, roll, pitch, yaw, bx, by = state
    moved = (
        complex(tx, STEP if component == 0 else 0.0),
        complex(ty, STEP if component == 1 else 0.0),
        complex(tz, STEP if component == 2 else 0.0),
        complex(roll, STEP if component == 3 else 0.0),
        complex(pitch, STEP if component == 4 else 0.0),
        complex(yaw, STEP if component == 5 else 0.0),
        complex(bx, STEP if component == 6 else 0.0),
        complex(by, STEP if component == 7 else 0.0),
    )
    return varied(geometry, moved, at)


def linearised(
    geometry: Geometry, state: tuple[Any, ...]
) -> tuple[tuple[Three, Three], tuple[Three, Three], tuple[Three, Three]]:
    """Readings and Jacobian at a state, for detectors A, B and C, as `gradient.linearised`."""
    at = scene(geometry, state)
    values = readings_in(geometry, at)
    columns = (
        by_component(geometry, state, at, 0),
        by_component(geometry, state, at, 1),
        by_component(geometry, state, at, 2),
        by_component(geometry, state, at, 3),
        by_component(geometry, state, at, 4),
        by_component(geometry, state, at, 5),
        by_component(geometry, state, at, 6),
        by_component(geometry, state, at, 7),
    )
    return (
        (values[0], rows(columns, 0)),
        (values[1], rows(columns, 1)),
        (values[2], rows(columns, 2)),
    )


def rows(columns: tuple[Any, ...], k: int) -> Three:
    return row(columns, k, 0), row(columns, k, 1), row(columns, k, 2)


def row(columns: tuple[Any, ...], k: int, i: int) -> tuple[Any, ...]:
    a, b, c, d, e, f, g, h = columns
    return a[k][i], b[k][i], c[k][i], d[k][i], e[k][i], f[k][i], g[k][i], h[k][i]


def nearly_linearised(
    geometry: Geometry, state: tuple[Any, ...]
) -> tuple[tuple[Three, Three], tuple[Three, Three], tuple[Three, Three]]:
    """Readings, exact, and a Jacobian that leaves out how what happens at the edges changes.

    For steps of an iteration and for uncertainties, some ten times faster than `linearised`: right
    for a curved wavefront, and to some per cent where spots are near the edge of a detector.
    """
    at = scene(geometry, state)
    back = unbent(geometry, at)
    values = readings_in(geometry, at)
    whitening = seen_axes(geometry, at, back)
    seen = bundle(geometry, geometry.direction, geometry.power, geometry.spread, whitening)
    turns, axes = turns_of_edges(seen, at), rotation_axes(state[4], state[5])
    return (
        (values[0], near_rows(geometry, at, whitening, turns, axes, 0, values[0])),
        (values[1], near_rows(geometry, at, whitening, turns, axes, 1, values[1])),
        (values[2], near_rows(geometry, at, whitening, turns, axes, 2, values[2])),
    )


def seen_axes(
    geometry: Geometry, at: Scene, back: tuple[Any, Any, Any, Any]
) -> tuple[Vector, Vector]:
    """What multiplies a small step of the apex to give that of q, in sigmas, and an edge to give
    its direction as the light sees it."""
    bent = applied(geometry.light.bend, at.q)
    x = combine(1, geometry.whitening[0], -bent[0], geometry.direction)
    y = combine(1, geometry.whitening[1], -bent[1], geometry.direction)
    return combine(back[0], x, back[1], y), combine(back[2], x, back[3], y)


def bundle(
    geometry: Geometry,
    direction: Vector,
    power: Number,
    spread: tuple[Vector, Vector],
    whitening: tuple[Vector, Vector],
) -> Geometry:
    """The sensor under a beam whose rays are parallel to one of its own."""
    return Geometry(
        direction,
        power,
        spread,
        whitening,
        geometry.normals,
        geometry.centres,
        geometry.axes,
        geometry.openings,
        geometry.light,
    )


def near_rows(
    geometry: Geometry,
    at: Scene,
    whitening: tuple[Vector, Vector],
    turns: Three,
    axes: Matrix,
    k: int,
    values: Three,
) -> Three:
    """The derivatives of detector k's readings by the state, the edges' effects held.

    Along the ray of the centroid, rays that spread shift as parallel ones would that lie farther
    apart by what they spread on their way.
    """
    light = geometry.light
    mass, centroid, _, _ = at.moments[k]
    own = (values[2] - light.background[k][0]) / mass
    bend = combine(centroid[0], light.fan[0], centroid[1], light.fan[1])
    direction = add(geometry.direction, bend)
    ray = path(bundle(geometry, direction, own, geometry.spread, whitening), at, k)
    reach = dot(subtract(ray.start, ray.origin), direction) + ray.length
    spread = (
        combine(1, geometry.spread[0], reach, light.fan[0]),
        combine(1, geometry.spread[1], reach, light.fan[1]),
    )
    parallel = bundle(geometry, direction, own, spread, whitening)
    of_psi, of_zeta, of_power = gradients(parallel, at, k, ray)
    normal, both = at.normals[k], (turns[k], turns[(k + 1) % 3])
    return drawn(
        values,
        light.background[k],
        by_state(parallel, of_psi, normal, both, axes),
        by_state(parallel, of_zeta, normal, both, axes),
        by_state(parallel, of_power, normal, both, axes),
    )


def drawn(values: Three, other: Three, of_psi: Row, of_zeta: Row, of_power: Row) -> Three:
    """The eight derivatives of each of a detector's readings, from those of its spot alone.

    values: (psi, zeta, power) as read, with the other light in them.  other: its power and place.
    """
    whole = values[2]
    share = 1 / whole
    own = (whole - other[0]) * share
    draws = other[0] * share / (whole - other[0])
    return (
        draws_place(of_psi, of_power, own, (values[0] - other[1]) * draws),
        draws_place(of_zeta, of_power, own, (values[1] - other[2]) * draws),
        of_power,
    )


def draws_place(of_place: Row, of_power: Row, own: Number, lever: Number) -> Row:
    """own: the spot's part of the power.  lever: what more of its power does to the place."""
    a, b, c, d, e, f, g, h = of_place
    p, q, r, s, t, u, v, w = of_power
    return (
        own * a + lever * p,
        own * b + lever * q,
        own * c + lever * r,
        own * d + lever * s,
        own * e + lever * t,
        own * f + lever * u,
        own * g + lever * v,
        own * h + lever * w,
    )
