"""A model of the readings by rays and integrals, which shares no code with the package's optics.

Each facet's light is a ray through the centroid of its wedge of the beam. The wedges are integrated
by a quadrature in NumPy, or by double integrals as in the paper.
"""

from __future__ import annotations

from collections.abc import Callable
from math import cos, exp, pi, sin

import numpy as np

from ..core.units import Floats

Angle = Floats | float


def rotation(roll: Angle, pitch: Angle, yaw: Angle) -> Floats:
    """Rotation matrices (..., 3, 3), Rz(yaw) Ry(pitch) Rx(roll), of angles (...) in rad."""
    (cr, sr), (cp, sp), (cy, sy) = ((np.cos(a), np.sin(a)) for a in (roll, pitch, yaw))
    rows = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


class RayModel:
    """The readings (n, 9) of states (n, 8) for a sensor's 30 parameters.

    nodes: number of nodes of the Gauss-Legendre rule in the angle; the radial integral has a closed
    form.
    """

    def __init__(self, p: tuple[float, ...], nodes: int = 12) -> None:
        self.rule = np.polynomial.legendre.leggauss(nodes)
        self.power = p[0]
        tilt, spin = rotation(p[4], p[5], 0.0), rotation(0.0, 0.0, p[3])
        self.frame = (tilt @ spin)[:, :2].T
        self.sigma = np.array([p[1], p[2]]) / 4
        self.down = -tilt[:, 2]
        slopes = np.array([p[6], p[8], p[10]]), np.array([p[7], p[9], p[11]])
        self.normals = np.stack(
            [np.sin(slopes[0]) * np.cos(slopes[1]), np.sin(slopes[0]) * np.sin(slopes[1]),
             np.cos(slopes[0])], axis=1
        )  # fmt: skip
        psd = np.array(p[12:]).reshape(3, 6)
        self.centres = np.stack(
            [psd[:, 0] * np.cos(psd[:, 1]), psd[:, 0] * np.sin(psd[:, 1]), psd[:, 2]], axis=1
        )
        self.axes = rotation(psd[:, 3], psd[:, 4], psd[:, 1] + psd[:, 5])

    def light(self, q: Floats, start: Floats, opening: Floats) -> tuple[Floats, Floats]:
        """Fraction of the light (n,) and its centroid (n, 2) in a wedge from q, in sigmas."""
        from scipy.special import erfc

        nodes, weights = self.rule
        angle = start[:, None] + opening[:, None] * ((nodes + 1) / 2)
        x, y = np.cos(angle), np.sin(angle)
        a = q[:, :1] * x + q[:, 1:] * y
        tail, edge = np.sqrt(np.pi / 2) * erfc(a / np.sqrt(2)), np.exp(-(a**2) / 2)
        h = q[:, :1] * y - q[:, 1:] * x
        weight = np.exp(-(h**2) / 2) * (opening[:, None] * (weights / (4 * np.pi)))
        first = edge - a * tail
        mass = (weight * first).sum(axis=1)
        weight *= tail - a * first
        return mass, q + np.stack([(weight * u).sum(axis=1) for u in (x, y)], axis=1) / mass[
            :, None
        ]

    def __call__(self, states: Floats) -> Floats:
        apex, place = states[:, :3], np.column_stack([states[:, 6:], np.zeros(len(states))])
        turn = rotation(states[:, 3], states[:, 4], states[:, 5])
        normals = np.einsum("nij,kj->nki", turn, self.normals)
        edges = np.cross(normals, np.roll(normals, 1, axis=1))
        flat = np.einsum("nki,ji->nkj", edges, self.frame) / self.sigma
        angles = np.arctan2(flat[..., 1], flat[..., 0])
        q = (apex - place) @ self.frame.T / self.sigma
        out = np.empty((len(states), 9))
        for k in range(3):
            opening = (angles[:, (k + 1) % 3] - angles[:, k]) % (2 * np.pi)
            mass, middle = self.light(q, angles[:, k], opening)
            origin = place + (middle * self.sigma) @ self.frame
            n = normals[:, k]
            drop = ((apex - origin) * n).sum(axis=1) / (n @ self.down)
            start = origin + drop[:, None] * self.down
            away = self.down - 2 * (n @ self.down)[:, None] * n
            x, y, z = self.axes[k].T
            reach = ((self.centres[k] - start) @ x) / (away @ x)
            spot = start + reach[:, None] * away - self.centres[k]
            out[:, 3 * k : 3 * k + 3] = np.stack([spot @ y, spot @ z, self.power * mass], axis=1)
        return out


class DoubleIntegrals(RayModel):
    """The same model with double integrals, as in the paper."""

    def light(self, q: Floats, start: Floats, opening: Floats) -> tuple[Floats, Floats]:
        """The fraction (n,) of the light in wedges and its centroid (n, 2), in sigmas. q: (n, 2).
        start, opening: (n,), rad."""
        wedges = zip(q, start, opening, strict=True)
        moments = np.array([moments_of_wedge(*wedge) for wedge in wedges])
        return moments[:, 0], moments[:, 1:]


def moments_of_wedge(q: Floats, start: float, opening: float) -> tuple[float, float, float]:
    """Mass and centroid (x, y) of a Gaussian beam over a wedge from q, in sigmas."""
    from scipy.integrate import dblquad

    def integral(weight: Callable[[float, float], float]) -> float:
        """The integral of a weight over the wedge, by numerical integration."""

        def integrand(s: float, angle: float) -> float:
            """The weight times the beam's density at a distance from q and an angle."""
            x, y = q[0] + s * cos(angle), q[1] + s * sin(angle)
            return s * weight(x, y) * exp(-(x * x + y * y) / 2) / (2 * pi)

        value, _ = dblquad(integrand, start, start + opening, 0, 10, epsabs=1e-12, epsrel=1e-12)
        return float(value)

    mass = integral(lambda x, y: 1.0)
    return mass, integral(lambda x, y: x) / mass, integral(lambda x, y: y) / mass
