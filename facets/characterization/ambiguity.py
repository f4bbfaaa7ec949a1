"""Two states with the same readings, beside one where the Jacobian is singular."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.sensor import Sensor
from ..detectors.noise import standard_deviations
from ..estimation.solver import solve
from ..model.arrays import readings
from .singularity import measures, weakest_direction

Floats = NDArray[np.float64]

#: How far from the singular state twins are looked for, largest first: shares of FARTHEST.
REACHES = np.geomspace(1, 1e-3, 25)
#: Of the longest component of the direction, um or urad.
FARTHEST = 3000.0
#: Readings this near, in standard deviations, are the same.
EQUAL = 1e-6
UNITS = np.array([1e-3, 1e-3, 1e-3, 1e-6, 1e-6, 1e-6, 1e-3, 1e-3])


@dataclass(frozen=True)
class AmbiguousPair:
    """States (8,) one and other, whose readings are equal.

    share: (n,) from one to the other along a straight line.  apart: (n,) of the readings there from
    those at the ends, root of the sum of squares, standard deviations.  determinant: (n,).
    """

    one: Floats
    other: Floats
    share: Floats
    apart: Floats
    determinant: Floats


def find_ambiguous_pair(sensor: Sensor, near: Floats) -> AmbiguousPair | None:
    """The pair furthest apart that is found about a nearly singular state (8,), if any is."""
    direction = weakest_direction(sensor, near) * UNITS
    direction *= FARTHEST / np.abs(direction / UNITS).max()
    for reach in REACHES:
        for side in (1, -1):
            one = near + side * reach * direction
            seen = readings(sensor, one)
            found = solve(sensor, seen, start=near - side * reach * direction)
            gap = np.linalg.norm((found.state - one) / UNITS) / np.linalg.norm(direction / UNITS)
            if found.ok and found.residual < EQUAL and gap > reach:
                return between(sensor, one, found.state)
    return None


def between(sensor: Sensor, one: Floats, other: Floats) -> AmbiguousPair:
    share = np.linspace(-0.15, 1.15, 131)
    states = one + share[:, None] * (other - one)
    seen = readings(sensor, states)
    sigma = standard_deviations(sensor, readings(sensor, one))
    apart = np.sqrt((((seen - readings(sensor, one)) / sigma) ** 2).sum(axis=1))
    return AmbiguousPair(one, other, share, apart, measures(sensor, states, spectra=False)[:, 0])
