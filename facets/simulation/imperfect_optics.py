"""Compute readings of imperfect optics by tracing rays: effects outside the model, and a check.

Simulations use this module to see how a coating, a diverging beam, facets that are not flat, edges
that roll off or are lost, and diffraction change poses that are solved without them, and to check
the closed form of these effects in `optics.edge_light`, which is not used here. The effects of
`sensor.imperfections` are added to those of `sensor.light`.

Each ray starts at the height of the beam's place, with a direction of its own if the wavefront is
curved, so that the beam's width changes along its way. A wedge of light is sampled in polar
coordinates about the apex, seen along the beam, where it is smooth up to its edges: some hundred
rays are as accurate as a closed form. Lost strips move the wedge's point; strips that roll off and
the tip are sampled separately, and their changes are added.

Diffraction at a facet's edge spreads light to both sides across the edge: at the distance s from
where the edge's own light lands, the share a / s^2 for each mm, a = wavelength x path / 4 pi^2 x
light along the edge (Fresnel). Most of this light lands on the detector and keeps the centroid in
place; light that misses the detector is lost. Each of the edge's rays is spread about its own
landing place; the light of the facet's point, where both edges end, is added.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from ..core.sensor import Imperfections, Sensor
from ..core.units import Floats
from ..detectors.skew import delay_states
from ..model.arrays import geometry_of, half_sizes, readings
from ..optics.forward import Geometry, LitFacet, beam_axes, dark_scene, mirror_facets

#: Numbers of nodes over a wedge's angle, its radius and a strip; end of the light, in sigmas.
ANGLES, RADII, ACROSS, FAR = 20, 40, 6, 9.0


@dataclass(frozen=True)
class Flaws:
    """All imperfections that rays meet: those of `sensor.light` and of `sensor.imperfections`.

    curvature: (2, 2) of the wavefront along `axes` (2, 3), 1/mm.  rolloff: (3, 2) mm, of the first
    and second edge of each facet.  background: (3, 3) power, y, z.  series: (5, 5) Hermite
    coefficients of the beam's profile.  The other fields as in `Imperfections`.
    """

    axes: Floats
    curvature: Floats
    wavelength: float
    rolloff: Floats
    rolloff_width: float
    strips: Floats
    tip: float
    background: Floats
    index: tuple[float, float] | None
    field: Floats | None
    sag: tuple[float, float, float]
    sag_over: float
    series: Floats | None


def flaws_of(sensor: Sensor) -> Flaws:
    light, extra, beam = sensor.light, sensor.imperfections, sensor.beam
    level: Floats = np.array(beam_axes(0.0, beam.tilt_x, beam.tilt_y)[:2])
    turned: Floats = np.array(beam_axes(beam.rotation, beam.tilt_x, beam.tilt_y)[:2])
    xx, xy, yy = light.curvature_xx, light.curvature_xy, light.curvature_yy
    field = None
    if extra.polarization is not None:
        field = np.array([np.cos(extra.polarization), np.sin(extra.polarization)]) @ turned
    elif light.polarization is not None:
        field = np.array([np.cos(light.polarization), np.sin(light.polarization)]) @ level
    both = np.array(light.background) + 0.0, np.array(extra.background) + 0.0
    powers = both[0][:, 0] + both[1][:, 0]
    moments = sum(part[:, :1] * part[:, 1:] for part in both)
    places = moments / np.where(powers == 0, 1, powers)[:, None]
    return Flaws(
        axes=level,
        curvature=np.array([[xx, xy], [xy, yy]]) + np.eye(2) / extra.wavefront_radius,
        wavelength=extra.wavelength or light.wavelength,
        rolloff=(np.array(light.rolloff) + np.array(extra.rolloff)).reshape(3, 2),
        rolloff_width=extra.rolloff_width or light.rolloff_width or 1e-4,
        strips=np.array(light.strips) + np.array(extra.strips),
        tip=light.tip + extra.tip,
        background=np.column_stack([powers, places]),
        index=extra.index or light.index,
        field=field,
        sag=extra.sag,
        sag_over=extra.sag_over,
        series=hermite_series(sensor) if light.has_profile else None,
    )


def hermite_series(sensor: Sensor) -> Floats:
    """Hermite series that multiplies a Gaussian irradiance, for NumPy's `hermeval2d`."""
    series = np.zeros((5, 5))
    series[0, 0] = 1.0
    for values in (sensor.light.profile, sensor.light.asymmetry):
        for k, value in enumerate(values):
            series[len(values) - 1 - k, k] = value
    return series


def imperfect_readings(sensor: Sensor, states: Floats) -> Floats:
    """Readings (n, 9) at states (n, 8), by rays if `sensor.imperfections` has any."""
    if sensor.imperfections == Imperfections():
        return readings(sensor, states)
    return ray_readings(sensor, states)


def delayed_readings(sensor: Sensor, time: Floats, motion: Floats, states: Floats) -> Floats:
    """Readings (n, 9) of `imperfect_readings` at states (n, 8), with each detector's delay.

    time: (n,) s.  motion: (n, 8) the states without the noise from sample to sample.
    """
    readings = imperfect_readings(sensor, states)
    for k, delay in enumerate(sensor.light.delays):
        if delay:
            late = imperfect_readings(sensor, states + delay_states(time, motion, delay) - motion)
            readings[:, 3 * k : 3 * k + 3] = late[:, 3 * k : 3 * k + 3]
    return readings


def ray_readings(sensor: Sensor, states: Floats) -> Floats:
    """Readings (n, 9) at states (n, 8) by rays, even without `sensor.imperfections`."""
    geometry, halves, flaws = geometry_of(sensor), half_sizes(sensor), flaws_of(sensor)
    return np.array([ray_reading(geometry, flaws, state, halves) for state in states])


def ray_reading(geometry: Geometry, flaws: Flaws, state: Floats, halves: Floats) -> Floats:
    """One reading (9,).  halves: (3, 2) half sizes of the detectors, mm."""
    at = dark_scene(geometry, tuple(state.tolist()))
    out = np.empty(9)
    for k, facet in enumerate(mirror_facets(geometry, at)):
        edges = [FacetEdge.from_facet(facet, flaws, which) for which in (0, 1)]
        spot = spot_reading(facet, flaws, edges)
        if flaws.wavelength:
            spot = diffract(facet, flaws, edges, spot, halves[k])
        power, *place = flaws.background[k]
        whole = spot[2] + power
        out[3 * k : 3 * k + 2] = (spot[2] * spot[:2] + power * np.array(place)) / whole
        out[3 * k + 2] = whole
    return out


@cache
def gauss(count: int) -> tuple[Floats, Floats]:
    """Gauss-Legendre nodes and weights from -1 to 1."""
    return np.polynomial.legendre.leggauss(count)


def origin(facet: LitFacet, flaws: Flaws, points: Floats) -> Floats:
    """Starting points (..., 2), mm across the beam, of the rays to points (..., 3) in space."""
    away = points - np.array(facet.at.place)
    height = (away @ np.array(facet.geometry.direction))[..., None, None]
    starts: Floats = np.linalg.solve(
        np.eye(2) + height * flaws.curvature, (away @ flaws.axes.T)[..., None]
    )[..., 0]
    return starts


@dataclass(frozen=True)
class FacetEdge:
    """An edge of a facet: its unit vector down from the apex, and the direction into the facet,
    both in space and both in the plane across the beam.

    across: distance across the beam of a point 1 mm inside the facet from the edge, mm.
    """

    along: Floats
    inward: Floats
    seen_along: Floats
    seen_inward: Floats
    across: float

    @classmethod
    def from_facet(cls, facet: LitFacet, flaws: Flaws, which: int) -> FacetEdge:
        """which: 0 for the edge where the facet begins, 1 for the edge where it ends."""
        along = np.array(facet.edges[which])
        along /= np.linalg.norm(along)
        inward = np.cross(facet.normal, along) * (1 if which == 0 else -1)
        apex, small = np.array(facet.at.apex), 1e-4
        ends = apex + small * np.array([along, -along, inward, -inward])
        ahead, behind, inside, outside = origin(facet, flaws, ends)
        direction, step = ahead - behind, (inside - outside) / (2 * small)
        direction /= np.linalg.norm(direction)
        square = step - (step @ direction) * direction
        size = float(np.linalg.norm(square))
        return cls(along, inward, direction, square / size, size)


def shares(geometry: Geometry, flaws: Flaws, places: Floats) -> Floats:
    """Shares of the beam for each mm^2 at places (n, 2), mm across the beam."""
    whitening = flaws.axes @ np.array(geometry.whitening).T
    x = places @ whitening
    area = np.linalg.norm(np.cross(*np.array(geometry.spread)))
    density: Floats = np.exp(-(x**2).sum(axis=-1) / 2) / (2 * np.pi) / area
    if flaws.series is not None:
        u, v = whitening / np.linalg.norm(whitening, axis=0) @ x.T  # along the world's x and y
        density *= np.polynomial.hermite_e.hermeval2d(u, v, flaws.series)
    return density


def size_of(geometry: Geometry) -> float:
    """The beam's larger sigma, mm."""
    return float(np.linalg.norm(np.array(geometry.spread), axis=1).max())


def wedge_point(facet: LitFacet, flaws: Flaws, edges: list[FacetEdge]) -> Floats:
    """The point (2,) of a facet without its lost strips, mm across the beam."""
    apex = origin(facet, flaws, np.array(facet.at.apex))
    lost = [flaws.strips[(facet.k + n) % 3] / 2 * edges[n].across for n in (0, 1)]
    shift: Floats = np.linalg.solve(np.array([edge.seen_inward for edge in edges]), lost)
    return apex + shift


def nodes(facet: LitFacet, flaws: Flaws, edges: list[FacetEdge]) -> tuple[Floats, Floats]:
    """Shares of the beam (n,) and places (n, 2), mm across the beam, over the wedge of a facet
    without the lost strips."""
    apex = wedge_point(facet, flaws, edges)
    first, last = (float(np.arctan2(*edge.seen_along[::-1])) for edge in edges)
    last = first + (last - first) % (2 * np.pi)
    far = float(np.hypot(*apex)) + FAR * size_of(facet.geometry)
    return polar(facet.geometry, flaws, apex, first, last, far)


def polar(
    geometry: Geometry, flaws: Flaws, apex: Floats, first: float, last: float, far: float
) -> tuple[Floats, Floats]:
    """Nodes over a sector about the apex, from the angle `first` to `last`, out to `far` mm: shares
    (n,) and places (n, 2)."""
    x, wx = gauss(ANGLES)
    r, wr = gauss(RADII)
    angle = first + (x + 1) / 2 * (last - first)
    radius = (r + 1) / 2 * far
    unit = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    places = (apex + radius[None, :, None] * unit[:, None, :]).reshape(-1, 2)
    area = wx[:, None] * wr[None, :] * radius * (last - first) / 2 * far / 2
    return shares(geometry, flaws, places) * area.ravel(), places


def spot_reading(facet: LitFacet, flaws: Flaws, edges: list[FacetEdge]) -> Floats:
    """psi, zeta and power of a facet's detector, without diffraction and background."""
    parts = [spots(facet, flaws, *nodes(facet, flaws, edges))]
    for which in (0, 1):
        if flaws.rolloff[facet.k, which]:
            weights, places = strip(facet, flaws, edges, which)
            slope = flaws.rolloff[facet.k, which] / flaws.rolloff_width
            tilt = -slope * edges[which].inward
            parts.append(spots(facet, flaws, weights, places, tilt))
            parts.append(spots(facet, flaws, -weights, places))
    if flaws.tip:
        parts.append(spots(facet, flaws, *tip_nodes(facet, flaws, edges)))
    moments = np.sum(parts, axis=0)
    return np.array([*(moments[:2] / moments[2]), facet.geometry.power * moments[2]])


def strip(
    facet: LitFacet, flaws: Flaws, edges: list[FacetEdge], which: int
) -> tuple[Floats, Floats]:
    """Nodes over the strip along one edge of a facet that rolls off, without its lost part."""
    apex = wedge_point(facet, flaws, edges)
    along, other = edges[which].seen_along, edges[1 - which].seen_along
    rise = float(other @ edges[which].seen_inward)
    wide = flaws.rolloff_width * edges[which].across / rise
    far = float(np.hypot(*apex)) + FAR * size_of(facet.geometry)
    x, wx = gauss(RADII)
    y, wy = gauss(ACROSS)
    s, t = (x + 1) / 2 * far, (y + 1) / 2 * wide
    places = (apex + s[:, None, None] * along + t[None, :, None] * other).reshape(-1, 2)
    area = np.outer(wx * far / 2, wy * wide / 2).ravel() * rise
    return shares(facet.geometry, flaws, places) * area, places


def tip_nodes(facet: LitFacet, flaws: Flaws, edges: list[FacetEdge]) -> tuple[Floats, Floats]:
    """Nodes over a facet's part of the flat disc at the apex, subtracted from the facet's light."""
    axis = np.array([row[2] for row in facet.at.turn])
    level = [edge.along - (edge.along @ axis) * axis for edge in edges]
    first, last = (v / np.linalg.norm(v) for v in level)
    beside = np.cross(axis, first)
    opening = np.arctan2(last @ beside, last @ first) % (2 * np.pi)
    radius = np.sqrt(abs(flaws.tip) / np.pi)
    x, wx = gauss(ACROSS)
    angle, r = (x + 1) / 2 * opening, (x + 1) / 2 * radius
    unit = np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * beside
    points = (np.array(facet.at.apex) + r[:, None, None] * unit).reshape(-1, 3)
    area = np.outer(wx * radius / 2 * r, wx * opening / 2).ravel()
    area = -np.sign(flaws.tip) * area * abs(axis @ np.array(facet.geometry.direction))
    places = origin(facet, flaws, points)
    return shares(facet.geometry, flaws, places) * area, places


def spots(
    facet: LitFacet, flaws: Flaws, weights: Floats, places: Floats, tilt: Floats | None = None
) -> Floats:
    """Sums of rays' reflected shares, times psi, zeta and 1.  tilt: added to the facet's normal."""
    spot, light = follow(facet, flaws, places, tilt)
    light = light * weights
    return np.array([*(light @ spot), light.sum()])


def follow(
    facet: LitFacet, flaws: Flaws, places: Floats, tilt: Floats | None = None
) -> tuple[Floats, Floats]:
    """Landing places (n, 2) of rays through places (n, 2), and the reflected share of each (n,)."""
    at, direction = facet.at, np.array(facet.geometry.direction)
    normal, apex = np.array(facet.normal), np.array(at.apex)
    start = np.array(at.place) + places @ flaws.axes
    aim = direction + places @ flaws.curvature @ flaws.axes
    aim /= np.linalg.norm(aim, axis=1, keepdims=True)
    along = ((apex - start) @ normal) / (aim @ normal)
    foot = start + along[:, None] * aim
    beside = foot - apex
    lean = 8 * flaws.sag[facet.k] / flaws.sag_over**2  # a dome's outward slope for each mm
    face = normal + lean * (beside - np.outer(beside @ normal, normal))
    if tilt is not None:
        face = face + tilt
    face /= np.linalg.norm(face, axis=1, keepdims=True)
    cosine = -(aim * face).sum(axis=1)
    leaving = aim + 2 * cosine[:, None] * face
    axes: Floats = np.array(facet.axes)
    centre = np.array(facet.centre)
    length = ((centre - foot) @ axes[0]) / (leaving @ axes[0])
    spot = foot + length[:, None] * leaving - centre
    return spot @ axes[1:].T, reflected_share(flaws, aim, face, cosine)


@dataclass(frozen=True)
class EdgeScatter:
    """The light that an edge spreads, as lines across the edge.

    amount: a of each line (n,), mW; a / s^2 is the light for each step at s steps across.  spots:
    the lines' starting places (n, 2), mm.  way: a step (2,), mm.  step: the same on the facet's
    side, in the world.  width: the lines' standard deviation from their middle, mm.
    """

    amount: Floats
    spots: Floats
    way: Floats
    step: Floats
    width: float


def streak(facet: LitFacet, flaws: Flaws, edge: FacetEdge) -> EdgeScatter:
    """The light that an edge of a facet spreads over the detector."""
    geometry, apex = facet.geometry, np.array(facet.at.apex)
    direction = np.array(geometry.direction)
    start = origin(facet, flaws, apex)
    far = float(np.hypot(*start)) + FAR * size_of(geometry)
    x, weights = gauss(RADII)
    places = start + np.outer((x + 1) / 2 * far, edge.seen_along)
    light = weights * far / 2 * shares(geometry, flaws, places)
    landing, reflecting = follow(facet, flaws, places)
    spread = scatter(facet, flaws)
    blur = spread * np.pi * wave_spread(geometry, flaws, start, places, light, edge)
    light = light * reflecting
    step = np.cross(direction, edge.along)
    step /= np.linalg.norm(step)  # one mm across the edge, perpendicular to the light
    sweeps = origin(facet, flaws, apex + step) - start
    swept = abs(sweeps @ edge.seen_inward)
    side = project_on_detector(facet, np.cross(step, direction))
    spots = np.concatenate([landing + blur * side, landing - blur * side])
    amount = spread * geometry.power * swept * np.concatenate([light, light]) / 2
    middle = amount @ spots / amount.sum()
    width = float(np.sqrt(amount @ ((spots - middle) ** 2).sum(axis=1) / amount.sum()))
    return EdgeScatter(amount, spots, project_on_detector(facet, step), step, width)


def scatter(facet: LitFacet, flaws: Flaws) -> float:
    """Wavelength x path / 4 pi^2, mm^2."""
    path = float(np.linalg.norm(np.array(facet.centre) - np.array(facet.at.apex)))
    return flaws.wavelength * path / (4 * np.pi**2)


def project_on_detector(facet: LitFacet, step: Floats) -> Floats:
    """The projection of a step across the beam, in the world, on a facet's detector: (2,)."""
    axes: Floats = np.array(facet.axes)
    normal, direction = np.array(facet.normal), np.array(facet.geometry.direction)
    step = step - 2 * (step @ normal) * normal
    ray = direction - 2 * (direction @ normal) * normal
    step = step - (step @ axes[0]) / (ray @ axes[0]) * ray
    projection: Floats = axes[1:] @ step
    return projection


def wave_spread(
    geometry: Geometry, flaws: Flaws, start: Floats, places: Floats, light: Floats, edge: FacetEdge
) -> float:
    """Spread of the light's waves along an edge, over wavelength x path / 4 pi: the root mean
    square of twice the amplitude's relative slope, corrected for the edge's end; 1/mm.

    light: at the places along the edge, whose sum is the light's integral.
    """
    inverse = flaws.axes @ np.array(geometry.whitening).T
    inverse = inverse @ inverse.T
    slopes = places @ inverse @ edge.seen_along
    end = shares(geometry, flaws, start[None])[0] * (start @ inverse @ edge.seen_along)
    square = (light @ slopes**2 - 2 * end) / light.sum()
    return float(np.sqrt(max(square, 0.0)))


def diffract(
    facet: LitFacet, flaws: Flaws, edges: list[FacetEdge], spot: Floats, half: Floats
) -> Floats:
    """The reading (3,) of a spot (3,) without the diffracted light that misses the detector.

    half: half sizes (2,) of the detector, mm.
    """
    lost, moment = 0.0, np.zeros(2)
    streaks = [streak(facet, flaws, edge) for edge in edges]
    for light in streaks:
        ahead, behind = (reaches(light, sign, half) for sign in (1, -1))
        both = light.amount * (1 / ahead + 1 / behind)
        lost += both.sum()
        moment += both @ (light.spots - spot[:2])
        moment += light.way * (light.amount @ np.log(behind / ahead))
    geometry, apex = facet.geometry, np.array(facet.at.apex)
    start = origin(facet, flaws, apex)
    (point,), (reflecting,) = follow(facet, flaws, start[None])
    steps = np.array([light.step for light in streaks])
    away = origin(facet, flaws, apex + steps) - start
    sine = abs(np.cross(*steps) @ np.array(geometry.direction))
    density = geometry.power * shares(geometry, flaws, start[None])[0] * reflecting
    density *= abs(np.linalg.det(away)) / sine
    mass, first = point_light(streaks, point, half)
    mass, first = (part * scatter(facet, flaws) ** 2 * density / sine for part in (mass, first))
    rest = spot[2] - lost - mass
    return np.array([*(spot[:2] - (moment + first + (point - spot[:2]) * mass) / rest), rest])


def point_light(streaks: list[EdgeScatter], point: Floats, half: Floats) -> tuple[float, Floats]:
    """Integral of 1 / s^2 t^2 over ds dt beyond a detector and its first moments, mm, with s and t
    steps of two streaks from `point`: Hadamard's finite part, by Green's theorem around the
    detector, where the integral is the negative of the integral over the detector."""
    basis = np.column_stack([light.way for light in streaks])
    turn = 1 if np.linalg.det(basis) > 0 else -1
    corners = np.array([[1, -1], [1, 1], [-1, 1], [-1, -1]]) * half - point
    steps = np.linalg.solve(basis, corners.T).T
    soft = np.array([light.width for light in streaks]) / abs(np.linalg.det(basis))
    logs = np.log((steps[:, 1] ** 2 + soft[0] ** 2) / (steps[:, 0] ** 2 + soft[1] ** 2)) / 2
    mass, first = 0.0, np.zeros(2)
    sides = [np.array(n) for n in ((1, 0), (0, 1), (-1, 0), (0, -1))]
    for n, normal in enumerate(sides):
        a, b = normal @ basis
        c, d = sides[(n + 1) % 4] @ basis
        gap, after = ((half - m * point)[np.abs(m) > 0][0] for m in (normal, sides[(n + 1) % 4]))
        rise = logs[(n + 1) % 4] - logs[n]
        mass += (a * d - b * c) / (gap * after) - a * b / gap**2 * rise
        first -= basis @ [b, a] / gap * rise
    return -turn * mass, -turn * first


#: Least distance of a line from a detector's edge, mm; nearer lines have hardly any light unless
#: the whole spot is there.
MIN_EDGE_DISTANCE_MM = 0.1


def reaches(light: EdgeScatter, sign: int, half: Floats) -> Floats:
    """Distances of a streak's lines (n,) from the edge of a detector, in steps; NaN if the streak's
    middle lies beside the detector."""
    way = light.way * sign
    with np.errstate(divide="ignore"):
        steps = np.maximum(half - np.sign(way) * light.spots, MIN_EDGE_DISTANCE_MM) / np.abs(way)
    inside = (np.abs(light.amount @ light.spots / light.amount.sum()) < half).all()
    return steps.min(axis=1) if inside else np.full(len(steps), np.nan)


def reflected_share(flaws: Flaws, aim: Floats, face: Floats, cosine: Floats) -> Floats:
    """Reflected share of each ray, relative to unpolarised light at 45 degrees."""
    if flaws.index is None:
        return np.ones(len(aim))
    s, p = reflectances(complex(*flaws.index), cosine)
    plain = sum(reflectances(complex(*flaws.index), np.sqrt(0.5)))
    if flaws.field is None:
        return (s + p) / plain
    across = np.cross(aim, face)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    share = (across @ flaws.field) ** 2
    both: Floats = 2 * (share * s + (1 - share) * p) / plain
    return both


def reflectances(index: complex, cosine: Floats | float) -> tuple[Floats, Floats]:
    """Reflectances across and along the plane of incidence (s, p), by Fresnel."""
    inside = np.sqrt(index**2 - 1 + np.asarray(cosine) ** 2 + 0j)
    s = (cosine - inside) / (cosine + inside)
    p = (index**2 * cosine - inside) / (index**2 * cosine + inside)
    return np.abs(s) ** 2, np.abs(p) ** 2
