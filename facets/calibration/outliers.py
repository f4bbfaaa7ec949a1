"""Exclude samples that noise cannot explain, before anything is decided.

Examples are a reading that jumped, a damaged frame or a row of another pose. Huber's loss grows
without bound with such a residual, and so do the sums that decide on candidates. Such samples are
removed if they are few. If they are many, something else is wrong, and all stay.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..core.sensor import Sensor
from ..core.units import Floats
from ..estimation.dwells import median
from ..model.arrays import EFFECTS
from .bundle_adjustment import Data, deviations
from .fit import NORMAL_MEDIAN, Fit, fit

#: Largest usual error of the model of real light against rays and propagated fields, mm. Residuals
#: do not show it where the unknowns absorb it.
PLACE_ACCURACY_MM = 2e-4
#: The standard deviation of that error, mm: 0.07 um against propagated fields, and 0.06 um in poses
#: of rigs that were read by rays.
PLACE_SIGMA_MM = 1e-4
#: The same of a power, as a share of the power.
POWER_ACCURACY = 5e-5
#: The robust weight below which a reading is none: at 12 standard deviations, with the limit at 3.
LEAST_WEIGHT = 0.25
#: The share of samples with an outlier beyond which they are no outliers.
MOST_OUTLIER_SHARE = 0.1
#: How often samples are taken out: large ones hide others.
EXCLUSION_ROUNDS = 2


def find_outliers(
    sensor: Sensor, result: Fit, data: Data, robust: float | None
) -> NDArray[np.bool_]:
    """Find samples (n,) with a reading that is far off relative to most residuals of its column.

    Each column has its own scale, because an error of the model in the powers says nothing about
    the places. Errors within the accuracy of the model of real light are no outliers.
    """
    if robust is None:
        return np.zeros(len(data.raw), dtype=bool)
    size = np.where(np.isfinite(data.raw), np.abs(result.residuals), np.nan)
    scale = np.maximum(1.0, NORMAL_MEDIAN * median(size))
    if any(name in EFFECTS for name in result.choice.names):
        scale = np.maximum(scale, median(model_accuracy(data) / deviations(sensor, data)))
    with np.errstate(invalid="ignore"):
        off = size > robust * scale / LEAST_WEIGHT
    return np.asarray(off.any(axis=1))


def model_accuracy(data: Data, place: float = PLACE_ACCURACY_MM) -> Floats:
    """The accuracy (9,) of the model of real light in each reading, mm and mW.  place: its accuracy
    in a place, mm."""
    accuracy = np.full(9, place)
    accuracy[2::3] = POWER_ACCURACY * median(data.raw)[2::3]
    return accuracy


def row_numbers(data: Data) -> NDArray[np.int64]:
    """The numbers (n,) of the samples' rows in the table, from 1."""
    return np.arange(1, len(data.raw) + 1) if data.number is None else data.number


def exclude_outliers(
    sensor: Sensor, data: Data, result: Fit, robust: float | None, spent: int = 0
) -> tuple[Data, Fit, list[int]]:
    """Return the samples without outliers, the fit to them, and the rows that were removed.

    spent: number of rows that were removed before.
    """
    gone = list[int]()
    for _ in range(EXCLUSION_ROUNDS):
        off = find_outliers(sensor, result, data, robust)
        if not off.any() or off.sum() + len(gone) + spent > MOST_OUTLIER_SHARE * (
            len(off) + len(gone)
        ):
            break
        gone += row_numbers(data)[off].tolist()
        data, start = data.part(~off), replace(result, own_values=result.own_values[~off])
        result = fit(sensor, data, result.choice, robust, start)
    return data, result, sorted(gone)
