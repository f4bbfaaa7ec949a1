"""The views of the sensor as data: parts and camera, and labels and insets for a state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...core.names import DETECTORS
from ...core.rules import Rules
from ...core.units import MICRO, MRAD, UM, UW, Floats
from ...model.arrays import readings
from .camera import Camera, fit, normalize
from .exposure import Exposure, Ghost
from .materials import THEMES, Material, Theme, rgb
from .range_solid import COLOURS, REASONS, range_solid
from .rig import RigModel
from .scene import PosedSensor, array, cut
from .sheet import Dimension, Inset, Label, Polyline, Words, length_in_words, round_down, unit_of
from .solids import RigPart, Solid, join
from .studio import cut_parts

#: Directions towards the camera for the rig, the apex of the mirror, and the head.
RIG_VIEW, POINT_VIEW, HEAD_VIEW = (0.56, -0.66, 0.46), (0.62, -0.60, 0.50), (0.59, -0.74, 0.32)
#: Largest shift or angle that a caption omits, mm or rad.
NEGLIGIBLE = 1e-9
#: Exposure of the head alone.
HEAD_LOOK = Exposure(("head",), 0.8, 0.4, floor=False)


def state_in_words(state: Floats) -> str:
    """Format a state: "x 80 µm, yaw 10 mrad"; "at rest" for zero."""
    names = ("x", "y", "z", "roll", "pitch", "yaw", "beam x", "beam y")
    words = []
    for n, (name, value) in enumerate(zip(names, state, strict=True)):
        if abs(value) < NEGLIGIBLE:
            continue
        if 3 <= n < 6:
            words.append(f"{name} {MRAD * value:.4g} mrad")
        elif abs(value) < 0.9995:
            words.append(f"{name} {UM * value:.4g} {MICRO}m")
        else:
            words.append(f"{name} {value:.4g} mm")
    return "   ".join(words) or "at rest"


def power_in_words(power: float) -> str:
    if not power > 0:
        return "no light"
    return f"{power:.3g} mW" if power >= 1 else f"{UW * power:.3g} {MICRO}W"


def factor_in_words(factor: float, turning: float = 1.0) -> str:
    """State a magnification: "motion drawn 20 times larger"; nothing for 1."""
    words = [f"motion drawn {factor:g} times larger"] if factor != 1 else []
    if turning != 1:
        words.append(f"the head's turning {factor * turning:g} times")
    return ", ".join(words)


class SceneView:
    """Base of the views.

    what, note: subject of the picture and a remark, for the caption.  look: exposure of the main
    picture.  scale: words of the scale bar, if there is one.  width: fraction of the sheet's width
    that the main picture takes.  has_state: whether the caption states the state.  legend: colours
    and their meanings.  extra: parts that only insets and ghosts show.
    """

    what, note, legend_title = "the rig", "", ""
    look = Exposure()
    scale: str | None = " at the mirror"
    width = 1.0
    has_state = True
    legend: Sequence[tuple[str, str]] = ()

    def __init__(self, rig: RigModel, theme: Theme, size: tuple[int, int]) -> None:
        self.rig, self.sensor, self.theme, self.size = rig, rig.sensor, theme, size
        self.extra: list[RigPart] = []
        self.parts = self.choose_parts()
        self.move(np.zeros(8))
        self.camera = self.place_camera()

    def choose_parts(self) -> list[RigPart]:
        return self.rig.parts()

    def place_camera(self) -> Camera:
        raise NotImplementedError

    def move(self, state: Floats) -> None:
        self.state, self.posed = state, PosedSensor.from_state(self.sensor, state)

    def labels(self) -> list[Label]:
        return []

    def insets(self) -> list[Inset]:
        return []

    def points(self) -> Floats:
        """Return all points of the parts, (n, 3)."""
        return np.concatenate([part.solid.points for part in self.parts])

    def powers(self) -> list[float]:
        return [float(power) for power in readings(self.sensor, self.state)[2::3]]

    def side(self, fraction: float) -> int:
        """Return the side of an inset in pixels, as a fraction of the picture."""
        return int(fraction * min(self.size[1], self.size[0] * 0.75))

    def apex_camera(self, sigmas: float, below: float, size: tuple[int, int]) -> Camera:
        """Place a camera close to the apex, on the side of facets A and C.

        sigmas: height of its picture, standard deviations of the beam.  below: depth of its focus
        below the apex in the same unit.
        """
        sigma = max(self.sensor.beam.diameter_x, self.sensor.beam.diameter_y) / 4
        focus = self.state[:3] - np.array([0, 0, below * sigma])
        return Camera(focus, POINT_VIEW, sigmas * sigma, size, angle=0.30)

    def face_inset(self, k: int, side: int, note: str, **options: Any) -> Inset:
        """Make an inset of a detector's face, from the front."""
        frame, psd = self.rig.detector_frame(k), self.sensor.psds[k]
        camera = Camera(
            frame.origin, -frame.axes[2], 1.16 * max(psd.size_z, psd.size_y), (side, side),
            upward=frame.axes[1],
        )  # fmt: skip
        look = Exposure((f"face {DETECTORS[k]}",), 0.0, 3.0, floor=False, glows=True)
        words = f"{psd.size_y:g} x {psd.size_z:g} mm, {note}"
        title = f"detector {DETECTORS[k].upper()}"
        return Inset(title, words, camera, look, self.theme.hues[k], **options)


class RigView(SceneView):
    """The rig with its dimensions."""

    area = (0.05, 0.05, 0.95, 0.88)

    def place_camera(self) -> Camera:
        """Place the camera so that the rig at rest fills the picture."""
        start = Camera((0, 0, 0), RIG_VIEW, 230.0, self.size, angle=0.38)
        return fit(start, self.points(), self.area)

    def labels(self) -> list[Label]:
        """Return the detectors' names, their distances from the axis, and the beam's data."""
        return [*self.detector_names(), *self.radii(), self.beam_name()]

    def detector_names(self) -> list[Label]:
        names: list[Label] = []
        for k, letter in enumerate(DETECTORS):
            frame, high = self.rig.detector_frame(k), self.rig.housing(k)[1]
            behind = [30 * frame.axes[2] + up * high * frame.axes[1] for up in (0.45, 0.9)]
            places = frame.origin + self.rig.unit * np.array(behind)
            names.append(Words(places, letter.upper(), 19, self.theme.hues[k], is_bold=True))
        return names

    def radii(self) -> list[Dimension]:
        """Return each detector's distance from the axis, once if they are equal."""
        radii = [psd.radius for psd in self.sensor.psds]
        return [
            Dimension([centre * [0, 0, 1], centre], length_in_words(radius), 30)
            for centre, radius in zip(self.rig.centres, radii, strict=True)
        ][: 1 if np.ptp(radii) < 1e-9 else 3]

    def beam_name(self) -> Label:
        beam, frame = self.sensor.beam, self.rig.laser_frame()
        x, y = beam.diameter_x, beam.diameter_y
        across = f"{x:.4g} mm" if x == y else f"{x:.4g} x {y:.4g} mm"
        top = frame.origin + 99 * self.rig.unit * frame.axes[2] + [*self.state[6:], 0]
        return Words(top[None], f"\u2300 {across}, {power_in_words(beam.power)}", 14, up=8)


class CombinedView(RigView):
    """The rig with insets of the apex and of the three detectors' faces."""

    what = "three-facet-mirror sensor"
    area = (0.165, 0.03, 0.835, 0.93)

    def choose_parts(self) -> list[RigPart]:
        self.extra = list(self.rig.faces())
        return super().choose_parts()

    def insets(self) -> list[Inset]:
        from scipy.optimize import linear_sum_assignment

        (width, height), edge = self.size, int(26 * unit_of(self.size))
        side, small = self.side(0.27), self.side(0.19)
        right = width - edge - small
        slots = np.array([(right, edge), (edge, int(0.47 * height)), (right, int(0.40 * height))])
        targets = self.camera.project(self.rig.centres)[:, None, :2]
        # lines of the smallest total length do not cross
        order = linear_sum_assignment(np.hypot(*(targets - slots - small / 2).transpose(2, 0, 1)))
        camera = self.apex_camera(17, 0.5, (side, side))
        faces = [
            self.face_inset(k, small, power_in_words(power), corner=tuple(slots[n]), target=centre)
            for k, n, power, centre in zip(*order, self.powers(), self.rig.centres, strict=True)
        ]
        note = f"{camera.height:.3g} mm wide"
        apex = Inset("the point", note, camera, HEAD_LOOK, self.theme.ink, (edge, edge),
                     self.state[:3], is_round=True)  # fmt: skip
        return [apex, *faces]


class MirrorView(SceneView):
    """The apex of the mirror with the light on each facet."""

    what = "the point of the mirror, and the light on its facets"
    look = replace(HEAD_LOOK, haze=0.85, bloom=0.3)
    scale = " at the point"

    def choose_parts(self) -> list[RigPart]:
        return list(self.rig.head())

    def place_camera(self) -> Camera:
        return self.apex_camera(13, 0.4, self.size)

    def move(self, state: Floats) -> None:
        super().move(state)
        self.camera = self.place_camera()

    def labels(self) -> list[Label]:
        """Return the sub-beams' names and powers, the outlines, and the beam's diameter."""
        labels: list[Label] = [self.width_across()]
        for k, (letter, power) in enumerate(zip(DETECTORS, self.powers(), strict=True)):
            out = normalize(self.rig.centres[k] - self.state[:3])
            reaches = np.array([0.30, 0.24, 0.36, 0.18, 0.42])[:, None] * self.camera.height
            words = f"{letter.upper()}  {power_in_words(power)}"
            places = self.state[:3] + reaches * out
            labels += [*self.outline(k), Words(places, words, 17, self.theme.hues[k], True, 26)]
        return labels

    def outline(self, k: int) -> list[Label]:
        """Return the line on facet k where the irradiance is 1/e^2 of its maximum."""
        cross, normal = cut(self.posed, k), np.array(self.posed.at.normals[k], float)
        if not len(cross) or self.camera.axes[2] @ normal > 0:
            return []
        rim = array(self.posed.facet_points(k, cross[-1]))
        return [Polyline(rim, self.theme.ink, 1.1, (0, (5, 4)))]

    def width_across(self) -> Label:
        diameter = self.sensor.beam.diameter_x
        up = self.state[2] + 0.30 * self.camera.height
        right = normalize(self.camera.axes[0] * [1, 1, 0])
        middle = np.array([self.state[6], self.state[7], up])
        ends = [middle + side * diameter / 2 * right for side in (-1, 1)]
        return Dimension(ends, f"\u2300 {length_in_words(diameter)}", 16)


class DetectorView(SceneView):
    """Detector A with the light on it."""

    what, scale = "detector A and the light on it", " at the detector"

    def place_camera(self) -> Camera:
        frame, high = self.rig.detector_frame(0), self.rig.unit * self.rig.housing(0)[1]
        direction = np.array([-0.52, 0.30, -0.80]) @ frame.axes
        focus = frame.origin - 0.12 * high * frame.axes[1]
        return Camera(focus, direction, 2.06 * high, self.size, angle=0.34)

    def labels(self) -> list[Label]:
        frame, (wide, high) = self.rig.detector_frame(0), self.rig.housing(0)
        psd = self.sensor.psds[0]
        halves = np.array([(-1, 1), (1, 1), (1, -1)]) / 2
        side, corner, low = frame.origin + halves * [psd.size_y, psd.size_z] @ frame.axes[:2]
        per_unit = self.rig.unit / self.camera.pixel / unit_of(self.size)
        sideways, upward = normalize(frame.axes[:2] @ self.camera.axes[:2].T) * [1, -1]
        across, up = (
            (fraction * size - face / 2) * per_unit
            for fraction, size, face in zip(
                (0.72, 0.68), (wide, high), self.rig.face(0), strict=True
            )
        )
        return [
            Dimension([side, corner], length_in_words(psd.size_y), up, upward),
            Dimension([corner, low], length_in_words(psd.size_z), across, sideways),
        ]


class CutawayView(SceneView):
    """The rig cut along the beam and through detector A, with its dimensions."""

    what, scale = "cut along the beam and through detector A", ""
    look = Exposure(hidden=(1, 2), floor=False)

    def normal(self) -> Floats:
        """Return the direction towards the removed side."""
        x, y, _ = self.rig.centres[0]
        return normalize([y, -x, 0.0])

    def choose_parts(self) -> list[RigPart]:
        """List the cut parts; the mirror is joined to one piece, so that its surface is closed."""
        rig, (a, b, c, body, *mount) = self.rig, list(self.rig.head())
        mirror = replace(body, solid=join([part.solid for part in (body, a, b, c)]))
        hub, *arms = (part for part in rig.base() if part.name != "tapped holes")
        parts = [mirror, *mount, *rig.laser(), *rig.gantry(), hub, arms[0], arms[3],
                 *rig.detector(0), *rig.support(0)]  # fmt: skip
        return cut_parts(parts, self.normal())

    def square(self, focus: Any, height: float, size: tuple[int, int]) -> Camera:
        """Place a camera square to the cut."""
        return Camera(focus, self.normal(), height, size)

    def place_camera(self) -> Camera:
        camera = self.square((0, 0, 0), 300.0, self.size)
        return fit(camera, self.points(), (0.07, 0.07, 0.93, 0.84))

    def insets(self) -> list[Inset]:
        unit, frame, side = unit_of(self.size), self.rig.detector_frame(0), self.side(0.36)
        radius, high = self.rig.head_radius * self.rig.unit, self.rig.unit * self.rig.housing(0)[1]
        inner = frame.origin + 6 * self.rig.unit * frame.axes[2]
        look = replace(self.look, haze=0.5)
        start, top = int(0.39 * self.size[0]), int(30 * unit)
        insets = []
        for title, focus, height, hue, corner in (
            ("mirror head", np.array([0, 0, -0.55 * radius]), 3.1 * radius, self.theme.ink, start),
            ("detector A", inner, 1.45 * high, self.theme.hues[0], start + side + int(40 * unit)),
        ):
            camera, note = self.square(focus, height, (side, side)), f"{height:.3g} mm wide"
            insets.append(
                Inset(title, note, camera, look, hue, (corner, top), focus, is_round=True)
            )
        return insets

    def labels(self) -> list[Label]:
        """Return the detector's distance from the axis, and the laser's from the apex."""
        laser = self.rig.laser_frame().origin
        foot = np.array([0, 0, (self.rig.floor - 12) * self.rig.unit])
        ends = [foot, foot + self.rig.centres[0] * [1, 1, 0]]
        height = round(float(laser[2]), 3)
        return [
            Dimension(ends, length_in_words(self.sensor.psds[0].radius), 34, (0, 1), 16),
            Dimension([np.zeros(3), laser], length_in_words(height), 34, (1, 0), 14),
        ]


class HeadView(SceneView):
    """Base of the views of the mirror head on its stage."""

    area = (0.26, 0.10, 0.74, 0.86)

    def choose_parts(self) -> list[RigPart]:
        return [*self.rig.head(), next(iter(self.rig.base()))]

    def drawn_points(self) -> Floats:
        """Return points (n, 3) that the picture must contain."""
        raise NotImplementedError

    def place_camera(self) -> Camera:
        start = Camera((0, 0, 0), HEAD_VIEW, 70.0, self.size, angle=0.34)
        return fit(start, self.drawn_points(), self.area)


class RangeView(HeadView):
    """The range of the mirror's position as a translucent solid about its apex."""

    scale, legend_title = None, "The range ends where"
    look = Exposure(haze=0.8, ghosts=(Ghost(("range",), np.zeros(8), 0.58, 0.22),))

    def __init__(self, *arguments: Any, rules: Rules) -> None:
        self.rules = rules
        super().__init__(*arguments)

    def choose_parts(self) -> list[RigPart]:
        """List the head; the sides of the range are extra parts, enlarged until visible."""
        from matplotlib.colors import to_hex

        solid = range_solid(self.sensor, self.rules)
        half, visible = np.abs(solid.extent).max(axis=0), 13.0 * self.rig.unit
        level, up = (visible_factor(visible / float(size)) for size in (half[:2].max(), half[2]))
        factors = np.array([level, level, up])
        self.extent, self.ends = np.ptp(solid.extent, axis=0), factors * solid.extent
        across, along = (f"drawn {f:g} times larger" if f != 1 else "to scale" for f in (level, up))
        self.note = across if across == along else f"x and y {across}, z {along}"
        following = ", the beam following" if self.rules.tracking else ""
        self.what = f"range of the mirror's position{following}"
        causes = np.unique(solid.causes)
        self.legend = [(COLOURS[n], REASONS[n]) for n in causes]
        # colours are linear in physically based shading
        hues = [to_hex(tuple(rgb(colour) ** 2.2)) for colour in COLOURS]
        self.extra = [
            RigPart(REASONS[n], "range", Material(hues[n], 0.0, 1.0),
                    Solid(factors * solid.points, solid.faces[solid.causes == n].tolist()))
            for n in causes
        ]  # fmt: skip
        return super().choose_parts()

    def drawn_points(self) -> Floats:
        return np.concatenate([self.extra[0].solid.points, [[0, 0, -30.0 * self.rig.unit]]])

    def labels(self) -> list[Label]:
        """Return the range of each axis, on the outside of the solid."""
        (x0, y0, z0), (x1, y1, z1) = self.ends
        sides = (
            ([(x0, y0, z0), (x1, y0, z0)], (0.0, 1.0)),
            ([(x1, y0, z0), (x1, y1, z0)], (0.0, 1.0)),
            ([(x0, y0, z0), (x0, y0, z1)], (-1.0, 0.0)),
        )
        return [
            Dimension(ends, f"{name}  {length_in_words(float(f'{size:.4g}'))}", 26, towards, 16)
            for name, size, (ends, towards) in zip("xyz", self.extent, sides, strict=True)
        ]


def visible_factor(ratio: float) -> float:
    """Return 1 if a body is visible to scale, else the round factor that makes it so.

    ratio: size of a well visible body over that of the body.
    """
    return 1.0 if 0.4 < ratio < 4 else round_down(ratio)


class TrailView(HeadView):
    """The path of the mirror's apex in a motion, and the spots' paths on the detectors."""

    what, scale, width = "the path of the mirror's point", " of the mirror", 0.645
    area = (0.08, 0.10, 0.66, 0.84)
    has_state = False

    def __init__(self, *arguments: Any, motion: Floats) -> None:
        self.motion = motion[:: max(1, len(motion) // 600)]
        super().__init__(*arguments)

    def choose_parts(self) -> list[RigPart]:
        """List the head, with ghosts at the lowest and the highest point of its path."""
        reach = float(np.abs(self.motion[:, :3]).max())
        factor = max(1.0, round_down(16.0 * self.rig.unit / reach)) if reach > 0 else 1.0
        self.path, self.note = factor * self.motion[:, :3], factor_in_words(factor)
        states = np.hstack([self.path, self.motion[:, 3:]])
        ends = self.path[:, 2].argmin(), self.path[:, 2].argmax()
        ghosts = [Ghost(("head",), states[n], 0.13, 0.13) for n in ends]
        self.look = Exposure(haze=0.8, ghosts=ghosts)
        self.extra = list(self.rig.faces())
        return super().choose_parts()

    def drawn_points(self) -> Floats:
        rim = np.array([[1, 0, -1], [-1, 0, -1], [0, 1, -1], [0, -1, -1], [0, 0, -2.4]])
        return np.concatenate([self.path, self.rig.head_radius * self.rig.unit * rim])

    def move(self, state: Floats) -> None:
        """Stay at rest, since a motion has many states."""
        super().move(np.zeros(8))

    def labels(self) -> list[Label]:
        """Return the path, whose colour changes with time, and its start."""
        hues = np.linspace(rgb("#FFD166"), rgb("#EF476F"), len(self.path) - 1)
        return [Polyline(self.path, hues, 2.6), Words(self.path[:1], "\u25cf", 15, "#FFD166")]

    def insets(self) -> list[Inset]:
        """Return the detectors' faces with the spots' paths, true to scale."""
        height, side = self.size[1], int(0.235 * self.size[1])
        start = self.size[0] - side - int(30 * unit_of(self.size))
        reading, insets = readings(self.sensor, self.motion), []
        for k in range(3):
            frame = self.rig.detector_frame(k)
            spots = frame.origin + reading[:, 3 * k : 3 * k + 2] @ frame.axes[:2]
            path = Polyline(spots, THEMES["dark"].hues[k], 1.6)
            corner = (start, int((0.04 + k * 0.315) * height))
            insets.append(self.face_inset(k, side, "to scale", corner=corner, labels=[path]))
        return insets
