"""Readings of imperfect optics, by rays: what the closed form leaves out.

For simulations: to see what a coating, a diverging beam, facets that are not flat or diffraction at
their edges do to poses that are solved without a thought of them. Each wedge of light is sampled in
polar coordinates about the apex, where it is smooth up to its edges, so that some hundred rays are
as good as a closed form.

Diffraction at a facet's edge spreads light to both sides across it: at the distance s from the spot
the share K / s^2 for each mm, K = wavelength x path / 4 pi^2 x light along the edge (Fresnel). Most
of it lands on the detector and leaves the centroid where it is; what misses the detector is lost.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from ..core.sensor import Imperfections, Sensor
from ..model.arrays import geometry_of, half_sizes, readings
from ..optics.forward import Geometry, Scene, placed

Floats = NDArray[np.float64]

#: Nodes over a wedge's angle and radius, and where the light ends, in sigmas.
ANGLES, RADII, FAR = 20, 40, 9.0


def seen(sensor: Sensor, states: Floats) -> Floats:
    """Readings (n, 9) at states (n, 8), imperfect where `sensor.imperfections` says so."""
    if sensor.imperfections == Imperfections():
        return readings(sensor, states)
    fixed, halves = geometry_of(sensor), half_sizes(sensor)
    return np.array([traced(fixed, sensor.imperfections, state, halves) for state in states])


def traced(fixed: Geometry, flaws: Imperfections, state: Floats, halves: Floats) -> Floats:
    """One reading (9,). halves: (3, 2) of the detectors' areas, mm."""
    at = placed(fixed, tuple(state.tolist()))
    out = np.empty(9)
    for k in range(3):
        weights, offsets = nodes(at, k)
        spread: Floats = np.array(fixed.spread)
        start = np.array(at.place) + offsets @ spread
        direction = np.array(fixed.direction)
        start += np.outer((np.array(at.apex) - start) @ direction, direction)  # level with the apex
        aim = direction + offsets @ spread / flaws.wavefront_radius
        aim /= np.linalg.norm(aim, axis=1, keepdims=True)
        out[3 * k : 3 * k + 3] = landed(fixed, at, k, flaws, start, aim, weights)
        if flaws.wavelength:
            out[3 * k : 3 * k + 3] += lost(fixed, at, k, flaws, out[3 * k : 3 * k + 3], halves[k])
    return out


@cache
def gauss(count: int) -> tuple[Floats, Floats]:
    """Gauss and Legendre's nodes and weights from -1 to 1, found once."""
    found: tuple[Floats, Floats] = np.polynomial.legendre.leggauss(count)
    return found


def nodes(at: Scene, k: int) -> tuple[Floats, Floats]:
    """Shares of the beam (n,) and places (n, 2) in sigmas from its centre, over the wedge of k."""
    q = np.array(at.q)
    first, last = (np.arctan2(side[1], side[0]) for side in (at.sides[k], at.sides[(k + 1) % 3]))
    last = first + (last - first) % (2 * np.pi)
    x, wx = gauss(ANGLES)
    r, wr = gauss(RADII)
    angle = first + (x + 1) / 2 * (last - first)
    far = np.hypot(*q) + FAR
    radius = (r + 1) / 2 * far
    unit = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    places = q + radius[None, :, None] * unit[:, None, :]
    density = np.exp(-(places**2).sum(axis=-1) / 2) / (2 * np.pi)
    area = wx[:, None] * wr[None, :] * radius * (last - first) / 2 * far / 2
    return (density * area).ravel(), places.reshape(-1, 2)


def landed(
    fixed: Geometry, at: Scene, k: int, flaws: Imperfections, start: Floats, aim: Floats,
    weights: Floats,
) -> Floats:  # fmt: skip
    """psi, zeta and power of detector k from rays (n, 3) and their shares."""
    normal, apex = np.array(at.normals[k]), np.array(at.apex)
    along = ((apex - start) @ normal) / (aim @ normal)
    foot = start + along[:, None] * aim
    beside = foot - apex
    tilt = 8 * flaws.sag[k] / flaws.sag_over**2  # a dome leans outward by so much a mm
    face = normal + tilt * (beside - np.outer(beside @ normal, normal))
    face /= np.linalg.norm(face, axis=1, keepdims=True)
    cosine = -(aim * face).sum(axis=1)
    leaving = aim + 2 * cosine[:, None] * face
    axes, centre = np.array(fixed.axes[k]), np.array(fixed.centres[k])
    length = ((centre - foot) @ axes[0]) / (leaving @ axes[0])
    spot = foot + length[:, None] * leaving - centre
    light = weights * reflected(fixed, flaws, aim, face, cosine)
    whole = light.sum()
    return np.array([light @ (spot @ axes[1]) / whole, light @ (spot @ axes[2]) / whole,
                     fixed.power * whole])  # fmt: skip


def lost(
    fixed: Geometry, at: Scene, k: int, flaws: Imperfections, spot: Floats, half: Floats
) -> Floats:
    """What diffracted light that misses detector k takes off its reading (3,)."""
    spread: Floats = np.array(fixed.spread)
    axes = np.array(fixed.axes[k])
    direction, normal = np.array(fixed.direction), np.array(at.normals[k])
    path = np.linalg.norm(np.array(fixed.centres[k]) - np.array(at.apex))
    out = np.zeros(3)
    for side in (np.array(at.sides[k]), np.array(at.sides[(k + 1) % 3])):
        edge = side @ spread
        across = np.cross(direction, edge / np.linalg.norm(edge))
        across -= 2 * (across @ normal) * normal
        way = axes[1:] @ across
        size = flaws.wavelength * path / (4 * np.pi**2) * along(fixed, at, side) / spot[2]
        ahead, behind = (reach(spot[:2], way * sign, half) for sign in (1, -1))
        out[:2] -= size * way * np.log(behind / ahead)
        out[2] -= spot[2] * size * (1 / ahead + 1 / behind)
    return out


def along(fixed: Geometry, at: Scene, side: Floats) -> float:
    """Light along an edge, mW/mm."""
    x, weights = gauss(RADII)
    far = np.hypot(*at.q) + FAR
    places = np.array(at.q) + np.outer((x + 1) / 2 * far, side)
    whole = weights @ np.exp(-(places**2).sum(axis=1) / 2) * far / 2 / (2 * np.pi)
    spread: Floats = np.array(fixed.spread)
    area = np.linalg.norm(np.cross(*spread))  # of a square of one sigma
    return float(fixed.power * whole * np.linalg.norm(side @ spread) / area)


def reach(spot: Floats, way: Floats, half: Floats) -> float:
    """From a spot to the edge of a detector, along a direction, mm; NaN from beside it."""
    with np.errstate(divide="ignore"):
        room = (half - np.sign(way) * spot) / np.abs(way)
    return float(room.min()) if (room > 0).all() else np.nan


def reflected(
    fixed: Geometry, flaws: Imperfections, aim: Floats, face: Floats, cosine: Floats
) -> Floats:
    """How much of each ray is reflected, over what is of unpolarised light at 45 degrees."""
    if flaws.index is None:
        return np.ones(len(aim))
    s, p = reflectances(complex(*flaws.index), cosine)
    plain = sum(reflectances(complex(*flaws.index), np.sqrt(0.5)))
    if flaws.polarization is None:
        return (s + p) / plain
    x = np.array(fixed.spread[0]) / np.linalg.norm(fixed.spread[0])
    y = np.cross(np.array(fixed.direction), x)
    field = np.cos(flaws.polarization) * x - np.sin(flaws.polarization) * y
    across = np.cross(aim, face)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    share = (across @ field) ** 2
    both: Floats = 2 * (share * s + (1 - share) * p) / plain
    return both


def reflectances(index: complex, cosine: Floats | float) -> tuple[Floats, Floats]:
    """Of light across and along the plane of incidence (s, p), by Fresnel."""
    inside = np.sqrt(index**2 - 1 + np.asarray(cosine) ** 2 + 0j)
    s = (cosine - inside) / (cosine + inside)
    p = (index**2 * cosine - inside) / (index**2 * cosine + inside)
    return np.abs(s) ** 2, np.abs(p) ** 2
