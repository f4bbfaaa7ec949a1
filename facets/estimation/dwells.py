"""Averages over the times in which a reference stands still.

A motion in steps, recorded at full rate, has thousands of rows at one pose, and rows on the way
from one to the next. Each stand becomes one row of means; the rows between are left out. How well a
mean is known is told by the scatter of the means of its parts, so that noise which is the same in
neighbouring rows counts as it should. That is taken over all stands together, since one has few
parts, and by the median of all, which a few stands that were spoilt do not move; the noise of a
place goes with one over the power that falls on the detector. What a converter's steps leave in a
mean does not scatter: `samples.add_converter_steps` adds it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..core.names import READING_COLUMNS
from ..core.units import Floats

#: A stand has so many rows at least.
FEWEST = 32
#: The reference stays within so many of its standard uncertainties of where the stand began.
WITHIN = 2.0
#: Share of a stand's rows that is left out at each end, where the mirror may still swing.
ENDS = 0.05
#: Parts of a stand whose means are compared.
PARTS = 4
#: Standard deviations from the median beyond which a row is left out of a stand's mean.
FAR = 12.0
#: Blocks of rows, whose means are compared, in the shortest stand of an axis.
BLOCKS = 12
#: An axis stands still while the means of blocks stay within this number of their standard
#: deviations, which one block in 45,000 leaves by chance.
STEP_SIGMAS = 6.0
#: The share of the whole way within which an axis may creep or drift during a stand.
CREEP_SHARE = 1 / 5000
#: A normal distribution's standard deviation over the median size of a difference of two.
QUARTILES_OF_STEP = 1 / (0.67449 * 2**0.5)
#: The distance of a normal distribution's quartiles, in standard deviations.
QUARTILES = 1.349
#: The median of a variance of `PARTS` normal deviates, over its mean: chi-square of 3, by 3.
MEDIAN_OF_VARIANCE = 2.36597 / 3


class Dwells(NamedTuple):
    """Means of columns over the stands of a reference.

    columns: means, (m,) each.  noise: (m, 9) standard deviations of the readings' means.
    rows: (m,) numbers of rows in each mean.  left_out: number of rows outside of all stands.
    """

    columns: dict[str, Floats]
    noise: Floats
    rows: Floats
    left_out: int


def stands(pose: Floats, sigma: Floats, fewest: int = FEWEST) -> list[slice]:
    """Find the rows during which the reference stands still.

    pose: (n, d) of the axes that it measures.  sigma: (d,).  fewest: rows of a
    stand.
    """
    bad = np.asarray(~np.isfinite(pose).all(axis=1))
    scaled = np.where(bad[:, None], np.inf, pose) / (WITHIN * sigma)
    parts, start, count = [], 0, len(pose)
    while start < count:
        if bad[start]:
            start += 1
            continue
        end = start_of_next(scaled, start)
        if end - start >= fewest:
            off = int(ENDS * (end - start))
            parts.append(slice(start + off, end - off))
            start = end
        else:
            start += 1 if end - start < 2 else (end - start) // 2
    return parts


def stands_of_axis(place: Floats, shortest: int) -> list[slice]:
    """Find the rows during which an axis stands still, from its noisy coordinate alone.

    place: (n,) as the sensor measures it; NaN where there is no pose.  shortest: rows of the
    shortest stand. Means of blocks are compared, so that noise hides smaller steps less; the first
    and the last block of a stand are left out.
    """
    size = max(1, shortest // BLOCKS)
    count = len(place) // size
    blocks = finite_means(place[: count * size].reshape(count, size))
    steps = np.abs(np.diff(blocks))
    noise = float(np.nanmedian(steps)) * QUARTILES_OF_STEP if np.isfinite(steps).any() else 0.0
    way = float(np.nanmax(blocks) - np.nanmin(blocks)) if np.isfinite(blocks).any() else 0.0
    sigma = np.array([max(STEP_SIGMAS * noise, CREEP_SHARE * way, 1e-12) / WITHIN])
    block_stands = stands(blocks[:, None], sigma, fewest=min(BLOCKS, max(3, shortest // size)))
    # The axis may begin or end its move within the outermost blocks.
    return [slice((part.start + 1) * size, (part.stop - 1) * size) for part in block_stands]


def finite_means(values: Floats) -> Floats:
    """Means over the last axis without missing values; NaN where there are none."""
    there = np.isfinite(values)
    with np.errstate(invalid="ignore"):
        means: Floats = np.where(there, values, 0.0).sum(axis=-1) / there.sum(axis=-1)
    return means


def start_of_next(scaled: Floats, start: int) -> int:
    """The first row after `start` at another place, searched for in growing pieces."""
    end, size = start + 1, FEWEST
    while end < len(scaled):
        part = slice(end, end + size)
        away = np.asarray((np.abs(scaled[part] - scaled[start]) > 1).any(axis=1))
        if away.any():
            return end + int(np.argmax(away))
        end, size = min(end + size, len(scaled)), 2 * size
    return len(scaled)


def dwell_means(columns: dict[str, Floats], pose: Floats, sigma: Floats) -> Dwells:
    """Average columns (n,) over the stands of a reference (n, d) with standard uncertainties
    `sigma` (d,)."""
    parts = stands(pose, sigma)
    means = {
        name: np.array([mean(values[part]) for part in parts]) for name, values in columns.items()
    }
    rows = np.array([part.stop - part.start for part in parts], dtype=float)
    readings = np.column_stack([columns[name] for name in READING_COLUMNS])
    share = shares(np.column_stack([means[name] for name in READING_COLUMNS]))
    spread = per_row([readings[part] for part in parts], share)
    noise = share * np.sqrt(spread / np.maximum(rows, 1)[:, None])
    left_out = len(pose) - int(rows.sum())
    return Dwells(means, noise, rows, left_out)


def mean(values: Floats) -> float:
    """The mean of the values of a stand, without those far from all others."""
    there = values[np.isfinite(values)]
    if not there.size:
        return np.nan
    low, middle, high = np.quantile(there, [0.25, 0.5, 0.75])
    if high > low:
        there = there[np.abs(there - middle) <= FAR * (high - low) / QUARTILES]
    return float(there.mean())


def shares(means: Floats) -> Floats:
    """Relative noise of the readings (m, 9) from stand to stand: proportional to 1 / power for a
    place, constant for a power."""
    noise_shares: Floats = np.ones_like(means)
    if not len(means):
        return noise_shares
    for k in range(3):
        power = means[:, 3 * k + 2]
        noise_shares[:, 3 * k : 3 * k + 2] = (np.nanmedian(power) / power)[:, None]
    return noise_shares


def per_row(stands: list[Floats], share: Floats) -> Floats:
    """The variance (d,) of one row of stands (n, d) each, from the scatter of the means of parts of
    all stands; NaN without any.

    share: (m, d) of the noise. For white noise it is the row's variance; for noise that lasts
    longer than a part, much more.
    """
    variances = []
    for rows, over in zip(stands, share, strict=True):
        length = len(rows) // PARTS
        means = rows[: PARTS * length].reshape(PARTS, length, -1).mean(axis=1)
        variances.append(length * means.var(axis=0, ddof=1) / over**2)
    if not variances:
        return np.full(share.shape[1], np.nan)
    return median(np.array(variances)) / MEDIAN_OF_VARIANCE


def median(values: Floats) -> Floats:
    """Medians (m,) of columns (n, m) without missing values; 0 for an empty column."""
    there = np.isfinite(values).any(axis=0)
    medians = np.zeros(values.shape[1])
    medians[there] = np.nanmedian(values[:, there], axis=0)
    return medians
