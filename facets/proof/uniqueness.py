"""Proof that a sensor's readings tell its states apart over a whole box, in intervals.

The powers fix the apex's offset from the beam at each rotation (`fan`). With the powers held, the
six coordinates of the spots are a map of apex and rotation alone, and the light's shape in it is
fractions of a millimetre on levers of a quarter of a metre. So its 6 x 6 Jacobian

    coordinate = along . (t - C) + shift . v,   d/dt = along,   d/dR = closed + shift . dv/dR

varies little over a measurement range. Two conclusions, each from intervals that hold it:

- regular at every state of a box: no singular state (Eq. 11 is not zero anywhere in it);
- the hull of all its values over a convex box is regular: no two states of the box have the same
  readings, since their difference would be in the kernel of a mean of such matrices.

docs/uniqueness.md states and proves the theorem; `experiments.check_certificate` checks a
certificate again with none of this code.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import pairwise, product
from typing import Any, NamedTuple

import numpy as np
from flint import arb, arb_mat
from numpy.typing import NDArray

from ..characterization.state_box import Domain
from ..core.sensor import Sensor
from ..model.arrays import parameters
from ..optics.forward import Geometry, Scene, edges, geometry, in_sigmas, placed
from ..optics.rays import flight, gradient_of_normal, gradient_of_shift, reflect, slanted
from ..optics.vectors import combine, cross, dot, rotate, rotation_axes, scale, subtract
from ..scalars.intervals import Ball, between, ends, hull, magnitude
from .light_sharing import Fan, NotAFan, Shares, fan_of, least_share, shares_held, together

Floats = NDArray[np.float64]

#: Into how many pieces each axis of the pose is cut to begin with: tx ty tz roll pitch yaw.
PIECES = (2, 2, 1, 3, 3, 3)
#: A piece is halved at most so many times.
DEPTH = 12
#: What sums of a few floats can round.
ROUNDED = 1e-12
#: No box is made more than so many times as large.
FARTHEST = 20.0
#: So many pieces without a proof end the search: there would be more.
ENOUGH = 20
#: And for the light each angle: roll pitch yaw.
TURNS = (1, 1, 3)


class Piece(NamedTuple):
    """A box of poses, low and high (6,), mm and rad, and a lower bound there of Eq. (11)'s |det|.

    at_least: 0 where nothing was proved.
    """

    low: tuple[float, ...]
    high: tuple[float, ...]
    at_least: float


@dataclass
class Certificate:
    """What was proved of a box of states.

    regular: no state of it is singular.  unique: no two states of it have the same readings.
    margin: by how much the hull is regular, 1 the most, 0 or less not at all.
    doubtful: pieces where a singular state may be.
    """

    domain: Domain
    share: float = 0.0
    regular: bool = False
    unique: bool = False
    margin: float = -np.inf
    at_least: float = 0.0
    pieces: list[Piece] = field(default_factory=list)
    doubtful: list[Piece] = field(default_factory=list)
    reason: str = ""
    seconds: float = 0.0
    inverse: Floats = field(default_factory=lambda: np.zeros((6, 6)))
    weights: Floats = field(default_factory=lambda: np.ones(6))
    shares: dict[str, Any] = field(default_factory=dict)


class Unlit(Exception):
    """Somewhere in the box a facet may not face the beam, or its sub-beam miss its detector."""


def exact(sensor: Sensor) -> Geometry:
    """The sensor's vectors from its parameters as they are stored, without further rounding."""
    return geometry(tuple(arb(value) for value in parameters(sensor)))


def scene_of(sensor: Geometry, pose: list[Ball]) -> Scene:
    """Where the mirror stands for all poses of a box; the light left out."""
    zero = arb(0)
    at = placed(sensor, (*pose, zero, zero))
    a, b, c = edges(sensor.normals)  # turned as they are: a cross product of intervals is wider
    return at._replace(edges=(rotate(at.turn, a), rotate(at.turn, b), rotate(at.turn, c)))


def fans_of(sensor: Geometry, domain: Domain) -> list[Fan]:
    """The edges over the box's rotations, in a few parts."""
    zero = arb(0)
    rotations = [cut(domain, 3 + j, n) for j, n in enumerate(TURNS)]
    return [
        fan_of(sensor, scene_of(sensor, [zero, zero, zero, *turns]), rotation_axes(*turns[1:]))
        for turns in product(*rotations)
    ]


def share_over(sensor: Geometry, fans: list[Fan], domain: Domain) -> float:
    """The least share that a facet has anywhere in the box, its offsets included; rounded down."""
    x, y, z = (between(domain.low[i], domain.high[i]) for i in (6, 7, 2))
    return min(least_share(fan, in_sigmas(sensor, (x, y, z))) for fan in fans)


def cut(domain: Domain, axis: int, count: int) -> list[Ball]:
    """One side of the box in equal parts."""
    if not domain.high[axis] > domain.low[axis]:
        return [arb(float(domain.low[axis]))]
    places = np.linspace(domain.low[axis], domain.high[axis], count + 1).tolist()
    return [between(a, b) for a, b in pairwise(places)]


def jacobian(sensor: Geometry, shares: Shares, pose: list[Ball]) -> list[list[Ball]]:
    """6 x 6 over a box of poses, the powers held: psi and zeta of A, B, C by apex and angles."""
    at = scene_of(sensor, pose)
    axes = rotation_axes(pose[4], pose[5])
    beam = sensor.direction
    rows = []
    for k in range(3):
        normal = at.normals[k]
        incidence = dot(beam, normal)
        leaving = reflect(beam, normal)
        x, y, z = sensor.axes[k]
        middle = combine(shares.from_point[k][0], sensor.spread[0],
                         shares.from_point[k][1], sensor.spread[1])  # fmt: skip
        lever = scale(-1, combine(1, middle, -dot(normal, middle) / incidence, beam))
        start = subtract(at.apex, lever)
        length = flight(start, leaving, sensor.centres[k], sensor.axes[k])
        if not (incidence < 0 and dot(leaving, x) > 0 and length > 0):
            raise Unlit
        for axis in (y, z):
            along = slanted(axis, leaving, x)
            turn = cross(normal, gradient_of_normal(along, beam, normal, lever, length))
            shift = gradient_of_shift(along, beam, normal)
            by_light = [dot(shift, spread) for spread in sensor.spread]
            by_turn = [
                dot(turn, axes[j])
                + by_light[0] * shares.turns[k][0][j]
                + by_light[1] * shares.turns[k][1][j]
                for j in range(3)
            ]
            rows.append([*along, *by_turn])
    return rows


def intervals(low: Any, high: Any) -> list[Ball]:
    return [between(float(a), float(b)) for a, b in zip(low, high, strict=True)]


def middles(matrix: list[list[Ball]]) -> Floats:
    return np.array([[float(x.mid()) for x in row] for row in matrix])


def determinant(matrix: list[list[Ball]]) -> Ball:
    """Of an interval matrix, sharp where it is near its middle: what is left of it there is 1."""
    middle = middles(matrix)
    if not np.isfinite(middle).all() or np.linalg.matrix_rank(middle) < len(middle):
        return between(-np.inf, np.inf)
    inverse = arb_mat(np.linalg.inv(middle).tolist())
    return (inverse * arb_mat(matrix)).det() / inverse.det()


def regularity(matrix: list[list[Ball]]) -> tuple[float, Floats, Floats]:
    """By how much |1 - C M| shrinks a positive vector, for every M in the intervals.

    Above 0: every matrix in them is regular. Returns that, C and the vector.
    """
    middle = middles(matrix)
    if not np.isfinite(middle).all():
        return -np.inf, np.zeros_like(middle), np.ones(len(middle))
    inverse = np.linalg.pinv(middle)
    left = arb_mat(inverse.tolist()) * arb_mat(matrix)
    size: Floats = np.array(
        [[magnitude(left[i, j] - (i == j)) for j in range(6)] for i in range(6)]
    )
    vector: Floats = np.ones(6)
    for _ in range(200):
        vector = size @ vector + 1e-9 * vector.max()
        vector /= vector.max()
    margin = float(1 - (size @ vector / vector).max()) - ROUNDED
    return margin, np.asarray(inverse), vector


def slope_of_powers(sensor: Geometry, shares: Shares) -> Ball:
    """|d(power_a, power_b) / d(bx, by)|: what Eq. (11) has beside the 6 x 6 determinant."""
    white = sensor.whitening
    return sensor.power**2 * shares.slope * (white[0][0] * white[1][1] - white[0][1] * white[1][0])


def pieces_of(domain: Domain) -> Iterator[tuple[Floats, Floats]]:
    """The box of poses, cut to begin with."""
    counts = [n if domain.high[i] > domain.low[i] else 1 for i, n in enumerate(PIECES)]
    places = [np.linspace(domain.low[i], domain.high[i], n + 1) for i, n in enumerate(counts)]
    for cell in product(*(range(n) for n in counts)):
        low = np.array([places[i][n] for i, n in enumerate(cell)])
        yield low, np.array([places[i][n + 1] for i, n in enumerate(cell)])


def certify(
    sensor: Sensor,
    domain: Domain,
    share: float | None = None,
    limit: float = 300.0,
    tell: Callable[[float], None] = lambda _: None,
) -> Certificate:
    """Tries to prove that the box has no singular state, and no two states with equal readings.

    share: taken are all states with a pose in the box at which each facet has at least this share
    of the light; default: the least anywhere in the box with its offsets, which so is covered.
    limit: seconds after which pieces not yet done count as doubtful. tell: is given the share done.
    The power is known, and nothing but the edges cuts the light.
    """
    begin = time.perf_counter()
    found = Certificate(domain)
    if sensor.apertures.cut:
        found.reason = "sensor.apertures cuts the light, of which the theorem knows nothing"
        return found
    if sensor.light.on:
        found.reason = "sensor.light is not ideal, and the theorem knows ideal light alone"
        return found
    ball = exact(sensor)
    try:
        fans = fans_of(ball, domain)
        found.share = share_over(ball, fans, domain) if share is None else share
        shares = together([shares_held(fan, found.share) for fan in fans])
    except NotAFan:
        found.reason = "the facets do not share the beam as three lit wedges over the whole box"
        found.seconds = time.perf_counter() - begin
        return found
    slope = ends(slope_of_powers(ball, shares))[0]
    todo = [(low, high, 0) for low, high in pieces_of(domain)]
    whole, matrices = len(todo), []
    done = 0.0
    while todo:
        low, high, depth = todo.pop()
        try:
            matrix = jacobian(ball, shares, intervals(low, high))
            least = slope * distance_from_zero(determinant(matrix))
        except Unlit:
            matrix, least = None, 0.0
        late = time.perf_counter() - begin > limit
        if least > 0 or depth == DEPTH or late:
            kind = found.pieces if least > 0 else found.doubtful
            kind.append(Piece(tuple(low.tolist()), tuple(high.tolist()), least))
            if matrix is not None and least > 0:
                matrices.append(matrix)
            done += 0.5**depth / whole
            tell(done)
            if len(found.doubtful) == ENOUGH:
                found.reason = "singular states may be in the pieces listed, and in others"
                break
            continue
        todo += halves(low, high, depth, domain)
    found.regular = not found.doubtful
    found.at_least = min((piece.at_least for piece in found.pieces), default=0.0)
    if found.regular:
        whole_hull = [[hull(m[i][j] for m in matrices) for j in range(6)] for i in range(6)]
        found.margin, found.inverse, found.weights = regularity(whole_hull)
        found.unique = found.margin > 0
    found.shares = told(shares)
    found.seconds = time.perf_counter() - begin
    return found


def distance_from_zero(x: Ball) -> float:
    """The least absolute value in an interval, rounded down; 0 where it holds zero."""
    low, high = ends(x)
    if not np.isfinite(low) or not np.isfinite(high):
        return 0.0
    return max(low, -high, 0.0)


def halves(low: Floats, high: Floats, depth: int, domain: Domain) -> list[Any]:
    """A piece cut in two across the axis in which it is longest, as shares of the box."""
    width = np.where(domain.high[:6] > domain.low[:6], domain.high[:6] - domain.low[:6], np.inf)
    axis = int(((high - low) / width).argmax())
    middle = (low[axis] + high[axis]) / 2
    first, second = high.copy(), low.copy()
    first[axis] = second[axis] = middle
    return [(low, first, depth + 1), (second, high, depth + 1)]


def told(shares: Shares) -> dict[str, Any]:
    """The bounds about the light, for a certificate's file."""
    return {
        "from_point": [[ends(x) for x in row] for row in shares.from_point],
        "turns": [[[ends(x) for x in row] for row in rows] for rows in shares.turns],
        "offset": [ends(x) for x in shares.offset],
        "slope": ends(shares.slope),
    }


def reach_of(sensor: Sensor, domain: Domain, share: float, limit: float = 300.0) -> float:
    """By what factor the box of poses can grow and still be proved unique, to 3 %."""
    from scipy.optimize import bisect

    def unproved(factor: float) -> float:
        grown = Domain(factor * domain.low, factor * domain.high)
        return 0.5 - certify(sensor, grown, share, limit).unique

    top = 1.0
    while unproved(top) < 0 and top < FARTHEST:
        bottom, top = top, 1.5 * top
    if top == 1.0:
        return 1.0
    factor: float = bisect(unproved, bottom, top, xtol=0.03 * bottom) - 0.03 * bottom
    return factor
