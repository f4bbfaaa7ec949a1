"""Ambient occlusion: corners and gaps get less ambient light."""

from __future__ import annotations

import numpy as np

from ...core.units import Floats
from .studio import Shot

#: Directions across a pixel, and the distances along each, in radii.
DIRECTIONS, STEPS = 6, (0.25, 0.6, 1.0)


def occlusion(shot: Shot, radius: float) -> Floats:
    """Return the share of ambient light that reaches each pixel, (h, w), 0 to 1.

    radius: distance within which a part blocks light, mm. A pixel lies in a hollow if two opposite
    neighbours are on average nearer; a flat face does not, however slanted.
    """
    from scipy.ndimage import gaussian_filter

    depth = shot.depth[::2, ::2]
    height, width = depth.shape
    known = np.isfinite(depth)
    rows, columns = np.nonzero(known)
    if not len(rows):
        return np.ones(shot.depth.shape)
    here = depth[rows, columns]
    camera = shot.camera
    size = 2 * camera.pixel * (1.0 if camera.parallel else here / camera.distance)
    pixels = np.clip(radius / size, 1.5, 40)
    taken = np.zeros(len(rows))
    for n in range(DIRECTIONS):
        turn = np.pi * (n + 0.5) / DIRECTIONS
        for step in STEPS:
            down = np.rint(pixels * step * np.sin(turn)).astype(int)
            aside = np.rint(pixels * step * np.cos(turn)).astype(int)
            pair, whole = [], np.ones(len(rows), bool)
            for sign in (1, -1):
                whole &= (rows + sign * down >= 0) & (rows + sign * down < height)
                whole &= (columns + sign * aside >= 0) & (columns + sign * aside < width)
                r = np.clip(rows + sign * down, 0, height - 1)
                c = np.clip(columns + sign * aside, 0, width - 1)
                pair.append(np.clip(depth[r, c], here - 1.5 * radius, here + radius))
            hollow = here - (pair[0] + pair[1]) / 2
            near = np.clip(1.6 - 1.6 * np.abs(pair[0] - pair[1]) / (2 * radius), 0, 1)
            taken += np.clip(hollow / (0.5 * radius), 0, 1) * near * whole
    light = np.ones((height, width))
    light[rows, columns] = 1 - np.minimum(0.7, 1.3 * taken / (DIRECTIONS * len(STEPS)))
    light = gaussian_filter(light, 1.8)
    whole = np.repeat(np.repeat(light, 2, axis=0), 2, axis=1)
    return whole[: shot.depth.shape[0], : shot.depth.shape[1]]
