"""The range of the mirror's place as a solid about its apex, with the cause of its end by side."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...characterization.ranges import CAUSES, find_exits
from ...core.rules import Rules
from ...core.sensor import Sensor
from ...core.units import Floats, Integers
from .camera import normalize

#: Number of rays around, and from pole to pole: over the upper side, the sides, and the lower side.
LONGITUDES, ROWS = 64, (10, 16, 10)
#: Number of halvings with which the border between two sides is located.
HALVINGS = 12
#: Largest distance of the search, mm.
FARTHEST_MM = 30.0
#: A colour for each of `CAUSES`, and for a side without a limit.
COLOURS = ("#FFC247", "#D884C6", "#EF7B5D", "#5FB7E5", "#C9CF5A", "#8C96A3")
#: Reasons for the range's end, and a text for no limit.
REASONS = (*CAUSES, "further than is looked")


@dataclass(frozen=True)
class RangeSolid:
    """points: (n, 3) of the boundary, mm.  faces: of four points.  causes: of each face, numbers of
    `REASONS`."""

    points: Floats
    faces: Integers
    causes: Integers

    @property
    def extent(self) -> Floats:
        """Return the lowest and highest x, y and z, (2, 3), mm."""
        return np.array([self.points.min(axis=0), self.points.max(axis=0)])


def range_solid(sensor: Sensor, rules: Rules) -> RangeSolid:
    """Find the places that the mirror can reach from rest without turning; mm.

    The solid has points along the lines where the cause changes, so that each face has one cause.
    """
    ends, _ = follow(sensor, rules, np.concatenate([-np.eye(3), np.eye(3)]))
    size = np.abs(ends).max(axis=0)
    around = 2 * np.pi * np.arange(LONGITUDES) / LONGITUDES

    def ask(polar: Floats, turn: Floats) -> tuple[Floats, Integers]:
        level = np.sin(polar)
        ways = np.stack([level * np.cos(turn), level * np.sin(turn), np.cos(polar)], axis=-1)
        return follow(sensor, rules, ways * size)

    upper = changes(lambda polar: ask(polar, around)[1], np.zeros(LONGITUDES))
    lower = changes(lambda polar: ask(polar, around)[1], np.full(LONGITUDES, np.pi))
    polar = between(upper, lower)
    points, causes = ask(polar.ravel(), np.tile(around, len(polar)))
    rows, columns = np.indices((len(polar) - 1, LONGITUDES)).reshape(2, -1)
    after = (columns + 1) % LONGITUDES
    first, second = rows * LONGITUDES, (rows + 1) * LONGITUDES
    faces = np.stack([first + columns, second + columns, second + after, first + after], axis=1)
    votes = np.array([(causes[faces] == n).sum(axis=1) for n in range(len(REASONS))])
    return RangeSolid(points, faces, votes.argmax(axis=0))


def changes(cause: Callable[[Floats], Integers], pole: Floats) -> Floats:
    """The polar angles, on each longitude, at which the cause is no longer that at the pole.

    The search ends at the equator; for a constant cause the result is a third of a right angle.
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


def between(upper: Floats, lower: Floats) -> Floats:
    """Return polar angles (rows, longitudes) of all points: a row on either side of each change."""
    above, sides, below = ROWS
    parts = [
        np.linspace(0, 1, above + 1)[:, None] * upper,
        upper + 1e-3 + np.linspace(0, 1, sides + 1)[:, None] * (lower - upper - 2e-3),
        lower + np.linspace(0, 1, below + 1)[:, None] * (np.pi - lower),
    ]
    return np.concatenate(parts)


def follow(sensor: Sensor, rules: Rules, ways: Floats) -> tuple[Floats, Integers]:
    """The ends of the range in directions (n, 3) of the mirror's place, mm, and the causes."""
    rays = np.zeros((len(ways), 6))
    rays[:, :3] = FARTHEST_MM * normalize(ways)
    exits = find_exits(sensor, rules, np.zeros(6), rays, 1e-5)
    ends = exits.distance[:, None] * rays[:, :3]
    return ends, np.where(exits.cause < 0, len(CAUSES), exits.cause)
