"""Reasons to distrust the newest poses, or why there are none, shown while they last."""

from __future__ import annotations

from collections import Counter
from math import erf, inf, log
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...core.names import DETECTORS, TEMPERATURE_COLUMN
from ...core.units import Floats, describe_bounds
from ...detectors.counts import SATURATED, UNEQUAL, counts_per_ampere
from ...detectors.noise import current_variances, has_two_layers
from ..sources.frames import ELECTRODES, RawSamples

if TYPE_CHECKING:
    from ...core.settings import Config
    from ...estimation.solution import Solution

#: Number of samples that are judged together.
LOOKED_AT = 5_000
#: A doubt that concerns more than this fraction of these samples is reported.
NOTICED = 0.01

#: A converter is frozen if the probability that all its counts stay the same is below this.
FROZEN_CHANCE = 1e-12
#: The constant counts of a detector or an electrode are a fault only while others move by more than
#: this number of counts.
MOVED_COUNTS = 100
#: The noise is then assumed to be at least this fraction of the configured noise.
MIN_NOISE_FRACTION = 0.5
#: Counts below this fraction of the converter's range are no fault: a dark electrode may stay at 0.
DARK_FRACTION = 0.01
#: Time, s, and number of samples in a row for which the layers of a detector measure different
#: currents until an electrode counts as faulty.
UNEQUAL_S, UNEQUAL_SAMPLES = 5e-3, 3
#: Time over which the fraction of poses with a residual beyond chance is averaged, s.
MISFIT_S = 0.5


def frozen_parts() -> list[tuple[str, NDArray[np.intp], NDArray[np.intp]]]:
    """Return the parts that may be frozen: all, then each detector, then each electrode.

    Each part has a sentence, its electrodes and the other electrodes, which must then move.
    """
    every = np.arange(12)
    names = [f"detector {name.upper()}" for name in DETECTORS]
    parts = [(name, every[4 * k : 4 * k + 4]) for k, name in enumerate(names)]
    parts += [(f"electrode {k % 4 + 1} of {names[k // 4]}", every[k : k + 1]) for k in range(12)]
    what = "does not change while the others do"
    more = [(f"{name} {what}", part, np.delete(every, part)) for name, part in parts]
    return [("the readings do not change", every, every[:0]), *more]


PARTS = frozen_parts()
BEYOND, FULL, COLD = "beyond chance", "saturated", "without a temperature"


class Trust:
    """Whether a stage may follow the newest samples at all.

    fault: the fault of the newest counts, or ''.  misfit: fraction of poses with a residual beyond
    chance.  same: (13,) number of samples since the count of each of the 12 electrodes changed, and
    since both layers of each duo-lateral detector had equal currents.  changed: (13,) the times of
    these samples, s.  then: (13, 12) their counts.
    """

    def __init__(self, config: Config) -> None:
        self.electronics, self.stale = config.electronics, config.stage.stale
        self.fault = ""
        self.last = np.full((1, 12), -(2**31))
        self.same, self.changed, self.then = np.zeros(13), np.full(13, inf), np.zeros((13, 12))
        self.misfit, self.judged = 0.0, inf

    def add_samples(self, samples: RawSamples, flags: NDArray[np.uint8], time: Floats) -> None:
        """Add samples with their flags and times (n,) on the host's clock, s."""
        counts = samples.counts
        rows = np.concatenate([self.last, counts])
        changes = rows[1:] != rows[:-1]
        is_equal = flags & (SATURATED | UNEQUAL) != UNEQUAL
        signs = np.column_stack([changes, is_equal])
        came, after = signs.any(axis=0), signs[::-1].argmax(axis=0)
        newest = len(counts) - 1 - after[came]
        self.same = np.where(came, after, self.same + len(counts))
        self.changed[came], self.then[came] = time[newest], counts[newest]
        self.last = counts[-1:]
        lasted = float(time[-1]) - self.changed
        self.fault = self.unequal_layers(lasted[12]) or self.frozen_counts(
            lasted[:12] > self.stale, bool(samples.kind[-1] == ELECTRODES)
        )

    def unequal_layers(self, lasted: float) -> str:
        """Return the fault of a detector whose layers have measured different currents for this
        time, s, after equal ones; '' if there is none."""
        if lasted < UNEQUAL_S or self.same[12] < UNEQUAL_SAMPLES:
            return ""
        k = int(np.abs(self.last.reshape(3, 4) @ [1, 1, -1, -1]).argmax())
        return f"the two layers of detector {DETECTORS[k].upper()} measure different currents"

    def frozen_counts(self, lasted: NDArray[np.bool_], has_electrodes: bool) -> str:
        """Return a sentence on counts that noise should change but that stay the same, or ''.

        lasted: (12,) whether a count stays the same for longer than `stage.stale_ms`.  A single
        electrode of a duo-lateral detector is found by the layers' currents instead.
        """
        count = (4 if has_two_layers(self.electronics) else len(PARTS)) if has_electrodes else 1
        for words, part, others in PARTS[: count if lasted.any() else 0]:
            if lasted[part].all() and not lasted[others].any() and self.is_frozen(part, others):
                return words
        return ""

    def is_frozen(self, part: NDArray[np.intp], others: NDArray[np.intp]) -> bool:
        """Whether the counts of a part (indices of electrodes) stay the same for a reason other
        than chance."""
        counts, noise_fraction = self.last[0], 1.0
        if len(others):
            noise_fraction, most = MIN_NOISE_FRACTION, 2**self.electronics.adc_bits - 1
            moved = np.abs(counts - self.then[part[0]])[others].max()
            size = np.abs(counts[part])
            if moved <= MOVED_COUNTS or not DARK_FRACTION * most < size.min() <= size.max() < most:
                return False
        independent = max(1.0, 0.75 * len(part))
        chance = independent * self.log_chance(counts[part], noise_fraction)
        return bool(self.same[part].min() * chance < log(FROZEN_CHANCE))

    def log_chance(self, counts: NDArray[np.int32], noise_fraction: float) -> float:
        """Logarithm of the largest probability that the next sample repeats one of these counts
        (m,), at a fraction of the configured noise.

        The probability is largest for a current in the middle of a converter's step.
        """
        per_ampere = counts_per_ampere(self.electronics)
        noise = current_variances(self.electronics, counts / per_ampere)[..., :-1].sum(axis=-1)
        steps = max(noise_fraction * per_ampere * float(noise.min()) ** 0.5, 1e-9)
        return log(erf(0.5 / 2**0.5 / steps))

    def add_poses(self, solution: Solution, time: float) -> None:
        """Add the poses of samples, the last of which has a time, s."""
        judged = solution.converged & (solution.checks > 0)
        if judged.any():
            weight = min(max(time - self.judged, 0.0) / MISFIT_S, 1.0)
            self.misfit += weight * (float(solution.misfit[judged].mean()) - self.misfit)
            self.judged = time

    @property
    def doubt(self) -> str:
        """The reason not to follow the newest samples, or ''."""
        misfit = "most poses have a residual beyond chance" if self.misfit > 0.5 else ""
        return self.fault or misfit


class Doubts:
    """Counts the newest samples for which there is a reason to distrust the pose.

    floor: (3,) least power of each detector that counts as light, mW.
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
        """Add samples: readings (n, 9) and flags (n,).

        beyond: (n,) whether the residual is beyond chance.  unknown: (n,) whether the sample lacks
        the temperature that the sensor's model needs.
        """
        self.samples += len(flags)
        is_dark = (
            readings[:, 2::3] < self.floor
        )  # false where a detector is saturated, and reads NaN
        signs = {COLD: unknown, BEYOND: beyond, FULL: flags & SATURATED}
        for name, has_doubt in (signs | dict(zip(DETECTORS, is_dark.T, strict=True))).items():
            self.counts[name] += int(np.count_nonzero(has_doubt))
        if self.samples >= LOOKED_AT:
            self.said = self.sentences()
            self.samples = 0
            self.counts.clear()

    def sentences(self) -> list[str]:
        """Return a sentence for each doubt that concerns more than `NOTICED` of the samples."""
        doubts = {
            BEYOND: "poses have a residual beyond chance: do not trust them",
            FULL: "samples are saturated: there is too much light, or "
            "sensor.electronics.transimpedance_kohm is too high",
            COLD: f"samples have no value of {TEMPERATURE_COLUMN} from "
            f"{describe_bounds(TEMPERATURE_COLUMN)}, which sensor.temperature needs, and "
            "therefore no pose",
        }
        sentences = [
            f"{self.percent(name)} of the newest {what}"
            for name, what in doubts.items()
            if self.fraction(name) > NOTICED
        ]
        lost = [name for name in DETECTORS if self.fraction(name) > NOTICED]
        if lost:
            most = max(lost, key=self.fraction)
            names = ", ".join(name.upper() for name in lost)
            what = "detectors" if len(lost) > 1 else "detector"
            sentences.append(
                f"light is lost on {what} {names}, in {self.percent(most)} of the newest samples"
            )
        return sentences

    def fraction(self, name: str) -> float:
        """Return the fraction of the samples to which a doubt applies."""
        return self.counts[name] / max(1, self.samples)

    def percent(self, name: str) -> str:
        """The fraction of samples with a doubt, as a percentage in text."""
        return f"{100 * self.fraction(name):.0f} %"
