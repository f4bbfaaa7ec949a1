"""The irradiance on the detectors as the paper prints it, Eq. (7) to (9), for comparison.

Eq. (8) measures the distance from the beam's image along y and z as if the two were independent.
The ellipse in which an oblique sub-beam cuts the detector has a cross term besides; without it the
irradiance is exact only where the sub-beam is level or lies in the plane of x and z. The integrals
run over the whole wedge between the images of the mirror's edges, in floats, by Gauss-Legendre
quadrature in polar coordinates about the apex's image.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..core.errors import InputError
from ..core.units import Floats
from .forward import Geometry, LitFacet, Path, mirror_facets, path, scene
from .rays import flight, hit, land
from .vectors import Vector, add, dot

NODES, WEIGHTS = np.polynomial.legendre.leggauss(32)
PANELS = 4
#: Radius, in sigmas about the beam's image, beyond which the neglected light is below 1e-17.
EDGE = 9.0


class SubBeamImage(NamedTuple):
    """The image on a detector's plane: (y, z), mm, in the detector's frame.

    apex: Q of Fig. 2.  beam: S.  edges: directions of the images of the two edges.  leaving: the
    sub-beam's direction in the detector's frame, x first.
    """

    apex: Floats
    beam: Floats
    edges: tuple[Floats, Floats]
    leaving: Floats


def landing_point(facet: LitFacet, start: Vector, leaving: Vector) -> Floats:
    axes, centre = facet.axes, facet.centre
    return np.array(land(start, leaving, flight(start, leaving, centre, axes), centre, axes))


def sub_beam_image(facet: LitFacet, ray: Path) -> SubBeamImage:
    leaving, at = ray.leaving, facet.at
    apex = landing_point(facet, at.apex, leaving)
    under_beam = hit(at.place, facet.geometry.direction, at.apex, facet.normal)
    first, second = (
        landing_point(facet, add(at.apex, edge), leaving) - apex for edge in facet.edges
    )
    return SubBeamImage(
        apex=apex,
        beam=landing_point(facet, under_beam, leaving),
        edges=(first, second),
        leaving=np.array([dot(leaving, axis) for axis in facet.axes]),
    )


def panels(start: float | Floats, stop: float | Floats) -> tuple[Floats, Floats]:
    """Nodes and weights of a composite rule on start..stop, on a new last axis."""
    width = (np.asarray(stop) - np.asarray(start))[..., None, None] / PANELS
    middle = np.asarray(start)[..., None, None] + width * (np.arange(PANELS)[:, None] + 0.5)
    nodes = middle + width / 2 * NODES
    weights = np.broadcast_to(width / 2 * WEIGHTS, nodes.shape)
    shape = (*nodes.shape[:-2], -1)
    return nodes.reshape(shape), weights.reshape(shape)


def angles(edges: tuple[Floats, Floats]) -> tuple[float, float]:
    """The angle at which the wedge's image begins, and its signed opening (a mirror flips it)."""
    (y1, z1), (y2, z2) = edges
    return np.arctan2(z1, y1), np.arctan2(y1 * z2 - z1 * y2, y1 * y2 + z1 * z2)


def integrate(seen: SubBeamImage, power: float, diameter: float) -> tuple[float, float, float]:
    """Eq. (9): centroid (psi, zeta) and power of the irradiance of Eq. (7) and (8)."""
    px, py, pz = seen.leaving
    ky, kz = px**2 / (px**2 + py**2), px**2 / (px**2 + pz**2)
    start, opening = angles(seen.edges)
    angle, angle_weight = panels(start, start + opening)
    uy, uz = np.cos(angle), np.sin(angle)
    offset_y, offset_z = seen.apex - seen.beam
    square = ky * uy**2 + kz * uz**2
    nearest = -(ky * uy * offset_y + kz * uz * offset_z) / square
    reach = np.maximum(nearest, 0) + EDGE * diameter / 4 / np.sqrt(square)
    s, weight = panels(np.zeros_like(reach), reach)
    y, z = seen.apex[0] + s * uy[:, None], seen.apex[1] + s * uz[:, None]
    r2 = ky * (y - seen.beam[0]) ** 2 + kz * (z - seen.beam[1]) ** 2
    irradiance = 8 * power / (np.pi * diameter**2) * np.exp(-8 * r2 / diameter**2)
    irradiance *= px / np.sqrt(px**2 + py**2 + pz**2)
    light = irradiance * s * weight * np.abs(angle_weight)[:, None]
    total = light.sum()
    return float((light * y).sum() / total), float((light * z).sum() / total), float(total)


def paper_readings(geometry: Geometry, states: Floats) -> Floats:
    """Readings (n, 9) at states (n, 8) by the paper's irradiance; NaN as for the exact ones."""
    sigma_x, sigma_y = (np.sqrt(dot(axis, axis)) for axis in geometry.spread)
    if not np.isclose(sigma_x, sigma_y, rtol=1e-12):
        raise InputError("the paper's irradiance needs a round beam; make both diameters equal")
    out = np.full((len(states), 9), np.nan)
    for n, state in enumerate(states):
        at = scene(geometry, tuple(state.tolist()))
        for k, facet in enumerate(mirror_facets(geometry, at)):
            ray = path(facet)
            if -ray.incidence > 0 and ray.facing > 0 and ray.length > 0:
                seen = sub_beam_image(facet, ray)
                out[n, 3 * k : 3 * k + 3] = integrate(seen, geometry.power, 4 * sigma_x)
    return out
