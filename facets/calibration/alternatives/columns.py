"""What each alternative does to the readings, as columns beside those of a fit's unknowns.

Columns (n, 9, q) are in standard deviations of the readings for each unit of an alternative: mm,
rad, s, shares, and mW of light. A course says how the size of an alternative goes with the rows, or
with the mirror's place: (m, n, w), m courses of w functions each, of which the best is taken.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from itertools import chain, combinations, combinations_with_replacement, permutations, product

import numpy as np

from ...core.names import DETECTORS
from ...core.sensor import BenchLight, Sensor
from ...core.units import Floats
from ...model.arrays import EFFECTS, effect_jacobian, half_sizes, readings
from ..fitting.bundle_adjustment import states_of
from .alternative import LAST_TRIALS, Alternative
from .remainder import Residuals
from .score import STEP_MARGIN

#: Numbers that the courses of a table may take; of longer tables fewer steps and frequencies are
#: tried.
MOST_VALUES = 4_000_000
#: A slow drift is a polynomial of this degree over the run; what follows it better is no step.
DRIFT_DEGREE = 5
#: Powers of x and y up to which the powers may follow the mirror's place.
DEGREE = 4
#: Periods in mm, and directions, of fringes across the beam; longer ones are no fringes over a
#: motion of half a millimetre.
FRINGE_PERIODS_MM, FRINGE_DIRECTIONS = np.geomspace(0.12, 0.6, 14), 12
#: Numbers of periods over a motion's spots, along psi and zeta, at which fringes of a detector's
#: window are searched for, and the least of both together.
WINDOW_PERIODS, LEAST_PERIODS = np.arange(-22.0, 22.5, 0.5), 2.0
#: Half of a width about the best of these, and the number of steps over it.
FINER_WINDOWS = (0.4, 9)
#: The least number of rows between resets of an offset that are searched for.
LEAST_RESET = 20
#: The share of what blocks explain that blocks which begin between them explain at most; of what
#: drifts they explain as much.
RESET_SHARE = 0.8
#: A power below which a detector has no place, mW.
LEAST_POWER_MW = 1e-6
#: Radius of a speck of dust in the beam's standard deviations; the places that are tried, and how
#: far they reach, over the whole beam and then about the best.
DUST_SIGMAS, DUST_WIDTHS = 0.3, ((2.4, 13), (0.6, 7), (0.15, 5))


# ---- things that may move, drift or switch


def separate(rows: Floats, columns: tuple[int, ...]) -> Floats:
    """Columns (n, 9, q) that hold the readings of rows (n, 9), each in the column that `columns`
    (9,) numbers; in none where the number is -1."""
    is_in = np.array(columns)[:, None] == np.arange(max(columns) + 1)
    return np.where(is_in, rows[:, :, None], 0.0)


#: The columns of readings: for each detector one; one for each power; one for each coordinate of a
#: place; one for each place and each power.
BY_DETECTOR = (0, 0, 0, 1, 1, 1, 2, 2, 2)
BY_POWER = (-1, -1, 0, -1, -1, 1, -1, -1, 2)
BY_PLACE = (0, 1, -1, 2, 3, -1, 4, 5, -1)
BY_PLACE_AND_POWER = (0, 0, 1, 2, 2, 3, 4, 4, 5)


def place_columns(remainder: Residuals) -> Floats:
    """The columns of all detectors' places, along psi and zeta."""
    return separate(1 / remainder.noise, BY_PLACE)


def drift_columns(remainder: Residuals) -> Floats:
    """The columns of the beam's place and of all detectors' places."""
    return np.concatenate([remainder.beam_columns, place_columns(remainder)], axis=2)


def detector_columns(remainder: Residuals, k: int) -> Floats:
    """The columns of a detector's place, along psi and zeta."""
    return place_columns(remainder)[:, :, 2 * k : 2 * k + 2]


def unknown_columns(remainder: Residuals, names: tuple[str, ...]) -> Floats:
    """The columns of some of the fit's own unknowns, where it has them all."""
    places = [n for n, name in enumerate(remainder.fit.choice.names) if name in names]
    if len(places) < len(names):
        return np.zeros((*remainder.noise.shape, len(names)))
    return remainder.likelihood.common[:, :, places]


def laser_columns(remainder: Residuals) -> Floats:
    """The column of the laser's power, by its share; as the fit's own unknown has it."""
    whole: Floats = unknown_columns(remainder, ("beam.power",)) * remainder.sensor.beam.power
    return whole if whole.any() else power_columns(remainder, (0, 1, 2)).sum(axis=2, keepdims=True)


#: By how much light that returns into the laser moves the beam, mm, and changes its power.
FEEDBACK_SIGMA = np.array([3e-3, 3e-3, 0.01])


def laser_beam_columns(remainder: Residuals) -> Floats:
    """The columns of the beam's place and of the laser's power, by its share."""
    return np.concatenate([remainder.beam_columns, laser_columns(remainder)], axis=2)


def dark_columns(remainder: Residuals) -> Floats:
    """The columns of the dark current of each detector, as light on its middle."""
    return lamp_columns(remainder)[:, :, ::3]


def lamp_columns(remainder: Residuals) -> Floats:
    """The columns of other light on each detector: its power, and its power times its place."""
    raw, noise, model = remainder.raw, remainder.noise, remainder.model_readings
    columns: Floats = np.zeros((*noise.shape, 9))
    for k in range(3):
        power, places = raw[:, 3 * k + 2], model[:, 3 * k : 3 * k + 2]
        columns[:, 3 * k + 2, 3 * k] = 1 / noise[:, 3 * k + 2]
        for m in (0, 1):
            across = 1 / power / noise[:, 3 * k + m]
            columns[:, 3 * k + m, 3 * k] = -places[:, m] * across
            columns[:, 3 * k + m, 3 * k + 1 + m] = across
    return columns


# ---- courses


def steps(remainder: Residuals) -> Floats:
    """Courses that begin at one of the samples and stay."""
    count = len(remainder.noise)
    every = max(1, count**2 // MOST_VALUES)
    first = np.arange(STEP_MARGIN, count - STEP_MARGIN, every)
    behind: Floats = (np.arange(count) >= first[:, None]).astype(float)
    return behind[:, :, None]


def slow_drift(remainder: Residuals) -> Floats:
    """One course of polynomials over the samples, which are zero at the end."""
    rows = remainder.row_numbers
    time = (2 * rows - rows[0] - rows[-1]) / max(rows[-1] - rows[0], 1)  # as the laser's own drift
    slow = np.polynomial.legendre.legvander(time, DRIFT_DEGREE)[None, :, 1:]
    since: Floats = np.asarray(slow - slow[:, -1:], dtype=float)
    return since


def warmth(remainder: Residuals) -> Floats:
    """Courses of the temperature and what follows it, by each of `Data.pasts`; zero where the
    table has none."""
    data = remainder.data
    if data.clock is None or data.pasts is None:
        return np.zeros((1, len(remainder.noise), 1))
    late = data.pasts.T
    return np.stack([np.broadcast_to(data.clock[:, 1], late.shape), late], axis=2)


def angle_courses(remainder: Residuals) -> Floats:
    """One course of polynomials in the mirror's angles over their reach, up to second order."""
    angles = remainder.data.pose[:, 3:]
    ends = angles / np.abs(angles).max(axis=0).clip(1e-12)
    pairs = combinations_with_replacement(range(3), 2)
    squares = np.stack([ends[:, i] * ends[:, j] for i, j in pairs], axis=1)
    whole: Floats = np.column_stack([ends, squares])[None]
    return whole


def frequencies(remainder: Residuals) -> Floats:
    """Frequencies per row that a run tells apart, faster than a slow drift."""
    rows = float(np.ptp(remainder.row_numbers)) + 1
    every = max(1, int(2 * rows) * len(remainder.noise) // MOST_VALUES)
    return np.arange(DRIFT_DEGREE + 1, rows, every) / (2 * rows)


def waves(remainder: Residuals, frequency: Floats) -> Floats:
    """Courses that go up and down at one frequency, also where the rows are too rare to follow."""
    return waves_at(tuple(frequency.tolist()), tuple(remainder.row_numbers.tolist()))


@lru_cache(maxsize=2)  # everything that moves may oscillate
def waves_at(frequency: tuple[float, ...], rows: tuple[int, ...]) -> Floats:
    phase = 2 * np.pi * np.array(frequency)[:, None] * np.array(rows)
    return np.stack([np.cos(phase), np.sin(phase)], axis=-1)


# ---- light


def shape_columns(remainder: Residuals) -> Floats:
    """Columns in which each power is a smooth function of the mirror's x and y by itself.

    What scatters follows nothing; light of another shape than the model's does, also where a beam
    or a power of each sample's own takes up most of it.
    """
    place = remainder.data.pose[:, :2] + remainder.fit.own_values[:, :2]
    place = place - np.median(place, axis=0)
    x, y = (place / np.abs(place).max(axis=0).clip(1e-12)).T
    rows = np.column_stack([x**a * y**b for a in range(DEGREE + 1) for b in range(DEGREE + 1 - a)
                            if a + b > 1])  # fmt: skip
    count = rows.shape[1]
    columns = np.zeros((len(rows), 9, 3 * count))
    for k in range(3):
        columns[:, 3 * k + 2, k * count : (k + 1) * count] = rows * remainder.light[:, k : k + 1]
    return columns


def effect_columns(remainder: Residuals, series: str) -> Floats:
    """The columns of the effects of light whose names begin with a series."""
    names = [name for name in EFFECTS if name.startswith(series)]
    whole = effect_jacobian(remainder.sensor, remainder.state, names=names)
    picked: Floats = whole[:, :, [EFFECTS.index(name) for name in names]]
    return picked / remainder.noise[:, :, None]


def chip_columns(remainder: Residuals) -> Floats:
    """The columns of an area broken off the tip of each facet, by mm^2: each facet lights its own
    detector."""
    return separate(effect_columns(remainder, "tip.area")[:, :, 0], BY_DETECTOR)


def uneven_columns(remainder: Residuals) -> Floats:
    """The columns of facets that reflect less and less along x and y, by the share for each mm from
    the tip.

    Of a Gaussian beam that is as much as a shift of the light on it, and of its place in the beam.
    """
    columns = np.zeros((*remainder.noise.shape, 6))
    for k in range(3):
        part, into = slice(3 * k, 3 * k + 3), slice(2 * k, 2 * k + 2)
        columns[:, part, into] = (
            -(beam_sigma(remainder.sensor) ** 2) * remainder.beam_columns[:, part]
        )
        columns[:, 3 * k + 2, into] += remainder.light[:, k, None] * place_in_beam(remainder)
    return columns


def yield_columns(remainder: Residuals) -> Floats:
    """The columns of facets that turn by shares of the mirror's angles."""
    facets = [f"facet_{k}.{angle}" for k in DETECTORS for angle in ("inclination", "azimuth")]
    turned, angles = unknown_columns(remainder, tuple(facets)), remainder.data.pose[:, 3:]
    whole: Floats = np.einsum("niq,nm->niqm", turned, angles)
    return whole.reshape(*remainder.noise.shape, -1)


def responsivity_columns(remainder: Residuals) -> Floats:
    """The columns of detectors whose responsivity varies over their faces, by the share at the
    edge, for each term of first and second order in the spot's place."""
    columns = np.zeros((*remainder.noise.shape, 15))
    for k, half in enumerate(half_sizes(remainder.sensor)):
        y, z = (remainder.raw[:, 3 * k : 3 * k + 2] / half).T
        terms = np.column_stack([y, z, y * y, y * z, z * z])
        columns[:, 3 * k + 2, 5 * k : 5 * k + 5] = terms * remainder.light[:, k : k + 1]
    return columns


def scatter_columns(remainder: Residuals) -> Floats:
    """The columns of light that each facet scatters onto the other detectors, by its share: its
    power, and its power times its place."""
    lamp, power = lamp_columns(remainder), remainder.model_readings[:, 2::3]
    parts = [
        lamp[:, :, 3 * k : 3 * k + 3] * power[:, None, None, j]
        for j, k in permutations(range(3), 2)
    ]
    return np.concatenate(parts, axis=2)


def power_columns(remainder: Residuals, detectors: tuple[int, ...]) -> Floats:
    """The columns of the powers of some detectors, each by itself."""
    return separate(np.repeat(remainder.light, 3, axis=1), BY_POWER)[:, :, detectors]


def beam_sigma(sensor: Sensor) -> float:
    """The standard deviation of the Gaussian part of the beam, mm; the mean of both directions."""
    return float(np.sqrt(sensor.beam.diameter_x * sensor.beam.diameter_y)) / 4


def place_in_beam(remainder: Residuals) -> Floats:
    """The apex's place (n, 2) from the beam's middle, mm."""
    place: Floats = remainder.state[:, :2] - remainder.state[:, 6:]
    return place


def fringes(remainder: Residuals) -> Floats:
    """Courses of fringes that stand in the beam: the light at the apex follows its place there."""
    place, sigma = place_in_beam(remainder), beam_sigma(remainder.sensor)
    envelope = np.exp(-(place**2).sum(axis=1) / 2 / sigma**2)
    angle = np.arange(FRINGE_DIRECTIONS) * np.pi / FRINGE_DIRECTIONS
    along = place @ np.array([np.cos(angle), np.sin(angle)])
    phase = (2 * np.pi * along[:, :, None] / FRINGE_PERIODS_MM).reshape(len(place), -1).T
    standing: Floats = np.stack([np.cos(phase), np.sin(phase)], axis=-1) * envelope[:, None]
    return standing


def window_columns(remainder: Residuals, k: int) -> Floats:
    """The columns of a detector's power and place."""
    return np.concatenate([power_columns(remainder, (k,)), detector_columns(remainder, k)], axis=2)


def spot_range(remainder: Residuals, k: int) -> Floats:
    """The range (2,) of the spot's places on a detector, mm."""
    place = remainder.raw[remainder.is_read[:, 3 * k], 3 * k : 3 * k + 2]
    across: Floats = np.ptp(place, axis=0) if len(place) else np.zeros(2)
    return across.clip(1e-12)


def window_fringes(remainder: Residuals, periods: Floats, k: int) -> Floats:
    """Courses of fringes of a detector's window, periodic in the spot's place.  periods: (m, 2)
    over the range of places."""
    place = remainder.raw[:, 3 * k : 3 * k + 2] / spot_range(remainder, k)
    phase = 2 * np.pi * periods @ place.T
    return np.stack([np.cos(phase), np.sin(phase)], axis=-1)


def likely_fringes(remainder: Residuals, columns: Floats, k: int) -> Floats:
    """The numbers of periods (m, 2) of the fringes that would explain most of what columns (n, 9,
    q) explain, if no unknown took up any of it."""
    along = WINDOW_PERIODS[WINDOW_PERIODS >= 0]
    place = remainder.raw[:, 3 * k : 3 * k + 2] / spot_range(remainder, k)
    psi = np.exp(2j * np.pi * along[:, None] * place[:, 0])
    zeta = np.exp(2j * np.pi * WINDOW_PERIODS[:, None] * place[:, 1])
    level = np.zeros((len(along), len(WINDOW_PERIODS)))
    for n in range(columns.shape[2]):
        column = columns[:, :, n]
        pulled = (column * remainder.pulled).sum(axis=1)
        square = np.einsum("ni,nij,nj->", column, remainder.inverse, column)
        level += np.abs((psi * pulled) @ zeta.T) ** 2 / max(square, 1e-300)
    level[np.hypot(along[:, None], WINDOW_PERIODS) < LEAST_PERIODS] = 0.0
    best = np.argsort(-level, axis=None)[:LAST_TRIALS]
    first, second = np.unravel_index(best, level.shape)
    return np.column_stack([along[first], WINDOW_PERIODS[second]])


# ---- light that is lost at a place of the mirror or of the beam


def narrow_beam(sensor: Sensor, diameter: float) -> Sensor:
    """The sensor with a thin beam, mm, whose ideal light shows where one ray goes."""
    narrow = replace(sensor.beam, diameter_x=diameter, diameter_y=diameter)
    return replace(sensor, beam=narrow, light=BenchLight())


class RayLanding:
    """Where the rays of a beam land: on each detector, by the place (..., 2) at which they meet the
    mirror, from its apex, mm. Exact for flat facets."""

    def __init__(self, remainder: Residuals) -> None:
        sensor, state = remainder.sensor, remainder.state
        self.raw, self.model_readings = remainder.raw, remainder.model_readings
        self.azimuths = np.array([facet.azimuth for facet in sensor.facets])
        size = beam_sigma(remainder.sensor)
        thin = narrow_beam(sensor, size / 100)
        self.origin, self.slope = np.empty((3, len(state), 2)), np.empty((3, len(state), 2, 2))
        for k, azimuth in enumerate(self.azimuths):
            ahead = size * np.array([np.cos(azimuth), np.sin(azimuth)])
            across = size / 2 * np.array([-np.sin(azimuth), np.cos(azimuth)])
            seen = []
            for at in (ahead, ahead + across, 2 * ahead):
                ray = state.copy()
                ray[:, 6:] = state[:, :2] + at
                seen.append(readings(thin, ray)[:, 3 * k : 3 * k + 2])
            ways = np.array([across, ahead])
            rise = np.stack([seen[1] - seen[0], seen[2] - seen[0]], axis=1)
            self.slope[k] = np.swapaxes(np.linalg.solve(ways, rise), 1, 2)
            self.origin[k] = seen[0] - self.slope[k] @ ahead

    def place(self, k: int, at: Floats) -> Floats:
        """Places (n, 2) on detector k of rays at (n, 2) from the apex."""
        where: Floats = self.origin[k] + (self.slope[k] @ at[:, :, None])[:, :, 0]
        return where

    def facet(self, at: Floats) -> Floats:
        """Numbers of the facets (...) that rays at (..., 2) from the apex meet."""
        angle = np.arctan2(at[..., 1], at[..., 0])[..., None] - self.azimuths
        nearest: Floats = np.argmax(np.cos(angle), axis=-1)
        return nearest


def lost_light(remainder: Residuals, landing: RayLanding, at: Floats, weight: Floats) -> Floats:
    """What the readings (n, 9) lose where light of shares (n, m) of the laser's power is lost at
    places (n, m, 2) from the apex."""
    power = remainder.sensor.beam.power
    facets, out = landing.facet(at), np.zeros(remainder.noise.shape)
    raw, model = landing.raw, landing.model_readings
    for k in range(3):
        share = power * weight * (facets == k)
        loss = share.sum(axis=1)
        middle = (share[:, :, None] * at).sum(axis=1) / np.maximum(loss, 1e-300)[:, None]
        out[:, 3 * k + 2] = -loss
        rest = model[:, 3 * k : 3 * k + 2] - landing.place(k, middle)
        out[:, 3 * k : 3 * k + 2] = (loss / raw[:, 3 * k + 2])[:, None] * rest
    return out / remainder.noise


def square_grid(width: float, count: int) -> Floats:
    """Places (count^2, 2) over a square of half a width about zero."""
    x, y = np.meshgrid(*[np.linspace(-width, width, count)] * 2)
    return np.column_stack([x.ravel(), y.ravel()])


def shadows(remainder: Residuals, places: Floats) -> Floats:
    """Courses of the light in specks at places (m, 2) of the mirror from its tip, over that of one
    in the beam's middle."""
    sigma, offset = beam_sigma(remainder.sensor), place_in_beam(remainder)
    apart = ((offset + places[:, None]) ** 2).sum(axis=2)
    light: Floats = np.exp(-apart / 2 / sigma**2 / (1 + DUST_SIGMAS**2))[:, :, None]
    return light


def dust_column(remainder: Residuals, landing: RayLanding, place: Floats) -> Floats:
    """The column (n, 9) of a speck at a place (2,) of the mirror from its tip, mm, by the share of
    the light in it that it absorbs."""
    largest = DUST_SIGMAS**2 / (1 + DUST_SIGMAS**2)
    share = largest * shadows(remainder, place[None])[0]
    at = np.broadcast_to(place, (len(share), 1, 2))
    return lost_light(remainder, landing, at, share)


# ---- the reference


#: How far the reference may err by each of its kinds of error, 1 sigma: shares of its ways, mm from
#: the line of measurement, rad of its axes; bow: of lengths and angles, mm and rad at the ends.
REFERENCE_SIGMAS = {"scale": 5e-3, "abbe": 10.0, "squareness": 5e-3}
BOW_SIGMAS = np.repeat([5e-3, 2e-5], 3)


def reference_columns(remainder: Residuals, terms: list[tuple[int, Floats]]) -> Floats:
    """The columns of errors of the reference: the axis that errs, and by what (n,), for each."""
    by_pose = remainder.pose_columns
    return np.stack([by_pose[:, :, axis] * size[:, None] for axis, size in terms], axis=-1)


def reference_terms(remainder: Residuals) -> dict[str, list[tuple[int, Floats]]]:
    """Each kind of error of the reference: the axes that err, and by what (n,) in prior standard
    uncertainties.

    abbe: lengths that are measured beside the apex, each along another line, err by the angles.
    bow: axes err by the square of where a length is.  cosine: lengths that are measured by what
    turns with the stage err by squares of the angles.
    """
    pose = remainder.data.pose
    ends: Floats = pose / np.abs(pose).max(axis=0).clip(1e-12)
    pairs = {
        "scale": [(n, n) for n in range(6)],
        "abbe": [(n, m) for n, m in product(range(3), range(3, 6)) if m != n + 3],
        "squareness": [*permutations(range(3), 2), *permutations(range(3, 6), 2)],
    }
    terms = {
        kind: [(n, sigma * pose[:, m]) for n, m in pairs[kind]]
        for kind, sigma in REFERENCE_SIGMAS.items()
    }
    terms["bow"] = square_terms(ends, range(6), [(m, m) for m in range(3)])
    terms["cosine"] = square_terms(
        ends, range(3), list(combinations_with_replacement(range(3, 6), 2))
    )
    mixed = square_terms(ends, range(6), list(combinations(range(6), 2)))
    return terms | {"reference": [*chain(*terms.values()), *mixed]}


def square_terms(
    ends: Floats, axes: range, pairs: list[tuple[int, int]]
) -> list[tuple[int, Floats]]:
    """Errors of axes by products of pairs of coordinates (n, 6), each over its largest."""
    return [(n, BOW_SIGMAS[n] * ends[:, i] * ends[:, j]) for n, (i, j) in product(axes, pairs)]


def changed_columns(remainder: Residuals, fault: Alternative) -> Floats:
    """The column of a change of the reference's poses that is small for these samples."""
    assert fault.change is not None
    moved = fault.change(remainder.data).pose - remainder.data.pose
    return remainder.pose_columns @ moved[:, :, None]


def axis_delay_columns(remainder: Residuals) -> Floats:
    """The columns of a delay of each axis of the reference, s; zero where the table is no motion in
    time."""
    velocity = remainder.data.velocity
    return remainder.pose_columns * (0.0 if velocity is None else velocity[:, None])


def moving_columns(remainder: Residuals) -> Floats:
    """The columns of each detector's delay, s; zero where the table is no motion in time."""
    data = remainder.data
    if data.velocity is None or data.clock is None:
        return np.zeros((*remainder.noise.shape, 3))
    moving = np.einsum("nij,nj->ni", remainder.pose_columns, data.velocity)
    return separate(moving, BY_DETECTOR)


def clock_columns(remainder: Residuals) -> Floats:
    """The column of a reference that is later and later, s at the end of the run."""
    moving = moving_columns(remainder).sum(axis=2, keepdims=True)
    clock = remainder.data.clock
    late: Floats = moving if clock is None else moving * clock[:, :1, None]
    return late


# ---- detectors and their electronics


def memory_columns(remainder: Residuals) -> Floats:
    """The columns of what each detector keeps of the row before, as a share: of places, of
    powers. Less what the model has for a row: its noise would look like a share of itself."""
    moves = remainder.data.moves
    return kept_columns(remainder, moves.before if moves else remainder.model_readings)


def memory_in_use(remainder: Residuals) -> Floats:
    """The same where each pose comes after the one on the other side of the motion."""
    return kept_columns(
        remainder, 2 * np.median(remainder.model_readings, axis=0) - remainder.model_readings
    )


def kept_columns(remainder: Residuals, before: Floats) -> Floats:
    """The columns of a share of readings before (n, 9) that each detector keeps."""
    return separate((before - remainder.model_readings) / remainder.noise, BY_PLACE_AND_POWER)


def averaged_columns(remainder: Residuals) -> Floats:
    """The column of readings of a motion that were averaged over rows, by the mean square of the
    rows' distance."""
    data, result = remainder.data, remainder.fit
    moves = data.moves
    if data.velocity is None or moves is None:
        return np.zeros((*remainder.noise.shape, 1))
    own, values, sensor = result.own_values, result.all_values, remainder.sensor
    half = (moves.last + moves.following) / 2
    before, here, behind = (
        readings(sensor, states_of(data._replace(pose=data.pose + step), own, values))
        for step in (moves.bend / 2 - half, np.zeros(6), moves.bend / 2 + half)
    )
    column = (before + behind) / 2 - here
    return (column / remainder.noise)[:, :, None]


def leak_columns(remainder: Residuals) -> Floats:
    """The columns of a share of each detector's currents in the channels of each other one."""
    raw, noise = np.nan_to_num(remainder.data.raw), remainder.noise  # what is not read is no leak
    columns = np.zeros((*noise.shape, 6))
    for n, (k, j) in enumerate(permutations(range(3), 2)):
        share = raw[:, 3 * k + 2] / np.maximum(remainder.raw[:, 3 * j + 2], LEAST_POWER_MW)
        columns[:, 3 * j + 2, n] = raw[:, 3 * k + 2] / noise[:, 3 * j + 2]
        for m in (0, 1):
            apart = raw[:, 3 * k + m] - raw[:, 3 * j + m]
            columns[:, 3 * j + m, n] = share * apart / noise[:, 3 * j + m]
    return columns


def likely_resets(remainder: Residuals, columns: Floats) -> tuple[Floats, int]:
    """Blocks (n, b) of rows, and their length: of all lengths the one at which columns (n, 9, q)
    with other amounts in each block would explain most if no unknown took up any of it. No blocks
    where there would be few, which are jumps, where they would be too many for a long table, or
    where what they explain does not begin with them."""
    pulled = (np.swapaxes(columns, 1, 2) @ remainder.pulled[:, :, None])[:, :, 0]
    square = np.einsum("niq,nij,njq->nq", columns, remainder.inverse, columns)
    rows, count = remainder.row_numbers - 1, len(pulled)
    most = MOST_VALUES // (columns[0].size * count)
    least, longest = max(LEAST_RESET, rows[-1] // max(most, 1) + 1), rows[-1] // 5
    if longest < least:
        return np.zeros((count, 1)), 0
    lengths = range(least, longest + 1, max(1, (longest - least) * count // MOST_VALUES))

    def gain(length: int, offset: int = 0) -> float:
        first = np.flatnonzero(np.diff((rows + offset) // length, prepend=-1))
        falls: Floats = np.add.reduceat(pulled, first) ** 2
        falls /= np.maximum(np.add.reduceat(square, first), 1e-300)
        return float(falls.sum()) - 2 * falls.size  # chance explains 1 each

    best = max(lengths, key=gain)
    if gain(best, best // 2) > RESET_SHARE * gain(best):
        return np.zeros((count, 1)), 0
    block = rows // best
    return (block[:, None] == np.unique(block)).astype(float), best


def amplifier_columns(remainder: Residuals) -> Floats:
    """The columns of amplifiers whose gain grows with the current, by the share at a current of 1
    mW of light, for each of the four electrodes of each detector."""
    raw = remainder.data.raw
    columns = np.zeros((*raw.shape, 12))
    for k, half in enumerate(half_sizes(remainder.sensor)):
        power = raw[:, 3 * k + 2]
        for m in (0, 1):
            ratio = raw[:, 3 * k + m] / half[m]
            for n, sign in enumerate((-1, 1)):
                current, column = power * (1 + sign * ratio) / 2, 4 * k + 2 * m + n
                bent = sign * (1 - sign * ratio) * current**2 / power
                columns[:, 3 * k + m, column] = half[m] * bent
                columns[:, 3 * k + 2, column] = current**2 / 2
    return columns / remainder.noise[:, :, None]
