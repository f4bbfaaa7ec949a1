"""The paper's method: the light of each facet by double integrals."""

from __future__ import annotations

from collections.abc import Callable
from math import cos, exp, pi, sin

import numpy as np

from ..core.units import Floats
from .head import POWER, SIGMA, edge_angles, facet_normals, land


def readings_by_dblquad(states: Floats) -> Floats:
    """Nine readings for each state, (n, 9)."""
    readings = np.empty((len(states), 9))
    for n, state in enumerate(states):
        normals = facet_normals(state)
        angles = edge_angles(normals)
        for k in range(3):
            start, stop = angles[k], angles[(k + 1) % 3]
            stop += 2 * pi if stop < start else 0
            mass, x, y = moments_of_wedge((state[:2] - state[6:]) / SIGMA, start, stop)
            point = state[6:] + SIGMA * np.array([x, y])
            readings[n, 3 * k : 3 * k + 2] = land(point, k, normals[k], state[:3])
            readings[n, 3 * k + 2] = POWER * mass
    return readings


def moments_of_wedge(apex: Floats, start: float, stop: float) -> tuple[float, float, float]:
    """Mass and centroid of a Gaussian beam over a wedge between two angles, in sigmas."""
    from scipy.integrate import dblquad

    def integral(weight: Callable[[float, float], float]) -> float:
        def integrand(s: float, angle: float) -> float:
            x, y = apex[0] + s * cos(angle), apex[1] + s * sin(angle)
            return s * weight(x, y) * exp(-(x * x + y * y) / 2) / (2 * pi)

        value, _ = dblquad(integrand, start, stop, 0, 10, epsabs=1e-12, epsrel=1e-12)
        return float(value)

    mass = integral(lambda x, y: 1.0)
    return mass, integral(lambda x, y: x) / mass, integral(lambda x, y: y) / mass
