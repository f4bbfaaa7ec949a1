"""How well poses are known after a calibration: tried on samples that it has not seen."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.knowledge import Prior
from ..core.names import ANGLES, POSE
from ..core.sensor import Sensor
from ..core.units import Floats
from ..detectors.correction import correct
from ..estimation.solution import Solution
from ..estimation.solver import solve
from ..model.arrays import readings
from .bundle_adjustment import OWN_COUNT, Data, add_skew, states_of
from .fit import NORMAL_MEDIAN, Fit
from .unknowns import fold_mount, values_of

#: From the axes' units to those in which errors are shown, um and urad.
FINE_FACTORS = np.array([1e6 if name in ANGLES else 1e3 for name in POSE])
#: Coverage factor of a level of confidence of 0.95.
COVERAGE_FACTOR = 1.96


class Trial(NamedTuple):
    """Errors of solved poses against those of the reference, and their standard uncertainties: (n,
    6)."""

    error: Floats
    uncertainty: Floats

    @property
    def coverage(self) -> Floats:
        """The share of 95 % intervals that held, by axis: (6,)."""
        with np.errstate(invalid="ignore"):
            hit = np.abs(self.error) <= COVERAGE_FACTOR * self.uncertainty
        there = np.isfinite(self.error)
        share: Floats = (hit & there).sum(axis=0) / np.maximum(there.sum(axis=0), 1)
        return share


def compare_poses(sensor: Sensor, held: Data, values: Floats, result: Fit) -> Trial:
    """Compare poses from held-back readings with the reference's, the beam known as well as the fit
    takes it to be.

    values: values of `ALL`, for where the mirror is on the reference.
    """
    data = held if held.seat is None else held.part(held.seat == 0)
    still, values = np.zeros((len(data.raw), OWN_COUNT)), fold_mount(values)
    truth = states_of(data, still, values)
    exact = readings(sensor, truth)
    seen = exact.copy()
    add_skew(seen, sensor, data, still, values)
    solution: Solution = solve(
        sensor,
        correct(sensor, data.raw) - (seen - exact),
        beam=Prior(truth[:, 6:], result.choice.beam),
        power="unknown" if result.choice.power else "known",
        threads=0,
    )
    return Trial(
        (solution.state - truth)[:, :6],
        np.hypot(solution.uncertainty[:, :6], np.where(np.isfinite(data.sigma), data.sigma, 0.0)),
    )


def validation_table(nominal: Sensor, result: Fit, held: Data) -> dict[str, NDArray[Any]]:
    """Poses solved from held-back readings less the reference's; um and urad.

    before: by the nominal sensor, r.m.s., its mean error taken off, since where the mirror is on
    the reference is not known then.  after: by the calibrated one, r.m.s.; robust: the same from
    the median of the errors' sizes, which a few spikes do not move.  stated: what the uncertainties
    of pose and reference say.  inside: per cent of 95 % intervals that held.
    """
    known = np.isfinite(held.sigma)
    start = compare_poses(nominal, held, values_of(nominal), result)
    ended = compare_poses(result.sensor, held, result.all_values, result)
    columns = {
        "before": rms(start.error - np.nanmean(start.error, axis=0)) * FINE_FACTORS,
        "after": rms(ended.error) * FINE_FACTORS,
        "robust": NORMAL_MEDIAN * np.nanmedian(np.abs(ended.error), axis=0) * FINE_FACTORS,
        "stated": rms(ended.uncertainty) * FINE_FACTORS,
        "inside": 100 * ended.coverage,
    }
    names: dict[str, NDArray[Any]] = {
        "axis": np.array(POSE),
        "unit": np.array(["urad" if name in ANGLES else "um" for name in POSE]),
    }
    return names | {name: np.where(known, column, np.nan) for name, column in columns.items()}


def rms(values: Floats) -> Floats:
    root: Floats = np.sqrt(np.nanmean(values**2, axis=0))
    return root
