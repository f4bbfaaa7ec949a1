"""How fast a pose is solved, beside what a user would write without this package.

    python -m facets.experiments.solve_speed [--poses N] [--seed N]

Contenders, on the same noise-free readings of the paper's sensor, from zero: `fsolve` on the
paper's double integrals (`dblquad`), `fsolve` on a Gauss-Legendre rule of the same integrals
(radial part closed, 12 nodes in the angle), and `facets.solve`. Rounds alternate between them, the
median of each is kept, and ratios are taken within the run, because machines are noisy.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from math import cos, erf, exp, pi, sin, sqrt

import numpy as np
from scipy.integrate import dblquad
from scipy.optimize import fsolve

import facets

Forward = Callable[[np.ndarray], np.ndarray]
SENSOR = facets.Sensor()
SIGMA = SENSOR.beam.diameter_x / 4
NODES, WEIGHTS = np.polynomial.legendre.leggauss(12)
AZIMUTHS = 2 * pi * np.arange(3) / 3


def turn(roll: float, pitch: float, yaw: float) -> np.ndarray:
    z = np.array([[cos(yaw), -sin(yaw), 0], [sin(yaw), cos(yaw), 0], [0, 0, 1]])
    y = np.array([[cos(pitch), 0, sin(pitch)], [0, 1, 0], [-sin(pitch), 0, cos(pitch)]])
    x = np.array([[1, 0, 0], [0, cos(roll), -sin(roll)], [0, sin(roll), cos(roll)]])
    return z @ y @ x


def trace(point: np.ndarray, k: int, normal: np.ndarray, apex: np.ndarray) -> tuple[float, float]:
    """Where the ray through (x, y) of the beam lands on detector k after the facet."""
    down = np.array([0.0, 0.0, -1.0])
    start = np.array([point[0], point[1], 0.0])
    start = start + down * ((apex - start) @ normal) / (down @ normal)
    leaving = down - 2 * (down @ normal) * normal
    outward = np.array([cos(AZIMUTHS[k]), sin(AZIMUTHS[k]), 0])
    sideways = np.array([-sin(AZIMUTHS[k]), cos(AZIMUTHS[k]), 0])
    spot = start + leaving * (SENSOR.psds[k].radius - start @ outward) / (leaving @ outward)
    return float(spot @ sideways), float(spot[2])


def by_quadrature(state: np.ndarray, moments: Callable[..., tuple]) -> np.ndarray:
    """Nine readings; `moments(apex, start, stop)` gives mass and centroid of a wedge, in sigmas."""
    mirror = turn(*state[3:6])
    slope = sqrt(0.5)
    normals = [mirror @ np.array([slope * cos(a), slope * sin(a), slope]) for a in AZIMUTHS]
    edges = [np.cross(normals[k], normals[k - 1]) for k in range(3)]
    angles = [np.arctan2(edge[1], edge[0]) for edge in edges]
    reading = np.empty(9)
    for k in range(3):
        start, stop = angles[k], angles[(k + 1) % 3]
        stop += 2 * pi if stop < start else 0
        mass, x, y = moments((state[:2] - state[6:]) / SIGMA, start, stop)
        point = state[6:] + SIGMA * np.array([x, y])
        reading[3 * k : 3 * k + 2] = trace(point, k, normals[k], state[:3])
        reading[3 * k + 2] = SENSOR.beam.power * mass
    return reading


def by_dblquad(q: np.ndarray, start: float, stop: float) -> tuple[float, float, float]:
    def integral(weight: Callable[[float, float], float]) -> float:
        def integrand(s: float, angle: float) -> float:
            x, y = q[0] + s * cos(angle), q[1] + s * sin(angle)
            return s * weight(x, y) * exp(-(x * x + y * y) / 2) / (2 * pi)

        value, _ = dblquad(integrand, start, stop, 0, 10, epsabs=1e-12, epsrel=1e-12)
        return float(value)

    mass = integral(lambda x, y: 1.0)
    return mass, integral(lambda x, y: x) / mass, integral(lambda x, y: y) / mass


def by_legendre(q: np.ndarray, start: float, stop: float) -> tuple[float, float, float]:
    mass = x = y = 0.0
    for node, weight in zip(NODES, WEIGHTS, strict=True):
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


def solve_by_fsolve(readings: np.ndarray, moments: Callable[..., tuple]) -> np.ndarray:
    """The paper's inversion: eight readings, eight unknowns, scaled to be of order one."""
    scale = np.array([1, 1, 1, 1e-2, 1e-2, 1e-2, 1, 1])
    poses = [
        fsolve(lambda x, xi=xi: (by_quadrature(x * scale, moments) - xi)[:8], np.zeros(8)) * scale
        for xi in readings
    ]
    return np.array(poses)


def states_in_range(count: int, seed: int) -> np.ndarray:
    """Random states whose three spots lie on their detectors."""
    rng = np.random.default_rng(seed)
    half = np.array([0.1, 0.1, 6.0, 12e-3, 12e-3, 24e-3, 0.05, 0.05])
    drawn = rng.uniform(-half, half, (8 * count, 8))
    return drawn[facets.reaches(SENSOR, drawn).all(axis=1)][:count]


def seconds_per_pose(solve: Callable[[np.ndarray], np.ndarray], readings: np.ndarray) -> float:
    start = time.perf_counter()
    solve(readings)
    return (time.perf_counter() - start) / len(readings)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--poses", type=int, default=100_000, help="for facets.solve")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--rounds", type=int, default=5)
    options = parser.parse_args()
    states = states_in_range(options.poses, options.seed)
    readings = facets.readings(SENSOR, states)

    def single(xi: np.ndarray) -> np.ndarray:
        starts = states[: len(xi)] + 1e-4
        pairs = zip(xi, starts, strict=True)
        return np.array([facets.solve(SENSOR, x, start=s).state for x, s in pairs])

    contenders: dict[str, tuple[Callable[[np.ndarray], np.ndarray], int]] = {
        "fsolve with dblquad": (lambda xi: solve_by_fsolve(xi, by_dblquad), 1),
        "fsolve with Gauss-Legendre": (lambda xi: solve_by_fsolve(xi, by_legendre), 20),
        "facets.solve, from zero": (lambda xi: facets.solve(SENSOR, xi).state, options.poses),
        "facets.solve, no covariance": (
            lambda xi: facets.solve(SENSOR, xi, covariance=False).state,
            options.poses,
        ),
        "facets.solve, one warm call each": (single, 2000),
    }
    times: dict[str, list[float]] = {name: [] for name in contenders}
    facets.solve(SENSOR, readings[:1])
    for number in range(options.rounds):
        for name, (solve, count) in contenders.items():
            if number == 0 or count > 1:  # the slowest once
                times[name].append(seconds_per_pose(solve, readings[:count]))
    ours = float(np.median(times["facets.solve, from zero"]))
    print(f"{'inverse, 8 unknowns, one core':34} {'us/pose':>12} {'poses/s':>10} {'ratio':>9}"
          f" {'error, mm':>10} {'error, rad':>10}")  # fmt: skip
    for name, (solve, count) in contenders.items():
        took = float(np.median(times[name]))
        error = np.abs(solve(readings[:count]) - states[:count]).max(axis=0)
        length, angle = error[[0, 1, 2, 6, 7]].max(), error[3:6].max()
        print(f"{name:34} {took * 1e6:12.2f} {1 / took:10.3g} {took / ours:9.3g}"
              f" {length:10.1e} {angle:10.1e}")  # fmt: skip


if __name__ == "__main__":
    main()
