"""The views of the sensor: their contents, cameras and labels."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ...core.names import DETECTORS
from ...core.sensor import Sensor
from ...core.units import MICRO, MRAD, UM, UW, Floats
from ...model.arrays import readings
from ...optics.vectors import rotation
from . import insets, rig
from .camera import Camera, fit, normalize
from .exposure import Lighting, expose, expose_face
from .ground import Ground, ground
from .insets import Inset
from .lettering import DrawingSheet, length_in_words
from .materials import Theme
from .rig import RigPart
from .scene import Stand, array, cut
from .sections import cut_parts
from .solids import join
from .studio import Studio, bounds, library

#: Direction from the rig to the camera: to the right, to the front and from above.
ASPECT = (0.56, -0.66, 0.46)


def state_in_words(state: Floats) -> str:
    """Format a state: "x 80 µm, yaw 10 mrad"; "at rest" for zero."""
    names = ("x", "y", "z", "roll", "pitch", "yaw", "beam x", "beam y")
    words = []
    for n, (name, value) in enumerate(zip(names, state, strict=True)):
        if value == 0:
            continue
        if 3 <= n < 6:
            words.append(f"{name} {MRAD * value:.4g} mrad")
        elif abs(value) < 0.9995:
            words.append(f"{name} {UM * value:.4g} {MICRO}m")
        else:
            words.append(f"{name} {value:.4g} mm")
    return "   ".join(words) or "at rest"


def power_in_words(power: float) -> str:
    return f"{power:.3g} mW" if power >= 1 else f"{UW * power:.3g} {MICRO}W"


class SceneView:
    """Base of the views: parts made at rest, whose head and laser are moved to a state.

    dark: detectors whose sub-beam is omitted.  larger: the magnification of its states, which the
    caption states.  turning: the further magnification of the head's rotation about its apex, if
    that would be invisible otherwise.
    """

    dark: tuple[int, ...] = ()
    larger = turning = 1.0

    def __init__(
        self, sensor: Sensor, theme: Theme, size: tuple[int, int], title: str, sharpness: int
    ) -> None:
        self.sensor, self.theme, self.size, self.title = sensor, theme, size, title
        self.sharpness = sharpness
        self.rest = self.stand = Stand.from_state(sensor, np.zeros(8))
        self.state = np.zeros(8)
        self.fit = rig.scale_of(self.rest)
        self.laser = rig.LASER_HEIGHT_MM * self.fit
        self.note = ""
        self.build()

    def build(self) -> None:
        self.parts = self.own_parts()
        self.studio = Studio(self.parts, self.theme)
        self.floor: Ground | None = ground(self.parts, rig.ground_of(self.rest))

    def own_parts(self) -> list[RigPart]:
        return rig.parts(self.rest)

    def move(self, state: Floats) -> None:
        self.state, self.stand = state, Stand.from_state(self.sensor, state)
        beam = np.eye(4)
        beam[:2, 3] = state[6:]
        self.carry_head(self.turning)
        self.studio.carry("laser", beam)

    def carry_head(self, turning: float) -> None:
        """Move the head to the mirror's pose, with its angles `turning` times as large."""
        matrix = np.eye(4)
        roll, pitch, yaw = turning * self.state[3:6]
        matrix[:3, :3] = np.array(rotation(roll, pitch, yaw), float)
        matrix[:3, 3] = self.state[:3]
        self.studio.carry("head", matrix)

    def image(self) -> Floats:
        """Render the picture, (h, w, 3), 0 to 1."""
        camera = self.camera()
        sheet = DrawingSheet(self.size, self.theme)
        picture = self.expose(camera)
        self.draw(picture, sheet, camera)
        return sheet.draw_over(picture)

    def camera(self) -> Camera:
        raise NotImplementedError

    def draw(self, picture: Floats, sheet: DrawingSheet, camera: Camera) -> None:
        """Draw labels and insets over the picture of the parts."""

    def expose(self, camera: Camera, floor: bool = True, haze: float = 1.0) -> Floats:
        shot = self.studio.take(camera, self.sharpness)
        under = self.floor if floor else None
        return expose(self.stand, shot, self.theme, under, Lighting(self.laser, haze, self.dark))

    def caption(self, sheet: DrawingSheet, what: str) -> None:
        """Write the picture's title and the state at the lower left."""
        left, low = 24 * sheet.unit, sheet.size[1] - 20 * sheet.unit
        state = sheet.write(
            (left, low), state_in_words(self.state / self.larger), 14, self.theme.ink, anchor=(0, 1)
        )
        words = " \u00b7 ".join(part for part in (self.title, what, self.note) if part)
        sheet.write((left, state[1] - 3 * sheet.unit), words, 13, self.theme.faint, anchor=(0, 1))

    def close(self) -> None:
        self.studio.close()


class RigView(SceneView):
    """The whole rig, with its dimensions."""

    area = (0.05, 0.05, 0.95, 0.88)

    def camera(self) -> Camera:
        """Place the camera so that all of the rig at rest is in the picture."""
        if not hasattr(self, "_camera"):
            start = Camera(
                place=tuple(600 * np.array(ASPECT)), focus=(0, 0, 0), angle=0.38, size=self.size
            )
            self._camera = fit(start, bounds(self.parts), self.area)
        return self._camera

    def draw(self, picture: Floats, sheet: DrawingSheet, camera: Camera) -> None:
        self.annotate(sheet, camera)
        self.caption(sheet, "the rig")

    def annotate(self, sheet: DrawingSheet, camera: Camera) -> None:
        """Draw dimensions, the detectors' names, the beam, and a scale."""
        width, height = self.size
        sheet.scale_bar(
            camera.pixel, (width - 28 * sheet.unit, height - 26 * sheet.unit), " at the mirror"
        )
        self.name_detectors(sheet, camera)
        self.dimension_radii(sheet, camera)
        self.name_beam(sheet, camera)

    def name_detectors(self, sheet: DrawingSheet, camera: Camera) -> None:
        for k, letter in enumerate(DETECTORS):
            centre, axes = rig.detector_frame(self.rest, k)
            top = (
                centre
                + 30 * self.fit * axes[2]
                + 0.45 * rig.housing_size(self.rest, k)[1] * axes[1]
            )
            at = camera.project(top)[:2]
            sheet.write(at, letter.upper(), 19, self.theme.hues[k], bold=True)

    def dimension_radii(self, sheet: DrawingSheet, camera: Camera) -> None:
        """Draw each detector's distance from the axis, once if they are equal."""
        psds = self.sensor.psds
        equal = np.ptp([psd.radius for psd in psds]) < 1e-9
        for k in range(1 if equal else 3):
            centre = np.array(self.rest.geometry.centres[k], float)
            axis = np.array([0.0, 0.0, centre[2]])
            a, b = camera.project(axis)[:2], camera.project(centre)[:2]
            along = (b - a) / np.hypot(*(b - a))
            aside = np.array([along[1], -along[0]])
            aside = aside if aside[1] < 0 else -aside
            words = length_in_words(psds[k].radius)
            sheet.dimension(a, b, words, 30 * sheet.unit * aside, 15)

    def name_beam(self, sheet: DrawingSheet, camera: Camera) -> None:
        beam = self.sensor.beam
        x, y = beam.diameter_x, beam.diameter_y
        across = f"{x:.4g} mm" if x == y else f"{x:.4g} x {y:.4g} mm"
        origin, axes = rig.laser_frame(self.stand)
        at = camera.project(origin + 99 * self.fit * axes[2])[:2]
        words = f"\u2300 {across}, {power_in_words(beam.power)}"
        sheet.write(at, words, 14, self.theme.ink, anchor=(0.5, 1))


class CombinedView(RigView):
    """The rig with magnified insets: the apex, and the three detectors' faces."""

    area = (0.165, 0.03, 0.835, 0.93)

    def draw(self, picture: Floats, sheet: DrawingSheet, camera: Camera) -> None:
        shown_insets = [self.point_inset(), *(self.face_inset(k) for k in range(3))]
        targets = [camera.project(inset.target)[:2] for inset in shown_insets]
        corners = self.slots(sheet, [inset.camera.size for inset in shown_insets])
        self.place(picture, sheet, shown_insets, targets, corners)
        self.annotate(sheet, camera)
        self.caption(sheet, "three-facet-mirror sensor")

    def slots(self, sheet: DrawingSheet, sizes: Any) -> list[tuple[int, int]]:
        """Return corners of four places for insets, the first for the largest."""
        width, height = self.size
        edge = int(26 * sheet.unit)
        small = sizes[1]
        right = width - edge - small[0]
        return [
            (edge, edge),
            (right, edge),
            (edge, int(0.47 * height)),
            (right, int(0.40 * height)),
        ]

    def place(
        self,
        picture: Floats,
        sheet: DrawingSheet,
        shown_insets: list[Inset],
        targets: list[Floats],
        corners: Any,
    ) -> None:
        middles = [
            np.array(c, float) + np.array(shown_insets[1].camera.size) / 2 for c in corners[1:]
        ]
        order = insets.assign(targets[1:], middles)
        places = [corners[0], *(corners[1 + n] for n in order)]
        for inset, target, corner in zip(shown_insets, targets, places, strict=True):
            insets.leader(sheet, inset, target, corner, inset.camera.size)
        for inset, corner in zip(shown_insets, places, strict=True):
            shown = self.magnify(inset)
            insets.paste(picture, shown, corner, inset.round)
            insets.frame(sheet, inset, corner, inset.camera.size)

    def magnify(self, inset: Inset) -> Floats:
        """Render the picture in an inset: of the head alone, or of a detector's face."""
        if not inset.round:
            return expose_face(self.stand, inset.camera, "ABC".index(inset.title[-1]))
        self.studio.only("head")
        self.carry_head(1.0)
        shot = self.studio.take(inset.camera, self.sharpness)
        self.carry_head(self.turning)
        self.studio.only()
        return expose(self.stand, shot, self.theme, None, Lighting(self.laser, 0.8, bloom=0.4))

    def point_inset(self) -> Inset:
        side = int(0.27 * min(self.size[1], self.size[0] * 0.75)) // 2 * 2
        sigma = max(self.sensor.beam.diameter_x, self.sensor.beam.diameter_y) / 4
        apex = self.state[:3]
        camera = point_camera(apex - np.array([0, 0, 0.5 * sigma]), 17 * sigma, (side, side))
        note = f"{camera.extent if camera.parallel else camera.height:.3g} mm wide"
        return Inset("the point", apex, camera, self.theme.ink, True, note)

    def face_inset(self, k: int) -> Inset:
        side = int(0.19 * min(self.size[1], self.size[0] * 0.75)) // 2 * 2
        psd = self.sensor.psds[k]
        reading = readings(self.sensor, self.state)[3 * k + 2]
        size = f"{psd.size_y:g} x {psd.size_z:g} mm"
        note = f"{size}, {power_in_words(float(reading))}" if reading > 0 else f"{size}, no light"
        target = np.array(self.rest.geometry.centres[k], float)
        camera = face_camera(self.rest, k, (side, side))
        title = f"detector {DETECTORS[k].upper()}"
        return Inset(title, target, camera, self.theme.hues[k], False, note, cross=True)


def point_camera(focus: Floats, height: float, size: tuple[int, int]) -> Camera:
    """Place a camera close to the apex, on the side of facets A and C."""
    direction = normalize([0.62, -0.60, 0.50])
    distance = height / (2 * np.tan(0.15))
    return Camera(tuple(focus + distance * direction), tuple(focus), angle=0.30, size=size)


def face_camera(stand: Stand, k: int, size: tuple[int, int]) -> Camera:
    """Place a camera square to a detector's face, on the mirror's side."""
    centre, axes = rig.detector_frame(stand, k)
    psd = stand.sensor.psds[k]
    extent = 1.16 * max(psd.size_z, psd.size_y * size[1] / size[0])
    away = centre - 1.8 * rig.scale_of(stand) * axes[2]  # behind the window
    return Camera(tuple(away), tuple(centre), tuple(axes[1]), angle=0.0, extent=extent, size=size)


class MirrorView(SceneView):
    """The mirror's apex, close: how the facets share the beam, and the light on each."""

    def own_parts(self) -> list[RigPart]:
        return [part for part in super().own_parts() if part.assembly == "head"]

    def camera(self) -> Camera:
        sigma = max(self.sensor.beam.diameter_x, self.sensor.beam.diameter_y) / 4
        focus = self.state[:3] - np.array([0, 0, 0.4 * sigma])
        return point_camera(focus, 13 * sigma, self.size)

    def expose(self, camera: Camera, floor: bool = True, haze: float = 1.0) -> Floats:
        shot = self.studio.take(camera, self.sharpness)
        return expose(self.stand, shot, self.theme, None, Lighting(self.laser, 0.85, bloom=0.3))

    def draw(self, picture: Floats, sheet: DrawingSheet, camera: Camera) -> None:
        width, height = self.size
        sheet.scale_bar(
            camera.pixel, (width - 28 * sheet.unit, height - 26 * sheet.unit), " at the point"
        )
        self.caption(sheet, "the point of the mirror, and the light on its facets")
        reading = readings(self.sensor, self.state)
        for k, letter in enumerate(DETECTORS):
            self.outline(sheet, camera, k)
            self.name_sub_beam(sheet, camera, k, letter, float(reading[3 * k + 2]))
        self.name_width(sheet, camera)

    def outline(self, sheet: DrawingSheet, camera: Camera, k: int) -> None:
        """Draw the line where the light on facet k falls to 1/e^2 of its maximum."""
        cross = cut(self.stand, k)
        if not len(cross) or camera.axes[2] @ np.array(self.stand.at.normals[k], float) > 0:
            return
        rim = camera.project(array(self.stand.facet_points(k, cross[-1])))[:, :2]
        for n in range(0, len(rim) - 1, 2):
            sheet.line(rim[n : n + 2], self.theme.ink, 1.1, 0.8)

    def name_sub_beam(
        self, sheet: DrawingSheet, camera: Camera, k: int, letter: str, power: float
    ) -> None:
        centre = np.array(self.stand.geometry.centres[k], float)
        out = normalize(centre - self.state[:3])
        words = (
            f"{letter.upper()}  {power_in_words(power)}"
            if power > 0
            else f"{letter.upper()}  no light"
        )
        for reach in (0.30, 0.24, 0.36, 0.18, 0.42):
            at = camera.project(self.state[:3] + reach * camera.height * out)[:2]
            wide, high = sheet.measure(words, 17, True)
            at = at + np.array([0, -26 * sheet.unit])
            box = (at[0] - wide / 2, at[1] - high, at[0] + wide / 2, at[1] + high)
            if sheet.free(box):
                sheet.write(at, words, 17, self.theme.hues[k], bold=True)
                return

    def name_width(self, sheet: DrawingSheet, camera: Camera) -> None:
        """Label the beam's 1/e^2 diameter across it."""
        radius = self.sensor.beam.diameter_x / 2
        up = 0.30 * camera.height
        middle = np.array([self.state[6], self.state[7], self.state[2] + up])
        right = np.array([camera.axes[0][0], camera.axes[0][1], 0.0])
        right = right / np.hypot(*right[:2])
        a, b = (camera.project(middle + side * radius * right)[:2] for side in (-1, 1))
        words = f"\u2300 {length_in_words(self.sensor.beam.diameter_x)}"
        sheet.dimension(a, b, words, np.array([0.0, -16 * sheet.unit]), 15)


class DetectorView(SceneView):
    """A commercial detector A with the light on it."""

    number = 0

    def camera(self) -> Camera:
        centre, axes = rig.detector_frame(self.rest, self.number)
        high = rig.housing_size(self.rest, self.number)[1]
        direction = normalize(-0.80 * axes[2] - 0.52 * axes[0] + 0.30 * axes[1])
        focus = centre - 0.12 * high * axes[1]
        return Camera(tuple(focus + 6 * high * direction), tuple(focus), angle=0.34, size=self.size)

    def draw(self, picture: Floats, sheet: DrawingSheet, camera: Camera) -> None:
        width, height = self.size
        k = self.number
        sheet.scale_bar(
            camera.pixel, (width - 28 * sheet.unit, height - 26 * sheet.unit), " at the detector"
        )
        self.caption(sheet, f"detector {DETECTORS[k].upper()} and the light on it")
        psd = self.sensor.psds[k]
        centre, axes = rig.detector_frame(self.rest, k)
        reach = rig.housing_size(self.rest, k)
        corners = [
            centre + sy * psd.size_y / 2 * axes[0] + sz * psd.size_z / 2 * axes[1]
            for sy, sz in ((-1, 1), (1, 1), (1, -1))
        ]
        at = camera.project(np.array(corners))[:, :2]
        lift = (
            camera.project(centre + reach[1] * 0.68 * axes[1])[:2]
            - camera.project(centre + psd.size_z / 2 * axes[1])[:2]
        )
        sheet.dimension(at[0], at[1], length_in_words(psd.size_y), lift, 15)
        side = (
            camera.project(centre + reach[0] * 0.72 * axes[0])[:2]
            - camera.project(centre + psd.size_y / 2 * axes[0])[:2]
        )
        sheet.dimension(at[1], at[2], length_in_words(psd.size_z), side, 15)


class CutawayView(SceneView):
    """The rig cut along the beam and through detector A, square to the cut, with its dimensions."""

    number = 0

    def plane(self) -> tuple[Floats, Floats]:
        """Return a point of the cut, and the direction of the removed side."""
        centre = np.array(self.rest.geometry.centres[self.number], float)
        outward = normalize([centre[0], centre[1], 0.0])
        return np.zeros(3), np.cross(outward, (0, 0, 1.0))

    def build(self) -> None:
        point, normal = self.plane()
        self.dark = tuple(k for k in range(3) if k != self.number)
        self.parts, faces = cut_parts(library(), self.own_parts(), point, normal)
        self.studio = Studio(self.parts, self.theme)
        for n, face in enumerate(faces):
            self.studio.add_flat(face, self.theme.cut(face.material), f"{face.assembly} cut {n}")
        self.floor = None

    def own_parts(self) -> list[RigPart]:
        """List the cut parts, and the mirror in one piece, so that it is closed."""
        name = f"detector {DETECTORS[self.number]}"
        plain = ("hub", "moving stage", "collar")
        kept = [
            part for part in super().own_parts()
            if part.assembly in ("head", "laser", name) or part.name in plain
        ]  # fmt: skip
        mirror = [part for part in kept if part.name.startswith("facet ")]
        body = next(part for part in kept if part.name == "mirror body")
        whole = replace(body, solid=join([body.solid, *(part.solid for part in mirror)]))
        rest = [part for part in kept if part not in mirror and part is not body]
        plates = [part for part in super().own_parts() if part.name == "plate"]
        return [whole, plates[self.number], plates[3], *rest]

    def camera(self) -> Camera:
        if not hasattr(self, "_camera"):
            _, normal = self.plane()
            start = Camera(tuple(600 * normal), (0, 0, 0), angle=0.0, extent=300.0, size=self.size)
            self._camera = fit(start, bounds(self.parts), (0.07, 0.07, 0.93, 0.84))
        return self._camera

    def expose(self, camera: Camera, floor: bool = True, haze: float = 1.0) -> Floats:
        return super().expose(camera, floor=False, haze=haze)

    def draw(self, picture: Floats, sheet: DrawingSheet, camera: Camera) -> None:
        width, height = self.size
        letter = DETECTORS[self.number].upper()
        shown_insets = [self.head_inset(), self.detector_inset()]
        targets = [camera.project(inset.target)[:2] for inset in shown_insets]
        side = shown_insets[0].camera.size[0]
        top = int(30 * sheet.unit)
        left = int(0.39 * width)
        corners = [(left, top), (left + side + int(40 * sheet.unit), top)]
        for inset, target, corner in zip(shown_insets, targets, corners, strict=True):
            shown = self.expose(inset.camera, haze=0.5)
            insets.paste(picture, shown, corner, inset.round)
            title = insets.frame(sheet, inset, corner, inset.camera.size)
            insets.leader(sheet, inset, target, corner, inset.camera.size, title)
        self.dimensions(sheet, camera)
        sheet.scale_bar(camera.pixel, (width - 28 * sheet.unit, height - 26 * sheet.unit))
        self.caption(sheet, f"cut along the beam and through detector {letter}")

    def dimensions(self, sheet: DrawingSheet, camera: Camera) -> None:
        centre = np.array(self.rest.geometry.centres[self.number], float)
        foot = np.array([0, 0, rig.floor_of(self.rest) - 12 * self.fit])
        low = camera.project(foot)[:2]
        end = camera.project([centre[0], centre[1], foot[2]])[:2]
        words = length_in_words(self.sensor.psds[self.number].radius)
        sheet.dimension(low, end, words, np.array([0, 34.0]) * sheet.unit, 16)
        origin, _ = rig.laser_frame(self.rest)
        a, b = camera.project(np.zeros(3))[:2], camera.project(origin)[:2]
        aside = np.array([34.0, 0]) * sheet.unit
        sheet.dimension(a, b, length_in_words(round(float(origin[2]), 3)), aside, 14)

    def head_inset(self) -> Inset:
        side = int(0.36 * min(self.size[1], self.size[0] * 0.75)) // 2 * 2
        _, normal = self.plane()
        radius = rig.head_radius(self.rest)
        focus = np.array([0, 0, -0.55 * radius])
        camera = Camera(tuple(focus + 200 * normal), tuple(focus), angle=0.0,
                        extent=3.1 * radius, size=(side, side))  # fmt: skip
        return Inset(
            "mirror head", focus, camera, self.theme.ink, True, f"{camera.extent:.3g} mm wide"
        )

    def detector_inset(self) -> Inset:
        side = int(0.36 * min(self.size[1], self.size[0] * 0.75)) // 2 * 2
        k = self.number
        centre, axes = rig.detector_frame(self.rest, k)
        _, normal = self.plane()
        high = rig.housing_size(self.rest, k)[1]
        focus = centre + 6 * self.fit * axes[2]
        camera = Camera(tuple(focus + 200 * normal), tuple(focus), angle=0.0,
                        extent=1.45 * high, size=(side, side))  # fmt: skip
        title = f"detector {DETECTORS[k].upper()}"
        return Inset(title, focus, camera, self.theme.hues[k], True, f"{camera.extent:.3g} mm wide")
