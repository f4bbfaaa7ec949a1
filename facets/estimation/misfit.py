"""Whether the readings fit the model: how many poses have a residual beyond chance, and why.

`Solution.misfit` flags a pose; this module counts the flags and describes them, for tables and live
loops.

If most poses are flagged, the likeliest cause is found by solving some of them again: with another
power of the laser, and with the beam at another position that is common to all. A free beam for
each reading would prove nothing: of the nine numbers it leaves one, which knows the power, not the
geometry.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from ..core.arguments import as_floats
from ..core.knowledge import Knowledge, Prior
from ..core.units import Floats
from .chance import FALSE_ALARM_RATE
from .solution import Solution
from .solver import solve

if TYPE_CHECKING:
    from ..core.sensor import Sensor

#: Flagged readings over those that chance flags, from which on the model is doubted; and the median
#: residual, over the noise's, from which on it is not the model of this sensor.
DOUBT, WRONG = 10.0, 5.0
#: Of the newest readings, whose residuals make the median.
KEPT = 10_000
#: So many flagged readings of the whole run, at most, are solved again; their median residual, over
#: the noise's, up to which a cause explains them; and by which factor it has to be smaller.
MAX_EXAMPLES, MAX_EXPLAINED_SIZE, EXPLAINED_SHARE = 60, 2.0, 0.5
#: A mirror whose poses scatter by less than so many standard uncertainties did not move.
STILL_SIGMAS = 10.0


@dataclass
class Misfit:
    """How many readings were judged, and flagged.  sizes: of the newest residuals, at least KEPT
    where there were so many, over what noise leaves; kept: how many.

    carried: whether a stage carries the beam, whose place is known by its encoder.  examples:
    flagged readings from all over the run, each with the place of the beam that was assumed, every
    `stride` of them.
    """

    judged: int = 0
    flagged: int = 0
    sizes: deque[Floats] = field(default_factory=deque)
    kept: int = 0
    carried: bool = False
    examples: list[tuple[Floats, Floats]] = field(default_factory=list)
    stride: int = 1
    sensor: Sensor | None = None
    knowledge: Knowledge = field(default_factory=Knowledge)
    method: str = "least-squares"

    def add(
        self,
        solution: Solution,
        sensor: Sensor,
        knowledge: Knowledge,
        method: str,
        readings: Floats,
    ) -> None:
        """Some solved readings (n, 9), as the model has them.

        knowledge, method: with which they were solved.
        """
        flags = solution.misfit
        if flags.any():
            self.sensor, self.knowledge, self.method = sensor, knowledge, method
            places = as_floats(knowledge.beam_prior.mean, "mean")
            self.keep_examples(flags, readings, np.broadcast_to(places, (len(flags), 2)))
        there = solution.converged & (solution.checks > 0)
        self.judged += int(there.sum())
        self.flagged += int(flags.sum())
        over = solution.residual[there] / np.sqrt(solution.checks[there])
        self.sizes.append(over)
        self.kept += len(over)
        while self.kept - len(self.sizes[0]) >= KEPT:
            self.kept -= len(self.sizes.popleft())

    def keep_examples(self, flags: NDArray[np.bool_], readings: Floats, places: Floats) -> None:
        rows = np.flatnonzero(flags)
        rows = rows[(self.flagged + np.arange(len(rows))) % self.stride == 0]
        self.examples += [(readings[row].copy(), places[row].copy()) for row in rows]
        while len(self.examples) > MAX_EXAMPLES:
            self.examples = self.examples[::2]
            self.stride *= 2

    @property
    def is_mostly_flagged(self) -> bool:
        """Whether more than half of what was judged is flagged."""
        return 2 * self.flagged > self.judged

    @property
    def sentence(self) -> str:
        """The message; empty if chance explains all flags."""
        chance = FALSE_ALARM_RATE * self.judged
        if self.flagged <= max(DOUBT * chance, chance + 5 * np.sqrt(chance) + 1):
            return ""
        size = float(np.median(np.concatenate(self.sizes)))
        told = (
            f"{self.flagged} of {self.judged} poses have a residual beyond chance "
            f"({chance:.2g} would by chance); the median residual is {size:.3g} times the noise"
        )
        if size > WRONG or self.is_mostly_flagged:
            cause = self.cause(size)
            if cause:
                return f"{told}. {cause} Until then the poses and their uncertainties are wrong."
        if size > WRONG:
            return (
                f"{told}. The cause is unknown: neither another place of the beam nor another "
                "power of the laser explains the readings. Check the sensor's geometry in the "
                "configuration, the order of the detectors and the columns' signs and units, or "
                "calibrate the rig; the stated uncertainties do not hold."
            )
        if self.is_mostly_flagged:
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

    @property
    def words(self) -> str:
        """The message; where chance explains all flags, how large the residuals are."""
        if self.sentence or not self.kept:
            return self.sentence
        size = float(np.sqrt(np.mean(np.concatenate(self.sizes) ** 2)))
        return f"the residuals are {size:.2f} times the noise (RMS; 1 is expected)"

    def cause(self, size: float) -> str:
        """The cause that explains the examples, whose residuals are `size` times the noise; or
        ""."""
        sensor, knowledge = self.sensor, self.knowledge
        if sensor is None or self.method == "paper" or not self.examples:
            return ""
        readings, places = (np.array(part) for part in zip(*self.examples, strict=True))
        enough = min(MAX_EXPLAINED_SIZE, EXPLAINED_SHARE * size)
        if knowledge.power != "unknown":
            power = power_that_explains(sensor, readings, places, enough)
            if power is not None:
                return (
                    f"The readings fit a laser of {power:.3g} mW instead of "
                    f"{sensor.beam.power:.3g} mW, which is the likeliest cause: correct "
                    "sensor.beam.power_mw, or solve with power: unknown."
                )
        if knowledge.beam == "free":
            return ""
        found = place_that_explains(sensor, readings, places, knowledge.power == "unknown", enough)
        return self.words_of_place(found, places.mean(axis=0)) if found is not None else ""

    def words_of_place(self, found: tuple[Floats, bool], assumed: Floats) -> str:
        """The sentences for a beam that stands elsewhere by so much (2,), mm."""
        away, moved = found
        if self.carried:
            words = (
                f"The readings fit a beam {point(away)} mm from where the stage "
                "says that it is, which is the likeliest cause: correct stage.zero_mm."
            )
        else:
            place = assumed + away
            words = (
                f"The readings fit a beam at {point(place)} mm instead of {point(assumed)} mm, "
                "which is the likeliest cause: move the beam back, say where it is, or solve with "
                "beam: free; where a stage carries it, acquire with --track."
            )
        if moved:
            return words
        return (
            f"{words} A wrong geometry in the configuration would explain the readings as well, "
            "because the mirror stood still."
        )


def point(place: Floats) -> str:
    """A place (2,), to the micrometre."""
    x, y = (round(float(value), 3) + 0.0 for value in place)
    return f"({x:g}, {y:g})"


def power_that_explains(
    sensor: Sensor, readings: Floats, places: Floats, enough: float
) -> float | None:
    """The power of the laser, mW, with which readings (n, 9) fit; None where they do not."""
    solution = solve(sensor, readings, beam=Prior(places, 0.0), power="unknown")
    if median_size(solution) > enough:
        return None
    return float(np.median(solution.power[solution.converged]))


def place_that_explains(
    sensor: Sensor, readings: Floats, places: Floats, unknown: bool, enough: float
) -> tuple[Floats, bool] | None:
    """How far the beam stands from `places` (n, 2), mm, for readings (n, 9) to fit, all of them by
    the same; and whether the mirror moved meanwhile. None where they do not.

    unknown: whether the power is.
    """
    power: Literal["known", "unknown"] = "unknown" if unknown else "known"
    free = solve(sensor, readings, beam="free", power=power, accept_unchecked=True)
    good = free.converged
    if not good.any():
        return None
    away = np.median(free.state[good, 6:] - places[good], axis=0)
    sigma = np.median(free.uncertainty[good, 6:], axis=0)
    together = solve(sensor, readings, beam=Prior(places + away, sigma), power=power)
    if median_size(together) > enough:
        return None
    poses, u = free.state[good, :6], np.median(free.uncertainty[good, :6], axis=0)
    return away, bool((poses.std(axis=0) > STILL_SIGMAS * u).any())


def median_size(solution: Solution) -> float:
    """The median residual over what noise leaves; infinite where less than half of the readings
    have a pose that can be checked."""
    good = solution.converged & (solution.checks > 0)
    if 2 * good.sum() < len(good):
        return np.inf
    return float(np.median(solution.residual[good] / np.sqrt(solution.checks[good])))
