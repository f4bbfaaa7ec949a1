"""Averages over the dwells of a reference: the periods in which it is at rest at one position.

A motion in steps, recorded at full rate, has thousands of rows at each position and some rows
between two positions. Each dwell becomes one row of means; the rows in between are excluded.

The uncertainty of a mean follows from the scatter of the means of the dwell's parts, which includes
noise that is correlated between rows. As one dwell has few parts, the median over all dwells is
used, which a few corrupted dwells do not change. The noise of a position is proportional to 1/power
on the detector. `samples.add_converter_steps` adds the error of a mean due to a converter's steps,
which scatter does not show.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..core.names import READING_COLUMNS
from ..core.units import Floats

#: Least number of rows in a dwell.
MIN_ROWS = 32
#: Largest distance of the reference from the dwell's first row, in standard uncertainties.
LARGEST_DISTANCE = 2.0
#: Fraction of a dwell's rows that is excluded at each end, where the mirror may still swing.
END_FRACTION = 0.05
#: Number of parts of a dwell whose means are compared.
PARTS = 4
#: Rows further than this from the dwell's median, in standard deviations, are excluded.
OUTLIER_SIGMAS = 12.0
#: Number of blocks of rows in the shortest dwell of an axis; the means of blocks are compared.
BLOCKS = 12
#: An axis is at rest while the means of blocks stay within this many of their standard deviations;
#: one block in 45,000 exceeds them by chance.
STEP_SIGMAS = 6.0
#: Largest creep or drift of an axis during a dwell, as a fraction of its travel.
CREEP_FRACTION = 1 / 5000
#: Standard deviation of normal deviates over the median of the differences between two of them.
SIGMA_PER_MEDIAN_STEP = 1 / (0.67449 * 2**0.5)
#: Distance between the quartiles of a normal distribution, in standard deviations.
QUARTILES = 1.349
#: Median over mean of the variance of `PARTS` normal deviates: that of chi-square with 3 degrees of
#: freedom.
MEDIAN_OF_VARIANCE = 2.36597 / 3


class Dwells(NamedTuple):
    """Means of columns over the m dwells of a reference.

    columns: means, (m,) each.  noise: (m, 9) standard deviations of the readings' means.
    rows: (m,) number of rows in each mean.  left_out: number of rows outside of all dwells.
    """

    columns: dict[str, Floats]
    noise: Floats
    rows: Floats
    left_out: int


def find_dwells(pose: Floats, sigma: Floats, min_rows: int = MIN_ROWS) -> list[slice]:
    """Find the rows of each dwell of a reference.

    pose: (n, d) the axes that it measures.  sigma: (d,) their standard uncertainties.  min_rows:
    least number of rows in a dwell.
    """
    bad = np.asarray(~np.isfinite(pose).all(axis=1))
    scaled = np.where(bad[:, None], np.inf, pose) / (LARGEST_DISTANCE * sigma)
    parts, start, count = [], 0, len(pose)
    while start < count:
        if bad[start]:
            start += 1
            continue
        end = start_of_next(scaled, start)
        if end - start >= min_rows:
            off = int(END_FRACTION * (end - start))
            parts.append(slice(start + off, end - off))
            start = end
        else:
            start += 1 if end - start < 2 else (end - start) // 2
    return parts


def find_axis_dwells(place: Floats, shortest: int) -> list[slice]:
    """Find the rows of each dwell of an axis from its measured coordinate alone.

    The means of blocks of rows are compared, because they resolve smaller steps than single rows.
    The first and the last block of a dwell are excluded, because the axis may move within them.

    place: (n,) the coordinate; NaN without a pose.  shortest: least number of rows in a dwell.
    """
    size = max(1, shortest // BLOCKS)
    count = len(place) // size
    blocks = finite_means(place[: count * size].reshape(count, size))
    steps = np.abs(np.diff(blocks))
    noise = float(np.nanmedian(steps)) * SIGMA_PER_MEDIAN_STEP if np.isfinite(steps).any() else 0.0
    travel = float(np.nanmax(blocks) - np.nanmin(blocks)) if np.isfinite(blocks).any() else 0.0
    sigma = np.array([max(STEP_SIGMAS * noise, CREEP_FRACTION * travel, 1e-12) / LARGEST_DISTANCE])
    parts = find_dwells(blocks[:, None], sigma, min_rows=min(BLOCKS, max(3, shortest // size)))
    return [slice((part.start + 1) * size, (part.stop - 1) * size) for part in parts]


def finite_means(values: Floats) -> Floats:
    """Means over the last axis without missing values; NaN where all values are missing."""
    is_finite = np.isfinite(values)
    with np.errstate(invalid="ignore"):
        means: Floats = np.where(is_finite, values, 0.0).sum(axis=-1) / is_finite.sum(axis=-1)
    return means


def start_of_next(scaled: Floats, start: int) -> int:
    """Find the first row after `start` at another position, in pieces of growing size.

    scaled: (n, d) positions in units of the largest allowed distance.
    """
    end, size = start + 1, MIN_ROWS
    while end < len(scaled):
        part = slice(end, end + size)
        away = np.asarray((np.abs(scaled[part] - scaled[start]) > 1).any(axis=1))
        if away.any():
            return end + int(np.argmax(away))
        end, size = min(end + size, len(scaled)), 2 * size
    return len(scaled)


def dwell_means(columns: dict[str, Floats], pose: Floats, sigma: Floats) -> Dwells:
    """Average columns (n,) over the dwells of a reference (n, d) with standard uncertainties
    `sigma` (d,)."""
    parts = find_dwells(pose, sigma)
    means = {
        name: np.array([mean(values[part]) for part in parts]) for name, values in columns.items()
    }
    rows = np.array([part.stop - part.start for part in parts], dtype=float)
    readings = np.column_stack([columns[name] for name in READING_COLUMNS])
    ratios = noise_ratios(np.column_stack([means[name] for name in READING_COLUMNS]))
    variance = row_variance([readings[part] for part in parts], ratios)
    noise = ratios * np.sqrt(variance / np.maximum(rows, 1)[:, None])
    left_out = len(pose) - int(rows.sum())
    return Dwells(means, noise, rows, left_out)


def mean(values: Floats) -> float:
    """The mean of the values of a dwell, without missing values and outliers; NaN for no values."""
    finite = values[np.isfinite(values)]
    if not finite.size:
        return np.nan
    low, middle, high = np.quantile(finite, [0.25, 0.5, 0.75])
    if high > low:
        finite = finite[np.abs(finite - middle) <= OUTLIER_SIGMAS * (high - low) / QUARTILES]
    return float(finite.mean())


def noise_ratios(means: Floats) -> Floats:
    """Noise (m, 9) of each dwell's readings relative to the median dwell.

    It is proportional to 1/power for a position and constant for a power.  means: (m, 9) of the
    dwells' readings, mm and mW.
    """
    ratios: Floats = np.ones_like(means)
    if not len(means):
        return ratios
    for k in range(3):
        power = means[:, 3 * k + 2]
        ratios[:, 3 * k : 3 * k + 2] = (np.nanmedian(power) / power)[:, None]
    return ratios


def row_variance(dwells: list[Floats], ratios: Floats) -> Floats:
    """The variance (d,) of a single row, from the scatter of the means of parts of m dwells.

    For white noise this is the variance of the rows; for noise that is correlated over more than a
    part of a dwell, it is much larger. NaN without dwells.

    dwells: rows (n, d) of each dwell.  ratios: (m, d) relative noise, as from `noise_ratios`.
    """
    variances = []
    for rows, ratio in zip(dwells, ratios, strict=True):
        length = len(rows) // PARTS
        means = rows[: PARTS * length].reshape(PARTS, length, -1).mean(axis=1)
        variances.append(length * means.var(axis=0, ddof=1) / ratio**2)
    if not variances:
        return np.full(ratios.shape[1], np.nan)
    return median(np.array(variances)) / MEDIAN_OF_VARIANCE


def median(values: Floats) -> Floats:
    """Medians (m,) of columns (n, m) without missing values; 0 for a column without values."""
    has_values = np.isfinite(values).any(axis=0)
    medians = np.zeros(values.shape[1])
    medians[has_values] = np.nanmedian(values[:, has_values], axis=0)
    return medians
