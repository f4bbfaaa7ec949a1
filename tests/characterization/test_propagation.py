"""Propagation of distributions: cases with a known answer, and what the command says."""

from dataclasses import replace

import numpy as np
import pytest

import facets
from facets.characterization import (
    MonteCarlo,
    coverage_interval,
    default_states,
    estimator_of,
    propagate_distributions,
    tolerance,
)
from facets.core import STATE_COLUMNS, STATE_UNITS
from facets.detectors import sample_readings
from facets.files import write_table

PAPER = facets.load("paper")
KNOWN = replace(PAPER.solve, beam="known", power="known")
REST = np.zeros(8)
#: The height at which all three spots reach the edges of their detectors, mm.
EDGE = 6.5 + 0.22025252
AWAY = np.array([0.03, -0.02, 0.3, 1e-3, -2e-3, 3e-3, 0.01, 0])


def test_the_tolerance_is_half_a_unit_of_the_last_digit():
    halves = [tolerance(1.5011, 2), tolerance(0.0996, 2), tolerance(960.0, 1)]
    assert halves == pytest.approx([0.05, 5e-3, 500.0])


def test_intervals_of_sums_and_of_a_skew_distribution_are_those_known():
    """JCGM 101, 9.2: sums of four normal and of four rectangular quantities, one of them with ten
    times the standard deviation of the others; an exponential one by its formulas."""
    rng, count = np.random.default_rng(3), 400_000
    normal = rng.standard_normal((4, count))
    flat = np.sqrt(3) * rng.uniform(-1, 1, (4, count)) * [[1], [1], [1], [10]]
    skew = rng.exponential(size=count)
    columns = [normal.sum(axis=0), flat.sum(axis=0), *[skew] * 4]
    symmetric = coverage_interval(np.stack(columns, axis=1), 0.95)
    expected = np.array([3.92, 17.0])
    assert symmetric.high[:2] == pytest.approx(expected, rel=0.008)
    assert symmetric.low[:2] == pytest.approx(-expected, rel=0.008)
    ends = [symmetric.low[3], symmetric.high[3]]
    assert ends == pytest.approx(-np.log([0.975, 0.025]), rel=0.02)
    error = np.sqrt(0.025 * 0.975 / count) / (0.05845 / 2)  # of a normal quantile, by its formula
    assert symmetric.errors[0] == pytest.approx([error, error], rel=0.2)


@pytest.mark.parametrize("known", [{}, {"method": "paper"}, {"beam": "prior", "beam_sigma": 0.005}])
@pytest.mark.parametrize("state", [REST, AWAY])
def test_a_linear_case_gives_the_linear_result(known, state):
    """The noise of the paper's detectors is so small that the pose follows it in proportion, so
    that estimates scatter as the bound says and have no bias."""
    found = propagate_distributions(
        PAPER.sensor, replace(PAPER.solve, **known), state, MonteCarlo(40_000)
    )
    ends = np.stack([found.symmetric.low, found.symmetric.high], axis=1)
    linear = np.stack(found.linear_interval, axis=1)
    assert (np.abs(ends - linear) < 4 * found.symmetric.errors).all()
    assert found.linear_region_probability == pytest.approx(0.95, abs=0.004)
    assert min(found.validate()[0]) >= 1
    assert not found.trials.failures


def test_a_quadratic_case_has_the_known_answer():
    """An object a metre away along x: its x falls by the square of pitch and yaw, of which the
    linear result knows nothing."""
    sensor = replace(PAPER.sensor, noise=replace(PAPER.sensor.noise, position=0.5))
    body = facets.MeasuredObject(point=(1000.0, 0, 0))
    found = propagate_distributions(sensor, KNOWN, REST, MonteCarlo(60_000), object=body)
    drawn = np.random.default_rng(9).standard_normal((400_000, 2))
    turns = found.linear.uncertainty[0, 4:6] * drawn
    expected = np.quantile(-1000 / 2 * (turns**2).sum(axis=1), [0.025, 0.975])
    ends = [found.symmetric.low[0], found.symmetric.high[0]]
    assert ends == pytest.approx(expected, rel=0.04, abs=2e-4)
    digits = found.validate()[0]
    assert digits[0] == 0
    assert digits[2] >= 1
    assert found.linear_region_probability < 0.3
    assert found.far > 0.3 * found.count


def test_steps_of_a_converter_are_drawn_as_rectangular():
    """Coarse steps alone: each current is off by up to half a step, not always by the same."""
    bench = facets.load("bench").sensor
    coarse = replace(bench, electronics=replace(bench.electronics, adc_bits=8, bandwidth=1e-3))
    exact = np.tile(facets.readings(coarse, REST), (20_000, 1))
    off = sample_readings(coarse, exact, np.random.default_rng(1), rounded=False) - exact
    sigma = facets.standard_deviations(coarse, exact[0])
    assert off.std(axis=0) == pytest.approx(sigma, rel=0.03)
    # of the power: a sum of four rectangular numbers is never farther than its steps
    assert np.abs(off[:, 2]).max() < 4 * np.sqrt(3) * off[:, 2].std()


#: A parameter of each kind that a calibration knows, with a standard uncertainty in mm, rad, mW.
KINDS = {
    "psd_a.height": 1e-3,
    "beam.power": 1e-4,
    "beam.sigma_xy": 1e-5,
    "correction_a.power": 1e-3,
    "correction_b.z20": 0.1,
    "misfit_a.psi": 1e-3,
    "model_b.power": 1e-5,
    "light.centre_x": 1e-3,
}


@pytest.mark.parametrize("name", KINDS)
def test_what_a_calibration_left_open_is_drawn(name):
    """The trials have the linear covariance of each kind of parameter, the noise being smaller."""
    known = facets.Calibration((name,), ((KINDS[name] ** 2,),), np.inf)
    quiet = replace(PAPER.sensor.noise, position=1e-6, power=1e-8)
    sensor = replace(PAPER.sensor, noise=quiet, calibration=known)
    found = propagate_distributions(sensor, KNOWN, AWAY, MonteCarlo(3000))
    assert not found.trials.failures
    assert found.linear.calibration_uncertainty[0].max() > 10 * found.linear.noise_uncertainty.max()
    sizes = np.sqrt(np.diag(found.covariance))
    assert sizes == pytest.approx(found.linear.uncertainty[0], rel=0.06)


def test_a_short_calibration_has_wide_tails():
    known = facets.Calibration(("psd_a.height",), ((1e-4,),), 5.0)
    sensor = replace(PAPER.sensor, calibration=known)
    found = propagate_distributions(sensor, KNOWN, REST, MonteCarlo(40_000))
    linear, rng = found.linear, np.random.default_rng(8)
    drawn = linear.noise_uncertainty[0, 2] * rng.standard_normal(400_000)
    drawn += linear.calibration_uncertainty[0, 2] * rng.standard_t(5, 400_000)
    assert found.symmetric.high[2] == pytest.approx(np.quantile(drawn, 0.975), rel=0.03)
    # Welch and Satterthwaite approximate
    assert 1 < found.symmetric.high[2] / linear.expanded_uncertainty()[0, 2] < 1.1


@pytest.mark.slow
def test_resolution_writes_trials(tmp_path, run_in_process):
    """Of the second pose, whose spots are on their detectors' edges, half of the trials have no
    solution, so that no interval is stated; of the third, a few have none."""
    import pandas

    places = np.tile(REST, (3, 1))
    places[:, 2] = AWAY[2], EDGE - 0.001, EDGE - 0.008
    columns = dict(zip(STATE_COLUMNS, (places / STATE_UNITS).T, strict=True))
    write_table(tmp_path / "p.csv", columns, {})
    status, out, _ = run_in_process(
        "resolution", "paper", "-d", "out", "--trials", "1000", "--poses", "p.csv", "--seed", "3"
    )
    assert status == 1
    assert "95 % coverage intervals at row 1 of p.csv, 1,000 trials" in out
    assert " ".join(out.split()).count("no interval is stated") == 1
    assert "nan" not in out
    table = pandas.read_csv(tmp_path / "out" / "trials.csv", comment="#")
    assert table.tz_mm[::6].tolist() == pytest.approx(places[:, 2])
    exact = propagate_distributions(
        PAPER.sensor, PAPER.solve, places[0], MonteCarlo(1000, seed=(3, 0))
    )
    low = np.repeat([1e3, 1e6], 3) * (exact.symmetric.low - exact.linear.pose[0])
    assert table.symmetric_low[:6].to_numpy() == pytest.approx(low)
    assert table.symmetric_low.isna().tolist() == [False] * 6 + [True] * 6 + [False] * 6
    _, most, few = table.without_pose[::6]
    assert 0 < few < 50 < 300 < most < 1000
    assert (tmp_path / "out" / "trials.png").exists()


def test_wrong_trials_are_refused(run_in_process, tmp_path):
    head = ",".join(STATE_COLUMNS)
    (tmp_path / "bad.csv").write_text(f"{head}\n0,0,0,0,0,0,0,0\n1,2,x,0,0,0,0,0\n")
    for words, message in (
        (["--poses", "bad.csv"], "add --trials"),
        (["--trials", "300"], "allowed: 400 or more"),
        (["--trials", "4000", "--poses", "bad.csv"], "bad.csv:3: this row is no pose"),
    ):
        status, _, errors = run_in_process("resolution", "paper", *words)
        assert (status, message in errors) == (2, True)


@pytest.mark.slow
def test_poses_where_axes_are_worst_do_not_repeat_rest():
    """In `paper` tz, roll and yaw are worst at rest."""
    found = default_states(PAPER.sensor, PAPER.range, estimator_of(KNOWN, PAPER.sensor))
    assert [*found] == ["at rest", *(f"where {name} is worst" for name in ("tx", "ty", "pitch"))]
    assert all(state.any() == (name != "at rest") for name, state in found.items())
