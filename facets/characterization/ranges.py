"""The limits of the range as smooth margins, and the ranges of axes.

A margin is positive if its limit is kept. All margins are scaled to order one, so that the smallest
of them indicates where the range ends and why.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import prod
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.arguments import check_arguments
from ..core.errors import InputError
from ..core.names import FINE_UNITS, POSE
from ..core.notebook import show_shortly
from ..core.rigid_body import MeasuredObject, displacement_slopes, mirror_poses
from ..core.rules import Rules
from ..core.sensor import Sensor
from ..core.units import Floats, Integers
from ..detectors.noise import fullness, least_light, other_light, standard_deviations
from ..model.arrays import (
    as_rows,
    centroids_as_ends,
    edge_distances,
    edge_limits,
    footprints,
    half_sizes,
    jacobian,
    readings,
)

#: Causes that end a range.
CAUSES = (
    "spot leaves the PSD",
    "too little light",
    "detector saturated",
    "Jacobian near singular",
    "too coarse",
)
PSD, LIGHT, SATURATED, SINGULAR, COARSE = range(5)
#: The reading without which Eq. (11) takes the determinant: the power of C.
LEFT_OUT = 8
#: Largest distances of the search: mm and rad, larger than any range of a sensor of this kind.
FARTHEST_MM_RAD = (30.0, 30.0, 30.0, 0.5, 0.5, 0.5)
#: Rays along the pose's axes, to the low and to the high ends of their ranges.
AXIS_RAYS = np.concatenate([-np.diag(FARTHEST_MM_RAD), np.diag(FARTHEST_MM_RAD)])


def states_of(poses: Floats, rules: Rules) -> Floats:
    """Convert poses (n, 6), or displacements of the rules' object, to states (n, 8), with the
    beam's place by the rules."""
    state = np.zeros((len(poses), 8))
    if rules.object is not None:
        poses = mirror_poses(poses, rules.object)
    state[:, :6] = poses
    if rules.tracking:
        state[:, 6:] = poses[:, :2]
    return state


def scaled_jacobian(sensor: Sensor, state: Floats) -> Floats:
    """The Jacobian at states (n, 8): columns per um and urad, rows in standard deviations of the
    readings; (n, 9, 8)."""
    return scale_to_noise(sensor, state, jacobian(sensor, state))


def scale_to_noise(sensor: Sensor, state: Floats, matrix: Floats) -> Floats:
    """Scale derivatives (n, 9, 8) at states (n, 8) from mm and rad to um and urad (columns), and
    from the readings' units to their standard deviations (rows)."""
    sigma = standard_deviations(sensor, readings(sensor, state))
    scaled: Floats = matrix * FINE_UNITS / sigma[:, :, None]
    return scaled


def clearances(sensor: Sensor, poses: Floats, rules: Rules) -> Floats:
    """The margins (n, 5) at poses (n, 6), in the order of CAUSES; positive inside.

    The first is in units of the detector's half size, -1 for a lost spot; others are logarithms.
    """
    state = states_of(poses, rules)
    reading, ends = readings(sensor, state), footprints(sensor, state)
    out = np.full((len(poses), len(CAUSES)), np.inf)
    limits = edge_limits(half_sizes(sensor), sensor.apertures.rim)
    out[:, PSD] = spot_clearances(ends, reading, limits, rules)
    out[:, LIGHT] = light_clearances(sensor, reading, rules)
    out[:, SATURATED] = saturation_clearances(sensor, reading)
    lit = (out[:, PSD] > -1) & (out[:, LIGHT] > NO_LIGHT)
    coarse = np.isfinite(rules.coarsest).any()
    if lit.any() and (coarse or np.isfinite(rules.condition)):
        out[lit, SINGULAR:] = information_margins(sensor, state[lit], rules)
    return out


#: A margin of light below this logarithm counts as no light.
NO_LIGHT = -690.0


def light_clearances(sensor: Sensor, reading: Floats, rules: Rules) -> Floats:
    """The margin of light of readings (n, 9): logarithm of the least light over its limit; (n,)."""
    other = other_light(sensor)
    light = (reading[:, 2::3] - other) / (least_light(sensor, rules.snr) - other)
    clearance: Floats = np.log(np.maximum(np.nan_to_num(least_of_rows(light)), 1e-300))
    return clearance


def saturation_clearances(sensor: Sensor, reading: Floats) -> Floats:
    """The margin of the amplifiers of readings (n, 9): logarithm of the end of their range over the
    largest current; (n,), infinite without electronics."""
    if sensor.electronics is None:
        return np.full(len(reading), np.inf)
    load = np.nan_to_num(fullness(sensor, reading)).max(axis=1)
    clearance: Floats = -np.log(np.maximum(load, 1e-300))
    return clearance


def spot_clearances(ends: Floats, reading: Floats, limits: Floats, rules: Rules) -> Floats:
    """The least margin of a spot to its detector's edge, over the detector's half size; (n,).

    ends: (n, 3, 5), see `footprints`.  limits: (3, 5) or (n, 3, 5), see `edge_limits`.
    """
    if rules.whole_spot:
        # A facet without light inside the circle has no footprint: its centroid counts.
        bare = np.isnan(ends[:, :, 0]) & ~np.isnan(reading[:, 0::3])
        if bare.any():
            ends = ends.copy()
            ends[bare, :4], ends[bare, 4] = centroids_as_ends(reading)[bare], -np.inf
    else:
        ends = np.concatenate([centroids_as_ends(reading), ends[:, :, 4:]], axis=2)
    distances = edge_distances(ends, limits)
    distances[:, :, :4] /= limits[..., :4]
    margin = least_of_rows(distances)
    return np.where(np.isnan(margin), -1.0, np.maximum(margin, -1.0))


def least_of_rows(values: Floats) -> Floats:
    """The least number of each row of an array (n, ...), NaN for a row with NaN: (n,).

    Ten times as fast as NumPy's minimum along short rows.
    """
    columns = values.reshape(len(values), prod(values.shape[1:])).T
    smallest: Floats = np.ascontiguousarray(columns).min(axis=0)
    return smallest


def information_margins(sensor: Sensor, state: Floats, rules: Rules) -> Floats:
    """The margins of conditioning and of resolution, (n, 2)."""
    matrix = scaled_jacobian(sensor, state)
    out = np.full((len(state), 2), -1.0)
    finite = np.isfinite(matrix).all(axis=(1, 2))
    values = np.linalg.svd(matrix[finite], compute_uv=False)
    with np.errstate(divide="ignore"):
        out[finite, 0] = np.log(rules.condition * values[:, -1] / values[:, 0])
    if np.isfinite(rules.coarsest).any():
        fine = standard_uncertainties(matrix[finite], fine_slopes(state[finite], rules.object))
        sigma = fine * np.array(FINE_UNITS[:6])
        out[finite, 1] = np.log(np.array(rules.coarsest) / sigma).min(axis=1)
    else:
        out[finite, 1] = np.inf
    return out


def standard_uncertainties(matrices: Floats, slopes: Floats | None = None) -> Floats:
    """Standard uncertainties of the pose, um and urad, (n, 6), from scaled Jacobians (n, 9, 8).

    slopes: (n, 6, 6), see `fine_slopes`, for an object's pose.
    """
    inverse = np.linalg.pinv(matrices)
    if slopes is not None:
        inverse = slopes @ inverse[:, :6]
    sigma: Floats = np.sqrt((inverse**2).sum(axis=2))[:, :6]
    return sigma


def fine_slopes(states: Floats, body: MeasuredObject | None) -> Floats | None:
    """Derivatives (n, 6, 6) of an object's displacement by the mirror's pose at states (n, 8), per
    um and urad in um and urad; None for the mirror itself."""
    if body is None:
        return None
    units = np.array(FINE_UNITS[:6])
    slopes: Floats = displacement_slopes(states[:, :6], body) * units / units[:, None]
    return slopes


class Exits(NamedTuple):
    """Distances at which rays leave the range, and numbers of the causes (-1: the ray does not
    leave it)."""

    distance: Floats
    cause: NDArray[np.int64]


#: Number of steps that are examined at once, and fractions of the farthest distance at which a ray
#: is examined before its exit is refined.
STEPS_AT_ONCE = 5
STEP_FRACTIONS = np.concatenate([[0.0], np.geomspace(1e-3, 1.0, 28)])


def find_exits(
    sensor: Sensor, rules: Rules, start: Floats, rays: Floats, tolerance: float = 1e-6
) -> Exits:
    """Distances at which rays (n, 6) from the pose `start` (6,) inside the range first leave it.

    tolerance: of the distance, in units of the rays' own lengths.
    """

    def margins_at(distance: Floats, ray: Integers) -> Floats:
        """The margins (n, 5) at distances (n,) along the rays of these numbers."""
        return clearances(sensor, start + distance[:, None] * rays[ray], rules)

    def signs_at(distance: Floats, ray: Integers) -> Floats:
        """The signs (n,) of the determinant at distances (n,) along the rays of these numbers."""
        return determinant_signs(sensor, start + distance[:, None] * rays[ray], rules)

    limited = np.isfinite([rules.condition, *rules.coarsest]).any()
    return first_exits(margins_at, len(rays), tolerance, signs_at if limited else None)


def determinant_signs(sensor: Sensor, poses: Floats, rules: Rules) -> Floats:
    """Signs (n,) of the determinants of Eq. (11) at poses (n, 6); NaN without light.

    Between poses with different signs the Jacobian is near singular, however thin that band is.
    """
    matrices = np.delete(jacobian(sensor, states_of(poses, rules)), LEFT_OUT, axis=1)
    with np.errstate(invalid="ignore"):
        signs: Floats = np.linalg.slogdet(matrices)[0]
    return signs


#: Columns of a table of places along rays; the heights and slopes of the margins follow.
RAY, PLACE, SIGN, CAUSE, HEIGHTS = range(5)


def first_exits(
    margins_at: Callable[[Floats, Integers], Floats],
    count: int,
    tolerance: float,
    signs_at: Callable[[Floats, Integers], Floats] | None = None,
) -> Exits:
    """Distances at which `count` rays that begin inside a range first leave it.

    margins_at: function that computes the margins (m, causes) at distances (m,) along the rays of
    ascending numbers (m,).  tolerance: that of a distance.  signs_at: function that computes signs
    (m,) there; between different signs a margin may be small.
    """
    from scipy.optimize.elementwise import find_root

    def least_margin(distance: Floats, ray: Integers) -> Floats:
        """The least margin at distances of any shape along the rays of these numbers."""
        return least_of_rows(margins_at(distance.ravel(), ray.ravel())).reshape(distance.shape)

    def look(distance: Floats, ray: Integers) -> Floats:
        """Examine places (n,): columns RAY to CAUSE, then heights and slopes of the margins."""
        places = np.stack([distance, distance + tolerance], axis=1).ravel()
        margins = margins_at(places, np.repeat(ray, 2)).reshape(len(ray), 2, -1)
        signs = np.ones(len(ray)) if signs_at is None else signs_at(distance, ray)
        with np.errstate(invalid="ignore", over="ignore"):
            height = np.expm1(margins)
            slope = (height[:, 1] - height[:, 0]) / tolerance
        about = np.stack([ray, distance, signs, margins[:, 1].argmin(axis=1)], axis=1)
        return np.concatenate([about, height[:, 0], slope], axis=1)

    ends, causes = np.full(count, np.inf), np.full(count, -1)
    numbers, examined = np.arange(count), []
    for begin in range(0, len(STEP_FRACTIONS), STEPS_AT_ONCE):
        if len(numbers):
            steps = STEP_FRACTIONS[begin : begin + STEPS_AT_ONCE]
            examined.append(look(np.tile(steps, len(numbers)), np.repeat(numbers, len(steps))))
            # Rays that have left the range need no further steps.
            numbers = np.setdiff1d(numbers, examined[-1][is_outside(examined[-1]), RAY].astype(int))
    while examined:
        rows = np.concatenate(examined)
        rows = rows[np.lexsort([rows[:, PLACE], rows[:, RAY]])]
        outside = np.flatnonzero(
            is_outside(rows) & (rows[:, PLACE] < ends[rows[:, RAY].astype(int)])
        )
        which, first = np.unique(rows[outside, RAY].astype(int), return_index=True)
        if len(which):
            bracket = rows[outside[first] - 1, PLACE], rows[outside[first], PLACE]
            tolerances = {"xatol": tolerance, "xrtol": 0, "fatol": 0}
            ends[which] = find_root(least_margin, bracket, args=(which,), tolerances=tolerances).x
            last = look(ends[which], which)
            causes[which] = last[:, CAUSE]
            examined = [rows[rows[:, PLACE] <= ends[rows[:, RAY].astype(int)]], last]
            continue
        place, ray = doubtful_places(rows, tolerance)
        examined = [rows, look(place, ray)] if len(ray) else []
    return Exits(np.minimum(ends, 1.0), causes)


def is_outside(rows: Floats) -> NDArray[np.bool_]:
    """Whether places (n,) are outside the range; rows: those of `first_exits`."""
    heights = rows[:, HEIGHTS : (HEIGHTS + rows.shape[1]) // 2]
    return ~(least_of_rows(heights) > 0)


def doubtful_places(rows: Floats, tolerance: float) -> tuple[Floats, Integers]:
    """Places (m,) between those of `rows`, and the numbers (m,) of their rays, where a margin may
    be negative: where its tangents from both sides meet below zero, or halfway between different
    signs."""
    near, far = rows[:-1], rows[1:]
    open_ = (near[:, RAY] == far[:, RAY]) & (far[:, PLACE] - near[:, PLACE] > 4 * tolerance)
    near, far = near[open_], far[open_]
    count = (rows.shape[1] - HEIGHTS) // 2
    width = (far[:, PLACE] - near[:, PLACE])[:, None]
    height, fall = near[:, HEIGHTS:-count], -near[:, -count:]
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        rise = far[:, -count:]
        away = (height - far[:, HEIGHTS:-count] + rise * width) / (fall + rise)
        sinks = (fall > 0) & (rise > 0) & (height < fall * away)
    away = np.where(sinks, away, np.inf).min(axis=1)
    turns = near[:, SIGN] * far[:, SIGN] < 0
    away = np.where(turns & np.isinf(away), width[:, 0] / 2, away)
    some = np.isfinite(away)
    away = np.clip(away, tolerance, width[:, 0] - tolerance)
    return (near[:, PLACE] + away)[some], near[some, RAY].astype(int)


@show_shortly
@dataclass(frozen=True)
class AxisRange:
    """The range of one axis with the others fixed: its ends, mm or rad, and their causes."""

    name: str
    low: float
    high: float
    low_cause: int
    high_cause: int

    @property
    def total(self) -> float:
        """The width of the range, mm or rad."""
        return self.high - self.low

    @property
    def symmetric(self) -> float:
        """Twice the nearer end: the largest range with equal lengths to both sides."""
        return 2 * min(self.high, -self.low)


def require_inside(sensor: Sensor, rules: Rules, start: ArrayLike) -> Floats:
    """Return a pose (6,) as an array. Raises `InputError` for an invalid pose, and for one outside
    the range, with the excess and the key of the limit."""
    rows, shape = as_rows(start, 6, "start")
    if shape:
        raise InputError(f"start has shape {(*shape, 6)}; needed: (6,), one pose")
    pose: Floats = rows[0]
    clear = clearances(sensor, pose[None], rules)[0]
    if not clear.min() > 0:
        place = ", ".join(f"{name} {value:.4g}" for name, value in zip(POSE, pose, strict=True))
        raise InputError(
            f"the range is measured from {place} (mm, rad), which is outside it: "
            f"{CAUSES[clear.argmin()]}; {remedy(sensor, rules, pose, int(clear.argmin()))}"
        )
    return pose


def remedy(sensor: Sensor, rules: Rules, start: Floats, cause: int) -> str:
    """The requirement of a limit, its value at a pose (6,), and the key that sets it."""
    if cause == LIGHT:
        return light_remedy(sensor, rules, start)
    if cause == SATURATED:
        load = np.nan_to_num(fullness(sensor, readings(sensor, states_of(start[None], rules))[0]))
        return (
            f"the light on detector {'ABC'[int(load.argmax())]} drives an electrode to "
            f"{load.max():.3g} times the end of its range (sensor.electronics.adc_range_v over "
            "transimpedance_kohm); choose a lower sensor.electronics.transimpedance_kohm, less "
            "laser power, or another place"
        )
    if cause == PSD:
        return "choose a place nearer to rest, or larger detectors (sensor.psd.size_mm)"
    key = "range.condition" if cause == SINGULAR else "range.coarsest"
    return f"choose another place, or an easier {key}"


def light_remedy(sensor: Sensor, rules: Rules, start: Floats) -> str:
    """The remedy for too little light at a pose (6,), as a text."""
    powers = np.nan_to_num(readings(sensor, states_of(start[None], rules))[0, 2::3])
    required, other = least_light(sensor, rules.snr), other_light(sensor)
    weakest = int((powers - required).argmin())
    background = (
        f" in addition to {1e3 * other[weakest]:.3g} µW of background light"
        if other[weakest]
        else ""
    )
    return (
        f"detector {'ABC'[weakest]} gets {1e3 * powers[weakest]:.3g} µW, and range.snr "
        f"{rules.snr:g} requires {1e3 * required[weakest]:.3g} µW{background}; choose a place "
        "nearer to the beam's centre, more laser power, or a lower range.snr"
    )


@check_arguments
def axis_ranges(
    sensor: Sensor, rules: Rules, start: ArrayLike, tolerance: float = 1e-9
) -> list[AxisRange]:
    """Find the range of each axis of the pose with the other axes fixed.

    Parameters
    ----------
    sensor
        The sensor.
    rules
        Limits of the range; `Config.range` contains a configuration's limits.
    start
        The pose from which the ranges extend, (6,); mm and rad, world frame; with `Rules.object`
        the displacement of the object from its pose at the mirror's zero.
    tolerance
        Tolerance of an end, in units of `FARTHEST_MM_RAD`.

    Returns
    -------
    list of AxisRange
        Six ranges, with their ends relative to `start` and the causes of the ends. `total` is the
        whole range, from one end to the other; `symmetric` is twice the nearer end, the range of
        the paper's Table 2.

    Raises
    ------
    InputError
        If `start` is outside the range; the message names the limit and the remedy.

    Examples
    --------
    >>> import numpy as np, facets
    >>> config = facets.load("paper")
    >>> z = facets.axis_ranges(config.sensor, config.range, np.zeros(6))[2]
    >>> f"{z.symmetric:.2f} mm, then {facets.CAUSES[z.high_cause]}"
    '12.15 mm, then spot leaves the PSD'
    """
    pose = require_inside(sensor, rules, start)
    exits = find_exits(sensor, rules, pose, AXIS_RAYS, tolerance)
    far = exits.distance * np.tile(FARTHEST_MM_RAD, 2)
    return [
        AxisRange(name, -far[i], far[i + 6], int(exits.cause[i]), int(exits.cause[i + 6]))
        for i, name in enumerate(POSE)
    ]


def largest_box(sensor: Sensor, rules: Rules, start: Floats, sizes: Floats) -> tuple[Floats, int]:
    """Half the sides, proportional to `sizes` (6,), of the largest box about a pose, and its limit.

    The box's 64 corners and 2000 random points of its surface are inside.
    """
    corners = np.array(np.meshgrid(*[[-1.0, 1.0]] * 6)).reshape(6, -1).T
    rng = np.random.default_rng(0)
    surface = rng.uniform(-1, 1, (2000, 6))
    face = rng.integers(0, 6, 2000)
    surface[np.arange(2000), face] = rng.choice([-1.0, 1.0], 2000)
    exits = find_exits(sensor, rules, start, np.concatenate([corners, surface]) * sizes, 1e-7)
    nearest = int(exits.distance.argmin())
    return exits.distance[nearest] * sizes, int(exits.cause[nearest])
