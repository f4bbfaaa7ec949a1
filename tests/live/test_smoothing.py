"""Smoothed poses against motions that are known, and how well they are said to be known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from commands import command

import facets
from facets.detectors import readings_to_counts
from facets.live import (
    MODELS,
    Samples,
    dynamic_error,
    noise_covariance,
    pack,
    process_noise,
    smooth,
    transition,
)
from facets.live.run import smoothing as module

AXES = 2
NOISE = np.array([[1.0, 0.6], [0.6, 2.0]])  # of a sample, as neighbours' axes have it


def walk(rng, count, order, strength):
    """A motion drawn from the model itself: (count, AXES)."""
    move = transition(order, 1.0)
    root = np.linalg.cholesky(process_noise(order, 1.0) + 1e-12 * np.eye(order))
    state, found = np.zeros((AXES, order)), []
    for _ in range(count):
        state = state @ move.T + np.sqrt(strength) * rng.standard_normal((AXES, order)) @ root.T
        found.append(state[:, 0])
    return np.array(found)


def measured(rng, true):
    root = np.linalg.cholesky(NOISE)
    return true + rng.standard_normal(true.shape) @ root.T


@pytest.mark.parametrize(("model", "strength"), [("acceleration", 1e-7), ("speed", 1e-4)])
@pytest.mark.slow
def test_errors_are_as_large_as_is_said(model, strength):
    """The root mean square of error over uncertainty is 1 within 5 %, over 20,000 samples."""
    rng = np.random.default_rng(2)
    true = walk(rng, 20_000, MODELS[model], strength)
    poses = measured(rng, true)
    found = smooth(1e-3 * np.arange(20_000), poses, np.tile(NOISE, (20_000, 1, 1)), model)
    sigma = np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2))
    over = (found.states - true) / sigma
    assert np.sqrt(np.mean(over**2)) == pytest.approx(1, abs=0.05)
    assert found.squares == pytest.approx(1, abs=0.05)
    assert abs(found.memory) < 0.05
    better = np.sqrt(np.mean((poses - true) ** 2) / np.mean((found.states - true) ** 2))
    assert better > 2.5
    assert "do not" not in found.sentence


@pytest.mark.slow
def test_a_known_sine_is_found_far_better_than_a_sample_has_it():
    rng = np.random.default_rng(5)
    time = 1e-3 * np.arange(4_000)
    true = np.stack([50 * np.sin(2 * np.pi * time), 50 * np.cos(2 * np.pi * 0.7 * time)], axis=1)
    poses = measured(rng, true)
    poses[1_000:1_020] = np.nan  # a gap
    found = smooth(time, poses, np.tile(NOISE, (4_000, 1, 1)))
    sigma = np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2))
    error = found.states - true
    assert np.sqrt(np.mean((error / sigma) ** 2)) < 1.3
    assert error[~np.isnan(poses)].std() < 0.25 * (poses - true)[~np.isnan(poses)].std()
    assert np.abs(error[1_000:1_020] / sigma[1_000:1_020]).max() < 5
    assert sigma[1_010].max() > sigma[500].max()


def test_the_smoother_is_the_least_squares_solution():
    """Against the whole problem at once: prior, motion and samples as one system of equations."""
    rng = np.random.default_rng(9)
    count, order = 12, 2
    true = walk(rng, count, order, 0.3)
    poses = measured(rng, true)
    poses[4] = np.nan
    found = smooth(
        np.arange(count), poses, np.tile(NOISE, (count, 1, 1)), "speed", np.array([0.3, 0.2])
    )
    units = np.sqrt(np.diag(NOISE))
    seen, noise = poses / units, NOISE / np.outer(units, units)
    there = np.isfinite(seen).all(axis=1)
    wide = (3 * np.abs(np.diff(seen[there], axis=0)).max(axis=0) + 3) ** 2
    size = AXES * order
    information, right = np.zeros((count * size,) * 2), np.zeros(count * size)
    start = np.zeros(size)
    start[::order] = seen[0]
    prior = np.diag(np.repeat(1 / wide, order))
    information[:size, :size] += prior
    right[:size] += prior @ start
    move = np.kron(np.eye(AXES), transition(order, 1.0))
    shake = np.kron(np.diag([0.3, 0.2]), process_noise(order, 1.0))
    for n in range(1, count):
        both = np.hstack([-move, np.eye(size)])
        part = slice((n - 1) * size, (n + 1) * size)
        information[part, part] += both.T @ np.linalg.inv(shake) @ both
    for n in np.flatnonzero(there):
        place = n * size + np.arange(0, size, order)
        information[np.ix_(place, place)] += np.linalg.inv(noise)
        right[place] += np.linalg.inv(noise) @ seen[n]
    covariance = np.linalg.inv(information)
    states = (covariance @ right).reshape(count, size)[:, ::order] * units
    np.testing.assert_allclose(found.states, states, rtol=1e-7, atol=1e-9)
    for n in range(count):
        place = n * size + np.arange(0, size, order)
        expected = covariance[np.ix_(place, place)] * np.outer(units, units)
        np.testing.assert_allclose(found.covariance[n], expected, rtol=1e-7)


@pytest.mark.slow
def test_pieces_of_a_long_recording_fit_together(monkeypatch):
    rng = np.random.default_rng(4)
    poses = measured(rng, walk(rng, 1_500, 2, 1e-2))
    given = np.arange(1_500), poses, np.tile(NOISE, (1_500, 1, 1)), "speed", np.full(2, 1e-2)
    whole = smooth(*given)
    monkeypatch.setattr(module, "PIECE", 400)
    monkeypatch.setattr(module, "MARGIN", 150)
    parts = smooth(*given)
    # what is known of the speed before the first sample is taken from the piece
    np.testing.assert_allclose(parts.states, whole.states, atol=1e-3)
    np.testing.assert_allclose(parts.states[50:], whole.states[50:], atol=1e-6)
    np.testing.assert_allclose(parts.covariance, whole.covariance, rtol=1e-2)


def test_innovations_tell_a_wrong_noise():
    rng = np.random.default_rng(3)
    true = walk(rng, 2_000, 3, 1e-7)
    found = smooth(np.arange(2_000), measured(rng, true), np.tile(NOISE / 9, (2_000, 1, 1)),
                   strength=np.full(2, 1e-7))  # fmt: skip
    assert found.squares == pytest.approx(9, rel=0.2)
    assert "is wrong" in found.sentence


def test_too_few_poses_are_refused():
    with pytest.raises(ValueError, match="too few"):
        smooth(np.arange(5), np.zeros((5, 2)), np.tile(NOISE, (5, 1, 1)))


@pytest.mark.parametrize("beam", ["prior", "known"])
def test_noise_is_told_from_what_is_the_same_in_each_sample(beam):
    """The scatter of poses of noisy readings, beside the noise's part of their covariance."""
    config = facets.load("paper")
    config = replace(config, solve=replace(config.solve, beam=beam, beam_sigma=0.001))
    state = np.array([0.02, -0.03, 0.1, 1e-3, 2e-3, -1e-3, 0, 0])
    exact = np.tile(facets.readings(config.sensor, state), (4_000, 1))
    noisy = facets.add_noise(config.sensor, exact, np.random.default_rng(1))
    prior = facets.Prior(np.zeros((4_000, 2)), 0.001) if beam == "prior" else "known"
    power = facets.Prior(config.sensor.beam.power, 0.01 * config.sensor.beam.power)
    solution = facets.solve(config.sensor, noisy, beam=prior, power=power)
    assert solution.ok.all()
    noise = noise_covariance(config, solution, carried=False)
    scatter = np.cov(solution.state[:, :6].T)
    sigma = np.sqrt(np.diagonal(noise.mean(axis=0)))
    np.testing.assert_allclose(np.sqrt(np.diag(scatter)) / sigma, 1, atol=0.05)
    whole = solution.uncertainty[:, :6].mean(axis=0)
    assert (sigma <= 1.001 * whole).all()
    if beam == "prior":  # without the parting, x would be said to be better than it can be
        assert sigma[0] < 0.9 * whole[0]


@pytest.mark.parametrize(("beam", "power"), [("prior", "known"), ("known", "prior")])
def test_the_laser_s_jitter_is_noise(beam, power):
    """The scatter of poses where the beam's place and power change from sample to sample."""
    config, rng = facets.load("bench"), np.random.default_rng(3)
    electronics = replace(config.sensor.electronics, pointing=0.002, power_noise=2e-3)
    sensor = replace(config.sensor, electronics=electronics)
    options = replace(config.solve, beam=beam, beam_sigma=0.001, power=power, power_sigma=0.001)
    config = replace(config, sensor=sensor, solve=options)
    truth = np.tile([0.02, -0.03, 0.1, 1e-3, 2e-3, -1e-3, 0, 0], (4_000, 1))
    truth[:, 6:] += 0.002 * rng.standard_normal((4_000, 2))
    exact = facets.readings(sensor, truth)
    exact[:, 2::3] *= 1 + 2e-3 * rng.standard_normal((4_000, 1))
    known = options.knowledge(sensor)
    noisy = facets.add_noise(sensor, exact, rng)
    solution = facets.solve(sensor, noisy, beam=known.beam, power=known.power)
    assert solution.converged.all()
    noise = noise_covariance(config, solution, carried=False)
    sigma = np.sqrt(np.diagonal(noise.mean(axis=0)))
    np.testing.assert_allclose(solution.state[:, :6].std(axis=0) / sigma, 1, atol=0.05)


def test_what_the_bandwidth_holds_back_grows_with_the_speed():
    """Against a low pass of the first order, run on a ramp: its lag when it has settled."""
    config = facets.load("bench")
    bandwidth, speed, step = config.sensor.electronics.bandwidth, 7.0, 1e-6
    ramp = speed * step * np.arange(1_000)
    passed, share = np.zeros(1_000), 2 * np.pi * bandwidth * step
    for n in range(1, 1_000):
        passed[n] = passed[n - 1] + share * (ramp[n] - passed[n - 1])
    late = dynamic_error(config, step * np.arange(1_000), ramp[:, None])[-1, 0]
    assert late == pytest.approx(ramp[-1] - passed[-1], rel=0.05)
    assert dynamic_error(facets.load("paper"), np.arange(3.0), np.ones((3, 1))).max() == 0


def wobble(count):
    """The bytes of a mirror that yaws by 1 mrad, with the noise of the electronics; its yaw."""
    config = facets.load("bench")
    state = np.zeros((count, 8))
    state[:, 5] = 1e-3 * np.sin(np.arange(count) / 300)
    rng = np.random.default_rng(6)
    exact = facets.readings(config.sensor, state)
    counts = readings_to_counts(config.sensor, config.electronics, exact, rng)
    number = np.arange(count, dtype=np.uint32)
    kind = np.ones(count, np.uint8)
    return pack(Samples(kind, 0 * kind, number, 100 * number, counts)), 1e3 * state[:, 5]


@pytest.mark.slow
def test_a_replay_smooths_beside_the_raw_poses(tmp_path):
    data, true = wobble(1_500)
    (tmp_path / "board.bin").write_bytes(data)
    command(
        "acquire", "bench", "--port", "file:board.bin", "--folder", "rec", "--plain", cwd=tmp_path
    )
    result = command(
        "replay", "rec", "--smooth", "acceleration", "-o", "poses.parquet", cwd=tmp_path
    )
    assert result.returncode == 0, result.stderr
    assert "innovations: mean normalised square" in result.stdout
    assert "is wrong" not in result.stdout
    import pandas as pd

    table = pd.read_parquet(tmp_path / "poses.parquet")
    raw, found = table["yaw_mrad"] - true, table["smooth_yaw_mrad"] - true
    assert found.std() < 0.35 * raw.std()
    over = found / table["u_smooth_yaw_mrad"]
    assert np.sqrt(np.mean(over**2)) < 1.3
    assert table["u_dynamic_yaw_mrad"].max() == pytest.approx(
        1 / 0.03 / (2 * np.pi * 5000), rel=0.05
    )
    assert (table["u_smooth_yaw_mrad"] < 0.5 * table["u_yaw_mrad"]).all()
    bad = command("replay", "rec", "--smooth", "speed", cwd=tmp_path)
    assert bad.returncode == 2
    assert "--smooth needs -o" in bad.stderr
