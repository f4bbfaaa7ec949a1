"""The rig as parts: mirror head, detectors, laser, and their supports.

The optics fixes the facets' planes, the detectors' faces and the beam, which are where the model
has them. Everything else is commonly used hardware: a one-inch mirror, half-inch posts, a detector
on a board in a housing; it shrinks if the rig is too small for it. mm, world frame.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ...core.names import DETECTORS
from ...core.units import Floats
from .camera import normalize
from .scene import Stand
from .solids import (
    Solid,
    cylinder,
    frame,
    hollow_cylinder,
    join,
    rectangle,
    revolve,
    ring_at_height,
    rod,
    slab,
    stack,
    tube,
)

#: A rig whose nearest detector is nearer than this has smaller parts, mm.
FULL_SIZE_RADIUS_MM = 110.0
#: Radius of a one-inch mirror, and of a half-inch post, mm.
HEAD_RADIUS_MM, POST_RADIUS_MM = 12.7, 6.35
#: Height above the apex at which the beam leaves the laser, mm.
LASER_HEIGHT_MM = 105.0


@dataclass(frozen=True)
class RigPart:
    """A piece of the rig.

    assembly: "head", "laser", "detector a", ..., "frame".  material: a name in `materials`.
    """

    name: str
    assembly: str
    material: str
    solid: Solid


def scale_of(stand: Stand) -> float:
    """Return the factor by which common parts shrink to fit."""
    return min(1.0, min(psd.radius for psd in stand.sensor.psds) / FULL_SIZE_RADIUS_MM)


def floor_of(stand: Stand) -> float:
    """Return z of the base plate's upper side."""
    fit = scale_of(stand)
    lowest = min(
        float(centre[2]) - housing_size(stand, k)[1] / 2
        for k, centre in enumerate(stand.geometry.centres)
    )
    return min(lowest - 22 * fit, -70 * fit)


def parts(stand: Stand) -> list[RigPart]:
    """List the parts of the whole rig at a state."""
    every = [*head(stand), *laser(stand), *base(stand)]
    for k in range(3):
        every += detector(stand, k)
    return every


# --- the mirror ----------------------------------------------------------------------------------


def head_radius(stand: Stand) -> float:
    return min(HEAD_RADIUS_MM * scale_of(stand), stand.sensor.apertures.rim)


def slopes(stand: Stand, angle: Floats) -> Floats:
    """The fall of the mirror's surface per mm from its axis in directions (n,); mirror frame."""
    normals = np.array(stand.geometry.normals)
    across = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    falls: Floats = (across @ normals[:, :2].T / normals[:, 2]).max(axis=1)
    return falls


def edge_angles(stand: Stand) -> Floats:
    """The directions of the edges ca, ab, bc, ascending from the first; rad."""
    normals = stand.geometry.normals
    angles = []
    for k in range(3):
        first, second = np.array(normals[k - 1]), np.array(normals[k])
        down = np.cross(second, first)
        angles.append(np.arctan2(down[1], down[0]))
    return np.unwrap(np.array([*angles, angles[0]]))


def head(stand: Stand) -> Iterator[RigPart]:
    """Yield the mirror with its facets, ground sides and a bevelled rim, its mount and its post."""
    fit, radius = scale_of(stand), head_radius(stand)
    turn: Floats = np.array(stand.at.turn, float).T  # rows: the mirror's axes in the world
    apex = np.array(stand.at.apex)

    def put(name: str, material: str, solid: Solid) -> RigPart:
        return RigPart(name, "head", material, solid.move(apex, turn))

    bevel = 0.03 * radius
    rim = radius - bevel
    angles = edge_angles(stand)
    for k, letter in enumerate(DETECTORS):
        angle = np.linspace(angles[k], angles[k + 1], 33)
        yield put(f"facet {letter}", "mirror", Solid(*facet(stand, angle, rim)))
    around = np.concatenate([np.linspace(angles[k], angles[k + 1], 33)[:-1] for k in range(3)])
    circle = np.stack([np.cos(around), np.sin(around)], axis=-1)
    falls = slopes(stand, around)
    bottom = -radius * float(falls.max()) - 0.45 * radius
    rings = [
        ring_at_height(rim * circle, bottom),
        ring_at_height(radius * circle, bottom + bevel),
        np.column_stack([radius * circle, -radius * falls - bevel]),
        np.column_stack([rim * circle, -rim * falls]),
    ]
    yield put("mirror body", "steel", stack(rings, closed=False))
    cup = radius + 1.8 * fit
    low = bottom - 6 * fit
    seat, wall = bottom + 4 * fit, radius + 0.05 * fit
    yield put("mount", "anodised", revolve([
        (cup - 0.6 * fit, low), (cup, low + 0.6 * fit), (cup, seat - 0.6 * fit),
        (cup - 0.6 * fit, seat), (wall, seat), (wall, bottom - 0.02 * fit),
    ]))  # fmt: skip
    screw = rod((cup - 1.2 * fit, 0, bottom), (cup + 2.2 * fit, 0, bottom), 1.6 * fit)
    yield put("clamping screw", "brass", screw)
    foot = floor_of(stand) + 16 * fit
    yield put("post", "steel", cylinder(POST_RADIUS_MM * fit, foot, low, 0.4 * fit))
    block = slab(rectangle(52 * fit, 52 * fit, 5 * fit), floor_of(stand), foot + 2 * fit, 0.8 * fit)
    yield RigPart("moving stage", "frame", "anodised", block)


def facet(stand: Stand, angle: Floats, rim: float) -> tuple[Floats, list[list[int]]]:
    """Return the flat side of the mirror between two edges; mirror frame."""
    circle = rim * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    outer = np.column_stack([circle, -rim * slopes(stand, angle)])
    points = np.concatenate([np.zeros((1, 3)), outer])
    return points, [list(range(len(points)))]


# --- a detector ----------------------------------------------------------------------------------


def housing_size(stand: Stand, k: int) -> tuple[float, float]:
    psd, fit = stand.sensor.psds[k], scale_of(stand)
    return psd.size_y + 15 * fit, psd.size_z + 15 * fit


def detector_frame(stand: Stand, k: int) -> tuple[Floats, Floats]:
    """Return the middle of a detector's face, and axes for parts: sideways, upward, out of its
    back.

    They are right-handed: y, z and x of the detector.
    """
    axes = np.array(stand.geometry.axes[k])
    return np.array(stand.geometry.centres[k]), axes[[1, 2, 0]]


def detector(stand: Stand, k: int) -> Iterator[RigPart]:
    """Yield a commercial detector: window, housing, chip in its carrier, pins, board; on a post."""
    fit, psd = scale_of(stand), stand.sensor.psds[k]
    centre, axes = detector_frame(stand, k)
    name = f"detector {DETECTORS[k]}"
    wide, high = housing_size(stand, k)
    width, height = psd.size_y, psd.size_z

    def put(what: str, material: str, solid: Solid) -> RigPart:
        return RigPart(f"{what} {DETECTORS[k]}", name, material, solid.move(centre, axes))

    def box(w: float, h: float, low: float, top: float, corner: float, bevel: float) -> Solid:
        return slab(rectangle(w, h, corner * fit), low * fit, top * fit, bevel * fit)

    outer, hole = (
        rectangle(wide, high, 2.5 * fit),
        rectangle(width + 2.4 * fit, height + 2.4 * fit, fit),
    )
    yield put("bezel", "anodised", frame(outer, hole, -5 * fit, -0.4 * fit))
    yield put("window", "glass", box(width + 4 * fit, height + 4 * fit, -3.4, -2.4, 0.5, 0))
    yield put("sensitive area", "silicon", slab(rectangle(width, height), 0, 0.4 * fit))
    rim = frame(rectangle(width + 1.2 * fit, height + 1.2 * fit, 0.2 * fit),
                rectangle(width, height, 0.01 * fit), -0.05 * fit, 0.4 * fit)  # fmt: skip
    yield put("bond ring", "gold", rim)
    yield put("carrier", "ceramic", box(width + 7 * fit, height + 7 * fit, 0.4, 2.4, 0.8, 0.2))
    back = frame(outer, rectangle(width + 8 * fit, height + 8 * fit, fit), -0.4 * fit, 9 * fit)
    yield put("housing", "anodised", back)
    pins = [
        cylinder(0.45 * fit, 2.4 * fit, 17 * fit).move((x, y, 0), np.eye(3))
        for x in np.linspace(-0.36, 0.36, 5) * (width + 4 * fit)
        for y in (-0.4 * (height + 4 * fit), 0.4 * (height + 4 * fit))
    ]
    yield put("pins", "gold", join(pins))
    yield put("board", "board", box(wide + 5 * fit, high + 5 * fit, 10.5, 12.1, 1.5, 0))
    plug = slab(rectangle(0.4 * wide, 0.26 * high, 0.4 * fit), 12.1 * fit, 19 * fit, 0.4 * fit)
    chips = [
        slab(rectangle(0.2 * wide, 0.14 * high), 12.1 * fit, 13.4 * fit).move(
            (x * wide, y * high, 0), np.eye(3)
        )
        for x, y in ((-0.28, 0.3), (0.28, 0.3), (-0.28, -0.3), (0.28, -0.3))
    ]  # fmt: skip
    yield put("amplifiers", "plastic", join([plug, *chips]))
    yield from stand_of(stand, k, name, fit)


def stand_of(stand: Stand, k: int, name: str, fit: float) -> Iterator[RigPart]:
    """Yield a detector's support: post, holder and foot."""
    centre, axes = detector_frame(stand, k)
    outward = normalize([axes[2][0], axes[2][1], 0.0])
    below = centre + 4 * fit * axes[2] - housing_size(stand, k)[1] / 2 * axes[1]
    floor = floor_of(stand)
    at = np.array([below[0], below[1], 0.0])
    middle = floor + max(0.55 * (below[2] - floor), 8 * fit)
    letter = DETECTORS[k]
    top = float(below[2]) + 1.0 * fit
    aside = np.cross((0, 0, 1.0), outward)
    level = np.array([outward, aside, (0, 0, 1.0)])
    rod = cylinder(POST_RADIUS_MM * fit, middle - 2 * fit, top)
    yield RigPart(f"post {letter}", name, "steel", rod.move(at, np.eye(3)))
    holder = revolve([(9.5 * fit, floor), (9.5 * fit, middle - 0.8 * fit), (8.7 * fit, middle)])
    yield RigPart(f"post holder {letter}", name, "anodised", holder.move(at, np.eye(3)))
    foot = slab(rectangle(50 * fit, 30 * fit, 4 * fit), floor, floor + 6 * fit, 0.7 * fit)
    yield RigPart(f"foot {letter}", name, "anodised", foot.move(at, level))
    heads = [
        cylinder(3.4 * fit, floor + 6 * fit, floor + 9 * fit, 0.4 * fit).move(
            at + side * 18 * fit * outward, np.eye(3)
        )
        for side in (-1, 1)
    ]
    yield RigPart(f"screws {letter}", name, "steel", join(heads))


# --- the laser and its support -------------------------------------------------------------------


def laser_frame(stand: Stand) -> tuple[Floats, Floats]:
    """Return where the beam leaves the laser, and axes for its parts: the last against the beam."""
    back = -np.array(stand.geometry.direction)
    up = LASER_HEIGHT_MM * scale_of(stand)
    origin = np.array(stand.at.place) + up / back[2] * back
    aside = normalize(np.cross(np.array([0, 1.0, 0]), back))
    return origin, np.array([aside, np.cross(back, aside), back])


def column_direction(stand: Stand) -> Floats:
    """Return the column's direction: the middle of the widest gap between two detectors."""
    angles = np.sort([np.arctan2(c[1], c[0]) for c in map(np.array, stand.geometry.centres)])
    gaps = np.diff([*angles, angles[0] + 2 * np.pi])
    widest = np.isclose(gaps, gaps.max(), rtol=0, atol=0.02)
    middles = angles[widest] + gaps[widest] / 2
    best = middles[np.argmin(np.cos(middles - np.radians(125)) * -1)]  # to the back, if it may be
    return np.array([np.cos(best), np.sin(best), 0.0])


def laser(stand: Stand) -> Iterator[RigPart]:
    fit = scale_of(stand)
    origin, axes = laser_frame(stand)

    def put(name: str, material: str, solid: Solid) -> RigPart:
        return RigPart(name, "laser", material, solid.move(origin, axes))

    s = fit
    yield put("collimator", "brass", tube([
        (4.6 * s, 0), (7.6 * s, 0), (8 * s, 0.4 * s), (8 * s, 11 * s), (7.4 * s, 11.6 * s),
        (5.4 * s, 11.6 * s), (5.4 * s, 5 * s), (4.6 * s, 5 * s),
    ]))  # fmt: skip
    lens = revolve([(0.1 * s, 5.1 * s), (3 * s, 5.3 * s), (5.3 * s, 6.4 * s), (5.3 * s, 7.4 * s),
                   (3 * s, 8.6 * s), (0.1 * s, 8.9 * s)])  # fmt: skip
    yield put("collimating lens", "glass", lens)
    diode = join([cylinder(4.5 * s, 19.6 * s, 21 * s), cylinder(2.8 * s, 16 * s, 19.6 * s)])
    yield put("laser diode", "gold", diode)
    driver = slab(rectangle(14 * s, 1.6 * s), 30 * s, 52 * s)
    yield put("driver board", "board", driver)
    yield put("heat sink", "aluminium", hollow_cylinder(9.2 * s, 3 * s, 21 * s, 29 * s, 0.4 * s))
    yield put("laser housing", "anodised", tube([
        (9.3 * s, 11.6 * s), (10.4 * s, 11.6 * s), (11 * s, 12.2 * s), (11 * s, 62 * s),
        (10.4 * s, 62.6 * s), (10 * s, 64 * s), (11 * s, 64 * s), (11 * s, 66 * s),
        (10 * s, 66 * s),
        (10 * s, 68 * s), (11 * s, 68 * s), (11 * s, 70 * s), (10 * s, 70 * s), (10 * s, 72 * s),
        (11 * s, 72 * s), (11 * s, 77.4 * s), (10.2 * s, 78.2 * s), (4 * s, 78.2 * s),
        (3.4 * s, 90 * s), (2.6 * s, 92 * s), (1.4 * s, 92 * s), (1.4 * s, 74 * s),
        (9.3 * s, 74 * s),
    ]))  # fmt: skip
    yield from gantry(stand, origin, fit)


def gantry(stand: Stand, origin: Floats, fit: float) -> Iterator[RigPart]:
    """Yield a column beside the beam and an arm that clamps the laser."""
    outward = column_direction(stand)
    far = 96 * fit
    foot = np.array([far * outward[0], far * outward[1], 0.0])
    floor, top = floor_of(stand), float(origin[2]) + 62 * fit
    yield RigPart(
        "column",
        "laser",
        "steel",
        cylinder(9 * fit, floor, top, 0.8 * fit).move(foot, np.eye(3)),
    )
    collar = revolve(
        [(14 * fit, floor), (14 * fit, floor + 13 * fit), (13 * fit, floor + 14 * fit)]
    )
    yield RigPart("collar", "frame", "anodised", collar.move(foot, np.eye(3)))
    aside = np.cross((0, 0, 1.0), outward)
    level = np.array([outward, aside, (0, 0, 1.0)])
    at = np.array([origin[0], origin[1], float(origin[2]) + 36 * fit])
    reach = float((foot - at) @ outward)
    bar = slab(rectangle(reach - 22 * fit, 17 * fit, 1 * fit), -7.9 * fit, 7.9 * fit, 0.8 * fit)
    yield RigPart(
        "arm", "laser", "aluminium", bar.move(at + outward * (reach + 1 * fit) / 2, level)
    )
    ring = hollow_cylinder(15.8 * fit, 11 * fit, -8 * fit, 8 * fit, 0.8 * fit)
    yield RigPart("laser clamp", "laser", "aluminium", ring.move(at, np.eye(3)))
    grip = hollow_cylinder(13.8 * fit, 9 * fit, -9 * fit, 9 * fit, 0.8 * fit)
    yield RigPart(
        "column clamp", "laser", "aluminium", grip.move([foot[0], foot[1], at[2]], np.eye(3))
    )


def base(stand: Stand) -> Iterator[RigPart]:
    """Yield a plate with an arm to each detector and one to the column."""
    fit, floor = scale_of(stand), floor_of(stand)
    low = floor - 12 * fit
    yield RigPart("hub", "frame", "plate", cylinder(60 * fit, low, floor, 1.2 * fit))
    ends = [np.array(c)[:2] for c in stand.geometry.centres]
    lengths = [float(np.hypot(*end)) + 36 * fit for end in ends]
    ends.append(column_direction(stand)[:2] * 96 * fit)
    lengths.append(96 * fit + 24 * fit)
    holes = []
    for end, length in zip(ends, lengths, strict=True):
        outward = np.array([*(end / np.hypot(*end)), 0.0])
        level = np.array([outward, np.cross((0, 0, 1.0), outward), (0, 0, 1.0)])
        arm = slab(rectangle(length, 44 * fit, 9 * fit), low, floor, 1.2 * fit)
        yield RigPart("plate", "frame", "plate", arm.move(outward * length / 2, level))
        for along in np.arange(75 * fit, length - 60 * fit, 25 * fit):
            for side in (-12.5 * fit, 12.5 * fit):
                place = along * outward + side * level[1]
                holes.append(cylinder(3 * fit, floor, floor + 0.06 * fit).move(place, np.eye(3)))
    if holes:
        yield RigPart("tapped holes", "frame", "hole", join(holes))


def ground_of(stand: Stand) -> float:
    """Return z of the surface under the rig."""
    return floor_of(stand) - 14 * scale_of(stand)
