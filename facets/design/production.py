"""Heads built by simulation, with the model itself, to check the predictions of `tolerancing`.

Each head is drawn, its margins are computed, and its poses are solved with the design's parameters.
If heads are calibrated, the head is calibrated from noisy readings as `facets calibrate` does, and
its poses are solved again. Nothing is expanded.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..core.errors import InputError
from ..core.small_matrices import one_thread
from ..core.units import Floats
from .assembly import Assembly, calibrate_head
from .requirement import accuracy_margins, errors_of, margins_of

OnProgress = Callable[[int, int], None]


@dataclass(frozen=True)
class SimulatedHeads:
    """The results of simulated heads.

    kept: (n,) the least margin of spots, light and limits.  built, known: (n,) the least margin of
    accuracy as built and calibrated, NaN without an accuracy limit or without a calibration.
    errors: (n, 2, 6) the largest errors in the volume, likewise; um and urad.  unsettled: number of
    heads whose calibration did not converge; they count as failed.
    """

    kept: Floats
    built: Floats
    known: Floats
    errors: Floats
    unsettled: int


@one_thread
def simulate_heads(
    built: Assembly, count: int, seed: int, on_progress: OnProgress = lambda done, whole: None
) -> SimulatedHeads:
    """Simulate `count` heads; the same seed gives the same heads."""
    rng = np.random.default_rng(seed)
    rows, errors, unsettled = np.full((count, 3), np.nan), np.full((count, 2, 6), np.nan), 0
    for n in range(count):
        on_progress(n, count)
        z = rng.normal(size=len(built.choice.names)) * built.loose
        try:
            head = built.head(z)
        except InputError:  # the drawn parameters give no pyramid or no beam
            rows[n] = -1.0
            continue
        rows[n, 0] = margins_of(built.asked, head).min()
        if not built.asked.accuracy_axes:
            continue
        errors_of_head = [errors_of(built.asked, head, built.sensor)]
        if built.asked.layout.calibrated:
            fitted = calibrate_head(built, head, rng)
            unsettled += not fitted.ended
            errors_of_head.append(errors_of(built.asked, head, fitted.sensor))
        for which, each in enumerate(errors_of_head):
            rows[n, 1 + which] = accuracy_margins(built.asked, each).min()
            errors[n, which] = np.abs(each).max(axis=0)
        if built.asked.layout.calibrated and not fitted.ended:
            rows[n, 2] = -1.0
    return SimulatedHeads(rows[:, 0], rows[:, 1], rows[:, 2], errors, unsettled)


def count_passes(heads: SimulatedHeads) -> dict[str, int]:
    """Count the heads that keep spots, light and limits; and accuracy as built, and calibrated."""
    kept = heads.kept >= 0
    return {
        "kept": int(kept.sum()),
        "built": int((kept & (heads.built >= 0)).sum()),
        "calibrated": int((kept & (heads.known >= 0)).sum()),
    }


def interval(passed: int, count: int) -> tuple[float, float]:
    """The 95 % interval of a share, after `passed` of `count` heads (Wilson)."""
    from scipy.stats import binomtest

    ends = binomtest(passed, count).proportion_ci(0.95, method="wilson")
    return float(ends.low), float(ends.high)
