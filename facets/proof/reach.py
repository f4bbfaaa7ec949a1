"""By how much the box of poses can grow and still be proved, or has to shrink until it is.

The same on every machine: what is limited is the work, not the time.
"""

from __future__ import annotations

from collections.abc import Sequence

from ..characterization.state_box import StateBox
from ..core.sensor import Sensor
from .uniqueness import Certificate, certify

#: No box is made more than so many times as large.
FARTHEST = 20.0
#: The factor grows by this, and then by its roots, until it is known so well.
STEP, PRECISE = 1.5, 0.03
#: Pieces that a proof may take: none of a sensor near what can be proved took more.
MOST_PIECES = 2000


def find_reach(
    sensor: Sensor,
    box: StateBox,
    share: float,
    tolerances: Sequence[float] | None = None,
    farthest: float = FARTHEST,
    work: int = MOST_PIECES,
) -> tuple[float, Certificate | None]:
    """The largest factor tried at which the box of poses is proved unique, and its certificate.

    The box grows about zero, its least share stays. 1.0 and none where no larger box is proved;
    `farthest` where every one is. A larger one may still be one-to-one: this is a lower bound.
    """
    proved: tuple[float, Certificate | None] = (1.0, None)
    factor, step = 1.0, STEP
    while step > 1 + PRECISE:
        grown = min(factor * step, farthest)
        if grown > factor:
            larger = StateBox(grown * box.low, grown * box.high)
            found = certify(sensor, larger, share, tolerances=tolerances, work=work)
            if found.unique:
                factor, proved = grown, (grown, found)
                continue
        step = step**0.5
    return proved


#: By what the box shrinks until it is proved, at most so many times, and the work for each.
SHRINK, SHRINKS, SHRUNK_WORK = 0.7, 7, 300


def find_core(
    sensor: Sensor,
    box: StateBox,
    share: float,
    tolerances: Sequence[float] | None = None,
    work: int = SHRUNK_WORK,
) -> tuple[float, Certificate | None]:
    """The largest factor tried below 1 at which the box of poses is proved unique, and its
    certificate; 0.0 and none where none is. The box shrinks about its middle."""
    middle = (box.low + box.high) / 2
    for step in range(1, SHRINKS + 1):
        factor = SHRINK**step
        low, high = (middle + factor * (end - middle) for end in (box.low, box.high))
        found = certify(sensor, StateBox(low, high), share, tolerances=tolerances, work=work)
        if found.unique:
            return factor, found
    return 0.0, None
