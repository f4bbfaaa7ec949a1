"""The measured object in a stream: its poses beside SciPy's, in all that samples go to."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from commands import command
from scipy.spatial.transform import Rotation

import facets
from facets import MeasuredObject
from facets.core import STATE_COLUMNS, STATE_UNITS, FacetsError
from facets.detectors import readings_to_counts
from facets.estimation import ZeroRequest
from facets.live import (
    SAMPLE,
    SIZE,
    Live,
    Pipeline,
    Playback,
    Publications,
    Samples,
    Screen,
    compare,
    description,
    join_poses,
    pack,
    pose_columns,
    recorded_config,
    recorded_poses,
    row_content,
    rows_of,
    sample_dtype,
    smoothed_columns,
    values,
)
from facets.live.streams.json_rows import json_of
from facets.live.streams.row_stream import kept_dtype, same_columns
from facets.live.streams.subscription import Subscription
from facets.live.web.hub import Hub

BENCH = facets.load("bench")
OBJECT = MeasuredObject(point=(10.0, -20.0, 50.0), orientation=(0.1, -0.2, 1.5))
WITH_OBJECT = replace(BENCH, object=OBJECT)
COUNT, STILL, PERIOD_S = 3_000, 1_000, 1e-4


def motion(count=COUNT):
    """States of a mirror that stands still and then moves in three axes."""
    state = np.zeros((count, 8))
    phase = np.maximum(np.arange(count) - STILL, 0) / 300
    state[:, 5], state[:, 2] = 1e-3 * np.sin(phase), 0.2 * np.sin(phase / 2)
    state[:, 0] = 0.05 * np.sin(phase / 3)
    return state


def board(state):
    """The bytes of a board that sees these states, with noise."""
    rng, electronics = np.random.default_rng(8), BENCH.electronics
    readings = facets.readings(BENCH.sensor, state)
    counts = readings_to_counts(BENCH.sensor, electronics, readings, rng)
    number = np.arange(len(state), dtype=np.uint32)
    kind = np.ones(len(state), np.uint8)
    return pack(Samples(kind, 0 * kind, number, round(1e6 * PERIOD_S) * number, counts))


STATE = motion()
DATA = board(STATE)


def solve(config, zero=None, covariance=False, data=DATA):
    pipeline = Pipeline(config, zero, covariance)
    size = 200 * SIZE
    parts = [pipeline.feed(data[n : n + size], 1.0 + n) for n in range(0, len(data), size)]
    return pipeline, join_poses(parts)


def numbers(columns, prefix):
    """Six columns in mm and rad."""
    names = [f"{prefix}{name}" for name in STATE_COLUMNS[:6]]
    return np.column_stack([columns[name] for name in names]) * STATE_UNITS[:6]


def truth(state):
    """Places (n, 3) and rotations of the object, by SciPy."""
    turn = Rotation.from_euler("ZYX", state[:, 5:2:-1])
    own = Rotation.from_euler("ZYX", OBJECT.orientation[::-1])
    return state[:, :3] + turn.apply(OBJECT.point), turn * own


def errors(columns, prefix, places, turns):
    """Errors over stated uncertainties: (n, 6)."""
    found, angles = numbers(columns, prefix), turns.as_euler("ZYX")[:, ::-1]
    return (found - np.column_stack([places, angles])) / numbers(columns, f"u_{prefix}")


def test_the_object_s_errors_are_as_large_as_stated_and_the_mirror_s_poses_stay_the_same():
    _, poses = solve(WITH_OBJECT)
    _, bare = solve(BENCH)
    assert bare.object == {}
    np.testing.assert_array_equal(poses.solution.state, bare.solution.state)
    over = errors(poses.object, "object_", *truth(STATE))
    assert np.abs(np.sqrt(np.mean(over**2, axis=0)) - 1).max() < 0.15
    columns = pose_columns(poses)
    assert list(columns)[-12:] == list(poses.object)
    assert not any("object" in name for name in pose_columns(bare))


def test_displacements_begin_after_the_zero_and_err_as_stated():
    request = ZeroRequest(seconds=0.08)
    pipeline, poses = solve(WITH_OBJECT, request, covariance=True)
    moved = numbers(poses.object, "displacement_")
    first = int(np.argmax(np.isfinite(moved[:, 0])))
    assert 800 <= first <= 1_000  # the batch that holds the first sample after the zero
    assert np.isnan(moved[:first]).all()
    assert pipeline.object_poses.zero.samples == 800
    places, turns = truth(STATE)
    shift = turns[0].inv().apply(places - places[0])
    late = slice(first, None)
    over = errors({n: c[late] for n, c in poses.object.items()}, "displacement_",
                  shift[late], (turns[0].inv() * turns)[late])  # fmt: skip
    assert np.abs(np.sqrt(np.mean(over**2, axis=0)) - 1).max() < 0.15
    variance = poses.object["cov_displacement_yaw_yaw_mrad2"][late]
    np.testing.assert_allclose(
        np.sqrt(variance), poses.object["u_displacement_yaw_mrad"][late], rtol=1e-12
    )
    assert pipeline.object_poses.take_news()[0].startswith("the first 0.08 s, 800 samples: tx_mm")
    assert tuple(poses.object) == Pipeline(WITH_OBJECT, request, True).object_poses.names


def test_a_sample_is_displaced_by_nothing_from_itself():
    _, poses = solve(WITH_OBJECT, ZeroRequest(row=1), data=DATA[: 300 * SIZE])
    assert np.abs(numbers(poses.object, "displacement_")[0]).max() < 1e-15
    assert numbers(poses.object, "u_displacement_")[0].max() < 1e-9
    assert numbers(poses.object, "u_displacement_")[1].min() > 1e-8


def test_a_zero_waits_for_light_and_says_that_the_mirror_moves():
    data = board(STATE[STILL:])
    pipeline = Pipeline(WITH_OBJECT, ZeroRequest(seconds=0.05))
    live = Live(pipeline, begin=np.inf)  # no run, which could be silent
    batch = pipeline.take(data[: 100 * SIZE], 1.0)[0]
    pipeline.solve(replace(batch, aligned=np.full_like(batch.readings, np.nan)))
    assert "waits for a pose" in live.messages()[0]
    pipeline.feed(data[300 * SIZE : 500 * SIZE], 2.0)
    assert "keep the mirror still" in live.messages()[0]
    pipeline.feed(data[500 * SIZE : 1_000 * SIZE], 3.0)
    assert "The mirror moved while the zero was measured" in live.messages()[0]
    assert any("The mirror moved" in text for text in pipeline.object_poses.sentences())


def test_rows_and_texts_say_which_point_they_mean():
    calibrated = replace(
        WITH_OBJECT,
        sensor=replace(BENCH.sensor, calibration=facets.Calibration(("psd_a.height",), ((1e-6,),))),
    )
    for config in (WITH_OBJECT, calibrated):
        pipeline, poses = solve(config, ZeroRequest(row=1), data=DATA[: 600 * SIZE])
        content = row_content(config, pipeline.object_poses)
        rows, about = rows_of(poses, 5.0), description(content)
        assert rows.dtype == sample_dtype(about)
        assert about["object"]["point_mm"] == [10.0, -20.0, 50.0]
        np.testing.assert_allclose(
            np.radians(about["object"]["orientation_deg"]), OBJECT.orientation
        )
        assert about["zero"] == "row 1"
        assert about["units"]["u_object_roll_mrad"] == "mrad"
        for name, column in poses.object.items():
            np.testing.assert_array_equal(rows[name], column)
        np.testing.assert_array_equal(rows["residual"], poses.solution.residual)
        text = json.loads(json_of(rows)[-1])
        assert text["object"]["object_tx_mm"] == pytest.approx(rows["object_tx_mm"][-1], rel=1e-8)
        assert "channels" not in text
        assert same_columns(rows).dtype == SAMPLE  # a program without the object
        assert same_columns(rows, kept_dtype(config))["object_tz_mm"][3] == rows["object_tz_mm"][3]
    bare = rows_of(solve(BENCH, data=DATA[: 50 * SIZE])[1], 5.0)
    assert bare.dtype == SAMPLE
    with pytest.raises(FacetsError, match=r"no object_tx_mm, .* publish with the same object"):
        same_columns(bare, kept_dtype(WITH_OBJECT))


def test_views_show_the_object():
    pipeline, poses = solve(WITH_OBJECT, ZeroRequest(row=1))
    live = Live(pipeline)
    live.newest = poses
    now = values(live)
    assert now["object_tz_mm"] == pytest.approx(poses.object["object_tz_mm"][-1], rel=1e-5)
    assert now["displacement_yaw_mrad"] == pytest.approx(1e3 * STATE[-1, 5], abs=0.01)
    from rich.console import Console

    screen = Console(width=100, height=60, record=True, force_terminal=False)
    screen.print(Screen(live))
    assert "displacement yaw" in screen.export_text()


def test_smoothed_poses_of_the_object_err_as_stated():
    state = motion(2_000)
    state[:, :3] *= 0.1
    places, turns = truth(state)
    solution = solve(WITH_OBJECT, data=board(state))[1].solution
    time = PERIOD_S * np.arange(2_000)
    columns, _ = smoothed_columns(WITH_OBJECT, time, solution, False, "acceleration")
    over = errors(columns, "smooth_object_", places, turns)
    assert np.sqrt(np.mean(over**2)) == pytest.approx(1, abs=0.25)


@pytest.mark.slow
def test_a_recording_keeps_its_point_and_is_replayed_to_the_bit(tmp_path):
    (tmp_path / "board.bin").write_bytes(DATA)
    words = ("--point", "10,-20,50", "--zero", "0.08s", "--covariance")
    done = command(
        "acquire", "bench", "--port", "file:board.bin", "--folder", "rec", "--plain", *words,
        cwd=tmp_path,
    )  # fmt: skip
    assert "zero: the first 0.08 s, 800 samples" in done.stdout, done.stderr
    folder = tmp_path / "rec"
    assert recorded_config(folder).object == MeasuredObject(point=(10.0, -20.0, 50.0))
    assert "point 10, -20, 50 mm" in (folder / "meta.yaml").read_text()
    playback = Playback(folder, zero=ZeroRequest(seconds=0.08), covariance=True)
    new = pose_columns(join_poses(list(playback.poses())))
    old = recorded_poses(folder)
    assert {"object_tx_mm", "displacement_yaw_mrad", "cov_displacement_tx_tx_mm2"} <= old.keys()
    assert compare(old, new).is_same
    assert np.isfinite(old["displacement_tx_mm"]).any()
    done = command("replay", "rec", "-o", "t.csv", "--zero", "9s", cwd=tmp_path)
    assert done.returncode == 2
    assert "rec: no displacements: --zero is the first 9 s, and no sample with" in done.stderr
    assert not (tmp_path / "t.csv").exists()
    done = command("replay", "rec", "-o", "t.csv", cwd=tmp_path)
    assert pd.read_csv(tmp_path / "t.csv", comment="#").misfit.mean() < 1e-3, done.stderr
    mcap = pytest.importorskip("mcap.reader")
    done = command("replay", "rec", "-o", "p.mcap", "--point", "0,0,50", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    with (tmp_path / "p.mcap").open("rb") as file:
        opened = mcap.make_reader(file)
        messages = [
            json.loads(m.data) for _, c, m in opened.iter_messages(topics=["/facets/object"])
        ]
        about = {one.name: one.metadata for one in opened.iter_metadata()}["facets"]
    assert about["object"].startswith("point 0, 0, 50 mm")
    tip = STATE[:, :3] + Rotation.from_euler("ZYX", STATE[:, 5:2:-1]).apply((0, 0, 50))
    heights = [1e3 * one["pose"]["position"]["z"] for one in messages]
    np.testing.assert_allclose(heights, tip[:, 2], atol=0.01)


@pytest.mark.slow
def test_subscribers_are_told_of_the_object():
    pipeline, poses = solve(WITH_OBJECT, data=DATA[: 500 * SIZE])
    with (
        Publications(["zmq://127.0.0.1:0"], WITH_OBJECT, True, utc_offset=5.0,
                     objects=pipeline.object_poses) as publications,
        Subscription(publications.places()[0]) as subscription,
    ):  # fmt: skip
        publications.add_poses(poses)
        came = next(iter(subscription))
    np.testing.assert_array_equal(
        came["object_yaw_mrad"], poses.object["object_yaw_mrad"][: len(came)]
    )


def test_a_bluesky_device_describes_the_object():
    pytest.importorskip("bluesky")
    pytest.importorskip("ophyd_async")
    import asyncio

    from facets.live import PoseSensor

    sensor = PoseSensor(WITH_OBJECT, "file:nothing", name="sensor")
    assert sensor.hints == {"fields": [f"sensor-object_{n}" for n in STATE_COLUMNS[:6]]}
    described = asyncio.run(sensor.describe())
    assert described["sensor-u_object_tx_mm"]["units"] == "mm"
    configured = asyncio.run(sensor.read_configuration())
    assert configured["sensor-object"]["value"] == OBJECT.text


def test_pages_get_the_object_beside_the_state_and_the_channels():
    pipeline, poses = solve(WITH_OBJECT, ZeroRequest(seconds=0.05))
    hub = Hub({**row_content(WITH_OBJECT, pipeline.object_poses), "statuses": {}})
    hub.take(rows_of(poses, 5.0))
    hello = json.loads(hub.hello())
    assert hello["object"]["point_mm"] == [10.0, -20.0, 50.0]
    place = hello["extras"].index("displacement_tz_mm")
    sample = hub.newest["channels"]
    assert sample[place] == poses.object["displacement_tz_mm"][-1]
    uncertainty = hello["extras"].index("u_displacement_tz_mm")
    assert sample[uncertainty] == poses.object["u_displacement_tz_mm"][-1]
    _, bins = hub.all.values(np.array([1, 200]))
    columns = {name: bins[:, n] for n, name in enumerate(hello["columns"])}
    assert np.isnan(columns["mean_displacement_tz_mm"][0])  # while the zero was measured
    assert columns["poses"][0] > 0
    inside = slice(2_000, 2_010)
    mean = poses.object["displacement_tz_mm"][inside].mean()
    assert columns["mean_displacement_tz_mm"][1] == pytest.approx(mean, abs=1e-3)
    largest = poses.object["u_displacement_tz_mm"][inside].max()
    assert columns["most_u_displacement_tz_mm"][1] == pytest.approx(largest, rel=0.1)
