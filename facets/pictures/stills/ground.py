"""The floor under the rig, which fades into the background, and soft shadows on it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...core.units import Floats
from .camera import Camera
from .materials import Theme, rgb
from .raster import enlarge
from .rig import RigPart

#: Direction of the light that casts shadows.
KEY = (-0.45, -0.55, 1.6)
#: Side of the map of shadows, pixels.
MAP = 256


@dataclass(frozen=True)
class Ground:
    """A floor at z with a map of its illumination, over x and y from -reach to reach."""

    z: float
    reach: float
    shade: Floats

    def darkness(self, x: Floats, y: Floats) -> Floats:
        """Return the darkness of the shadows at places, 0 to 1."""
        from scipy.ndimage import map_coordinates

        scale = (MAP - 1) / (2 * self.reach)
        rows, columns = (y + self.reach) * scale, (x + self.reach) * scale
        shade: Floats = map_coordinates(self.shade, [rows, columns], order=1, mode="constant")
        return shade


def ground(parts: Sequence[RigPart], z: float) -> Ground:
    """Make the floor with the shadows of parts: the higher a part is, the softer its shadow."""
    from scipy.ndimage import gaussian_filter

    points = np.concatenate([part.solid.points for part in parts])
    reach = 1.35 * float(np.abs(points[:, :2]).max())
    pixel = 2 * reach / MAP
    levels: dict[int, list[RigPart]] = {}
    for part in parts:
        if np.ptp(part.solid.points, axis=0).max() < 4 * pixel or part.material in ("gold", "hole"):
            continue  # too fine to be visible in a soft shadow
        height = float(part.solid.points[:, 2].mean()) - z
        levels.setdefault(int(np.clip(np.log2(1 + height / 12), 0, 5)), []).append(part)
    shade = np.zeros((MAP, MAP))
    for level, group in levels.items():
        height = 12 * (2.0**level - 1)
        soft = (4 + 0.16 * height) / pixel
        cast = gaussian_filter(silhouettes(group, z, reach, KEY), soft)
        shade = 1 - (1 - shade) * (1 - 0.75 * cast)
        near = gaussian_filter(
            silhouettes(group, z, reach, (0, 0, 1.0)), (8 + 0.5 * height) / pixel
        )
        shade = 1 - (1 - shade) * (1 - 0.5 * near / (1 + height / 60))
    return Ground(z, reach, shade)


def silhouettes(
    parts: Sequence[RigPart], z: float, reach: float, light: tuple[float, float, float]
) -> Floats:
    """The shadows of parts on the floor in parallel light, (MAP, MAP), rows along y."""
    from PIL import Image, ImageDraw

    sheet = Image.new("L", (MAP, MAP))
    draw = ImageDraw.Draw(sheet)
    slope = np.array(light[:2]) / light[2]
    for part in parts:
        points = part.solid.points
        flat = points[:, :2] - (points[:, 2:] - z) * slope
        pixels = [tuple(pixel) for pixel in ((flat + reach) * (MAP - 1) / (2 * reach)).tolist()]
        for face in part.solid.faces:
            draw.polygon([pixels[n] for n in face], fill=255)
    return np.asarray(sheet, float) / 255


def backdrop(camera: Camera, theme: Theme, floor: Ground | None) -> Floats:
    """Render the background, (h, w, 3), from every other pixel a side, as it is soft."""
    width, height = camera.size
    half = camera.resize(((width + 1) // 2, (height + 1) // 2))
    whole = (2 * half.size[0], 2 * half.size[1])
    picture: Floats = enlarge(scenery(half, theme, floor), whole)[:height, :width]
    return picture


def scenery(camera: Camera, theme: Theme, floor: Ground | None) -> Floats:
    width, height = camera.size
    share = np.linspace(0, 1, height)[:, None, None]
    behind = np.array(rgb(theme.top)) * (1 - share) + np.array(rgb(theme.bottom)) * share
    picture = np.broadcast_to(behind, (height, width, 3)).copy()
    if floor is None:
        return picture
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    origin, ray = camera.rays(x.ravel(), y.ravel())
    down = ray[:, 2] < -1e-9
    reach = (floor.z - origin[down, 2]) / ray[down, 2]
    place = origin[down, :2] + reach[:, None] * ray[down, :2]
    far = np.hypot(place[:, 0], place[:, 1]) / floor.reach
    fade = (np.exp(-(far**2) * 1.6) * (reach > 0))[:, None]
    shade = (theme.shadow * floor.darkness(place[:, 0], place[:, 1]))[:, None]
    flat = picture.reshape(-1, 3)
    flat[down] = (flat[down] * (1 - fade) + np.array(rgb(theme.ground)) * fade) * (1 - shade)
    return picture
