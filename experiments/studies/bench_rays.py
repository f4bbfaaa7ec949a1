"""Readings of a sensor on a bench, by rays: an oracle for calibrations that shares no optics.

Every facet is covered by a net of points, Gauss nodes in the angle between its edges and in the
distance from its apex. Through each point goes the ray of a beam with an elliptical cross-section
and a curved wavefront; it is reflected at the surface as it is there, rolled off towards the edges,
with a metal's reflectance for the light's polarisation, and lands on the detector's plane. What the
strips along the edges lose is left out of the net. Diffraction at the edges is added by its closed
form (two terms for each edge), since rays know none; background light is added last.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from facets.core.sensor import Psd, Sensor
from facets.core.units import Floats

#: Nodes between the edges and away from the apex; how far the net goes, in the beam's sigmas.
ANGLES, DISTANCES, REACH = 40, 48, 6.0


class RayBench(NamedTuple):
    """The properties of the light that the nominal model does not have.

    covariance: of the irradiance (2, 2), mm^2.  curvature: of the wavefront (2, 2), 1/mm.
    wavelength: mm.  metal: its complex index, None for a perfect mirror.  polarisation: rad.
    strips: mm, of edges 0 to 2.
    depth, width: of the roll-off at each facet's two edges (3, 2) mm, and its decay, mm.
    background: (3, 3) power and place, mW and mm.
    profile: factor of the irradiance at places (..., 2) across the beam, in standard deviations;
    None for a Gaussian beam.  chip: radius of the piece broken off the tip of the first two
    facets, mm.
    """

    covariance: Floats
    curvature: Floats
    wavelength: float
    metal: complex | None
    polarisation: float
    strips: Floats
    depth: Floats
    width: float
    background: Floats
    profile: Callable[[Floats], Floats] | None = None
    chip: float = 0.0


def rotation_about(axis: int, angle: Floats | float) -> Floats:
    """Rotations (..., 3, 3) about x, y or z."""
    angle = np.asarray(angle, dtype=float)
    c, s = np.cos(angle), np.sin(angle)
    out = np.zeros((*angle.shape, 3, 3))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    out[..., axis, axis] = 1
    out[..., i, i] = out[..., j, j] = c
    out[..., i, j], out[..., j, i] = -s, s
    return out


def normalise(vectors: Floats) -> Floats:
    size: Floats = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return size


def detector_plane(psd: Psd) -> tuple[Floats, Floats]:
    """A detector's centre (3,), and its axes by rows (3, 3)."""
    centre = np.array([psd.radius * np.cos(psd.azimuth), psd.radius * np.sin(psd.azimuth),
                       psd.height])  # fmt: skip
    turn = (
        rotation_about(2, psd.azimuth + psd.yaw)
        @ rotation_about(1, psd.pitch)
        @ rotation_about(0, psd.roll)
    )
    return centre, turn.T


def landing_point(start: Floats, along: Floats, psd: Psd) -> tuple[Floats, Floats]:
    """Points (..., 2) at which rays meet a detector's plane, and the rays' lengths (...)."""
    centre, (x, y, z) = detector_plane(psd)
    path = ((centre - start) @ x) / (along @ x)
    beside = start + path[..., None] * along - centre
    return np.stack([beside @ y, beside @ z], axis=-1), path


def reflectance(cosine: Floats, index: complex) -> tuple[Floats, Floats]:
    """Reflectance of s and p light at a metal."""
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
    def from_sensor(cls, sensor: Sensor) -> RayBeam:
        turn = rotation_about(1, sensor.beam.tilt_y) @ rotation_about(0, sensor.beam.tilt_x)
        return cls(turn @ [0.0, 0.0, -1.0], turn @ [1.0, 0.0, 0.0], turn @ [0.0, 1.0, 0.0])


def edges_of(normals: Floats) -> Floats:
    """Unit vectors (3, 3) down the edges; edge k is where facet k begins."""
    found = normalise(np.cross(normals[[2, 0, 1]], normals))
    return found * -np.sign(found[:, 2:])


def spots(sensor: Sensor, bench: RayBench, state: Floats) -> Floats:
    """Exact readings (n, 9) at states (n, 8)."""
    normals = np.array([[np.sin(f.inclination) * np.cos(f.azimuth),
                         np.sin(f.inclination) * np.sin(f.azimuth), np.cos(f.inclination)]
                        for f in sensor.facets])  # fmt: skip
    edges = edges_of(normals)
    parts = [rotation_about(2 - i, state[:, 5 - i]) for i in range(3)]
    turn = parts[0] @ parts[1] @ parts[2]
    out = np.empty((len(state), 9))
    for k in range(3):
        out[:, 3 * k : 3 * k + 3] = facet(sensor, bench, state, turn, normals[k], edges, k)
    return out


def facet(
    sensor: Sensor,
    bench: RayBench,
    state: Floats,
    turn: Floats,
    normal: Floats,
    edges: Floats,
    k: int,
) -> Floats:
    """Place and power (n, 3) of the light of one facet."""
    beam, psd = RayBeam.from_sensor(sensor), sensor.psds[k]
    points, area, distances = sample_facet(bench, normal, edges[k], edges[(k + 1) % 3], k)
    world = state[:, None, :3] + points @ np.swapaxes(turn, 1, 2)
    density, cosine, along = incident_light(bench, beam, world, state, turn, normal)
    reflected = reflected_share(bench, beam, cosine, turn @ normal)
    weight = sensor.beam.power * density * area * reflected
    if bench.chip and k < 2:
        weight = weight * (np.linalg.norm(points, axis=-1) > bench.chip)
    tilted = normal - surface_slope(bench, distances, normal, edges[k], edges[(k + 1) % 3], k)
    surface = normalise(tilted) @ np.swapaxes(turn, 1, 2)
    leaving = along - 2 * (along * surface).sum(-1, keepdims=True) * surface
    place, _ = landing_point(world, leaving, psd)
    power = weight.sum(axis=1)
    centre = (weight[..., None] * place).sum(axis=1) / power[:, None]
    if bench.wavelength:
        for edge in (edges[k], edges[(k + 1) % 3]):
            power, centre = add_diffraction(
                sensor, bench, beam, state, turn, normal, edge, reflected.mean(axis=1), power,
                centre, k,
            )  # fmt: skip
    extra, at = bench.background[k, 0], bench.background[k, 1:]
    whole = power + extra
    return np.column_stack([(centre * power[:, None] + at * extra) / whole[:, None], whole])


def sample_facet(
    bench: RayBench, normal: Floats, first: Floats, second: Floats, k: int
) -> tuple[Floats, Floats, Floats]:
    """Points of a facet (m, 3) in the mirror's frame, their areas, their distances from edges."""
    inward = np.cross(normal, first), np.cross(second, normal)
    angle = np.arccos(first @ second)
    gaps = np.array([bench.strips[k], bench.strips[(k + 1) % 3]]) / 2
    basis = np.array([first, inward[0]])
    corner = np.linalg.solve(np.array([[basis[0] @ v, basis[1] @ v] for v in inward]), gaps)
    nodes, weights = np.polynomial.legendre.leggauss(ANGLES)
    turns, of_turns = angle * (nodes + 1) / 2, angle * weights / 2
    nodes, weights = np.polynomial.legendre.leggauss(DISTANCES)
    size = 2 * REACH * np.sqrt(np.trace(bench.covariance))
    far, of_far = size * (nodes + 1) / 2, size * weights / 2
    flat = np.stack([np.outer(far, np.cos(turns)), np.outer(far, np.sin(turns))], axis=-1)
    points = (corner + flat.reshape(-1, 2)) @ basis
    return points, np.outer(of_far * far, of_turns).ravel(), np.column_stack(
        [points @ v for v in inward])  # fmt: skip


def incident_light(
    bench: RayBench, beam: RayBeam, world: Floats, state: Floats, turn: Floats, normal: Floats
) -> tuple[Floats, Floats, Floats]:
    """Flux on the facet, cosine and direction of the rays through points."""
    beside = world - np.pad(state[:, None, 6:], ((0, 0), (0, 0), (0, 1)))
    depth = beside @ beam.along
    matrix = np.eye(2) + depth[..., None, None] * bench.curvature
    seen = np.stack([beside @ beam.x, beside @ beam.y], axis=-1)
    across = np.linalg.solve(matrix, seen[..., None])[..., 0]
    fan = across @ bench.curvature
    along = beam.along + fan[..., :1] * beam.x + fan[..., 1:] * beam.y
    facing = -np.einsum("nmi,ni->nm", along, turn @ normal)
    inverse = np.linalg.inv(bench.covariance)
    bell = np.exp(-np.einsum("nmi,ij,nmj->nm", across, inverse, across) / 2)
    bell /= 2 * np.pi * np.sqrt(np.linalg.det(bench.covariance))
    if bench.profile is not None:
        bell *= bench.profile(across / np.sqrt(np.trace(bench.covariance) / 2))
    cosine = facing / np.linalg.norm(along, axis=-1)
    return bell * facing / np.linalg.det(matrix), cosine, along


def reflected_share(bench: RayBench, beam: RayBeam, cosine: Floats, normal: Floats) -> Floats:
    """Reflected share of the light (n, m)."""
    if bench.metal is None:
        return np.ones_like(cosine)
    field = np.cos(bench.polarisation) * beam.x + np.sin(bench.polarisation) * beam.y
    upright = (normalise(np.cross(beam.along, normal)) @ field) ** 2
    s, p = reflectance(cosine, bench.metal)
    mixed: Floats = upright[:, None] * s + (1 - upright[:, None]) * p
    return mixed


def surface_slope(
    bench: RayBench, distances: Floats, normal: Floats, first: Floats, second: Floats, k: int
) -> Floats:
    """Slope (m, 3) of the surface towards its edges."""
    inward = np.array([np.cross(normal, first), np.cross(second, normal)])
    fall = bench.depth[k] / bench.width * np.exp(-np.maximum(distances, 0) / bench.width)
    found: Floats = fall @ inward
    return found


def add_diffraction(
    sensor: Sensor, bench: RayBench, beam: RayBeam, state: Floats, turn: Floats, normal: Floats,
    edge: Floats, reflected: Floats, power: Floats, centre: Floats, k: int,
) -> tuple[Floats, Floats]:  # fmt: skip
    """Power and position after one edge has spread its light past the detector's window."""
    psd, world = sensor.psds[k], turn @ edge
    nodes, weights = np.polynomial.legendre.leggauss(64)
    far = 4 * REACH * np.sqrt(np.trace(bench.covariance))
    along = far * (nodes + 1) / 2
    points = state[:, None, :3] + along[:, None] * world[:, None]
    bell, _, fan = incident_light(bench, beam, points, state, turn, normal)
    facing = -np.einsum("nmi,ni->nm", fan, turn @ normal)
    bell *= sensor.beam.power * reflected[:, None] / facing
    flat = np.stack([world @ beam.x, world @ beam.y], axis=-1)
    stretch = np.linalg.norm(flat, axis=-1)
    weight = bell * weights * far / 2
    per_mm = weight.sum(axis=1) * stretch
    middle = (weight * along).sum(axis=1) / weight.sum(axis=1)
    surface = turn @ normal
    on_edge = state[:, :3] + middle[:, None] * world
    sideways = np.stack([-flat[:, 1], flat[:, 0]], axis=-1) / stretch[:, None]
    step = sideways[:, :1] * beam.x + sideways[:, 1:] * beam.y
    step -= ((step * surface).sum(-1) / (surface @ beam.along))[:, None] * beam.along
    arriving = (weight[..., None] * fan).sum(axis=1) / weight.sum(axis=1)[:, None]
    leaving = arriving - 2 * (surface * arriving).sum(-1, keepdims=True) * surface
    here, length = landing_points(on_edge, leaving, psd)
    across = landing_points(on_edge + 1e-3 * step, leaving, psd)[0] - here
    across /= 1e-3
    ahead, behind = steps_to_window(here, across, psd), steps_to_window(here, -across, psd)
    strength = bench.wavelength * length * per_mm / (4 * np.pi**2)
    sums = 1 / ahead + 1 / behind
    left = power - strength * sums
    moved = (here - centre) * sums[:, None] + across * np.log(behind / ahead)[:, None]
    return left, centre - strength[:, None] * moved / left[:, None]


def landing_points(start: Floats, along: Floats, psd: Psd) -> tuple[Floats, Floats]:
    place, path = landing_point(start, along, psd)
    return place, path * np.linalg.norm(along, axis=-1)


def steps_to_window(place: Floats, along: Floats, psd: Psd) -> Floats:
    """Number of steps to the edge of the sensitive area (n,)."""
    half = np.array([psd.size_y, psd.size_z]) / 2
    with np.errstate(divide="ignore"):
        steps = np.where(along > 0, (half - place) / along, (-half - place) / along)
    nearest: Floats = np.min(np.where(along == 0, np.inf, steps), axis=-1)
    return nearest
