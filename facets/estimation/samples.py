"""Samples, and the poses that are solved from them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..core.arguments import check_arguments
from ..core.names import DETECTORS
from ..core.units import Booleans, Floats, Integers
from .result import DETECTOR_BITS
from .solution import Solution

if TYPE_CHECKING:
    from ..core.knowledge import Knowledge

#: The status of a row that is not numbers.
UNPARSABLE = "unparsable"


@check_arguments
@dataclass(frozen=True)
class Samples:
    """Readings that are solved together, and what was measured beside each of them.

    Attributes
    ----------
    readings
        (n, 9) of one instant each (`align`), as the detectors gave them; mm and mW.
    numbers
        (n,) numbers of the samples; by default from 1.
    time
        (n,) s; None where it is not known.
    temperature
        (n,) degrees Celsius, NaN where it is missing; None without a thermometer.
    place
        (n, 2) the beam's measured place, mm, without `solve.beam_offset_um` and without its shift
        by the temperature; a sample whose place is NaN gets no pose. None: at the origin.
    place_sigma
        Standard uncertainty of `place`, mm; infinite: the beam is free. None: what the
        configuration's `solve` says of the beam.
    saturated
        (n,) whether a converter was at its end; None where that is not known.
    """

    readings: Floats
    numbers: Integers = field(default_factory=lambda: np.empty(0, np.int64))
    time: Floats | None = None
    temperature: Floats | None = None
    place: Floats | None = None
    place_sigma: float | None = None
    saturated: Booleans | None = None

    def __post_init__(self) -> None:
        if not len(self.numbers):
            object.__setattr__(self, "numbers", 1 + np.arange(len(self.readings)))


class SampleEstimate(NamedTuple):
    """Samples that were solved.

    knowledge: what was known of the beam.  exact: the readings (n, 9) that were solved, those of
    perfect detectors at the reference temperature; NaN where the beam's place is missing.
    """

    solution: Solution
    knowledge: Knowledge
    exact: Floats


@dataclass(frozen=True)
class Poses:
    """The poses of some samples.

    Attributes
    ----------
    solution
        The solution of each sample.
    members
        (n,) whether a sample belongs to the zero, with a pose that fits its readings.
    object
        The columns (n,) of the measured object, of displacements from a zero, and of covariances
        and expanded uncertainties, by name; see `Measurement`.
    """

    solution: Solution
    members: Booleans
    object: dict[str, Floats] = field(default_factory=dict)

    def columns(self) -> dict[str, Any]:
        """The poses as columns of numbers, without what was measured beside them."""
        return self.solution.columns() | self.object


def detectors_of(used: ArrayLike) -> Booleans:
    """Whether each detector took part (n, 3), by a column `used`: bits, or letters."""
    column = np.asarray(used)
    if column.dtype.kind in "iu":
        return np.asarray(column[:, None] & DETECTOR_BITS > 0)
    words = column.astype(str)
    return np.stack([np.char.find(words, letter) >= 0 for letter in DETECTORS], axis=1)


def common_detectors(used: Booleans) -> Booleans:
    """The detectors (3,) that took part in all of some samples (n, 3); where these are fewer than
    two, the two that took part in most of them."""
    common = np.asarray(used.all(axis=0))
    if common.sum() < 2:
        common = np.arange(3) != int(np.argmin(used.sum(axis=0)))
    return common
