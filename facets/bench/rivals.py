"""Other ways to the readings of the paper's sensor, written from the physics, without the optics.

`dblquad` is the paper's method; Gauss-Legendre in the angle, with the radial part in closed form,
is the best of the short methods; rays are the method of optics packages. All are for the symmetric
sensor with a round, vertical beam.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from math import cos, erf, exp, pi, sin, sqrt

import numpy as np

from ..core.sensor import Sensor
from ..core.units import Floats
from ..model.arrays import reaches

Moments = Callable[[Floats, float, float], tuple[float, float, float]]

SENSOR = Sensor()
SIGMA = SENSOR.beam.diameter_x / 4
POWER = SENSOR.beam.power
AZIMUTHS = 2 * pi * np.arange(3) / 3
SLOPE = sqrt(0.5)
DOWN = np.array([0.0, 0.0, -1.0])
OUTWARD = np.stack([np.cos(AZIMUTHS), np.sin(AZIMUTHS), np.zeros(3)], axis=1)
SIDEWAYS = np.stack([-np.sin(AZIMUTHS), np.cos(AZIMUTHS), np.zeros(3)], axis=1)


def turn(roll: Floats, pitch: Floats, yaw: Floats) -> Floats:
    """Rz(yaw) Ry(pitch) Rx(roll), (..., 3, 3)."""
    (cr, sr), (cp, sp), (cy, sy) = ((np.cos(a), np.sin(a)) for a in (roll, pitch, yaw))
    rows = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def facet_normals(states: Floats) -> Floats:
    """(..., 3, 3): the normals of A, B, C in the world."""
    resting = SLOPE * (OUTWARD - DOWN)
    turned = turn(*np.moveaxis(states[..., 3:6], -1, 0))
    normals: Floats = np.einsum("...ij,kj->...ki", turned, resting)
    return normals


def edge_directions(normals: Floats) -> Floats:
    """(..., 3, 3): the edge where each facet begins, from the apex down."""
    return np.cross(normals, np.roll(normals, 1, axis=-2))


def edge_angles(normals: Floats) -> Floats:
    """(..., 3): the angle, seen from above, of the edge where each facet begins."""
    edges = edge_directions(normals)
    return np.arctan2(edges[..., 1], edges[..., 0])


def land(points: Floats, k: int, normal: Floats, apex: Floats) -> Floats:
    """Where vertical rays through (x, y) land on detector k after the facet: (..., 2)."""
    start = np.concatenate([points, np.zeros((*points.shape[:-1], 1))], axis=-1)
    depth = ((apex - start) * normal).sum(-1) / (DOWN * normal).sum(-1)
    start = start + depth[..., None] * DOWN
    leaving = DOWN - 2 * (normal @ DOWN)[..., None] * normal
    radius = SENSOR.psds[k].radius
    flight = (radius - start @ OUTWARD[k]) / (leaving @ OUTWARD[k])
    spot = start + flight[..., None] * leaving
    return np.stack([spot @ SIDEWAYS[k], spot[..., 2]], axis=-1)


def moment_readings(states: Floats, moments: Moments) -> Floats:
    """Nine readings per state; `moments(apex, start, stop)` integrates over a wedge, in sigmas."""
    out = np.empty((len(states), 9))
    for n, state in enumerate(states):
        normals = facet_normals(state)
        angles = edge_angles(normals)
        for k in range(3):
            start, stop = angles[k], angles[(k + 1) % 3]
            stop += 2 * pi if stop < start else 0
            mass, x, y = moments((state[:2] - state[6:]) / SIGMA, start, stop)
            point = state[6:] + SIGMA * np.array([x, y])
            out[n, 3 * k : 3 * k + 2] = land(point, k, normals[k], state[:3])
            out[n, 3 * k + 2] = POWER * mass
    return out


def dblquad(states: Floats) -> Floats:
    return moment_readings(states, dblquad_moments)


def dblquad_moments(q: Floats, start: float, stop: float) -> tuple[float, float, float]:
    from scipy.integrate import dblquad

    def integral(weight: Callable[[float, float], float]) -> float:
        def integrand(s: float, angle: float) -> float:
            x, y = q[0] + s * cos(angle), q[1] + s * sin(angle)
            return s * weight(x, y) * exp(-(x * x + y * y) / 2) / (2 * pi)

        value, _ = dblquad(integrand, start, stop, 0, 10, epsabs=1e-12, epsrel=1e-12)
        return float(value)

    mass = integral(lambda x, y: 1.0)
    return mass, integral(lambda x, y: x) / mass, integral(lambda x, y: y) / mass


@cache
def legendre(nodes: int) -> tuple[tuple[float, ...], tuple[float, ...]]:
    places, weights = np.polynomial.legendre.leggauss(nodes)
    return tuple(places.tolist()), tuple(weights.tolist())


def legendre_moments(nodes: int) -> Moments:
    """Moments of one wedge by Gauss-Legendre in the angle, in plain Python."""

    def moments(q: Floats, start: float, stop: float) -> tuple[float, float, float]:
        mass = x = y = 0.0
        for node, weight in zip(*legendre(nodes), strict=True):
            angle = (start + stop + node * (stop - start)) / 2
            ux, uy = cos(angle), sin(angle)
            a, h = q[0] * ux + q[1] * uy, q[0] * uy - q[1] * ux
            zeroth = exp(-h * h / 2) * (1 - erf(a / sqrt(2))) / (2 * sqrt(2 * pi))
            first = exp(-(a * a + h * h) / 2) / (2 * pi) - a * zeroth
            second = zeroth - a * first
            share = weight * (stop - start) / 2
            mass += share * first
            x += share * (q[0] * first + second * ux)
            y += share * (q[1] * first + second * uy)
        return mass, x / mass, y / mass

    return moments


def legendre_batch(states: Floats, nodes: int) -> Floats:
    """Readings of all states at once by Gauss-Legendre in the angle, in NumPy."""
    from scipy.special import erfc

    places, weights = np.polynomial.legendre.leggauss(nodes)
    normals = facet_normals(states)
    start = edge_angles(normals)
    opening = (np.roll(start, -1, axis=1) - start) % (2 * pi)
    angle = start[..., None] + opening[..., None] * (places + 1) / 2
    ux, uy = np.cos(angle), np.sin(angle)
    q = ((states[:, :2] - states[:, 6:]) / SIGMA)[:, None, None, :]
    a, h = q[..., 0] * ux + q[..., 1] * uy, q[..., 0] * uy - q[..., 1] * ux
    zeroth = np.exp(-h * h / 2) * erfc(a / sqrt(2)) / (2 * sqrt(2 * pi))
    first = np.exp(-(a * a + h * h) / 2) / (2 * pi) - a * zeroth
    second = zeroth - a * first
    share = opening[..., None] / 2 * weights
    mass = (share * first).sum(-1)
    x = (share * (q[..., 0] * first + second * ux)).sum(-1) / mass
    y = (share * (q[..., 1] * first + second * uy)).sum(-1) / mass
    points = states[:, None, 6:] + SIGMA * np.stack([x, y], axis=-1)
    out = np.empty((len(states), 9))
    for k in range(3):
        out[:, 3 * k : 3 * k + 2] = land(points[:, k], k, normals[:, k], states[:, :3])
        out[:, 3 * k + 2] = POWER * mass[:, k]
    return out


def rays(states: Floats, points: Floats) -> Floats:
    """Readings by tracing rays through standard normal points (n, 2) of the cross-section."""
    out = np.empty((len(states), 9))
    for n, state in enumerate(states):
        normals = facet_normals(state)
        where = state[6:] + SIGMA * points
        start = np.concatenate([where, np.zeros((len(where), 1))], axis=1)
        # a ray is inside the pyramid once it has crossed the last of its three planes
        facet = (((state[:3] - start) @ normals.T) / (normals @ DOWN)).argmax(axis=1)
        for k in range(3):
            mine = where[facet == k]
            out[n, 3 * k : 3 * k + 2] = land(mine, k, normals[k], state[:3]).mean(axis=0)
            out[n, 3 * k + 2] = POWER * len(mine) / len(where)
    return out


def random_points(count: int, seed: int) -> Floats:
    return np.random.default_rng(seed).standard_normal((count, 2))


def sobol_points(count: int, seed: int) -> Floats:
    """Sobol points, 2^k >= count of them, so that the sequence keeps its balance."""
    from scipy.special import ndtri
    from scipy.stats import qmc

    sequence = qmc.Sobol(2, rng=np.random.default_rng(seed))
    points: Floats = ndtri(sequence.random_base2(int(np.ceil(np.log2(count)))))
    return points


def states_in_range(count: int, seed: int) -> Floats:
    """Random states whose three spots lie on their detectors."""
    half = np.array([0.1, 0.1, 6.0, 12e-3, 12e-3, 24e-3, 0.05, 0.05])
    rng = np.random.default_rng(seed)
    kept: list[Floats] = []
    while sum(map(len, kept)) < count:
        drawn = rng.uniform(-half, half, (2 * count + 1000, 8))
        kept.append(drawn[reaches(SENSOR, drawn).all(axis=1)])
    return np.concatenate(kept)[:count]
