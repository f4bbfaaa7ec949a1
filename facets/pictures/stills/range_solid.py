"""The range of the mirror's position as a solid about its apex, with the cause of each side."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...characterization.ranges import CAUSES, find_exits
from ...core.rules import Rules
from ...core.sensor import Sensor
from ...core.units import Floats, Integers
from .camera import normalize

#: Number of rays around, and of rows on the upper side, the sides and the lower side.
LONGITUDES, ROWS = 64, (10, 16, 10)
#: Number of bisections that locate the border between two sides.
HALVINGS = 12
#: Largest distance of the search, mm.
FARTHEST_MM = 30.0
#: A colour for each of `CAUSES`, and for a side without a limit.
COLOURS = ("#FFC247", "#D884C6", "#EF7B5D", "#5FB7E5", "#C9CF5A", "#8C96A3")
#: Causes of the range's end in words, the last where no limit was found.
REASONS = (*CAUSES, "no limit within 30 mm")


@dataclass(frozen=True)
class RangeSolid:
    """Boundary of a range.

    points: (n, 3), mm.  faces: numbers of their four points.  causes: number of each face's cause
    in `REASONS`.
    """

    points: Floats
    faces: Integers
    causes: Integers

    @property
    def extent(self) -> Floats:
        """Return the minimum and maximum of x, y and z, (2, 3), mm."""
        return np.array([self.points.min(axis=0), self.points.max(axis=0)])


def range_solid(sensor: Sensor, rules: Rules) -> RangeSolid:
    """Find the positions that the mirror can reach from rest without rotation.

    Points lie along the lines where the cause changes, so that each face has one cause.
    """
    ends, _ = follow(sensor, rules, np.concatenate([-np.eye(3), np.eye(3)]))
    size = np.abs(ends).max(axis=0)
    around = 2 * np.pi * np.arange(LONGITUDES) / LONGITUDES

    def find_ends(polar: Floats, turn: Floats) -> tuple[Floats, Integers]:
        level = np.sin(polar)
        directions = np.stack([level * np.cos(turn), level * np.sin(turn), np.cos(polar)], axis=-1)
        return follow(sensor, rules, directions * size)

    upper, lower = (
        find_change(lambda polar: find_ends(polar, around)[1], np.full(LONGITUDES, pole))
        for pole in (0, np.pi)
    )
    polar = place_rows(upper, lower)
    points, causes = find_ends(polar.ravel(), np.tile(around, len(polar)))
    rows, columns = np.indices((len(polar) - 1, LONGITUDES)).reshape(2, -1)
    after = (columns + 1) % LONGITUDES
    first, second = rows * LONGITUDES, (rows + 1) * LONGITUDES
    faces = np.stack([first + columns, second + columns, second + after, first + after], axis=1)
    votes = np.array([(causes[faces] == n).sum(axis=1) for n in range(len(REASONS))])
    return RangeSolid(points, faces, votes.argmax(axis=0))


def find_change(cause: Callable[[Floats], Integers], pole: Floats) -> Floats:
    """Find the polar angle on each longitude at which the cause at the pole ends.

    The search stops at the equator; if the cause does not change, the result is 30 degrees from
    there.
    """
    at_pole = cause(pole)
    near, far = pole.copy(), np.full(len(pole), np.pi / 2)
    differs = cause(far) != at_pole
    for _ in range(HALVINGS):
        middle = (near + far) / 2
        same = cause(middle) == at_pole
        near, far = np.where(same, middle, near), np.where(same, far, middle)
    angles: Floats = np.where(differs, near, pole + (np.pi / 2 - pole) * 2 / 3)
    return angles


def place_rows(upper: Floats, lower: Floats) -> Floats:
    """Return polar angles (rows, longitudes) of all points: a row on both sides of each change."""
    above, sides, below = ROWS
    parts = [
        np.linspace(0, 1, above + 1)[:, None] * upper,
        upper + 1e-3 + np.linspace(0, 1, sides + 1)[:, None] * (lower - upper - 2e-3),
        lower + np.linspace(0, 1, below + 1)[:, None] * (np.pi - lower),
    ]
    return np.concatenate(parts)


def follow(sensor: Sensor, rules: Rules, directions: Floats) -> tuple[Floats, Integers]:
    """Find the ends of the range in directions (n, 3), mm, and their causes."""
    rays = np.zeros((len(directions), 6))
    rays[:, :3] = FARTHEST_MM * normalize(directions)
    exits = find_exits(sensor, rules, np.zeros(6), rays, 1e-5)
    ends = exits.distance[:, None] * rays[:, :3]
    return ends, np.where(exits.cause < 0, len(CAUSES), exits.cause)
