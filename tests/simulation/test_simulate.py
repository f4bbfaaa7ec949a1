"""A simulated sensor: noise as stated, errors as propagated, nothing hidden."""

import numpy as np
import pytest
from facets.cli.simulate import outcome

import facets
from facets import InputError, add_noise, simulate
from facets.detectors import fullness
from facets.simulation import axes, pose_table, reading_table, statuses


def config(tmp_path, text: str) -> facets.Config:
    path = tmp_path / "c.yaml"
    path.write_text("extends: paper\n" + text)
    return facets.load(path)


def test_without_noise_the_poses_are_exact():
    for segment in simulate(facets.load("paper"), noise=False):
        assert segment.solution.ok.all()
        assert np.abs(segment.error).max() < 1e-10


def test_with_noise_the_errors_are_those_that_are_stated():
    """Of 1,901 samples; the normalised error's RMS is 1 within 4 of its standard errors."""
    segments = simulate(facets.load("paper"))
    scaled = np.concatenate([s.error / s.solution.uncertainty for s in segments])
    assert np.sqrt((scaled**2).mean(axis=0)) == pytest.approx(np.ones(8), abs=4 / np.sqrt(2 * 1901))


def test_noise_is_of_the_stated_size_and_grows_with_falling_power():
    sensor = facets.Sensor(noise=facets.Noise(position=1e-3, at_power=0.1, power=1e-4))
    exact = np.tile([1.0, 2.0, 0.1, 1.0, 2.0, 0.05, 1.0, 2.0, 0.2], (100_000, 1))
    spread = (add_noise(sensor, exact, np.random.default_rng(1)) - exact).std(axis=0)
    expected = [1e-3, 1e-3, 1e-4, 2e-3, 2e-3, 1e-4, 5e-4, 5e-4, 1e-4]
    assert spread == pytest.approx(expected, rel=0.01)


def test_the_seed_decides_and_motions_do_not_disturb_each_other():
    paper = facets.load("paper")
    first, again = simulate(paper, seed=4), simulate(paper, seed=4)
    for a, b in zip(first, again, strict=True):
        assert (a.readings == b.readings).all()
    alone = simulate(paper, ["yaw-sweep"], seed=4)[0]
    assert (alone.readings == first[1].readings).all()
    assert (simulate(paper, seed=5)[0].readings != first[0].readings).any()


def test_a_spot_beside_its_detector_is_withheld_and_counted(tmp_path):
    motions = "motions: {far: {kind: sweep, from: {tz_mm: 0}, to: {tz_mm: 9}, samples: 10}}\n"
    segment = simulate(config(tmp_path, motions), ["far"])[0]
    beside = ~segment.reached.all(axis=1)
    assert beside.sum() == 3
    assert np.isnan(segment.readings[beside]).all()
    assert np.isnan(segment.solution.state[beside]).all()
    assert segment.solution.ok[~beside].all()
    assert statuses(segment) == {"converged": 7, "non finite": 3}
    assert axes(segment)[2].largest < 0.02


def test_a_motion_that_is_nowhere_on_the_detectors_has_no_errors(tmp_path):
    motions = "motions: {gone: {kind: sweep, from: {tz_mm: 9}, to: {tz_mm: 9.5}, samples: 3}}\n"
    segment = simulate(config(tmp_path, motions), ["gone"])[0]
    assert all(np.isnan([axis.largest, axis.rms]).all() for axis in axes(segment))


@pytest.mark.parametrize("beam", ["known", "prior"])
def test_a_moving_beam_can_be_known(tmp_path, beam):
    motions = (
        "motions: {m: {kind: sweep, from: {tx_mm: -3, bx_mm: -3}, to: {tx_mm: 3, bx_mm: 3}}}\n"
    )
    free = simulate(config(tmp_path, motions), ["m"])[0]
    told = simulate(
        config(tmp_path, motions + f"solve: {{beam: {beam}, beam_sigma_um: 0.1}}\n"), ["m"]
    )[0]
    assert told.solution.ok.all()
    assert axes(told)[0].rms < axes(free)[0].rms / 5
    scaled = told.error[:, 0] / told.solution.uncertainty[:, 0]
    assert np.sqrt((scaled**2).mean()) == pytest.approx(1, abs=4 / np.sqrt(2 * 401))


def test_motions_that_are_not_there_are_named():
    with pytest.raises(InputError, match="no motion jump; its motions: x-steps"):
        simulate(facets.load("paper"), ["jump"])


def test_tables_have_a_row_a_sample():
    segments = simulate(facets.load("paper"))
    for table in (reading_table(segments), pose_table(segments)):
        assert {len(column) for column in table.values()} == {1901}
    errors = pose_table(segments)["yaw_mrad"] - pose_table(segments)["true_yaw_mrad"]
    assert errors == pytest.approx(1e3 * np.concatenate([s.error[:, 5] for s in segments]))


def test_samples_whose_detector_is_saturated_are_counted():
    """A detector that its spot misses is not."""
    config = facets.load("bench")
    (segment,) = simulate(config, ["x-sweep"])
    exact = facets.readings(config.sensor, segment.truth)
    share = np.where(segment.reached, np.nan_to_num(fullness(config.sensor, exact)), 0.0)
    assert (segment.saturated >= (share > 1.02)).all()
    assert (segment.saturated <= (share > 0.98)).all()
    assert "samples without PSD A: it was saturated" in outcome(segment)
