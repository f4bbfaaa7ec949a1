"""Bodies to pictures, by pyvista: off-screen where there is no display, else as asked."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ..core.errors import InputError
from ..core.names import STATE_COLUMNS, STATE_UNITS
from ..core.sensor import Sensor
from ..core.units import Floats
from ..files.tables import Whole
from ..model.arrays import geometry_of
from . import scene, style
from .scene import Body

View = Literal["both", "rig", "mirror"]

#: Colour and opacity by kind.
LOOKS: dict[str, tuple[str, float]] = {
    "mirror": ("#9FB4C7", 1.0),
    "beam": (style.ORANGE, 0.30),
    "sub-beam": (style.ORANGE, 0.45),
    "detector": ("#DCE6DC", 1.0),
}
PICTURES, SCENES, MOVIES = (".png",), (".gltf", ".html"), (".mp4", ".gif")


def library(interactive: bool = False) -> Any:
    """pyvista, told to work without a display where there is none."""
    if not interactive and sys.platform.startswith("linux") and not os.environ.get("DISPLAY"):
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
    try:
        import pyvista
    except ImportError as error:
        raise InputError(
            f"3D pictures need libraries that are missing ({error}); on Debian and Ubuntu: "
            "apt install libegl1 libegl-mesa0 libgl1-mesa-dri"
        ) from None
    pyvista.OFF_SCREEN = not interactive
    return pyvista


def mesh_of(pyvista: Any, body: Body) -> Any:
    faces = np.concatenate([[len(face), *face] for face in body.faces])
    mesh = pyvista.PolyData(body.points, faces)
    if body.light is not None:
        mesh["light"] = body.light
    return mesh


#: A view's bodies, by its name.
BODIES: dict[str, Callable[[Sensor, Floats], list[Body]]] = {
    "rig": scene.rig,
    "mirror": scene.close_up,
    "PSD A": lambda sensor, state: scene.face(sensor, state, 0),
    "PSD B": lambda sensor, state: scene.face(sensor, state, 1),
    "PSD C": lambda sensor, state: scene.face(sensor, state, 2),
}
#: Where the five views of a whole picture stand: rows and columns of a 3 x 6 grid.
WHOLE = {
    "rig": (slice(0, 2), slice(0, 3)),
    "mirror": (slice(0, 2), slice(3, 6)),
    "PSD A": (2, slice(0, 2)),
    "PSD B": (2, slice(2, 4)),
    "PSD C": (2, slice(4, 6)),
}


def corner(place: Any) -> tuple[int, int]:
    """Where a group of the grid begins."""
    rows, columns = (part.start if isinstance(part, slice) else part for part in place)
    return rows, columns


def detector_frame(sensor: Sensor, k: int) -> tuple[Floats, Floats]:
    """Centre and axes of detector k, in the world."""
    geometry = geometry_of(sensor)
    return np.array(geometry.centres[k]), np.array(geometry.axes[k])


class Picture:
    """A plotter with the sensor in it, at a state that can be changed."""

    def __init__(
        self,
        sensor: Sensor,
        state: Floats,
        view: View = "both",
        size: tuple[int, int] = (1200, 900),
        interactive: bool = False,
    ) -> None:
        self.sensor, self.pyvista = sensor, library(interactive)
        self.places = {name: corner(place) for name, place in WHOLE.items()}
        if view != "both":
            self.places = {view: (0, 0)}
        whole = {"shape": (3, 6), "groups": list(WHOLE.values())} if view == "both" else {}
        self.plotter = self.pyvista.Plotter(
            off_screen=not interactive, window_size=list(size), border=view == "both",
            border_color=style.GREY, **whole,
        )  # fmt: skip
        self.meshes: dict[tuple[str, str], Any] = {}
        for name in self.places:
            self.fill(name, state)
            self.dress(name, state)
        self.plotter.render_window.SetMultiSamples(0)  # else translucent bodies are not drawn
        self.tell(state)

    def turn_to(self, name: str) -> None:
        self.plotter.subplot(*self.places[name])

    def fill(self, view: str, state: Floats) -> None:
        """Draws the bodies of a view at a state; those that were drawn already only move.

        A body that has vanished is taken out, and one with other points or faces drawn anew.
        """
        self.turn_to(view)
        bodies = {body.name: body for body in BODIES[view](self.sensor, state)}
        for name in [name for of, name in self.meshes if of == view and name not in bodies]:
            for actor in (name, f"to {name}"):  # the body, and the line along it
                self.plotter.remove_actor(actor, render=False)
            del self.meshes[view, name]
        for body in bodies.values():
            fresh, mesh = mesh_of(self.pyvista, body), self.meshes.get((view, body.name))
            if mesh is None or not np.array_equal(mesh.faces, fresh.faces):
                self.meshes[view, body.name] = fresh
                self.add(fresh, body)
                continue
            mesh.points = body.points
            if body.light is not None:
                mesh["light"] = body.light

    def add(self, mesh: Any, body: Body) -> None:
        """Adds a body's mesh to the present view, in place of an older one of its name."""
        if body.light is not None:
            self.plotter.add_mesh(
                mesh, scalars="light", cmap="inferno", clim=(0, 1), show_scalar_bar=False,
                lighting=False, name=body.name, reset_camera=False, render=False,
            )  # fmt: skip
            return
        colour, opacity = LOOKS[body.kind]
        self.plotter.add_mesh(
            mesh, color=colour, opacity=opacity, line_width=1.5, edge_color=style.INK,
            show_edges=body.kind in ("mirror", "detector"),
            lighting=body.kind == "mirror", name=body.name, reset_camera=False, render=False,
        )  # fmt: skip

    def dress(self, view: str, state: Floats) -> None:
        """Labels and camera of a view."""
        self.plotter.set_background("white")
        self.plotter.enable_depth_peeling(12)
        if view == "rig":
            self.guides()
            self.label_rig()
            self.plotter.view_vector((1.0, -1.25, 0.8))
            self.plotter.camera.zoom(1.02)
        elif view == "mirror":
            self.look_close(np.array(state[:3]))
        else:
            self.look_at_face("ABC".index(view[-1]))
        title = {"rig": "rig", "mirror": "mirror, close"}.get(view, f"{view}, from the mirror")
        self.plotter.add_text(
            title, position="upper_left", font_size=10, color=style.INK, render=False
        )

    def look_close(self, apex: Floats) -> None:
        width = max(self.sensor.beam.diameter_x, self.sensor.beam.diameter_y)
        self.arrows(apex)
        place = apex + 6.0 * width * np.array([0.8, -0.75, 0.62])
        self.plotter.camera_position = [tuple(place), tuple(apex), (0, 0, 1)]

    def look_at_face(self, k: int) -> None:
        psd = self.sensor.psds[k]
        centre, axes = detector_frame(self.sensor, k)
        place = centre - 60 * axes[0]
        self.plotter.camera_position = [tuple(place), tuple(centre), tuple(axes[2])]
        self.plotter.enable_parallel_projection()
        self.plotter.camera.parallel_scale = 0.66 * max(psd.size_y, psd.size_z)

    def guides(self) -> None:
        """A line along the beam and each sub-beam, to find what is a pixel wide."""
        for (view, name), mesh in list(self.meshes.items()):
            if view == "rig" and (name.startswith("sub-beam") or name == "beam"):
                half = len(mesh.points) // 2
                line = self.pyvista.Line(
                    mesh.points[:half].mean(axis=0), mesh.points[half:].mean(axis=0)
                )
                self.plotter.add_mesh(
                    line,
                    color=style.ORANGE,
                    line_width=2.5,
                    name=f"to {name}",
                    reset_camera=False,
                    render=False,
                )

    def label_rig(self) -> None:
        beam = self.sensor.beam
        places, texts = [(0.0, 0.0, 128.0)], [f"{1e3 * beam.power:g} uW, {beam.diameter_x:g} mm"]
        for psd, letter in zip(self.sensor.psds, "ABC", strict=True):
            x, y = psd.radius * np.cos(psd.azimuth), psd.radius * np.sin(psd.azimuth)
            places += [
                (x, y, psd.height + psd.size_z / 2 + 12),
                (x / 2, y / 2, psd.height / 2 - 14),
            ]
            texts += [f"PSD {letter}, {psd.size_y:g} x {psd.size_z:g} mm", f"{psd.radius:g} mm"]
        self.write(places, texts, "labels", 13)

    def write(self, places: Any, texts: list[str], name: str, size: int) -> None:
        self.plotter.add_point_labels(
            np.array(places), texts, shape=None, show_points=False, font_size=size, name=name,
            text_color=style.INK, always_visible=True, reset_camera=False, render=False,
        )  # fmt: skip

    def arrows(self, apex: Floats) -> None:
        """The world's axes at the apex, a millimetre long."""
        for axis, colour in enumerate((style.BLUE, style.GREEN, style.INK)):
            arrow = self.pyvista.Arrow(
                start=apex, direction=np.eye(3)[axis], scale=1.0, shaft_radius=0.008,
                tip_radius=0.025, tip_length=0.08,
            )  # fmt: skip
            self.plotter.add_mesh(
                arrow,
                color=colour,
                lighting=False,
                name=f"axis {axis}",
                render=False,
                reset_camera=False,
            )
        self.write(apex + 1.12 * np.eye(3), ["x_w, 1 mm", "y_w, 1 mm", "z_w, 1 mm"], "axes", 14)

    def tell(self, state: Floats) -> None:
        """The state, written below."""
        words = [
            f"{name} {value / unit:.4g}"
            for name, value, unit in zip(STATE_COLUMNS, state, STATE_UNITS, strict=True)
            if value != 0
        ]
        self.turn_to("rig" if "rig" in self.places else "mirror")
        lines = ["   ".join(words[n : n + 4]) for n in range(0, len(words), 4)] or ["at rest"]
        self.plotter.add_text(
            "\n".join(lines),
            position="lower_left",
            font_size=8,
            color=style.INK,
            name="state",
            render=False,
        )

    def move(self, state: Floats) -> None:
        """To another state."""
        for view in self.places:
            self.fill(view, state)
        if "rig" in self.places:
            self.turn_to("rig")
            self.guides()
        if "mirror" in self.places:
            self.turn_to("mirror")
            self.look_close(np.array(state[:3]))
        self.tell(state)

    def save(self, path: Path) -> None:
        """PNG or glTF by its ending; whole or not at all."""
        with Whole(path) as temporary:
            kind = path.suffix.lower()
            if kind in PICTURES:
                self.plotter.screenshot(str(temporary))
            else:
                self.plotter.export_gltf(str(temporary))

    def film(
        self, path: Path, states: Iterable[Floats], rate: float, tell: Callable[[], None]
    ) -> None:
        """A frame for each of states (n, 8)."""
        with Whole(path) as temporary:
            if path.suffix.lower() == ".gif":
                self.plotter.open_gif(str(temporary), fps=rate)
            else:
                self.plotter.open_movie(str(temporary), framerate=rate, macro_block_size=2)
            for state in states:
                self.move(state)
                self.plotter.write_frame()
                tell()
            self.plotter.mwriter.close()

    def close(self) -> None:
        self.plotter.close()
