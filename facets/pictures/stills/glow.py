"""Beams and spots as light: the amount in each pixel from the model's own beam and sub-beams.

In the beam's cross-section, in sigmas, the light is exp(-|u|^2 / 2), and a facet takes the part of
it that lies in its wedge. A ray of the camera is a straight line in that plane, too, folded at the
facet; this also holds where it passes through a sub-beam. The light that haze scatters towards the
pixel is then the integral of a Gaussian along a piece of a line, a difference of two error
functions, and the light of a detector or a facet is the irradiance at one point: no mesh is needed.
The light is collimated.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...core.units import Booleans, Floats
from ...optics.forward import illuminate
from .camera import Camera
from .raster import enlarge
from .scene import RIM_MM, Stand, is_in_wedge, reflect_points
from .studio import Shot

#: Two coordinates of many rays across the beam, sigmas.
Across = tuple[Any, Any]
#: Radius of the drawn light, standard deviations of the Gaussian.
FAR = 3.2
#: The least standard deviation of a drawn beam, pixels.
THIN = 1.2


@dataclass(frozen=True)
class Glow:
    """Light in a picture: (h, w) by detector, and that of the beam before the mirror.

    A surface's irradiance over the beam's largest, and the light that haze scatters, over that of
    the middle of the beam.
    """

    sub_beams: tuple[Floats, Floats, Floats]
    beam: Floats
    surfaces: tuple[Floats, Floats, Floats]


def glow(stand: Stand, shot: Shot, laser: float, dark: Collection[int] = ()) -> Glow:
    """Compute a picture's light. laser: start of the beam above the apex, mm.  dark: omitted
    sub-beams."""

    def light_of(k: int) -> Floats:
        if k in dark:
            return np.zeros(shot.depth.shape)
        return hazy(shot, lambda part: sub_beam(stand, part, k) + reflection(stand, part, k), stand)

    parts = [light_of(k) for k in range(3)]
    beam = hazy(shot, lambda part: incoming(stand, part, laser), stand)
    shown = [surface(stand, shot, k) for k in range(3)]
    return Glow((parts[0], parts[1], parts[2]), beam, (shown[0], shown[1], shown[2]))


def hazy(shot: Shot, light: Callable[[Shot], Floats], stand: Stand) -> Floats:
    """Compute every other pixel a side if the beam is so wide that it has no finer detail."""
    if width_of(stand) < 10 * shot.camera.pixel:
        return light(shot)
    width, height = shot.camera.size
    if width % 2 or height % 2:
        return light(shot)
    half = shot.camera.resize((width // 2, height // 2))
    depth = np.minimum(shot.depth[::2, ::2], shot.depth[1::2, 1::2])
    whole: Floats = enlarge(light(Shot(half, shot.colour, shot.cover, depth)), (width, height))
    return whole


def centroid(stand: Stand, k: int) -> tuple[Floats, float]:
    """The centroid of the light on facet k across the beam, sigmas, and its share of the power."""
    mass, middle = illuminate(stand.at).moments[k][:2]
    return np.nan_to_num(np.array(middle, float)), float(mass)


def segment_pixels(camera: Camera, ends: Floats, width: float) -> tuple[Booleans, float]:
    """The pixels (h, w) within a width (mm) of a segment (2, 3), and the size of a pixel, mm."""
    size = camera.size
    seen = camera.project(clip_segment(camera, ends))
    per_mm = 1 / camera.pixel
    if not camera.parallel:
        per_mm *= camera.distance / float(max(seen[:, 2].min(), 1e-3))
    pad = width * per_mm + 6
    a, b = seen[0, :2], seen[1, :2]
    where = np.zeros((size[1], size[0]), bool)
    low, high = np.minimum(a, b) - pad, np.maximum(a, b) + pad
    (left, top), (right, bottom) = (np.clip(v, 0, size).astype(int) for v in (low, high + 1))
    x, y = np.arange(left, right)[None, :] + 0.5, np.arange(top, bottom)[:, None] + 0.5
    along = b - a
    square = max(float(along @ along), 1e-12)
    share = np.clip(((x - a[0]) * along[0] + (y - a[1]) * along[1]) / square, 0, 1)
    off = (x - a[0] - share * along[0]) ** 2 + (y - a[1] - share * along[1]) ** 2
    where[top:bottom, left:right] = off < pad * pad
    return where, 1 / per_mm


def clip_segment(camera: Camera, ends: Floats) -> Floats:
    """The part of a segment in front of the camera."""
    depth = (ends - np.array(camera.place)) @ camera.axes[2]
    least = 1e-3 * camera.distance
    if camera.parallel or (depth > least).all():
        return ends
    if (depth <= least).all():
        return np.repeat(ends[:1], 2, axis=0)
    front, back = (0, 1) if depth[0] > depth[1] else (1, 0)
    share = (depth[front] - least) / (depth[front] - depth[back])
    moved = ends.copy()
    moved[back] = ends[front] + share * (ends[back] - ends[front])
    return moved


class PixelRays:
    """Rays of some pixels, and the piece of each on which there is light.

    A ray is place + t ray, both linear in the pixel's coordinates, so that every product with a
    vector is the sum of three numbers times these: no array of vectors is made.
    """

    def __init__(self, shot: Shot, where: Booleans) -> None:
        rows, columns = np.nonzero(where)
        self.where, self.camera = where, shot.camera
        self.x, self.y = shot.camera.aside(columns + 0.5, rows + 0.5)
        self.low = np.zeros(len(rows))
        depth = shot.depth[where]
        self.high = np.where(np.isfinite(depth), depth, 1e9)

    def origins(self, vector: Floats, point: Floats) -> Any:
        """Return (origin - point) . vector of each ray."""
        right, upward, _ = self.camera.axes
        start = float((np.array(self.camera.place) - point) @ vector)
        if not self.camera.parallel:
            return start
        return start + self.x * float(right @ vector) + self.y * float(upward @ vector)

    def rays(self, vector: Floats) -> Any:
        """Return ray . vector of each ray."""
        right, upward, forward = self.camera.axes
        start = float(forward @ vector)
        if self.camera.parallel:
            return start
        far = self.camera.distance
        return start + self.x * float(right @ vector) / far + self.y * float(upward @ vector) / far

    def keep(self, start: Any, rate: Any) -> None:
        """Restrict the pieces to where start + rate t is positive."""
        start, rate = np.broadcast_arrays(start, rate, self.low)[:2]
        with np.errstate(divide="ignore", invalid="ignore"):
            crossing = -start / rate
        np.maximum(self.low, crossing, out=self.low, where=rate > 0)
        np.minimum(self.high, crossing, out=self.high, where=rate < 0)
        dark = (rate == 0) & (start <= 0)
        self.high[dark] = self.low[dark]

    def side(self, point: Floats, normal: Floats) -> None:
        """Restrict the pieces to one side of a plane."""
        self.keep(self.origins(normal, point), self.rays(normal))

    def gaussian(self, u: Across, w: Across) -> Any:
        """The integral of exp(-|u + w t|^2 / 2) over the piece, over that of the whole line through
        the beam's middle; (n,)."""
        from scipy.special import ndtr

        square = np.maximum(w[0] * w[0] + w[1] * w[1], 1e-24)
        speed = np.sqrt(square)
        middle = -(u[0] * w[0] + u[1] * w[1]) / square
        across = (u[0] * w[1] - u[1] * w[0]) / speed
        length = ndtr((self.high - middle) * speed) - ndtr((self.low - middle) * speed)
        return np.exp(-across * across / 2) * np.maximum(length, 0)

    def spread(self, values: Any) -> Floats:
        picture = np.zeros(self.where.shape)
        picture[self.where] = np.where(self.high > self.low, values, 0.0)
        return picture


def beam_coordinates(
    stand: Stand, line: PixelRays, k: int | None = None, about: Any = (0, 0), wide: float = 1.0
) -> tuple[Across, Across]:
    """Return coordinates of rays across the beam, folded at facet k if given: at t = 0, and per t.

    about, wide: origin and unit of the coordinates, sigmas.
    """
    whitening = np.array(stand.geometry.whitening, float)
    place = np.array(stand.at.place, float)
    if k is not None:
        normal, apex = np.array(stand.at.normals[k], float), np.array(stand.at.apex, float)
        place = reflect_points(place, apex, normal)
        whitening = whitening - 2 * (whitening @ normal)[:, None] * normal
    start = tuple((line.origins(v, place) - about[i]) / wide for i, v in enumerate(whitening))
    rate = tuple(line.rays(v) / wide for v in whitening)
    return (start[0], start[1]), (rate[0], rate[1])


def sigma_coordinates(stand: Stand, points: Floats) -> Floats:
    """Return coordinates (n, 2) across the beam of points (n, 3) of the world."""
    apart = points - np.array(stand.at.place, float)
    whitening = np.array(stand.geometry.whitening, float)
    return np.stack([(apart * v).sum(axis=-1) for v in whitening], axis=-1)


def width_of(stand: Stand) -> float:
    """The larger standard deviation of the beam, mm."""
    return float(max(np.linalg.norm(part) for part in stand.geometry.spread))


def sub_beam(stand: Stand, shot: Shot, k: int) -> Floats:
    """Compute the light that haze scatters out of the sub-beam from facet k to its detector."""
    middle, share = centroid(stand, k)
    if share < 1e-6:
        return np.zeros(shot.depth.shape)
    ends = np.array(
        [np.ravel(stand.facet_points(k, middle)), np.ravel(stand.detector_points(k, middle))], float
    )
    sigma = width_of(stand)
    where, pixel = segment_pixels(shot.camera, ends, FAR * sigma)
    line = PixelRays(shot, where)
    normal = np.array(stand.at.normals[k], float)
    line.side(np.array(stand.at.apex, float), normal)
    line.side(np.array(stand.geometry.centres[k], float), -np.array(stand.geometry.axes[k][0]))
    if sigma < THIN * pixel:  # a beam thinner than a pixel is drawn round
        wide = THIN * pixel / sigma
        return line.spread(
            3 * share * line.gaussian(*beam_coordinates(stand, line, k, middle, wide))
        )
    u, w = beam_coordinates(stand, line, k)
    keep_wedge(line, stand, k, u, w)
    return line.spread(line.gaussian(u, w))


def keep_wedge(line: PixelRays, stand: Stand, k: int, u: Across, w: Across) -> None:
    """Restrict the pieces to the part of the beam on facet k."""
    q = np.array(stand.at.q, float)
    first, second = (np.array(stand.at.sides[n], float) for n in (k, (k + 1) % 3))
    x, y = u[0] - q[0], u[1] - q[1]
    line.keep(first[0] * y - first[1] * x, first[0] * w[1] - first[1] * w[0])
    line.keep(second[1] * x - second[0] * y, second[1] * w[0] - second[0] * w[1])


def incoming(stand: Stand, shot: Shot, laser: float) -> Floats:
    """Compute the light that haze scatters out of the beam between the laser and the facets."""
    back = -np.array(stand.geometry.direction, float)
    place, apex = np.array(stand.at.place, float), np.array(stand.at.apex, float)
    start = place + ((apex - place) @ back) * back
    ends = np.array([start - 1.5 * RIM_MM * back, start + laser * back])
    sigma = width_of(stand)
    where, pixel = segment_pixels(shot.camera, ends, FAR * sigma)
    total = np.zeros(shot.depth.shape)
    wide = max(1.0, THIN * pixel / sigma)
    for k in range(3):
        line = PixelRays(shot, where)
        line.side(apex, np.array(stand.at.normals[k], float))
        line.side(ends[1], -back)
        u, w = beam_coordinates(stand, line, wide=wide)
        if wide > 1:
            return line.spread(line.gaussian(u, w))
        keep_wedge(line, stand, k, u, w)
        total += line.spread(line.gaussian(u, w))
    return total


#: A facet's reflectance.
REFLECTS = 0.8


def reflection(stand: Stand, shot: Shot, k: int) -> Floats:
    """Compute the light that facet k reflects: the images of the beam on it and of its sub-beam.

    An image lies behind the facet: that of the beam on the sub-beam's backward extension, and that
    of the sub-beam on the beam's forward extension.
    """
    apex, normal = np.array(stand.at.apex, float), np.array(stand.at.normals[k], float)
    where, pixel = segment_pixels(shot.camera, np.array([apex, apex]), 4 * RIM_MM)
    where = where & shot.is_covered
    if width_of(stand) < THIN * pixel or not where.any():
        return np.zeros(shot.depth.shape)
    line = PixelRays(shot, where)
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = -line.origins(normal, apex) / line.rays(normal)
    mirror = (line.rays(normal) < 0) & (np.abs(line.high - depth) < 0.02 + 1.5 * pixel)
    where = fill_mask(where, mirror)
    light = np.zeros(shot.depth.shape)
    for folded in (k, None):
        line = PixelRays(shot, where)
        line.low, line.high = line.high, np.full(len(line.high), 1e9)
        u, w = beam_coordinates(stand, line, folded)
        keep_wedge(line, stand, k, u, w)
        light += REFLECTS * line.spread(line.gaussian(u, w))
    return light


def surface(stand: Stand, shot: Shot, k: int) -> Floats:
    """Compute the irradiance of facet k's light on facet and detector, over the largest."""
    normal = np.array(stand.at.normals[k], float)
    apex = np.array(stand.at.apex, float)
    centre = np.array(stand.geometry.centres[k], float)
    facing = -np.array(stand.geometry.axes[k][0], float)
    psd = stand.sensor.psds[k]
    reach = float(np.hypot(psd.size_y, psd.size_z)) / 2
    return np.maximum(
        plane(stand, shot, k, apex, normal), plane(stand, shot, k, centre, facing, reach)
    )


def fill_mask(where: Booleans, values: Any) -> Booleans:
    """Return a picture with values at the pixels that are true in `where`."""
    picture = np.zeros(where.shape, bool)
    picture[where] = values
    return picture


def plane(
    stand: Stand, shot: Shot, k: int, point: Floats, normal: Floats, reach: float | None = None
) -> Floats:
    """Compute the irradiance about a point of a plane, where a surface lies in it.

    reach: half the diagonal of detector k, whose plane it is; by default the plane is facet k's.
    """
    around = 2 * FAR * width_of(stand) if reach is None else reach
    where, pixel = segment_pixels(shot.camera, np.array([point, point]), around)
    where = where & shot.is_covered
    picture = np.zeros(shot.depth.shape)
    line = PixelRays(shot, where)
    falls = line.rays(normal)
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = -line.origins(normal, point) / falls
    seen = (falls < 0) & (np.abs(shot.depth[where] - depth) < 0.4 + 2.5 * pixel)
    rows, columns = np.nonzero(where & fill_mask(where, seen))
    depth = depth[seen] if np.ndim(depth) else depth
    origin, ray = shot.camera.rays(columns + 0.5, rows + 0.5)
    places = origin + np.reshape(depth, (-1, 1)) * ray
    lit = np.ones(len(rows), bool)
    if reach is not None:
        axes, psd = np.array(stand.geometry.axes[k], float), stand.sensor.psds[k]
        lit &= np.abs(((places - point) * axes[1]).sum(axis=-1)) < psd.size_y / 2
        lit &= np.abs(((places - point) * axes[2]).sum(axis=-1)) < psd.size_z / 2
    mirror_normal, apex = np.array(stand.at.normals[k], float), np.array(stand.at.apex, float)
    if reach is not None:
        places = reflect_points(places, apex, mirror_normal)
    u = sigma_coordinates(stand, places)
    middle, share = centroid(stand, k)
    wide = THIN * pixel / width_of(stand)
    if wide > 1 and share > 0:
        light = 3 * share * np.exp(-(((u - middle) / wide) ** 2).sum(axis=-1) / 2)
    else:
        light = np.exp(-(u**2).sum(axis=-1) / 2) * is_in_wedge(stand, k, u)
    picture[rows, columns] = np.where(lit, light, 0.0)
    return picture
