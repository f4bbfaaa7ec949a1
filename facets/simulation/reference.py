"""Simulate a reference instrument that measures the mirror's poses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..core.names import state_columns
from ..core.units import Floats


def reference_poses(poses: Floats, sigma: Sequence[float], rng: np.random.Generator) -> Floats:
    """Add the reference's errors to poses (n, 6); NaN on an axis that it does not measure.

    sigma: (6,) standard uncertainties, mm and rad; infinite for an axis without measurement.
    An error stays constant while the mirror is at rest, as that of an encoder.
    """
    error = rng.standard_normal(poses.shape)
    moved = np.append(True, (np.diff(poses, axis=0) != 0).any(axis=1))
    arrival = np.maximum.accumulate(np.where(moved, np.arange(len(poses)), 0))
    measured = np.isfinite(sigma)
    readings: Floats = poses + np.where(measured, sigma, 0.0) * error[arrival]
    readings[:, ~measured] = np.nan
    return readings


def reference_columns(poses: Floats) -> dict[str, Floats]:
    """Columns `ref_tx_mm` ... of `reference_poses` (n, 6), only for the measured axes."""
    columns = state_columns(poses, "ref_")
    return {name: values for name, values in columns.items() if not np.isnan(values).any()}
