"""Find two states with the same readings: next to a singular state, then within a box of states.

At a singular Jacobian the readings fold: states with the same readings lie on both sides, along the
direction of the weakest response. Such pairs form a surface of eight dimensions out of sixteen; a
pair on this surface is moved, with equal readings, until both of its states lie in the box.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..core.names import FINE_UNITS
from ..core.sensor import Sensor
from ..core.units import Floats
from ..detectors.noise import standard_deviations
from ..estimation.solver import local_solution
from ..model.arrays import jacobian, readings
from .singularity import measures, weakest_direction
from .state_box import StateBox

#: Distances of pairs from the singular state, largest first: shares of FARTHEST_UM_URAD.
REACHES = np.geomspace(1, 1e-3, 25)
#: Largest component of the farthest step along the direction, um or urad.
FARTHEST_UM_URAD = 3000.0
#: Readings that differ by less than this, in standard deviations, are equal.
EQUAL_SIGMAS = 1e-6
#: Largest number of steps along the weakest direction to a singular state.
MAX_STEPS = 400
#: Length of a step along the weakest direction, um or urad.
STEP_UM_URAD = 100.0
#: Distances at which pairs are moved into the box, shares of FARTHEST_UM_URAD; moves for each.
DISTANCES, MOVES = (0.03, 0.3, 1.0, 3.0), 40
#: The power reading that follows from the other eight if the laser's power is known.
REDUNDANT_READING = 8


@dataclass(frozen=True)
class AmbiguousPair:
    """Two states (8,) with equal readings.

    share: (n,) of the straight line from the first to the second.  apart: (n,) root of the sum of
    squares of the readings' differences from those at the ends, in standard deviations.
    determinant: (n,).
    """

    first: Floats
    second: Floats
    share: Floats
    apart: Floats
    determinant: Floats


class PairSearch(NamedTuple):
    """The result of a search for a pair in a box.  pair: the pair nearest to the box, if there is
    one.  outside: its largest distance from the box, in half widths of the box or as the logarithm
    of a power; 0 for a pair in the box."""

    pair: AmbiguousPair | None
    outside: float


def find_ambiguous_pair(sensor: Sensor, near: Floats) -> AmbiguousPair | None:
    """Find the pair furthest apart about a nearly singular state (8,), if there is one."""
    direction = weakest_direction(sensor, near) * FINE_UNITS
    direction *= FARTHEST_UM_URAD / np.abs(direction / FINE_UNITS).max()
    for reach in REACHES:
        for side in (1, -1):
            first = near + side * reach * direction
            seen = readings(sensor, first)
            second, residual = local_solution(sensor, seen, near - side * reach * direction)
            gap = np.linalg.norm((second - first) / FINE_UNITS) / np.linalg.norm(
                direction / FINE_UNITS
            )
            if residual < EQUAL_SIGMAS and gap > reach:
                return pair_between(sensor, first, second)
    return None


def find_pair_in_box(sensor: Sensor, box: StateBox, share: float, near: Floats) -> PairSearch:
    """Find the pair of states nearest to a certificate's set, from a weak state (8,).

    share: least share of the light on each facet.
    """
    best = PairSearch(None, np.inf)
    fold = find_singular_state(sensor, near)
    if fold is None:
        return best
    for distance in DISTANCES:
        direction = weakest_direction(sensor, fold) * FINE_UNITS
        direction *= distance * FARTHEST_UM_URAD / np.abs(direction / FINE_UNITS).max()
        pair = np.concatenate([fold - direction, fold + direction])
        moved = move_into_box(sensor, box, share, pair)
        if moved is not None and moved[1] < best.outside:
            best = PairSearch(pair_between(sensor, moved[0][:8], moved[0][8:]), moved[1])
        if best.outside == 0:
            break
    return best


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
    """Find the singular state between two states whose determinants have different signs."""
    for _ in range(40):
        middle = (near + far) / 2
        same = np.sign(measures(sensor, middle[None], spectra=False)[0, 0]) == sign
        near, far = (middle, far) if same else (near, middle)
    state: Floats = (near + far) / 2
    return state


def move_into_box(
    sensor: Sensor, box: StateBox, share: float, pair: Floats
) -> tuple[Floats, float] | None:
    """A pair (16,) with equal readings and its distance from the box; None if there is none."""
    scale = np.tile(FINE_UNITS, 2)
    length = np.linalg.norm((pair[8:] - pair[:8]) / FINE_UNITS)
    best: tuple[Floats, float] | None = None
    for _ in range(MOVES):
        seen, slopes = readings(sensor, pair.reshape(2, 8)), jacobian(sensor, pair.reshape(2, 8))
        if not (np.isfinite(seen).all() and np.isfinite(slopes).all()):
            break
        sigma = standard_deviations(sensor, seen[0])
        apart = (seen[1] - seen[0]) / sigma
        excess, slope = excess_of(sensor, box, share, pair, seen, slopes)
        outside = float(excess.max(initial=0.0))
        if np.abs(apart).max() < EQUAL_SIGMAS and (best is None or outside < best[1]):
            best = pair.copy(), outside
            if outside == 0:
                break
        gap = (pair[8:] - pair[:8]) / FINE_UNITS
        along = gap / np.linalg.norm(gap)
        rows = np.delete(
            np.hstack([-slopes[0], slopes[1]]) / sigma[:, None], REDUNDANT_READING, axis=0
        )
        equal = np.vstack([rows * scale, np.concatenate([-along, along])])
        missing = np.concatenate(
            [-np.delete(apart, REDUNDANT_READING), [length - np.linalg.norm(gap)]]
        )
        step = constrained_step(slope * scale, -excess, equal, missing)
        pair = pair + scale * step * min(1.0, 1e3 / np.abs(step).max(initial=1e-12))
    return best


def constrained_step(rows: Floats, target: Floats, equal: Floats, missing: Floats) -> Floats:
    """The step (16,) with equal . step = missing and with rows . step nearest to the target."""
    first = np.linalg.lstsq(equal, missing, rcond=1e-12)[0]
    free = np.linalg.svd(equal)[2][len(equal) :].T
    inner = rows @ free
    damped = inner.T @ inner + 1e-9 * np.eye(free.shape[1])
    step: Floats = first + free @ np.linalg.solve(damped, inner.T @ (target - rows @ first))
    return step


def excess_of(
    sensor: Sensor, box: StateBox, share: float, pair: Floats, seen: Floats, slopes: Floats
) -> tuple[Floats, Floats]:
    """The excess of a pair over each limit, 0 or more, (18,); its derivatives (18, 16)."""
    middle, half = (box.low + box.high)[:6] / 2, np.maximum((box.high - box.low)[:6] / 2, 1e-9)
    excess, slope = np.zeros(18), np.zeros((18, 16))
    for n in range(2):
        off = (pair[8 * n : 8 * n + 6] - middle) / half
        powers = seen[n, 2::3]
        short = np.log(share * sensor.beam.power / powers)
        part = slice(9 * n, 9 * n + 9)
        excess[part] = np.concatenate([np.abs(off) - 1, short])
        slope[9 * n : 9 * n + 6, 8 * n : 8 * n + 6] = np.diag(np.sign(off) / half)
        slope[9 * n + 6 : 9 * n + 9, 8 * n : 8 * n + 8] = -slopes[n, 2::3] / powers[:, None]
    inside = excess <= 0
    excess[inside], slope[inside] = 0.0, 0.0
    return np.where(inside, 0.0, excess + 1e-3), slope


def pair_between(sensor: Sensor, first: Floats, second: Floats) -> AmbiguousPair:
    """The pair of two states (8,) with equal readings, and the readings on the line through
    them."""
    share = np.linspace(-0.15, 1.15, 131)
    states = first + share[:, None] * (second - first)
    seen = readings(sensor, states)
    sigma = standard_deviations(sensor, readings(sensor, first))
    apart = np.sqrt((((seen - readings(sensor, first)) / sigma) ** 2).sum(axis=1))
    return AmbiguousPair(first, second, share, apart, measures(sensor, states, spectra=False)[:, 0])
