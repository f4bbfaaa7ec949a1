"""Filtered poses against motions that are known, and against the smoother's last estimate."""

from __future__ import annotations

import json
from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
from commands import command

import facets
from facets.detectors.counts import readings_to_counts
from facets.live import Subscription, smooth
from facets.live.run import filtering as module
from facets.live.run.filtering import Filter, PoseFilter
from facets.live.run.pipeline import Pipeline
from facets.live.run.smoothing import MODELS, process_noise, transition
from facets.live.sources.frames import Samples, pack
from facets.live.streams.filtered_rows import FILTERED, WIDE, RowFilter
from facets.live.streams.json_rows import json_of
from facets.live.streams.publication import Publications
from facets.live.streams.sample_rows import SAMPLE, rows_of

AXES = 2
NOISE = np.array([[1.0, 0.6], [0.6, 2.0]])


def walk(rng, count, order, strength):
    """A motion drawn from the model itself, in the unit of each axis's noise: (count, AXES)."""
    move, root = transition(order, 1.0), np.linalg.cholesky(process_noise(order, 1.0))
    state, found = np.zeros((AXES, order)), []
    for _ in range(count):
        state = state @ move.T + np.sqrt(strength) * rng.standard_normal((AXES, order)) @ root.T
        found.append(state[:, 0])
    return np.array(found) * np.sqrt(NOISE.diagonal())


def measured(rng, true):
    return true + rng.standard_normal(true.shape) @ np.linalg.cholesky(NOISE).T


def filtered(one, time, poses, noise=NOISE, lot=50):
    parts = [
        one.add(time[n : n + lot], poses[n : n + lot], noise) for n in range(0, len(time), lot)
    ]
    return tuple(np.concatenate([getattr(part, name) for part in parts])
                 for name in ("places", "speeds", "variance"))  # fmt: skip


@pytest.mark.parametrize("model", list(MODELS))
def test_the_last_estimate_is_that_of_the_smoother(model):
    """Samples until then, no others: a smoother of these alone says the same of the last one."""
    rng = np.random.default_rng(1)
    poses = measured(rng, walk(rng, 60, MODELS[model], 1e-3))
    poses[20:23] = np.nan
    time, strength = 1e-3 * np.arange(60), np.full(AXES, 1e-3)
    one = Filter(model, strength)
    places, _, variance = filtered(one, time, poses, lot=60)
    assert np.isfinite(places).all()
    assert (variance[22] > variance[19]).all()
    for count in (19, 22, 41, 60):
        part = np.tile(NOISE, (count, 1, 1))
        # what is thought of the first speed comes from all samples of the lot
        known = Filter(model, strength)
        found = known.add(time[:count], poses[:count], NOISE)
        expected = smooth(time[:count], poses[:count], part, model, strength)
        np.testing.assert_allclose(found.places[-1], expected.states[-1], rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(
            found.variance[-1], expected.covariance[-1].diagonal(), rtol=1e-6
        )


@pytest.mark.parametrize(("model", "strength"), [("acceleration", 1e-7), ("speed", 1e-4)])
def test_errors_are_as_large_as_is_said(model, strength):
    """Learnt from the first samples; the root mean square of error over uncertainty is 1."""
    rng = np.random.default_rng(3)
    true = walk(rng, 12_000, MODELS[model], strength)
    poses = measured(rng, true)
    one = Filter(model)
    places, _, variance = filtered(one, 1e-3 * np.arange(12_000), poses)
    there = np.isfinite(places).all(axis=1)
    assert not there[: module.LEARNT_FROM].any()
    assert there.mean() > 0.8
    over = ((places - true) / np.sqrt(variance))[there]
    assert np.sqrt(np.mean(over**2)) == pytest.approx(1, abs=0.1)
    better = np.std((poses - true)[there]) / np.std((places - true)[there])
    assert better > 1.7
    assert one.learnt == 1
    assert one.sentence().startswith("the filter follows half of a sudden step after")


def test_a_gain_that_has_settled_is_that_of_each_sample(monkeypatch):
    rng = np.random.default_rng(4)
    poses = measured(rng, walk(rng, 3_000, 2, 1e-2))
    time = 1e-3 * np.arange(3_000)
    quick = Filter("speed", np.full(AXES, 1e-2))
    found = filtered(quick, time, poses)
    assert quick.settled
    monkeypatch.setattr(module, "SETTLED", -1.0)
    slow = Filter("speed", np.full(AXES, 1e-2))
    expected = filtered(slow, time, poses)
    assert not slow.settled
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-3, atol=1e-3)


def test_a_mirror_that_begins_to_move_is_told_within_the_noise_of_a_sample():
    """Learnt from a mirror at rest, then it moves: raw poses only, until that is learnt."""
    rng = np.random.default_rng(5)
    time = 1e-3 * np.arange(9_000)
    true = np.zeros((9_000, AXES))
    moving = slice(4_000, None)
    true[moving] = 40 * np.sin(2 * np.pi * 3 * (time[moving] - 4.0))[:, None]
    places, _, variance = filtered(Filter("acceleration"), time, measured(rng, true), lot=20)
    there = np.isfinite(places).all(axis=1)
    assert there[2_100:4_000].all()
    assert not there[4_000:4_300].all()
    assert there[-2_000:].mean() > 0.9
    off = np.abs(places - true)[there]
    over = off / np.sqrt(variance[there])
    # before a motion is out of the noise nothing can tell it
    assert (over > 8).any(axis=1).sum() < 30
    assert (off / np.sqrt(NOISE.diagonal())).max() < 5
    assert np.sqrt(np.mean(over[-2_000:] ** 2)) < 2


def test_the_stated_delay_is_that_of_a_step():
    """Half of a sudden step, looked for in what the filter gives."""
    one = Filter("speed", np.full(AXES, 1e-5))
    time, poses = 1e-3 * np.arange(3_000), np.zeros((3_000, AXES))
    filtered(one, time, poses)
    _, sudden = one.delays()
    half = []
    for n in range(AXES):
        once = deepcopy(one)
        later = once.add(3.0 + 1e-3 * np.arange(200), np.tile(np.eye(AXES)[n], (200, 1)), NOISE)
        half.append(np.argmax(later.places[:, n] >= 0.5))
    assert max(half) == pytest.approx(1e3 * sudden, abs=1)
    assert "steady" not in one.sentence()
    late = []
    for axis in np.eye(AXES):
        still = Filter("place", np.full(AXES, 1e-3))
        places, *_ = filtered(still, time, 7.0 * time[:, None] * axis)
        late.append((7.0 * time[-1] - places[-1]) @ axis / 7.0)
    steady, _ = still.delays()
    assert steady == pytest.approx(max(late), rel=0.02)


def board(count, moved=1e-3):
    config = facets.load("bench")
    state = np.zeros((count, 8))
    state[:, 5] = moved * np.sin(np.arange(count) / 300)
    rng = np.random.default_rng(6)
    counts = readings_to_counts(
        config.sensor, config.electronics, facets.readings(config.sensor, state), rng
    )
    number = np.arange(count, dtype=np.uint32)
    kind = np.ones(count, np.uint8)
    return pack(Samples(kind, 0 * kind, number, 100 * number, counts)), 1e3 * state[:, 5]


def test_the_uncertainty_holds_what_the_bandwidth_holds_back():
    config = facets.load("bench")
    electronics = config.sensor.electronics
    slow = replace(config.sensor, electronics=replace(electronics, bandwidth=50.0))
    assert PoseFilter(config).late == pytest.approx(1 / (2 * np.pi * electronics.bandwidth))
    assert PoseFilter(facets.load("paper")).late == 0
    data, true = board(4_000)
    rows = np.concatenate([rows_of(part, 0.0) for part in solved(config, data)])
    one = RowFilter(config, "acceleration")
    one.filter.late = PoseFilter(replace(config, sensor=slow)).late  # and the noise as it is
    found = np.concatenate([one.widen(rows[n : n + 100]) for n in range(0, 4_000, 100)])
    expected = np.abs(np.gradient(true, 1e-4)) / (2 * np.pi * 50.0)
    late = slice(3_000, None)  # when the strength has been learnt
    np.testing.assert_allclose(
        found["u_filtered_yaw_mrad"][late], expected[late], atol=0.1 * expected.max()
    )


def solved(config, data):
    pipeline = Pipeline(config)
    return [pipeline.solve(b) for b in pipeline.take(data, 1_000.0)]


@pytest.mark.slow
def test_a_publication_has_filtered_poses_beside_the_raw_ones():
    config = facets.load("bench")
    parts = solved(config, board(3_000, moved=1e-4)[0])
    rows = []
    with (
        Publications(["zmq://127.0.0.1:0"], config, True, filter_by="acceleration") as all_,
        Subscription(all_.places()[0]) as samples,
    ):
        for part in parts:
            all_.add_poses(part)
        for some in samples:
            rows.append(some)
            if sum(map(len, rows)) == 3_000:
                break
    rows = np.concatenate(rows)
    assert rows.dtype == WIDE
    raw = np.concatenate([rows_of(part, all_.offset) for part in parts])
    for name in SAMPLE.names:
        np.testing.assert_array_equal(rows[name], raw[name])
    assert np.isfinite(rows["filtered_yaw_mrad"][2_200:]).all()
    assert (rows["u_filtered_yaw_mrad"] < rows["u_yaw_mrad"])[2_200:].all()
    assert any("follows half of a sudden step" in text for text in all_.sentences())


def test_json_has_filtered_poses_where_there_are_any():
    rows = np.ones(2, WIDE)
    rows["filtered_tx_mm"][0] = np.nan
    first, second = (json.loads(text) for text in json_of(rows))
    assert "tx_mm" not in first["filtered"]
    assert first["u_filtered"]["u_tx_mm"] == second["filtered"]["tx_mm"] == 1
    assert "filtered" not in json.loads(json_of(np.ones(1, SAMPLE))[0])


@pytest.mark.slow
def test_a_replay_filters_as_a_live_run(tmp_path):
    data, true = board(4_000)
    (tmp_path / "board.bin").write_bytes(data)
    command(
        "acquire", "bench", "--port", "file:board.bin", "--folder", "rec", "--plain", cwd=tmp_path
    )
    result = command("replay", "rec", "--filter", "acceleration", "-o", "p.parquet", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "follows half of a sudden step after" in result.stdout
    import pandas as pd

    table = pd.read_parquet(tmp_path / "p.parquet")
    late = table[2_500:]
    error = late["filtered_yaw_mrad"] - true[2_500:]
    assert np.isfinite(late[FILTERED[0]]).all()
    assert error.std() < 0.6 * (late["yaw_mrad"] - true[2_500:]).std()
    assert np.sqrt(np.mean((error / late["u_filtered_yaw_mrad"]) ** 2)) < 1.3
    for words, told in (
        (("replay", "rec", "--filter", "speed"), "--filter needs -o"),
        (("replay", "rec", "--filter", "fast", "-o", "q.csv"), "unknown model"),
        (("acquire", "bench", "--filter", "speed"), "--filter needs --publish"),
    ):
        bad = command(*words, cwd=tmp_path)
        assert bad.returncode == 2
        assert told in bad.stderr
