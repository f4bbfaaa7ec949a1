"""Samples, and the poses that are solved from them: the same for tables, runs and simulations."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..core.units import Booleans, Floats, Integers
from .columns import solution_columns
from .solution import Solution


@dataclass(frozen=True)
class Samples:
    """Readings that are solved together, and what was measured beside each of them.

    Attributes
    ----------
    readings
        (n, 9) of one instant each (`align`), as the detectors gave them; mm and mW.
    numbers
        (n,) of the samples; by default from 1.
    time
        (n,) s; None where it is not known.
    temperature
        (n,) degrees Celsius, NaN where it is missing; None without a thermometer.
    place
        (n, 2) where the beam was measured to be, without `solve.beam_offset_um` and what follows
        the temperature, mm; where it is NaN there is no pose. None: at the origin.
    place_sigma
        Standard uncertainty of `place`, mm, infinite where nothing is known of it; None: as the
        configuration's `solve` says.
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


@dataclass(frozen=True)
class Poses:
    """What became of some samples.

    solution: of each sample.  members: (n,) whether it belongs to the zero and fits its readings.
    object: the columns of the measured object, of displacements from a zero, and of covariances,
    each (n,); see `Measurement`.
    """

    solution: Solution
    members: Booleans
    object: dict[str, Floats] = field(default_factory=dict)

    def columns(self) -> dict[str, Any]:
        """The poses as columns of numbers, without what was measured beside them."""
        return solution_columns(self.solution) | self.object
