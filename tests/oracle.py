"""Readings by brute force, from the physics alone: many rays, each traced on its own in space.

Shares no code and no formula with the optics. `by_quadrature` places the rays at Gauss-Legendre
nodes of the beam's cross-section and is good to some 1e-13; `by_random_rays` draws Sobol points
and asks of each ray which side of the solid pyramid it meets first.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import ndtri
from scipy.stats import qmc

from facets import Sensor

NODES, WEIGHTS = np.polynomial.legendre.leggauss(16)


@dataclass
class Setup:
    """A sensor at a state: everything in the world, mm."""

    down: np.ndarray
    across: np.ndarray
    sigmas: np.ndarray
    centre: np.ndarray
    apex: np.ndarray
    normals: np.ndarray
    power: float
    detectors: list


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
    )


def land(at: Setup, k: int, points: np.ndarray) -> np.ndarray:
    """Where rays through points (n, 2) of the cross-section, in sigmas, land on detector k."""
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
    """A vector as seen along the beam, in sigmas."""
    return (vector @ at.across) / at.sigmas


def edge(at: Setup, first: int, second: int) -> np.ndarray:
    """The direction from the apex down the edge between two facets, seen along the beam."""
    along = np.linalg.svd(at.normals[[first, second]])[2][2]
    third = 3 - first - second
    return seen(at, along if along @ at.normals[third] < 0 else -along)


def by_quadrature(sensor: Sensor, state: np.ndarray, refine: int = 1) -> np.ndarray:
    """Nine readings. refine: multiplies the number of panels, to see that it changes nothing."""
    at = setup(sensor, state)
    apex = seen(at, at.apex - at.centre)
    radius, radius_weight = panels(0, np.hypot(*apex) + 9.5, 7 * refine)
    reading = np.empty(9)
    for k in range(3):
        begin, end = edge(at, k, (k + 2) % 3), edge(at, k, (k + 1) % 3)
        start = np.arctan2(begin[1], begin[0])
        opening = (np.arctan2(end[1], end[0]) - start) % (2 * np.pi)
        angle, angle_weight = panels(start, start + opening, 4 * refine)
        ray = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        points = (apex + radius[:, None, None] * ray).reshape(-1, 2)
        density = np.exp(-(points**2).sum(axis=1) / 2) / (2 * np.pi)
        share = density * np.outer(radius * radius_weight, angle_weight).ravel()
        spots = land(at, k, points)
        reading[3 * k : 3 * k + 2] = share @ spots / share.sum()
        reading[3 * k + 2] = at.power * share.sum()
    return reading


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
