"""The sensor in three dimensions: a picture, a film's frame, or a scene for other programs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from shutil import copyfile
from tempfile import TemporaryDirectory
from typing import Any, Literal

import numpy as np

from ...core.closing import ClosedAtExit
from ...core.sensor import Sensor
from ...core.units import Floats
from ...files.whole import Whole
from . import scene, space, views
from .materials import MATERIALS, THEMES, ThemeName
from .raster import as_bytes
from .rig import parts
from .scene import Stand
from .solids import Solid
from .studio import Studio, library, mesh_of

ViewName = Literal["both", "rig", "mirror", "detector", "cutaway", "range", "trail"]
#: File name endings: pictures, scenes that can be turned, films.
PICTURES, SCENES, MOVIES = (".png",), (".gltf", ".html"), (".mp4", ".gif")

VIEWS: dict[str, Callable[..., views.SceneView]] = {
    "both": views.CombinedView,
    "rig": views.RigView,
    "mirror": views.MirrorView,
    "detector": views.DetectorView,
    "cutaway": views.CutawayView,
    "range": space.RangeView,
    "trail": space.TrailView,
}


@dataclass(frozen=True)
class PictureForm:
    """How a picture is drawn.

    size: pixels.  title: begins the caption.  sharpness: samples a side of each pixel.
    """

    view: ViewName = "both"
    size: tuple[int, int] = (1200, 900)
    theme: ThemeName = "dark"
    title: str = ""
    sharpness: int = 2


class Picture(ClosedAtExit):
    """A view of the sensor at a state that can be changed.

    more: further inputs of a view: `rules` of a range, `motion` (n, 8) of a trail.
    """

    def __init__(
        self, sensor: Sensor, state: Floats, form: PictureForm | None = None, **more: Any
    ) -> None:
        form = form or PictureForm()
        theme = THEMES[form.theme]
        self.view = VIEWS[form.view](sensor, theme, form.size, form.title, form.sharpness, **more)
        self.move(state)

    def move(self, state: Floats) -> None:
        """Move to another state (8,), mm and rad."""
        self.view.move(np.asarray(state, float))

    def image(self) -> Any:
        """Return the picture (h, w, 3), 0 to 255."""
        return as_bytes(self.view.image())

    def save(self, path: Path) -> None:
        """Write a PNG; a failure leaves no partial file."""
        from PIL import Image

        with Whole(path) as temporary:
            Image.fromarray(self.image()).save(temporary, format="png", optimize=True)

    def close(self) -> None:
        self.view.close()


# --- scenes that can be turned: bodies of light beside the parts ---------------------------------


def add_light(studio: Studio, body: scene.Body) -> None:
    """Add a beam or a spot as a surface in its hue."""
    if body.kind not in ("beam", "sub-beam", "spot"):
        return
    theme = studio.theme
    colour = theme.beam if body.kind == "beam" else theme.hues["abc".index(body.name[-1].lower())]
    mesh = mesh_of(studio.pyvista, Solid(body.points, [list(face) for face in body.faces]), False)
    studio.plotter.add_mesh(
        mesh, color=colour, opacity=1.0 if body.kind == "spot" else 0.5, lighting=False,
        name=body.name, reset_camera=False, render=False,
    )  # fmt: skip


def save_scene(sensor: Sensor, state: Floats, path: Path) -> None:
    """Write a glTF file: the rig's parts with their materials, and the light as bodies."""
    studio = Studio(parts(Stand.from_state(sensor, state)), THEMES["light"])
    for body in scene.rig(sensor, state):
        add_light(studio, body)
    studio.plotter.camera_position = [(430, -540, 330), (0, 0, 0), (0, 0, 1)]
    studio.plotter.reset_camera()
    with Whole(path) as temporary, TemporaryDirectory() as folder:
        plain = Path(folder) / "scene.gltf"  # VTK opens no name that is not UTF-8
        studio.plotter.export_gltf(str(plain))
        copyfile(plain, temporary)
    studio.close()


__all__ = [
    "MATERIALS", "MOVIES", "PICTURES", "SCENES", "Picture", "PictureForm", "library", "save_scene",
]  # fmt: skip
