"""Whether two halves of the samples find the same sensor.

At the unknowns x of a fit, the normal equations of one half are F_h, s_h, with what was known
before, P: s_1 + s_2 = P (x - x_0). Each half by itself would end at x + C_h (s_h - s_1 - s_2), with
C_h = (F_h + P)^-1, so that both are C_2 s_1 - C_1 s_2 apart, and chance alone makes that

    C_1 F_1 C_1 + C_2 F_2 C_2 + (C_1 - C_2) P (C_1 - C_2).

No residual needs to show what changed: what each half takes for another sensor, the halves show.
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

#: Chances below which errors, or halves that differ, widen what is stated, and forbid the use.
WIDER_CHANCE, WRONG_CHANCE = 1e-2, 1e-4


class HalfDifference(NamedTuple):
    """How far two halves of the samples are apart.

    words: which halves.  shift: of the fit's unknowns (p,).  size, stated: of poses in each axis,
    r.m.s., as they are and by chance (6,), um and urad.  chance: of such a difference (6,).
    """

    words: str
    shift: Floats
    size: Floats
    stated: Floats
    chance: Floats

    @property
    def least_chance(self) -> float:
        """The chance of the least likely of all axes (Sidak), of both ways to halve the samples."""
        return float(-np.expm1(2 * len(self.chance) * np.log1p(-self.chance.min())))


@one_thread
def compare_halves(remainder: Remainder) -> list[HalfDifference]:
    """The halves by time and the interleaved ones."""
    row = np.arange(len(remainder.noise))
    halves = {
        "first and the second half": 2 * row < len(row),
        "even and the odd ones": row % 2 == 0,
    }
    return [half_difference(remainder, words, first) for words, first in halves.items()]


def half_difference(remainder: Remainder, words: str, first: Booleans) -> HalfDifference:
    size, matrices, sides = len(remainder.matrix), [], []
    for rows in (first, ~first):
        flat = remainder.likelihood.common[rows].reshape(-1, size)
        matrices.append(flat.T @ remainder.weighted[rows].reshape(-1, size))
        sides.append(flat.T @ remainder.pulled[rows].ravel())
    prior = remainder.matrix - sum(matrices)
    known, beside = (np.linalg.inv(matrix + prior) for matrix in matrices)
    apart = known - beside
    covariance = known @ matrices[0] @ known + beside @ matrices[1] @ beside + apart @ prior @ apart
    shift: Floats = beside @ sides[0] - known @ sides[1]
    expected = covariance_factor(remainder.fit) * covariance
    return HalfDifference(words, shift, *pose_chances(pose_slopes(remainder), shift, expected))


def pose_chances(
    slopes: PoseSlopes, shift: Floats, covariance: Floats
) -> tuple[Floats, Floats, Floats]:
    """How far a shift of the unknowns (p,) moves poses in each axis, r.m.s. (6,), how far chance
    moves them that makes such a covariance, and the chance of as much."""
    by_unknowns = slopes.by_unknowns
    square = np.einsum("nip,niq->ipq", by_unknowns, by_unknowns, optimize=True) / len(by_unknowns)
    expected = square @ covariance
    mean = np.trace(expected, axis1=1, axis2=2)
    freedom = mean**2 / np.einsum("ipq,iqp->i", expected, expected)
    level = np.einsum("p,ipq,q->i", shift, square, shift)
    chance = [chance_of(*pair) for pair in np.transpose([freedom * level / mean, freedom])]
    return np.sqrt(level), np.sqrt(mean), np.array(chance)


def half_findings(halves: list[HalfDifference]) -> list[Finding]:
    """Findings on halves that are further apart than chance allows."""
    findings = []
    for half in halves:
        n = int(np.argmin(half.chance))
        if half.least_chance < WIDER_CHANCE:
            findings.append(Finding(half.least_chance < WRONG_CHANCE, (
                f"By themselves, the {half.words} of the samples give poses that differ by "
                f"{half.size[n]:.2g} {'urad' if POSE[n] in ANGLES else 'um'} in {POSE[n]} "
                f"(r.m.s.), where {half.stated[n]:.2g} is stated for the difference: something "
                "changed, or another model holds, and no residual shows it. Find out what follows "
                "the time, and calibrate again."
            )))  # fmt: skip
    return findings


def half_covariance(halves: list[HalfDifference]) -> Floats:
    """What the unknowns (p, p) may be wrong by where halves disagree: the mean of both is as far
    from each."""
    shifts = np.array([half.shift * (half.least_chance < WIDER_CHANCE) for half in halves]) / 2
    return shifts.T @ shifts
