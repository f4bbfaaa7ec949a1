"""Whether the errors on samples held back are more than chance allows."""

import numpy as np
import pytest

from facets.calibration import verdict
from facets.core import STATE_COLUMNS

#: From the median of absolute deviates to a standard deviation.
NORMAL_MEDIAN = 1.4826


def findings_of(error):
    """The findings on errors (n, 6) of poses, each with a standard uncertainty of 1."""
    return verdict.validation_findings({
        "axis": np.array(STATE_COLUMNS[:6]),
        "unit": np.full(6, "um"),
        "robust": NORMAL_MEDIAN * np.nanmedian(np.abs(error), axis=0),
        "stated": np.ones(6),
        "samples": np.isfinite(error).sum(axis=0).astype(float),
    })  # fmt: skip


@pytest.mark.parametrize("count", [5, 10, 26, 200])
def test_calibrations_without_a_fault_are_hardly_ever_told_to_be_worse(count):
    """One in a hundred; with a fixed limit of 1.5 these were 70, 44, 11.5 and 0 %."""
    rng = np.random.default_rng(count)
    told = [findings_of(rng.standard_normal((count, 6))) for _ in range(400)]
    assert sum(map(bool, told)) <= 12
    assert not any(finding.bad for each in told for finding in each)


@pytest.mark.parametrize(("count", "factor"), [(5, 12.0), (10, 5.0), (26, 3.0), (200, 2.5)])
def test_a_calibration_that_is_worse_than_stated_is_refused(count, factor):
    rng = np.random.default_rng(count)
    error = factor * rng.standard_normal((200, count, 6))
    refused = [any(finding.bad for finding in findings_of(each)) for each in error]
    assert np.mean(refused) > 0.95


def test_each_axis_counts_its_own_poses():
    """Errors of 1.75 uncertainties in five poses are within chance; in 50 they are not."""
    error = np.full((50, 6), 0.1)
    error[:5, 1], error[5:, 1] = 1.75, np.nan
    assert not findings_of(error)
    error[:, 1] = 1.75
    assert "50 samples held back the poses err by 2.59 um in ty_mm" in findings_of(error)[0].words
