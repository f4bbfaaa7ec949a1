"""The paper's inversion by casadi's Newton root finder, on the Gauss-Legendre form of `rivals`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..core.units import Floats
from . import rivals

SCALE = np.array([1, 1, 1, 1e-2, 1e-2, 1e-2, 1, 1])


def readings(state: Any, nodes: int = 12) -> Any:
    """Nine readings of a symbolic state (8,), as one column."""
    import casadi as ca

    places, weights = np.polynomial.legendre.leggauss(nodes)
    (cr, cp, cy), (sr, sp, sy) = ([f(state[i]) for i in (3, 4, 5)] for f in (ca.cos, ca.sin))
    rows = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    turn = ca.vertcat(*[ca.horzcat(*row) for row in rows])
    resting = rivals.SLOPE * (rivals.OUTWARD - rivals.DOWN)
    normals = [ca.mtimes(turn, ca.DM(normal)) for normal in resting]
    edges = [ca.cross(normals[k], normals[k - 1]) for k in range(3)]
    angles = [ca.atan2(edge[1], edge[0]) for edge in edges]
    q = (state[:2] - state[6:8]) / rivals.SIGMA
    out = []
    for k in range(3):
        opening = angles[(k + 1) % 3] - angles[k]
        opening += ca.if_else(opening < 0, 2 * np.pi, 0)
        mass = x = y = 0
        for place, weight in zip(places, weights, strict=True):
            angle = angles[k] + opening * (place + 1) / 2
            ux, uy = ca.cos(angle), ca.sin(angle)
            a, h = q[0] * ux + q[1] * uy, q[0] * uy - q[1] * ux
            across = ca.exp(-h * h / 2)
            zeroth = across * (1 - ca.erf(a / np.sqrt(2))) / (2 * np.sqrt(2 * np.pi))
            first = across * ca.exp(-a * a / 2) / (2 * np.pi) - a * zeroth
            second = zeroth - a * first
            mass += weight * first
            x += weight * (q[0] * first + second * ux)
            y += weight * (q[1] * first + second * uy)
        point = state[6:8] + rivals.SIGMA * ca.vertcat(x, y) / mass
        out += [*landing(point, k, normals[k], state[:3]), rivals.POWER * mass * opening / 2]
    return ca.vertcat(*out)


def landing(point: Any, k: int, normal: Any, apex: Any) -> tuple[Any, Any]:
    """Where the vertical ray through `point` lands on detector k after the facet."""
    import casadi as ca

    start = ca.vertcat(point, 0)
    down, outward = ca.DM(rivals.DOWN), ca.DM(rivals.OUTWARD[k])
    start += ca.dot(apex - start, normal) / ca.dot(down, normal) * down
    leaving = down - 2 * ca.dot(normal, down) * normal
    radius = rivals.SENSOR.psds[k].radius
    flight = (radius - ca.dot(start, outward)) / ca.dot(leaving, outward)
    spot = start + flight * leaving
    return ca.dot(spot, ca.DM(rivals.SIDEWAYS[k])), spot[2]


def solver() -> Callable[[Floats], Floats]:
    """Make a solver of readings (n, 9 or more columns) for states (n, 8), starting at zero."""
    import casadi as ca

    x, xi = ca.SX.sym("x", 8), ca.SX.sym("xi", 8)
    rest = (readings(x * SCALE) - ca.vertcat(xi, 0))[:8]
    problem = ca.Function("rest", [x, xi], [rest])
    newton = ca.rootfinder("pose", "newton", problem, {"abstol": 1e-11})

    def solve(rows: Floats) -> Floats:
        batch = newton.map(len(rows))
        found: Floats = np.array(batch(np.zeros((8, len(rows))), rows[:, :8].T))
        states: Floats = found.T * SCALE
        return states

    return solve
