"""How a mirror that was lost is looked for: towards the light while there is any, else in a spiral.

Light shows the way to the mirror over several millimetres, so the stage goes there within the
limits of tracking, for CHASE at most. In the dark it goes back to the last good place, or to where
the light went out, and from there in a spiral with limits of its own, slower and shorter than
tracking. It ends at FARTHEST, and after so many commands that a stage which does not follow ends
it, too.
"""

from __future__ import annotations

from math import ceil, cos, hypot, pi, sin

import numpy as np

from ..core.settings import Stage as Settings
from ..core.units import Floats
from .limits import Limits

#: Between turns, between places, and from the middle to the end, mm.
TURN, STEP, FARTHEST = 0.25, 0.1, 2.0
#: In the dark no faster than this, mm/s.
SPEED = 10.0
#: How much longer than the spiral takes a search may go on, and how long it may follow light, s.
SPARE, CHASE = 3.0, 10.0


class Search:
    """One search after the other.

    outcome: how the last one ended, '' while one goes on.  limits: of the place that `next` gave.
    """

    def __init__(self, settings: Settings) -> None:
        self.full = full = Limits.from_settings(settings)
        speed = min(settings.max_speed, SPEED)
        self.step = min(STEP, full.reach, speed / settings.rate)
        self.narrow = self.limits = Limits(full.low, full.high, speed, self.step)
        self.most_spiral = ceil(SPARE * pi * FARTHEST**2 / TURN / self.step)
        self.most_chase = ceil(CHASE * settings.rate)
        self.forget()

    def forget(self) -> None:
        """The next call of `next` begins anew."""
        self.limits = self.narrow
        self.centre: Floats | None = None
        self.goal: Floats | None = None
        self.angle = 0.0
        self.spirals = self.chases = 0
        self.outcome = ""

    def next(self, place: Floats, towards: Floats | None, home: Floats) -> Floats | None:
        """Where to look next (2,), mm; None at the end, of which `outcome` tells.

        place: where the stage is.  towards: where the light says that the mirror is, or None in
        the dark.  home: the last good place, to which a search that begins in the dark goes back.
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
            self.outcome = f"the light was followed for {CHASE:g} s without a pose"
            return None
        self.limits = self.narrow
        self.spirals += 1
        if self.centre is None or self.goal is None:
            self.centre = (place if self.chases else home).copy()
            self.goal = self.centre
        elif hypot(*(place - self.goal)) < 2 * self.step:  # else the stage is still on its way
            self.goal = self.turn()
        if self.radius <= FARTHEST and self.spirals <= self.most_spiral:
            return self.goal
        at = ", ".join(f"{x:.3f}" for x in self.centre)
        self.outcome = f"the mirror was not found within {FARTHEST:g} mm of ({at}) mm"
        return None

    @property
    def radius(self) -> float:
        return TURN * self.angle / (2 * pi)

    def turn(self) -> Floats:
        """The next place of the spiral, within the soft limits."""
        assert self.centre is not None
        self.angle += self.step / hypot(self.radius, TURN / (2 * pi))
        at = self.centre + self.radius * np.array([cos(self.angle), sin(self.angle)])
        held: Floats = np.clip(at, self.narrow.low, self.narrow.high)
        return held
