"""Find the dwells of an axis in a series of poses, and the commanded position of each.

Dwells are found in the coordinate along the axis. Each belongs to the commanded position nearest to
its own, after a common offset. The sequence of these positions is aligned with the commanded one,
so that dwells without a command, and commanded positions without a dwell, are counted and excluded
instead of shifting all others.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..core import (
    STATE_COLUMNS,
    STATE_UNITS,
    Booleans,
    Floats,
    InputError,
    Integers,
    Sensor,
    object_displacements,
)
from ..estimation import (
    Plan,
    common_detectors,
    detectors_of,
    find_axis_dwells,
    mean,
    propagate_in_light,
    row_variance,
)
from ..files import Source, join_columns, read_chunks, read_words
from .error_motions import LETTERS, AxisTest, Commands, Visits

#: Columns of a table of commands, and their units in mm or rad.
POSITIONS = {
    "position_mm": 1.0, "position_um": 1e-3, "position_mrad": 1e-3, "position_urad": 1e-6,
    "position_deg": np.pi / 180,
}  # fmt: skip
#: Number of the first dwells and commands that are tried as each other's partner.
FIRST_DWELLS = 4
#: Least ratio of the measured travel to the commanded one, and the inverse of the largest.
LEAST_SCALE = 0.8
#: An excursion before a dwell is an overshoot, which does not show the direction of the approach,
#: below this fraction of the distance between positions.
OVERSHOOT_FRACTION = 0.05
#: Least number of rows of a dwell for the scatter of its parts.
SCATTER_ROWS = 32
#: Gaps between positions are this many times as wide as the widest gap within one, or more.
CLUSTER_RATIO = 3.0
#: Largest deviation of equal steps from their mean, relative to it, without commanded positions.
UNEVEN_STEPS = 0.2


@dataclass(frozen=True)
class PoseSeries:
    """Solved poses in time.

    Attributes
    ----------
    time
        (n,) s, ascending.
    states
        (n, 8) mm and rad; NaN without a pose.
    misfit
        (n,) whether the residual is beyond chance; such rows are excluded.
    used
        (n, 3) whether each detector took part; None for all.
    """

    time: Floats
    states: Floats
    misfit: Booleans
    used: Booleans | None = None

    @property
    def has_pose(self) -> Booleans:
        """Whether each row has all six numbers of a pose: (n,)."""
        return np.asarray(np.isfinite(self.states[:, :6]).all(axis=1))

    def usable(self) -> PoseSeries:
        """The series with NaN in rows with a misfit or without a pose."""
        good = self.has_pose & ~self.misfit
        return replace(self, states=np.where(good[:, None], self.states, np.nan))


@dataclass(frozen=True)
class VisitCounts:
    """Counts of excluded data.

    stray_dwells: number of dwells without a command.  missing: commanded positions without a dwell.
    unsolved, misfits: number of rows without a pose, and with a misfit.  doubtful: positions of
    dwells in which less than half of the rows have a pose.
    """

    stray_dwells: int = 0
    missing: tuple[float, ...] = ()
    unsolved: int = 0
    misfits: int = 0
    doubtful: tuple[float, ...] = ()


def series_of_columns(columns: dict[str, Any], clock: str = "host_s") -> PoseSeries:
    """Make a series from the columns of a table or a recording.  clock: the column of times, s."""
    time = columns[clock]
    zero = np.zeros(len(time))
    states = np.column_stack([columns.get(name, zero) for name in STATE_COLUMNS]) * STATE_UNITS
    used = detectors_of(columns["used"]) if "used" in columns else None
    return PoseSeries(time - time[0], states, columns.get("misfit", zero) > 0, used)


def read_series(path: Source) -> PoseSeries:
    """Read a table of poses in time, such as `facets solve` and `facets replay` write."""
    optional = (*STATE_COLUMNS[6:], "time_s", "host_s", "misfit")
    parts = [chunk.columns for chunk in read_chunks(path, STATE_COLUMNS[:6], optional)]
    rows = sum(len(part[STATE_COLUMNS[0]]) for part in parts)
    name = next((name for name in ("time_s", "host_s") if parts and name in parts[0]), None)
    if name is None:
        raise InputError(
            f"{path}: "
            + ("missing column: time_s (or host_s, a recording's)" if rows else "no rows")
        )
    columns: dict[str, Any] = join_columns(parts)
    time = columns[name]
    bad = np.flatnonzero(~np.isfinite(time) | (np.diff(time, prepend=-np.inf) <= 0))
    if len(bad):
        raise InputError(
            f"{path}: row {bad[0] + 1}: {name} is {time[bad[0]]:g}; the times of all rows must "
            "ascend, so that the table holds one motion"
        )
    words = read_words(path, "used")
    return series_of_columns(columns if words is None else columns | {"used": words}, name)


def read_commands(path: Source, axis: str) -> Commands:
    """Read a table of commanded positions with one row for each dwell.

    The column is `position_mm` or `position_um` for a linear axis, `position_mrad`,
    `position_urad` or `position_deg` for a rotary one. An optional column `direction` (1 or -1)
    gives the direction of the approach.
    """
    parts = [chunk.columns for chunk in read_chunks(path, (), (*POSITIONS, "direction"))]
    positions = read_positions(path, parts, axis)
    if "direction" not in parts[0]:
        return Commands(positions, approach_directions(positions))
    signs = np.concatenate([part["direction"] for part in parts])
    wrong = np.flatnonzero(~np.isin(signs, (1, -1)))
    if len(wrong):
        raise InputError(
            f"{path}: row {wrong[0] + 1}: direction is {signs[wrong[0]]:g}; allowed: 1 and -1"
        )
    moves = np.sign(np.diff(positions))
    if len(set(signs)) > 1 and moves.any() and (moves * signs[1:] <= 0).all():
        raise InputError(
            f"{path}: direction contradicts the order of the positions in every row; give the rows "
            "in the order in which the axis was sent, or turn the signs of direction"
        )
    return Commands(positions, (signs < 0).astype(np.int64))


def read_positions(path: Source, parts: list[dict[str, Floats]], axis: str) -> Floats:
    """The commanded positions (k,) of a table's columns; mm or rad."""
    names = [name for name in POSITIONS if parts and name in parts[0]]
    linear = LETTERS.index(axis) < 3
    allowed = [name for name in POSITIONS if name.endswith("m") == linear]
    if len(names) != 1 or names[0] not in allowed:
        raise InputError(
            f"{path}: columns of positions: {', '.join(names) or 'none, or no rows'}; needed for "
            f"the axis {axis}: one of {', '.join(allowed)}"
        )
    positions = np.concatenate([part[names[0]] for part in parts]) * POSITIONS[names[0]]
    wrong = np.flatnonzero(~np.isfinite(positions))
    if len(wrong):
        raise InputError(
            f"{path}: row {wrong[0] + 1}: {names[0]} is not a number; each row is one position"
        )
    return positions


def approach_directions(positions: Floats) -> Integers:
    """The direction (k,) of the move to each position: 0 positive, 1 negative.

    At the beginning, and at an end that is visited twice, it is the direction of the next move.
    """
    signs = np.sign(np.diff(positions, prepend=positions[:1]))
    ahead = np.sign(np.diff(positions, append=positions[-1:]))
    signs = np.where(signs == 0, ahead, signs)
    signs[-1:] = np.where(signs[-1:] == 0, np.sign(positions[-1:] - positions[:1]), signs[-1:])
    directions: Integers = (signs < 0).astype(np.int64)
    return directions


def find_visits(
    series: PoseSeries, test: AxisTest, sensor: Sensor, plan: Plan
) -> tuple[Visits, VisitCounts]:
    """Find the dwells of an axis under test and the commanded position of each.

    Raises `InputError` if the axis does not rest, if another axis moved further, or if all dwells
    belong to one position.
    """
    good = series.usable()
    moved, _, _ = object_displacements(good.states[:, :6], np.zeros(6), test.body)
    place = moved[:, test.main]
    check_axis(moved, test.axis)
    rate = (len(place) - 1) / (series.time[-1] - series.time[0]) if len(place) > 1 else 1.0
    parts = find_axis_dwells(place, max(2, round(test.shortest_s * rate)))
    if len(parts) < 2:
        raise InputError(
            f"the axis is at rest {len(parts)} times for {test.shortest_s:g} s or more; needed: "
            "2. Shorter dwells are found with a smaller --dwell"
        )
    places = np.array([mean(place[part]) for part in parts])
    positions = equal_positions(places) if test.commands is None else test.commands.positions
    overshoot = OVERSHOOT_FRACTION * np.diff(np.unique(positions)).min(initial=np.inf)
    directions = measured_directions(place, parts, overshoot)
    commands, partner = match_dwells(places, test.commands, directions)
    is_measured = (partner >= 0) & (directions >= 0)  # the poses decide, not the commands
    approached = commands.direction.copy()
    approached[partner[is_measured]] = directions[is_measured]
    commands = replace(commands, direction=approached)
    matched = [part for part, command in zip(parts, partner, strict=True) if command >= 0]
    rows = np.isfinite(place)
    doubtful = [
        float(places[n]) for n, part in enumerate(parts) if partner[n] >= 0
        and 2 * rows[part].sum() < part.stop - part.start
    ]  # fmt: skip
    counts = VisitCounts(
        stray_dwells=len(parts) - len(matched),
        missing=tuple(np.delete(commands.positions, partner[partner >= 0]).tolist()),
        unsolved=int((~series.has_pose).sum()),
        misfits=int(series.misfit.sum()),
        doubtful=tuple(doubtful),
    )
    return make_visits(good, matched, commands, partner[partner >= 0], sensor, plan), counts


def check_axis(moved: Floats, axis: str) -> None:
    """Raise `InputError` for displacements (n, 6), mm and rad, if there is no pose, or if another
    axis moved further."""
    if not np.isfinite(moved).any():
        raise InputError("no row has a pose; see the statuses of `facets solve` or `facets replay`")
    main = LETTERS.index(axis)
    kind = slice(main // 3 * 3, main // 3 * 3 + 3)
    low, high = np.nanquantile(moved[:, kind], [0.02, 0.98], axis=0)
    if (high - low).max() > (high - low)[main - kind.start]:
        unit, factor = ("mm", 1) if main < 3 else ("mrad", 1e3)
        extents = ", ".join(
            f"{factor * extent:.3g} {unit} {'along' if main < 3 else 'about'} {letter}"
            for letter, extent in zip(LETTERS[kind], high - low, strict=True)
        )
        raise InputError(
            f"--axis {axis}: the object moved {extents}; name the axis that moved, or turn the "
            "object's axes with `object:` in the configuration"
        )


def measured_directions(place: Floats, parts: list[slice], overshoot: float) -> Integers:
    """The direction (k,) of the approach to each dwell: 0 positive, 1 negative, -1 unknown.

    The last row before the dwell that is further away than `overshoot` decides; if there is none,
    the direction is that of the previous dwell.  place: (n,) coordinate of the axis.
    """
    directions = np.full(len(parts), -1)
    begin = 0
    for n, part in enumerate(parts):
        distance = place[begin : part.start] - mean(place[part])
        far = distance[np.abs(distance) > overshoot]
        directions[n] = int(far[-1] > 0) if len(far) else directions[n - 1] if n else -1
        begin = part.start
    return directions


def match_dwells(
    places: Floats, commands: Commands | None, directions: Integers
) -> tuple[Commands, Integers]:
    """Match dwells at `places` (k,) with commands.

    directions: (k,) as from `measured_directions`; they decide between dwells that may belong to
    the same command.

    Returns the commands, and the number of each dwell's command (k,), -1 if it has none.
    """
    if commands is None:
        positions = equal_positions(places)
        return Commands(positions, approach_directions(positions)), np.arange(len(places))
    targets, labels = np.unique(commands.positions, return_inverse=True)
    if len(targets) < 2:
        raise InputError("all commanded positions are equal; needed: two different ones or more")
    middle = [(places.max() + places.min() - targets[-1] - targets[0]) / 2]
    pairs = [
        place - position
        for place in places[:FIRST_DWELLS]
        for position in commands.positions[:FIRST_DWELLS]
    ]
    agrees = directions[:, None] == commands.direction
    best = max((match_by_offset(places, offset, targets, labels, agrees)
                for offset in middle + pairs),
               key=lambda matches: int((matches >= 0).sum()))  # fmt: skip
    matched = best >= 0
    partner = commands.positions[best[matched]]
    scale = np.polyfit(partner, places[matched], 1)[0] if len(np.unique(partner)) > 1 else 0.0
    is_stray = 2 * matched.sum() < min(len(places), len(labels))
    ratio = np.ptp(places) / np.ptp(targets)
    rescaled = match_by_offset(places / ratio, places.min() / ratio - targets[0], targets, labels,
                               agrees)  # fmt: skip
    if (
        (rescaled >= 0).sum() > matched.sum()
        or is_stray
        or not LEAST_SCALE < scale < 1 / LEAST_SCALE
    ):
        raise InputError(
            f"the {len(places)} dwells, from {places.min():.4g} to {places.max():.4g}, do not "
            f"belong to the {len(labels)} commanded positions, from {targets[0]:.4g} to "
            f"{targets[-1]:.4g} (mm or rad), {ratio:.4g} times as far; check the unit and the sign "
            "of the table, whether it holds diameters, whether the object's axis lies along this "
            "one, and whether the axis was at rest at each position for the time of --dwell"
        )
    # An offset from one dwell contains the error of that dwell: the median of all is more accurate.
    offset = float(np.median(places[matched] - partner))
    return commands, match_by_offset(places, offset, targets, labels, agrees)


def match_by_offset(
    places: Floats, offset: float, targets: Floats, labels: Integers, agrees: Booleans
) -> Integers:
    """Match dwells at `places` (k,), less an offset, with the nearest targets.

    labels, agrees: as in `align_sequences`. Returns the number of each dwell's command (k,), -1 if
    it has none.
    """
    nearest = np.argmin(np.abs(places[:, None] - offset - targets), axis=1)
    far = np.abs(places - offset - targets[nearest]) > np.diff(targets).min() / 2
    return align_sequences(np.where(far, -1, nearest), labels, agrees)


def align_sequences(names: Integers, labels: Integers, agrees: Booleans) -> Integers:
    """Align two sequences: the number (k,) of each name's partner among the labels, -1 if none.

    Partners are equal and in the same order. As many names as possible have a partner, and as many
    of these as possible agree with it.  names: (k,).  labels: (n,).  agrees: (k, n).
    """
    weights = (len(names) + 1) * (names[:, None] == labels)
    weights += (weights > 0) & agrees
    scores = np.zeros((len(names) + 1, len(labels) + 1), dtype=np.int64)
    for n in range(len(names)):
        best = np.maximum(scores[n, 1:], scores[n, :-1] + weights[n])
        scores[n + 1, 1:] = np.maximum.accumulate(best)
    partners = np.full(len(names), -1)
    n, place = len(names), len(labels)
    while n and place:
        weight = weights[n - 1, place - 1]
        if weight and scores[n, place] == scores[n - 1, place - 1] + weight:
            n, place = n - 1, place - 1
            partners[n] = place
        elif scores[n - 1, place] == scores[n, place]:
            n -= 1
        else:
            place -= 1
    return partners


def equal_positions(places: Floats) -> Floats:
    """The nominal positions (k,) of dwells at equally spaced targets, from the measured places.

    The step is the mean of the measured ones, so that an error of scale does not show.
    """
    order = np.sort(places)
    gaps = np.diff(order)
    large = np.sort(gaps)[::-1]
    jumps = large[:-1] > CLUSTER_RATIO * large[1:]
    between = int(np.argmax(jumps)) + 1 if jumps.any() else len(gaps)  # gaps between targets
    borders = (order[:-1] + order[1:])[gaps >= large[between - 1]] / 2
    number = np.searchsorted(borders, places)
    slope, start = np.polyfit(number, places, 1)
    means = np.array([places[number == n].mean() for n in range(len(borders) + 1)])
    uneven = np.abs(np.diff(means) / slope - 1)
    if len(uneven) and uneven.max() > UNEVEN_STEPS:
        raise InputError(
            "the dwells are not equally spaced (steps from "
            f"{np.diff(means).min():.4g} to {np.diff(means).max():.4g} mm or rad); say where the "
            "axis was sent with --commands"
        )
    positions: Floats = start + slope * number
    return positions


def make_visits(
    series: PoseSeries,
    parts: list[slice],
    commands: Commands,
    partner: Integers,
    sensor: Sensor,
    plan: Plan,
) -> Visits:
    """Make the visits from the rows of dwells, which belong to the commands `partner` (k,)."""
    targets, target = np.unique(commands.positions[partner], return_inverse=True)
    direction = commands.direction[partner]
    run = np.zeros_like(target)
    for n in range(len(run)):
        run[n] = int(((target[:n] == target[n]) & (direction[:n] == direction[n])).sum())
    states = np.array([[mean(column) for column in series.states[part].T] for part in parts])
    samples = np.array([np.isfinite(series.states[part, 0]).sum() for part in parts], float)
    used = None
    if series.used is not None:
        rows = (series.used[part][np.isfinite(series.states[part, 0])] for part in parts)
        used = np.stack([common_detectors(some) for some in rows])
    return Visits(
        targets,
        target,
        direction,
        run,
        np.array([float(series.time[part].mean()) for part in parts]),
        states,
        samples,
        excess_scatter(series, parts, propagate_in_light(sensor, states, plan, used).noise),
        used=used,
    )


def excess_scatter(series: PoseSeries, parts: list[slice], noise: Floats) -> Floats:
    """The scatter (6,) of the means of parts of dwells over that of the sensor's noise, 1 or more.

    It is 1 if the dwells have too few rows.  noise: (k, 8, 8) covariance of the sensor's noise.
    """
    rows = [series.states[part, :6] for part in parts]
    rows = [some[np.isfinite(some[:, 0])] for some in rows]
    long = [n for n, some in enumerate(rows) if len(some) >= SCATTER_ROWS]
    if not long:
        return np.ones(6)
    measured = row_variance([rows[n] for n in long], np.ones((len(long), 6)))
    expected = np.median(np.diagonal(noise[long], axis1=1, axis2=2)[:, :6], axis=0)
    excess: Floats = np.sqrt(np.maximum(1.0, measured / np.maximum(expected, 1e-300)))
    return excess
