"""Light of beams and spots in each pixel, from the model's own beam and sub-beams.

In the beam's cross-section, in standard deviations, the irradiance is exp(-|u|^2 / 2), and a facet
takes the part in its wedge. A camera's ray is a straight line in that plane, too; for a sub-beam it
is folded at the facet. The light that haze scatters into the pixel is therefore the integral of a
Gaussian along a piece of a line: a difference of two error functions. The light on a facet or a
detector is the irradiance at one point. No mesh is needed. The light is collimated.
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
    """Light in a picture, each part (h, w).

    sub_beams, beam: light that haze scatters, over that from the middle of the beam; of each
    sub-beam, and of the beam before the mirror.  surfaces: irradiance over its maximum, on each
    facet and its detector.
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
    """Return the larger standard deviation of the beam, mm."""
    return float(max(np.linalg.norm(part) for part in posed.geometry.spread))


def centroid(posed: PosedSensor, k: int) -> tuple[Floats, float]:
    """Return the centroid of facet k's light, standard deviations, and its fraction of power."""
    mass, middle = illuminate(posed.at).moments[k][:2]
    return np.nan_to_num(np.array(middle, float)), float(mass)


class Piece(NamedTuple):
    """The piece of each ray on which there is light, between two depths."""

    low: Any
    high: Any

    def clip(self, side: Linear) -> Piece:
        """Return the part in which a linear function of the depth is positive."""
        start, rate = side[0], side[1] + 0.0  # without a negative zero
        with np.errstate(divide="ignore", invalid="ignore"):
            crossing = -start / rate
        low = np.fmax(self.low, np.where(rate >= 0, crossing, -np.inf))
        return Piece(low, np.fmin(self.high, np.where(rate < 0, crossing, np.inf)))

    def gaussian(self, x: Linear, y: Linear) -> Any:
        """Integrate exp(-(x^2 + y^2) / 2) over the piece.

        The unit is the integral along an infinite line through the middle of the beam.
        """
        from scipy.special import ndtr

        square = np.maximum(x[1] * x[1] + y[1] * y[1], 1e-24)
        speed = np.sqrt(square)
        middle = -(x[0] * x[1] + y[0] * y[1]) / square
        across = (x[0] * y[1] - y[0] * x[1]) / speed
        length = ndtr((self.high - middle) * speed) - ndtr((self.low - middle) * speed)
        return np.exp(-across * across / 2) * np.maximum(length, 0)


def across_beam(posed: PosedSensor, rays: Rays, folded: int | None) -> tuple[Linear, Linear]:
    """Return the rays' coordinates across the beam, standard deviations.

    folded: number of the facet at which the rays are folded, if any.
    """
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
    """Compute the light that haze scatters out of facet k's part of the beam, by ray.

    folded: whether after the facet.  wide: factor above 1 by which a beam thinner than a pixel is
    drawn wider, and round.
    """
    x, y = across_beam(posed, rays, k if folded else None)
    if wide > 1:
        middle, fraction = centroid(posed, k)
        about = middle if folded else (0.0, 0.0)
        x, y = (((a - b) / wide, rate / wide) for (a, rate), b in zip((x, y), about, strict=True))
        return (3 if folded else 1) * fraction * piece.gaussian(x, y)
    for side in wedge(posed, k, x, y):
        piece = piece.clip(side)
    return piece.gaussian(x, y)


def haze(
    posed: PosedSensor, shot: Shot, k: int, folded: bool, ends: Floats,
    sides: Sequence[tuple[Floats, Floats]],
) -> Floats:  # fmt: skip
    """Compute the picture of facet k's part of the beam, along a segment (2, 3).

    sides: points and normals of the planes that bound it.
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
    middle, fraction = centroid(posed, k)
    if fraction < 1e-6:
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
    parts = [
        haze(posed, shot, k, False, ends, [facet_plane(posed, k), (ends[1], -back)])
        for k in range(3)
    ]
    return parts[0] + parts[1] + parts[2]


def reflection(posed: PosedSensor, shot: Shot, k: int) -> Floats:
    """Compute the images of the beam and of the sub-beam that are seen in facet k.

    They lie behind the facet: the beam's image on the backward extension of the sub-beam, and the
    sub-beam's image on the forward extension of the beam.
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
    """Compute the irradiance on facet k and on its detector, over its maximum."""
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
    """Compute the irradiance on a surface in a plane, within `reach` of the plane's point.

    edges: directions and lengths of the edges of detector k, if the plane is the detector's; by
    default, it is that of facet k.
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
    middle, fraction = centroid(posed, k)
    wide = THIN * pixel / width_of(posed)
    if wide > 1 and fraction > 0:
        square = ((u - middle[0]) ** 2 + (v - middle[1]) ** 2) / wide**2
        light = 3 * fraction * np.exp(-square / 2)
    else:
        light = np.exp(-(u**2 + v**2) / 2)
        for start, rate in wedge(posed, k, x, y):
            lit &= start + rate * depth > 0
    picture = shot.black()
    picture[box] = np.where(lit, light, 0.0)
    return picture
