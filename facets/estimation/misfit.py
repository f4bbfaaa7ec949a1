"""Whether the readings fit the model: how many poses have a residual beyond chance, and why.

Which pose has one is `Solution.misfit`; here they are counted and put into words, for a table and
for a live loop alike.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from ..core.units import Floats
from .chance import LEVEL
from .solution import Solution

#: Flagged readings over those that chance flags, from which on the model is doubted; and the median
#: residual, over the noise's, from which on it is not the model of this sensor.
DOUBT, WRONG = 10.0, 5.0
#: Of the newest readings, whose residuals make the median.
KEPT = 10_000


@dataclass
class Misfit:
    """How many readings were judged, and flagged.  sizes: of the newest residuals, at least KEPT
    where there were so many, over what noise leaves; kept: how many.

    carried: whether a stage carries the beam, whose place is known by its encoder.
    """

    judged: int = 0
    flagged: int = 0
    sizes: deque[Floats] = field(default_factory=deque)
    kept: int = 0
    carried: bool = False

    def add(self, solution: Solution) -> None:
        there = solution.converged & (solution.checks > 0)
        self.judged += int(there.sum())
        self.flagged += int(solution.misfit.sum())
        over = solution.residual[there] / np.sqrt(solution.checks[there])
        self.sizes.append(over)
        self.kept += len(over)
        while self.kept - len(self.sizes[0]) >= KEPT:
            self.kept -= len(self.sizes.popleft())

    @property
    def mostly(self) -> bool:
        """Whether more than half of what was judged is flagged."""
        return 2 * self.flagged > self.judged

    @property
    def sentence(self) -> str:
        """What is to be said; empty where chance explains all."""
        chance = LEVEL * self.judged
        if self.flagged <= max(DOUBT * chance, chance + 5 * np.sqrt(chance) + 1):
            return ""
        size = float(np.median(np.concatenate(self.sizes)))
        told = (
            f"{self.flagged} of {self.judged} poses have a residual beyond chance "
            f"({chance:.2g} would by chance); the median residual is {size:.3g} times the noise"
        )
        if size > WRONG:
            return (
                f"{told}: this is not the geometry of the sensor that gave the readings. Check the "
                "configuration, the order of the detectors and the columns' signs and units, or "
                "calibrate the rig; the stated uncertainties do not hold."
            )
        if self.mostly:
            return (
                f"{told}: the model misses something of this sensor. Calibrate it again; if the "
                "laser's power or the beam may have moved, solve with power: unknown or beam: free."
            )
        causes = "dust, a cable, a shutter, a passing reflection"
        if self.carried:
            causes += ", or a stage whose place came too late to be that of the sample"
        return (
            f"{told}: single readings are spoilt ({causes}); the column residual of the poses "
            "says which."
        )
