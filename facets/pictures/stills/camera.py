"""A camera: the projection of points of the world to pixels, and the rays of pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ...core.units import Floats

#: A linear function of the depth t: start + rate t.
Linear = tuple[Any, Any]
#: Rows and columns of some pixels.
Box = tuple[slice, slice]


def normalize(vector: Any) -> Floats:
    """The unit vector along (..., 3)."""
    array = np.asarray(vector, float)
    unit: Floats = array / np.linalg.norm(array, axis=-1, keepdims=True)
    return unit


@dataclass(frozen=True)
class Camera:
    """Lengths mm, world frame.

    focus: the point in the picture's middle.  direction: from there to the camera.  height: of the
    picture at the focus.  size: width and height, pixels.  angle: of view from the lower to the
    upper edge, rad; 0 stands for a parallel projection from the distance `away`.  upward: the
    upward direction.  shift: of the picture's middle from the focus, in heights of the picture, to
    the right and up.
    """

    focus: Sequence[float] | Floats
    direction: Sequence[float] | Floats
    height: float
    size: tuple[int, int]
    angle: float = 0.0
    away: float = 300.0
    upward: Sequence[float] | Floats = (0.0, 0.0, 1.0)
    shift: tuple[float, float] = (0.0, 0.0)

    @cached_property
    def axes(self) -> Floats:
        """The directions to the right, upward and forward, by rows."""
        forward = -normalize(self.direction)
        right = normalize(np.cross(forward, self.upward))
        return np.array([right, np.cross(right, forward), forward])

    @property
    def parallel(self) -> bool:
        return self.angle == 0

    @property
    def distance(self) -> float:
        return self.away if self.parallel else self.height / (2 * float(np.tan(self.angle / 2)))

    @property
    def place(self) -> Floats:
        place: Floats = np.asarray(self.focus, float) - self.distance * self.axes[2]
        return place

    @property
    def pixel(self) -> float:
        """The size of a pixel at the focus, mm."""
        return self.height / self.size[1]

    def project(self, points: Any) -> Floats:
        """Points (..., 3) to (..., 3): pixels from the left, pixels from the top, depth in mm.

        Behind the camera the depth is negative and the pixels are invalid.
        """
        apart = (np.asarray(points, float) - self.place) @ self.axes.T
        depth = apart[..., 2]
        per_mm: Any = 1 / self.pixel
        if not self.parallel:
            per_mm = per_mm * self.distance / np.where(np.abs(depth) < 1e-9, 1e-9, depth)
        width, height = self.size
        x = width / 2 - self.shift[0] * height + apart[..., 0] * per_mm
        y = height / 2 + self.shift[1] * height - apart[..., 1] * per_mm
        return np.stack([x, y, depth], axis=-1)

    def aside(self, x: Any, y: Any) -> tuple[Floats, Floats]:
        """Distances of pixels from the focus to the right and upward, mm at the focus."""
        width, height = self.size
        across = (x - width / 2 + self.shift[0] * height) * self.pixel
        return across, (height / 2 + self.shift[1] * height - y) * self.pixel

    def pixel_box(self, ends: Any, radius: float) -> tuple[Box, float]:
        """The pixels within a radius (mm) of a segment (2, 3), and the least size of one, mm."""
        seen = self.project(np.linspace(ends[0], ends[1], 200))
        seen = seen[seen[:, 2] > 0]
        if not len(seen):
            return np.s_[:0, :0], self.pixel
        pixel = self.pixel * (1.0 if self.parallel else float(seen[:, 2].min()) / self.distance)
        pad = radius / pixel + 6
        low = np.clip(seen[:, :2].min(axis=0) - pad, 0, self.size).astype(int)
        high = np.clip(seen[:, :2].max(axis=0) + pad + 1, 0, self.size).astype(int)
        return np.s_[low[1] : high[1], low[0] : high[0]], pixel

    def apply(self, camera: Any, strip: int = 0, count: int = 1) -> None:
        """Set a `vtkCamera` to the same view, or to one of several strips, counted from below."""
        camera.SetPosition(*self.place)
        camera.SetFocalPoint(*self.focus)
        camera.SetViewUp(*self.axes[1])
        camera.SetParallelProjection(self.parallel)
        camera.SetParallelScale(self.height / 2 / count)
        half = np.arctan(np.tan((self.angle or 0.01) / 2) / count)
        camera.SetViewAngle(2 * np.degrees(half))
        width, height = self.size
        above = 2 * strip + 1 + count * (2 * self.shift[1] - 1)
        camera.SetWindowCenter(2 * self.shift[0] * height / width, above)


class Rays:
    """The rays through a box of pixels, by default through all.

    A ray's point at the depth t is origin + t ray, both linear in the pixel's coordinates, so that
    its coordinate along any vector is made of three numbers: no array of vectors is needed.
    """

    def __init__(self, camera: Camera, box: Box | None = None) -> None:
        width, height = camera.size
        rows, columns = box or np.s_[0:height, 0:width]
        x, y = (np.arange(part.start or 0, part.stop) + 0.5 for part in (columns, rows))
        self.camera = camera
        self.across, self.up = camera.aside(x, y[:, None])

    def coordinate(self, vector: Floats, point: Any = (0.0, 0.0, 0.0)) -> Linear:
        """Return (p - point) . vector of the rays' points p."""
        camera = self.camera
        right, upward, rate = (float(part) for part in camera.axes @ vector)
        start = float((camera.place - point) @ vector)
        aside = self.across * right + self.up * upward
        if camera.parallel:
            return start + aside, rate
        return start, rate + aside / camera.distance

    def meet(self, point: Any, normal: Floats) -> tuple[Any, Any]:
        """Return the depths at which the rays meet a plane, and whether they do so from outside."""
        start, rate = self.coordinate(normal, point)
        outside = rate < 0
        return np.where(outside, -start / np.minimum(rate, -1e-12), 1e9), outside


def fit(camera: Camera, points: Floats, area: Sequence[float]) -> Camera:
    """The camera moved along its own direction and aside until points (n, 3) fill an area of its
    picture: left, top, right and bottom as shares of width and height."""
    corners = np.reshape(area, (2, 2)) * camera.size
    for _ in range(16):
        seen = camera.project(points)[:, :2]
        low, high = seen.min(axis=0), seen.max(axis=0)
        scale = float(((high - low) / (corners[1] - corners[0])).max())
        x, y = ((low + high) / 2 - corners.mean(axis=0)) / camera.size[1]
        shift = (camera.shift[0] + float(x), camera.shift[1] - float(y))
        camera = replace(camera, height=camera.height * scale, shift=shift)
    return camera
