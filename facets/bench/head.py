"""The paper's head by vectors, for the other methods: normals, edges and where rays land.

Written from the physics, without the optics, for the symmetric sensor with a round, vertical beam.
"""

from __future__ import annotations

from math import pi, sqrt

import numpy as np

from ..core.sensor import Sensor
from ..core.units import Floats
from ..model.arrays import reaches

SENSOR = Sensor()
SIGMA = SENSOR.beam.diameter_x / 4
POWER = SENSOR.beam.power
AZIMUTHS = 2 * pi * np.arange(3) / 3
SLOPE = sqrt(0.5)
DOWN = np.array([0.0, 0.0, -1.0])
OUTWARD = np.stack([np.cos(AZIMUTHS), np.sin(AZIMUTHS), np.zeros(3)], axis=1)
SIDEWAYS = np.stack([-np.sin(AZIMUTHS), np.cos(AZIMUTHS), np.zeros(3)], axis=1)


def turn(roll: Floats, pitch: Floats, yaw: Floats) -> Floats:
    """The rotation Rz(yaw) Ry(pitch) Rx(roll), (..., 3, 3)."""
    (cr, sr), (cp, sp), (cy, sy) = ((np.cos(a), np.sin(a)) for a in (roll, pitch, yaw))
    rows = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def facet_normals(states: Floats) -> Floats:
    """The normals of facets A, B, C in the world, (..., 3, 3)."""
    resting = SLOPE * (OUTWARD - DOWN)
    turned = turn(*np.moveaxis(states[..., 3:6], -1, 0))
    normals: Floats = np.einsum("...ij,kj->...ki", turned, resting)
    return normals


def edge_angles(normals: Floats) -> Floats:
    """The angle (..., 3), seen from above, of the edge where each facet begins."""
    edges = np.cross(normals, np.roll(normals, 1, axis=-2))
    return np.arctan2(edges[..., 1], edges[..., 0])


def land(points: Floats, k: int, normal: Floats, apex: Floats) -> Floats:
    """The points (..., 2) on detector k to which the facet turns vertical rays through (x, y)."""
    start = np.concatenate([points, np.zeros((*points.shape[:-1], 1))], axis=-1)
    depth = ((apex - start) * normal).sum(-1) / (DOWN * normal).sum(-1)
    start = start + depth[..., None] * DOWN
    leaving = DOWN - 2 * (normal @ DOWN)[..., None] * normal
    radius = SENSOR.psds[k].radius
    flight = (radius - start @ OUTWARD[k]) / (leaving @ OUTWARD[k])
    spot = start + flight[..., None] * leaving
    return np.stack([spot @ SIDEWAYS[k], spot[..., 2]], axis=-1)


def states_in_range(count: int, seed: int) -> Floats:
    """Random states whose three spots lie on their detectors."""
    half = np.array([0.1, 0.1, 6.0, 12e-3, 12e-3, 24e-3, 0.05, 0.05])
    rng = np.random.default_rng(seed)
    kept: list[Floats] = []
    while sum(map(len, kept)) < count:
        drawn = rng.uniform(-half, half, (2 * count + 1000, 8))
        kept.append(drawn[reaches(SENSOR, drawn).all(axis=1)])
    return np.concatenate(kept)[:count]
