"""Samples condensed to time bins, of which a strip chart of a few hundred pixels shows all."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...core.names import READING_COLUMNS, STATE_COLUMNS
from ...core.units import Floats, Integers, Rows

#: Columns of a bin as pages get them: the numbers of samples and of poses, the largest residual and
#: the mean readings. Then, for each component of the state, its least, largest and mean value and
#: the largest standard uncertainty. Residual, state and uncertainty are of the samples with a pose.
COLUMNS = (
    "samples",
    "poses",
    "residual",
    *READING_COLUMNS,
    *(f"{part}{name}" for part in ("least_", "most_", "mean_", "u_") for name in STATE_COLUMNS),
)
#: How the three tables of `Bins` take in samples, and the value of an empty bin.
REDUCTIONS = ((np.add, 0.0), (np.fmin, np.nan), (np.fmax, np.nan))

_U_COLUMNS = tuple(f"u_{name}" for name in STATE_COLUMNS)
_READINGS, _STATES = len(READING_COLUMNS), len(STATE_COLUMNS)


def bin_columns(channels: tuple[str, ...]) -> tuple[str, ...]:
    """Return COLUMNS with the least, the largest and the mean value of each auxiliary channel."""
    return (
        *COLUMNS,
        *(f"{part}{name}" for part in ("least_", "most_", "mean_") for name in channels),
    )


def reduced_numbers(rows: Rows, channels: tuple[str, ...]) -> tuple[Floats, Floats, Floats]:
    """Return the numbers of rows (n,) that enter sums, minima and maxima, (n, k) each.

    Sums: of samples, of those with a pose, of readings, states and channels, and of the known ones
    among these. Minima: of states and channels. Maxima: of these, of uncertainties and residuals.
    """
    readings, states, sigmas, extras, residual = (
        np.stack([rows[name] for name in names], axis=1) if names else np.zeros((len(rows), 0))
        for names in (READING_COLUMNS, STATE_COLUMNS, _U_COLUMNS, channels, ("residual",))
    )
    # a sample has a pose if its status says so; no number is drawn of a sample without a pose
    good = (rows["status"] == 0) & np.isfinite(states).all(axis=1)
    for of_pose in (states, sigmas, residual):
        of_pose[~good] = np.nan
    extras[~np.isfinite(extras)] = np.nan
    summed = np.column_stack([readings, states, extras])
    is_known = np.isfinite(summed)
    sums = np.column_stack([np.ones(len(rows)), good, np.where(is_known, summed, 0.0), is_known])
    minima = np.column_stack([states, extras])
    return sums, minima, np.column_stack([minima, sigmas, residual])


class Bins:
    """Bins of one width, of which the newest `count` are kept.

    width: s.  numbers: (count,) number of the bin in each place, -1 for none: bin k has the times
    from k width to (k + 1) width after the origin.  tables: see `reduced_numbers`; a row for each
    bin.  changed: numbers of the bins that changed since `take_changes`.  channels: columns of the
    auxiliary channels.
    """

    def __init__(self, width: float, count: int, channels: tuple[str, ...]) -> None:
        self.width, self.count, self.channels = width, count, channels
        self.numbers: Integers = np.full(count, -1, np.int64)
        drawn = _STATES + len(channels)
        columns = (2 + 2 * (_READINGS + drawn), drawn, drawn + _STATES + 1)
        self.tables = [
            np.full((count, width), empty)
            for width, (_, empty) in zip(columns, REDUCTIONS, strict=True)
        ]
        self.changed: set[int] = set()

    def add(self, times: Floats, rows: Rows) -> None:
        """Add rows (n,) of SAMPLE at times (n,), s after the origin, in any order.

        Samples from before the origin, and of bins that are no longer kept, are ignored.
        """
        numbers = np.floor(times / self.width).astype(np.int64)
        newest = max(int(self.numbers.max()), int(numbers.max(initial=-1)))
        chosen = np.flatnonzero((numbers >= 0) & (numbers > newest - self.count))
        if not len(chosen):
            return
        chosen = chosen[np.argsort(numbers[chosen], kind="stable")]
        numbers, rows = numbers[chosen], rows[chosen]
        starts = np.flatnonzero(np.diff(numbers, prepend=-1))
        numbers, places = numbers[starts], numbers[starts] % self.count
        fresh = places[self.numbers[places] != numbers]
        self.numbers[places] = numbers
        parts = reduced_numbers(rows, self.channels)
        for table, part, (reduce, empty) in zip(self.tables, parts, REDUCTIONS, strict=True):
            table[fresh] = empty
            table[places] = reduce(table[places], reduce.reduceat(part, starts))
        self.changed.update(numbers.tolist())

    def take_changes(self) -> set[int]:
        """Return the numbers of the bins that changed since the last call."""
        changed, self.changed = self.changed, set()
        return changed

    def present_numbers(self) -> list[int]:
        """Return the numbers of all bins that are kept, in ascending order."""
        return sorted(self.numbers[self.numbers >= 0].tolist())

    def values(self, numbers: Integers) -> tuple[Integers, NDArray[np.float32]]:
        """Return the numbers (m,) of those of these bins that are kept, and their columns (m,
        `bin_columns`).

        Unknown values are NaN.
        """
        places = numbers % self.count
        is_kept = self.numbers[places] == numbers
        numbers, places = numbers[is_kept], places[is_kept]
        sums, minima, most = (table[places] for table in self.tables)
        counts, totals, known_counts = np.split(sums, [2, 1 + sums.shape[1] // 2], axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            means = totals / known_counts
        states = _READINGS + _STATES
        table = np.column_stack(
            [counts, most[:, -1], means[:, :_READINGS], minima[:, :_STATES], most[:, :_STATES],
             means[:, _READINGS:states], most[:, -1 - _STATES : -1], minima[:, _STATES:],
             most[:, _STATES : -1 - _STATES], means[:, states:]]
        )  # fmt: skip
        table[~np.isfinite(table)] = np.nan
        return numbers, table.astype(np.float32)


class AllBins(Bins):
    """Bins of the whole run from its origin; if there are too many, their width doubles.

    age: number of times that their width doubled.
    """

    age = 0

    def add(self, times: Floats, rows: Rows) -> None:
        """Add rows at times (n,), s, with wider bins if they are later than the last bin."""
        last = float(times.max(initial=0.0))
        while last >= self.width * self.count:
            self.widen()
        super().add(times, rows)

    def widen(self) -> None:
        """Join neighbouring bins in pairs."""
        half = self.count // 2
        is_present = (self.numbers.reshape(half, 2) >= 0).any(axis=1)
        for table, (reduce, empty) in zip(self.tables, REDUCTIONS, strict=True):
            table[:half] = reduce.reduce(table.reshape(half, 2, -1), axis=1)
            table[half:] = empty
        self.numbers[:half] = np.where(is_present, np.arange(half), -1)
        self.numbers[half:] = -1
        self.width *= 2
        self.age += 1
        self.changed = set(np.flatnonzero(is_present).tolist())
