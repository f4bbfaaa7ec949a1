"""The fraction of the time for which a beam that should follow the mirror was lost."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...core.units import Floats


@dataclass
class BeamLoss:
    """Counts samples without a pose since the stage first moved, in which the beam was lost.

    solved: number of samples.  lost: number of samples without a pose.  begin, end: times of the
    first and the last sample, s.
    """

    solved: int = 0
    lost: int = 0
    begin: float = np.inf
    end: float = -np.inf

    def add(self, times: Floats, has_pose: NDArray[np.bool_], begun: float) -> None:
        """Add samples at times (n,), s.  begun: time of the stage's first move, s."""
        since = times >= begun
        if since.any():
            self.solved += int(np.count_nonzero(since))
            self.lost += int(np.count_nonzero(since & ~has_pose))
            self.begin = min(self.begin, float(times[since][0]))
            self.end = max(self.end, float(times[-1]))

    @property
    def share(self) -> float:
        """Fraction of the time for which the beam was lost; NaN if the stage never moved."""
        return self.lost / self.solved if self.solved else float("nan")

    @property
    def sentence(self) -> str:
        """The fraction of time and the seconds of lost beam, as a sentence."""
        if not self.solved:
            return "The stage never moved, because there was no pose to follow."
        seconds = self.end - self.begin
        if not self.lost:
            return f"The beam was never lost in the {seconds:.1f} s since the stage first moved."
        return (
            f"The beam was lost for {100 * self.share:.2g} % of the time, "
            f"{self.share * seconds:.2g} s of the {seconds:.1f} s since the stage first moved."
        )
