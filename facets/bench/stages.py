"""Where a pose's time goes: the chain compiled up to each stage in turn, and ways to its heart.

Importing this imports Numba.
"""

from __future__ import annotations

from math import erf, erfc, exp, pi, sqrt
from typing import Any

import numpy as np

from ..model import kernels
from ..model.jit import compiler
from ..model.kernels import state_of, unpack
from ..optics.forward import placed, readings_of, shone_on
from ..optics.gradient import linearised
from ..optics.wedge import side, swept_series

Array = Any

compiled = compiler(__file__, calls=(kernels,))


@compiled
def up_to_placed(packed: Array, states: Array, out: Array) -> None:
    sensor = unpack(packed)
    for n in range(len(states)):
        at = placed(sensor, state_of(states, n))
        out[n] = at.q[0] + at.sides[0][0] + at.sides[1][0] + at.sides[2][0]


@compiled
def up_to_sides(packed: Array, states: Array, out: Array) -> None:
    sensor = unpack(packed)
    for n in range(len(states)):
        at = placed(sensor, state_of(states, n))
        total = 0.0
        for k in range(3):
            length, first, second, swept = side(at.q, at.sides[k])
            total += length + first + second + swept
        out[n] = total


@compiled
def up_to_light(packed: Array, states: Array, out: Array) -> None:
    sensor = unpack(packed)
    for n in range(len(states)):
        at = shone_on(placed(sensor, state_of(states, n)))
        total = 0.0
        for k in range(3):
            mass, centroid, shift, _ = at.moments[k]
            total += mass + centroid[0] + centroid[1] + shift[0] + shift[1] + shift[2]
        out[n] = total


@compiled
def up_to_readings(packed: Array, states: Array, out: Array) -> None:
    sensor = unpack(packed)
    for n in range(len(states)):
        detectors = readings_of(sensor, shone_on(placed(sensor, state_of(states, n))))
        total = 0.0
        for k in range(3):
            total += detectors[k][0] + detectors[k][1] + detectors[k][2]
        out[n] = total


@compiled
def up_to_jacobian(packed: Array, states: Array, out: Array) -> None:
    sensor = unpack(packed)
    for n in range(len(states)):
        detectors = linearised(sensor, state_of(states, n))
        total = 0.0
        for k in range(3):
            for i in range(3):
                for c in range(8):
                    total += detectors[k][1][i][c]
        out[n] = total


#: In the order of the chain: each does what the one before does, and more.
CHAIN = {
    "mirror turned; its edges seen along the beam": up_to_placed,
    "special functions of three edges": up_to_sides,
    "mass; centroid and covariance on three facets": up_to_light,
    "three rays to the detectors": up_to_readings,
    "their 72 derivatives": up_to_jacobian,
}


@compiled
def by_series(points: Array, out: Array) -> None:
    """What a side sweeps over, by the series that the optics uses; points (n, 2): a, h."""
    for n in range(len(points)):
        a, h = points[n, 0], points[n, 1]
        along, across = exp(-a * a / 2), exp(-h * h / 2)
        out[n] = swept_series(a, h, along, across, erfc(a / sqrt(2.0)), erf(h / sqrt(2.0)))


@compiled
def by_quadrature(points: Array, nodes: Array, weights: Array, out: Array) -> None:
    """The same with the series' integral by Gauss-Legendre; nodes on 0..1."""
    for n in range(len(points)):
        a, h = points[n, 0], points[n, 1]
        wide = abs(a) >= abs(h)
        larger, smaller = (a, h) if wide else (h, a)
        x, t = larger * larger / 2, smaller / larger
        total = 0.0
        for i in range(len(nodes)):
            around = 1 + (t * nodes[i]) ** 2
            total += weights[i] * (1 - exp(-x * around)) / around
        total *= t / (2 * pi)
        within = erf(h / sqrt(2.0))
        out[n] = erfc(a / sqrt(2.0)) * within / 4 + total if wide else within / 4 - total


def by_library(points: Array, out: Array) -> None:
    """The same from SciPy's Owen's T (Patefield and Tandy)."""
    from scipy import special

    a, h = points.T
    wide = np.abs(a) >= np.abs(h)
    larger, t = np.where(wide, a, h), np.where(wide, h / a, a / h)
    total = np.arctan(t) / (2 * pi) - special.owens_t(larger, t)
    within = special.erf(h / sqrt(2.0))
    out[:] = np.where(wide, special.erfc(a / sqrt(2.0)) * within / 4 + total, within / 4 - total)
