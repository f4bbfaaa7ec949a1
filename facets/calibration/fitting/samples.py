"""Prepare samples for a fit: remove outliers and duplicates, and determine the noise of means.

An outlier is a corrupted reading or a row of another pose. Huber's loss grows without bound with
such a residual, as do the sums by which candidates are compared. Such samples are removed if they
are few; if they are many, there is another fault, and none is removed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...core.sensor import Sensor
from ...core.units import Floats
from ...detectors.calibrated import TEMPERATURE
from ...detectors.correction import correct
from ...detectors.noise import standard_deviations, step_variances
from ...estimation.dwells import mean, median
from ...model.arrays import EFFECTS
from .bundle_adjustment import Data, deviations
from .fit import NORMAL_MEDIAN, Fit, fit
from .unknowns import TIME_DRIFT, block

#: Largest usual error of the model of real light against rays and propagated fields, mm. Residuals
#: do not show it where the unknowns absorb it.
PLACE_ACCURACY_MM = 2e-4
#: The standard deviation of that error, mm: 0.07 um against propagated fields, and 0.06 um in poses
#: of rigs that were read by rays.
PLACE_SIGMA_MM = 1e-4
#: Relative accuracy of the model of real light in a power.
POWER_ACCURACY = 5e-5
#: Robust weight below which a reading is an outlier: beyond 12 standard deviations, if the limit of
#: full weight is 3.
LEAST_WEIGHT = 0.25
#: Largest fraction of samples with an outlier for which they are removed.
MOST_OUTLIER_FRACTION = 0.1
#: Number of times that outliers are looked for, because large ones hide others.
EXCLUSION_ROUNDS = 2


def find_outliers(
    sensor: Sensor, result: Fit, data: Data, robust: float | None
) -> NDArray[np.bool_]:
    """Whether each sample (n,) has a residual far beyond most residuals of its column.

    robust: limit of full weight, in standard deviations; None: no sample is an outlier. Each column
    has its own scale, because errors of the model in powers and positions are unrelated. Errors
    within the accuracy of the model of real light are not outliers.
    """
    if robust is None:
        return np.zeros(len(data.raw), dtype=bool)
    size = np.where(np.isfinite(data.raw), np.abs(result.residuals), np.nan)
    scale = np.maximum(1.0, NORMAL_MEDIAN * median(size))
    if any(name in EFFECTS for name in result.choice.names):
        scale = np.maximum(scale, median(model_accuracy(data) / deviations(sensor, data)))
    return np.asarray((size > robust * scale / LEAST_WEIGHT).any(axis=1))


def model_accuracy(data: Data, place: float = PLACE_ACCURACY_MM) -> Floats:
    """The accuracy (9,) of the model of real light in each reading, mm and mW.

    place: its accuracy in a place on a detector, mm.
    """
    accuracy = np.full(9, place)
    accuracy[2::3] = POWER_ACCURACY * median(data.raw)[2::3]
    return accuracy


#: The correlation above which two regressors are indistinguishable.
ALIKE = 0.95


def warms_with_time(data: Data) -> bool:
    """Whether the temperature correlates with time, or with the row's number, over the run."""
    if data.clock is None or not data.clock[:, 1].any():
        return False
    time = data.clock[:, 0] if data.clock[:, 0].any() else row_numbers(data)
    return bool(abs(np.corrcoef(time, data.clock[:, 1])[0, 1]) > ALIKE)


def half_drift(result: Fit, data: Data) -> Floats:
    """Drift (8,) of the beam and of positions on the detectors in half a run, mm: with time, plus
    with the temperature if this is indistinguishable from time."""
    drifted: Floats = result.all_values[block(TIME_DRIFT)]
    if warms_with_time(data):
        assert data.clock is not None
        drifted = drifted + result.all_values[block(TEMPERATURE)] * np.ptp(data.clock[:, 1]) / 2
    return drifted


def row_numbers(data: Data) -> NDArray[np.int64]:
    """The numbers (n,) of the samples' rows in the table, from 1."""
    return np.arange(1, len(data.raw) + 1) if data.number is None else data.number


def exclude_outliers(
    sensor: Sensor, data: Data, result: Fit, robust: float | None, spent: int = 0
) -> tuple[Data, Fit, list[int]]:
    """Return the samples without outliers, the fit to them, and the numbers of the removed rows.

    None is removed if there are many outliers.  spent: number of rows that were removed before.
    """
    remaining, last, excluded = data, result, list[int]()
    for _ in range(EXCLUSION_ROUNDS):
        is_outlier = find_outliers(sensor, last, remaining, robust)
        if not is_outlier.any():
            break
        excluded += row_numbers(remaining)[is_outlier].tolist()
        if len(excluded) + spent > MOST_OUTLIER_FRACTION * (len(data.raw) + spent):
            return data, result, []
        start = replace(last, own_values=last.own_values[~is_outlier])
        remaining = remaining.part(~is_outlier)
        last = fit(sensor, remaining, result.choice, robust, start)
    return remaining, last, sorted(excluded)


def remove_duplicates(data: Data) -> Data:
    """Remove repeated rows."""
    _, first = np.unique(np.column_stack([data.pose, data.raw]), axis=0, return_index=True)
    return data if len(first) == len(data.raw) else data.part(np.sort(first))


def average_equal_poses(sensor: Sensor, data: Data) -> Data:
    """Average readings at equal poses, where the reference has the same error, to one sample with
    the noise of the mean."""
    keys = np.column_stack([data.pose, data.beam])
    _, first, group, counts = np.unique(
        keys, axis=0, return_index=True, return_inverse=True, return_counts=True
    )
    if (counts == 1).all() or np.isinf(data.sigma).all():
        return data
    noise, group = deviations(sensor, data), group.ravel()
    parts = [mean_readings(data.raw[group == n], noise[group == n]) for n in range(len(first))]
    raw, sigma = np.array(parts).swapaxes(0, 1)
    rows = np.ones(len(data.raw)) if data.rows is None else data.rows
    totals = np.bincount(group, rows)
    order = np.argsort(first)
    merged = data.part(first)._replace(raw=raw, noise=sigma, rows=totals.astype(float))
    return merged.part(order)


def mean_readings(raw: Floats, noise: Floats) -> tuple[Floats, Floats]:
    """The mean (9,) of readings (n, 9) and its noise (9,).  noise: (n, 9) of the readings."""
    is_finite = np.isfinite(raw)
    with np.errstate(invalid="ignore"):  # no reading at all
        sigma = np.where(is_finite, noise, 0.0).sum(axis=0) / is_finite.sum(axis=0) ** 1.5
    return np.array([mean(column) for column in raw.T]), sigma


def add_converter_steps(sensor: Sensor, data: Data) -> Data:
    """Add the variance of the converter's steps to the noise of means.

    The error due to the steps is the same in all readings at one state, so that averaging does not
    reduce it and scatter does not show it.
    """
    if data.rows is None or data.noise is None or sensor.electronics is None:
        return data
    raw, rows = correct(sensor, data.raw), data.rows[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = data.noise**2 * rows / standard_deviations(sensor, raw) ** 2
    scatter = np.ones(len(raw))
    is_read = np.isfinite(ratio).any(axis=1)
    scatter[is_read] = np.minimum(np.nanmedian(ratio[is_read], axis=1), 1.0)
    added = np.nan_to_num(step_variances(sensor, raw, scatter)) * (1 - 1 / np.maximum(rows, 1))
    return data._replace(noise=np.sqrt(data.noise**2 + added))
