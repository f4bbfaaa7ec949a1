"""How fast readings and poses are computed, beside what a user would write without this package.

    python -m facets.experiments.speed [--poses N] [--seed N]

Contenders on the same noise-free states of the paper's sensor: the paper's double integrals
(SciPy's `dblquad`), a Gauss-Legendre rule of the same integrals (radial part closed, 12 nodes in
the angle), each inverted from zero by `fsolve`; and this package. Rounds alternate between them,
the median of each is kept, and ratios are taken within the run, because machines are noisy. Errors
of readings are against the Gauss-Legendre rule with 40 nodes, those of poses against the truth.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from functools import cache
from math import cos, erf, exp, pi, sin, sqrt

import numpy as np
from scipy.integrate import dblquad
from scipy.optimize import fsolve

import facets

Moments = Callable[[np.ndarray, float, float], tuple[float, float, float]]
Contender = tuple[str, Callable[[np.ndarray], np.ndarray], int]
SENSOR = facets.Sensor()
SIGMA = SENSOR.beam.diameter_x / 4
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


def by_quadrature(state: np.ndarray, moments: Moments) -> np.ndarray:
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


@cache
def legendre(nodes: int) -> tuple[list[float], list[float]]:
    places, weights = np.polynomial.legendre.leggauss(nodes)
    return places.tolist(), weights.tolist()


def by_many_nodes(q: np.ndarray, start: float, stop: float) -> tuple[float, float, float]:
    return by_legendre(q, start, stop, 40)


def by_dblquad(q: np.ndarray, start: float, stop: float) -> tuple[float, float, float]:
    def integral(weight: Callable[[float, float], float]) -> float:
        def integrand(s: float, angle: float) -> float:
            x, y = q[0] + s * cos(angle), q[1] + s * sin(angle)
            return s * weight(x, y) * exp(-(x * x + y * y) / 2) / (2 * pi)

        value, _ = dblquad(integrand, start, stop, 0, 10, epsabs=1e-12, epsrel=1e-12)
        return float(value)

    mass = integral(lambda x, y: 1.0)
    return mass, integral(lambda x, y: x) / mass, integral(lambda x, y: y) / mass


def by_legendre(
    q: np.ndarray, start: float, stop: float, nodes: int = 12
) -> tuple[float, float, float]:
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


def solve_by_fsolve(readings: np.ndarray, moments: Moments) -> np.ndarray:
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


def seconds_per_pose(work: Callable[[np.ndarray], np.ndarray], inputs: np.ndarray) -> float:
    start = time.perf_counter()
    work(inputs)
    return (time.perf_counter() - start) / len(inputs)


def alternate(contenders: Sequence[Contender], inputs: np.ndarray, rounds: int) -> list[float]:
    """Median seconds a pose of each; the last number of a contender is how many poses it gets."""
    times: list[list[float]] = [[] for _ in contenders]
    for _, work, count in contenders:
        if count > 1000:
            work(inputs[:1])  # compiles
    for number in range(rounds):
        for taken, (_, work, count) in zip(times, contenders, strict=True):
            if number == 0 or count > 10:  # the slowest once
                taken.append(seconds_per_pose(work, inputs[:count]))
    return [float(np.median(taken)) for taken in times]


def report(
    title: str,
    contenders: Sequence[Contender],
    seconds: list[float],
    reference: int,
    errors: list[tuple[float, float]],
    units: tuple[str, str],
) -> None:
    print(f"{title:36} {'us/pose':>10} {'poses/s':>9} {'ratio':>8}"
          f" {'error, ' + units[0]:>10} {'error, ' + units[1]:>10}")  # fmt: skip
    for (name, _, _), took, (first, second) in zip(contenders, seconds, errors, strict=True):
        ratio = took / seconds[reference]
        print(f"{name:36} {took * 1e6:10.4g} {1 / took:9.3g} {ratio:8.3g}"
              f" {shown(first)} {shown(second)}")  # fmt: skip
    print()


def shown(error: float) -> str:
    return f"{error:10.1e}" if np.isfinite(error) else ""


def forward(states: np.ndarray, rounds: int) -> None:
    def one_by_one(some: np.ndarray) -> np.ndarray:
        return np.array([facets.readings(SENSOR, state) for state in some])

    def brute(moments: Moments) -> Callable[[np.ndarray], np.ndarray]:
        return lambda some: np.array([by_quadrature(state, moments) for state in some])

    contenders: list[Contender] = [
        ("dblquad", brute(by_dblquad), 2),
        ("Gauss-Legendre, 12 nodes", brute(by_legendre), 100),
        ("facets.readings, one call each", one_by_one, 2000),
        ("facets.readings", lambda some: facets.readings(SENSOR, some), len(states)),
        ("facets.jacobian", lambda some: facets.jacobian(SENSOR, some), len(states)),
    ]
    exact = brute(by_many_nodes)(states[:100])
    errors = []
    for _, work, count in contenders:
        n = min(count, 100)
        values = work(states[:n])
        if values.ndim == 3:
            errors.append((np.nan, np.nan))
            continue
        error = np.abs(values - exact[:n])
        error[:, 2::3] /= SENSOR.beam.power
        errors.append((np.delete(error, [2, 5, 8], axis=1).max(), error[:, 2::3].max()))
    seconds = alternate(contenders, states, rounds)
    report("readings, one core", contenders, seconds, 3, errors, ("mm", "P"))


def inverse(states: np.ndarray, rounds: int) -> None:
    readings = facets.readings(SENSOR, states)

    def one_by_one(xi: np.ndarray) -> np.ndarray:
        pairs = zip(xi, states[: len(xi)] + 1e-4, strict=True)
        return np.array([facets.solve(SENSOR, x, start=s).state for x, s in pairs])

    def near(xi: np.ndarray) -> np.ndarray:
        return facets.solve(SENSOR, xi, start=states[: len(xi)] + 1e-4).state

    contenders: list[Contender] = [
        ("fsolve on dblquad, from zero", lambda xi: solve_by_fsolve(xi, by_dblquad), 1),
        ("fsolve on Gauss-Legendre, from zero", lambda xi: solve_by_fsolve(xi, by_legendre), 20),
        ("facets.solve, one warm call each", one_by_one, 2000),
        ("facets.solve, from zero", lambda xi: facets.solve(SENSOR, xi).state, len(states)),
        ("facets.solve, warm", near, len(states)),
    ]
    errors = []
    for _, work, count in contenders:
        error = np.abs(work(readings[:count]) - states[:count]).max(axis=0)
        errors.append((error[[0, 1, 2, 6, 7]].max(), error[3:6].max()))
    seconds = alternate(contenders, readings, rounds)
    report("poses, 8 unknowns, one core", contenders, seconds, 3, errors, ("mm", "rad"))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--poses", type=int, default=100_000, help="for the batches")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--rounds", type=int, default=5)
    options = parser.parse_args()
    states = states_in_range(options.poses, options.seed)
    forward(states, options.rounds)
    inverse(states, options.rounds)


if __name__ == "__main__":
    main()
