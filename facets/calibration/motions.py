"""Describe the parameters that a motion does not determine, and propose poses that determine most.

Everything is in units of the prior uncertainties: a direction in which the data add less
information than the prior is reported. Proposed poses have an order that is short to travel.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..config import Config
from ..core.names import DETECTORS, state_columns
from ..core.sensor import Sensor
from ..core.small_matrices import one_thread
from ..core.units import Floats
from ..model.arrays import readings
from .fitting.bundle_adjustment import (
    OWN_COUNT,
    OWN_UNITS,
    Data,
    eliminate_own_unknowns,
    linearise_model,
    own_sigma,
)
from .fitting.fit import solve_open_axes
from .fitting.unknowns import ALL, PLACE, Choice, values_of
from .table import choice

#: Least fraction of a pattern that lies in the weak directions, for the pattern to be named; and
#: least component of another weak direction that is named.
NAMED_FRACTION, NAMED_PART = 0.98, 0.25


class Direction(NamedTuple):
    """A direction of the unknowns.

    information: of the data, relative to that of the prior.  words: description of the direction.
    """

    information: float
    words: str


@one_thread
def information(sensor: Sensor, data: Data, choice: Choice) -> Floats:
    """The information of the data alone (p, p), in units of the prior, at the nominal sensor."""
    own_values = solve_open_axes(data, sensor)
    model = linearise_model(sensor, data, own_values, values_of(sensor), choice)
    sigma = own_sigma(data, choice)
    matrix = eliminate_own_unknowns(model, np.ones_like(data.raw), own_values, sigma).matrix
    scaled: Floats = choice.sigma[:, None] * matrix * choice.sigma
    return scaled


def weak_directions(
    matrix: Floats, choice: Choice, sensor: Sensor, limit: float = 1.0
) -> list[Direction]:
    """The directions in which the data have less than `limit` times the prior's information, the
    weakest first; empty if there are none. matrix: (unknowns, unknowns) information relative to the
    prior's.

    A named pattern is used where it lies in these directions; the others are described by their
    largest parts.
    """
    sizes, directions = np.linalg.eigh(matrix)
    space = directions[:, sizes < limit]
    for pattern in conventions(sensor, choice):
        scaled = pattern[choice.places] / choice.sigma
        scaled /= np.linalg.norm(scaled) or 1.0
        if np.linalg.norm(space.T @ scaled) > NAMED_FRACTION:
            space = remove_direction(space, scaled)
    weak = []
    for words, pattern in patterns(sensor).items():
        scaled = pattern[choice.places] / choice.sigma
        level, size = information_along(matrix, scaled), np.linalg.norm(scaled)
        if level < limit and np.linalg.norm(space.T @ scaled) > NAMED_FRACTION * size:
            weak.append(Direction(level, words))
            space = remove_direction(space, scaled / size)
    small = space.T @ matrix @ space
    values, turned = np.linalg.eigh(small)
    rest = (space @ turned).T
    weak += [
        Direction(max(float(level), 0.0), describe_direction(direction, choice))
        for level, direction in zip(values, rest, strict=True)
    ]
    return sorted(weak)


def information_along(matrix: Floats, direction: Floats) -> float:
    """The information along a direction (unknowns,), relative to the prior's; infinite for a
    direction of zero length."""
    square = float(direction @ direction)
    return max(float(direction @ matrix @ direction) / square, 0.0) if square else np.inf


def conventions(sensor: Sensor, choice: Choice) -> list[Floats]:
    """Changes (ALL,) of `ALL`, mm and rad, that change no pose in any motion, and need not be
    determined.

    These are a rotation of the mirror on its reference with its facets rotated back and, if each
    sample has its own power, the detectors' common gain.
    """
    changes = []
    for axis, name in (("x", "mount.roll"), ("y", "mount.pitch"), ("z", "mount.yaw")):
        if axis == "z":
            parts = {f"facet_{letter}.azimuth": -1.0 for letter in DETECTORS}
        else:
            parts = {key: -value for key, value in facet_tilts(sensor, axis).items()}
        if {name, *parts} <= set(choice.names):
            changes.append(change(parts | {name: 1.0}))
    gains = {f"correction_{letter}.power": 1.0 for letter in DETECTORS}
    if np.isinf(choice.power) and set(gains) <= set(choice.names):
        changes.append(change(gains))
    return changes


def change(parts: dict[str, float]) -> Floats:
    """Values (ALL,) of `ALL` that are zero except for these parts."""
    values = np.zeros(len(ALL))
    for name, value in parts.items():
        values[PLACE[name]] = value
    return values


def remove_direction(space: Floats, direction: Floats) -> Floats:
    """A basis (p, k - 1) of the complement of a direction in a space (p, k)."""
    inside = space.T @ direction
    _, _, rows = np.linalg.svd(inside[None] / np.linalg.norm(inside))
    rest: Floats = space @ rows[1:].T
    return rest


def describe_direction(direction: Floats, choice: Choice) -> str:
    """Describe a direction (unknowns,), in prior standard uncertainties, by its largest parts."""
    order = np.argsort(-np.abs(direction))
    large = [n for n in order if abs(direction[n]) > NAMED_PART][:4]
    parts = [f"{choice.names[n]} {'up' if direction[n] > 0 else 'down'}" for n in large]
    return ", ".join(parts) or "a little of everything"


def patterns(sensor: Sensor) -> dict[str, Floats]:
    """Changes (ALL,) of `ALL` by their names, mm and rad."""
    named = {}

    def add(words: str, parts: dict[str, float]) -> None:
        """Add the pattern of these parts under a name."""
        named[words] = change(parts)

    def each(what: str, name: str) -> dict[str, float]:
        """The parts that change one parameter of all three facets or detectors by 1."""
        return {f"{what}_{letter}.{name}": 1.0 for letter in DETECTORS}

    add("turning all PSDs about z", each("psd", "azimuth"))
    add("raising all PSDs", each("psd", "height"))
    add("all PSDs further out", each("psd", "radius"))
    add("all PSDs turned about their normals", each("psd", "roll"))
    add("all PSDs leaning outward", each("psd", "pitch"))
    add("all PSDs turned about their upright axes", each("psd", "yaw"))
    add("turning all facets about z, as yaw does", each("facet", "azimuth"))
    for axis, name in (("x", "roll"), ("y", "pitch")):
        add(f"tilting all facets about {axis}, as {name} does", facet_tilts(sensor, axis))
    add("all facets steeper", each("facet", "inclination"))
    add("all powers larger", each("correction", "power"))
    add("all places scaled along y", each("correction", "y10"))
    add("all places scaled along z", each("correction", "z01"))
    for axis, turn in (("x", np.cos), ("y", np.sin)):
        parts = {}
        for letter, psd in zip(DETECTORS, sensor.psds, strict=True):
            across = -np.sin(psd.azimuth) if axis == "x" else np.cos(psd.azimuth)
            parts[f"psd_{letter}.radius"] = float(turn(psd.azimuth))
            parts[f"psd_{letter}.azimuth"] = float(across / psd.radius)
        add(f"shifting all PSDs along {axis}", parts)
        add(f"shifting all PSDs and the apex along {axis}", parts | {f"apex.{axis}": 1.0})
    together = each("psd", "azimuth") | each("facet", "azimuth")
    add("turning all PSDs and facets about z", together)
    return named


def facet_tilts(sensor: Sensor, axis: str) -> dict[str, float]:
    """The changes of the facets' angles with a rotation about x or y."""
    parts = {}
    for letter, facet in zip(DETECTORS, sensor.facets, strict=True):
        c, s, across = np.cos(facet.azimuth), np.sin(facet.azimuth), 1 / np.tan(facet.inclination)
        turn = (-s, -c * across) if axis == "x" else (c, -s * across)
        parts[f"facet_{letter}.inclination"] = float(turn[0])
        parts[f"facet_{letter}.azimuth"] = float(turn[1])
    return parts


@one_thread
def choose_poses(
    sensor: Sensor, choice: Choice, sigma: Floats, candidates: Floats, count: int
) -> tuple[NDArray[np.int64], Floats]:
    """Choose poses from candidates (n, 6) one after another, each of which adds most information
    (D-optimal).

    sigma: (6,) standard uncertainty of the reference. Returns the numbers (count,) of the chosen
    poses, and `mean_reduction` after each.
    """
    rows = pose_information(sensor, choice, sigma, candidates)
    size = len(choice.names)
    covariance, chosen, reductions = np.eye(size), [], []
    for _ in range(count):
        spread = (rows.reshape(-1, size) @ covariance).reshape(rows.shape)
        gains = np.eye(9) + spread @ np.swapaxes(rows, 1, 2)
        best = int(np.argmax(np.linalg.slogdet(gains)[1]))
        chosen.append(best)
        across = covariance @ rows[best].T
        covariance = covariance - across @ np.linalg.solve(gains[best], across.T)
        reductions.append(mean_reduction(np.linalg.inv(covariance)))
    return np.array(chosen), np.array(reductions)


def mean_reduction(matrix: Floats) -> float:
    """The geometric mean of the ratios of the uncertainties to the prior ones.

    matrix: information (p, p) of data and prior, in units of the prior.
    """
    return float(np.exp(-np.linalg.slogdet(matrix)[1] / 2 / len(matrix)))


def pose_information(sensor: Sensor, choice: Choice, sigma: Floats, candidates: Floats) -> Floats:
    """Factors (n, 9, p) of each pose's information: derivatives of the readings in standard
    deviations, per prior standard uncertainty."""
    data = Data(np.zeros((len(candidates), 9)), candidates, sigma, np.zeros((len(candidates), 2)))
    states = np.concatenate([candidates, data.beam], axis=1)
    data = data._replace(raw=readings(sensor, states))
    model = linearise_model(
        sensor, data, np.zeros((len(candidates), OWN_COUNT)), values_of(sensor), choice
    )
    own_uncertainty = own_sigma(data, choice)
    spread = np.where(np.isfinite(own_uncertainty), own_uncertainty / OWN_UNITS, 1e5)
    wide = model.by_own * spread
    inner = np.eye(9) + wide @ np.swapaxes(wide, 1, 2)
    root = np.linalg.cholesky(inner)
    factors: Floats = np.linalg.solve(root, model.common * choice.sigma)
    return factors


def travel(points: Floats) -> float:
    """The length of the path through points (n, d) in their order; all axes move at once, so that
    the length of a step is its largest component."""
    return float(np.abs(np.diff(points, axis=0)).max(axis=1).sum()) if len(points) > 1 else 0.0


def nearest_order(points: Floats, start: Floats) -> NDArray[np.int64]:
    """The order of points (n, d) in which a path from `start` (d,) visits the nearest remaining
    point next; see `travel`."""
    order, position, remaining = list[int](), start, np.arange(len(points))
    while len(remaining):
        nearest = remaining[np.abs(points[remaining] - position).max(axis=1).argmin()]
        order.append(nearest)
        position, remaining = points[nearest], remaining[remaining != nearest]
    return np.array(order, np.int64)


@dataclass(frozen=True)
class Proposal:
    """Poses to calibrate with, in the order of a short path.

    columns: of a table with the poses (mm, mrad), their rank by information, and the mean reduction
    of uncertainty by the poses up to this rank.  reduction: ratio of the parameters' standard
    uncertainties after and before the calibration, geometric mean.  random_reduction: the same with
    as many random poses.  saving: fraction of the path's length that the order saves.  upward: (6,)
    fraction of poses that each axis approaches from below; where both directions are frequent, a
    calibration finds the backlash of the reference.
    """

    columns: dict[str, Floats]
    reduction: float
    random_reduction: float
    saving: float
    upward: Floats


def propose_poses(settings: Config, poses: Floats, count: int) -> Proposal:
    """Choose from poses (n, 6), mm and rad, those whose readings determine the parameters best."""
    sensor, calibrate = settings.sensor, settings.calibrate
    unknowns = choice(sensor, calibrate)
    sigma = np.array(calibrate.reference)
    chosen, remaining = choose_poses(sensor, unknowns, sigma, poses, count)
    rows = pose_information(sensor, unknowns, sigma, poses[:count]).reshape(-1, len(unknowns.names))
    shares = poses[chosen] / np.maximum(np.abs(poses).max(axis=0), 1e-12)
    rest = np.zeros((1, 6))
    order = nearest_order(shares, rest[0])
    columns = state_columns(poses[chosen[order]])
    columns["rank"], columns["mean_left"] = order + 1, remaining[order]
    long, short = (travel(np.vstack([rest, places])) for places in (shares, shares[order]))
    random_reduction = mean_reduction(np.eye(rows.shape[1]) + rows.T @ rows)
    steps = np.diff(np.vstack([rest, shares[order]]), axis=0)
    upward = (steps > 0).sum(axis=0) / np.maximum((steps != 0).sum(axis=0), 1)
    return Proposal(columns, remaining[-1], random_reduction, 1 - short / long, upward)
