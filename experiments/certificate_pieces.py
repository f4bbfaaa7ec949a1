"""Check that a certificate's Jacobians are regular over its pieces and between any two states.

Over a piece about x, J(p) = J(x) + slopes (p - x), with slopes over all angles of the piece and at
the apex of x, since G is linear in the apex. Two states of
the box with equal readings would have a kernel in common with a mean of J over the way between
them: one of the hull of all J; and, since the mean of an affine L is its value in the middle, one
of L(middle) + the hull of J - L.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
from flint import arb, arb_mat

from .certificate_optics import IntervalDual, IntervalSensor, pose_of_box, span, spots
from .certificate_schema import Refused, refuse_unless

Rows = list[list[Any]]

#: Largest number of parts of the box that are examined as the middle of the way.
MOST = 4000
#: Largest number of cuts of one part to reach half of the file's margin.
DEPTH = 8


@dataclass
class CheckResult:
    """Verified lower bounds of the margin and of Eq. (11)'s |det|, and the claims left.

    not_verified: sentences about claims that were not verified.
    """

    margin: Fraction = Fraction(0)
    determinant: Fraction = Fraction(0)
    not_verified: list[str] = field(default_factory=list)


class Jacobian(NamedTuple):
    """Jacobian over a piece: `middle` (6, 6) is its value at `place` (6,), slopes[i][j][m] its
    derivatives by axis m over the whole piece, `off` (6,) the piece relative to `place`."""

    place: list[Any]
    off: list[Any]
    middle: Rows
    slopes: list[list[list[Any]]]

    def whole(self) -> Rows:
        return [
            [a + sum(d * by for d, by in zip(slope, self.off, strict=True))
             for a, slope in zip(row, rows, strict=True)]
            for row, rows in zip(self.middle, self.slopes, strict=True)
        ]  # fmt: skip


def jacobian_over(rig: IntervalSensor, piece: dict[str, Any], light: Any) -> Jacobian:
    pose = [span(a, b) for a, b in zip(piece["low"], piece["high"], strict=True)]
    place = [side.mid() for side in pose]
    off = [side - x for side, x in zip(pose, place, strict=True)]
    middle = [spot.slope for spot in spots(rig, place, light)]
    spots(rig, pose, light)  # refuses where a facet or a detector may face away
    carried = [spot.slope for spot in spots(rig, pose_of_box([*place[:3], *pose[3:]]), light)]
    slopes = [
        [x.slope if isinstance(x, IntervalDual) else [arb(0)] * 6 for x in row] for row in carried
    ]
    return Jacobian(place, off, middle, slopes)


def as_fraction(x: Any) -> Fraction:
    """Convert an exact number to a fraction."""
    value = x.fmpq()
    return Fraction(int(value.p), int(value.q))


def slope_of_powers(rig: IntervalSensor, content: dict[str, Any]) -> Any:
    """Lower bound of the ratio of Eq. (11) to the determinant of the 6 x 6 Jacobian.

    The ratio is d(power_a, power_b) / d(bx, by); the powers depend on q = across . (t - b) / sigma.
    So q turns with b by the parts of the two vectors across the beam that lie in the plane of x and
    y, whose determinant is the vertical part of their cross product: of the beam's direction. A
    beam that leans moves less across itself than its place does in the plane.
    """
    least = arb(content["light"]["slope"][0]) * rig.power.lower() ** 2
    return least * rig.down[2].abs_lower() / (rig.sigma[0] * rig.sigma[1])


def check_pieces(
    rig: IntervalSensor, content: dict[str, Any], found: CheckResult
) -> list[Jacobian]:
    """Compute the Jacobians over the pieces and check the bounds of their determinants."""
    slope, unverified = slope_of_powers(rig, content), 0
    jacobians, least = [], []
    for piece in content["pieces"]:
        jacobians.append(jacobian_over(rig, piece, content["light"]))
        size = determinant_of(jacobians[-1].whole()) * slope
        refuse_unless(not size.abs_upper() < arb(piece["at_least"]),
                      "a piece claims a larger determinant than it has")  # fmt: skip
        least.append(least_magnitude(size))
        unverified += least[-1] < Fraction(piece["at_least"])
    found.determinant = min(least)
    claims = min(Fraction(piece["at_least"]) for piece in content["pieces"])
    below = Fraction(content["least_determinant"]) <= claims
    refuse_unless(below or content.get("middles") is not None,
                  "least_determinant is more than its least piece claims")  # fmt: skip
    if unverified:
        found.not_verified.append(f"the bound of the determinant in {unverified} pieces")
    return jacobians


def least_magnitude(size: Any) -> Fraction:
    """Least absolute value of an interval; 0 if the interval is not finite."""
    return max(as_fraction(size.abs_lower()), Fraction(0)) if size.is_finite() else Fraction(0)


def middles_of(rows: Rows) -> Any:
    middles = np.array([[float(x.mid()) for x in row] for row in rows])
    refuse_unless(bool(np.isfinite(middles).all()), "no bounds of the Jacobian")
    return middles


def determinant_of(rows: Rows) -> Any:
    """Determinant of an interval matrix, from its product with an approximate inverse."""
    near = arb_mat(np.linalg.pinv(middles_of(rows)).tolist())
    return (near * arb_mat(rows)).det() / near.det()


def hull_of(matrices: list[Rows]) -> Rows:
    hull = matrices[0]
    for rows in matrices[1:]:
        hull = [[x.union(y) for x, y in zip(a, b, strict=True)]
                for a, b in zip(hull, rows, strict=True)]  # fmt: skip
    return hull


def margin_of(rows: Rows, inverse: Any, weights: Any) -> Fraction:
    """Margin by which |1 - C M| shrinks the weights for every M in the rows, or raise `Refused`."""
    margins, product = [], arb_mat(inverse) * arb_mat(rows)
    for i in range(6):
        row = arb(0)
        for j in range(6):
            row += (product[i, j] - (i == j)).abs_upper() * weights[j]
        refuse_unless(row < weights[i], f"the hull of the Jacobians may be singular: row {i + 1} of"
                      f" |1 - C M| times the weights is {row}, not below its own")  # fmt: skip
        margins.append(as_fraction((1 - row / weights[i]).lower()))
    return min(margins)


def check_hull(jacobians: list[Jacobian], content: dict[str, Any], found: CheckResult) -> None:
    """Check with the file's inverse and weights that the hull of all Jacobians is regular."""
    hull = hull_of([jacobian.whole() for jacobian in jacobians])
    found.margin = margin_of(hull, content["inverse"], content["weights"])
    note_margin(content, found)


def note_margin(content: dict[str, Any], found: CheckResult) -> None:
    if found.margin < Fraction(content["margin"]):
        found.not_verified.append(f"the margin of {content['margin']:.4g}")


class CertifiedAffine:
    """Affine map L of the file; a map far from the Jacobian weakens the proof but is valid."""

    def __init__(self, content: dict[str, Any]) -> None:
        self.place, self.value, self.slopes = (content[k] for k in ("place", "value", "slopes"))

    def evaluate(self, pose: list[Any]) -> Rows:
        off = [side - x for side, x in zip(pose, self.place, strict=True)]
        return [
            [arb(self.value[i][j]) + sum(arb(self.slopes[m][i][j]) * off[m] for m in range(6))
             for j in range(6)]
            for i in range(6)
        ]  # fmt: skip

    def rest(self, jacobian: Jacobian) -> Rows:
        """Enclose J - L over a piece."""
        at = self.evaluate(jacobian.place)
        return [
            [jacobian.middle[i][j] - at[i][j]
             + sum((jacobian.slopes[i][j][m] - arb(self.slopes[m][i][j])) * jacobian.off[m]
                   for m in range(6))
             for j in range(6)]
            for i in range(6)
        ]  # fmt: skip


def sum_of(one: list[list[Any]], other: list[list[Any]]) -> list[list[Any]]:
    """Sum of two matrices."""
    return [[x + y for x, y in zip(*pair, strict=True)] for pair in zip(one, other, strict=True)]


def check_middles(
    rig: IntervalSensor, jacobians: list[Jacobian], content: dict[str, Any], found: CheckResult
) -> None:
    """Check that L(middle) + the hull of J - L is regular for every middle in the box."""
    affine, slope = CertifiedAffine(content["middles"]), slope_of_powers(rig, content)
    rest = hull_of([affine.rest(jacobian) for jacobian in jacobians])
    whole = list(zip(map(arb, content["low"]), map(arb, content["high"]), strict=True))
    enough, todo = Fraction(content["margin"]) / 2, [(whole, 0)]
    margins, sizes, done = [], [], 0
    while todo:
        (part, depth), done = todo.pop(), done + 1
        refuse_unless(done <= MOST, "L(middle) + the hull of J - L may be singular near"
                      f" {[float(a.mid()) for a, _ in part]}")  # fmt: skip
        near = affine.evaluate([span(a, b) for a, b in part])
        rows = sum_of(near, rest)
        margin, inverse = margin_by_itself(rows)
        if margin <= 0 or (margin < enough and depth < DEPTH):
            todo += [(half, depth + 1) for half in cut_in_two(part, affine.slopes, rows)]
            continue
        margins.append(margin)
        power = arb(margin.numerator) / margin.denominator
        bound = power**6 / arb_mat(inverse).det() * slope
        sizes.append(max(least_magnitude(bound), least_magnitude(determinant_of(rows) * slope)))
        claim = arb(content["least_determinant"])
        refuse_unless(not (determinant_of(rows) * slope).abs_upper() < claim,
                      "least_determinant is a larger determinant than it has")  # fmt: skip
    found.margin, found.determinant = min(margins), max(found.determinant, min(sizes))
    if found.determinant < Fraction(content["least_determinant"]):
        found.not_verified.append(f"the determinant's bound of {content['least_determinant']:.4g}")
    note_margin(content, found)


def margin_by_itself(rows: Rows) -> tuple[Fraction, list[list[float]]]:
    """Return the margin, or -1, for an inverse of the midpoints, and that inverse."""
    inverse = np.linalg.pinv(middles_of(rows)).tolist()
    left = arb_mat(inverse) * arb_mat(rows)
    apart = np.array([[float((left[i, j] - (i == j)).abs_upper()) for j in range(6)]
                      for i in range(6)])  # fmt: skip
    refuse_unless(bool(np.isfinite(apart).all()), "no bounds of the Jacobian")
    weights = np.ones(6)
    for _ in range(100):
        weights = apart @ weights + 1e-9 * weights.max()
        weights /= weights.max()
    try:
        return margin_of(rows, inverse, weights.tolist()), inverse
    except Refused:
        return Fraction(-1), inverse


def cut_in_two(part: list[tuple[Any, Any]], slopes: Any, rows: Rows) -> list[list[tuple[Any, Any]]]:
    """Halve a part across the axis that changes L the most."""
    inverse = np.abs(np.linalg.pinv(middles_of(rows)))
    moved = [
        float((b - a).mid()) * (inverse @ np.abs(slope)).sum(axis=1).max()
        for (a, b), slope in zip(part, np.array(slopes, dtype=float), strict=True)
    ]
    axis = int(np.argmax(moved))
    a, b = part[axis]
    middle = ((a + b) / 2).mid()
    sides = [(a, middle), (middle, b)]
    return [[*part[:axis], side, *part[axis + 1 :]] for side in sides]
