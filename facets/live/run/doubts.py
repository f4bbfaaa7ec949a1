"""When poses cannot be believed, or are not there: what a person should see while it lasts."""

from __future__ import annotations

from collections import Counter
from math import erf, inf, log
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...core.names import DETECTORS, TEMPERATURE_COLUMN
from ...core.units import Floats, describe_bounds
from ...detectors.counts import SATURATED, counts_per_ampere
from ...detectors.noise import current_variances

if TYPE_CHECKING:
    from ...core.settings import Config
    from ...estimation.solution import Solution

#: So many samples are looked at together; what is said is said of them.
LOOKED_AT = 5_000
#: A share of them from which on it is said.
NOTICED = 0.01

#: Counts that stay the same, all of them, at less than this chance are those of a frozen converter.
FROZEN_CHANCE = 1e-12
#: Time over which the share of poses with a residual beyond chance is averaged, s.
MISFIT_S = 0.5

BEYOND, FULL, COLD = "beyond chance", "saturated", "without a temperature"


class Trust:
    """Whether a stage may follow the newest samples at all.

    is_frozen: whether counts have stayed the same for longer than `stage.stale_ms` and than the
    noise of the electronics explains.  misfit: share of poses with a residual beyond chance.
    """

    def __init__(self, config: Config) -> None:
        self.electronics, self.stale = config.electronics, config.stage.stale
        self.is_frozen = False
        self.last, self.same, self.changed = np.full((1, 12), -(2**31)), 0, 0.0
        self.misfit, self.judged = 0.0, inf

    def add_counts(self, counts: NDArray[np.int32], time: Floats) -> None:
        """Some samples: counts (n, 12) at times (n,) on the host's clock, s."""
        differs = np.diff(np.vstack([self.last, counts]), axis=0).any(axis=1)
        self.last, self.same = counts[-1:], self.same + len(counts)
        if differs.any():
            newest = int(np.flatnonzero(differs)[-1])
            self.same, self.changed = len(counts) - 1 - newest, float(time[newest])
        lasted = float(time[-1]) - self.changed
        self.is_frozen = lasted > self.stale and self.same > self.most_same(self.last[0])

    def most_same(self, counts: NDArray[np.int32]) -> float:
        """So many samples have the same counts (12,) by chance, at most."""
        per_ampere = counts_per_ampere(self.electronics)
        noise = current_variances(self.electronics, counts / per_ampere)[..., :-1].sum(axis=-1)
        steps = max(per_ampere * float(noise.min()) ** 0.5, 1e-9)
        same = erf(0.5 / 2**0.5 / steps)  # of one count that lies in the middle of its step
        return log(FROZEN_CHANCE) / (9 * log(same)) if same < 1 else inf

    def add_poses(self, solution: Solution, time: float) -> None:
        """The poses of some samples, the last of which was taken at a time, s."""
        judged = solution.converged & (solution.checks > 0)
        if judged.any():
            weight = min(max(time - self.judged, 0.0) / MISFIT_S, 1.0)
            self.misfit += weight * (float(solution.misfit[judged].mean()) - self.misfit)
            self.judged = time

    @property
    def doubt(self) -> str:
        """Why the newest samples cannot be followed; '' if they can."""
        if self.is_frozen:
            return "the readings do not change"
        return "most poses have a residual beyond chance" if self.misfit > 0.5 else ""


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
        sentences = []
        if self.share(BEYOND) > NOTICED:
            sentences.append(
                f"{self.percent(BEYOND)} of the newest poses have a residual beyond chance: do not "
                "trust them"
            )
        if self.share(FULL) > NOTICED:
            sentences.append(
                f"{self.percent(FULL)} of the newest samples are saturated: there is too much "
                "light, or sensor.electronics.transimpedance_kohm is too high"
            )
        if self.share(COLD) > NOTICED:
            sentences.append(
                f"{self.percent(COLD)} of the newest samples have no value of "
                f"{TEMPERATURE_COLUMN} from {describe_bounds(TEMPERATURE_COLUMN)}, which "
                "sensor.temperature needs, and therefore no pose"
            )
        lost = [name for name in DETECTORS if self.share(name) > NOTICED]
        if lost:
            most = max(lost, key=self.share)
            names = ", ".join(name.upper() for name in lost)
            what = "detectors" if len(lost) > 1 else "detector"
            sentences.append(
                f"light is lost on {what} {names}, in {self.percent(most)} of the newest samples"
            )
        return sentences

    def share(self, name: str) -> float:
        return self.counts[name] / max(1, self.samples)

    def percent(self, name: str) -> str:
        return f"{100 * self.share(name):.0f} %"
