"""A simulated sensor: noise as stated, errors as propagated, nothing hidden."""

import numpy as np
import pytest

import facets
from facets import InputError, add_noise, simulate
from facets.detectors import fullness
from facets.simulation import axes, pose_table, reading_table, statuses

PAPER = facets.load("paper")


@pytest.fixture(scope="module")
def segments():
    return simulate(PAPER, seed=4)


def simulate_motion(folder, motion: str, solve: str = "{}"):
    path = folder / "c.yaml"
    path.write_text(f"extends: paper\nmotions: {{m: {motion}}}\nsolve: {solve}\n")
    return simulate(facets.load(path), ["m"])[0]


def test_without_noise_the_poses_are_exact():
    for segment in simulate(PAPER, noise=False):
        assert segment.solution.ok.all()
        assert np.abs(segment.error).max() < 1e-10


def normalised(segments, axis=slice(None)):
    """The r.m.s. of errors over their uncertainties."""
    scaled = [s.error[:, axis] / s.solution.uncertainty[:, axis] for s in segments]
    return np.sqrt((np.concatenate(scaled) ** 2).mean(axis=0))


def test_with_noise_the_errors_are_those_that_are_stated(segments):
    """Of 1,901 samples; the normalised error's RMS is 1 within 4 of its standard errors."""
    assert normalised(segments) == pytest.approx(np.ones(8), abs=4 / np.sqrt(2 * 1901))


def test_noise_is_of_the_stated_size_and_grows_with_falling_power():
    sensor = facets.Sensor(noise=facets.Noise(position=1e-3, at_power=0.1, power=1e-4))
    exact = np.tile([1.0, 2.0, 0.1, 1.0, 2.0, 0.05, 1.0, 2.0, 0.2], (100_000, 1))
    spread = (add_noise(sensor, exact, np.random.default_rng(1)) - exact).std(axis=0)
    expected = [1e-3, 1e-3, 1e-4, 2e-3, 2e-3, 1e-4, 5e-4, 5e-4, 1e-4]
    assert spread == pytest.approx(expected, rel=0.01)


def test_the_seed_decides_and_motions_do_not_disturb_each_other(segments):
    for first, again in zip(segments, simulate(PAPER, seed=4), strict=True):
        assert (first.readings == again.readings).all()
    alone = simulate(PAPER, ["yaw-sweep"], seed=4)[0]
    assert (alone.readings == segments[1].readings).all()
    assert (simulate(PAPER, seed=5)[0].readings != segments[0].readings).any()


def test_a_spot_beside_its_detector_is_withheld_and_counted(tmp_path):
    motion = "{kind: sweep, from: {tz_mm: 0}, to: {tz_mm: 9}, samples: 10}"
    segment = simulate_motion(tmp_path, motion)
    beside = ~segment.reached.all(axis=1)
    assert beside.sum() == 3
    assert np.isnan(segment.readings[beside]).all()
    assert np.isnan(segment.solution.state[beside]).all()
    assert segment.solution.ok[~beside].all()
    assert statuses(segment) == {"converged": 7, "non finite": 3}
    assert axes(segment)[2].largest < 0.02
    gone = simulate_motion(tmp_path, motion.replace("tz_mm: 0", "tz_mm: 8.9"))
    assert all(np.isnan([axis.largest, axis.rms]).all() for axis in axes(gone))


@pytest.mark.parametrize("beam", ["known", "prior"])
def test_a_moving_beam_can_be_known(tmp_path, beam):
    motion = "{kind: sweep, from: {tx_mm: -3, bx_mm: -3}, to: {tx_mm: 3, bx_mm: 3}}"
    free = simulate_motion(tmp_path, motion)
    known = simulate_motion(tmp_path, motion, f"{{beam: {beam}, beam_sigma_um: 0.1}}")
    assert known.solution.ok.all()
    assert axes(known)[0].rms < axes(free)[0].rms / 5
    assert normalised([known], 0) == pytest.approx(1, abs=4 / np.sqrt(2 * 401))


def test_motions_that_are_not_there_are_named():
    with pytest.raises(InputError, match="no motion jump; its motions: x-steps"):
        simulate(PAPER, ["jump"])


def test_tables_have_a_row_a_sample(segments):
    for table in (reading_table(segments), pose_table(segments)):
        assert {len(column) for column in table.values()} == {1901}
    errors = pose_table(segments)["yaw_mrad"] - pose_table(segments)["true_yaw_mrad"]
    assert errors == pytest.approx(1e3 * np.concatenate([s.error[:, 5] for s in segments]))


def test_samples_whose_detector_is_saturated_are_counted():
    """A detector that its spot misses is not."""
    bench = facets.load("bench")
    (segment,) = simulate(bench, ["x-sweep"])
    exact = facets.readings(bench.sensor, segment.truth)
    share = np.where(segment.reached, np.nan_to_num(fullness(bench.sensor, exact)), 0.0)
    assert (segment.saturated >= (share > 1.02)).all()
    assert (segment.saturated <= (share > 0.98)).all()
    assert segment.saturated.any()
