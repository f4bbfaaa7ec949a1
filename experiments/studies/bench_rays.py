"""Readings of a sensor on a bench, by rays: an oracle for tests and studies that shares no optics.

Every facet is covered by a net of points, which are Gauss nodes in the angle between its edges and
in the distance from its apex. Each point has a ray of a beam with an elliptical cross-section and a
curved wavefront. The ray is reflected at the local surface, which is rolled off towards the edges,
with a metal's reflectance for the light's polarisation, and meets the detector's plane. The net
excludes the strips along the edges, whose light is lost. Diffraction at the edges is added by its
closed form (two terms for each edge), because rays do not have it. Background light is added last.

n states and m points: places (n, m, 3) and directions are in mm in the world, angles in rad, powers
in mW.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from facets.bench.ray_model import rotation
from facets.core.sensor import Beam, BenchLight, Facet, Psd, Sensor
from facets.core.units import Floats

#: Numbers of nodes between the edges and away from the apex; extent of the net, in the beam's
#: sigmas.
ANGLES, DISTANCES, REACH = 40, 48, 6.0


class RayBench(NamedTuple):
    """Properties of a bench's light and facets that the nominal model does not have.

    covariance: of the irradiance (2, 2), mm^2.  curvature: of the wavefront (2, 2), 1/mm.
    wavelength: mm.  metal: its complex index, None for a perfect mirror.  polarisation: rad, None
    for unpolarised light.  strips: mm, of edges 0 to 2.
    depth, width: of the roll-off at each facet's two edges (3, 2) mm, and its decay, mm.
    background: (3, 3) power and place, mW and mm.
    profile: factor of the irradiance at places (..., 2) across the beam, in standard deviations;
    None for a Gaussian beam.  chip: radius of the piece broken off the tip of the first two
    facets, mm.  tip: area, square to the
    mirror's axis, of a disc at the tip that reflects nothing, mm^2.  domes: curvatures of facets A,
    B and C, positive where their middle bulges out, 1/mm.  gain: factor of the beam's power.
    """

    covariance: Floats
    curvature: Floats
    wavelength: float
    metal: complex | None
    polarisation: float | None
    strips: Floats
    depth: Floats
    width: float
    background: Floats
    profile: Callable[[Floats], Floats] | None = None
    chip: float = 0.0
    tip: float = 0.0
    domes: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gain: float = 1.0

    @classmethod
    def from_sensor(cls, sensor: Sensor) -> RayBench:
        """The light of a sensor's beam with the effects of `sensor.light`, in its conventions.

        The power there is relative to the reflectance for unpolarised light at 45 degrees, and the
        depth of the roll-off begins at the end of a lost strip.
        """
        beam, light = sensor.beam, sensor.light
        turn = rotation(0.0, 0.0, beam.rotation)[:2, :2]
        covariance = turn @ np.diag([beam.diameter_x**2, beam.diameter_y**2]) / 16 @ turn.T
        xx, xy, yy = light.curvature_xx, light.curvature_xy, light.curvature_yy
        metal = complex(*light.index) if light.index else None
        plain = np.mean(reflectance(np.sqrt(np.array([0.5])), metal)) if metal else 1.0
        strips, width = np.array(light.strips), light.rolloff_width / 2 or 0.03
        gaps = np.column_stack([strips, np.roll(strips, -1)]) / 2
        return cls(
            covariance,
            np.array([[xx, xy], [xy, yy]]),
            light.wavelength,
            metal,
            light.polarization,
            strips,
            np.array(light.rolloff).reshape(3, 2) * np.exp(gaps / width),
            width,
            np.array(light.background),
            hermite_profile(light, covariance) if light.has_profile else None,
            tip=light.tip,
            gain=float(1 / plain),
        )


def hermite_profile(light: BenchLight, covariance: Floats) -> Callable[[Floats], Floats]:
    """The factor of the irradiance, a function of places (..., 2) in the beam, mm, that the
    coefficients of a beam's profile describe."""
    series = np.zeros((5, 5))
    series[0, 0] = 1.0
    for values in (light.profile, light.asymmetry):
        for k, value in enumerate(values):
            series[len(values) - 1 - k, k] = value
    size, axes = np.linalg.eigh(covariance)
    whitening = np.sqrt(np.trace(covariance) / 2) * axes @ np.diag(size**-0.5) @ axes.T

    def factor(places: Floats) -> Floats:
        x, y = np.moveaxis(places @ whitening, -1, 0)
        irradiance: Floats = np.polynomial.hermite_e.hermeval2d(x, y, series)
        return irradiance

    return factor


def normalise(vectors: Floats) -> Floats:
    """Vectors (..., 3) divided by their lengths."""
    size: Floats = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return size


def detector_plane(psd: Psd) -> tuple[Floats, Floats]:
    """A detector's centre (3,), and its axes by rows (3, 3)."""
    centre = np.array([psd.radius * np.cos(psd.azimuth), psd.radius * np.sin(psd.azimuth),
                       psd.height])  # fmt: skip
    return centre, rotation(psd.roll, psd.pitch, psd.azimuth + psd.yaw).T


def landing_point(start: Floats, along: Floats, psd: Psd) -> tuple[Floats, Floats]:
    """Points (..., 2) at which rays meet a detector's plane, and the rays' lengths (...)."""
    centre, (x, y, z) = detector_plane(psd)
    path = ((centre - start) @ x) / (along @ x)
    place = start + path[..., None] * along - centre
    return np.stack([place @ y, place @ z], axis=-1), path


def reflectance(cosine: Floats, index: complex) -> tuple[Floats, Floats]:
    """Reflectance of s and p light at a metal of a complex index, for cosines of the angle of
    incidence."""
    inner = np.sqrt(index**2 - 1 + cosine**2)
    s = (cosine - inner) / (cosine + inner)
    p = (index**2 * cosine - inner) / (index**2 * cosine + inner)
    return np.abs(s) ** 2, np.abs(p) ** 2


class RayBeam(NamedTuple):
    """The beam's direction and the axes of its cross-section, in the world."""

    along: Floats
    x: Floats
    y: Floats

    @classmethod
    def from_beam(cls, beam: Beam) -> RayBeam:
        """The axes of a beam in the world, from its tilts."""
        turn = rotation(beam.tilt_x, beam.tilt_y, 0.0)
        return cls(turn @ [0.0, 0.0, -1.0], turn @ [1.0, 0.0, 0.0], turn @ [0.0, 1.0, 0.0])


def edges_of(normals: Floats) -> Floats:
    """Unit vectors (3, 3) down the edges; edge k is where facet k begins."""
    edges = normalise(np.cross(normals[[2, 0, 1]], normals))
    return edges * -np.sign(edges[:, 2:])


class RayFacet(NamedTuple):
    """One facet of a sensor on a bench, at states (n, 8).

    turn: rotations of the mirror (n, 3, 3).  normal: of the facet (3,), and edges: where it begins
    and where it ends (2, 3), in the mirror's frame.  k: number of the facet and of its detector.
    """

    sensor: Sensor
    bench: RayBench
    beam: RayBeam
    states: Floats
    turn: Floats
    normal: Floats
    edges: Floats
    k: int

    @property
    def psd(self) -> Psd:
        """The detector of the facet."""
        return self.sensor.psds[self.k]

    @property
    def power(self) -> float:
        """The power of the laser, mW."""
        return self.sensor.beam.power * self.bench.gain

    @property
    def world_normal(self) -> Floats:
        """The facet's normals (n, 3) in the world."""
        return self.turn @ self.normal

    @property
    def inward(self) -> Floats:
        """Unit vectors (2, 3) from each edge into the facet, in the mirror's frame."""
        first, second = self.edges
        return np.array([np.cross(self.normal, first), np.cross(second, self.normal)])


def facet_normals(facets: Sequence[Facet]) -> Floats:
    """Normals of facets (k, 3), by rows, in the mirror's frame."""
    return np.array([[np.sin(f.inclination) * np.cos(f.azimuth),
                      np.sin(f.inclination) * np.sin(f.azimuth), np.cos(f.inclination)]
                     for f in facets])  # fmt: skip


def facet_of(sensor: Sensor, bench: RayBench, states: Floats, k: int) -> RayFacet:
    """The facet k (0 to 2) of a mirror at states (n, 8)."""
    normals, beam = facet_normals(sensor.facets), RayBeam.from_beam(sensor.beam)
    both = edges_of(normals)[[k, (k + 1) % 3]]
    return RayFacet(sensor, bench, beam, states, rotation(*states[:, 3:6].T), normals[k], both, k)


def spots(sensor: Sensor, bench: RayBench, state: Floats) -> Floats:
    """Exact readings (n, 9) at states (n, 8); the bench's light replaces the sensor's."""
    return np.hstack([spot(facet_of(sensor, bench, state, k)) for k in range(3)])


class ReflectedLight(NamedTuple):
    """Light that points of a facet reflect: its power (n,), mW, its place (n, 2), mm, and the
    reflectance at each point (n, m)."""

    power: Floats
    place: Floats
    reflected: Floats


def facet_light(
    facet: RayFacet, points: Floats, weights: Floats, slope: Floats | float = 0.0
) -> ReflectedLight:
    """The light that points (m, 3) of a facet reflect onto its detector.

    weights: areas of the points, times any further factor.  slope: (m, 3) of the surface there.
    """
    turn = np.swapaxes(facet.turn, 1, 2)
    world = facet.states[:, None, :3] + points @ turn
    density, cosine, along = incident_light(facet, world)
    reflected = reflectance_at(facet, cosine)
    weight = facet.power * density * weights * reflected
    surface = normalise(facet.normal - slope * np.ones_like(points)) @ turn
    leaving = along - 2 * (along * surface).sum(-1, keepdims=True) * surface
    place, _ = landing_point(world, leaving, facet.psd)
    power = weight.sum(axis=1)
    return ReflectedLight(
        power, (weight[..., None] * place).sum(axis=1) / power[:, None], reflected
    )


def spot(facet: RayFacet) -> Floats:
    """Place and power (n, 3) of the light of one facet."""
    bench, k = facet.bench, facet.k
    points, weights, distances = sample_facet(facet)
    if bench.chip and k < 2:
        weights = weights * (np.linalg.norm(points, axis=-1) > bench.chip)
    slope = surface_slope(facet, distances) - bench.domes[k] * points
    power, centre, reflected = facet_light(facet, points, weights, slope)
    if bench.tip:
        lost = facet_light(facet, *sample_tip(facet))
        rest = power - lost.power
        centre = (centre * power[:, None] - lost.place * lost.power[:, None]) / rest[:, None]
        power = rest
    if bench.wavelength:
        for edge in facet.edges:
            power, centre = add_diffraction(facet, edge, reflected.mean(axis=1), power, centre)
    extra, at = bench.background[k, 0], bench.background[k, 1:]
    total = power + extra
    return np.column_stack([(centre * power[:, None] + at * extra) / total[:, None], total])


def gauss_legendre(count: int, end: float) -> tuple[Floats, Floats]:
    """Nodes (count,) between 0 and an end, and their weights (count,)."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return end * (nodes + 1) / 2, end * weights / 2


def sample_sector(
    radius: float, opening: float, counts: tuple[int, int], start: float = 0.0
) -> tuple[Floats, Floats]:
    """Points (m, 2) of a circular sector, and their areas; counts: those of radii and angles."""
    (far, of_far), (turns, of_turns) = map(gauss_legendre, counts, (radius, opening))
    turns = start + turns
    points = np.stack([np.outer(far, np.cos(turns)), np.outer(far, np.sin(turns))], axis=-1)
    return points.reshape(-1, 2), np.outer(of_far * far, of_turns).ravel()


def sample_facet(facet: RayFacet) -> tuple[Floats, Floats, Floats]:
    """Points of a facet (m, 3) in the mirror's frame, their areas, their distances from edges."""
    bench, k, inward = facet.bench, facet.k, facet.inward
    first, second = facet.edges
    gaps = np.array([bench.strips[k], bench.strips[(k + 1) % 3]]) / 2
    basis = np.array([first, inward[0]])
    corner = np.linalg.solve(np.array([[basis[0] @ v, basis[1] @ v] for v in inward]), gaps)
    radius = 2 * REACH * np.sqrt(np.trace(bench.covariance))
    flat, areas = sample_sector(radius, np.arccos(first @ second), (DISTANCES, ANGLES))
    points = (corner + flat) @ basis
    return points, areas, np.column_stack([points @ v for v in inward])


def sample_tip(facet: RayFacet) -> tuple[Floats, Floats]:
    """Points (m, 3) of a facet inside the disc that is lost at the tip, and their areas."""
    first, last = (np.arctan2(edge[1], edge[0]) for edge in facet.edges)
    opening = (last - first) % (2 * np.pi)
    flat, areas = sample_sector(np.sqrt(facet.bench.tip / np.pi), opening, (6, 6), first)
    height = -(flat @ facet.normal[:2]) / facet.normal[2]
    return np.column_stack([flat, height]), areas / facet.normal[2]


def incident_light(facet: RayFacet, world: Floats) -> tuple[Floats, Floats, Floats]:
    """Flux on the facet, cosine (n, m) and direction (n, m, 3) of the rays through points (n, m,
    3)."""
    bench, beam = facet.bench, facet.beam
    from_beam = world - np.pad(facet.states[:, None, 6:], ((0, 0), (0, 0), (0, 1)))
    depth = from_beam @ beam.along
    matrix = np.eye(2) + depth[..., None, None] * bench.curvature
    aside = np.stack([from_beam @ beam.x, from_beam @ beam.y], axis=-1)
    across = np.linalg.solve(matrix, aside[..., None])[..., 0]
    fan = across @ bench.curvature
    along = beam.along + fan[..., :1] * beam.x + fan[..., 1:] * beam.y
    facing = -np.einsum("nmi,ni->nm", along, facet.world_normal)
    inverse = np.linalg.inv(bench.covariance)
    bell = np.exp(-np.einsum("nmi,ij,nmj->nm", across, inverse, across) / 2)
    bell /= 2 * np.pi * np.sqrt(np.linalg.det(bench.covariance))
    if bench.profile is not None:
        bell *= bench.profile(across / np.sqrt(np.trace(bench.covariance) / 2))
    cosine = facing / np.linalg.norm(along, axis=-1)
    return bell * facing / np.linalg.det(matrix), cosine, along


def reflectance_at(facet: RayFacet, cosine: Floats) -> Floats:
    """Reflectance (n, m) for the beam's polarisation."""
    bench, beam = facet.bench, facet.beam
    if bench.metal is None:
        return np.ones_like(cosine)
    s, p = reflectance(cosine, bench.metal)
    if bench.polarisation is None:
        return (s + p) / 2
    field = np.cos(bench.polarisation) * beam.x + np.sin(bench.polarisation) * beam.y
    upright = (normalise(np.cross(beam.along, facet.world_normal)) @ field) ** 2
    mixed: Floats = upright[:, None] * s + (1 - upright[:, None]) * p
    return mixed


def surface_slope(facet: RayFacet, distances: Floats) -> Floats:
    """Slope (m, 3) of the surface towards its edges."""
    depth, width = facet.bench.depth[facet.k], facet.bench.width
    fall: Floats = depth / width * np.exp(-np.maximum(distances, 0) / width)
    return fall @ facet.inward


def add_diffraction(
    facet: RayFacet, edge: Floats, reflected: Floats, power: Floats, centre: Floats
) -> tuple[Floats, Floats]:
    """Power (n,) and position after one edge has spread its light past the detector's window."""
    bench, beam, psd, states = facet.bench, facet.beam, facet.psd, facet.states
    world, surface = facet.turn @ edge, facet.world_normal
    far = 4 * REACH * np.sqrt(np.trace(bench.covariance))
    along, _ = gauss_legendre(64, far)
    points = states[:, None, :3] + along[:, None] * world[:, None]
    bell, _, fan = incident_light(facet, points)
    facing = -np.einsum("nmi,ni->nm", fan, surface)
    bell *= facet.power * reflected[:, None] / facing
    flat = np.stack([world @ beam.x, world @ beam.y], axis=-1)
    stretch = np.linalg.norm(flat, axis=-1)
    weight = bell * np.polynomial.legendre.leggauss(64)[1] * far / 2
    per_mm = weight.sum(axis=1) * stretch
    middle = (weight * along).sum(axis=1) / weight.sum(axis=1)
    on_edge = states[:, :3] + middle[:, None] * world
    sideways = np.stack([-flat[:, 1], flat[:, 0]], axis=-1) / stretch[:, None]
    step = sideways[:, :1] * beam.x + sideways[:, 1:] * beam.y
    step -= ((step * surface).sum(-1) / (surface @ beam.along))[:, None] * beam.along
    arriving = (weight[..., None] * fan).sum(axis=1) / weight.sum(axis=1)[:, None]
    leaving = arriving - 2 * (surface * arriving).sum(-1, keepdims=True) * surface
    spot_centre, path = landing_point(on_edge, leaving, psd)
    length = path * np.linalg.norm(leaving, axis=-1)
    across = landing_point(on_edge + 1e-3 * step, leaving, psd)[0] - spot_centre
    across /= 1e-3
    ahead, behind = (
        steps_to_window(spot_centre, across, psd),
        steps_to_window(spot_centre, -across, psd),
    )
    strength = bench.wavelength * length * per_mm / (4 * np.pi**2)
    sums = 1 / ahead + 1 / behind
    rest = power - strength * sums
    moved = (spot_centre - centre) * sums[:, None] + across * np.log(behind / ahead)[:, None]
    return rest, centre - strength[:, None] * moved / rest[:, None]


def steps_to_window(place: Floats, along: Floats, psd: Psd) -> Floats:
    """Number of steps to the edge of the sensitive area (n,)."""
    half = np.array([psd.size_y, psd.size_z]) / 2
    with np.errstate(divide="ignore"):
        steps = np.where(along > 0, (half - place) / along, (-half - place) / along)
    nearest: Floats = np.min(np.where(along == 0, np.inf, steps), axis=-1)
    return nearest
