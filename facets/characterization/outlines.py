"""The outline of the range over two axes, and maps of its inside.

An outline is traced along rays from a place inside, to a tolerance, and rays are added until the
outline between them has the same accuracy.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.arguments import check_arguments
from ..core.errors import InputError
from ..core.names import ANGLES, POSE
from ..core.notebook import show_shortly
from ..core.rigid_body import MeasuredObject
from ..core.rules import Rules
from ..core.sensor import Sensor
from ..core.units import Floats
from ..estimation.solver import solve
from ..model.arrays import readings
from .ranges import (
    FARTHEST_MM_RAD,
    SINGULAR,
    clearances,
    determinant_signs,
    find_exits,
    fine_slopes,
    require_inside,
    scaled_jacobian,
    standard_uncertainties,
    states_of,
)

#: Tolerance of an outline: 0.1 um and 0.1 urad.
TOLERANCE_MM = 1e-4
TOLERANCE_RAD = 1e-7


@show_shortly
@dataclass(frozen=True)
class Boundary:
    """The traced outline of the range over two axes: points (n, 2), mm or rad, in order, from
    `start` (6,); places of the pose, or of the displacement of `object`.

    causes: (n,) why the range ends between each point and the next; -1 where the search ended.
    """

    axes: tuple[str, str]
    start: Floats
    points: Floats
    causes: NDArray[np.int64]
    object: MeasuredObject | None = None

    def poses(self, points: Floats) -> Floats:
        """Poses (n, 6) at points (n, 2) of the two axes, the others as at `start`."""
        return poses_on_axes(self.start, self.axes, points)

    @property
    def extent(self) -> Floats:
        """Width and height (2,) of the outline, in mm or rad like its axes."""
        size: Floats = np.ptp(self.points, axis=0)
        return size


def poses_on_axes(start: Floats, axes: Sequence[str], points: Floats) -> Floats:
    """The pose `start` (6,) moved by points (n, 2) along two axes: (n, 6)."""
    poses = np.repeat(start[None], len(points), axis=0)
    poses[:, [POSE.index(name) for name in axes]] += points
    return poses


def grid_points(x: Floats, y: Floats) -> Floats:
    """The points (n, 2) of a grid over x and y, x varying first."""
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def tolerances(axes: Sequence[str]) -> Floats:
    """The outline's tolerance along each axis, mm or rad."""
    return np.array([TOLERANCE_RAD if name in ANGLES else TOLERANCE_MM for name in axes])


@check_arguments
def trace(
    sensor: Sensor, rules: Rules, axes: tuple[str, str], start: ArrayLike | None = None
) -> Boundary:
    """Trace the outline of the range over two axes of the pose, as in Figs. 6 and 10 of the paper.

    Parameters
    ----------
    sensor
        The sensor.
    rules
        Limits of the range; `Config.range` contains a configuration's limits.
    axes
        Two names out of `facets.POSE`.
    start
        A pose inside the range, (6,), mm and rad; zero by default. With `Rules.object` the
        displacement of the object, as the axes are.

    Returns
    -------
    Boundary
        Points (n, 2) in mm or rad, and the cause of the range's end at each. Every ray from `start`
        is followed until it first leaves the range, to 0.1 um and 0.1 urad; parts of the range
        beyond that point are not found (`cause_grid` shows them).

    Raises
    ------
    InputError
        If `start` is outside the range.

    Examples
    --------
    >>> import facets
    >>> config = facets.load("paper")
    >>> outline = facets.trace(config.sensor, config.range, ("tz", "yaw"))
    >>> f"{outline.extent[0]:.1f} mm by {1e3 * outline.extent[1]:.0f} mrad"
    '12.6 mm by 49 mrad'
    """
    if not set(axes) <= set(POSE) or axes[0] == axes[1]:
        raise InputError(f"axes is {axes!r}; allowed: two different names of {', '.join(POSE)}")
    pose = require_inside(sensor, rules, np.zeros(6) if start is None else start)
    cheap = replace(rules, condition=np.inf, coarsest=(np.inf,) * 6)
    boundary = trace_outline(sensor, cheap, axes, pose)
    if cheap == rules:
        return boundary
    shares = np.linspace(0, 1, 9)[1:, None, None]
    within = (shares * boundary.points[:: max(1, len(boundary.points) // 64)]).reshape(-1, 2)
    poses = poses_on_axes(pose, axes, within)
    signs = determinant_signs(sensor, poses, rules)
    if (clearances(sensor, poses, rules)[:, SINGULAR:] > np.log(2)).all() and (
        signs == determinant_signs(sensor, pose[None], rules)
    ).all():
        return boundary  # conditioning and resolution are nowhere near their limits
    return trace_outline(sensor, rules, axes, pose)


def trace_outline(sensor: Sensor, rules: Rules, axes: tuple[str, str], pose: Floats) -> Boundary:
    """Trace the outline from a pose (6,) that is inside the range."""
    columns = [POSE.index(name) for name in axes]
    reach = np.array([FARTHEST_MM_RAD[column] for column in columns])
    fine = tolerances(axes)

    def follow(angles: Floats, scale: Floats, precise: float) -> tuple[Floats, Any]:
        """Points (n, 2) at which rays leave the range, and the causes (n,)."""
        rays = np.zeros((len(angles), 6))
        rays[:, columns] = np.stack([np.cos(angles), np.sin(angles)], axis=1) * scale
        exits = find_exits(sensor, rules, pose, rays, precise)
        return exits.distance[:, None] * rays[:, columns], exits.cause

    ends, _ = follow(np.arange(4) * np.pi / 2, reach, 1e-6)
    scale = 4 * np.abs(ends).max(axis=0)  # a nearly round outline, inside the ends of the rays
    points, causes = refine_outline(follow, scale, fine)
    while (causes < 0).any() and (scale < reach).any():  # a long range between the two axes
        scale = 2 * scale
        points, causes = refine_outline(follow, scale, fine)
    poses = poses_on_axes(pose, axes, (points[:-1] + points[1:]) / 2)
    between = clearances(sensor, poses, rules).argmin(axis=1)
    ended = (causes[:-1] < 0) & (causes[1:] < 0)
    causes = np.where(ended, -1, between)
    return Boundary(axes, pose, points[:-1], causes, rules.object)


def refine_outline(
    follow: Callable[[Floats, Floats, float], tuple[Floats, Any]], scale: Floats, fine: Floats
) -> tuple[Floats, Any]:
    """Points (n, 2) of an outline from rays of the lengths `scale`, mm or rad, with their causes
    (n,); rays are added until chords between points are within the tolerances `fine`.

    follow: points and causes of rays by their angles, lengths and tolerance.
    """
    precise = float((fine / scale).min()) / 10
    angles = np.arange(33) * np.pi / 16
    points, causes = follow(angles, scale, precise)
    open_ = np.arange(32)  # segments whose middle has not been examined
    while len(open_) and len(angles) < 20_000:
        middle = (angles[open_] + angles[open_ + 1]) / 2
        between, why = follow(middle, scale, precise)
        away = chord_distance(between / fine, points[open_] / fine, points[open_ + 1] / fine)
        split = (away > 1) & (np.diff(angles)[open_] > 1e-9)
        where = open_ + 1
        angles, points = np.insert(angles, where, middle), np.insert(points, where, between, axis=0)
        causes = np.insert(causes, where, why)
        first = open_[split] + np.flatnonzero(split)  # numbers after the insertion
        open_ = np.sort(np.concatenate([first, first + 1]))
    return points, causes


def chord_distance(point: Floats, a: Floats, b: Floats) -> Floats:
    """Distances (n,) of points (n, 2) from the lines through a and b (n, 2)."""
    chord = b - a
    length = np.maximum(np.hypot(*chord.T), 1e-300)
    off: Floats = np.abs(chord[:, 0] * (point - a)[:, 1] - chord[:, 1] * (point - a)[:, 0]) / length
    return off


def cause_grid(
    sensor: Sensor, rules: Rules, boundary: Boundary, count: int
) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """The two axes, and for each place of a count x count grid why it is outside; -1 inside.

    The grid covers the outline and a margin of a tenth. Shapes (count,), (count,), (count, count).
    """
    low, high = boundary.points.min(axis=0), boundary.points.max(axis=0)
    low, high = low - 0.05 * (high - low), high + 0.05 * (high - low)
    x, y = np.linspace(low[0], high[0], count), np.linspace(low[1], high[1], count)
    clear = clearances(sensor, boundary.poses(grid_points(x, y)), rules)
    cause = np.where(clear.min(axis=1) > 0, -1, clear.argmin(axis=1))
    return x, y, cause.reshape(count, count)


def count_grid_differences(sensor: Sensor, rules: Rules, boundary: Boundary, count: int) -> int:
    """Number of the places of `cause_grid` that are on another side of the outline than of the
    range."""
    from matplotlib.path import Path

    x, y, cause = cause_grid(sensor, rules, boundary, count)
    within = Path(boundary.points).contains_points(grid_points(x, y))
    return int((within != (cause.ravel() < 0)).sum())


def states_inside(rules: Rules, boundary: Boundary) -> Floats:
    """States (n, 8) at places inside an outline, up to near its edge."""
    shares = np.linspace(0.25, 0.999, 4)[:, None, None]
    some = boundary.points[:: max(1, len(boundary.points) // 100)]
    return states_of(boundary.poses((shares * some).reshape(-1, 2)), rules)


def count_correct_solutions(sensor: Sensor, states: Floats) -> int:
    """Number of states (n, 8) that `solve` finds from zero."""
    start = np.zeros_like(states)
    start[:, [0, 1, 6, 7]] = states[:, [6, 7, 6, 7]]  # start with the mirror under the beam
    solution = solve(sensor, readings(sensor, states), start=start, covariance=False)
    right = solution.converged & (np.abs(solution.state - states).max(axis=1) < 1e-6)
    return int(right.sum())


def map_inside(
    sensor: Sensor, rules: Rules, boundary: Boundary, what: str, count: int = 101
) -> tuple[Floats, Floats, Floats]:
    """A grid inside the outline as (x, y, values), NaN outside.

    what: an axis, for its standard uncertainty, um or urad; or "condition", for the logarithm of
    the condition number of the weighted Jacobian.
    """
    x, y, cause = cause_grid(sensor, rules, boundary, count)
    states = states_of(boundary.poses(grid_points(x, y)[cause.ravel() < 0]), rules)
    matrix = scaled_jacobian(sensor, states)
    values = np.full(cause.shape, np.nan)
    if what == "condition":
        values[cause < 0] = np.log10(np.linalg.cond(matrix))
    else:
        fine = standard_uncertainties(matrix, fine_slopes(states, rules.object))
        values[cause < 0] = fine[:, POSE.index(what)]
    return x, y, values
