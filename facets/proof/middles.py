"""Proof that no two states have the same readings, by the Jacobian about the segment's midpoint.

While the facets' shares in the light are fixed, G(p') - G(p) = M (p' - p), where M is the mean of
dG over the segment from p to p'. For any function L that is affine in the pose, the mean of L is
its value at the midpoint. So if dG - L lies in a remainder E everywhere in the box, M lies in
L(middle) + E; and the midpoint lies in the box, since it is convex. If L approximates dG, E
contains only the curvature of dG and the uncertainty of the light. So the proof succeeds if
L(piece) + E is regular for pieces that fill the box, even where the hull of all dG is not.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ..characterization.state_box import StateBox
from ..core.units import Floats
from ..optics.forward import Geometry
from .interval_matrix import (
    Intervals,
    determinant_bound,
    hull_of_arrays,
    middles,
    regularity,
)
from .light_sharing import SharingBounds
from .pieces import ProvedPiece, cut_in_two, initial_pieces, proved_piece, share_levers
from .spot_jacobian import Centred, centred_jacobian, intervals_between

#: Largest number of pieces for the midpoint, and how many times each is halved.
MOST_PIECES, MOST_CUTS = 4000, 12


class AffineJacobian(NamedTuple):
    """A matrix (6, 6) that is affine in the pose: its value at `place` (6,) and its slopes (6, 6,
    6), whose first index is the axis of the pose. Any such matrix is valid; a better approximation
    of dG proves more."""

    place: Floats
    value: Floats
    slopes: Floats

    def as_numbers(self) -> dict[str, Any]:
        """Return the numbers for a certificate's file; a checker recomputes everything else."""
        return {name: values.tolist() for name, values in self._asdict().items()}

    def evaluate(self, pose: Intervals) -> Intervals:
        """The matrix (6, 6) over a box of poses (6,)."""
        matrix: Intervals = self.value + np.tensordot(self.slopes, pose - self.place, (0, 0))
        return matrix


class ByMiddles(NamedTuple):
    """A proof by midpoints.  affine: L.  rest: E.  pieces: they fill the box, and L + E is regular
    over each.

    margin: the least margin of all pieces, a lower bound; 0 or less if a piece is not regular.  A
    state is the midpoint between it and itself, so no state in the box is singular either; the
    pieces' `at_least` is a bound of its determinant.
    """

    affine: AffineJacobian
    rest: Intervals
    pieces: list[ProvedPiece]
    margin: float


def prove_by_middles(
    geometry: Geometry,
    shares: SharingBounds,
    box: StateBox,
    jacobians: Sequence[Centred],
    slope: float,
) -> ByMiddles:
    """Prove regularity.  jacobians: over pieces that fill the box.  slope: a lower bound of the
    powers' slope."""
    affine = affine_part(geometry, shares, box)
    rest = hull_of_arrays([affine_remainder(affine, jacobian) for jacobian in jacobians])
    pieces: list[ProvedPiece] = []
    margin, todo = 1.0, [(*piece, 0) for piece in initial_pieces(box)]
    for _ in range(MOST_PIECES):
        if not todo:
            return ByMiddles(affine, rest, pieces, margin)
        low, high, depth = todo.pop()
        matrix = affine.evaluate(intervals_between(low, high)) + rest
        margin_of_piece = regularity(matrix)[0]
        if margin_of_piece > 0:
            margin = min(margin, margin_of_piece)
            bound = determinant_bound(matrix, slope, margin_of_piece)
            pieces.append(proved_piece(low, high, bound))
        elif depth == MOST_CUTS:
            break
        else:
            todo += [(*part, depth + 1) for part in cut_in_two(low, high, share_levers(box))]
    return ByMiddles(affine, rest, pieces, -np.inf)


def affine_part(geometry: Geometry, shares: SharingBounds, box: StateBox) -> AffineJacobian:
    """Return the Jacobian and its slopes at the midpoint of the box."""
    place = (box.low + box.high)[:6] / 2
    jacobian = centred_jacobian(geometry, shares, place, place)
    slopes = np.array([middles(slope) for slope in jacobian.slopes])
    return AffineJacobian(place, middles(jacobian.middle), slopes)


def affine_remainder(affine: AffineJacobian, jacobian: Centred) -> Intervals:
    """Return the difference between the Jacobian and L over a piece."""
    slopes = np.tensordot(jacobian.slopes - affine.slopes, jacobian.half, (0, 0))
    remainder: Intervals = jacobian.middle - affine.evaluate(jacobian.place) + slopes
    return remainder
