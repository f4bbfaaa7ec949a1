"""Check that a certificate's Jacobians are regular over its pieces and between any two states.

Over a piece about x, J(p) = J(x) + slopes (p - x). The slopes are those over all angles of the
piece and at the apex of x, since G is linear in the apex. If two states of the box had equal
readings, the mean of J over the segment between them would be singular. This mean lies in the hull
of all J. It also lies in L(middle) + the hull of J - L for any affine L, since the mean of L is its
value in the segment's middle.

Poses and pieces are in mm and rad; matrices (6, 6) are of intervals. Whatever cannot be verified
raises `Refused`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
from flint import arb, arb_mat

from .certificate_optics import Array, IntervalDual, IntervalSensor, pose_of_box, span, spots
from .certificate_schema import Refused, refuse_unless

#: Operations on each element of arrays of intervals.
UNION: Any = np.frompyfunc(arb.union, 2, 1)
MAGNITUDE: Any = np.frompyfunc(arb.abs_upper, 1, 1)

#: Largest number of parts of the box that are examined as places of a segment's middle.
MOST = 4000
#: Largest number of cuts of one part to reach half of the file's margin.
DEPTH = 8


@dataclass
class CheckResult:
    """Verified lower bounds of the margin and of Eq. (11)'s |det|.

    not_verified: descriptions of the claims that were not verified.
    """

    margin: Fraction = Fraction(0)
    determinant: Fraction = Fraction(0)
    not_verified: list[str] = field(default_factory=list)


class Jacobian(NamedTuple):
    """Jacobian over a piece: `middle` (6, 6) is its value at `place` (6,), slopes[i][j][m] its
    derivatives by axis m over the whole piece, `off` (6,) the piece relative to `place`."""

    place: Array
    off: Array
    middle: Array
    slopes: Array

    def enclosure(self) -> Array:
        """Enclose the Jacobian (6, 6) over the whole piece."""
        enclosure: Array = self.middle + self.slopes @ self.off
        return enclosure


def spans(low: Any, high: Any) -> Array:
    """Intervals (6,) between the ends of a piece."""
    return np.array([span(a, b) for a, b in zip(low, high, strict=True)])


def jacobian_over(rig: IntervalSensor, piece: dict[str, Any], light: Any) -> Jacobian:
    """The spots' Jacobian over a piece, with its slopes. Raises `Refused` if a facet or a detector
    may face away."""
    pose = spans(piece["low"], piece["high"])
    place = np.array([side.mid() for side in pose])
    middle = np.array([spot.slope for spot in spots(rig, place, light)])
    spots(rig, pose, light)  # refuses where a facet or a detector may face away
    carried = spots(rig, pose_of_box([*place[:3], *pose[3:]]), light)
    slopes = [
        [x.slope if isinstance(x, IntervalDual) else np.full(6, arb(0)) for x in spot.slope]
        for spot in carried
    ]
    return Jacobian(place, pose - place, middle, np.array(slopes))


def as_fraction(x: Any) -> Fraction:
    """Convert an exact number to a fraction."""
    value = x.fmpq()
    return Fraction(int(value.p), int(value.q))


def slope_of_powers(rig: IntervalSensor, content: dict[str, Any]) -> Any:
    """Lower bound of the ratio of Eq. (11) to the determinant of the 6 x 6 Jacobian.

    The ratio is d(power_a, power_b) / d(bx, by), and the powers depend on q = across . (t - b) /
    sigma. The derivative of q by b consists of the x and y components of the two vectors across the
    beam. Its determinant is the vertical component of their cross product, which is the beam's
    direction. A beam that leans moves less across itself than its place does in the plane.
    """
    bound = arb(content["light"]["slope"][0]) * rig.power.lower() ** 2
    return bound * rig.down[2].abs_lower() / (rig.sigma[0] * rig.sigma[1])


def check_pieces(
    rig: IntervalSensor, content: dict[str, Any], result: CheckResult
) -> list[Jacobian]:
    """Compute the Jacobians over the pieces and check the bounds of their determinants."""
    slope, unverified = slope_of_powers(rig, content), 0
    jacobians, magnitudes = [], []
    for piece in content["pieces"]:
        jacobians.append(jacobian_over(rig, piece, content["light"]))
        size = determinant_of(jacobians[-1].enclosure()) * slope
        refuse_unless(not size.abs_upper() < arb(piece["at_least"]),
                      "a piece claims a larger determinant than it has")  # fmt: skip
        magnitudes.append(least_magnitude(size))
        unverified += magnitudes[-1] < Fraction(piece["at_least"])
    result.determinant = min(magnitudes)
    claims = min(Fraction(piece["at_least"]) for piece in content["pieces"])
    below = Fraction(content["least_determinant"]) <= claims
    refuse_unless(below or content.get("middles") is not None,
                  "least_determinant is more than its least piece claims")  # fmt: skip
    if unverified:
        result.not_verified.append(f"the bound of the determinant in {unverified} pieces")
    return jacobians


def least_magnitude(size: Any) -> Fraction:
    """Least absolute value of an interval; 0 if the interval is not finite."""
    return max(as_fraction(size.abs_lower()), Fraction(0)) if size.is_finite() else Fraction(0)


def inverse_of_middles(matrix: Array) -> Any:
    """Approximate inverse (6, 6), in floats, of an interval matrix."""
    middles = np.array([[float(x.mid()) for x in row] for row in matrix])
    refuse_unless(bool(np.isfinite(middles).all()), "no bounds of the Jacobian")
    return np.linalg.pinv(middles).tolist()


def determinant_of(matrix: Array) -> Any:
    """Determinant of an interval matrix, from its product with an approximate inverse."""
    near = arb_mat(inverse_of_middles(matrix))
    return (near * arb_mat(matrix.tolist())).det() / near.det()


def distances_from_identity(matrix: Array, inverse: Any) -> Array:
    """Upper bounds (6, 6) of |1 - C M| for an inverse C and every M in an interval matrix."""
    product = np.array((arb_mat(inverse) * arb_mat(matrix.tolist())).tolist())
    bounds: Array = MAGNITUDE(product - np.eye(6, dtype=int))
    return bounds


def margin_of(matrix: Array, inverse: Any, weights: Any) -> Fraction:
    """Margin by which |1 - C M| shrinks the weights for every M in an interval matrix, or raise
    `Refused`."""
    margins = []
    shrunk = distances_from_identity(matrix, inverse) @ np.array(weights, dtype=object)
    for i, (row, weight) in enumerate(zip(shrunk, weights, strict=True)):
        refuse_unless(row < weight, f"the hull of the Jacobians may be singular: row {i + 1} of"
                      f" |1 - C M| times the weights is {row}, not below its own")  # fmt: skip
        margins.append(as_fraction((1 - row / weight).lower()))
    return min(margins)


def check_hull(jacobians: list[Jacobian], content: dict[str, Any], result: CheckResult) -> None:
    """Check with the file's inverse and weights that the hull of all Jacobians is regular."""
    hull = UNION.reduce([jacobian.enclosure() for jacobian in jacobians])
    result.margin = margin_of(hull, content["inverse"], content["weights"])
    note_margin(content, result)


def note_margin(content: dict[str, Any], result: CheckResult) -> None:
    """Note that the stated margin is not verified, if the margin found is smaller."""
    if result.margin < Fraction(content["margin"]):
        result.not_verified.append(f"the margin of {content['margin']:.4g}")


class CertifiedAffine:
    """Affine map L of the file; a map far from the Jacobian weakens the proof but is valid.

    slopes: (6, 6, 6), the first index that of the pose's axis.
    """

    def __init__(self, content: dict[str, Any]) -> None:
        self.place, self.value, self.slopes = (
            np.array(content[key], dtype=object) for key in ("place", "value", "slopes")
        )

    def evaluate(self, pose: Array) -> Array:
        """The matrix L (6, 6) at a pose."""
        matrix: Array = self.value + np.tensordot(pose - self.place, self.slopes, 1)
        return matrix

    def remainder(self, jacobian: Jacobian) -> Array:
        """Enclose J - L over a piece."""
        slopes = jacobian.slopes - np.moveaxis(self.slopes, 0, -1)
        enclosure: Array = jacobian.middle - self.evaluate(jacobian.place) + slopes @ jacobian.off
        return enclosure


def check_middles(
    rig: IntervalSensor, jacobians: list[Jacobian], content: dict[str, Any], result: CheckResult
) -> None:
    """Check that L(middle) + the hull of J - L is regular for every middle in the box."""
    affine, slope = CertifiedAffine(content["middles"]), slope_of_powers(rig, content)
    remainder = UNION.reduce([affine.remainder(jacobian) for jacobian in jacobians])
    box = list(zip(map(arb, content["low"]), map(arb, content["high"]), strict=True))
    enough, claim = Fraction(content["margin"]) / 2, arb(content["least_determinant"])
    margins, sizes, examined, todo = [], [], 0, [(box, 0)]
    while todo:
        (part, depth), examined = todo.pop(), examined + 1
        refuse_unless(examined <= MOST, "L(middle) + the hull of J - L may be singular near"
                      f" {[float(a.mid()) for a, _ in part]}")  # fmt: skip
        matrix = affine.evaluate(spans(*zip(*part, strict=True))) + remainder
        margin, inverse = margin_by_itself(matrix)
        if margin <= 0 or (margin < enough and depth < DEPTH):
            todo += [(half, depth + 1) for half in cut_in_two(part, affine.slopes, inverse)]
            continue
        margins.append(margin)
        power = arb(margin.numerator) / margin.denominator
        bound = power**6 / arb_mat(inverse).det() * slope
        size = determinant_of(matrix) * slope
        sizes.append(max(least_magnitude(bound), least_magnitude(size)))
        refuse_unless(not size.abs_upper() < claim,
                      "least_determinant is a larger determinant than it has")  # fmt: skip
    result.margin, result.determinant = min(margins), max(result.determinant, min(sizes))
    if result.determinant < Fraction(content["least_determinant"]):
        result.not_verified.append(f"the determinant's bound of {content['least_determinant']:.4g}")
    note_margin(content, result)


def margin_by_itself(matrix: Array) -> tuple[Fraction, Any]:
    """Return the margin, or -1 if it is not proved, for an inverse of the midpoints, and that
    inverse."""
    inverse = inverse_of_middles(matrix)
    distances = distances_from_identity(matrix, inverse).astype(float)
    refuse_unless(bool(np.isfinite(distances).all()), "no bounds of the Jacobian")
    weights = np.ones(6)
    for _ in range(100):
        weights = distances @ weights + 1e-9 * weights.max()
        weights /= weights.max()
    try:
        return margin_of(matrix, inverse, weights.tolist()), inverse
    except Refused:
        return Fraction(-1), inverse


def cut_in_two(part: list[Any], slopes: Array, inverse: Any) -> list[list[Any]]:
    """Halve a part across the axis that changes L the most.  inverse: of L in its middle."""
    widths = np.array([float((b - a).mid()) for a, b in part])
    changes = (np.abs(inverse) @ np.abs(slopes.astype(float))).sum(axis=2).max(axis=1)
    axis = int(np.argmax(widths * changes))
    a, b = part[axis]
    middle = ((a + b) / 2).mid()
    return [[*part[:axis], side, *part[axis + 1 :]] for side in ((a, middle), (middle, b))]
