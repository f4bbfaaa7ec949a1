"""A studio: parts among three soft lights, rendered by VTK.

VTK gives the colour and the depth of each pixel, also without a display or a graphics card. Beams,
shade and letters are added afterwards.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...core.errors import InputError
from ...core.extras import require_extra
from ...core.units import Floats
from ...optics.vectors import rotation
from .camera import Camera
from .materials import Material, Theme
from .solids import RigPart, Solid, join

#: Lamps: direction, colour and power of key, fill and rim light.
LAMPS = (
    ((-0.6, -1.0, 1.9), "#FFF4E6", 2.0),
    ((1.4, -0.3, 0.8), "#DCE8FF", 0.7),
    ((0.2, 1.5, 1.0), "#EAF2FF", 1.7),
)
#: Soft lights that the parts reflect: row and column of the middle, half height and half width, as
#: fractions of the surroundings, and power.
SOFTBOXES = (
    (0.10, 0.30, 0.13, 0.40, 0.75),
    (0.34, 0.62, 0.20, 0.10, 0.95),
    (0.36, 0.12, 0.24, 0.06, 0.95),
    (0.40, 0.86, 0.14, 0.12, 0.6),
)
#: Samples along each side of a pixel.
SHARPNESS = 2


def library() -> Any:
    """Import pyvista, set up to render without a display."""
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


def mesh_of(solid: Solid, smooth: bool) -> Any:
    """Convert a surface to a mesh; a smooth one has normals, which are split at sharp edges."""
    faces = np.concatenate([[len(face), *face] for face in solid.faces])
    mesh = library().PolyData(np.asarray(solid.points, float), faces)
    if not smooth:
        return mesh
    return mesh.triangulate().compute_normals(
        cell_normals=False, split_vertices=True, feature_angle=32.0, consistent_normals=False
    )


def cut_parts(parts: Iterable[RigPart], normal: Floats) -> list[RigPart]:
    """Cut parts by a plane through the origin; return the rear pieces and the faces of the cut.

    normal: towards the removed side.
    """
    pieces = []
    for part in parts:
        height = part.solid.points @ normal
        if height.max() <= 0:
            pieces.append(part)
        elif height.min() < 0:
            rest, face = cut_solid(part.solid, normal)
            material = Material(part.material.cut, even=True, outlined=True)
            pieces += [replace(part, solid=rest), replace(part, solid=face, material=material)]
    return pieces


def cut_solid(solid: Solid, normal: Floats) -> tuple[Solid, Solid]:
    """Cut a closed surface; return the open remainder, and the face that closes it."""
    from vtkmodules.vtkCommonDataModel import vtkPlane, vtkPlaneCollection
    from vtkmodules.vtkFiltersGeneral import vtkClipClosedSurface

    plane, planes, clip = vtkPlane(), vtkPlaneCollection(), vtkClipClosedSurface()
    plane.SetNormal(*-normal)
    planes.AddItem(plane)
    clip.SetInputData(mesh_of(solid, False).triangulate())
    clip.SetClippingPlanes(planes)
    clip.SetScalarModeToLabels()
    clip.Update()
    mesh = library().wrap(clip.GetOutput()).triangulate()
    is_face = np.asarray(mesh.active_scalars) == 1
    points, triangles = np.asarray(mesh.points, float), mesh.regular_faces
    return Solid(points, triangles[~is_face].tolist()), Solid(points, triangles[is_face].tolist())


@dataclass(frozen=True)
class Shot:
    """The parts as a camera renders them.

    colour: (h, w, 3), 0 to 1, black where no part is.  cover: (h, w), opacity of the parts, 0 to 1.
    depth: (h, w), distance behind the focus, mm, infinite where no opaque part is.
    """

    camera: Camera
    colour: Floats
    cover: Floats
    depth: Floats

    def black(self) -> Floats:
        """Return a picture (h, w) without light."""
        return np.zeros(self.depth.shape, np.float32)


def as_bytes(picture: Floats) -> Any:
    """Convert 0 to 1 to bytes, 0 to 255."""
    return (255 * np.clip(picture, 0, 1) + 0.5).astype(np.uint8)


def surroundings(theme: Theme) -> Any:
    """Return the environment that the parts reflect, (64, 128, 3), bytes."""
    rows, columns = np.linspace(0, 1, 64)[:, None], np.linspace(0, 1, 128)
    sky, floor = (0.42, 0.20) if theme.shines else (0.64, 0.55)
    light = np.where(rows > 0.53, floor, sky - 0.30 * rows) + 0 * columns
    for row, column, tall, wide, power in SOFTBOXES:
        around = np.abs((columns - column + 0.5) % 1 - 0.5)
        edge = np.maximum(np.abs(rows - row) / tall, around / wide)
        light += power / (1 + np.exp(np.clip(24 * (edge - 1), -50, 50)))
    return as_bytes(light[..., None] * [0.97, 1.0, 1.04])


class Studio:
    """Parts that a camera can render from any place.

    extra: parts that appear only in pictures that name their assemblies.
    """

    def __init__(
        self, parts: Sequence[RigPart], theme: Theme, extra: Sequence[RigPart] = ()
    ) -> None:
        self.pyvista = library()
        self.plotter = self.pyvista.Plotter(off_screen=True, window_size=[64, 64], lighting="none")
        self.plotter.set_background("black")
        self.plotter.render_window.SetMultiSamples(0)
        self.plotter.render_window.SetAlphaBitPlanes(1)
        self.plotter.renderer.SetBackgroundAlpha(0.0)
        self.actors: list[tuple[str, Any]] = []
        self.surround(theme)
        groups: dict[tuple[str, Material], list[Solid]] = {}
        self.main = {part.assembly for part in parts}
        for part in (*parts, *extra):  # few surfaces, since each takes time
            groups.setdefault((part.assembly, part.material), []).append(part.solid)
        for (assembly, material), solids in groups.items():
            self.add(assembly, join(solids), material)

    def surround(self, theme: Theme) -> None:
        """Add the lamps and the environment that the parts reflect."""
        texture = self.pyvista.Texture(surroundings(theme))
        texture.SetMipmap(True)
        texture.SetInterpolate(True)
        renderer = self.plotter.renderer
        renderer.SetUseImageBasedLighting(True)
        renderer.SetEnvironmentTexture(texture, True)
        renderer.SetEnvironmentUp(0, 0, 1)
        renderer.SetEnvironmentRight(1, 0, 0)
        renderer.GetEnvMapPrefiltered().SetPrefilterMaxSamples(32)
        renderer.GetEnvMapPrefiltered().SetPrefilterLevels(4)
        table = renderer.GetEnvMapLookupTable()  # small: the light is soft
        table.SetLUTSize(128)
        table.SetLUTSamples(32)
        for place, colour, power in LAMPS:
            lamp = self.pyvista.Light(
                position=place, focal_point=(0, 0, 0), color=colour,
                intensity=power * theme.exposure, light_type="scene light",
            )  # fmt: skip
            lamp.positional = False
            self.plotter.add_light(lamp)

    def add(self, assembly: str, solid: Solid, material: Material) -> None:
        """Add a surface of a material."""
        look: dict[str, Any] = {"smooth_shading": False, "reset_camera": False, "render": False}
        mesh = mesh_of(solid, material.smooth and not material.even)
        if material.even:
            look |= {"lighting": False}
        else:
            look |= {"pbr": True, "metallic": material.metallic, "roughness": material.roughness}
        actor = self.plotter.add_mesh(
            mesh, color=material.colour, opacity=1 - material.clear, **look
        )
        if material.smooth and not material.even:
            actor.prop.interpolation = "Physically based rendering"
        self.actors.append((assembly, actor))
        if material.outlined:
            rims = mesh.extract_feature_edges(feature_edges=False, manifold_edges=False)
            self.actors.append((assembly, self.plotter.add_mesh(
                rims, color="#10141A", line_width=2.0, lighting=False,
                reset_camera=False, render=False,
            )))  # fmt: skip

    def add_floor(self, picture: Any, reach: float, z: float) -> None:
        """Add a picture (n, n, 4), bytes, as a floor from -reach to reach at z; its first row is at
        the smallest y."""
        corners = reach * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
        floor = mesh_of(Solid(np.insert(corners, 2, z, axis=1), [[0, 1, 2, 3]]), False)
        floor.active_texture_coordinates = (corners / reach + 1) / 2
        actor = self.plotter.add_mesh(
            floor, texture=self.pyvista.Texture(picture[::-1].copy()), lighting=False,
            reset_camera=False, render=False,
        )  # fmt: skip
        actor.ForceTranslucentOn()
        self.main.add("floor")
        self.actors.append(("floor", actor))

    def move(self, state: Floats, turning: float = 1.0) -> None:
        """Move head and laser to a state (8,); the head's angles are multiplied by `turning`."""
        moved = {"head": np.eye(4), "laser": np.eye(4)}
        moved["head"][:3, :3] = np.array(rotation(*(turning * state[3:6])), float)
        moved["head"][:3, 3], moved["laser"][:2, 3] = state[:3], state[6:]
        for assembly, actor in self.actors:
            if assembly in moved:
                actor.user_matrix = moved[assembly]

    def take(self, camera: Camera, assemblies: Collection[str] = ()) -> Shot:
        """Render assemblies, by default those of the rig, from `SHARPNESS`^2 samples a pixel."""
        for assembly, actor in self.actors:
            actor.visibility = assembly in (assemblies or self.main)
        width, height = camera.size
        window, view = self.plotter.render_window, self.plotter.renderer.GetActiveCamera()
        camera.apply(view)
        self.plotter.renderer.ResetCameraClippingRange()
        # strips, since VTK holds several buffers of all samples
        count = max(n for n in range(1, SHARPNESS**2 + 1) if height % n == 0)
        window.SetSize(width * SHARPNESS, height * SHARPNESS // count)
        strips = []
        for n in reversed(range(count)):  # from the top
            camera.apply(view, n, count)
            window.Render()
            strips.append(develop(*buffers(window)))
        colour, nearest = (np.concatenate(parts) for parts in zip(*strips, strict=True))
        shown = np.divide(colour, 255, dtype=np.float32)
        depth = depth_of(nearest, *view.GetClippingRange()) - camera.distance
        return Shot(camera, shown[..., :3], shown[..., 3], depth.astype(np.float32))

    def close(self) -> None:
        self.plotter.close()


def buffers(window: Any) -> tuple[Any, Any]:
    """Return colour and opacity of each sample (h, w, 4), 0 to 255, and its depth level (h, w)."""
    from vtkmodules.util import numpy_support
    from vtkmodules.vtkCommonCore import vtkFloatArray, vtkUnsignedCharArray

    width, height = window.GetActualSize()
    bytes_, levels = vtkUnsignedCharArray(), vtkFloatArray()
    window.GetRGBACharPixelData(0, 0, width - 1, height - 1, 0, bytes_, 0)
    window.GetZbufferData(0, 0, width - 1, height - 1, levels)
    as_array: Any = numpy_support.vtk_to_numpy
    colour = as_array(bytes_).reshape(height, width, 4)[::-1]
    return colour, as_array(levels).reshape(height, width)[::-1]


def develop(colour: Any, level: Any) -> tuple[Any, Any]:
    """Reduce samples to pixels: the mean of colour and opacity, and the nearest depth level."""
    from PIL import Image

    image = Image.fromarray(np.ascontiguousarray(colour), "RGBa").reduce(SHARPNESS)
    cells = [level[i::SHARPNESS, j::SHARPNESS] for i, j in np.ndindex(SHARPNESS, SHARPNESS)]
    return np.asarray(image), np.minimum.reduce(cells)


def depth_of(level: Any, near: float, far: float) -> Floats:
    """Convert depth levels, 0 at the near and 1 at the far end of the clipping range, to mm."""
    depth = near * far / (far - level.astype(float) * (far - near))
    return np.where(level < 1, depth, np.inf)
