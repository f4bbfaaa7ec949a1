"""Comparison of the sensors that two halves of the samples yield.

At the unknowns x of a fit, the normal equations of one half are F_h, s_h, with the prior
information P: s_1 + s_2 = P (x - x_0). Each half alone would end at x + C_h (s_h - s_1 - s_2), with
C_h = (F_h + P)^-1. So the halves differ by C_2 s_1 - C_1 s_2, whose covariance by chance alone is

    C_1 F_1 C_1 + C_2 F_2 C_2 + (C_1 - C_2) P (C_1 - C_2).

The halves also show changes that leave no residual, because each fits them as another sensor.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..core.names import ANGLES, POSE
from ..core.small_matrices import one_thread
from ..core.units import Booleans, Floats
from .alternatives.alternative import Finding, chance_of
from .alternatives.judge import PoseSlopes, pose_slopes
from .alternatives.remainder import Remainder
from .alternatives.scatter import covariance_factor

#: Probabilities of errors, or of differences of halves, below which the stated uncertainty is
#: widened, and the result refused.
WIDER_CHANCE, WRONG_CHANCE = 1e-2, 1e-4


class HalfDifference(NamedTuple):
    """The difference of two halves of the samples.

    words: their names.  shift: the difference of the fit's unknowns (p,).  size, stated: the r.m.s.
    differences of poses in each axis (6,), observed and expected by chance, um and urad.  chance:
    the probability of such a difference (6,).
    """

    words: str
    shift: Floats
    size: Floats
    stated: Floats
    chance: Floats

    @property
    def least_chance(self) -> float:
        """The probability of the least likely difference of all axes and of both pairs of halves
        (Sidak)."""
        return float(-np.expm1(2 * len(self.chance) * np.log1p(-self.chance.min())))


@one_thread
def compare_halves(remainder: Remainder) -> list[HalfDifference]:
    """Compare the halves by time, and the interleaved halves."""
    row = np.arange(len(remainder.noise))
    halves = {
        "first and the second half": 2 * row < len(row),
        "even and the odd rows": row % 2 == 0,
    }
    return [half_difference(remainder, words, first) for words, first in halves.items()]


def half_difference(remainder: Remainder, words: str, first: Booleans) -> HalfDifference:
    """The difference of the sensors from the two halves of samples. first: (n,), which samples are
    in the first half. words: the name of the halves."""
    size, matrices, sides = len(remainder.matrix), [], []
    for rows in (first, ~first):
        flat = remainder.likelihood.common[rows].reshape(-1, size)
        matrices.append(flat.T @ remainder.weighted[rows].reshape(-1, size))
        sides.append(flat.T @ remainder.pulled[rows].ravel())
    prior = remainder.matrix - sum(matrices)
    first_half, second_half = (np.linalg.inv(matrix + prior) for matrix in matrices)
    difference = first_half - second_half
    covariance = (
        first_half @ matrices[0] @ first_half + second_half @ matrices[1] @ second_half
        + difference @ prior @ difference
    )  # fmt: skip
    shift: Floats = second_half @ sides[0] - first_half @ sides[1]
    expected = covariance_factor(remainder.fit) * covariance
    return HalfDifference(words, shift, *pose_chances(pose_slopes(remainder), shift, expected))


def pose_chances(
    slopes: PoseSlopes, shift: Floats, covariance: Floats
) -> tuple[Floats, Floats, Floats]:
    """The r.m.s. shifts of poses (6,) by a shift of the unknowns (p,), those expected with a
    covariance (p, p), and the probability of shifts as large."""
    by_unknowns = slopes.by_unknowns
    square = np.einsum("nip,niq->ipq", by_unknowns, by_unknowns, optimize=True) / len(by_unknowns)
    expected = square @ covariance
    mean = np.trace(expected, axis1=1, axis2=2)
    freedom = mean**2 / np.einsum("ipq,iqp->i", expected, expected)
    level = np.einsum("p,ipq,q->i", shift, square, shift)
    chance = [chance_of(*pair) for pair in np.transpose([freedom * level / mean, freedom])]
    return np.sqrt(level), np.sqrt(mean), np.array(chance)


def half_findings(halves: list[HalfDifference]) -> list[Finding]:
    """Findings on halves that differ by more than chance allows."""
    findings = []
    for half in halves:
        n = int(np.argmin(half.chance))
        if half.least_chance < WIDER_CHANCE:
            findings.append(Finding(half.least_chance < WRONG_CHANCE, (
                f"Fitted separately, the {half.words} of the samples give poses that differ by "
                f"{half.size[n]:.2g} {'urad' if POSE[n] in ANGLES else 'um'} in {POSE[n]} "
                f"(r.m.s.), but the stated uncertainty of the difference is {half.stated[n]:.2g}: "
                "something changed during the calibration, or the model is incomplete, and no "
                "residual shows it. Find out what changed, and calibrate again."
            )))  # fmt: skip
    return findings


def half_covariance(halves: list[HalfDifference]) -> Floats:
    """The covariance (p, p) of the unknowns by halves that disagree: half of their difference, by
    which their mean differs from each."""
    shifts = np.array([half.shift * (half.least_chance < WIDER_CHANCE) for half in halves]) / 2
    return shifts.T @ shifts
