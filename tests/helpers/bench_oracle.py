"""Readings under the light of a bench, ray by ray: a check that shares no formula with the optics.

The rays come from a curved wavefront, each with its own direction. Of each facet the light is laid
out along its two edges as they are seen from where the light comes from, x = q + s u1 + t u2, so
that strips along the edges are bands of s and t; Gauss-Legendre nodes in every band. What a facet's
surface does near an edge is done to the single ray's normal.
"""

import itertools
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import oracle

from facets import Sensor


@dataclass
class Bench:
    """Light and edges of a bench. curvature: (2, 2), of the wavefront, 1/mm, on the beam's axes.

    strips: width lost along edges ca, ab, bc, mm.  depths: of the roll-off at the first and second
    edge of each facet, mm, linear over `width` (mm) from the lost strip on, counted on the facet.
    profile: factor of a Gaussian beam's irradiance at places x and y, in the beam's sigmas, along
    the world's axes as the beam's tilt carries them.
    """

    curvature: np.ndarray = field(default_factory=lambda: np.zeros((2, 2)))
    strips: tuple = (0.0, 0.0, 0.0)
    depths: tuple = ((0.0, 0.0),) * 3
    width: float = 1e-3
    profile: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None


def origin_of(at: oracle.Setup, bench: Bench, point: np.ndarray) -> np.ndarray:
    """Starting point (2,), in mm across the beam at its place, of the ray to a point in space."""
    away = point - at.centre
    height = away @ at.down
    return np.linalg.solve(np.eye(2) + height * bench.curvature, away @ at.across)


def rays(at: oracle.Setup, bench: Bench, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Starts and directions (n, 3) of the rays through x (n, 2), mm across the beam."""
    start = at.centre + x @ at.across.T
    aim = at.down + x @ bench.curvature @ at.across.T
    return start, aim / np.linalg.norm(aim, axis=1, keepdims=True)


def down_edge(at: oracle.Setup, first: int, second: int) -> np.ndarray:
    """Unit vector from the apex down the edge of two facets."""
    along = np.linalg.svd(at.normals[[first, second]])[2][2]
    return along if along @ at.down > 0 else -along


def bands(breaks: list, far: float) -> tuple[np.ndarray, np.ndarray]:
    """Quadrature nodes and weights over 0..far, finer near 0, with no panel across a break."""
    ends = sorted({0.0, *[b for b in breaks if b > 0], *(far * np.linspace(0, 1, 13) ** 1.5)})
    parts = [oracle.panels(a, b, 1) for a, b in itertools.pairwise(ends)]
    return np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts])


class Side:
    """Facet k at a state: its edges in space and as the light sees them, mm across the beam."""

    def __init__(self, at: oracle.Setup, bench: Bench, k: int):
        self.at, self.bench, self.k = at, bench, k
        self.normal = at.normals[k]
        self.apex = origin_of(at, bench, at.apex)
        self.along = [down_edge(at, (k + 2) % 3, k), down_edge(at, k, (k + 1) % 3)]
        self.inward = [np.cross(self.normal, self.along[0]), np.cross(self.along[1], self.normal)]
        sigma = at.sigmas.max()
        ends = [origin_of(at, bench, at.apex + sigma * e) - self.apex for e in self.along]
        self.seen = [v / np.hypot(*v) for v in ends]
        self.spread = abs(np.cross([*self.seen[0], 0], [*self.seen[1], 0])[2])

    def density(self, x: np.ndarray) -> np.ndarray:
        sigmas = self.at.sigmas
        z = x / sigmas
        gauss = np.exp(-(z**2).sum(axis=1) / 2) / np.prod(sigmas) / (2 * np.pi)
        if self.bench.profile is None:
            return gauss
        turn = self.at.rotation
        return gauss * self.bench.profile(
            np.cos(turn) * z[:, 0] - np.sin(turn) * z[:, 1],
            np.sin(turn) * z[:, 0] + np.cos(turn) * z[:, 1],
        )

    def hits(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        start, aim = rays(self.at, self.bench, x)
        reach = ((self.at.apex - start) @ self.normal) / (aim @ self.normal)
        return start + reach[:, None] * aim, aim

    def leads_away(self, own: int) -> float:
        """Distance from this edge, on the facet, for each mm along the other edge's image."""
        hit, _ = self.hits((self.apex + 1e-3 * self.seen[1 - own])[None])
        return float((hit - self.at.apex)[0] @ self.inward[own]) / 1e-3

    def nodes(self) -> tuple[np.ndarray, np.ndarray]:
        """Places and shares over the whole facet, in bands along its edges."""
        strips = [self.bench.strips[(self.k + i) % 3] / 2 for i in (0, 1)]
        ends = [(strip, strip + self.bench.width) for strip in strips]
        breaks = [[w / self.leads_away(i) for w in ends[i]] for i in (0, 1)]
        far = (np.hypot(*self.apex) + 9.5 * self.at.sigmas.max()) / self.spread
        s, ws = bands(breaks[1], far)
        t, wt = bands(breaks[0], far)
        x = self.apex + s[:, None, None] * self.seen[0] + t[None, :, None] * self.seen[1]
        x = x.reshape(-1, 2)
        return x, np.outer(ws, wt).ravel() * self.spread * self.density(x)

    def trace(self, x: np.ndarray, share: np.ndarray) -> np.ndarray:
        """Sum the rays' shares times psi, zeta and 1."""
        bench, (hits, aim) = self.bench, self.hits(x)
        normal = np.repeat(self.normal[None], len(x), axis=0)
        for i in (0, 1):
            depth = (hits - self.at.apex) @ self.inward[i] - bench.strips[(self.k + i) % 3] / 2
            share = np.where(depth < 0, 0.0, share)
            slope = np.where(depth < bench.width, bench.depths[self.k][i] / bench.width, 0.0)
            normal = normal - slope[:, None] * self.inward[i]
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        leaving = aim - 2 * (aim * normal).sum(axis=1, keepdims=True) * normal
        place, axes = self.at.detectors[self.k]
        flight = ((place - hits) @ axes[:, 0]) / (leaving @ axes[:, 0])
        spots = (hits + flight[:, None] * leaving - place) @ axes[:, 1:]
        return np.array([*(share @ spots), share.sum()])


def by_rays(sensor: Sensor, state: np.ndarray, bench: Bench) -> np.ndarray:
    """Nine readings, without diffraction, a flat tip, a coating and other light."""
    at = oracle.setup(sensor, state)
    reading = np.empty(9)
    for k in range(3):
        side = Side(at, bench, k)
        sums = side.trace(*side.nodes())
        reading[3 * k : 3 * k + 2] = sums[:2] / sums[2]
        reading[3 * k + 2] = at.power * sums[2]
    return reading
