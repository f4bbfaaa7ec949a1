"""The views of the sensor as data: parts, camera, and for a state labels and insets."""

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
from .sheet import Dimension, Inset, Label, Polyline, Words, length_in_words, unit_of
from .solids import RigPart, Solid, join
from .studio import cut_parts

#: Directions to the camera: of the whole rig, of the mirror's point, and of the head.
RIG_VIEW, POINT_VIEW, HEAD_VIEW = (0.56, -0.66, 0.46), (0.62, -0.60, 0.50), (0.59, -0.74, 0.32)
#: Shift or angle that is not written, mm or rad.
NEGLIGIBLE = 1e-9
#: What looks at the head and at a detector's face show.
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


def round_down(factor: float) -> float:
    """The largest of 1, 2, 3, 5, 10, ... (or 0.5, 0.3, ...) that is not larger."""
    power = 10.0 ** np.floor(np.log10(factor) + 1e-12)
    largest = max(n * power for n in (1, 2, 3, 5) if n * power <= factor * (1 + 1e-12))
    return float(f"{largest:.3g}")


def factor_in_words(factor: float, turning: float = 1.0) -> str:
    """The magnification in words: "motion drawn 20 times larger", or nothing for 1."""
    words = [f"motion drawn {factor:g} times larger"] if factor != 1 else []
    if turning != 1:
        words.append(f"the head's turning {factor * turning:g} times")
    return ", ".join(words)


class SceneView:
    """Base of the views.

    what: the subject, for the caption; note: what else it says.  look: of the picture.  scale:
    words of the scale bar, if any.  width: of the main picture, as a share.  legend: colours and
    their meanings, below its title.
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

    def side(self, share: float) -> int:
        """Return the even side of an inset in pixels, as a share of the picture."""
        return int(share * min(self.size[1], self.size[0] * 0.75)) // 2 * 2

    def point_camera(self, sigmas: float, below: float, size: tuple[int, int]) -> Camera:
        """Place a camera close to the apex, on the side of facets A and C."""
        sigma = max(self.sensor.beam.diameter_x, self.sensor.beam.diameter_y) / 4
        focus = self.state[:3] - np.array([0, 0, below * sigma])
        return Camera(focus, POINT_VIEW, sigmas * sigma, size, angle=0.30)

    def face_inset(self, k: int, side: int, note: str, **more: Any) -> Inset:
        """Make an inset of a detector's face, seen from between its window and its silicon."""
        frame, psd = self.rig.detector_frame(k), self.sensor.psds[k]
        camera = Camera(
            frame.origin, -frame.axes[2], 1.16 * max(psd.size_z, psd.size_y), (side, side),
            upward=frame.axes[1],
        )  # fmt: skip
        look = Exposure((f"face {DETECTORS[k]}",), 0.0, 3.0, floor=False, glows=True)
        words = f"{psd.size_y:g} x {psd.size_z:g} mm, {note}"
        title = f"detector {DETECTORS[k].upper()}"
        return Inset(title, words, camera, look, self.theme.hues[k], **more)


class RigView(SceneView):
    """The whole rig, with its dimensions."""

    area = (0.05, 0.05, 0.95, 0.88)

    def place_camera(self) -> Camera:
        """Place the camera so that all of the rig at rest is in the picture."""
        start = Camera((0, 0, 0), RIG_VIEW, 230.0, self.size, angle=0.38)
        return fit(start, self.points(), self.area)

    def labels(self) -> list[Label]:
        """Return the detectors' names, their distances from the axis, and the beam."""
        return [*self.detector_names(), *self.radii(), self.beam_name()]

    def detector_names(self) -> list[Label]:
        names: list[Label] = []
        for k, letter in enumerate(DETECTORS):
            frame, high = self.rig.detector_frame(k), self.rig.housing(k)[1]
            tops = [30 * frame.axes[2] + share * high * frame.axes[1] for share in (0.45, 0.9)]
            places = frame.origin + self.rig.unit * np.array(tops)
            names.append(Words(places, letter.upper(), 19, self.theme.hues[k], bold=True))
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
    """The rig with magnified insets: the apex, and the three detectors' faces."""

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
        # the pairing with the shortest lines, of which none cross then
        order = linear_sum_assignment(np.hypot(*(targets - slots - small / 2).transpose(2, 0, 1)))
        camera = self.point_camera(17, 0.5, (side, side))
        faces = [
            self.face_inset(k, small, power_in_words(power), corner=tuple(slots[n]), target=centre)
            for k, n, power, centre in zip(*order, self.powers(), self.rig.centres, strict=True)
        ]
        note = f"{camera.height:.3g} mm wide"
        point = Inset("the point", note, camera, HEAD_LOOK, self.theme.ink, (edge, edge),
                      self.state[:3], round=True)  # fmt: skip
        return [point, *faces]


class MirrorView(SceneView):
    """The mirror's apex, close: how the facets share the beam, and the light on each."""

    what = "the point of the mirror, and the light on its facets"
    look = replace(HEAD_LOOK, haze=0.85, bloom=0.3)
    scale = " at the point"

    def choose_parts(self) -> list[RigPart]:
        return list(self.rig.head())

    def place_camera(self) -> Camera:
        return self.point_camera(13, 0.4, self.size)

    def move(self, state: Floats) -> None:
        super().move(state)
        self.camera = self.place_camera()

    def labels(self) -> list[Label]:
        """Return names of the sub-beams with powers, outlines, and the beam's diameter."""
        labels: list[Label] = [self.width_across()]
        for k, (letter, power) in enumerate(zip(DETECTORS, self.powers(), strict=True)):
            out = normalize(self.rig.centres[k] - self.state[:3])
            reaches = np.array([0.30, 0.24, 0.36, 0.18, 0.42])[:, None] * self.camera.height
            words = f"{letter.upper()}  {power_in_words(power)}"
            places = self.state[:3] + reaches * out
            labels += [*self.outline(k), Words(places, words, 17, self.theme.hues[k], True, 26)]
        return labels

    def outline(self, k: int) -> list[Label]:
        """Return the line where the light on facet k falls to 1/e^2 of its maximum."""
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
    """A commercial detector A with the light on it."""

    what, scale = "detector A and the light on it", " at the detector"

    def place_camera(self) -> Camera:
        frame, high = self.rig.detector_frame(0), self.rig.unit * self.rig.housing(0)[1]
        direction = np.array([-0.52, 0.30, -0.80]) @ frame.axes
        focus = frame.origin - 0.12 * high * frame.axes[1]
        return Camera(focus, direction, 2.06 * high, self.size, angle=0.34)

    def labels(self) -> list[Label]:
        frame, (wide, high) = self.rig.detector_frame(0), self.rig.housing(0)
        psd = self.sensor.psds[0]
        shares = np.array([(-1, 1), (1, 1), (1, -1)]) / 2
        left, corner, low = frame.origin + shares * [psd.size_y, psd.size_z] @ frame.axes[:2]
        per_unit = self.rig.unit / self.camera.pixel / unit_of(self.size)
        sideways, upward = normalize(frame.axes[:2] @ self.camera.axes[:2].T) * [1, -1]
        across, up = (
            (share * size - face / 2) * per_unit
            for share, size, face in zip((0.72, 0.68), (wide, high), self.rig.face(0), strict=True)
        )
        return [
            Dimension([left, corner], length_in_words(psd.size_y), up, upward),
            Dimension([corner, low], length_in_words(psd.size_z), across, sideways),
        ]


class CutawayView(SceneView):
    """The rig cut along the beam and through detector A, square to the cut, with its dimensions."""

    what, scale = "cut along the beam and through detector A", ""
    look = Exposure(hidden=(1, 2), floor=False)

    def normal(self) -> Floats:
        """Return the direction of the removed side."""
        x, y, _ = self.rig.centres[0]
        return normalize([y, -x, 0.0])

    def choose_parts(self) -> list[RigPart]:
        """List the cut parts, and the mirror in one piece, so that it is closed."""
        rig = self.rig
        *facets, body, mount = list(rig.head())[:5]
        whole = replace(body, solid=join([body.solid, *(facet.solid for facet in facets)]))
        base = list(rig.base())
        plates = [part for part in base if part.name == "plate"]
        kept = [whole, mount, *list(rig.head())[5:], *rig.laser(), *rig.gantry(), base[0],
                plates[0], plates[3], *rig.detector(0), *rig.support(0)]  # fmt: skip
        return cut_parts(kept, self.normal())

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
        left, top = int(0.39 * self.size[0]), int(30 * unit)
        insets = []
        for title, focus, height, hue, corner in (
            ("mirror head", np.array([0, 0, -0.55 * radius]), 3.1 * radius, self.theme.ink, left),
            ("detector A", inner, 1.45 * high, self.theme.hues[0], left + side + int(40 * unit)),
        ):
            camera, note = self.square(focus, height, (side, side)), f"{height:.3g} mm wide"
            insets.append(Inset(title, note, camera, look, hue, (corner, top), focus, round=True))
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
    """Base of the views of the mirror head alone, on its stage."""

    area = (0.26, 0.10, 0.74, 0.86)

    def choose_parts(self) -> list[RigPart]:
        return [*self.rig.head(), next(iter(self.rig.base()))]

    def drawn_points(self) -> Floats:
        """Return points (n, 3) that must be in the picture."""
        raise NotImplementedError

    def place_camera(self) -> Camera:
        start = Camera((0, 0, 0), HEAD_VIEW, 70.0, self.size, angle=0.34)
        return fit(start, self.drawn_points(), self.area)


class RangeView(HeadView):
    """The range of the mirror's place as a translucent solid about its apex."""

    scale, legend_title = None, "The range ends where"
    look = Exposure(haze=0.8, ghosts=(Ghost(("range",), np.zeros(8), 0.58, 0.22),))

    def __init__(self, *arguments: Any, rules: Rules) -> None:
        self.rules = rules
        super().__init__(*arguments)

    def choose_parts(self) -> list[RigPart]:
        """List the head, and aside the sides of the range, enlarged until they are visible."""
        from matplotlib.colors import to_hex

        solid = range_solid(self.sensor, self.rules)
        half, wanted = np.abs(solid.extent).max(axis=0), 13.0 * self.rig.unit
        aside, up = (visible_factor(wanted / float(size)) for size in (half[:2].max(), half[2]))
        factors = np.array([aside, aside, up])
        self.extent, self.ends = np.ptp(solid.extent, axis=0), factors * solid.extent
        across, along = (f"drawn {f:g} times larger" if f != 1 else "to scale" for f in (aside, up))
        self.note = across if across == along else f"x and y {across}, z {along}"
        following = ", the beam following" if self.rules.tracking else ""
        self.what = f"range of the mirror's place{following}"
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
        (left, front, low), (right, back, high) = self.ends
        sides = (
            ([(left, front, low), (right, front, low)], (0.0, 1.0)),
            ([(right, front, low), (right, back, low)], (0.0, 1.0)),
            ([(left, front, low), (left, front, high)], (-1.0, 0.0)),
        )
        return [
            Dimension(ends, f"{name}  {length_in_words(float(f'{size:.4g}'))}", 26, towards, 16)
            for name, size, (ends, towards) in zip("xyz", self.extent, sides, strict=True)
        ]


def visible_factor(ratio: float) -> float:
    """Return 1 if what is drawn is visible at its own size, else a round factor."""
    return 1.0 if 0.4 < ratio < 4 else round_down(ratio)


class TrailView(HeadView):
    """The path of the mirror's apex in a motion, and the spots' paths on the detectors."""

    what, scale, width = "the way of the mirror's point", " of the mirror", 0.645
    area = (0.08, 0.10, 0.66, 0.84)
    has_state = False

    def __init__(self, *arguments: Any, motion: Floats) -> None:
        self.motion = motion[:: max(1, len(motion) // 600)]
        super().__init__(*arguments)

    def choose_parts(self) -> list[RigPart]:
        """List the head, with ghosts where its path is lowest and highest."""
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
        """Stay at rest, since a motion has no single state."""
        super().move(np.zeros(8))

    def labels(self) -> list[Label]:
        """Return the path, in colours that change with time, and its start."""
        first, last = rgb("#FFD166"), rgb("#EF476F")
        shares = np.linspace(0, 1, len(self.path) - 1)[:, None]
        start = Words(self.path[:1], "\u25cf", 15, "#FFD166")
        return [Polyline(self.path, first + shares * (last - first), 2.6), start]

    def insets(self) -> list[Inset]:
        """Return the detectors' faces with the spots' paths, true to scale."""
        height, side = self.size[1], int(0.235 * self.size[1]) // 2 * 2
        left = self.size[0] - side - int(30 * unit_of(self.size))
        reading, insets = readings(self.sensor, self.motion), []
        for k in range(3):
            frame = self.rig.detector_frame(k)
            spots = frame.origin + reading[:, 3 * k : 3 * k + 2] @ frame.axes[:2]
            path = Polyline(spots, THEMES["dark"].hues[k], 1.6)
            corner = (left, int((0.04 + k * 0.315) * height))
            insets.append(self.face_inset(k, side, "to scale", corner=corner, labels=[path]))
        return insets
