"""The measured object in a stream: its poses and displacements, in all that samples go to."""

from __future__ import annotations

import asyncio
from dataclasses import replace

import numpy as np
import pytest
from streams import BENCH, CALIBRATED, samples_of, subscribe

import facets
from facets import MeasuredObject
from facets.core import STATE_COLUMNS, STATE_UNITS
from facets.estimation import PoseColumns, ZeroRequest
from facets.live import (
    SIZE,
    Live,
    Pipeline,
    Publications,
    join_poses,
    pack,
    recorded_config,
    recorded_poses,
    rows_of,
)

OBJECT = MeasuredObject(point=(10.0, -20.0, 50.0), orientation=(0.1, -0.2, 1.5))
WITH_OBJECT = replace(BENCH, object=OBJECT)
WITH_ALL = replace(CALIBRATED, object=OBJECT)
COUNT, STILL = 1_500, 500
POSE = STATE_COLUMNS[:6]


def make_states():
    """A mirror that stands still and then moves in three axes."""
    states = np.zeros((COUNT, 8))
    phase = np.maximum(np.arange(COUNT) - STILL, 0) / 150
    states[:, 5], states[:, 2] = 1e-3 * np.sin(phase), 0.2 * np.sin(phase / 2)
    states[:, 0] = 0.05 * np.sin(phase / 3)
    return states


STATES = make_states()
DATA = pack(samples_of(facets.readings(BENCH.sensor, STATES), np.random.default_rng(8)))


def solve(config, zero=None, covariance=False, count=COUNT):
    pipeline = Pipeline(config, PoseColumns(zero, covariance))
    size = 200 * SIZE
    parts = [pipeline.feed(DATA[n : n + size], 1.0 + n) for n in range(0, count * SIZE, size)]
    return pipeline, join_poses(parts)


def pose_of(columns, prefix):
    """Six columns in mm and rad."""
    return np.column_stack([columns[f"{prefix}{name}"] for name in POSE]) * STATE_UNITS[:6]


def rms_error(columns, prefix, zero=None, first=0):
    """Root mean square (6,) of errors over stated uncertainties, from a sample on."""
    true = facets.transform(STATES, OBJECT, zero).pose
    ratio = (pose_of(columns, prefix) - true) / pose_of(columns, f"u_{prefix}")
    return np.sqrt(np.mean(ratio[first:] ** 2, axis=0))


def test_objects_and_their_displacements_after_the_zero_err_as_stated():
    request = ZeroRequest(seconds=0.04)
    pipeline, poses = solve(WITH_OBJECT, request, covariance=True)
    np.testing.assert_array_equal(poses.solution.state, solve(BENCH)[1].solution.state)
    assert rms_error(poses.object, "object_") == pytest.approx(1, abs=0.15)
    moved = pose_of(poses.object, "displacement_")
    first = int(np.argmax(np.isfinite(moved[:, 0])))
    assert 400 <= first <= 600  # the batch that holds the first sample after the zero
    assert np.isnan(moved[:first]).all()
    assert pipeline.measurement.zero.samples == 400
    ratio = rms_error(poses.object, "displacement_", STATES[0], first)
    assert ratio == pytest.approx(1, abs=0.15)
    variance = poses.object["u_displacement_yaw_mrad"] ** 2
    np.testing.assert_allclose(poses.object["cov_displacement_yaw_yaw_mrad2"], variance, rtol=1e-12)
    assert tuple(poses.columns())[-len(poses.object) :] == pipeline.measurement.object_names


def test_a_zero_waits_for_light_and_says_that_the_mirror_moves():
    pipeline = Pipeline(WITH_OBJECT, PoseColumns(ZeroRequest(seconds=0.05)))
    live = Live(pipeline, begin=np.inf)  # no run, which could be silent
    batch = pipeline.take(DATA[STILL * SIZE : (STILL + 100) * SIZE], 1.0)[0]
    pipeline.solve(replace(batch, aligned=np.full_like(batch.readings, np.nan)))
    for first, words in (
        (100, "waits for a pose"),
        (300, "keep the mirror still"),
        (1_000, "The mirror moved while the zero was measured"),
    ):
        pipeline.feed(DATA[(STILL + max(first - 500, 100)) * SIZE : (STILL + first) * SIZE], 2.0)
        assert words in live.messages()[0]
    assert any("The mirror moved" in text for text in pipeline.measurement.sentences())


def test_subscribers_are_told_of_the_object():
    pipeline, poses = solve(WITH_ALL, ZeroRequest(row=1), count=600)
    assert np.abs(pose_of(poses.object, "displacement_")[0]).max() < 1e-15  # of the zero itself
    u = pose_of(poses.object, "u_displacement_")
    assert u[0].max() < 1e-9
    assert u[1].min() > 1e-8
    publications = Publications(["zmq://127.0.0.1:0"], WITH_ALL, True, 5.0, pipeline.measurement)
    with publications:
        (subscription,) = subscribe(publications)
        with subscription:
            publications.add_poses(poses)
            rows = next(iter(subscription))
    assert rows.tobytes() == rows_of(poses, 5.0)[: len(rows)].tobytes()
    for name, column in poses.object.items():
        np.testing.assert_array_equal(rows[name], column[: len(rows)])
    about = subscription.about
    assert about["object"]["point_mm"] == [10.0, -20.0, 50.0]
    assert np.radians(about["object"]["orientation_deg"]) == pytest.approx(OBJECT.orientation)
    assert about["zero"] == "row 1"


def test_bluesky_is_told_of_the_object():
    pytest.importorskip("bluesky")
    pytest.importorskip("ophyd_async")
    from facets.live import PoseSensor

    sensor = PoseSensor(WITH_OBJECT, "zmq://127.0.0.1:9", name="sensor")
    assert sensor.hints == {"fields": [f"sensor-object_{name}" for name in POSE]}
    assert asyncio.run(sensor.describe())["sensor-u_object_tx_mm"]["units"] == "mm"
    parts = PoseSensor(WITH_ALL, "zmq://127.0.0.1:9", name="sensor")
    assert asyncio.run(parts.describe())["sensor-u_calibration_object_tx_mm"]["units"] == "mm"
    assert asyncio.run(parts.describe())["sensor-u_noise_tx_mm"]["units"] == "mm"
    assert asyncio.run(sensor.read_configuration())["sensor-object"]["value"] == OBJECT.text


def test_a_recording_keeps_its_point_and_is_replayed_for_others(run_in_process, tmp_path):
    import pandas as pd

    (tmp_path / "board.bin").write_bytes(DATA)
    _, output, errors = run_in_process(
        "acquire", "bench", "--port", "file:board.bin", "--folder", "rec", "--plain",
        "--point", "10,-20,50", "--zero", "0.04s", "--covariance",
    )  # fmt: skip
    assert "zero: the first 0.04 s, 400 samples" in output, errors
    folder = tmp_path / "rec"
    assert recorded_config(folder).object == MeasuredObject(point=(10.0, -20.0, 50.0))
    old = recorded_poses(folder)
    assert {"object_tx_mm", "displacement_yaw_mrad", "cov_displacement_tx_tx_mm2"} <= old.keys()
    assert np.isfinite(old["displacement_tx_mm"]).any()
    status, _, errors = run_in_process("replay", "rec", "-o", "t.csv", "--zero", "9s")
    assert status == 2
    assert "rec: no displacements: --zero is the first 9 s" in errors
    assert not (tmp_path / "t.csv").exists()
    assert run_in_process("replay", "rec", "-o", "t.csv", "--point", "0,0,50")[0] == 0
    tip = facets.transform(STATES, MeasuredObject(point=(0.0, 0.0, 50.0))).pose
    heights = pd.read_csv(tmp_path / "t.csv", comment="#")["object_tz_mm"]
    np.testing.assert_allclose(heights, tip[:, 2], atol=0.01)
