"""Find two states with the same readings: next to a singular state, then within a box of states.

At a singular Jacobian the readings fold: states with the same readings lie on both sides, along the
direction of the weakest response. Such pairs form a surface of eight dimensions out of sixteen. A
pair on this surface is moved along it until both of its states lie in the box.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.names import FINE_UNITS
from ..core.sensor import Sensor
from ..core.units import Floats
from ..detectors.noise import standard_deviations
from ..estimation.solver import local_solution
from ..model.arrays import readings
from .singularity import measures, weakest_direction
from .state_box import StateBox

#: Distances of pairs from the singular state, largest first: fractions of FARTHEST_UM_URAD.
REACHES = np.geomspace(1, 1e-3, 25)
#: Largest component of the farthest step along the direction, um or urad.
FARTHEST_UM_URAD = 3000.0
#: Readings that differ by less than this, in standard deviations, are equal.
EQUAL_SIGMAS = 1e-6
#: Largest number of steps along the weakest direction to a singular state.
MAX_STEPS = 400
#: Length of a step along the weakest direction, um or urad.
STEP_UM_URAD = 100.0
#: Half the distances at which pairs are moved into the box, as fractions of FARTHEST_UM_URAD.
DISTANCES = np.array([0.03, 0.3, 1.0, 3.0])
#: How far pairs are moved into the box, in its half widths.
INSIDE = 1 - 1e-3
#: Weight of these limits relative to differences of readings in standard deviations.
LIMIT_WEIGHT = 10.0


@dataclass(frozen=True)
class AmbiguousPair:
    """Two states (8,) with equal readings, and places on the straight line through both.

    position: (n,) of the places, 0 at the first state and 1 at the second.  difference: (n,) root
    of the sum of squares of the readings' differences from those of the two states, in standard
    deviations.  determinant: (n,) of Eq. (11).
    """

    first: Floats
    second: Floats
    position: Floats
    difference: Floats
    determinant: Floats


def find_ambiguous_pair(sensor: Sensor, near: Floats) -> AmbiguousPair | None:
    """Find the pair furthest apart about a nearly singular state (8,), if there is one."""
    direction = weakest_direction(sensor, near) * FINE_UNITS
    direction *= FARTHEST_UM_URAD / np.abs(direction / FINE_UNITS).max()
    for reach in REACHES:
        for side in (1, -1):
            first = near + side * reach * direction
            measured = readings(sensor, first)
            second, residual = local_solution(sensor, measured, near - side * reach * direction)
            gap = np.linalg.norm((second - first) / FINE_UNITS) / np.linalg.norm(
                direction / FINE_UNITS
            )
            if residual < EQUAL_SIGMAS and gap > reach:
                return pair_between(sensor, first, second)
    return None


def find_pair_in_box(
    sensor: Sensor, box: StateBox, least_share: float, near: Floats
) -> AmbiguousPair | None:
    """Find two states of a certificate's set with equal readings, from a weak state (8,).

    least_share: fraction of the light that each facet has at least. Returns None if there is no
    such pair about the singular state along the weakest direction.
    """
    from scipy.optimize import least_squares

    fold = find_singular_state(sensor, near)
    if fold is None:
        return None
    tight = {"jac": "3-point", "xtol": 1e-15, "ftol": 1e-15, "gtol": 1e-15, "max_nfev": 200}
    for reach in DISTANCES * FARTHEST_UM_URAD:
        direction = weakest_direction(sensor, fold)
        direction *= reach / np.abs(direction).max()
        begin = np.concatenate([fold / FINE_UNITS - direction, fold / FINE_UNITS + direction])
        limits = (least_share, float(np.linalg.norm(direction)))
        result = least_squares(pair_residuals, begin, args=(sensor, box, *limits), **tight)
        if np.abs(result.fun).max() < EQUAL_SIGMAS:
            first, second = result.x.reshape(2, 8) * FINE_UNITS
            return pair_between(sensor, first, second)
    return None


def pair_residuals(
    fine: Floats, sensor: Sensor, box: StateBox, least_share: float, least_distance: float
) -> Floats:
    """Residuals of a pair of states (16,), um and urad: differences of its readings, and violations
    of the least distance and of a certificate's set; all zero for a pair that is sought."""
    pair = fine.reshape(2, 8) * FINE_UNITS
    middle, half = (box.low + box.high)[:6] / 2, np.maximum((box.high - box.low)[:6] / 2, 1e-9)
    measured = readings(sensor, pair)
    near = 2 - 2 * np.linalg.norm(fine[8:] - fine[:8]) / least_distance
    outside = np.abs((pair[:, :6] - middle) / half) - INSIDE
    with np.errstate(all="ignore"):
        missing_light = np.log(least_share * sensor.beam.power / measured[:, 2::3]) + 1 - INSIDE
    limits = np.maximum(np.concatenate([[near], outside.ravel(), missing_light.ravel()]), 0.0)
    differences = (measured[1] - measured[0]) / standard_deviations(sensor, measured[0])
    residuals = np.concatenate([differences, LIMIT_WEIGHT * limits])
    return np.asarray(np.nan_to_num(residuals, nan=1e6, posinf=1e6, neginf=-1e6))


def find_singular_state(sensor: Sensor, near: Floats) -> Floats | None:
    """Find a zero of the determinant along the weakest direction from a state (8,), if any."""
    sign = np.sign(measures(sensor, near[None], spectra=False)[0, 0])
    for side in (1.0, -1.0):
        state, before = near.copy(), side * weakest_direction(sensor, near)
        for _ in range(MAX_STEPS):
            ahead = weakest_direction(sensor, state)
            ahead *= np.sign(ahead @ before) or 1.0
            moved = state + STEP_UM_URAD * ahead * FINE_UNITS
            value = measures(sensor, moved[None], spectra=False)[0, 0]
            if not np.isfinite(value):
                break
            if np.sign(value) != sign:
                return narrow_down(sensor, state, moved, sign)
            state, before = moved, ahead
    return None


def narrow_down(sensor: Sensor, near: Floats, far: Floats, sign: float) -> Floats:
    """Find the singular state (8,) between two states (8,) whose determinants have different signs.
    sign: that at `near`."""
    for _ in range(40):
        middle = (near + far) / 2
        same = np.sign(measures(sensor, middle[None], spectra=False)[0, 0]) == sign
        near, far = (middle, far) if same else (near, middle)
    state: Floats = (near + far) / 2
    return state


def pair_between(sensor: Sensor, first: Floats, second: Floats) -> AmbiguousPair:
    """Evaluate the readings and the determinant on the line through two states (8,)."""
    position = np.linspace(-0.15, 1.15, 131)
    states = first + position[:, None] * (second - first)
    measured = readings(sensor, states)
    sigma = standard_deviations(sensor, readings(sensor, first))
    difference = np.sqrt((((measured - readings(sensor, first)) / sigma) ** 2).sum(axis=1))
    return AmbiguousPair(
        first, second, position, difference, measures(sensor, states, spectra=False)[:, 0]
    )
