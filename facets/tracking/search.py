"""The search for a lost mirror: towards the light while there is any, otherwise in a spiral.

Light shows the direction of the mirror over several millimetres, so the stage moves there within
the limits of following. In the dark it returns to the last good place, or to the place where the
light was lost, and moves from there in a spiral, at lower speed and in shorter steps. Settings
bound the time, the distance from the last good place, and how often the light may lead back.

Places (2,) are in mm.
"""

from __future__ import annotations

from math import cos, hypot, inf, pi, sin

import numpy as np

from ..core.settings import Stage as Settings
from ..core.units import Floats
from .limits import Limits

#: Distance between two turns of the spiral, mm.
TURN_SPACING_MM = 0.25
#: Maximum distance between two commanded positions, mm.
MAX_STEP_MM = 0.1
#: Maximum speed in the dark, mm/s.
DARK_SPEED_MM_PER_S = 10.0


class Search:
    """Searches for the mirror, one after the other.

    outcome: how the last search ended, '' during one.  limits: for the last place of `next`.
    """

    def __init__(self, settings: Settings) -> None:
        self.settings, self.most = settings, settings.search_distance
        self.goal = np.zeros(2)
        self.full = full = Limits.from_settings(settings)
        speed = min(settings.max_speed, DARK_SPEED_MM_PER_S)
        self.step = min(MAX_STEP_MM, full.reach, speed / settings.rate)
        self.narrow = self.limits = Limits(full.low, full.high, speed, self.step)
        self.forget()

    def forget(self) -> None:
        """Prepare a new search."""
        self.limits, self.begun = self.narrow, inf
        self.centre: Floats | None = None
        self.way: Floats | None = None
        self.angle = 0.0
        self.reversals = 0
        self.outcome = ""

    @property
    def scope(self) -> str:
        """The largest distance and duration of a search, in words."""
        return f"within {self.most:g} mm, in {self.settings.search_time:g} s"

    def next(
        self, now: float, place: Floats, towards: Floats | None, home: Floats
    ) -> Floats | None:
        """The next place of the search (2,), mm; None at its end, which `outcome` describes.

        now: s.  place: of the stage.  towards: the mirror's place by the light, or None in the
        dark.  home: the last good place, at which a search in the dark begins.
        """
        self.begun = min(self.begun, now)
        if now - self.begun > self.settings.search_time or self.radius > self.most:
            self.outcome = self.outcome or f"the mirror was not found {self.scope}"
        if self.outcome:
            return None
        goal = (
            self.place_in_dark(place, home)
            if towards is None
            else self.place_by_light(place, towards)
        )
        away = goal - home
        self.goal = home + away * min(1.0, self.most / max(hypot(*away), 1e-9))
        return self.goal

    def place_by_light(self, place: Floats, towards: Floats) -> Floats:
        """The place (2,) of the mirror by the light, mm. Too many reversals set `outcome`."""
        self.limits, self.centre = self.full, None  # the spiral begins where the light is lost
        way, self.angle = towards - place, 0.0
        self.reversals += self.way is not None and bool(way @ self.way < 0)
        self.way = way
        if self.reversals > self.settings.search_reversals:
            self.outcome = f"the light led back {self.settings.search_reversals} times"
        return towards

    def place_in_dark(self, place: Floats, home: Floats) -> Floats:
        """The next place (2,), mm, without light: the way's end, `home`, or the spiral."""
        self.limits = self.narrow
        if self.centre is None:
            self.centre = (home if self.way is None else place).copy()
            return self.centre
        on_its_way = hypot(*(place - self.goal)) >= 2 * self.step
        return self.goal if on_its_way else self.next_on_spiral()

    @property
    def radius(self) -> float:
        """The radius of the spiral at the present angle, mm."""
        return TURN_SPACING_MM * self.angle / (2 * pi)

    def next_on_spiral(self) -> Floats:
        """The next place (2,) of the spiral, mm, within the soft limits."""
        assert self.centre is not None
        self.angle += self.step / hypot(self.radius, TURN_SPACING_MM / (2 * pi))
        at = self.centre + self.radius * np.array([cos(self.angle), sin(self.angle)])
        held: Floats = np.clip(at, self.narrow.low, self.narrow.high)
        return held
