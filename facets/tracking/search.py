"""The search for a lost mirror: towards the light while there is any, otherwise in a spiral.

Light shows the direction of the mirror over several millimetres, so the stage goes there within the
limits of following, for at most MAX_CHASE_S. In the dark it goes back to the last good place, or to
where the light went out, and from there in a spiral that is slower and has shorter steps. The
spiral ends at MAX_RADIUS_MM, or after a number of commands if the stage does not follow.
"""

from __future__ import annotations

from math import ceil, cos, hypot, pi, sin

import numpy as np

from ..core.settings import Stage as Settings
from ..core.units import Floats
from .limits import Limits

#: Distance between two turns of the spiral, mm.
TURN_SPACING_MM = 0.25
#: Maximum distance between two commanded positions, mm.
MAX_STEP_MM = 0.1
#: Radius at which the spiral ends, mm.
MAX_RADIUS_MM = 2.0
#: Maximum speed in the dark, mm/s.
DARK_SPEED_MM_PER_S = 10.0
#: Maximum number of commands in the spiral, relative to those that its length needs: it also ends
#: if the stage does not follow.
SPARE_FACTOR = 3.0
#: A search follows light without a pose for up to this time, s.
MAX_CHASE_S = 10.0


class Search:
    """Searches for the mirror, one after the other.

    outcome: how the last search ended, '' during one.  limits: for the last place of `next`.
    """

    def __init__(self, settings: Settings) -> None:
        self.full = full = Limits.from_settings(settings)
        speed = min(settings.max_speed, DARK_SPEED_MM_PER_S)
        self.step = min(MAX_STEP_MM, full.reach, speed / settings.rate)
        self.narrow = self.limits = Limits(full.low, full.high, speed, self.step)
        self.most_spiral = ceil(SPARE_FACTOR * pi * MAX_RADIUS_MM**2 / TURN_SPACING_MM / self.step)
        self.most_chase = ceil(MAX_CHASE_S * settings.rate)
        self.forget()

    def forget(self) -> None:
        """Prepare a new search."""
        self.limits = self.narrow
        self.centre: Floats | None = None
        self.goal: Floats | None = None
        self.angle = 0.0
        self.spirals = self.chases = 0
        self.outcome = ""

    def next(self, place: Floats, towards: Floats | None, home: Floats) -> Floats | None:
        """The next place of the search (2,), mm; None at its end, which `outcome` describes.

        place: of the stage.  towards: the mirror's place by the light, or None in the dark.  home:
        the last good place, at which a search in the dark begins.
        """
        if self.outcome:
            return None
        if towards is not None:
            self.limits = self.full
            self.chases += 1
            self.centre = self.goal = None  # the spiral begins where the light goes out
            self.angle = 0.0
            if self.chases <= self.most_chase:
                return towards
            self.outcome = f"the light was followed for {MAX_CHASE_S:g} s without a pose"
            return None
        self.limits = self.narrow
        self.spirals += 1
        if self.centre is None or self.goal is None:
            self.centre = (place if self.chases else home).copy()
            self.goal = self.centre
        elif hypot(*(place - self.goal)) < 2 * self.step:  # otherwise the stage is still on its way
            self.goal = self.turn()
        if self.radius <= MAX_RADIUS_MM and self.spirals <= self.most_spiral:
            return self.goal
        at = ", ".join(f"{x:.3f}" for x in self.centre)
        self.outcome = f"the mirror was not found within {MAX_RADIUS_MM:g} mm of ({at}) mm"
        return None

    @property
    def radius(self) -> float:
        return TURN_SPACING_MM * self.angle / (2 * pi)

    def turn(self) -> Floats:
        """The next place of the spiral, within the soft limits."""
        assert self.centre is not None
        self.angle += self.step / hypot(self.radius, TURN_SPACING_MM / (2 * pi))
        at = self.centre + self.radius * np.array([cos(self.angle), sin(self.angle)])
        held: Floats = np.clip(at, self.narrow.low, self.narrow.high)
        return held
