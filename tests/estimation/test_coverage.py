"""Coverage factors, effective degrees of freedom and expanded uncertainties."""

from dataclasses import replace

import numpy as np
import pytest

import facets
from facets import Rules
from facets.characterization import density_at_rest, estimators, resolution_columns, resolve
from facets.core import READING_COLUMNS
from facets.estimation import coverage_factor, effective_degrees_of_freedom, region_factor
from facets.files import write_table

KNOWN = facets.Calibration(("psd_a.height",), ((1e-4,),), 5.0)
SENSOR = replace(facets.load("paper").sensor, calibration=KNOWN)


def test_degrees_of_freedom_follow_welch_and_satterthwaite():
    """By hand: variances 16 + 9 with 4 degrees of freedom of the 9 have 4 (25 / 9)^2."""
    assert effective_degrees_of_freedom(25, 9, 4) == pytest.approx(30.864, abs=1e-3)
    assert effective_degrees_of_freedom([1.0, 0.0], 0, np.nan).tolist() == [np.inf, np.inf]
    assert np.isnan(effective_degrees_of_freedom(25, 9, np.nan))


def test_coverage_factors_are_those_of_the_printed_tables():
    """JCGM 100, table G.2, and JCGM 102, table 1."""
    table = {4: 2.78, 10: 2.23, 20: 2.09, 50: 2.01, np.inf: 1.96, np.nan: 1.96}
    assert coverage_factor(0.95, [*table]) == pytest.approx([*table.values()], abs=5e-3)
    assert coverage_factor(0.99, 5) == pytest.approx(4.03, abs=5e-3)
    regions = [region_factor(0.95, dimensions) for dimensions in (1, 2, 3)]
    assert regions == pytest.approx([1.96, 2.45, 2.80], abs=5e-3)
    # Hotelling: m n / (n - m + 1) times the quantile 4.256 of F with 2 and 9 degrees of freedom.
    assert region_factor(0.95, 2, 10) == pytest.approx(np.sqrt(20 / 9 * 4.256), abs=1e-3)
    assert np.isnan(region_factor(0.95, 6, 5))
    for probability in (0, 1, np.nan):
        with pytest.raises(facets.InputError, match="allowed: between 0 and 1"):
            coverage_factor(probability)


@pytest.mark.parametrize("known", [KNOWN, replace(KNOWN, degrees_of_freedom=None), None])
def test_a_short_calibration_needs_a_larger_factor(known):
    """Where its freedom is unknown, and without a calibration, the factor is the normal one."""
    sensor = replace(SENSOR, calibration=known)
    readings = facets.readings(sensor, np.zeros((2, 8)))
    readings[1] = np.nan
    solution = facets.solve(sensor, readings, beam="known")
    freedom = np.nan if known else np.inf
    if known == KNOWN:
        part = solution.calibration_uncertainty[0, :6] ** 2 / solution.uncertainty[0, :6] ** 2
        freedom = 5 / part**2
    expected = np.broadcast_to(freedom, 6)
    assert solution.degrees_of_freedom[0, :6] == pytest.approx(expected, nan_ok=True)
    factor, expanded = solution.coverage_factor(0.95), solution.expanded_uncertainty(0.95)
    assert factor[0, :6] == pytest.approx(coverage_factor(0.95, expected))
    assert expanded[0] == pytest.approx(factor[0] * solution.uncertainty[0])
    assert np.isnan([factor[1], expanded[1]]).all()


def test_solve_writes_expanded_uncertainties(tmp_path, run_in_process):
    import pandas as pd

    (tmp_path / "c.csv").write_text("psd_a.height\n1e-4\n")
    config = tmp_path / "mine.yaml"
    config.write_text(
        "extends: paper\nsensor: {calibration: {file: c.csv, degrees_of_freedom: 5}}\n"
    )
    rows = facets.readings(SENSOR, np.zeros((2, 8)))
    write_table(tmp_path / "r.csv", dict(zip(READING_COLUMNS, rows.T, strict=True)), {})
    words = ["solve", "mine.yaml", "r.csv", "-o", "poses.csv", "--beam", "known", "--coverage"]
    said = " ".join(run_in_process(*words, "0.99")[1].split())
    assert "coverage probability 99 %" in said
    assert "degrees of freedom of the calibration: 5." in said
    poses = tmp_path / "poses.csv"
    assert "# coverage_probability: 0.99" in poses.read_text()
    row = pd.read_csv(poses, comment="#").iloc[0]
    assert row.expanded_tz_mm == pytest.approx(row.k_tz * row.u_tz_mm)
    assert row.k_tz == pytest.approx(coverage_factor(0.99, row.degrees_of_freedom_tz), rel=1e-6)
    config.write_text(config.read_text().replace(", degrees_of_freedom: 5", ""))
    said = " ".join(run_in_process(*words, "0.99", "--force")[1].split())
    assert "unknown; coverage factors are those of the normal" in said
    assert run_in_process(*words, "95")[0] == 2


def test_resolution_has_expanded_uncertainties():
    """The command of them is one of `tests/helpers/chains.py`."""
    resolutions = resolve(SENSOR, Rules(), estimators(0.005)[-1:])
    densities = [density_at_rest(SENSOR, resolutions[0].how, 1e3)]
    row = resolution_columns(resolutions, densities, 0.95)
    exact = facets.solve(SENSOR, facets.readings(SENSOR, np.zeros(8)), beam="known")
    for name, expected in (
        ("degrees_of_freedom_at_rest", exact.degrees_of_freedom[2]),
        ("expanded_at_rest", 1e3 * exact.expanded_uncertainty(0.95)[2]),
        ("expanded_worst", row["k_worst"][2] * row["u_worst"][2]),
    ):
        assert row[name][2] == pytest.approx(expected, rel=1e-6)
