"""A box of poses that contains every pose in the measurement range, by intervals.

A pose keeps the rules of the range, whatever the beam's place, only if each of the three spots has
a point on its detector and each facet its least share of the light. Seen from the apex that point
is not far: the apex itself if the whole footprint has to be on the detector and the apex lies
within the beam's 1/e^2 ellipse, else the centroid or a point of the footprint, whose distances the
least share bounds. So six coordinates of rays near the apex lie in known intervals H, and with G
for them, over a box T x R of poses about x = (t, r),

    pose in T x R,  G(pose) in H   =>   pose in  x + C (H - G(x)) + (1 - C G'(t, R)) (T x R - x)

for any matrix C, since G is linear in the apex: from (t, r) to (t, r'), then to (t', r'). Boxes are
cut until that leaves nothing of them, or only a part within the target box or slightly beyond; the
result is the hull of these parts. If that takes too many boxes there is no result.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from flint import arb, arb_mat

from ..characterization.state_box import StateBox, box_of_poses
from ..core.rules import Rules
from ..core.sensor import Sensor
from ..core.units import Floats
from ..optics.forward import Geometry
from ..optics.rays import reflect
from ..optics.vectors import cross, dot, rotation_axes, subtract
from ..scalars.intervals import Interval, ends, hull, interval, magnitude
from .interval_matrix import middles
from .light_sharing import LightNotShared, SharingBounds, facet_edges, farthest_offset
from .pieces import cut_in_two
from .spot_jacobian import (
    NotFacing,
    dark_scene_over,
    interval_geometry,
    intervals_between,
    spot_jacobian,
    spot_places,
)

#: Limits of the poses that are searched, mm and rad: past any range that a sensor of this kind can
#: have. The float 0.3 is less than 0.3, so that the stated limits are rounded down.
FARTHEST_MM_RAD = (30.0, 30.0, 30.0, 0.3 + 1e-12, 0.3 + 1e-12, 0.5)
#: The target box is larger by this factor than the box for a straight sensor.
TARGET_FACTOR = 1.06
#: A box is not cut further if it lies within the target box times this factor.
NEAR_FACTOR = 1.25
#: Largest number of boxes, and the share of its width above which a contracted box is cut.
MOST_BOXES, KEPT_SHARE = 10_000, 0.8
#: The beam's 1/e^2 ellipse, in sigmas.
ELLIPSE_SIGMAS = 2.0
#: Levers with which a box is cut in its angles alone.
ANGLE_LEVERS = np.array([0.0, 0.0, 0.0, 1.0, 1.0, 1.0])


class RangeCover(NamedTuple):
    """low, high (6,) of a box that contains every pose within `farthest` (6,) that keeps the rules.

    share: the least of the light on a facet.  halves: (3, 2) half the detectors' sizes, mm.
    whole: whether the whole footprint must be on the detector.  work: number of boxes examined.
    """

    low: Floats
    high: Floats
    farthest: tuple[float, ...]
    share: float
    halves: tuple[tuple[float, float], ...]
    whole: bool
    work: int


class RangeProblem(NamedTuple):
    """The problem of covering a range.

    geometry: the sensor in intervals.  halves: half the sizes of A, B, C along y and z, mm.  share:
    least share of the light on a facet.  whole: whether the whole footprint must be on the
    detector.  levers: (6,) the approximate displacement of a spot by each axis.
    """

    geometry: Geometry
    halves: tuple[tuple[float, float], ...]
    share: float
    whole: bool
    levers: Floats


class NoPose(Exception):
    """No pose of a box keeps the rules."""


def cover_range(
    sensor: Sensor,
    rules: Rules,
    share: float,
    tolerances: Sequence[float] | None = None,
    work: int = MOST_BOXES,
) -> RangeCover | None:
    """Find a box of all poses that keep the rules, for any place of the beam, or None.

    share: the least of the light, by the rules.  tolerances: as for `certify`.
    """
    halves = tuple((psd.size_y / 2, psd.size_z / 2) for psd in sensor.psds)
    levers = np.where(ANGLE_LEVERS > 0, max(psd.radius for psd in sensor.psds), 1.0)
    geometry = interval_geometry(sensor, tolerances)
    problem = RangeProblem(geometry, halves, share, rules.whole_spot, levers)
    far = np.array(FARTHEST_MM_RAD)
    try:
        aim = target_box(problem)
    except (NotFacing, LightNotShared, np.linalg.LinAlgError):
        return None
    low, high, done = narrow_down(problem, -far, far, aim, work)
    if low is None or (low <= -far).any() or (high >= far).any():
        return None
    return RangeCover(low, high, FARTHEST_MM_RAD, share, halves, rules.whole_spot, done)


def target_box(problem: RangeProblem) -> StateBox:
    """The box for a sensor whose Jacobian is everywhere that at rest, enlarged slightly.

    Tolerances make that Jacobian an interval: its deviation from the midpoint moves a spot as well.
    """
    rest = [arb(0)] * 6
    around = points_near_apex(problem, rest)
    slopes = jacobian_at(problem.geometry, rest, around)
    inverse = np.linalg.inv(middles(slopes))
    product = arb_mat(inverse.tolist()) * arb_mat(slopes)
    apart = np.array([[magnitude(product[i, j] - (i == j)) for j in range(6)] for i in range(6)])
    places = spot_places(problem.geometry, rest, around)
    middle = -inverse @ np.array([float(place.mid()) for place in places])
    off = np.array([float(place.rad()) for place in places])
    straight = np.abs(inverse) @ (np.array(problem.halves).ravel() + off)
    half = TARGET_FACTOR * np.linalg.solve(np.eye(6) - apart, straight)
    return box_of_poses(middle - half, middle + half)


def narrow_down(
    problem: RangeProblem, low: Floats, high: Floats, aim: StateBox, work: int
) -> tuple[Floats | None, Floats, int]:
    """Return the hull of the poses that remain of a box, and the number of boxes examined."""
    todo, remaining, done = [(low, high)], [], 0
    while todo:
        low, high = todo.pop()
        if is_within((low, high), aim):
            remaining.append((low, high))
            continue
        if done >= work:
            return None, high, done
        done += 1
        try:
            smaller = contract(problem, low, high)
        except NoPose:
            continue
        except (NotFacing, LightNotShared):
            todo += cut_in_two(low, high, ANGLE_LEVERS)
            continue
        width = np.where(high > low, high - low, 1.0)
        if ((smaller[1] - smaller[0]) / width).min() < KEPT_SHARE:
            todo.append(smaller)
        elif is_within(smaller, aim, NEAR_FACTOR):
            remaining.append(smaller)
        else:
            todo += cut_in_two(*smaller, problem.levers)
    if not remaining:
        return None, high, done
    return (
        np.min([a for a, _ in remaining], axis=0),
        np.max([b for _, b in remaining], axis=0),
        done,
    )


def is_within(piece: tuple[Floats, Floats], box: StateBox, times: float = 1.0) -> bool:
    """Return whether a box of poses lies in another, scaled about its middle."""
    middle, half = (box.low + box.high)[:6] / 2, times * (box.high - box.low)[:6] / 2
    return bool((piece[0] >= middle - half).all() and (piece[1] <= middle + half).all())


def points_near_apex(problem: RangeProblem, pose: Sequence[Interval]) -> list[list[Interval]]:
    """Regions (3, 2) across the beam in which each spot has a point on its detector, sigmas from
    the apex."""
    zero = arb(0)
    at = dark_scene_over(problem.geometry, [zero, zero, zero, *pose[3:]])
    edges = facet_edges(problem.geometry, at, rotation_axes(pose[4], pose[5]))
    offset = farthest_offset(edges, problem.share)
    if problem.whole and offset <= ELLIPSE_SIGMAS:
        return [[zero, zero]] * 3
    reach = offset + max(farthest_centroid(problem.share), ELLIPSE_SIGMAS if problem.whole else 0.0)
    return [points_in_facet(edges.angles[k], edges.openings[k], reach) for k in range(3)]


#: Number of parts of a facet's angle for bounding its points.
PARTS_OF_FACET = 4


def points_in_facet(start: Interval, opening: Interval, reach: float) -> list[Interval]:
    """The points of a facet within `reach` of the apex, seen along the beam: (2,) sigmas."""
    parts = [start + opening * (interval(0, 1) + n) / PARTS_OF_FACET for n in range(PARTS_OF_FACET)]
    far = interval(0, reach)
    return [hull(far * part.cos() for part in parts), hull(far * part.sin() for part in parts)]


def farthest_centroid(share: float) -> float:
    """The largest distance of a part of the beam's light from the beam's centroid, in sigmas.

    It is at most that of the half-plane with as much light: its density at the border over its
    light; bounded, at any border z, by the light past z and z times the rest.
    """
    borders = np.linspace(0.0, 6.0, 241)
    bounds = np.exp(-(borders**2) / 2) / np.sqrt(2 * np.pi) / share + borders
    return float(bounds.min()) * (1 + 1e-9)


def contract(problem: RangeProblem, low: Floats, high: Floats) -> tuple[Floats, Floats]:
    """Return a smaller box with all poses of a box that keep the rules. Raises `NoPose`.

    Raises `NotFacing` or `LightNotShared` if the box is too large to decide.
    """
    pose = intervals_between(low, high)
    around = points_near_apex(problem, pose)
    refuse_wrong_way(problem, pose, around)
    middle = (low + high) / 2
    thin = [arb(float(x)) for x in middle]
    slopes = jacobian_at(problem.geometry, [*thin[:3], *pose[3:]], around)
    places = spot_places(problem.geometry, thin, around)
    missing = [
        interval(-half, half) - place
        for half, place in zip(np.ravel(problem.halves).tolist(), places, strict=True)
    ]
    inverse = np.linalg.pinv(middles(slopes))
    preconditioner = arb_mat(inverse.tolist())
    step = preconditioner * arb_mat([[x] for x in missing])
    product = preconditioner * arb_mat(slopes)
    new_low, new_high = low.copy(), high.copy()
    for i in range(6):
        rest = sum(((int(i == j)) - product[i, j]) * (pose[j] - thin[j]) for j in range(6))
        bounds = ends(thin[i] + step[i, 0] + rest)
        new_low[i], new_high[i] = max(low[i], bounds[0]), min(high[i], bounds[1])
    if (new_low > new_high).any():
        raise NoPose
    return new_low, new_high


def jacobian_at(
    geometry: Geometry, pose: Sequence[Interval], around: list[list[Interval]]
) -> list[list[Interval]]:
    """The Jacobian of the coordinates of rays that are fixed relative to the apex."""
    still = [[[arb(0)] * 3] * 2] * 3
    return spot_jacobian(geometry, SharingBounds(around, still, [], arb(0)), pose)


def refuse_wrong_way(
    problem: RangeProblem, pose: Sequence[Interval], around: Sequence[Sequence[Interval]]
) -> None:
    """Raise `NoPose` if a sub-beam cannot go from its facet to its detector's area.

    This needs no quotient, so that it also decides large boxes: the vector from the ray's origin to
    a possible landing point is along the ray.
    """
    geometry, at = problem.geometry, dark_scene_over(problem.geometry, pose)
    for k in range(3):
        normal, beam = at.normals[k], geometry.direction
        incidence = dot(beam, normal)
        if incidence >= 0:
            raise NoPose
        if not incidence < 0:
            raise NotFacing
        leaving = reflect(beam, normal)
        _, y, z = geometry.axes[k]
        a, b = (interval(-half, half) for half in problem.halves[k])
        middle = [
            around[k][0] * p + around[k][1] * q
            for p, q in zip(geometry.spread[0], geometry.spread[1], strict=True)
        ]
        drop = -dot(normal, (middle[0], middle[1], middle[2])) / incidence
        landing = [c + a * p + b * q for c, p, q in zip(geometry.centres[k], y, z, strict=True)]
        start = [t + m + drop * d for t, m, d in zip(at.apex, middle, beam, strict=True)]
        way = subtract((landing[0], landing[1], landing[2]), (start[0], start[1], start[2]))
        across = cross(way, leaving)
        if any(not x.contains(arb(0)) for x in across) or dot(way, leaving) < 0:
            raise NoPose
