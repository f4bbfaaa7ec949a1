"""When poses cannot be believed, or are not there: what a person should see while it lasts."""

from __future__ import annotations

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from ...core.names import DETECTORS, TEMPERATURE_COLUMN
from ...core.units import Floats, describe_bounds
from ...detectors.counts import SATURATED

#: So many samples are looked at together; what is said is said of them.
LOOKED_AT = 5_000
#: A share of them from which on it is said.
NOTICED = 0.01

BEYOND, FULL, COLD = "beyond chance", "saturated", "without a temperature"


class Doubts:
    """Counts, over the newest samples, what speaks against poses.

    floor: (3,) the least powers that count as light, mW.
    """

    def __init__(self, floor: Floats) -> None:
        self.floor = floor
        self.samples = 0
        self.counts: Counter[str] = Counter()
        self.said: list[str] = []

    def add(
        self,
        readings: Floats,
        flags: NDArray[np.uint8],
        beyond: NDArray[np.bool_],
        unknown: NDArray[np.bool_],
    ) -> None:
        """Some samples: readings (n, 9), flags (n,), whose residual is beyond chance (n,), and
        which lack the temperature that the sensor follows (n,)."""
        self.samples += len(flags)
        if unknown.any():
            self.counts[COLD] += int(unknown.sum())
        if beyond.any():
            self.counts[BEYOND] += int(beyond.sum())
        if flags.any():
            self.counts[FULL] += int(np.count_nonzero(flags & SATURATED))
        dark = readings[:, 2::3] < self.floor  # false where a detector is saturated, and reads NaN
        if dark.any():
            for name, count in zip(DETECTORS, dark.sum(axis=0).tolist(), strict=True):
                self.counts[name] += count
        if self.samples >= LOOKED_AT:
            self.said = self.sentences()
            self.samples = 0
            self.counts.clear()

    def sentences(self) -> list[str]:
        """One for each thing that is not rare."""
        found = []
        if self.share(BEYOND) > NOTICED:
            found.append(
                f"{self.percent(BEYOND)} of the newest poses have a residual beyond chance: do not "
                "trust them"
            )
        if self.share(FULL) > NOTICED:
            found.append(
                f"{self.percent(FULL)} of the newest samples are saturated: there is too much "
                "light, or sensor.electronics.transimpedance_kohm is too high"
            )
        if self.share(COLD) > NOTICED:
            found.append(
                f"{self.percent(COLD)} of the newest samples have no value of "
                f"{TEMPERATURE_COLUMN} from {describe_bounds(TEMPERATURE_COLUMN)}, which "
                "sensor.temperature needs, and therefore no pose"
            )
        lost = [name for name in DETECTORS if self.share(name) > NOTICED]
        if lost:
            most = max(lost, key=self.share)
            names = ", ".join(name.upper() for name in lost)
            what = "detectors" if len(lost) > 1 else "detector"
            found.append(
                f"light is lost on {what} {names}, in {self.percent(most)} of the newest samples"
            )
        return found

    def share(self, name: str) -> float:
        return self.counts[name] / max(1, self.samples)

    def percent(self, name: str) -> str:
        return f"{100 * self.share(name):.0f} %"
