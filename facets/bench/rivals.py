"""Other ways to compute readings and poses of the paper's head.

Readings are computed by double integrals, as in the paper, and by a quadrature in NumPy; poses by
SciPy's solvers on these; both by the exported C. The head is written by vectors from the physics,
without the optics, for the symmetric sensor with a round, vertical beam.
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from functools import cache
from math import cos, exp, pi, sin, sqrt
from pathlib import Path

import numpy as np

from ..core.sensor import Sensor
from ..core.units import Floats
from ..firmware.export import export
from ..firmware.source import Provenance
from ..model.arrays import reaches

#: Compiler of the exported C, and its options.
COMPILER, OPTIONS = "gcc", ("-O3", "-march=native", "-std=c99")
#: Numbers of a solution of the exported C, its state first.
SOLUTION_NUMBERS = 77
#: Loops over many readings or states, so that a call from Python costs nothing a pose.
LOOPS = f"""\
#include "facets.c"
void all_readings(const double *states, double *found, long count)
{{
    for (long n = 0; n < count; n++) facets_readings(states + 8 * n, found + 9 * n);
}}
void all_poses(const double *readings, double *found, long count)
{{
    for (long n = 0; n < count; n++)
        facets_solve_plain(readings + 9 * n, 0, 0, found + {SOLUTION_NUMBERS} * n);
}}
"""

SENSOR = Sensor()
SIGMA = SENSOR.beam.diameter_x / 4
POWER = SENSOR.beam.power
AZIMUTHS = 2 * pi * np.arange(3) / 3
SLOPE = sqrt(0.5)
DOWN = np.array([0.0, 0.0, -1.0])
OUTWARD = np.stack([np.cos(AZIMUTHS), np.sin(AZIMUTHS), np.zeros(3)], axis=1)
SIDEWAYS = np.stack([-np.sin(AZIMUTHS), np.cos(AZIMUTHS), np.zeros(3)], axis=1)
#: Scales of the unknowns, mm and rad, and the step of differences: the root of a float's last bit.
SCALE, STEP = np.array([1, 1, 1, 1e-2, 1e-2, 1e-2, 1, 1]), 1.5e-8
Function = Callable[[Floats], Floats]


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


def readings_by_dblquad(states: Floats) -> Floats:
    """Nine readings for each state, (n, 9), by double integrals as in the paper."""
    found = np.empty((len(states), 9))
    for n, state in enumerate(states):
        normals = facet_normals(state)
        angles = edge_angles(normals)
        for k in range(3):
            start, stop = angles[k], angles[(k + 1) % 3]
            stop += 2 * pi if stop < start else 0
            mass, x, y = moments_of_wedge((state[:2] - state[6:]) / SIGMA, start, stop)
            point = state[6:] + SIGMA * np.array([x, y])
            found[n, 3 * k : 3 * k + 2] = land(point, k, normals[k], state[:3])
            found[n, 3 * k + 2] = POWER * mass
    return found


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


def readings_by_legendre(states: Floats, nodes: int = 12) -> Floats:
    """Nine readings for each state, (n, 9), all at once: Gauss-Legendre in the angle, the radial
    part in closed form."""
    places, weights = np.polynomial.legendre.leggauss(nodes)
    normals = facet_normals(states)
    start = edge_angles(normals)
    opening = ((np.roll(start, -1, axis=1) - start) % (2 * pi))[..., None]
    mass, centroid = integrate_rays(
        (states[:, :2] - states[:, 6:]) / SIGMA,
        start[..., None] + opening * (places + 1) / 2,
        opening / 2 * weights,
    )
    points = states[:, None, 6:] + SIGMA * centroid
    found = np.empty((len(states), 9))
    for k in range(3):
        found[:, 3 * k : 3 * k + 2] = land(points[:, k], k, normals[:, k], states[:, :3])
        found[:, 3 * k + 2] = POWER * mass[:, k]
    return found


def integrate_rays(apex: Floats, angle: Floats, weights: Floats) -> tuple[Floats, Floats]:
    """Mass (n, 3) and centroid (n, 3, 2) of a Gaussian beam over wedges from the apex (n, 2), by
    rays at the angles (n, 3, nodes), in sigmas."""
    from scipy.special import erfc

    ux, uy = np.cos(angle), np.sin(angle)
    q = apex[:, None, None, :]
    a, h = q[..., 0] * ux + q[..., 1] * uy, q[..., 0] * uy - q[..., 1] * ux
    zeroth = np.exp(-h * h / 2) * erfc(a / sqrt(2)) / (2 * sqrt(2 * pi))
    first = np.exp(-(a * a + h * h) / 2) / (2 * pi) - a * zeroth
    second = zeroth - a * first
    mass = (weights * first).sum(-1)
    x = (weights * (q[..., 0] * first + second * ux)).sum(-1) / mass
    y = (weights * (q[..., 1] * first + second * uy)).sum(-1) / mass
    return mass, np.stack([x, y], axis=-1)


def solve_by_scipy(model: Function, readings: Floats) -> Floats:
    """States (n, 8) of readings (n, 9), from zero, by `fsolve`: eight readings, without the third
    power, determine eight unknowns of order one.

    model: gives the readings (n, 9) of states (n, 8).
    """
    from scipy.optimize import fsolve

    def first_eight(unknowns: Floats) -> Floats:
        return model(unknowns * SCALE)[:, :8]

    def slopes(x: Floats, _: Floats) -> Floats:
        """Differences from nine states at once, which costs a vectorised model little."""
        values = first_eight(np.vstack([x, x + STEP * np.eye(8)]))
        differences: Floats = (values[1:] - values[0]).T / STEP
        return differences

    def residual(x: Floats, reading: Floats) -> Floats:
        differences: Floats = first_eight(x[None])[0] - reading[:8]
        return differences

    unknowns = [fsolve(residual, np.zeros(8), (reading,), slopes) for reading in readings]
    states: Floats = np.array(unknowns) * SCALE
    return states


def has_compiler() -> bool:
    return shutil.which(COMPILER) is not None


@cache
def exported_c() -> ctypes.CDLL:
    """The C that `facets export-c` writes for the head, compiled for this machine's processor."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for path, text in export(SENSOR, Provenance("paper", "", "facets bench")).items():
            if path.parent == Path() and path.suffix in (".c", ".h"):
                (folder / path).write_text(text)
        (folder / "loops.c").write_text(LOOPS)
        subprocess.run(
            [COMPILER, *OPTIONS, "-shared", "-fPIC", "loops.c", "-o", "loops.so", "-lm"],
            cwd=folder, check=True,
        )  # fmt: skip
        return ctypes.CDLL(str(folder / "loops.so"))


def readings_by_c(states: Floats) -> Floats:
    """Readings (n, 9) of states (n, 8)."""
    return call_c("all_readings", states, 9)


def poses_by_c(readings: Floats) -> Floats:
    """States (n, 8) of readings (n, 9), from zero, computed with their covariances."""
    return call_c("all_poses", readings, SOLUTION_NUMBERS)[:, :8]


def call_c(loop: str, rows: Floats, width: int) -> Floats:
    rows, found = np.ascontiguousarray(rows), np.empty((len(rows), width))
    pointers = (ctypes.c_void_p(array.ctypes.data) for array in (rows, found))
    getattr(exported_c(), loop)(*pointers, ctypes.c_long(len(rows)))
    return found
