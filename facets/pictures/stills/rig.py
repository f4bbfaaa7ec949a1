"""The rig as parts: mirror head, detectors, laser, and their supports.

The facets' planes, the detectors' faces and the beam are those of the model. Everything else is
common hardware: a one-inch mirror, half-inch posts, a detector on a board in a housing. It is
smaller if the rig is too small for it. World frame; lengths in mm, those of the parts in
`RigModel.unit`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ...core.names import DETECTORS
from ...core.sensor import Sensor
from ...core.units import Floats
from .camera import normalize
from .scene import PosedSensor
from .solids import (
    PartFrame,
    RigPart,
    Solid,
    cylinder,
    hollow_cylinder,
    profile_of,
    rectangle,
    revolve,
    ring_at_height,
    slab,
    stack,
    window_frame,
)

#: Distance of the nearest detector below which the parts are smaller, mm.
FULL_SIZE_RADIUS_MM = 110.0
#: Radii of a one-inch mirror and of a half-inch post; unit.
HEAD_RADIUS, POST_RADIUS = 12.7, 6.35
#: Height of the laser's exit above the apex, and distance of its column from the axis; unit.
LASER_HEIGHT, COLUMN_DISTANCE = 105.0, 96.0
#: Points along the rim of a facet.
RIM_POINTS = 33


class RigModel:
    """A rig at rest.

    unit: length of a part that is 1 mm long in a rig of full size, mm.  floor: z of the upper side
    of the base plate, unit.  head_radius: radius of the mirror, unit.
    """

    def __init__(self, sensor: Sensor) -> None:
        self.sensor, self.posed = sensor, PosedSensor.from_state(sensor, np.zeros(8))
        self.unit = min(1.0, min(psd.radius for psd in sensor.psds) / FULL_SIZE_RADIUS_MM)
        self.centres = np.array(self.posed.geometry.centres, float)
        lowest = min(self.centres[k, 2] / self.unit - self.housing(k)[1] / 2 for k in range(3))
        self.floor = min(float(lowest) - 22, -70)
        self.head_radius = min(HEAD_RADIUS, sensor.apertures.rim / self.unit)

    def face(self, k: int) -> tuple[float, float]:
        """Return the width and height of a detector's face, unit."""
        psd = self.sensor.psds[k]
        return psd.size_y / self.unit, psd.size_z / self.unit

    def housing(self, k: int) -> tuple[float, float]:
        width, height = self.face(k)
        return width + 15, height + 15

    def detector_frame(self, k: int) -> PartFrame:
        """Return the frame of a detector's face: axes sideways, upward and out of its back."""
        axes = np.array(self.posed.geometry.axes[k], float)[[1, 2, 0]]
        return PartFrame(f"detector {DETECTORS[k]}", self.unit, self.centres[k], axes)

    def laser_frame(self) -> PartFrame:
        """Return the frame where the beam leaves the laser, with z against the beam."""
        back = -np.array(self.posed.geometry.direction)
        origin = np.array(self.posed.at.place) + LASER_HEIGHT * self.unit / back[2] * back
        aside = normalize(np.cross(np.array([0, 1.0, 0]), back))
        return PartFrame("laser", self.unit, origin, np.array([aside, np.cross(back, aside), back]))

    def level_frame(self, assembly: str, place: Floats, outward: Floats) -> PartFrame:
        """Return a frame with origin (x, y, 0), whose first axis is the level part of `outward`."""
        out = normalize([*outward[:2], 0.0])
        axes = np.array([out, np.cross((0, 0, 1.0), out), (0, 0, 1.0)])
        return PartFrame(assembly, self.unit, np.array([*place[:2], 0.0]), axes)

    def column_direction(self) -> Floats:
        """Return the column's direction: the middle of the widest gap between two detectors."""
        angles = np.sort(np.arctan2(self.centres[:, 1], self.centres[:, 0]))
        gaps = np.diff([*angles, angles[0] + 2 * np.pi])
        widest = np.isclose(gaps, gaps.max(), rtol=0, atol=0.02)
        middles = angles[widest] + gaps[widest] / 2
        angle = middles[np.argmax(np.cos(middles - np.radians(125)))]  # the rearmost one
        return np.array([np.cos(angle), np.sin(angle)])

    def parts(self) -> list[RigPart]:
        """List all parts."""
        detectors = (part for k in range(3) for part in (*self.detector(k), *self.support(k)))
        return [*self.head(), *self.laser(), *self.gantry(), *self.base(), *detectors]

    def head(self) -> Iterator[RigPart]:
        """Yield the mirror with its facets, ground sides and bevelled rim, its mount and post."""
        frame, radius = PartFrame("head", self.unit), self.head_radius
        bevel = 0.03 * radius
        normals = np.array(self.posed.geometry.normals, float)
        down = np.cross(normals, np.roll(normals, 1, axis=0))
        edges = np.unwrap(np.arctan2(down[[0, 1, 2, 0], 1], down[[0, 1, 2, 0], 0]))
        turns = [np.linspace(edges[k], edges[k + 1], RIM_POINTS) for k in range(3)]
        circles = [np.stack([np.cos(turn), np.sin(turn)], axis=-1) for turn in turns]
        falls = [(c @ normals[:, :2].T / normals[:, 2]).max(axis=1) for c in circles]
        rims = [np.column_stack([c, -fall]) for c, fall in zip(circles, falls, strict=True)]
        for rim, letter in zip(rims, DETECTORS, strict=True):
            points = np.concatenate([np.zeros((1, 3)), (radius - bevel) * rim])
            facet = Solid(points, [list(range(RIM_POINTS + 1))])
            yield frame.part(f"facet {letter}", "mirror", facet)
        rim = np.concatenate([part[:-1] for part in rims])
        bottom = radius * (float(rim[:, 2].min()) - 0.45)
        yield frame.part("mirror body", "steel", stack([
            ring_at_height((radius - bevel) * rim[:, :2], bottom),
            ring_at_height(radius * rim[:, :2], bottom + bevel),
            radius * rim - [0, 0, bevel],
            (radius - bevel) * rim,
        ], closed=False))  # fmt: skip
        cup, low, foot = radius + 1.8, bottom - 6, self.floor + 16
        yield frame.part("mount", "anodised", revolve([
            *profile_of(cup, low, bottom + 4, 0.6),
            (radius + 0.05, bottom + 4), (radius + 0.05, bottom - 0.02),
        ]))  # fmt: skip
        across = PartFrame("head", self.unit, axes=((0, 1, 0), (0, 0, 1), (1, 0, 0)))
        screw = cylinder(1.6, cup - 1.2, cup + 2.2).move(0, bottom, 0)
        yield across.part("clamping screw", "brass", screw)
        yield frame.part("post", "steel", cylinder(POST_RADIUS, foot, low, 0.4))
        block = slab(rectangle(52, 52, 5), self.floor, foot + 2, 0.8)
        yield PartFrame("frame", self.unit).part("moving stage", "anodised", block)

    def detector(self, k: int) -> Iterator[RigPart]:
        """Yield a detector: window, housing, chip in its carrier, pins and board."""
        frame, letter = self.detector_frame(k), DETECTORS[k]
        (width, height), (wide, high) = self.face(k), self.housing(k)

        def outline(more: float, corner: float) -> Floats:
            """Return the outline of the face, enlarged by a length."""
            return rectangle(width + more, height + more, corner)

        outer = rectangle(wide, high, 2.5)
        pins = [
            cylinder(0.45, 2.4, 17).move(x, y, 0)
            for x in np.linspace(-0.36, 0.36, 5) * (width + 4)
            for y in (-0.4 * (height + 4), 0.4 * (height + 4))
        ]
        plug = slab(rectangle(0.4 * wide, 0.26 * high, 0.4), 12.1, 19, 0.4)
        chips = [
            slab(rectangle(0.2 * wide, 0.14 * high), 12.1, 13.4).move(x * wide, y * high, 0)
            for x in (-0.28, 0.28)
            for y in (-0.3, 0.3)
        ]
        table: list[tuple[str, str, list[Solid]]] = [
            ("bezel", "anodised", [window_frame(outer, outline(2.4, 1), -5, -0.4)]),
            ("window", "glass", [slab(outline(4, 0.5), -3.4, -2.4)]),
            ("sensitive area", "silicon", [slab(outline(0, 0), 0, 0.4)]),
            ("bond ring", "gold", [window_frame(outline(1.2, 0.2), outline(0, 0.01), -0.05, 0.4)]),
            ("carrier", "ceramic", [slab(outline(7, 0.8), 0.4, 2.4, 0.2)]),
            ("housing", "anodised", [window_frame(outer, outline(8, 1), -0.4, 9)]),
            ("pins", "gold", pins),
            ("board", "board", [slab(rectangle(wide + 5, high + 5, 1.5), 10.5, 12.1)]),
            ("amplifiers", "plastic", [plug, *chips]),
        ]
        for name, material, solids in table:
            yield frame.part(f"{name} {letter}", material, *solids)

    def faces(self) -> Iterator[RigPart]:
        """Yield the detectors' faces for pictures from the front: silicon, ring and carrier."""
        for k, letter in enumerate(DETECTORS):
            frame, (width, height) = self.detector_frame(k), self.face(k)
            frame, side = replace(frame, assembly=f"face {letter}"), 1.2 * max(width, height)
            for name, low, outline in (
                ("silicon", 0.0, (width, height)),
                ("ring", 0.05, (1.06 * width, 1.06 * height)),
                ("carrier", 0.1, (side, side)),
            ):
                plate = slab(rectangle(*outline), low, low + 0.04)
                yield frame.part(f"{name} {letter}", f"face {name}", plate)

    def support(self, k: int) -> Iterator[RigPart]:
        """Yield a detector's post, holder and foot."""
        face, letter, floor = self.detector_frame(k), DETECTORS[k], self.floor
        below = face.origin + self.unit * (4 * face.axes[2] - self.housing(k)[1] / 2 * face.axes[1])
        frame = self.level_frame(face.assembly, below, face.axes[2])
        end = float(below[2]) / self.unit
        middle = floor + max(0.55 * (end - floor), 8)
        holder = revolve([(9.5, floor), (9.5, middle - 0.8), (8.7, middle)])
        screw = cylinder(3.4, floor + 6, floor + 9, 0.4)
        foot = slab(rectangle(50, 30, 4), floor, floor + 6, 0.7)
        post = cylinder(POST_RADIUS, middle - 2, end + 1)
        yield frame.part(f"post {letter}", "steel", post)
        yield frame.part(f"post holder {letter}", "anodised", holder)
        yield frame.part(f"foot {letter}", "anodised", foot)
        yield frame.part(f"screws {letter}", "steel", screw.move(-18, 0, 0), screw.move(18, 0, 0))

    def laser(self) -> Iterator[RigPart]:
        frame = self.laser_frame()
        yield frame.part("collimator", "brass", revolve([
            (4.6, 0), (7.6, 0), (8, 0.4), (8, 11), (7.4, 11.6), (5.4, 11.6), (5.4, 5), (4.6, 5),
        ], bore=True))  # fmt: skip
        yield frame.part("collimating lens", "glass", revolve([
            (0.1, 5.1), (3, 5.3), (5.3, 6.4), (5.3, 7.4), (3, 8.6), (0.1, 8.9),
        ]))  # fmt: skip
        diode = (cylinder(4.5, 19.6, 21), cylinder(2.8, 16, 19.6))
        yield frame.part("laser diode", "gold", *diode)
        yield frame.part("driver board", "board", slab(rectangle(14, 1.6), 30, 52))
        yield frame.part("heat sink", "aluminium", hollow_cylinder(9.2, 3, 21, 29, 0.4))
        yield frame.part("laser housing", "anodised", revolve([
            (9.3, 11.6), (10.4, 11.6), (11, 12.2), (11, 62), (10.4, 62.6), (10, 64), (11, 64),
            (11, 66), (10, 66), (10, 68), (11, 68), (11, 70), (10, 70), (10, 72), (11, 72),
            (11, 77.4), (10.2, 78.2), (4, 78.2), (3.4, 90), (2.6, 92), (1.4, 92), (1.4, 74),
            (9.3, 74),
        ], bore=True))  # fmt: skip

    def gantry(self) -> Iterator[RigPart]:
        """Yield a column next to the beam and an arm that clamps the laser."""
        outward, laser = self.column_direction(), self.laser_frame().origin
        foot = COLUMN_DISTANCE * self.unit * outward
        floor, level = self.floor, float(laser[2]) / self.unit + 36
        frame = self.level_frame("laser", foot, outward)
        yield frame.part("column", "steel", cylinder(9, floor, level + 26, 0.8))
        grip = hollow_cylinder(13.8, 9, -9, 9, 0.8).move(0, 0, level)
        yield frame.part("column clamp", "aluminium", grip)
        collar = revolve([(14, floor), (14, floor + 13), (13, floor + 14)])
        yield self.level_frame("frame", foot, outward).part("collar", "anodised", collar)
        reach = float((foot - laser[:2]) @ outward) / self.unit
        frame = self.level_frame("laser", laser, outward)
        bar = slab(rectangle(reach - 22, 17, 1), level - 7.9, level + 7.9, 0.8)
        yield frame.part("arm", "aluminium", bar.move((reach + 1) / 2, 0, 0))
        ring = hollow_cylinder(15.8, 11, level - 8, level + 8, 0.8)
        yield frame.part("laser clamp", "aluminium", ring)

    def base(self) -> Iterator[RigPart]:
        """Yield a plate with an arm to each detector and one to the column."""
        low, floor = self.floor - 12, self.floor
        yield PartFrame("frame", self.unit).part("hub", "plate", cylinder(60, low, floor, 1.2))
        arms = [(c, float(np.hypot(*c[:2])) / self.unit + 36) for c in self.centres]
        for end, length in [*arms, (self.column_direction(), COLUMN_DISTANCE + 24)]:
            frame = self.level_frame("frame", np.zeros(2), end)
            arm = slab(rectangle(length, 44, 9), low, floor, 1.2)
            yield frame.part("plate", "plate", arm.move(length / 2, 0, 0))
            hole = cylinder(3, floor, floor + 0.06)
            holes = [
                hole.move(along, side, 0)
                for along in np.arange(75, length - 60, 25)
                for side in (-12.5, 12.5)
            ]
            if holes:
                yield frame.part("tapped holes", "hole", *holes)
