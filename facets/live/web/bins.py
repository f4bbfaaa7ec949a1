"""Samples condensed to time bins: what a strip of a few hundred pixels can show of them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.names import READING_COLUMNS, STATE_COLUMNS
from ...core.units import Floats

#: Columns of a bin as pages get them: samples, those with a pose, the largest residual, the mean
#: readings, and for each component of the state its least, its largest, its mean and the largest
#: standard uncertainty. Means, ends and uncertainties are of the samples with a pose.
COLUMNS = (
    "samples",
    "poses",
    "residual",
    *READING_COLUMNS,
    *(f"{part}{name}" for part in ("least_", "most_", "mean_", "u_") for name in STATE_COLUMNS),
)


def bin_columns(channels: tuple[str, ...]) -> tuple[str, ...]:
    """COLUMNS, and the least, the largest and the mean of each auxiliary channel."""
    return (
        *COLUMNS,
        *(f"{part}{name}" for part in ("least_", "most_", "mean_") for name in channels),
    )


_READINGS, _STATES = len(READING_COLUMNS), len(STATE_COLUMNS)

Rows = NDArray[np.void]
Numbers = NDArray[np.int64]


class Part:
    """Sums and ends over bins of some samples: numbers (n,), and arrays with a row for each."""

    def __init__(self, numbers: Numbers, rows: Rows, channels: tuple[str, ...]) -> None:
        """numbers: of the samples' bins (m,), not negative. rows: of SAMPLE, (m,), with the
        columns of auxiliary channels."""
        if len(numbers) > 1 and (np.diff(numbers) < 0).any():
            order = np.argsort(numbers, kind="stable")
            numbers, rows = numbers[order], rows[order]
        starts = np.concatenate([[0], np.flatnonzero(np.diff(numbers)) + 1])
        self.numbers: Numbers = numbers[starts]
        states, sigmas = (columns(rows, names) for names in (STATE_COLUMNS, _U_COLUMNS))
        readings, extras = (columns(rows, names) for names in (READING_COLUMNS, channels))
        held = np.isfinite(extras)
        # a sample has a pose where its status says so; no number is drawn of one that has none
        good = (rows["status"] == 0) & np.isfinite(states).all(axis=1)
        seen = np.isfinite(readings)
        self.sums: Floats = np.add.reduceat(
            np.column_stack(
                [np.ones(len(rows)), good, np.where(seen, readings, 0.0), seen,
                 np.where(good[:, None], states, 0.0), np.where(held, extras, 0.0), held]
            ),
            starts,
        )  # fmt: skip
        lowest = [np.where(good[:, None], states, np.inf), np.where(held, extras, np.inf)]
        self.least: Floats = np.minimum.reduceat(np.column_stack(lowest), starts)
        highest = np.column_stack([states, sigmas, rows["residual"], extras])
        known = good[:, None] & ~np.isnan(highest)
        known[:, 2 * _STATES + 1 :] = held
        self.most: Floats = np.maximum.reduceat(np.where(known, highest, -np.inf), starts)


def columns(rows: Rows, names: tuple[str, ...]) -> Floats:
    """Columns of rows (n,): (n, number of names)."""
    return np.stack([rows[name] for name in names], axis=1) if names else np.zeros((len(rows), 0))


_U_COLUMNS = tuple(f"u_{name}" for name in STATE_COLUMNS)


class Bins:
    """Bins of one width, the newest `count` of them.

    width: s.  numbers: (count,) which bin a place holds, -1 for none: bin k has the times from
    k width to (k + 1) width after the origin.  changed: bins with news since `take_changes`.
    channels: columns of the auxiliary channels.
    """

    def __init__(self, width: float, count: int, channels: tuple[str, ...] = ()) -> None:
        self.width, self.count, self.channels = width, count, channels
        extras = len(channels)
        self.numbers: Numbers = np.full(count, -1, np.int64)
        self.sums = np.zeros((count, 2 + 2 * _READINGS + _STATES + 2 * extras))
        self.least = np.full((count, _STATES + extras), np.inf)
        self.most = np.full((count, 2 * _STATES + 1 + extras), -np.inf)
        self.changed: set[int] = set()

    def add(self, times: Floats, rows: Rows) -> None:
        """Takes in rows (n,) of SAMPLE at times (n,), s after the origin; those before it are not.

        Samples may come in any order; those of bins that are no longer held are passed over.
        """
        numbers = np.floor(times / self.width).astype(np.int64)
        fit = numbers >= 0
        if fit.any():
            self.merge(Part(numbers[fit], rows[fit], self.channels))

    def merge(self, part: Part) -> None:
        newest = max(int(self.numbers.max()), int(part.numbers[-1]))
        held = part.numbers > newest - self.count
        numbers, places = part.numbers[held], part.numbers[held] % self.count
        fresh = places[self.numbers[places] != numbers]
        self.sums[fresh], self.least[fresh], self.most[fresh] = 0.0, np.inf, -np.inf
        self.numbers[places] = numbers
        self.sums[places] += part.sums[held]
        self.least[places] = np.minimum(self.least[places], part.least[held])
        self.most[places] = np.maximum(self.most[places], part.most[held])
        self.changed.update(numbers.tolist())

    def take_changes(self) -> set[int]:
        changed, self.changed = self.changed, set()
        return changed

    def present_numbers(self) -> list[int]:
        """The numbers of all bins that are held, in their order."""
        return sorted(self.numbers[self.numbers >= 0].tolist())

    def values(self, numbers: Numbers) -> tuple[Numbers, NDArray[np.float32]]:
        """The bins of these numbers that are held: which, and their `bin_columns`; NaN for
        unknown."""
        places = numbers % self.count
        held = self.numbers[places] == numbers
        numbers, places = numbers[held], places[held]
        ends = np.cumsum([2, _READINGS, _READINGS, _STATES, len(self.channels)])
        sums, totals, seen, states, extras, held = np.split(self.sums[places], ends, axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            readings, means, extra_means = totals / seen, states / sums[:, 1:], extras / held
        least, most = self.least[places], self.most[places]
        table = np.column_stack(
            [sums, most[:, 2 * _STATES], readings, least[:, :_STATES], most[:, :_STATES], means,
             most[:, _STATES : 2 * _STATES], least[:, _STATES:], most[:, 2 * _STATES + 1 :],
             extra_means]
        )  # fmt: skip
        table[~np.isfinite(table)] = np.nan
        return numbers, table.astype(np.float32)


class AllBins(Bins):
    """Bins of the whole run from its origin: where there are too many they become twice as wide.

    age: how often they became wider.
    """

    def __init__(self, width: float, count: int, channels: tuple[str, ...] = ()) -> None:
        super().__init__(width, count, channels)
        self.age = 0

    def add(self, times: Floats, rows: Rows) -> None:
        last = float(times.max(initial=0.0))
        while last >= self.width * self.count:
            self.widen()
        super().add(times, rows)

    def widen(self) -> None:
        half = self.count // 2
        some = (self.numbers.reshape(half, 2) >= 0).any(axis=1)
        joined: list[tuple[Any, Any]] = [
            (self.sums, self.sums.reshape(half, 2, -1).sum(axis=1)),
            (self.least, self.least.reshape(half, 2, -1).min(axis=1)),
            (self.most, self.most.reshape(half, 2, -1).max(axis=1)),
        ]
        for (whole, pairs), nothing in zip(joined, (0.0, np.inf, -np.inf), strict=True):
            whole[:half], whole[half:] = pairs, nothing
        self.numbers[:half] = np.where(some, np.arange(half), -1)
        self.numbers[half:] = -1
        self.width *= 2
        self.age += 1
        self.changed = set(np.flatnonzero(some).tolist())
