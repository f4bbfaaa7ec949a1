"""Whether a solved reading fits the model: its residual against what noise alone leaves.

Of nine readings, those beside the unknowns check the others: their number is the redundancy. The
squared residual of a right model follows the chi-square distribution with so many degrees of
freedom; beyond `LEVEL` of it the reading is flagged, for solving and for a live loop alike.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..core.units import Floats
from ..detectors.calibrated import MISFIT
from .solution import Solution

if TYPE_CHECKING:
    from ..core.sensor import Sensor
    from ..core.settings import Solve


#: The chance that a reading is flagged though nothing is wrong with it.
LEVEL = 1e-4
#: That many standard deviations of a residual with 0 to 9 degrees of freedom are beyond `LEVEL`:
#: kept, because the library that has the distribution takes longer to load than to solve a table.
LIMITS = (
    np.inf, 3.8905918864130937, 4.291932052578694, 4.594291399787372, 4.848993962152442,
    5.073936534787943, 5.277910688521919, 5.466031824754125, 5.641598000678736, 5.806888016740519,
)  # fmt: skip
#: Flagged readings over those that chance flags, from which on the model is doubted; and the median
#: residual, over the noise's, from which on it is not the model of this sensor.
DOUBT, WRONG = 10.0, 5.0
#: Of the newest readings, whose residuals make the median.
KEPT = 10_000


def redundancy(used: NDArray[np.bool_], options: Solve) -> NDArray[np.int64]:
    """How many numbers of a reading check the others (n,), from the detectors used (n, 3).

    What has a prior counts as known; a beam or a power that is free takes its part.
    """
    free = 6 + (2 if options.beam == "free" else 0) + (1 if options.power == "unknown" else 0)
    if options.method == "paper":
        return np.zeros(used.shape[:-1], dtype=np.int64)
    left: NDArray[np.int64] = 3 * used.sum(axis=-1) - free
    return np.maximum(left, 0)


def beyond_chance(
    sensor: Sensor, options: Solve, solution: Solution, level: float = LEVEL
) -> NDArray[np.bool_]:
    """Which solved readings (n,) have a residual that noise leaves with a chance below `level`.

    Never where nothing checks a reading, nor where there is no pose. What a calibration found its
    model to miss widens the noise.
    """
    limits, count = limits_at(level), redundancy(solution.used, options)
    with np.errstate(invalid="ignore"):
        high: NDArray[np.bool_] = solution.residual > limits[count] * widening(sensor)
    return high & solution.ok


@cache
def limits_at(level: float) -> Floats:
    """The limits of residuals with 0 to 9 degrees of freedom, in standard deviations."""
    return np.array([limit_of(count, level) for count in range(10)])


def limit_of(count: int, level: float) -> float:
    """Of a residual with so many degrees of freedom, in standard deviations."""
    if not count:
        return np.inf
    if level == LEVEL:
        return LIMITS[count]
    from scipy.special import chdtri

    return float(np.sqrt(chdtri(count, level)))


def widening(sensor: Sensor) -> float:
    """By how much residuals of this sensor are larger than the noise, as its calibration says."""
    known = sensor.calibration
    if known is None or not any(name in MISFIT for name in known.names):
        return 1.0
    from ..detectors.noise import standard_deviations
    from ..model.arrays import readings

    noise = standard_deviations(sensor, readings(sensor, np.zeros(8)))
    missed = {name: known.covariance[n][n] for n, name in enumerate(known.names)}
    over = [missed.get(name, 0.0) / s**2 for name, s in zip(MISFIT, noise, strict=True)]
    return float(np.sqrt(1 + np.nanmax(over)))


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

    def add(self, flags: NDArray[np.bool_], solution: Solution, options: Solve) -> None:
        count = redundancy(solution.used, options)
        there = solution.ok & (count > 0)
        self.judged += int(there.sum())
        self.flagged += int(flags.sum())
        over = solution.residual[there] / np.sqrt(count[there])
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
