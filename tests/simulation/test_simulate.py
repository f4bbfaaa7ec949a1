"""A simulated sensor: noise as stated, errors as propagated, nothing hidden."""

from dataclasses import replace

import numpy as np
import pytest

import facets
from facets import add_noise, simulate
from facets.core import STATE_COLUMNS, Sweep
from facets.detectors import fullness
from facets.estimation import PoseColumns, ZeroRequest
from facets.simulation import axes, pose_table, reading_table, statuses

PAPER = facets.load("paper")


@pytest.fixture(scope="module")
def segments():
    return simulate(PAPER, seed=4)


def test_with_noise_the_errors_are_those_that_are_stated_and_without_it_none(segments):
    """Of 1,901 samples; the normalised error's RMS is 1 within 4 of its standard errors."""
    scaled = np.concatenate([s.error / s.solution.uncertainty for s in segments])
    assert np.sqrt((scaled**2).mean(axis=0)) == pytest.approx(np.ones(8), abs=4 / np.sqrt(2 * 1901))
    for segment in simulate(PAPER, noise=False):
        assert np.abs(segment.error).max() < 1e-10


def test_noise_is_of_the_stated_size_and_grows_with_falling_power():
    sensor = facets.Sensor(noise=facets.Noise(position=1e-3, at_power=0.1, power=1e-4))
    exact = np.tile([1.0, 2.0, 0.1, 1.0, 2.0, 0.05, 1.0, 2.0, 0.2], (100_000, 1))
    spread = (add_noise(sensor, exact, np.random.default_rng(1)) - exact).std(axis=0)
    expected = [1e-3, 1e-3, 1e-4, 2e-3, 2e-3, 1e-4, 5e-4, 5e-4, 1e-4]
    assert spread == pytest.approx(expected, rel=0.01)


def test_the_seed_decides_and_motions_do_not_disturb_each_other(segments):
    (alone,) = simulate(PAPER, ["yaw-sweep"], seed=4)
    assert (alone.readings == segments[1].readings).all()
    assert (alone.readings != simulate(PAPER, ["yaw-sweep"])[0].readings).any()


def test_a_spot_beside_its_detector_is_withheld_and_counted():
    motion = Sweep((0.0,) * 8, (0.0, 0.0, 9.0, *(0.0,) * 5), 10, 1.0)
    (segment,) = simulate(replace(PAPER, motions={"m": motion}))
    beside = ~segment.reached.all(axis=1)
    assert np.isnan(segment.readings[beside]).all()
    assert np.isnan(segment.solution.state[beside]).all()
    assert statuses(segment) == {"converged": 7, "non finite": 3}
    assert axes(segment)[2].largest < 0.02


def test_tables_have_a_row_a_sample_and_a_saved_zero_holds_for_each_motion(tmp_path):
    (tmp_path / "zero.csv").write_text(",".join(STATE_COLUMNS[:6]) + "\n0,0,0.1,0,0,0\n")
    request = ZeroRequest(file=tmp_path / "zero.csv")
    segments = simulate(PAPER, seed=4, columns=PoseColumns(request))
    poses = pose_table(segments)
    assert {len(column) for column in reading_table(segments).values()} == {1901}
    errors = poses["yaw_mrad"] - poses["true_yaw_mrad"]
    assert errors == pytest.approx(1e3 * np.concatenate([s.error[:, 5] for s in segments]))


def test_samples_whose_detector_is_saturated_are_counted():
    """A detector that its spot misses is not."""
    sensor = facets.load("bench").sensor
    (segment,) = simulate(facets.load("bench"), ["x-sweep"])
    full = fullness(sensor, facets.readings(sensor, segment.truth))
    share = np.where(segment.reached, np.nan_to_num(full), 0.0)
    assert segment.saturated[share > 1.02].all()
    assert not segment.saturated[share <= 0.98].any()
    assert segment.saturated.any()
