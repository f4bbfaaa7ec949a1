"""The largest scaling of the box of poses for which the proof succeeds.

The result is the same on every machine, because the amount of work is limited, not the time.
"""

from __future__ import annotations

from collections.abc import Sequence

from ..characterization.state_box import StateBox
from ..core.sensor import Sensor
from .uniqueness import Certificate, Effort, certify

#: Largest scaling that is tried.
LARGEST_SCALING = 20.0
#: The factor grows by this, and then by its roots, until it is known this accurately.
FIRST_STEP, LAST_STEP = 1.5, 0.03
#: Largest number of pieces for a proof: no proof that succeeded near the limit took more.
MOST_PIECES = 2000


def find_reach(
    sensor: Sensor,
    box: StateBox,
    share: float,
    tolerances: Sequence[float] | None = None,
    farthest: float = LARGEST_SCALING,
    work: int = MOST_PIECES,
) -> tuple[float, Certificate | None]:
    """Find the largest tried factor at which the box is proved unique, and its certificate.

    The box grows about zero, and its least share stays. Returns 1.0 and None if no larger box is
    proved; `farthest` if every one is. A larger box may still be one-to-one: this is a lower bound.
    """
    proved: tuple[float, Certificate | None] = (1.0, None)
    factor, step = 1.0, FIRST_STEP
    while step > 1 + LAST_STEP:
        grown = min(factor * step, farthest)
        if grown > factor:
            larger = StateBox(grown * box.low, grown * box.high)
            certificate = certify(sensor, larger, share, tolerances, Effort(work))
            if certificate.unique:
                factor, proved = grown, (grown, certificate)
                continue
        step = step**0.5
    return proved


#: The factor by which the box shrinks until it is proved, the most times, and the work for each.
SHRINK_FACTOR, MAX_SHRINKS, SHRUNK_WORK = 0.7, 7, 300


def find_core(
    sensor: Sensor,
    box: StateBox,
    share: float,
    tolerances: Sequence[float] | None = None,
    work: int = SHRUNK_WORK,
) -> tuple[float, Certificate | None]:
    """Find the largest tried factor below 1 at which the box of poses is proved unique, and its
    certificate; 0.0 and None if there is none. The box shrinks about its middle."""
    middle = (box.low + box.high) / 2
    for step in range(1, MAX_SHRINKS + 1):
        factor = SHRINK_FACTOR**step
        low, high = (middle + factor * (end - middle) for end in (box.low, box.high))
        certificate = certify(sensor, StateBox(low, high), share, tolerances, Effort(work))
        if certificate.unique:
            return factor, certificate
    return 0.0, None
