"""A camera: the projection of points of the world to pixels, and the rays of pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ...core.units import Floats


def normalize(vector: Any) -> Floats:
    """The unit vector along (..., 3)."""
    array = np.asarray(vector, float)
    unit: Floats = array / np.linalg.norm(array, axis=-1, keepdims=True)
    return unit


@dataclass(frozen=True)
class Camera:
    """Lengths mm, world frame.

    place, focus: the camera's place and the point in its middle.  upward: the upward direction.
    angle: of view from the lower to the upper edge, rad; 0 stands for a parallel projection
    `extent` mm high.  size: width and height, pixels.  shift: of the picture's middle from the
    focus, in heights of the picture, to the right and up.
    """

    place: tuple[float, float, float]
    focus: tuple[float, float, float]
    upward: tuple[float, float, float] = (0.0, 0.0, 1.0)
    angle: float = 0.44
    extent: float = 100.0
    size: tuple[int, int] = (1200, 900)
    shift: tuple[float, float] = (0.0, 0.0)

    @cached_property
    def axes(self) -> Floats:
        """The directions to the right, upward and forward, by rows."""
        forward = normalize(np.subtract(self.focus, self.place))
        right = normalize(np.cross(forward, self.upward))
        return np.array([right, np.cross(right, forward), forward])

    @property
    def distance(self) -> float:
        return float(np.linalg.norm(np.subtract(self.focus, self.place)))

    @property
    def parallel(self) -> bool:
        return self.angle == 0

    @property
    def height(self) -> float:
        """The height of the picture at the focus, mm."""
        return self.extent if self.parallel else 2 * self.distance * float(np.tan(self.angle / 2))

    @property
    def pixel(self) -> float:
        """The size of a pixel at the focus, mm."""
        return self.height / self.size[1]

    def project(self, points: Any) -> Floats:
        """Points (..., 3) to (..., 3): pixels from the left, pixels from the top, depth in mm.

        Behind the camera the depth is negative and the pixels are invalid.
        """
        apart = (np.asarray(points, float) - np.array(self.place)) @ self.axes.T
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

    def rays(self, x: Any, y: Any) -> tuple[Floats, Floats]:
        """Origins and directions (n, 3) of the rays through pixels.

        A direction advances the depth by one mm, so that a depth is a coordinate along the ray.
        """
        across, up = self.aside(x, y)
        right, upward, forward = self.axes
        aside = across[:, None] * right + up[:, None] * upward
        place = np.broadcast_to(np.array(self.place), aside.shape)
        if self.parallel:
            return place + aside, np.broadcast_to(forward, aside.shape)
        return place, forward + aside / self.distance

    def resize(self, size: tuple[int, int]) -> Camera:
        return replace(self, size=size)

    def apply(self, camera: Any) -> None:
        """Set a `vtkCamera` to the same view."""
        camera.SetPosition(*self.place)
        camera.SetFocalPoint(*self.focus)
        camera.SetViewUp(*self.axes[1])
        camera.SetParallelProjection(self.parallel)
        if self.parallel:
            camera.SetParallelScale(self.extent / 2)
        else:
            camera.SetViewAngle(np.degrees(self.angle))
        width, height = self.size
        camera.SetWindowCenter(2 * self.shift[0] * height / width, 2 * self.shift[1])


def fit(camera: Camera, points: Floats, area: Sequence[float] = (0.0, 0.0, 1.0, 1.0)) -> Camera:
    """The camera moved along its own direction and aside until points (n, 3) fill an area of its
    picture: left, top, right and bottom as shares of width and height."""
    width, height = camera.size
    left, top, right, bottom = area
    for _ in range(8):
        seen = camera.project(points)[:, :2]
        low, high = seen.min(axis=0), seen.max(axis=0)
        room = np.array([(right - left) * width, (bottom - top) * height])
        scale = float(((high - low) / room).max())
        away = np.subtract(camera.place, camera.focus) * scale
        camera = replace(
            camera,
            place=tuple(np.add(camera.focus, away)),
            extent=camera.extent * scale,
        )
        seen = camera.project(points)[:, :2]
        middle = (seen.min(axis=0) + seen.max(axis=0)) / 2
        wanted = np.array([(left + right) * width, (top + bottom) * height]) / 2
        more = (middle - wanted) / height
        camera = replace(
            camera, shift=(camera.shift[0] + float(more[0]), camera.shift[1] - float(more[1]))
        )
    return camera
