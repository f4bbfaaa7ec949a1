"""Propagation of distributions: cases with a known answer, and what the command says."""

from dataclasses import replace

import numpy as np
import pytest
import yaml
from commands import command

import facets
from facets.characterization import (
    coverage_intervals,
    default_states,
    propagate_distributions,
    saturated_detectors,
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
FINE = np.array([1e3, 1e3, 1e3, 1e6, 1e6, 1e6])


@pytest.mark.parametrize(
    ("uncertainty", "digits", "half"), [(1.5011, 2, 0.05), (0.0996, 2, 5e-3), (960.0, 1, 500.0)]
)
def test_the_tolerance_is_half_a_unit_of_the_last_digit(uncertainty, digits, half):
    assert tolerance(uncertainty, digits) == pytest.approx(half)


def test_intervals_of_sums_and_of_a_skew_distribution_are_those_known():
    """JCGM 101, 9.2: sums of four normal and of four rectangular quantities, also where one has ten
    times the standard deviation of the others; an exponential one by its formulas."""
    rng, count = np.random.default_rng(3), 400_000
    flat = np.sqrt(3) * rng.uniform(-1, 1, (4, count))
    columns = [
        rng.standard_normal((4, count)).sum(axis=0),
        flat.sum(axis=0),
        flat[:3].sum(axis=0) + 10 * flat[3],
        rng.exponential(size=count),
    ]
    symmetric, shortest = coverage_intervals(np.stack([*columns, *columns[:2]], axis=1), 0.95)
    expected = np.array([3.92, 3.88, 17.0])
    for interval, rel in ((symmetric, 0.008), (shortest, 0.025)):
        assert interval.high[:3] == pytest.approx(expected, rel=rel)
        assert interval.low[:3] == pytest.approx(-expected, rel=rel)
    low, high = -np.log(0.975), -np.log(0.025)
    assert [symmetric.low[3], symmetric.high[3]] == pytest.approx([low, high], rel=0.02)
    assert [shortest.low[3], shortest.high[3]] == pytest.approx([0, -np.log(0.05)], abs=0.02)
    error = np.sqrt(0.025 * 0.975 / count) / (0.05845 / 2)  # of a normal quantile, by its formula
    assert symmetric.errors[0] == pytest.approx([error, error], rel=0.2)


def test_a_linear_case_gives_the_linear_result():
    """The noise of the paper's detectors is so small that the pose follows it in proportion."""
    found = propagate_distributions(PAPER.sensor, PAPER.solve, REST, 40_000)
    low, high = found.linear_interval
    for ends, linear, side in ((found.symmetric.low, low, 0), (found.symmetric.high, high, 1)):
        assert (np.abs(ends - linear) < 4 * found.symmetric.errors[:, side]).all()
    assert found.linear_region_probability == pytest.approx(0.95, abs=0.004)
    assert found.region_factor == pytest.approx(3.548, rel=0.01)
    assert min(found.validate()[0]) >= 1
    assert not found.trials.failures


def test_a_quadratic_case_has_the_known_answer():
    """An object a metre away along x: its x falls by the square of pitch and yaw, of which the
    linear result knows nothing."""
    noise = replace(PAPER.sensor.noise, position=0.5)
    sensor, arm = replace(PAPER.sensor, noise=noise), 1000.0
    body = facets.MeasuredObject(point=(arm, 0, 0))
    mirror = propagate_distributions(sensor, KNOWN, REST, 60_000)
    found = propagate_distributions(sensor, KNOWN, REST, 60_000, object=body)
    rng, sigma = np.random.default_rng(9), mirror.linear.uncertainty[0]
    turns = rng.standard_normal((400_000, 2)) * sigma[4:6]
    fall = -arm / 2 * (turns**2).sum(axis=1)
    expected = np.quantile(fall, [0.025, 0.975])
    ends = [found.symmetric.low[0], found.symmetric.high[0]]
    assert ends == pytest.approx(expected, rel=0.04, abs=2e-4)
    assert found.validate()[0][0] == 0
    assert found.validate()[0][2] >= 1
    assert found.linear_region_probability < 0.3
    assert found.far > 0.3 * found.count


def test_steps_of_a_converter_are_drawn_as_rectangular():
    """Coarse steps alone: each current is off by up to half a step, not always by the same."""
    bench = facets.load("bench").sensor
    electronics = replace(bench.electronics, adc_bits=8, bandwidth=1e-3)
    sensor = replace(bench, electronics=electronics)
    exact = np.tile(facets.readings(sensor, REST), (20_000, 1))
    drawn = sample_readings(sensor, exact, np.random.default_rng(1), rounded=False)
    assert drawn.std(axis=0) == pytest.approx(
        facets.standard_deviations(sensor, exact[0]), rel=0.03
    )
    assert (facets.add_noise(sensor, exact, np.random.default_rng(1)).std(axis=0) < 1e-9).all()
    # of the power: a sum of four rectangular numbers is never farther than its steps
    off = np.abs(drawn[:, 2] - exact[:, 2]).max() / drawn[:, 2].std()
    assert off < 4 * np.sqrt(3)


#: A parameter of each kind that a calibration knows, with a standard uncertainty in mm, rad, mW.
KINDS = {
    "psd_a.height": 1e-3,
    "beam.power": 1e-4,
    "beam.sigma_xx": 1e-5,
    "beam.sigma_xy": 1e-5,
    "correction_a.power": 1e-3,
    "correction_b.z20": 0.1,
    "misfit_a.psi": 1e-3,
    "model_b.power": 1e-5,
    "light.centre_x": 1e-3,
}
AWAY = np.array([0.03, -0.02, 0.3, 1e-3, -2e-3, 3e-3, 0.01, 0])


@pytest.mark.parametrize("name", KINDS)
def test_what_a_calibration_left_open_is_drawn(name):
    """The trials have the linear covariance of each kind of parameter, the noise being smaller."""
    known = facets.Calibration((name,), ((KINDS[name] ** 2,),), np.inf)
    quiet = replace(PAPER.sensor.noise, position=1e-6, power=1e-8)
    sensor = replace(PAPER.sensor, noise=quiet, calibration=known)
    found = propagate_distributions(sensor, KNOWN, AWAY, 3000)
    assert not found.trials.failures
    assert found.linear.calibration_uncertainty[0].max() > 10 * found.linear.noise_uncertainty.max()
    size = np.sqrt(np.diag(found.covariance))
    assert size == pytest.approx(found.linear.uncertainty[0], rel=0.06)


def test_a_short_calibration_has_wide_tails():
    known = facets.Calibration(("psd_a.height",), ((1e-4,),), 5.0)
    sensor = replace(PAPER.sensor, calibration=known)
    found = propagate_distributions(sensor, KNOWN, REST, 40_000)
    whole, part = found.linear.uncertainty[0, 2], found.linear.calibration_uncertainty[0, 2]
    noise, rng = found.linear.noise_uncertainty[0, 2], np.random.default_rng(8)
    drawn = noise * rng.standard_normal(400_000) + part * rng.standard_t(5, 400_000)
    size = np.sqrt(noise**2 + part**2 * 5 / 3)  # the variance of Student's t is n / (n - 2)
    assert np.sqrt(found.covariance[2, 2]) == pytest.approx(size, rel=0.05)
    assert found.symmetric.high[2] == pytest.approx(np.quantile(drawn, 0.975), rel=0.03)
    linear = found.linear.expanded_uncertainty()[0, 2]  # Welch and Satterthwaite approximate
    assert 1 < found.symmetric.high[2] / linear < 1.1
    assert linear > 1.15 * 1.96 * whole


def test_the_linear_result_differs_where_light_is_faint():
    """4 uW with an unknown power, beside the beam's middle: the interval is skew."""
    sensor = replace(PAPER.sensor, beam=replace(PAPER.sensor.beam, power=0.004))
    options, state = replace(KNOWN, power="unknown"), REST.copy()
    state[0] = 0.13
    found = propagate_distributions(sensor, options, state, 40_000)
    low, high = found.linear_interval
    assert found.validate()[0][0] == 0
    assert found.symmetric.high[0] - high[0] > 5 * found.symmetric.errors[0, 1]
    assert found.symmetric.low[0] - low[0] > 4 * found.symmetric.errors[0, 0]


def test_trials_without_a_pose_are_counted():
    """A spot just inside its detector's edge: noise carries some of the readings past it."""
    near = REST.copy()
    near[2] = EDGE - 0.008
    found = propagate_distributions(PAPER.sensor, KNOWN, near, 2000)
    assert 0 < sum(found.trials.failures.values()) < 100
    assert np.isfinite(found.symmetric.low).all()


def test_resolution_writes_trials(tmp_path):
    """Of the second pose, whose spots are on their detectors' edges, half of the trials have no
    solution, so that no interval is stated."""
    import pandas

    edge = REST.copy()
    edge[2] = EDGE - 0.001
    places = np.array([AWAY, edge]) / STATE_UNITS
    write_table(tmp_path / "p.csv", dict(zip(STATE_COLUMNS, places.T, strict=True)), {})
    words = ["resolution", "paper", "-d", "out", "--trials"]
    run = command(*words, "4000", "--poses", "p.csv", "--seed", "3", cwd=tmp_path)
    assert run.returncode == 1, run.stderr
    assert "95 % coverage intervals at row 1 of p.csv, 4,000 trials" in run.stdout
    assert "no interval is stated" in " ".join(run.stdout.split())
    assert "nan" not in run.stdout
    found = pandas.read_csv(tmp_path / "out" / "trials.csv", comment="#")
    assert len(found) == 12
    assert found.tx_mm.iloc[0] == pytest.approx(0.03)
    exact = propagate_distributions(PAPER.sensor, PAPER.solve, AWAY, 4000, seed=(3, 0))
    assert found.symmetric_low.iloc[:6].to_numpy() == pytest.approx(
        FINE * (exact.symmetric.low - exact.linear.pose[0])
    )
    assert found.symmetric_low.iloc[6:].isna().all()
    assert 0.3 < found.without_pose.iloc[6] / 4000 < 1
    assert (found.agrees_to_digits.iloc[6:] == 0).all()
    assert (tmp_path / "out" / "trials.png").stat().st_size > 10_000
    record = yaml.safe_load((tmp_path / "out" / "run.yaml").read_text("utf-8"))
    assert record["results"]["trials"] == 4000
    assert run.stdout.count("more trials decide") == (
        "digit?" in run.stdout or "digits?" in run.stdout
    )


def test_wrong_trials_are_refused(run_in_process, tmp_path):
    head = ",".join(STATE_COLUMNS)
    (tmp_path / "bad.csv").write_text(f"{head}\n0,0,0,0,0,0,0,0\n1,2,x,0,0,0,0,0\n")
    for words, message in (
        (["--poses", "bad.csv"], "add --trials"),
        (["--trials", "300"], "allowed: 400 or more"),
        (["--trials", "4000", "--poses", "bad.csv"], "bad.csv:3: this row is no pose"),
    ):
        status, _, errors = run_in_process("resolution", "paper", *words)
        assert status == 2
        assert message in errors


@pytest.mark.slow
def test_poses_where_axes_are_worst_do_not_repeat_rest():
    """In `paper` tz, roll and yaw are worst at rest."""
    found = default_states(PAPER.sensor, PAPER.range, KNOWN)
    assert [*found] == ["at rest", *(f"where {name} is worst" for name in ("tx", "ty", "pitch"))]
    assert all(state.any() == (name != "at rest") for name, state in found.items())


def test_a_detector_whose_converter_ends_is_named_as_the_cause_of_trials_without_a_pose():
    bench, state = facets.load("bench").sensor, np.array([0, -0.5, 0, 0, 0, 0, 0, 0])
    assert saturated_detectors(bench, state) == ["B"]
    finer = replace(bench.electronics, transimpedance=bench.electronics.transimpedance / 2)
    assert saturated_detectors(replace(bench, electronics=finer), state) == []
    assert saturated_detectors(PAPER.sensor, state) == []
