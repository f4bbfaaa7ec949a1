"""Parts in a studio: three soft lights around them, and a camera.

The colours and depths of the parts' pixels come from VTK, which also renders without a display and
without a graphics card. Ground, light and letters are added to that.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...core.errors import InputError
from ...core.extras import require_extra
from ...core.units import Booleans, Floats
from .camera import Camera
from .materials import MATERIALS, Theme
from .rig import RigPart
from .solids import Solid, join


def library() -> Any:
    """Import pyvista, set up for the case without a display."""
    if sys.platform.startswith("linux") and not os.environ.get("DISPLAY"):
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
    try:
        import pyvista
        import pyvista.plotting  # pyvista imports it late
    except ModuleNotFoundError:
        require_extra("pyvista", "a picture in 3D")
        raise
    except ImportError as error:
        raise InputError(
            f"3D pictures need libraries that are missing ({error}); on Debian and Ubuntu: "
            "apt install libegl1 libegl-mesa0 libgl1-mesa-dri"
        ) from None
    pyvista.OFF_SCREEN = True
    return pyvista


def mesh_of(pyvista: Any, solid: Solid, smooth: bool = True) -> Any:
    """Convert a surface to a mesh with normals: shared across flat edges, split at sharp ones."""
    faces = np.concatenate([[len(face), *face] for face in solid.faces])
    mesh = pyvista.PolyData(np.asarray(solid.points, float), faces)
    if not smooth:
        return mesh
    return mesh.triangulate().compute_normals(
        cell_normals=False, split_vertices=True, feature_angle=32.0, consistent_normals=False
    )


def group_solids(parts: Iterable[RigPart]) -> dict[tuple[str, str], list[Solid]]:
    """Group surfaces by assembly and material, since each drawn surface takes time."""
    groups: dict[tuple[str, str], list[Solid]] = {}
    for part in parts:
        groups.setdefault((part.assembly, part.material), []).append(part.solid)
    return groups


@dataclass(frozen=True)
class Shot:
    """A camera's picture of the parts.

    colour: (h, w, 3), 0 to 1, black where no part is.  cover: (h, w) opacity of the parts.
    depth: (h, w), mm along the camera's axis, infinite where no part is.
    """

    camera: Camera
    colour: Floats
    cover: Floats
    depth: Floats

    @property
    def is_covered(self) -> Booleans:
        finite: Booleans = np.isfinite(self.depth)
        return finite


def surroundings(theme: Theme) -> Any:
    """Return the environment that the parts reflect, (64, 128, 3): a large soft light above, one
    from the side, a narrow one from behind, and a floor."""
    rows, columns = np.linspace(0, 1, 64)[:, None], np.linspace(0, 1, 128)[None, :]

    def softbox(row: float, column: float, tall: float, wide: float, power: float) -> Floats:
        around = np.abs((columns - column + 0.5) % 1 - 0.5)
        edge = np.maximum(np.abs(rows - row) / tall, around / wide)
        light: Floats = power / (1 + np.exp(np.clip(24 * (edge - 1), -50, 50)))
        return light

    sky = 0.42 - 0.30 * rows
    floor = 0.20 if theme.shines else 0.55
    light = np.where(rows > 0.53, floor * np.ones_like(columns), sky + 0 * columns)
    if not theme.shines:
        light = light + np.where(rows <= 0.53, 0.22, 0.0)
    light = light + softbox(0.10, 0.30, 0.13, 0.40, 0.75)
    light = light + softbox(0.34, 0.62, 0.20, 0.10, 0.95)
    light = light + softbox(0.36, 0.12, 0.24, 0.06, 0.95)
    light = light + softbox(0.40, 0.86, 0.14, 0.12, 0.6)
    tint = np.array([0.97, 1.0, 1.04])
    return (255 * np.clip(light[..., None] * tint, 0, 1)).astype(np.uint8)


class Studio:
    """Parts that a camera can render from any place."""

    def __init__(self, parts: Iterable[RigPart], theme: Theme) -> None:
        self.pyvista, self.theme = library(), theme
        self.plotter = self.pyvista.Plotter(off_screen=True, window_size=[64, 64], lighting="none")
        self.plotter.set_background("black")
        self.plotter.render_window.SetMultiSamples(0)
        self.plotter.render_window.SetAlphaBitPlanes(1)
        self.plotter.renderer.SetBackgroundAlpha(0.0)
        self.actors: dict[str, Any] = {}
        self.surround()
        self.light()
        for (assembly, material), solids in group_solids(parts).items():
            self.add(join(solids), material, f"{assembly} {material}")

    def surround(self) -> None:
        texture = self.pyvista.Texture(surroundings(self.theme))
        texture.SetMipmap(True)
        texture.SetInterpolate(True)
        renderer = self.plotter.renderer
        renderer.SetUseImageBasedLighting(True)
        renderer.SetEnvironmentTexture(texture, True)
        renderer.SetEnvironmentUp(0, 0, 1)
        renderer.SetEnvironmentRight(1, 0, 0)
        renderer.GetEnvMapPrefiltered().SetPrefilterMaxSamples(32)
        renderer.GetEnvMapPrefiltered().SetPrefilterLevels(4)
        table = renderer.GetEnvMapLookupTable()  # of a size that soft light needs
        table.SetLUTSize(128)
        table.SetLUTSamples(32)

    def light(self) -> None:
        """Add key, fill and rim light."""
        strength = self.theme.exposure
        for place, colour, power in (
            ((-0.6, -1.0, 1.9), "#FFF4E6", 2.0),
            ((1.4, -0.3, 0.8), "#DCE8FF", 0.7),
            ((0.2, 1.5, 1.0), "#EAF2FF", 1.7),
        ):
            light = self.pyvista.Light(
                position=place, focal_point=(0, 0, 0), color=colour, intensity=power * strength,
                light_type="scene light",
            )  # fmt: skip
            light.positional = False
            self.plotter.add_light(light)

    def add(self, solid: Solid, name: str, key: str) -> None:
        """Add a surface of a material; it replaces an earlier one with the same key."""
        material = MATERIALS[name]
        mesh = mesh_of(self.pyvista, solid, material.smooth)
        actor = self.plotter.add_mesh(
            mesh, color=material.colour, pbr=True, metallic=material.metallic,
            roughness=material.roughness, opacity=1 - material.clear, name=key,
            smooth_shading=False, reset_camera=False, render=False,
        )  # fmt: skip
        if material.smooth:
            actor.prop.interpolation = "Physically based rendering"
        self.actors[key] = actor

    def add_flat(self, part: RigPart, colour: str, name: str) -> None:
        """Add a part in one even colour, as the face of a cut."""
        mesh = mesh_of(self.pyvista, part.solid, smooth=False)
        self.actors[name] = self.plotter.add_mesh(
            mesh, color=colour, lighting=False, show_edges=True, edge_color="#10141A",
            line_width=2.0, name=name, reset_camera=False, render=False,
        )  # fmt: skip

    def carry(self, assembly: str, matrix: Floats) -> None:
        """Move an assembly's parts from their original place by a matrix (4, 4)."""
        for key, actor in self.actors.items():
            if key.startswith(f"{assembly} "):
                actor.user_matrix = matrix

    def only(self, *assemblies: str) -> None:
        """Show only these assemblies, or all if none is named."""
        for key, actor in self.actors.items():
            actor.visibility = not assemblies or key.startswith(tuple(f"{a} " for a in assemblies))

    def take(self, camera: Camera, sharpness: int = 2) -> Shot:
        """Render the camera's picture, from `sharpness` x `sharpness` samples a pixel."""
        width, height = (n * sharpness for n in camera.size)
        self.plotter.window_size = [width, height]
        view = self.plotter.renderer.GetActiveCamera()
        camera.apply(view)
        self.plotter.renderer.ResetCameraClippingRange()
        window = self.plotter.render_window
        window.Render()
        return develop(camera, *buffers(window, view, width, height), sharpness)

    def close(self) -> None:
        self.plotter.close()


def buffers(window: Any, view: Any, width: int, height: int) -> tuple[Any, Floats]:
    """Return colour and cover (h, w, 4) of each sample, 0 to 255, and depth (h, w), mm along the
    camera's axis."""
    from vtkmodules.util import numpy_support
    from vtkmodules.vtkCommonCore import vtkFloatArray, vtkUnsignedCharArray

    bytes_, levels = vtkUnsignedCharArray(), vtkFloatArray()
    window.GetRGBACharPixelData(0, 0, width - 1, height - 1, 0, bytes_, 0)
    window.GetZbufferData(0, 0, width - 1, height - 1, levels)
    as_array: Any = numpy_support.vtk_to_numpy
    colour = as_array(bytes_).reshape(height, width, 4)[::-1]
    level = as_array(levels).reshape(height, width)[::-1]
    near, far = view.GetClippingRange()
    behind = level >= 1
    level = level.astype(float)
    if view.GetParallelProjection():
        depth = near + level * (far - near)
    else:
        depth = near * far / (far - level * (far - near))
    depth[behind] = np.inf
    return colour, depth


def develop(camera: Camera, colour: Any, depth: Floats, sharpness: int) -> Shot:
    """Reduce samples to pixels: colours and covers are averaged, and depths are the nearest."""
    from PIL import Image

    image = Image.fromarray(np.ascontiguousarray(colour), "RGBa").reduce(sharpness)
    shown = np.asarray(image, np.float32) / 255
    cells = [depth[i::sharpness, j::sharpness] for i in range(sharpness) for j in range(sharpness)]
    nearest = cells[0]
    for cell in cells[1:]:
        nearest = np.minimum(nearest, cell)
    return Shot(camera, shown[..., :3], shown[..., 3], nearest)


def bounds(parts: Sequence[RigPart]) -> Floats:
    """Return all points of parts, (n, 3)."""
    return np.concatenate([part.solid.points for part in parts])
