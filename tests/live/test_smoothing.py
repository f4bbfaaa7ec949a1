"""Smoothed poses against motions that are known, and how well they are said to be known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from streams import BENCH, samples_of, yawing

import facets
from facets.live import (
    MODELS,
    dynamic_error,
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
    rng = np.random.default_rng(9)
    count, order, strength = 12, MODELS[model], np.array([0.3, 0.2])
    poses = measure(rng, walk(rng, count, order, 0.3))
    poses[4] = np.nan
    smoothed = smooth(np.arange(count), poses, noise_of(poses), model, strength)
    units = np.sqrt(np.diag(NOISE))
    seen, weight = poses / units, np.linalg.inv(NOISE / np.outer(units, units))
    there = np.isfinite(seen).all(axis=1)
    size = AXES * order
    wide = (3 * np.abs(np.diff(seen[there], axis=0)).max(axis=0) + 3) ** 2
    information, right = np.zeros((count * size,) * 2), np.zeros(count * size)
    information[:size, :size] = np.diag(np.repeat(1 / wide, order))
    right[:size:order] = seen[0] / wide
    move = np.kron(np.eye(AXES), transition(order, 1.0))
    shake = np.kron(np.diag(strength), process_noise(order, 1.0))
    both = np.hstack([-move, np.eye(size)])
    for n in range(1, count):
        part = slice((n - 1) * size, (n + 1) * size)
        information[part, part] += both.T @ np.linalg.inv(shake) @ both
    places = [n * size + np.arange(0, size, order) for n in range(count)]
    for n in np.flatnonzero(there):
        information[np.ix_(places[n], places[n])] += weight
        right[places[n]] += weight @ seen[n]
    covariance = np.linalg.inv(information)
    for n, place in enumerate(places):
        state = (covariance @ right)[place] * units
        np.testing.assert_allclose(smoothed.states[n], state, rtol=1e-7, atol=1e-9)
        expected = covariance[np.ix_(place, place)] * np.outer(units, units)
        np.testing.assert_allclose(smoothed.covariance[n], expected, rtol=1e-7)


def test_pieces_of_a_long_recording_fit_together(monkeypatch):
    rng = np.random.default_rng(4)
    poses = measure(rng, walk(rng, 1_500, 2, 1e-2))
    arguments = np.arange(1_500), poses, noise_of(poses), "speed", np.full(2, 1e-2)
    whole = smooth(*arguments)
    monkeypatch.setattr("facets.live.run.smoothing.PIECE", 400)
    monkeypatch.setattr("facets.live.run.smoothing.MARGIN", 150)
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
    ("name", "beam", "power"),
    [
        ("paper", "prior", "prior"),
        ("bench", "prior", "known"),
        ("bench", "known", "prior"),
    ],
)
def test_noise_is_told_from_what_is_the_same_in_each_sample(name, beam, power):
    """The scatter of poses of noisy readings, beside the noise's part of their covariance; the
    jitter of the bench's laser in place and power is noise."""
    rng, config = np.random.default_rng(1), facets.load(name)
    jitter, flicker = (0.002, 2e-3) if name == "bench" else (0.0, 0.0)
    sensor = config.sensor
    if jitter:
        electronics = replace(sensor.electronics, pointing=jitter, power_noise=flicker)
        sensor = replace(sensor, electronics=electronics)
    options = replace(config.solve, beam=beam, beam_sigma=0.001, power=power, power_sigma=0.01)
    truth = np.tile([0.02, -0.03, 0.1, 1e-3, 2e-3, -1e-3, 0, 0], (4_000, 1))
    truth[:, 6:] += jitter * rng.standard_normal((4_000, 2))
    exact = facets.readings(sensor, truth)
    exact[:, 2::3] *= 1 + flicker * rng.standard_normal((4_000, 1))
    noisy, known = facets.add_noise(sensor, exact, rng), options.knowledge(sensor)
    solution = facets.solve(sensor, noisy, beam=known.beam, power=known.power)
    assert solution.converged.all()
    noise = noise_covariance(replace(config, sensor=sensor, solve=options), solution, carried=False)
    sigma = np.sqrt(np.diagonal(noise.mean(axis=0)))
    np.testing.assert_allclose(solution.state[:, :6].std(axis=0) / sigma, 1, atol=0.05)
    whole = solution.uncertainty[:, :6].mean(axis=0)
    assert (sigma <= 1.001 * whole).all()
    if beam == "prior" and not jitter:  # without the parting, x would be said to be too good
        assert sigma[0] < 0.9 * whole[0]


def test_what_the_bandwidth_holds_back_grows_with_the_speed():
    """Against a low pass of the first order, run on a ramp: its lag when it has settled."""
    bandwidth, speed, step = BENCH.sensor.electronics.bandwidth, 7.0, 1e-6
    ramp = speed * step * np.arange(1_000)
    passed, share = np.zeros(1_000), 2 * np.pi * bandwidth * step
    for n in range(1, 1_000):
        passed[n] = passed[n - 1] + share * (ramp[n] - passed[n - 1])
    late = dynamic_error(BENCH, step * np.arange(1_000), ramp[:, None])[-1, 0]
    assert late == pytest.approx(ramp[-1] - passed[-1], rel=0.05)
    assert dynamic_error(facets.load("paper"), np.arange(3.0), np.ones((3, 1))).max() == 0


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
    assert "innovations: mean normalised square" in output
    assert "is wrong" not in output
    table = pd.read_csv(tmp_path / "p.csv", comment="#")
    raw, error = (table[name] - 1e3 * states[:, 5] for name in ("yaw_mrad", "smooth_yaw_mrad"))
    assert error.std() < 0.35 * raw.std()
    assert np.sqrt(np.mean((error / table["u_smooth_yaw_mrad"]) ** 2)) < 1.3
    lag = 1 / 0.03 / (2 * np.pi * 5000)
    assert table["u_dynamic_yaw_mrad"].max() == pytest.approx(lag, rel=0.05)
    assert (table["u_smooth_yaw_mrad"] < 0.5 * table["u_yaw_mrad"]).all()
