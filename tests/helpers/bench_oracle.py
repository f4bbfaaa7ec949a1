"""Readings under the light of a bench, ray by ray: a check that shares no formula with the optics.

The rays come from a curved wavefront, each with its own direction. Of each facet the light is laid
out along its two edges as they are seen from where the light comes from, x = q + s u1 + t u2, so
that strips along the edges are bands of s and t; Gauss-Legendre nodes in every band. What a facet's
surface does near an edge is done to the single ray's normal.
"""

import itertools
from dataclasses import dataclass, field

import numpy as np
import oracle

from facets import Sensor


@dataclass
class Bench:
    """What the rays meet. curvature: (2, 2) of the wavefront, 1/mm, along the beam's axes.

    strips: width lost along edges ca, ab, bc, mm.  depths: of the roll-off at the first and second
    edge of each facet, mm, linear over `width` (mm), counted on the facet.  tip: radius of a flat
    disc at the apex, mm.  reflect: share reflected, of (ray direction, normal).
    """

    curvature: np.ndarray = field(default_factory=lambda: np.zeros((2, 2)))
    strips: tuple = (0.0, 0.0, 0.0)
    depths: tuple = ((0.0, 0.0),) * 3
    width: float = 1e-3
    tip: float = 0.0


def origin_of(at: oracle.Setup, bench: Bench, point: np.ndarray) -> np.ndarray:
    """Where, in mm across the beam at its place, the ray to a point in space starts: (2,)."""
    away = point - at.centre
    height = away @ at.down
    return np.linalg.solve(np.eye(2) + height * bench.curvature, away @ at.across)


def rays(at: oracle.Setup, bench: Bench, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Starts and directions (n, 3) of the rays through x (n, 2), mm across the beam."""
    start = at.centre + x @ at.across.T
    aim = at.down + x @ bench.curvature @ at.across.T
    return start, aim / np.linalg.norm(aim, axis=1, keepdims=True)


def edge_in_space(at: oracle.Setup, first: int, second: int) -> np.ndarray:
    along = np.linalg.svd(at.normals[[first, second]])[2][2]
    third = 3 - first - second
    return along if along @ at.normals[third] > 0 else -along


def down_edge(at: oracle.Setup, first: int, second: int) -> np.ndarray:
    """From the apex down the edge of two facets, a unit vector."""
    along = edge_in_space(at, first, second)
    return along if along @ at.down > 0 else -along


def bands(breaks: list, far: float) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and weights over 0..far, finer near 0, with no panel across a break."""
    ends = sorted({0.0, *[b for b in breaks if b > 0], *(far * np.linspace(0, 1, 13) ** 1.5)})
    parts = [oracle.panels(a, b, 1) for a, b in itertools.pairwise(ends)]
    return np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts])


def by_rays(sensor: Sensor, state: np.ndarray, bench: Bench) -> np.ndarray:
    """Nine readings, without diffraction and background."""
    at = oracle.setup(sensor, state)
    reading = np.empty(9)
    apex = origin_of(at, bench, at.apex)
    sigma = at.sigmas.max()
    far = np.hypot(*apex) + 9.5 * sigma
    for k in range(3):
        first, second = down_edge(at, (k + 2) % 3, k), down_edge(at, k, (k + 1) % 3)
        u = [origin_of(at, bench, at.apex + sigma * e) - apex for e in (first, second)]
        u = [v / np.hypot(*v) for v in u]
        inward = [np.cross(at.normals[k], first), np.cross(second, at.normals[k])]
        edges = [k, (k + 1) % 3]
        spread = abs(u[0][0] * u[1][1] - u[0][1] * u[1][0])
        # by how much a step along one edge leads away from the other, on the facet
        away = []
        for own, other in ((0, 1), (1, 0)):
            start, aim = rays(at, bench, (apex + 1e-3 * u[other])[None])
            reach = ((at.apex - start) @ at.normals[k]) / (aim @ at.normals[k])
            away.append(float((start + reach[:, None] * aim - at.apex)[0] @ inward[own]) / 1e-3)
        breaks = [[bench.strips[edges[i]] / 2 / away[i], bench.width / away[i]] for i in (0, 1)]
        s, ws = bands(breaks[1], far / spread)
        t, wt = bands(breaks[0], far / spread)
        x = (apex + s[:, None, None] * u[0] + t[None, :, None] * u[1]).reshape(-1, 2)
        share = np.outer(ws, wt).ravel() * spread / np.prod(at.sigmas) / (2 * np.pi)
        share = share * np.exp(-((x / at.sigmas) ** 2).sum(axis=1) / 2)
        start, aim = rays(at, bench, x)
        normal = np.repeat(at.normals[k][None], len(x), axis=0)
        reach = ((at.apex - start) @ at.normals[k]) / (aim @ at.normals[k])
        hits = start + reach[:, None] * aim
        for i in (0, 1):
            depth = (hits - at.apex) @ inward[i]
            share = np.where(depth < bench.strips[edges[i]] / 2, 0.0, share)
            slope = np.where(depth < bench.width, bench.depths[k][i] / bench.width, 0.0)
            normal = normal - slope[:, None] * inward[i]
        if bench.tip:
            axis = -np.linalg.solve(at.normals, -np.ones(3))
            axis /= np.linalg.norm(axis)
            beside = hits - at.apex
            beside = beside - np.outer(beside @ axis, axis)
            share = np.where(np.linalg.norm(beside, axis=1) < bench.tip, 0.0, share)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        leaving = aim - 2 * (aim * normal).sum(axis=1, keepdims=True) * normal
        place, axes = at.detectors[k]
        flight = ((place - hits) @ axes[:, 0]) / (leaving @ axes[:, 0])
        spots = (hits + flight[:, None] * leaving - place) @ axes[:, 1:]
        reading[3 * k : 3 * k + 2] = share @ spots / share.sum()
        reading[3 * k + 2] = at.power * share.sum()
    return reading
