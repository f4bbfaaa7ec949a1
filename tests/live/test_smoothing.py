"""Smoothed poses against motions that are known, and how well they are said to be known."""

from __future__ import annotations

import inspect
from dataclasses import replace

import numpy as np
import pytest
from streams import BENCH, samples_of, yawing

import facets
from facets.live import (
    MODELS,
    noise_covariance,
    pack,
    process_noise,
    smooth,
    transition,
)

AXES = 2
NOISE = np.array([[1.0, 0.6], [0.6, 2.0]])  # of a sample, as neighbours' axes have it


def walk(rng, count, order, strength):
    """A motion drawn from the model itself: (count, AXES)."""
    move = transition(order, 1.0)
    root = np.linalg.cholesky(process_noise(order, 1.0) + 1e-12 * np.eye(order))
    state, places = np.zeros((AXES, order)), []
    for _ in range(count):
        state = state @ move.T + np.sqrt(strength) * rng.standard_normal((AXES, order)) @ root.T
        places.append(state[:, 0])
    return np.array(places)


def measure(rng, true):
    return true + rng.standard_normal(true.shape) @ np.linalg.cholesky(NOISE).T


def noise_of(poses):
    return np.tile(NOISE, (len(poses), 1, 1))


@pytest.mark.parametrize("model", MODELS)
def test_the_smoother_is_the_least_squares_solution(model):
    """Against the whole problem at once: prior, motion and samples as one system of equations."""
    rng, strength, count, order = np.random.default_rng(9), [0.3, 0.2], 12, MODELS[model]
    poses = measure(rng, walk(rng, count, order, 0.3))
    poses[4] = np.nan
    smoothed = smooth(np.arange(count), poses, noise_of(poses), model, np.array(strength))
    units = np.sqrt(np.diag(NOISE))
    scaled = poses / units
    steps = np.abs(np.diff(np.delete(scaled, 4, axis=0), axis=0)).max(axis=0)
    # the first state, and what each later one has beside the motion of the one before it
    move = np.kron(np.eye(AXES), transition(order, 1.0))
    motion = np.eye(count * len(move)) - np.kron(np.eye(count, k=-1), move)
    shake = np.kron(np.diag(strength), process_noise(order, 1.0))
    weight = np.kron(np.eye(count), np.linalg.inv(shake))
    prior = slice(0, len(move))
    weight[prior, prior] = np.diag(np.repeat((3 * steps + 3) ** -2, order))
    at_rest = np.zeros(len(weight))
    at_rest[prior][::order] = scaled[0]
    known = np.isfinite(scaled.ravel())
    place = np.eye(len(weight))[::order][known]
    precision = np.kron(np.eye(count - 1), np.linalg.inv(NOISE / np.outer(units, units)))
    covariance = np.linalg.inv(motion.T @ weight @ motion + place.T @ precision @ place)
    right = motion.T @ weight @ at_rest + place.T @ precision @ scaled.ravel()[known]
    states = (covariance @ right)[::order].reshape(count, AXES) * units
    np.testing.assert_allclose(smoothed.states, states, rtol=1e-7, atol=1e-9)
    covariance = covariance[::order, ::order].reshape(count, AXES, count, AXES)
    each = np.arange(count)
    expected = covariance[each, :, each] * np.outer(units, units)
    np.testing.assert_allclose(smoothed.covariance, expected, rtol=1e-7)


def test_pieces_of_a_long_recording_fit_together(monkeypatch):
    rng = np.random.default_rng(4)
    poses = measure(rng, walk(rng, 1_500, 2, 1e-2))
    arguments = np.arange(1_500), poses, noise_of(poses), "speed", np.full(2, 1e-2)
    whole = smooth(*arguments)
    module = inspect.getmodule(smooth)
    monkeypatch.setattr(module, "PIECE", 400)
    monkeypatch.setattr(module, "MARGIN", 150)
    parts = smooth(*arguments)
    # what is known of the speed before the first sample is taken from the piece
    np.testing.assert_allclose(parts.states, whole.states, atol=1e-3)
    np.testing.assert_allclose(parts.states[50:], whole.states[50:], atol=1e-6)
    np.testing.assert_allclose(parts.covariance, whole.covariance, rtol=1e-2)


def test_innovations_tell_a_wrong_noise():
    rng = np.random.default_rng(3)
    poses = measure(rng, walk(rng, 2_000, 3, 1e-7))
    smoothed = smooth(np.arange(2_000), poses, noise_of(poses) / 9, strength=np.full(2, 1e-7))
    assert smoothed.squares == pytest.approx(9, rel=0.2)
    assert "is wrong" in smoothed.sentence


def test_too_few_poses_are_refused():
    with pytest.raises(ValueError, match="too few"):
        smooth(np.arange(5), np.zeros((5, 2)), np.tile(NOISE, (5, 1, 1)))


@pytest.mark.parametrize(
    ("name", "beam", "power", "jitter"),
    [("paper", "prior", "prior", 0.0), ("bench", "prior", "known", 0.002),
     ("bench", "known", "prior", 0.002)],
)  # fmt: skip
def test_noise_is_told_from_what_is_the_same_in_each_sample(name, beam, power, jitter):
    """The scatter of poses of noisy readings, beside the noise's part of their covariance; the
    jitter of the laser in place and power is noise."""
    rng, config = np.random.default_rng(1), facets.load(name)
    sensor, options = config.sensor, config.solve
    if jitter:
        electronics = replace(sensor.electronics, pointing=jitter, power_noise=jitter)
        sensor = replace(sensor, electronics=electronics)
    options = replace(options, beam=beam, beam_sigma=0.001, power=power, power_sigma=0.01)
    truth = np.tile([0.02, -0.03, 0.1, 1e-3, 2e-3, -1e-3, 0, 0], (4_000, 1))
    truth[:, 6:] += jitter * rng.standard_normal((4_000, 2))
    readings = facets.readings(sensor, truth)
    readings[:, 2::3] *= 1 + jitter * rng.standard_normal((4_000, 1))
    noisy, known = facets.add_noise(sensor, readings, rng), options.knowledge(sensor)
    solution = facets.solve(sensor, noisy, beam=known.beam, power=known.power)
    assert solution.converged.all()
    noise = noise_covariance(replace(config, sensor=sensor, solve=options), solution, carried=False)
    sigma = np.sqrt(np.diagonal(noise.mean(axis=0)))
    np.testing.assert_allclose(solution.state[:, :6].std(axis=0) / sigma, 1, atol=0.05)
    whole = solution.uncertainty[:, :6].mean(axis=0)
    assert (sigma <= 1.001 * whole).all()
    # without the parting, x would be said to be too good
    assert name != "paper" or sigma[0] < 0.9 * whole[0]


def test_a_replay_smooths_beside_the_raw_poses(run_in_process, tmp_path):
    import pandas as pd

    states = yawing(1_500, samples_per_radian=300)
    readings = facets.readings(BENCH.sensor, states)
    (tmp_path / "board.bin").write_bytes(pack(samples_of(readings, np.random.default_rng(6))))
    run_in_process("acquire", "bench", "--port", "file:board.bin", "-d", "rec", "--plain")
    assert "--smooth needs -o" in run_in_process("replay", "rec", "--smooth", "speed")[2]
    status, output, errors = run_in_process(
        "replay", "rec", "--smooth", "acceleration", "-o", "p.csv"
    )
    assert status == 0, errors
    assert "is wrong" not in output
    table = pd.read_csv(tmp_path / "p.csv", comment="#")
    raw, error = (table[name] - 1e3 * states[:, 5] for name in ("yaw_mrad", "smooth_yaw_mrad"))
    assert error.std() < 0.35 * raw.std()
    assert np.sqrt(np.mean((error / table["u_smooth_yaw_mrad"]) ** 2)) < 1.3
    lag = 1 / 0.03 / (2 * np.pi * 5000)
    assert table["u_dynamic_yaw_mrad"].max() == pytest.approx(lag, rel=0.05)
    assert (table["u_smooth_yaw_mrad"] < 0.5 * table["u_yaw_mrad"]).all()
