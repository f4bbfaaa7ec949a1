"""Effects of the facets' edges on the light: diffraction, roll-off and lost strips.

The effects are proportional to the light along the edge (`EdgeStep`), which diffraction spreads
across the edge. At the distance s from its landing point, the fraction per mm is a / s^2 (Fresnel's
far field of an edge), with a = wavelength x path x light / 4 pi^2. Light beyond the detector's
sensitive area is lost. Light inside it moves the centroid where the area's ends are at different
distances:

    dP = -sum a (1/S+ + 1/S-)
    c' = c - sum a [(x_e - c)(1/S+ + 1/S-) + v ln(S-/S+)] / (P + dP)

To second order in the spot's size over S, the width of the edge's own light has an effect, too
(`EdgeStreak`), and the facet's point, where both edges end, spreads additional light
(`add_apex_loss`).

A surface that rolls off by a depth d reflects the strip's light outward: the spot moves by 2 d
cos(incidence) path x light / P across the edge. A lost strip moves the wedge's point inward,
together with the start of the roll-off. Masses are fractions of the beam's power. All functions
take any number type.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ..scalars.dispatch import Number, log, maximum, pi, sqrt
from .curved_light import DetectorImage, Ray, apply, trace_ray
from .forward import Geometry, LitFacet, Scene, project_to_sigmas
from .profile import density_at_point, moment_slopes
from .stains import stained_light
from .vectors import Plane, Vector, combine, cross, cross2, dot, dot2, rotate, scale

#: Fraction of the beam's light below which a facet is dark. For less light than this per sigma
#: along an edge, the place and the width of this light are set to 0 and 1 sigma, because they
#: underflow; they have no effect.
FAINT = 1e-290


class EdgeStep(NamedTuple):
    """A step of one mm across an edge, into the facet that begins there, and the edge's own light.

    world: the step, in the world.  away: distance of its end from the edge as seen from the light's
    source, in sigmas.  sine: of the angle between beam and edge.  light: fraction of the beam's
    light that the step sweeps over, 1/mm.  far, middle: mean distance of the edge's light from the
    apex, and its mean place, in sigmas.  along, fan: vector of one sigma along the edge, mm, and
    the change of a ray's direction over it; in the world.  spread: variance of the edge's light
    along it, in sigmas squared.  blur: factor 1 - a f / L of the width by diffraction, see
    `edge_streak`.
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


def edge_step(
    geometry: Geometry, at: Scene, back: tuple[Any, Any, Any, Any], edge: int
) -> EdgeStep:
    """The effect of one edge of the mirror (0 to 2) on the light next to it."""
    along = at.edges[edge]
    across = cross(along, geometry.direction)
    square = dot(across, across)
    size = sqrt(square)
    step = scale(1 / size, across)
    u, (length, first, second, _) = at.sides[edge], at.integrals[edge]
    away = cross2(u, apply(back, project_to_sigmas(geometry, step)))
    lit = maximum(length, FAINT)
    far = first / lit
    middle = at.q[0] + far * u[0], at.q[1] + far * u[1]
    fan = geometry.light.fan
    height = dot2(at.q, u)
    waves = 1 - height * (far + height)
    return EdgeStep(
        world=step,
        away=away,
        sine=sqrt(square / dot(along, along)),
        light=length * away,
        far=far,
        middle=middle,
        along=combine(u[0], geometry.spread[0], u[1], geometry.spread[1]),
        fan=combine(u[0], fan[0], u[1], fan[1]),
        spread=(second + (lit - length)) / lit - far * far,
        blur=maximum(waves, waves * 0),
    )


def light_after_wear(
    facet: LitFacet, back: tuple[Any, Any, Any, Any], steps: tuple[EdgeStep, EdgeStep]
) -> tuple[Number, Plane, Plane]:
    """Mass and centroid of the light on a facet without the lost strips, the worn tip and stains,
    and the shift of its point by the strips, in sigmas.

    The two strips move the facet's edges inward, and its point by d. With the centroid C, and P one
    minus the covariance, the mass becomes mass (1 - C.d - (d.P d - (C.d)^2) / 2), and the centroid
    C + P d.
    """
    geometry, k = facet.geometry, facet.k
    mass, centroid, _, _ = facet.moments
    decline, (pxx, pxy, pyx, pyy) = moment_slopes(facet)
    first, second = facet.sides
    facing = -dot(geometry.direction, facet.normal)
    inward1 = geometry.light.strips[k] * facing / (2 * steps[0].sine)
    inward2 = geometry.light.strips[(k + 1) % 3] * facing / (2 * steps[1].sine)
    across1 = inward1 * steps[0].away
    across2 = inward2 * steps[1].away
    inverse = 1 / cross2(first, second)
    d = (
        (across2 * first[0] + across1 * second[0]) * inverse,
        (across2 * first[1] + across1 * second[1]) * inverse,
    )
    pd = pxx * d[0] + pxy * d[1], pyx * d[0] + pyy * d[1]
    step = dot2(decline, d)
    remaining = mass * (1 - step - (dot2(d, pd) - step * step) / 2)
    lost, place = tip_loss(facet, back)
    stained, moment = stained_light(facet)
    rest = remaining - lost - stained
    moved = centroid[0] + pd[0], centroid[1] + pd[1]
    inverse = 1 / rest
    centroid = (
        (remaining * moved[0] - lost * place[0] - moment[0]) * inverse,
        (remaining * moved[1] - lost * place[1] - moment[1]) * inverse,
    )
    return rest, centroid, d


def tip_loss(facet: LitFacet, back: tuple[Any, Any, Any, Any]) -> tuple[Number, Plane]:
    """The fraction of the beam's light that a facet loses at the worn tip, and the centroid of this
    light, in sigmas.

    The facet's part of the tip's area lies between its edges, as seen along the mirror's axis. Its
    light follows from the density at the apex and the density's gradient.
    """
    geometry, at, light, k = facet.geometry, facet.at, facet.geometry.light, facet.k
    density = density_at_point(facet)
    axis = at.turn[0][2], at.turn[1][2], at.turn[2][2]
    size = back[0] * back[3] - back[1] * back[2]
    area = -dot(axis, geometry.direction) * light.tip * light.tip_fractions[k]
    offset = apply(back, project_to_sigmas(geometry, rotate(at.turn, light.tip_offsets[k])))
    lost = density * (1 - dot2(at.q, offset)) * area * size * light.density
    return lost, (at.q[0] + offset[0], at.q[1] + offset[1])


class EdgeEffects(NamedTuple):
    """The summed effects of the edges.

    lost: light beyond the detector, as a fraction of the beam's.  moment: change of the first
    moment of place by this loss and by the roll-off, mm.
    """

    lost: Number
    moment: Plane


class ImagedSpot(NamedTuple):
    """The spot of a facet's light without the effects of its edges.

    image: of the detector in the facet.  centre: of the spot, mm.  scatter: wavelength x path /
    4 pi^2, mm^2.
    """

    facet: LitFacet
    image: DetectorImage
    centre: Plane
    scatter: Number


class EdgeStreak(NamedTuple):
    """The light that an edge diffracts to both sides, on a detector's image.

    step: across the edge.  amount: a in the density a / s^2 at s steps across the edge, mm.  spot:
    landing point of the edge's own light, mm.  v: image of the step.  wide: standard deviation of
    the light along the edge, as a vector, mm.
    """

    step: EdgeStep
    amount: Number
    spot: Plane
    v: Plane
    wide: Plane


def step_on_image(ray: Ray, image: DetectorImage, v: Vector) -> Plane:
    """The image on the detector of a step v across the light, which is in the world's frame."""
    level, across, up = rotate(image.axes, v)
    return across - level * ray.slopes[0], up - level * ray.slopes[1]


def edge_streak(spot: ImagedSpot, step: EdgeStep) -> EdgeStreak:
    """The light that an edge diffracts.

    The variance of the light along an edge is the sum of two variances: of its rays' landing
    points, and of the diffraction of each short piece. The second one diverges for a piece that
    ends at the apex. `add_apex_loss` includes the diffraction of the ends; the rest is Hadamard's
    finite part, (wavelength x path / 4 pi sigma)^2 (1 - a f / L), with the density f at the apex.
    """
    image, scatter = spot.image, spot.scatter
    ray = trace_ray(image, step.middle)
    square, landed = dot(step.along, step.along), combine(1, step.along, image.path, step.fan)
    inverse = 1 / square
    waves = pi(square) * scatter * inverse
    wide = sqrt(step.spread * dot(landed, landed) * inverse + waves * waves * step.blur)
    along = step_on_image(ray, image, step.along)
    return EdgeStreak(
        step=step,
        amount=scatter * step.light,
        spot=ray.spot,
        v=step_on_image(ray, image, step.world),
        wide=(wide * along[0], wide * along[1]),
    )


def add_streak_loss(spot: ImagedSpot, streak: EdgeStreak, total: EdgeEffects) -> EdgeEffects:
    """Add the light of a streak beyond the detector's sensitive area to `total`.

    The streak is approximated by two lines, one standard deviation to each side of its middle.
    """
    image, nearest = spot.image, spot.facet.geometry.light.options.nearest
    (x, y), v, wide, centre = streak.spot, streak.v, streak.wide, spot.centre
    ahead, behind = edge_rates((x + wide[0], y + wide[1]), v, image.halves, nearest)
    ahead2, behind2 = edge_rates((x - wide[0], y - wide[1]), v, image.halves, nearest)
    half = streak.amount / 2
    beyond, beyond2 = half * (ahead + behind), half * (ahead2 + behind2)
    missing, lopsided = beyond + beyond2, beyond - beyond2
    lean = half * log(ahead * ahead2 / (behind * behind2))
    return EdgeEffects(
        total.lost + missing,
        (
            total.moment[0] - (x - centre[0]) * missing - wide[0] * lopsided - v[0] * lean,
            total.moment[1] - (y - centre[1]) * missing - wide[1] * lopsided - v[1] * lean,
        ),
    )


def add_apex_loss(
    spot: ImagedSpot,
    streaks: tuple[EdgeStreak, EdgeStreak],
    back: tuple[Any, Any, Any, Any],
    total: EdgeEffects,
) -> EdgeEffects:
    """Add the light from a facet's point, where both edges end, beyond the detector to `total`.

    s and t count steps of the two streaks from the landing point of the apex's ray. The light that
    the point diffracts to an area ds dt is A / s^2 t^2, where A = (wavelength x path / 4 pi^2)^2 x
    density at the apex / sine between the edges. Over the infinite plane, the finite part of the
    integral of this light is zero. The loss is therefore minus the integral over the detector's
    sensitive area (`finite_part`).
    """
    geometry, image, centre, scatter = spot.facet.geometry, spot.image, spot.centre, spot.scatter
    size = back[0] * back[3] - back[1] * back[2]
    density = density_at_point(spot.facet) * size * geometry.light.density
    sine = dot(cross(streaks[0].step.world, streaks[1].step.world), geometry.direction)
    amount = -scatter * scatter * density / sine
    apex = trace_ray(image, spot.facet.at.q).spot
    integral, moment = finite_part(apex, image.halves, streaks, geometry.light.options.nearest)
    missing = -2 * amount * integral
    lean = amount * moment[0], amount * moment[1]
    return EdgeEffects(
        total.lost + missing,
        (
            total.moment[0] - (apex[0] - centre[0]) * missing - lean[0],
            total.moment[1] - (apex[1] - centre[1]) * missing - lean[1],
        ),
    )


def finite_part(
    spot: Plane, halves: Plane, streaks: tuple[EdgeStreak, EdgeStreak], nearest: Number
) -> tuple[Number, Plane]:
    """Half of Hadamard's finite part J of the integral of 1 / s^2 t^2 over the sensitive area, and
    its first moments about `spot`.

    J is a sum over the area's four sides, on lines alpha s + beta t = gamma, and over its corners:

        J = sum over corners of (alpha beta' - alpha' beta) / gamma gamma'
            - sum over sides of alpha beta / gamma^2 [ln |t / s|]
        first moments: - sum over sides of (beta v1 + alpha v2) / gamma [ln |t / s|]

    where [] is a difference between the ends of a side. The width of a streak keeps its
    contribution finite where it runs through a corner.
    """
    (v, wide_v), (w, wide_w) = (streaks[0].v, streaks[0].wide), (streaks[1].v, streaks[1].wide)
    turn = cross2(v, w)
    widths = dot2(wide_v, wide_v), dot2(wide_w, wide_w)
    y, z = halves
    y1, z1, y0, z0 = y - spot[0], z - spot[1], -y - spot[0], -z - spot[1]
    a = corner_squares(v, w, widths, y1, z0)
    b = corner_squares(v, w, widths, y1, z1)
    c = corner_squares(v, w, widths, y0, z1)
    d = corner_squares(v, w, widths, y0, z0)
    up = log(b[0] * a[1] / (b[1] * a[0]))
    over = log(c[0] * b[1] / (c[1] * b[0]))
    down = log(d[0] * c[1] / (d[1] * c[0]))
    limit = nearest + spot[0] * 0
    y1, z1 = maximum(y1, limit), maximum(z1, limit)
    y0, z0 = maximum(-y0, limit), maximum(-z0, limit)
    level, upright = y1 * y0, z1 * z0
    each = 1 / (2 * level * upright)
    # Half of the reciprocal distance of each side.
    right_side, left_side = y0 * upright * each, y1 * upright * each
    top_side, bottom_side = z0 * level * each, z1 * level * each
    on_right, on_top, on_left = right_side * up, top_side * over, left_side * down
    on_bottom = -bottom_side * (up + over + down)
    integral = 2 * turn * (right_side + left_side) * (top_side + bottom_side)
    integral -= v[0] * w[0] * (right_side * on_right + left_side * on_left)
    integral -= v[1] * w[1] * (top_side * on_top + bottom_side * on_bottom)
    sideways, upward = on_right - on_left, on_top - on_bottom
    return integral, (
        2 * v[0] * w[0] * sideways + (w[1] * v[0] + v[1] * w[0]) * upward,
        (w[0] * v[1] + v[0] * w[1]) * sideways + 2 * v[1] * w[1] * upward,
    )


def corner_squares(v: Plane, w: Plane, widths: Plane, x: Number, y: Number) -> Plane:
    """The squares of t and s for a corner at s v + t w = (x, y) from the landing point of the
    apex's ray.

    widths: the squares of both streaks' standard deviations, mm^2.
    """
    s, t = x * w[1] - y * w[0], v[0] * y - v[1] * x
    return t * t + widths[0], s * s + widths[1]


def add_rolloff(
    spot: ImagedSpot, streak: EdgeStreak, moved: Plane, which: int, total: EdgeEffects
) -> EdgeEffects:
    """Add the effect of the roll-off of a facet's edge to `total`.

    moved: shift of the facet's point by lost strips, in sigmas.  which: 0 for the edge where the
    facet begins, 1 for the edge where it ends.
    """
    geometry, facet, step = spot.facet.geometry, spot.facet, streak.step
    begin, end = geometry.light.rolloff[facet.k]
    depth = begin if which == 0 else -end
    facing = -dot(geometry.direction, facet.normal)
    width = geometry.light.rolloff_width * facing / step.sine
    mean = strip_mean(facet, step, moved, width, which)
    far = -2 * depth * facing * spot.image.path * step.light * mean
    return EdgeEffects(
        total.lost, (total.moment[0] + streak.v[0] * far, total.moment[1] + streak.v[1] * far)
    )


def strip_mean(facet: LitFacet, step: EdgeStep, moved: Plane, width: Number, which: int) -> Number:
    """The mean light along a strip next to a facet's edge, over the light along the edge itself.

    moved: start of the strip, from the apex, in sigmas.  width: of the strip, across the beam, mm.
    which: of the facet's two edges, 0 or 1.

    L(a, h) is the light along a line from q, where a = q.u and h = q x u. D is the vector along the
    other edge from the start of the strip's outer side to the start of its inner side. The result
    is the mean of 1 + (dL.x + x.d2L x / 2) / L over x from `moved` to `moved` + D.
    """
    q, u, w = facet.at.q, facet.sides[which], facet.sides[1 - which]
    sine = cross2(u, w) if which == 0 else cross2(w, u)
    far = width * step.away / sine
    a, h = dot2(q, u), cross2(q, u)
    wide, deep = far * dot2(w, u), far * cross2(w, u)
    along, across = dot2(moved, u) + wide / 2, cross2(moved, u) + deep / 2
    ratio = step.far + a
    rise = -ratio * along - h * across
    bow = a * ratio * (along * along + wide * wide / 12)
    bow += 2 * h * ratio * (along * across + wide * deep / 12)
    bow += (h * h - 1) * (across * across + deep * deep / 12)
    return 1 + rise + bow / 2


def edge_rates(spot: Plane, v: Plane, halves: Plane, nearest: Number) -> tuple[Number, Number]:
    """The reciprocals of the number of steps v from a spot to the window's edge, forward and
    backward."""
    limit = nearest + spot[0] * 0
    rightward, leftward = maximum(halves[0] - spot[0], limit), maximum(halves[0] + spot[0], limit)
    above, below = maximum(halves[1] - spot[1], limit), maximum(halves[1] + spot[1], limit)
    level, upright = rightward * leftward, above * below
    inverse = 1 / (level * upright)  # one division for all four distances
    x, y = v[0] * upright * inverse, v[1] * level * inverse
    return (
        maximum(maximum(x * leftward, -x * rightward), maximum(y * below, -y * above)),
        maximum(maximum(-x * leftward, x * rightward), maximum(-y * below, y * above)),
    )
