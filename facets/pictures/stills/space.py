"""Views of the mirror's range and of its path in a motion."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...core.names import DETECTORS
from ...core.rules import Rules
from ...core.units import Floats
from ...model.arrays import readings
from . import insets, rig
from .camera import Camera, fit
from .exposure import Lighting, assemble, expose
from .lettering import DrawingSheet, length_in_words
from .magnification import factor_in_words, round_down
from .materials import rgb
from .range_solid import COLOURS, REASONS, range_solid
from .rig import RigPart
from .studio import Studio, library
from .views import SceneView, face_camera


class HeadView(SceneView):
    """The mirror head alone, on its stage."""

    def own_parts(self) -> list[RigPart]:
        return [
            part
            for part in super().own_parts()
            if part.assembly == "head" or part.name in ("moving stage", "hub")
        ]


class RangeView(HeadView):
    """The range of the mirror's place as a translucent solid about its apex."""

    def __init__(self, *arguments: Any, rules: Rules) -> None:
        self.rules = rules
        super().__init__(*arguments)

    def build(self) -> None:
        super().build()
        self.solid = range_solid(self.sensor, self.rules)
        half = np.abs(self.solid.extent).max(axis=0)
        wanted = 13.0 * self.fit
        aside = self.factor(wanted / float(half[:2].max()))
        self.factors = np.array([aside, aside, self.factor(wanted / float(half[2]))])
        pyvista = library()
        points = self.solid.points * self.factors
        cells = np.column_stack([np.full(len(self.solid.faces), 4), self.solid.faces])
        self.mesh = pyvista.PolyData(points, cells.ravel())
        self.mesh["colour"] = (255 * np.array([rgb(COLOURS[n]) for n in self.solid.causes])).astype(
            np.uint8
        )
        self.mesh = self.mesh.compute_normals(
            cell_normals=False, split_vertices=True, feature_angle=25.0
        )
        self.shell = Studio([], self.theme)
        self.shell.plotter.add_mesh(
            self.mesh, scalars="colour", rgb=True, ambient=0.42, diffuse=0.55, specular=0.25,
            smooth_shading=True, reset_camera=False, render=False,
        )  # fmt: skip

    def factor(self, ratio: float) -> float:
        """Return 1 if the range is visible at its own size, else a round factor."""
        return 1.0 if 0.4 < ratio < 4 else round_down(ratio)

    def camera(self) -> Camera:
        if not hasattr(self, "_camera"):
            start = Camera(place=(120, -150, 62), focus=(0, 0, 0), angle=0.34, size=self.size)
            points = np.concatenate([self.mesh.points, np.array([[0, 0, -30.0 * self.fit]])])
            self._camera = fit(start, points, (0.26, 0.10, 0.74, 0.86))
        return self._camera

    def expose(self, camera: Camera, floor: bool = True, haze: float = 1.0) -> Floats:
        picture = super().expose(camera, haze=0.8)
        shot, shell = (
            self.studio.take(camera, self.sharpness),
            self.shell.take(camera, self.sharpness),
        )
        front = shell.depth < shot.depth
        clear = np.where(front, 0.52, 0.20) * shell.cover
        shown = shell.colour / np.maximum(shell.cover, 1e-3)[..., None]
        mixed: Floats = picture * (1 - clear[..., None]) + shown * clear[..., None]
        return mixed

    def draw(self, picture: Floats, sheet: DrawingSheet, camera: Camera) -> None:
        low, high = self.solid.extent
        ends = self.factors * np.array([low, high])
        offsets = {0: (0.0, 1.0), 1: (0.0, 1.0), 2: (-1.0, 0.0)}
        for axis, name in enumerate("xyz"):
            points = self.edge(ends, axis)
            a, b = camera.project(points)[:, :2]
            if a[0] > b[0]:
                a, b = b, a
            along = (b - a) / max(float(np.hypot(*(b - a))), 1e-9)
            aside = np.array([-along[1], along[0]])
            aside *= 1 if aside @ np.array(offsets[axis]) > 0 else -1
            words = f"{name}  {length_in_words(float(f'{high[axis] - low[axis]:.4g}'))}"
            sheet.dimension(a, b, words, 26 * sheet.unit * aside, 16)
        self.legend(sheet)
        across, up = (
            f"drawn {f:g} times larger" if f != 1 else "to scale" for f in self.factors[1:]
        )
        self.note = across if across == up else f"x and y {across}, z {up}"
        words = "range of the mirror's place" + (
            ", the beam following" if self.rules.tracking else ""
        )
        self.caption(sheet, words)

    def edge(self, ends: Floats, axis: int) -> Floats:
        """Return the two ends of a dimension, on the outside of the solid."""
        points = np.zeros((2, 3))
        points[:, axis] = ends[:, axis]
        if axis == 0:
            points[:, 1], points[:, 2] = ends[0, 1], ends[0, 2]
        elif axis == 1:
            points[:, 0], points[:, 2] = ends[1, 0], ends[0, 2]
        else:
            points[:, 0], points[:, 1] = ends[0, 0], ends[0, 1]
        return points

    def legend(self, sheet: DrawingSheet) -> None:
        """Name the causes of the range's end, with their shares of its faces."""
        unit = sheet.unit
        x, y = 30 * unit, 36 * unit
        title = sheet.write((x, y), "The range ends where", 15, bold=True, anchor=(0, 0.5))
        y = title[3] + 14 * unit
        areas = np.bincount(self.solid.causes, minlength=len(REASONS)) / len(self.solid.causes)
        for share, colour, reason in zip(areas, COLOURS, REASONS, strict=True):
            if share == 0:
                continue
            box = [n * 2 for n in (x, y - 8 * unit, x + 16 * unit, y + 8 * unit)]
            sheet.draw.rounded_rectangle(box, 6 * unit, fill=sheet.colour(colour))
            sheet.write((x + 26 * unit, y), reason, 15, anchor=(0, 0.5))
            y += 28 * unit

    def close(self) -> None:
        self.shell.close()
        super().close()


class TrailView(HeadView):
    """The path of the mirror's apex in a motion, and the spots' paths on the detectors."""

    def __init__(self, *arguments: Any, motion: Floats) -> None:
        self.motion = motion[:: max(1, len(motion) // 600)]
        super().__init__(*arguments)

    def build(self) -> None:
        super().build()
        reach = float(np.abs(self.motion[:, :3]).max())
        self.factor = max(1.0, round_down(16.0 * self.fit / reach)) if reach > 0 else 1.0
        self.path = self.factor * self.motion[:, :3]

    def camera(self) -> Camera:
        if not hasattr(self, "_camera"):
            start = Camera(place=(120, -150, 70), focus=(0, 0, 0), angle=0.34, size=self.size)
            radius = rig.head_radius(self.rest)
            rim = radius * np.array(
                [[1, 0, -1], [-1, 0, -1], [0, 1, -1], [0, -1, -1], [0, 0, -2.4]]
            )
            self._camera = fit(start, np.concatenate([self.path, rim]), (0.08, 0.10, 0.66, 0.84))
        return self._camera

    def expose(self, camera: Camera, floor: bool = True, haze: float = 1.0) -> Floats:
        """Render ghosts of the head where its path is lowest and highest, then the head at rest."""
        self.move_to(np.zeros(8))
        shot = self.studio.take(camera, self.sharpness)
        picture = expose(self.rest, shot, self.theme, self.floor, Lighting(self.laser, 0.8))
        for n in self.ghosts():
            self.move_to(np.concatenate([self.path[n], self.motion[n, 3:]]))
            shot = self.studio.take(camera, self.sharpness)
            ghost = assemble(shot, self.theme, None)
            cover = 0.13 * shot.cover[..., None]
            picture = picture * (1 - cover) + ghost * cover
        return picture

    def ghosts(self) -> list[int]:
        """Return the samples at which the path is lowest and highest."""
        return [int(self.path[:, 2].argmin()), int(self.path[:, 2].argmax())]

    def move_to(self, state: Floats) -> None:
        head = np.eye(4)
        stand = type(self.rest).from_state(self.sensor, state)
        head[:3, :3], head[:3, 3] = np.array(stand.at.turn, float), state[:3]
        self.studio.carry("head", head)

    def move(self, state: Floats) -> None:
        """Do nothing, since a motion has no single state."""

    def draw(self, picture: Floats, sheet: DrawingSheet, camera: Camera) -> None:
        seen = camera.project(self.path)[:, :2]
        count = len(seen)
        for n in range(count - 1):
            sheet.line([seen[n], seen[n + 1]], self.colour(n / count), 2.6)
        sheet.dot(seen[0], 5, self.colour(0.0))
        self.faces(picture, sheet)
        self.note = factor_in_words(self.factor)
        sheet.scale_bar(
            camera.pixel, (0.62 * self.size[0], self.size[1] - 26 * sheet.unit), " of the mirror"
        )
        self.caption(sheet, "the way of the mirror's point")

    def colour(self, share: float) -> str:
        """Return the colour at a share of the motion's duration."""
        first, last = np.array(rgb("#FFD166")), np.array(rgb("#EF476F"))
        mixed = (255 * (first + share * (last - first))).astype(int)
        return f"#{mixed[0]:02X}{mixed[1]:02X}{mixed[2]:02X}"

    def caption(self, sheet: DrawingSheet, what: str) -> None:
        words = " \u00b7 ".join(part for part in (self.title, what, self.note) if part)
        place = (24 * sheet.unit, sheet.size[1] - 20 * sheet.unit)
        sheet.write(place, words, 14, self.theme.ink, anchor=(0, 1))

    def faces(self, picture: Floats, sheet: DrawingSheet) -> None:
        """Draw the spots' paths, true to scale, on the three detectors."""
        height = self.size[1]
        side = int(0.235 * height) // 2 * 2
        left = self.size[0] - side - int(30 * sheet.unit)
        reading = readings(self.sensor, self.motion)
        for k, letter in enumerate(DETECTORS):
            top = int(0.04 * height + k * 0.315 * height)
            camera = face_camera(self.rest, k, (side, side))
            back = np.array(rgb(self.theme.panel)) * np.ones((side, side, 3))
            insets.paste(picture, back, (left, top), False)
            inset = insets.Inset(
                f"spot on detector {letter.upper()}", np.zeros(3), camera, self.theme.hues[k],
                note=self.size_in_words(k), cross=True,
            )  # fmt: skip
            insets.frame(sheet, inset, (left, top), (side, side))
            centre, axes = rig.detector_frame(self.rest, k)
            psd = self.sensor.psds[k]
            corners = [(-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1)]
            edge = [
                centre + a * psd.size_y / 2 * axes[0] + b * psd.size_z / 2 * axes[1]
                for a, b in corners
            ]
            shift = np.array([left, top])
            sheet.line(camera.project(np.array(edge))[:, :2] + shift, self.theme.faint, 1.0)
            spots = (
                centre + reading[:, 3 * k, None] * axes[0] + reading[:, 3 * k + 1, None] * axes[1]
            )
            way = camera.project(spots)[:, :2] + shift
            for n in range(len(way) - 1):
                if np.isfinite(way[n : n + 2]).all():
                    sheet.line([way[n], way[n + 1]], self.theme.hues[k], 1.6)

    def size_in_words(self, k: int) -> str:
        psd = self.sensor.psds[k]
        return f"{psd.size_y:g} x {psd.size_z:g} mm, to scale"
