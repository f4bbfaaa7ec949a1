"""A camera: the projection of points in the world to pixels, and the rays through pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ...core.units import Floats

#: Linear function of the depth t: start + rate t.
Linear = tuple[Any, Any]
#: Rows and columns of a box of pixels.
Box = tuple[slice, slice]
#: Angle of view at which the projection is parallel to within half a percent of a picture.
NEARLY_PARALLEL_RAD = 5e-3


def normalize(vector: Any) -> Floats:
    """Scale vectors (..., 3) to length 1."""
    array = np.asarray(vector, float)
    unit: Floats = array / np.linalg.norm(array, axis=-1, keepdims=True)
    return unit


@dataclass(frozen=True)
class Camera:
    """Lengths mm, world frame.

    focus: point in the middle of the picture.  direction: from the focus to the camera.  height:
    height of the picture at the focus.  size: width and height, pixels.  angle: angle of view from
    the lower to the upper edge, rad; the default is nearly a parallel projection.  upward: upward
    direction of the picture.  shift: offset of the picture's middle from the focus, to the right
    and up, in heights of the picture.
    """

    focus: Sequence[float] | Floats
    direction: Sequence[float] | Floats
    height: float
    size: tuple[int, int]
    angle: float = NEARLY_PARALLEL_RAD
    upward: Sequence[float] | Floats = (0.0, 0.0, 1.0)
    shift: tuple[float, float] = (0.0, 0.0)

    @cached_property
    def axes(self) -> Floats:
        """Unit vectors to the right, upward and forward, by rows."""
        forward = -normalize(self.direction)
        right = normalize(np.cross(forward, self.upward))
        return np.array([right, np.cross(right, forward), forward])

    @property
    def distance(self) -> float:
        """Distance of the camera from the focus, mm."""
        return self.height / (2 * float(np.tan(self.angle / 2)))

    @property
    def place(self) -> Floats:
        """Position of the camera, mm."""
        place: Floats = np.asarray(self.focus, float) - self.distance * self.axes[2]
        return place

    @property
    def pixel(self) -> float:
        """Size of a pixel at the focus, mm."""
        return self.height / self.size[1]

    def project(self, points: Any) -> Floats:
        """Project points (..., 3): pixels from the left, pixels from the top, and depth in mm.

        Behind the camera the depth is negative and the pixels are invalid.
        """
        offset = (np.asarray(points, float) - self.place) @ self.axes.T
        depth = offset[..., 2]
        per_mm = self.distance / self.pixel / np.where(np.abs(depth) < 1e-9, 1e-9, depth)
        width, height = self.size
        x = width / 2 - self.shift[0] * height + offset[..., 0] * per_mm
        y = height / 2 + self.shift[1] * height - offset[..., 1] * per_mm
        return np.stack([x, y, depth], axis=-1)

    def offsets(self, x: Any, y: Any) -> tuple[Floats, Floats]:
        """Offsets of pixels from the focus to the right and upward, mm at the focus."""
        width, height = self.size
        across = (x - width / 2 + self.shift[0] * height) * self.pixel
        return across, (height / 2 + self.shift[1] * height - y) * self.pixel

    def pixel_box(self, ends: Any, radius: float) -> tuple[Box, float]:
        """Find the pixels within a radius (mm) of a segment (2, 3), and the smallest one's size."""
        points = self.project(np.linspace(ends[0], ends[1], 200))
        points = points[points[:, 2] > 0]
        if not len(points):
            return np.s_[0:0, 0:0], self.pixel
        pixel = self.pixel * float(points[:, 2].min()) / self.distance
        pad = radius / pixel + 6
        low = np.clip(points[:, :2].min(axis=0) - pad, 0, self.size).astype(int)
        high = np.clip(points[:, :2].max(axis=0) + pad + 1, 0, self.size).astype(int)
        return np.s_[low[1] : high[1], low[0] : high[0]], pixel

    def apply(self, camera: Any, strip: int = 0, count: int = 1) -> None:
        """Set a `vtkCamera` to this view, or to one of `count` strips of it, numbered upward."""
        camera.SetPosition(*self.place)
        camera.SetFocalPoint(*self.focus)
        camera.SetViewUp(*self.axes[1])
        camera.SetViewAngle(2 * np.degrees(np.arctan(np.tan(self.angle / 2) / count)))
        width, height = self.size
        above = 2 * strip + 1 + count * (2 * self.shift[1] - 1)
        camera.SetWindowCenter(2 * self.shift[0] * height / width, above)


class Rays:
    """The rays through a box of pixels.

    A ray's point at depth t behind the focus is origin + t ray, both linear in the pixel's
    coordinates. Its coordinate along a vector therefore follows from three numbers, without an
    array of vectors. Depths are counted from the focus, so that single precision suffices.
    """

    def __init__(self, camera: Camera, box: Box) -> None:
        rows, columns = box
        x, y = (
            np.arange(part.start, part.stop, dtype=np.float32) + 0.5 for part in (columns, rows)
        )
        self.camera = camera
        self.across, self.up = camera.offsets(x, y[:, None])

    def coordinate(self, vector: Floats, point: Any = (0.0, 0.0, 0.0)) -> Linear:
        """Return (p - point) . vector for the rays' points p, as a function of depth."""
        camera = self.camera
        right, upward, rate = (float(part) for part in camera.axes @ vector)
        offset = self.across * right + self.up * upward
        start = float((np.asarray(camera.focus) - point) @ vector)
        return start + offset, rate + offset / camera.distance

    def meet(self, point: Any, normal: Floats) -> tuple[Any, Any]:
        """Return the depths at which the rays meet a plane, and whether from its outside."""
        start, rate = self.coordinate(normal, point)
        outside = rate < 0
        return np.where(outside, -start / np.minimum(rate, -1e-12), 1e9), outside


def fit(camera: Camera, points: Floats, area: Sequence[float]) -> Camera:
    """Move a camera along its direction and sideways until points (n, 3) fill an area.

    area: left, top, right and bottom, as fractions of the picture's width and height.
    """
    corners = np.reshape(area, (2, 2)) * camera.size
    for _ in range(16):
        pixels = camera.project(points)[:, :2]
        low, high = pixels.min(axis=0), pixels.max(axis=0)
        scale = float(((high - low) / (corners[1] - corners[0])).max())
        x, y = ((low + high) / 2 - corners.mean(axis=0)) / camera.size[1]
        shift = (camera.shift[0] + float(x), camera.shift[1] - float(y))
        camera = replace(camera, height=camera.height * scale, shift=shift)
    return camera
