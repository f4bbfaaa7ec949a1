"""Effects of each alternative on the readings, as columns that extend those of a fit's unknowns.

Functions named `..._columns` return columns (n, 9, q) for n samples: derivatives of the readings,
in their standard deviations, by the q quantities that the docstring names, in mm, rad, s,
fractions, or mW of light. Where a quantity cannot act on these samples its columns are zero, and no
function raises an error. Candidates are basis functions (m, n, w) of the row or of the mirror's
position, by which the size of an alternative varies: m candidates of w functions each, of which the
best is taken.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache
from itertools import chain, combinations, combinations_with_replacement, permutations, product

import numpy as np
from numpy.typing import ArrayLike

from ...core.names import DETECTORS
from ...core.sensor import Sensor
from ...core.units import Floats
from ...model.arrays import EFFECTS, effect_jacobian, half_sizes, readings
from ..fitting.bundle_adjustment import states_of
from .alternative import EXACT_TRIALS, Alternative
from .remainder import Residuals
from .score import STEP_MARGIN

#: Maximum number of values of all candidate basis functions of a table; longer tables are searched
#: with fewer steps and frequencies.
MAX_BASIS_VALUES = 4_000_000
#: A slow drift is a polynomial of this degree over the run; what it describes better is no step.
DRIFT_DEGREE = 5
#: Highest power of x and y in the maps by which the powers may vary with the mirror's position.
MAP_DEGREE = 4
#: Periods in mm, and number of directions, of fringes across the beam; longer ones are no fringes
#: over a motion of half a millimetre.
FRINGE_PERIODS_MM, FRINGE_DIRECTIONS = np.geomspace(0.12, 0.6, 14), 12
#: Numbers of periods over the range of a motion's spots, along psi and zeta, of the fringes of a
#: detector's window that are tried, and the least of both together.
WINDOW_PERIODS, LEAST_PERIODS = np.arange(-22.0, 22.5, 0.5), 2.0
#: Half of the width about the best of these that is searched again, and the number of steps in it.
FINER_WINDOWS = (0.4, 9)
#: The least number of rows between resets of an offset that are searched for.
LEAST_RESET = 20
#: Resets of offsets are rejected where blocks that begin half a block later explain more than this
#: fraction of what the best blocks explain, as they do with a drift.
RESET_FRACTION = 0.8


# ---- detectors, beam and lamps


def detector_blocks(effects: Floats) -> Floats:
    """Columns (n, 9, 3 q) each of which acts on one detector, of effects (n, 3, 3, q) on the three
    readings of each detector."""
    count, width = len(effects), effects.shape[3]
    columns = np.zeros((count, 3, 3, 3, width))
    columns[:, range(3), :, range(3)] = np.swapaxes(effects, 0, 1)
    return columns.reshape(count, 9, 3 * width)


def separate(values: Floats, pattern: ArrayLike) -> Floats:
    """Columns (n, 9, 3 q) of values (n, 9) of the readings; pattern (3, q): the columns of a
    detector in which each of its three readings is."""
    return detector_blocks(values.reshape(-1, 3, 3, 1) * np.asarray(pattern))


def follow_powers(remainder: Residuals, terms: Floats) -> Floats:
    """Columns (n, 9, 3 q), in standard deviations of the readings, in which the power of each
    detector varies by terms (n, 3 or 1, q), fractions of that power."""
    effects = np.zeros((len(terms), 3, 3, terms.shape[2]))
    effects[:, :, 2] = terms * remainder.light[:, :, None]
    return detector_blocks(effects)


#: Patterns of `separate`: one column for each detector; one for each coordinate of a spot; one for
#: both coordinates and one for the power.
BY_DETECTOR = np.ones((3, 1))
BY_COORDINATE = ((1, 0), (0, 1), (0, 0))
BY_PLACE_AND_POWER = ((1, 0), (1, 0), (0, 1))


def place_columns(remainder: Residuals) -> Floats:
    """Displacements of the spots on all detectors along psi and zeta, mm: (n, 9, 6)."""
    return separate(1 / remainder.noise, BY_COORDINATE)


def drift_columns(remainder: Residuals) -> Floats:
    """Displacements of the beam (x, y) and of the spots on all detectors (psi, zeta), mm: (n, 9,
    8)."""
    return np.concatenate([remainder.beam_columns, place_columns(remainder)], axis=2)


def detector_columns(remainder: Residuals, k: int) -> Floats:
    """Displacements of the spot on one detector along psi and zeta, mm: (n, 9, 2)."""
    return place_columns(remainder)[:, :, 2 * k : 2 * k + 2]


def unknown_columns(remainder: Residuals, names: tuple[str, ...]) -> Floats:
    """Columns of some of the fit's own unknowns, in the order of `names`: (n, 9, names); zero if
    the fit has not all of them."""
    places = [n for n, name in enumerate(remainder.fit.choice.names) if name in names]
    if len(places) < len(names):
        return np.zeros((*remainder.noise.shape, len(names)))
    return remainder.likelihood.common[:, :, places]


def facet_columns(remainder: Residuals, letters: Iterable[str] = DETECTORS) -> Floats:
    """Inclination and azimuth, rad, of each of some facets: two columns per letter, (n, 9, q)."""
    angles = ("inclination", "azimuth")
    return unknown_columns(
        remainder, tuple(f"facet_{k}.{angle}" for k in letters for angle in angles)
    )


def laser_columns(remainder: Residuals) -> Floats:
    """The relative change of the laser's power, (n, 9, 1), as the fit's own unknown if it has
    that."""
    columns: Floats = unknown_columns(remainder, ("beam.power",)) * remainder.sensor.beam.power
    if not columns.any():
        columns = power_columns(remainder, (0, 1, 2)).sum(axis=2, keepdims=True)
    return columns


#: Prior standard uncertainties of what light that returns into the laser does: displacements of
#: the beam, mm, and the relative change of its power.
FEEDBACK_SIGMA = np.array([3e-3, 3e-3, 0.01])


def laser_beam_columns(remainder: Residuals) -> Floats:
    """Displacements of the beam, mm, and the relative change of the laser's power: (n, 9, 3)."""
    return np.concatenate([remainder.beam_columns, laser_columns(remainder)], axis=2)


def dark_columns(remainder: Residuals) -> Floats:
    """The dark current of each detector, as mW of light on its middle: (n, 9, 3)."""
    return lamp_columns(remainder)[:, :, ::3]


def lamp_columns(remainder: Residuals) -> Floats:
    """Other light on each detector: its power, mW, and its power times its place (psi, zeta), mW
    mm: (n, 9, 9), three columns for each detector."""
    power = remainder.raw.reshape(-1, 3, 3)[:, :, 2, None]
    effects = np.zeros((len(power), 3, 3, 3))
    effects[:, :, :2, 0] = -remainder.model_readings.reshape(-1, 3, 3)[:, :, :2] / power
    effects[:, :, 2, 0] = 1
    effects[:, :, [0, 1], [1, 2]] = 1 / power
    return detector_blocks(effects / remainder.noise.reshape(-1, 3, 3, 1))


# ---- basis functions


def constant(remainder: Residuals) -> Floats:
    """One candidate: 1 in all rows, (1, n, 1)."""
    return np.ones((1, len(remainder.noise), 1))


def steps(remainder: Residuals) -> Floats:
    """Candidates (m, n, 1) that are 0 before one of the samples and 1 from it to the end."""
    count = len(remainder.noise)
    every = max(1, count**2 // MAX_BASIS_VALUES)
    first = np.arange(STEP_MARGIN, count - STEP_MARGIN, every)
    is_later: Floats = (np.arange(count) >= first[:, None]).astype(float)
    return is_later[:, :, None]


def slow_drift(remainder: Residuals) -> Floats:
    """One candidate (1, n, DRIFT_DEGREE): polynomials of the row number that are zero at the
    end."""
    rows = remainder.row_numbers
    time = (2 * rows - rows[0] - rows[-1]) / max(rows[-1] - rows[0], 1)  # as the laser's own drift
    slow = np.polynomial.legendre.legvander(time, DRIFT_DEGREE)[None, :, 1:]
    return np.asarray(slow - slow[:, -1:], dtype=float)


def warmth(remainder: Residuals) -> Floats:
    """Candidates (m, n, 2) of the temperature together with a delayed temperature, for each time
    constant of `Data.pasts`; one candidate of zeros (1, n, 1) if the table has no temperature."""
    data = remainder.data
    if data.clock is None or data.pasts is None:
        return np.zeros((1, len(remainder.noise), 1))
    late = data.pasts.T
    return np.stack([np.broadcast_to(data.clock[:, 1], late.shape), late], axis=2)


def mirror_angles(remainder: Residuals) -> Floats:
    """One candidate (1, n, 3): the mirror's angles, rad."""
    return remainder.data.pose[None, :, 3:]


def angle_polynomials(remainder: Residuals) -> Floats:
    """One candidate (1, n, 9): polynomials of the mirror's angles, relative to their reach, up to
    second order."""
    angles = remainder.data.pose[:, 3:]
    ends = angles / np.abs(angles).max(axis=0).clip(1e-12)
    pairs = combinations_with_replacement(range(3), 2)
    squares = np.stack([ends[:, i] * ends[:, j] for i, j in pairs], axis=1)
    return np.column_stack([ends, squares])[None]


def frequencies(remainder: Residuals) -> Floats:
    """Frequencies (m,), cycles per row, that the run resolves and that are faster than a slow
    drift."""
    rows = float(np.ptp(remainder.row_numbers)) + 1
    every = max(1, int(2 * rows) * len(remainder.noise) // MAX_BASIS_VALUES)
    return np.arange(DRIFT_DEGREE + 1, rows, every) / (2 * rows)


def waves(remainder: Residuals, frequency: Floats) -> Floats:
    """Candidates (m, n, 2) of a cosine and a sine of each frequency (m,), cycles per row, aliased
    ones included."""
    return waves_at(tuple(frequency.tolist()), tuple(remainder.row_numbers.tolist()))


@lru_cache(maxsize=2)  # all drift sources are tried with the same waves
def waves_at(frequency: tuple[float, ...], rows: tuple[int, ...]) -> Floats:
    """The cosine and sine (m, n, 2) of frequencies, cycles per row, at row numbers."""
    phase = 2 * np.pi * np.array(frequency)[:, None] * np.array(rows)
    return np.stack([np.cos(phase), np.sin(phase)], axis=-1)


# ---- light


def shape_columns(remainder: Residuals) -> Floats:
    """Smooth maps over the mirror's x and y by which each power varies separately, as fractions:
    one column for each map and detector.

    Scatter follows no map. Light of another shape than the model's does, also where an unknown beam
    position or power of each sample absorbs most of it.
    """
    place = remainder.data.pose[:, :2] + remainder.fit.own_values[:, :2]
    place = place - np.median(place, axis=0)
    x, y = (place / np.abs(place).max(axis=0).clip(1e-12)).T
    orders = product(range(MAP_DEGREE + 1), repeat=2)
    terms = [x**a * y**b for a, b in orders if 1 < a + b <= MAP_DEGREE]
    return follow_powers(remainder, np.stack(terms, axis=1)[:, None])


def effect_columns(remainder: Residuals, series: str) -> Floats:
    """Effects of real light whose names begin with a series, in the order and units of
    `EFFECTS`."""
    names = [name for name in EFFECTS if name.startswith(series)]
    slopes = effect_jacobian(remainder.sensor, remainder.state, names=names)
    columns: Floats = slopes[:, :, [EFFECTS.index(name) for name in names]]
    return columns / remainder.noise[:, :, None]


def chip_columns(remainder: Residuals) -> Floats:
    """An area broken off the tip of each facet, mm^2, (n, 9, 3): each facet illuminates its own
    detector."""
    return separate(effect_columns(remainder, "tip.area")[:, :, 0], BY_DETECTOR)


def uneven_columns(remainder: Residuals) -> Floats:
    """Facets whose reflectance decreases along x and y, as a fraction per mm from the tip: (n, 9,
    6).

    In a Gaussian beam this shifts the light on the facet, and varies with its place in the beam.
    """
    effects = -(beam_sigma(remainder.sensor) ** 2) * remainder.beam_columns.reshape(-1, 3, 3, 2)
    effects[:, :, 2] += remainder.light[:, :, None] * place_in_beam(remainder)[:, None]
    return detector_blocks(effects)


def responsivity_columns(remainder: Residuals) -> Floats:
    """Detectors whose responsivity varies over their faces: fractions at the edge, for each of the
    five terms of first and second order in the spot's place, (n, 9, 15)."""
    places = remainder.raw.reshape(-1, 3, 3)[:, :, :2] / half_sizes(remainder.sensor)
    y, z = np.moveaxis(places, 2, 0)
    return follow_powers(remainder, np.stack([y, z, y * y, y * z, z * z], axis=2))


def scatter_columns(remainder: Residuals) -> Floats:
    """Light that each facet scatters onto the other detectors, as a fraction of the facet's power:
    its power, and its power times its place, mm; (n, 9, 18)."""
    lamp, power = lamp_columns(remainder), remainder.model_readings[:, 2::3]
    parts = [
        lamp[:, :, 3 * k : 3 * k + 3] * power[:, None, None, j]
        for j, k in permutations(range(3), 2)
    ]
    return np.concatenate(parts, axis=2)


def power_columns(remainder: Residuals, detectors: tuple[int, ...]) -> Floats:
    """Relative changes of the powers of some detectors, (n, 9, detectors)."""
    return follow_powers(remainder, np.ones((len(remainder.noise), 1, 1)))[:, :, detectors]


def beam_sigma(sensor: Sensor) -> float:
    """The standard deviation of the Gaussian part of the beam, mm; the mean of both directions."""
    return float(np.sqrt(sensor.beam.diameter_x * sensor.beam.diameter_y)) / 4


def place_in_beam(remainder: Residuals) -> Floats:
    """The apex's place (n, 2) from the beam's centre, mm."""
    place: Floats = remainder.state[:, :2] - remainder.state[:, 6:]
    return place


def fringes(remainder: Residuals) -> Floats:
    """Candidates (m, n, 2), a cosine and a sine, of fringes that are fixed in the beam, by the
    apex's place in it."""
    place, sigma = place_in_beam(remainder), beam_sigma(remainder.sensor)
    envelope = np.exp(-(place**2).sum(axis=1) / 2 / sigma**2)
    angle = np.arange(FRINGE_DIRECTIONS) * np.pi / FRINGE_DIRECTIONS
    along = place @ np.array([np.cos(angle), np.sin(angle)])
    phase = (2 * np.pi * along[:, :, None] / FRINGE_PERIODS_MM).reshape(len(place), -1).T
    bases: Floats = np.stack([np.cos(phase), np.sin(phase)], axis=-1) * envelope[:, None]
    return bases


def window_columns(remainder: Residuals, k: int) -> Floats:
    """The relative change of a detector's power, and displacements of its spot (psi, zeta), mm: (n,
    9, 3)."""
    return np.concatenate([power_columns(remainder, (k,)), detector_columns(remainder, k)], axis=2)


def spot_range(remainder: Residuals, k: int) -> Floats:
    """The range (2,) of the spot's places on a detector, mm."""
    place = remainder.raw[remainder.is_read[:, 3 * k], 3 * k : 3 * k + 2]
    across: Floats = np.ptp(place, axis=0) if len(place) else np.zeros(2)
    return across.clip(1e-12)


def window_fringes(remainder: Residuals, periods: Floats, k: int) -> Floats:
    """Candidates (m, n, 2) of fringes of a detector's window, periodic in the spot's place.
    periods: numbers of periods (m, 2) over the range of places."""
    place = remainder.raw[:, 3 * k : 3 * k + 2] / spot_range(remainder, k)
    phase = 2 * np.pi * periods @ place.T
    return np.stack([np.cos(phase), np.sin(phase)], axis=-1)


def likely_fringes(remainder: Residuals, columns: Floats, k: int) -> Floats:
    """Numbers of periods (m, 2) of the fringes with which columns (n, 9, q) would explain most if
    no unknown absorbed any of it."""
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
    best = np.argsort(-level, axis=None)[:EXACT_TRIALS]
    first, second = np.unravel_index(best, level.shape)
    return np.column_stack([along[first], WINDOW_PERIODS[second]])


def square_grid(width: float, count: int) -> Floats:
    """Places (count^2, 2) over a square of this half width about zero."""
    x, y = np.meshgrid(*[np.linspace(-width, width, count)] * 2)
    return np.column_stack([x.ravel(), y.ravel()])


# ---- the reference


#: Prior standard uncertainties of the reference's errors: relative errors of scale; distances of
#: its lines of measurement, mm; angles between its axes, rad.  And of bows of its lengths and
#: angles at the ends of the motion, mm and rad.
REFERENCE_SIGMAS = {"scale": 5e-3, "abbe": 10.0, "squareness": 5e-3}
BOW_SIGMAS = np.repeat([5e-3, 2e-5], 3)


def reference_columns(remainder: Residuals, terms: list[tuple[int, Floats]]) -> Floats:
    """Columns (n, 9, terms) of errors of the reference.  terms: for each column, the axis, and its
    error (n,), mm or rad."""
    by_pose = remainder.pose_columns
    return np.stack([by_pose[:, :, axis] * size[:, None] for axis, size in terms], axis=-1)


def reference_terms(remainder: Residuals) -> dict[str, list[tuple[int, Floats]]]:
    """Each kind of error of the reference: the axes, and their errors (n,) in prior standard
    uncertainties.

    abbe: each length is measured along a line at some distance from the apex, and errs by the
    angles.  bow: axes err by the square of a length.  cosine: lengths that are measured by a part
    that turns with the stage err by squares of the angles.
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
    """Errors of axes by products of pairs of coordinates (n, 6), each relative to its largest."""
    return [(n, BOW_SIGMAS[n] * ends[:, i] * ends[:, j]) for n, (i, j) in product(axes, pairs)]


def changed_columns(remainder: Residuals, fault: Alternative) -> Floats:
    """The column (n, 9, 1) of a change of the reference's poses that is small in these samples."""
    assert fault.change is not None
    moved = fault.change(remainder.data).pose - remainder.data.pose
    return remainder.pose_columns @ moved[:, :, None]


def axis_delay_columns(remainder: Residuals) -> Floats:
    """Delays of the reference's six axes, s, (n, 9, 6); zero where the table is no motion in
    time."""
    velocity = remainder.data.velocity
    return remainder.pose_columns * (0.0 if velocity is None else velocity[:, None])


def moving_columns(remainder: Residuals) -> Floats:
    """Delays of the three detectors, s, (n, 9, 3); zero where the table is no motion in time."""
    data = remainder.data
    if data.velocity is None or data.clock is None:
        return np.zeros((*remainder.noise.shape, 3))
    moving = np.einsum("nij,nj->ni", remainder.pose_columns, data.velocity)
    return separate(moving, BY_DETECTOR)


def clock_columns(remainder: Residuals) -> Floats:
    """A delay of the reference that grows with time, s at the end of the run: (n, 9, 1)."""
    moving = moving_columns(remainder).sum(axis=2, keepdims=True)
    clock = remainder.data.clock
    late: Floats = moving if clock is None else moving * clock[:, :1, None]
    return late


# ---- detectors and their electronics


def memory_columns(remainder: Residuals) -> Floats:
    """Memory: fractions of the previous reading that each detector retains, of places and powers,
    (n, 9, 6).

    The change is taken from the model's reading of a row, whose noise would look like memory.
    """
    moves = remainder.data.moves
    return retained_columns(remainder, moves.before if moves else remainder.model_readings)


def memory_in_use(remainder: Residuals) -> Floats:
    """The columns of `memory_columns` if each pose follows the one on the other side of the
    motion."""
    model = remainder.model_readings
    return retained_columns(remainder, 2 * np.median(model, axis=0) - model)


def retained_columns(remainder: Residuals, before: Floats) -> Floats:
    """Fractions of the readings before (n, 9) that each detector retains, of places and powers: (n,
    9, 6)."""
    return separate((before - remainder.model_readings) / remainder.noise, BY_PLACE_AND_POWER)


def averaged_columns(remainder: Residuals) -> Floats:
    """Readings of a motion that were averaged over rows, per mean square of the rows' distance, (n,
    9, 1); zero where the table is no motion in time."""
    data, result = remainder.data, remainder.fit
    moves = data.moves
    if data.velocity is None or moves is None:
        return np.zeros((*remainder.noise.shape, 1))
    own_values, values, sensor = result.own_values, result.all_values, remainder.sensor
    half = (moves.last + moves.following) / 2
    before, middle, behind = (
        readings(sensor, states_of(data._replace(pose=data.pose + step), own_values, values))
        for step in (moves.bend / 2 - half, np.zeros(6), moves.bend / 2 + half)
    )
    column = (before + behind) / 2 - middle
    return (column / remainder.noise)[:, :, None]


def leak_columns(remainder: Residuals) -> Floats:
    """Fractions of each detector's currents in the channels of each other detector: (n, 9, 24)."""
    raw = np.nan_to_num(remainder.data.raw).reshape(-1, 3, 3)  # a missing reading leaks nothing
    lamp = lamp_columns(remainder).reshape(-1, 9, 3, 3)
    light = raw[:, :, [2, 0, 1]]
    light[:, :, 1:] *= light[:, :, :1]
    parts = [lamp[:, :, j] @ light[:, k, :, None] for k, j in permutations(range(3), 2)]
    return np.concatenate(parts, axis=2)


def likely_resets(remainder: Residuals, columns: Floats) -> tuple[Floats, int]:
    """Indicators (n, b) of blocks of rows, and the length of a block at which columns (n, 9, q)
    with separate amounts in each block would explain most if no unknown absorbed any of it.

    There are none if the blocks would be few (which are jumps) or too many for a long table, or if
    blocks that begin elsewhere explain as much. The indicators are then zero, (n, 1), and the
    length 0.
    """
    pulled = (np.swapaxes(columns, 1, 2) @ remainder.pulled[:, :, None])[:, :, 0]
    square = np.einsum("niq,nij,njq->nq", columns, remainder.inverse, columns)
    rows, count = remainder.row_numbers - 1, len(pulled)
    most = MAX_BASIS_VALUES // (columns[0].size * count)
    shortest, longest = max(LEAST_RESET, rows[-1] // max(most, 1) + 1), rows[-1] // 5
    if longest < shortest:
        return np.zeros((count, 1)), 0
    lengths = range(shortest, longest + 1, max(1, (longest - shortest) * count // MAX_BASIS_VALUES))

    def gain(length: int, offset: int = 0) -> float:
        """The fall of chi-square by blocks of this length, less that by chance."""
        first = np.flatnonzero(np.diff((rows + offset) // length, prepend=-1))
        falls: Floats = np.add.reduceat(pulled, first) ** 2
        falls /= np.maximum(np.add.reduceat(square, first), 1e-300)
        return float(falls.sum()) - 2 * falls.size  # chance explains 1 each

    best = max(lengths, key=gain)
    if gain(best, best // 2) > RESET_FRACTION * gain(best):
        return np.zeros((count, 1)), 0
    block = rows // best
    return (block[:, None] == np.unique(block)).astype(float), best


def amplifier_columns(remainder: Residuals) -> Floats:
    """Amplifiers (n, 9, 12) whose gain grows with the current, as a fraction at a current of 1 mW
    of light, for each of the four electrodes of each detector."""
    raw, half = remainder.data.raw.reshape(-1, 3, 3, 1), half_sizes(remainder.sensor)[:, :, None]
    power, ratio, sign = raw[:, :, 2:], raw[:, :, :2] / half, np.array([-1, 1])
    square = (power * (1 + sign * ratio) / 2) ** 2  # of the currents (n, 3, 2, 2)
    bent = half * sign * (1 - sign * ratio) * square / power
    effects = np.zeros((len(raw), 3, 3, 4))
    effects[:, :, 0, :2], effects[:, :, 1, 2:] = bent[:, :, 0], bent[:, :, 1]
    effects[:, :, 2] = square.reshape(-1, 3, 4) / 2
    return detector_blocks(effects / remainder.noise.reshape(-1, 3, 3, 1))
