"""Readings from the physics alone, by rays that are traced in space one by one.

The module shares no code and no formula with the optics. `by_strips` cuts the beam's cross-section
into strips along all limits, and is good to some 1e-13; `by_random_rays` draws Sobol points and
determines for each ray which side of the solid pyramid it meets first.
"""

import itertools
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import ndtr, ndtri
from scipy.stats import qmc

from facets import MeasuredObject, Sensor

NODES, WEIGHTS = np.polynomial.legendre.leggauss(16)


def object_motion(poses: np.ndarray, body: MeasuredObject) -> tuple[np.ndarray, Rotation]:
    """Positions (..., 3) and axes of an object at poses (..., 6) of the mirror, by quaternions."""
    turn = Rotation.from_euler("xyz", poses[..., 3:6])
    place = poses[..., :3] + turn.apply(body.point)
    return place, turn * Rotation.from_euler("xyz", body.orientation)


@dataclass
class Setup:
    """A sensor at a state, in world coordinates, mm."""

    down: np.ndarray
    across: np.ndarray
    sigmas: np.ndarray
    centre: np.ndarray
    apex: np.ndarray
    normals: np.ndarray
    power: float
    detectors: list
    rotation: float


def setup(sensor: Sensor, state: np.ndarray) -> Setup:
    tx, ty, tz, roll, pitch, yaw, bx, by = state
    beam = sensor.beam
    aim = Rotation.from_euler("ZYX", [0, beam.tilt_y, beam.tilt_x])
    frame = (aim * Rotation.from_euler("Z", beam.rotation)).as_matrix()
    mirror = Rotation.from_euler("ZYX", [yaw, pitch, roll])
    normals = [
        mirror.apply(Rotation.from_euler("ZY", [f.azimuth, f.inclination]).apply([0, 0, 1]))
        for f in sensor.facets
    ]
    detectors = []
    for psd in sensor.psds:
        place = Rotation.from_euler("Z", psd.azimuth).apply([psd.radius, 0, psd.height])
        turn = Rotation.from_euler("ZYX", [psd.azimuth + psd.yaw, psd.pitch, psd.roll])
        detectors.append((place, turn.as_matrix()))
    return Setup(
        down=-frame[:, 2],
        across=frame[:, :2],
        sigmas=np.array([beam.diameter_x, beam.diameter_y]) / 4,
        centre=np.array([bx, by, 0.0]),
        apex=np.array([tx, ty, tz]),
        normals=np.array(normals),
        power=beam.power,
        detectors=detectors,
        rotation=beam.rotation,
    )


def land(at: Setup, k: int, points: np.ndarray) -> np.ndarray:
    """Landing points on detector k of rays through points (n, 2) of the cross-section, sigmas."""
    start = at.centre + (points * at.sigmas) @ at.across.T
    normal = at.normals[k]
    far = ((at.apex - start) @ normal) / (at.down @ normal)
    hits = start + far[:, None] * at.down
    leaving = at.down - 2 * (at.down @ normal) * normal
    place, axes = at.detectors[k]
    flight = ((place - hits) @ axes[:, 0]) / (leaving @ axes[:, 0])
    spots = hits + flight[:, None] * leaving - place
    return spots @ axes[:, 1:]


def panels(start: float, stop: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    width = (stop - start) / count
    middle = start + width * (np.arange(count) + 0.5)
    return (middle[:, None] + width / 2 * NODES).ravel(), np.tile(width / 2 * WEIGHTS, count)


def seen(at: Setup, vector: np.ndarray) -> np.ndarray:
    """Project a vector along the beam; the result is in sigmas."""
    return (vector @ at.across) / at.sigmas


def edge(at: Setup, first: int, second: int) -> np.ndarray:
    """Direction from the apex down the edge between two facets, seen along the beam."""
    along = np.linalg.svd(at.normals[[first, second]])[2][2]
    third = 3 - first - second
    return seen(at, along if along @ at.normals[third] < 0 else -along)


def by_random_rays(sensor: Sensor, state: np.ndarray, count: int, seed: int) -> np.ndarray:
    """Nine readings from 2^count Sobol rays; which facet a ray meets is decided ray by ray."""
    at = setup(sensor, state)
    points = ndtri(qmc.Sobol(2, rng=np.random.default_rng(seed)).random_base2(count))
    start = at.centre + (points * at.sigmas) @ at.across.T
    # a ray enters the pyramid where it has crossed the last of the planes it meets from outside
    depth = ((at.apex - start) @ at.normals.T) / (at.down @ at.normals.T)
    facet = depth.argmax(axis=1)
    reading = np.empty(9)
    for k in range(3):
        mine = points[facet == k]
        reading[3 * k : 3 * k + 2] = land(at, k, mine).mean(axis=0)
        reading[3 * k + 2] = at.power * len(mine) / len(points)
    return reading


def clearances(sensor: Sensor, at: Setup, state: np.ndarray, k: int, points: np.ndarray):
    """Clearances (n, m), mm, of rays through points (n, 2) at each limit of facet and detector k.

    They are computed from the traced points in space, limit by limit.
    """
    mirror = Rotation.from_euler("ZYX", state[[5, 4, 3]])
    start = at.centre + (points * at.sigmas) @ at.across.T
    far = ((at.apex - start) @ at.normals[k]) / (at.down @ at.normals[k])
    hits = start + far[:, None] * at.down - at.apex
    apertures = sensor.apertures
    clear = []
    for other in ((k + 2) % 3, (k + 1) % 3):
        along = np.cross(at.normals[k], at.normals[other])
        across = np.cross(along / np.linalg.norm(along), at.normals[k])
        inward = across if across @ at.normals[other] < 0 else -across
        clear.append(hits @ inward - apertures.gap / 2)
    azimuth = sensor.facets[k].azimuth
    reach = mirror.inv().apply(hits) @ [np.cos(azimuth), np.sin(azimuth), 0]
    clear.append(reach - apertures.tip)
    if np.isfinite(apertures.rim):
        clear.append(apertures.rim - reach)
    if apertures.detectors:
        spots = land(at, k, points)
        for i, size in enumerate((sensor.psds[k].size_y, sensor.psds[k].size_z)):
            clear += [size / 2 - spots[:, i], size / 2 + spots[:, i]]
    return np.stack(clear, axis=1)


def lines_of_limits(sensor: Sensor, at: Setup, state: np.ndarray, k: int) -> np.ndarray:
    """Coefficients (m, 3) c0, cx, cy of each limit c0 + cx x + cy y > 0, from three rays."""
    origin, x, y = clearances(sensor, at, state, k, np.array([[0.0, 0], [1, 0], [0, 1]]))
    return np.stack([origin, x - origin, y - origin], axis=1)


def kinks(lines: np.ndarray, radius: float) -> np.ndarray:
    """Values of x at which lines cross each other or the circle."""
    found = [-radius, radius]
    for i, (c, a, b) in enumerate(lines):
        norm = np.hypot(a, b)
        a, b, c = a / norm, b / norm, c / norm
        if abs(c) < radius:
            half = np.sqrt(radius**2 - c * c)
            found += [-c * a - half * b, -c * a + half * b]
        for e, f, g in lines[:i]:
            if abs(a * g - b * f) > 1e-12:
                found.append((b * e - g * c) / (a * g - b * f))
    return np.unique(np.clip(found, -radius, radius))


def by_strips(sensor: Sensor, state: np.ndarray, radius: float = 12.0) -> np.ndarray:
    """Nine readings with all limits, by strips of the cross-section that the limits cut.

    A strip's integrals along y are erf and exp, across strips Gauss-Legendre between all kinks.
    """
    at = setup(sensor, state)
    radius = min(radius, 2 * sensor.apertures.beam)
    reading = np.full(9, np.nan)
    for k in range(3):
        lines = lines_of_limits(sensor, at, state, k)
        borders = np.arcsin(kinks(lines, radius) / radius)  # strips narrow at the circle's ends
        parts = [panels(a, b, 8) for a, b in itertools.pairwise(borders)]
        angle = np.concatenate([part[0] for part in parts])
        x, weight = radius * np.sin(angle), np.concatenate([part[1] for part in parts])
        weight = weight * radius * np.cos(angle) * np.exp(-x * x / 2) / np.sqrt(2 * np.pi)
        high = radius * np.cos(angle)
        low = -high
        for c, a, b in lines:
            border = -(c + a * x) / b if b else np.where(c + a * x > 0, -np.inf, np.inf)
            if b < 0:
                high = np.minimum(high, border)
            else:
                low = np.maximum(low, border)
        high = np.maximum(high, low)
        amount = weight * (ndtr(high) - ndtr(low))
        moment = weight * (np.exp(-low * low / 2) - np.exp(-high * high / 2)) / np.sqrt(2 * np.pi)
        share = amount.sum()
        if share > 1e-7:
            point = np.array([[amount @ x, moment.sum()]]) / share
            reading[3 * k : 3 * k + 2] = land(at, k, point)[0]
            reading[3 * k + 2] = at.power * share
    return reading
