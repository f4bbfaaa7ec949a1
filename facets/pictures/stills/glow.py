"""Beams and spots as light: the amount in each pixel from the model's own beam and sub-beams.

In the beam's cross-section, in sigmas, the light is exp(-|u|^2 / 2), and a facet takes the part of
it that lies in its wedge. A ray of the camera is a straight line in that plane, too, folded at the
facet; this also holds where it passes through a sub-beam. The light that haze scatters towards the
pixel is then the integral of a Gaussian along a piece of a line, a difference of two error
functions, and the light of a detector or a facet is the irradiance at one point: no mesh is needed.
The light is collimated.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ...core.units import Floats
from ...optics.forward import illuminate
from .camera import Linear, Rays
from .scene import RIM_MM, PosedSensor
from .studio import Shot

#: Radius of the drawn light, standard deviations of the Gaussian.
FAR = 3.2
#: Smallest standard deviation of a drawn beam, pixels.
THIN = 1.2
#: A facet's reflectance.
REFLECTS = 0.8


@dataclass(frozen=True)
class Glow:
    """Light in a picture: (h, w) by detector, and that of the beam before the mirror.

    A surface's irradiance over the beam's largest, and the light that haze scatters, over that of
    the middle of the beam.
    """

    sub_beams: list[Floats]
    beam: Floats
    surfaces: list[Floats]


def glow(posed: PosedSensor, shot: Shot, laser: float, hidden: Collection[int] = ()) -> Glow:
    """Compute a picture's light.

    laser: height above the apex at which the beam begins, mm.  hidden: omitted sub-beams.
    """
    sub_beams = [
        shot.black() if k in hidden else sub_beam(posed, shot, k) + reflection(posed, shot, k)
        for k in range(3)
    ]
    surfaces = [surface(posed, shot, k) for k in range(3)]
    return Glow(sub_beams, incoming(posed, shot, laser), surfaces)


def width_of(posed: PosedSensor) -> float:
    """The larger standard deviation of the beam, mm."""
    return float(max(np.linalg.norm(part) for part in posed.geometry.spread))


def centroid(posed: PosedSensor, k: int) -> tuple[Floats, float]:
    """The centroid of the light on facet k across the beam, sigmas, and its share of the power."""
    mass, middle = illuminate(posed.at).moments[k][:2]
    return np.nan_to_num(np.array(middle, float)), float(mass)


class Piece(NamedTuple):
    """The piece of each ray on which there is light, between two depths."""

    low: Any
    high: Any

    def clip(self, side: Linear) -> Piece:
        """Return the part on which a linear function of the depth is positive."""
        start, rate = side[0], side[1] + 0.0  # without a negative zero
        with np.errstate(divide="ignore", invalid="ignore"):
            crossing = -start / rate
        low = np.fmax(self.low, np.where(rate >= 0, crossing, -np.inf))
        return Piece(low, np.fmin(self.high, np.where(rate < 0, crossing, np.inf)))

    def gaussian(self, x: Linear, y: Linear) -> Any:
        """The integral of exp(-(x^2 + y^2) / 2) over the piece, over that of the whole line through
        the beam's middle."""
        from scipy.special import ndtr

        square = np.maximum(x[1] * x[1] + y[1] * y[1], 1e-24)
        speed = np.sqrt(square)
        middle = -(x[0] * x[1] + y[0] * y[1]) / square
        across = (x[0] * y[1] - y[0] * x[1]) / speed
        length = ndtr((self.high - middle) * speed) - ndtr((self.low - middle) * speed)
        return np.exp(-across * across / 2) * np.maximum(length, 0)


def across_beam(posed: PosedSensor, rays: Rays, folded: int | None) -> tuple[Linear, Linear]:
    """Return the rays' two coordinates across the beam, sigmas, folded at a facet if given."""
    whitening = np.array(posed.geometry.whitening, float)
    place = np.array(posed.at.place, float)
    if folded is not None:
        normal, apex = np.array(posed.at.normals[folded], float), np.array(posed.at.apex, float)
        place = place - 2 * ((place - apex) @ normal) * normal
        whitening = whitening - 2 * (whitening @ normal)[:, None] * normal
    return rays.coordinate(whitening[0], place), rays.coordinate(whitening[1], place)


def wedge(posed: PosedSensor, k: int, x: Linear, y: Linear) -> list[Linear]:
    """Return two functions of the depth that are positive where rays are in facet k's wedge."""
    apex, first, second = posed.sides(k)
    u, v = x[0] - apex[0], y[0] - apex[1]
    return [
        (first[0] * v - first[1] * u, first[0] * y[1] - first[1] * x[1]),
        (second[1] * u - second[0] * v, second[1] * x[1] - second[0] * y[1]),
    ]


def beam_integral(
    posed: PosedSensor, rays: Rays, piece: Piece, k: int, folded: bool, wide: float = 1.0
) -> Any:
    """Compute the light that haze scatters out of facet k's share of the beam, by ray.

    folded: after the facet.  wide: above 1, the factor by which a beam thinner than a pixel is
    drawn wider, and round.
    """
    x, y = across_beam(posed, rays, k if folded else None)
    if wide > 1:
        middle, share = centroid(posed, k)
        about = middle if folded else (0.0, 0.0)
        x, y = (((a - b) / wide, rate / wide) for (a, rate), b in zip((x, y), about, strict=True))
        return (3 if folded else 1) * share * piece.gaussian(x, y)
    for side in wedge(posed, k, x, y):
        piece = piece.clip(side)
    return piece.gaussian(x, y)


def haze(
    posed: PosedSensor, shot: Shot, k: int, folded: bool, ends: Floats,
    sides: Sequence[tuple[Floats, Floats]],
) -> Floats:  # fmt: skip
    """Compute the picture of facet k's share of the beam, along a segment (2, 3).

    sides: points and normals of planes that bound it.
    """
    box, pixel = shot.camera.pixel_box(ends, FAR * width_of(posed))
    rays, piece = Rays(shot.camera, box), Piece(-shot.camera.distance, shot.depth[box])
    for point, normal in sides:
        piece = piece.clip(rays.coordinate(normal, point))
    picture = shot.black()
    picture[box] = beam_integral(posed, rays, piece, k, folded, THIN * pixel / width_of(posed))
    return picture


def facet_plane(posed: PosedSensor, k: int) -> tuple[Floats, Floats]:
    return np.array(posed.at.apex, float), np.array(posed.at.normals[k], float)


def detector_plane(posed: PosedSensor, k: int) -> tuple[Floats, Floats]:
    geometry = posed.geometry
    return np.array(geometry.centres[k], float), -np.array(geometry.axes[k][0], float)


def sub_beam(posed: PosedSensor, shot: Shot, k: int) -> Floats:
    """Compute the light that haze scatters out of the sub-beam from facet k to its detector."""
    middle, share = centroid(posed, k)
    if share < 1e-6:
        return shot.black()
    points = posed.facet_points(k, middle), posed.detector_points(k, middle)
    ends = np.array([np.ravel(point) for point in points], float)
    return haze(posed, shot, k, True, ends, [facet_plane(posed, k), detector_plane(posed, k)])


def incoming(posed: PosedSensor, shot: Shot, laser: float) -> Floats:
    """Compute the light that haze scatters out of the beam between the laser and the facets."""
    back = -np.array(posed.geometry.direction, float)
    place, apex = np.array(posed.at.place, float), np.array(posed.at.apex, float)
    start = place + ((apex - place) @ back) * back
    ends = np.array([start - 1.5 * RIM_MM * back, start + laser * back])
    shares = [
        haze(posed, shot, k, False, ends, [facet_plane(posed, k), (ends[1], -back)])
        for k in range(3)
    ]
    return shares[0] + shares[1] + shares[2]


def reflection(posed: PosedSensor, shot: Shot, k: int) -> Floats:
    """Compute the light that facet k reflects: the images of the beam on it and of its sub-beam.

    An image lies behind the facet: that of the beam on the sub-beam's backward extension, and that
    of the sub-beam on the beam's forward extension.
    """
    picture, (apex, normal) = shot.black(), facet_plane(posed, k)
    box, pixel = shot.camera.pixel_box([apex, apex], 4 * RIM_MM)
    if width_of(posed) < THIN * pixel:
        return picture
    rays, depth = Rays(shot.camera, box), shot.depth[box]
    meeting, outside = rays.meet(apex, normal)
    mirror = outside & (np.abs(depth - meeting) < 0.02 + 1.5 * pixel)
    piece = Piece(depth, np.where(mirror, np.inf, -np.inf))
    for folded in (True, False):
        picture[box] += REFLECTS * beam_integral(posed, rays, piece, k, folded)
    return picture


def surface(posed: PosedSensor, shot: Shot, k: int) -> Floats:
    """Compute the irradiance of facet k's light on facet and detector, over the largest."""
    psd = posed.sensor.psds[k]
    axes, sizes = np.array(posed.geometry.axes[k][1:], float), (psd.size_y, psd.size_z)
    facet = irradiance(posed, shot, k, facet_plane(posed, k), 2 * FAR * width_of(posed))
    edges = list(zip(axes, sizes, strict=True))
    reach = float(np.hypot(*sizes)) / 2
    return np.maximum(facet, irradiance(posed, shot, k, detector_plane(posed, k), reach, edges))


def irradiance(
    posed: PosedSensor, shot: Shot, k: int, plane: tuple[Floats, Floats], reach: float,
    edges: Sequence[tuple[Floats, float]] = (),
) -> Floats:  # fmt: skip
    """Compute the irradiance about a point of a plane, where a surface lies in it.

    edges: directions and sizes of the rectangle of detector k, whose plane it is; by default the
    plane is facet k's.
    """
    point, normal = plane
    box, pixel = shot.camera.pixel_box([point, point], reach)
    rays = Rays(shot.camera, box)
    depth, outside = rays.meet(point, normal)
    lit = outside & (np.abs(shot.depth[box] - depth) < 0.4 + 2.5 * pixel)
    for direction, size in edges:
        start, rate = rays.coordinate(direction, point)
        lit &= np.abs(start + rate * depth) < size / 2
    x, y = across_beam(posed, rays, k if edges else None)
    u, v = (start + rate * depth for start, rate in (x, y))
    middle, share = centroid(posed, k)
    wide = THIN * pixel / width_of(posed)
    if wide > 1 and share > 0:
        square = ((u - middle[0]) ** 2 + (v - middle[1]) ** 2) / wide**2
        light = 3 * share * np.exp(-square / 2)
    else:
        light = np.exp(-(u**2 + v**2) / 2)
        for start, rate in wedge(posed, k, x, y):
            lit &= start + rate * depth > 0
    picture = shot.black()
    picture[box] = np.where(lit, light, 0.0)
    return picture
