"""Proof that no two states in a box have the same readings, in intervals.

The powers fix the apex's offset from the beam at each rotation (`light_sharing`). At fixed powers,
the six coordinates of the spots depend on apex and rotation alone. The light's shape contributes
fractions of a millimetre to them, on levers of a quarter of a metre. So the 6 x 6 Jacobian

    coordinate = along . (t - C) + shift . v,   d/dt = along,   d/dR = closed + shift . dv/dR

varies little over a measurement range. Two conclusions follow, each from enclosing intervals:

- If it is regular at every state of a box, the box has no singular state (Eq. 11 is not zero
  anywhere in it).
- If the hull of all its values over a convex box is regular, no two states of the box have the same
  readings. Otherwise their difference would be in the kernel of a mean of such matrices.

docs/uniqueness.md states and proves the theorem; `experiments.check_certificate` checks a
certificate again with none of this code.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise, product
from typing import Any

import numpy as np
from flint import arb

from ..characterization.state_box import StateBox
from ..core.sensor import Sensor
from ..core.units import Floats
from ..optics.forward import Geometry, project_to_sigmas
from ..optics.vectors import rotation_axes
from ..scalars.intervals import Interval, ends, interval, nonnegative_product
from .interval_matrix import determinant_bound, hull_of_arrays, regularity
from .light_sharing import (
    FacetEdges,
    LightNotShared,
    SharingBounds,
    bounds_at_fixed_shares,
    facet_edges,
    hull_of_bounds,
    least_share_over,
)
from .middles import prove_by_middles
from .pieces import ProvedPiece, cut_in_two, initial_pieces, proved_piece, share_levers
from .spot_jacobian import Centred, NotFacing, centred_jacobian, dark_scene_over, interval_geometry

#: Largest number of times that a piece is halved.
MOST_CUTS = 12
#: The search ends after this many pieces without a proof, since there would be more.
MOST_DOUBTFUL = 20
#: Least margin of a hull: another grid of pieces might not reproduce a smaller one.
LEAST_HULL_MARGIN = 0.15
#: Number of parts of each angle for the bounds of the light: roll pitch yaw.
PARTS_OF_ANGLES = (1, 1, 3)


#: Largest number of pieces that a proof examines by default.
MOST_PIECES = 20_000


@dataclass
class Certificate:
    """The proved statement about all states with a pose in a box, and with enough light on each
    facet.

    tolerances: (30,) the largest errors of the parameters of the sensors for which it holds.
    least_share: fraction of the beam's light that each facet has at least.
    regular: no such state is singular.  unique: no two of them have the same readings.
    margin: lower bound of the margin of the hull's regularity, at most 1; 0 or less if the hull is
    not regular.
    at_least: lower bound of Eq. (11)'s |det|, without the last reading of power; mm, mW, rad.
    doubtful: pieces that may have a singular state.  work: number of pieces examined.
    inverse (6, 6), weights (6,): the matrix and the vector of the inequality.
    shares: the bounds of the light, as numbers.  middles: the affine part in a proof by midpoints,
    if the hull of all Jacobians is not regular.
    """

    box: StateBox
    tolerances: tuple[float, ...] = (0.0,) * 30
    least_share: float = 0.0
    regular: bool = False
    unique: bool = False
    margin: float = -np.inf
    at_least: float = 0.0
    pieces: list[ProvedPiece] = field(default_factory=list)
    doubtful: list[ProvedPiece] = field(default_factory=list)
    reason: str = ""
    seconds: float = 0.0
    work: int = 0
    inverse: Floats = field(default_factory=lambda: np.zeros((6, 6)))
    weights: Floats = field(default_factory=lambda: np.ones(6))
    shares: dict[str, Any] = field(default_factory=dict)
    middles: dict[str, Any] | None = None


def refusal_reason(sensor: Sensor) -> str:
    """The reason why a sensor whose model has more than ideal light cannot be certified; else an
    empty text."""
    if sensor.apertures.cut:
        return "sensor.apertures cuts the light, of which the theorem knows nothing"
    if sensor.light.on:
        return "sensor.light is not that of an ideal beam, of which alone the theorem speaks"
    return ""


def certify(
    sensor: Sensor,
    box: StateBox,
    least_share: float | None = None,
    tolerances: Sequence[float] | None = None,
    pieces: int = MOST_PIECES,
    on_progress: Callable[[float], None] = lambda _: None,
) -> Certificate:
    """Try to prove that the box has no singular state, and no two states with equal readings.

    least_share: fraction of the light. The proof covers all states with a pose in the box at which
    each facet has at least this fraction. By default it is the least in the box with its offsets,
    so that the whole box is covered.
    tolerances: (30,) the proof is for every sensor with parameters within them; mm, rad, mW.
    pieces: largest number of pieces that are examined; all others count as doubtful.
    on_progress: receives the completed fraction.
    """
    begin = time.perf_counter()
    certificate = Certificate(
        box, (0.0,) * 30 if tolerances is None else tuple(map(float, tolerances))
    )
    certificate.reason = refusal_reason(sensor)
    if not certificate.reason:
        try:
            prove(
                interval_geometry(sensor, certificate.tolerances),
                certificate,
                least_share,
                pieces,
                on_progress,
            )
        except LightNotShared:
            certificate.reason = (
                "the facets may not share the beam as three lit wedges everywhere in it"
            )
    certificate.seconds = time.perf_counter() - begin
    return certificate


def prove(
    geometry: Geometry,
    certificate: Certificate,
    least_share: float | None,
    pieces: int,
    on_progress: Callable[[float], None],
) -> None:
    """Fill in a certificate.

    pieces: largest number of pieces to examine. Raises `LightNotShared`.
    """
    parts = edges_over_rotations(geometry, certificate.box)
    if least_share is None:
        least_share = least_share_in_box(geometry, parts, certificate.box)
    certificate.least_share = least_share
    shares = hull_of_bounds([bounds_at_fixed_shares(edges, least_share) for edges in parts])
    certificate.shares = bounds_as_numbers(shares)
    slope = ends(slope_of_powers(geometry, shares))[0]
    if prove_at_once(geometry, certificate, shares, slope):
        on_progress(1.0)
        return
    jacobians = prove_pieces(geometry, certificate, shares, slope, pieces, on_progress)
    certificate.regular = not certificate.doubtful
    if certificate.regular:
        conclude(geometry, certificate, shares, jacobians, slope)


def prove_at_once(
    geometry: Geometry, certificate: Certificate, shares: SharingBounds, slope: float
) -> bool:
    """Try the proof with the initial pieces; fill in the certificate and return True if it
    succeeds."""
    examined = [(low, high, *examine_piece(geometry, shares, slope, low, high))
              for low, high in initial_pieces(certificate.box)]  # fmt: skip
    jacobians = [jacobian for *_, jacobian, _ in examined if jacobian is not None]
    if len(jacobians) < len(examined):
        return False
    certificate.pieces = [proved_piece(a, b, bound) for a, b, _, bound in examined]
    certificate.work = len(examined)
    conclude(geometry, certificate, shares, jacobians, slope)
    if not certificate.unique:
        certificate.pieces, certificate.at_least = [], 0.0
    return certificate.unique


def conclude(
    geometry: Geometry,
    certificate: Certificate,
    shares: SharingBounds,
    jacobians: list[Centred],
    slope: float,
) -> None:
    """Write the conclusion from the Jacobians over the pieces into the certificate.

    Sets margin, inverse, weights, at_least, unique and regular, by the hull of the Jacobians, and
    `middles` if the proof by midpoints has a larger margin. If neither proves uniqueness, `unique`
    is False.
    slope: lower bound of the powers' part of the determinant, see `slope_of_powers`.
    """
    hull = hull_of_arrays([jacobian.enclosure() for jacobian in jacobians])
    certificate.margin, certificate.inverse, certificate.weights = regularity(hull)
    bound = determinant_bound(hull, slope, certificate.margin)
    certificate.pieces = [p._replace(at_least=max(p.at_least, bound)) for p in certificate.pieces]
    certificate.at_least = min(piece.at_least for piece in certificate.pieces)
    if not (certificate.margin > LEAST_HULL_MARGIN and certificate.at_least > 0):
        by_middles = prove_by_middles(geometry, shares, certificate.box, jacobians, slope)
        if by_middles.margin > max(certificate.margin, 0):
            by_midpoint = min(piece.at_least for piece in by_middles.pieces)
            certificate.margin, certificate.middles = (
                by_middles.margin,
                by_middles.affine.as_numbers(),
            )
            certificate.at_least = max(certificate.at_least, by_midpoint)
    certificate.unique = certificate.margin > 0
    certificate.regular = certificate.unique or certificate.at_least > 0


def prove_pieces(
    geometry: Geometry,
    certificate: Certificate,
    shares: SharingBounds,
    slope: float,
    pieces: int,
    on_progress: Callable[[float], None],
) -> list[Centred]:
    """Halve the box's pieces until each is proved or doubtful; return the Jacobians over the
    proved pieces."""
    todo = [(low, high, 0) for low, high in initial_pieces(certificate.box)]
    certificate.work = 0
    count, completed, jacobians = len(todo), 0.0, []
    while todo:
        low, high, depth = todo.pop()
        jacobian, bound = examine_piece(geometry, shares, slope, low, high)
        certificate.work += 1
        late = certificate.work >= pieces
        if not (bound > 0 or depth == MOST_CUTS or late):
            todo += [(a, b, depth + 1) for a, b in halves_of(low, high, jacobian, certificate.box)]
            continue
        piece = proved_piece(low, high, bound)
        if jacobian is not None and bound > 0:
            jacobians.append(jacobian)
            certificate.pieces.append(piece)
        else:
            certificate.doubtful.append(piece)
        completed += 0.5**depth / count
        on_progress(completed)
        if len(certificate.doubtful) == MOST_DOUBTFUL:
            certificate.reason = "singular states may be in the pieces listed, and in others"
            break
    return jacobians


def halves_of(
    low: Floats, high: Floats, jacobian: Centred | None, box: StateBox
) -> list[tuple[Floats, Floats]]:
    """Halve a piece across the axis that changes its Jacobian most, or else the light's shares;
    returns the low and high ends (6,) of both."""
    levers = share_levers(box) if jacobian is None else jacobian.levers()
    return cut_in_two(low, high, levers)


def examine_piece(
    geometry: Geometry, shares: SharingBounds, slope: float, low: Floats, high: Floats
) -> tuple[Centred | None, float]:
    """The Jacobian over a piece and a lower bound of Eq. (11)'s |det|, which is 0 if none is found.

    The Jacobian is None, too, if a facet or a detector may face away.
    """
    try:
        jacobian = centred_jacobian(geometry, shares, low, high)
    except NotFacing:
        return None, 0.0
    return jacobian, determinant_bound(jacobian.enclosure(), slope)


def edges_over_rotations(geometry: Geometry, box: StateBox) -> list[FacetEdges]:
    """The edges over the box's rotations, in a few parts."""
    zero = arb(0)
    rotations = [divide_side(box, 3 + j, n) for j, n in enumerate(PARTS_OF_ANGLES)]
    return [
        facet_edges(
            geometry,
            dark_scene_over(geometry, [zero, zero, zero, *turns]),
            rotation_axes(*turns[1:]),
        )
        for turns in product(*rotations)
    ]


def least_share_in_box(geometry: Geometry, parts: list[FacetEdges], box: StateBox) -> float:
    """The least share that a facet has anywhere in the box, its offsets included; rounded down."""
    x, y, z = (interval(box.low[i], box.high[i]) for i in (6, 7, 2))
    offset = np.array(project_to_sigmas(geometry, (x, y, z)))
    return min(least_share_over(edges, offset) for edges in parts)


def divide_side(box: StateBox, axis: int, count: int) -> list[Interval]:
    """Divide one side of the box into equal parts."""
    if not box.high[axis] > box.low[axis]:
        return [arb(float(box.low[axis]))]
    places = np.linspace(box.low[axis], box.high[axis], count + 1).tolist()
    return [interval(a, b) for a, b in pairwise(places)]


def slope_of_powers(geometry: Geometry, shares: SharingBounds) -> Interval:
    """|d(power_a, power_b) / d(bx, by)|: Eq. (11) is this times the 6 x 6 determinant."""
    white = geometry.whitening
    area = white[0][0] * white[1][1] - white[0][1] * white[1][0]
    return nonnegative_product(nonnegative_product(geometry.power**2, shares.slope), area)


def bounds_as_numbers(shares: SharingBounds) -> dict[str, Any]:
    """Return the light's bounds as numbers, for a certificate's file."""
    return {
        "from_point": [[ends(x) for x in row] for row in shares.from_point],
        "turns": [[[ends(x) for x in row] for row in rows] for rows in shares.turns],
        "slope": ends(shares.slope),
    }
