"""A recording as MCAP, read back by the format's own library."""

from __future__ import annotations

import json

import numpy as np
import pytest
from recorded import record

from facets.live import recorded_poses

pytestmark = pytest.mark.installed


def test_every_sample_is_in_the_file_with_its_schema(tmp_path, run_in_process):
    reader = pytest.importorskip("mcap.reader")
    record(tmp_path / "rec")
    status, _, err = run_in_process("replay", "rec", "-o", "poses.mcap")
    assert status == 0, err
    poses = recorded_poses(tmp_path / "rec")
    messages = {"/facets/sample": [], "/facets/pose": []}
    with (tmp_path / "poses.mcap").open("rb") as file:
        opened = reader.make_reader(file)
        for schema, channel, message in opened.iter_messages():
            assert schema.encoding == "jsonschema"
            json.loads(schema.data)
            messages[channel.topic].append((message.log_time, json.loads(message.data)))
        about = {entry.name: entry.metadata for entry in opened.iter_metadata()}
    assert about["facets"]["config"] == "bench"
    samples = [sample for _, sample in messages["/facets/sample"]]
    assert [sample["seq"] for sample in samples] == poses["seq"].tolist()
    yaw = np.array([sample["pose"]["yaw_mrad"] for sample in samples])
    np.testing.assert_allclose(yaw, poses["yaw_mrad"], rtol=1e-8)
    turns = [message["pose"]["orientation"] for _, message in messages["/facets/pose"]]
    # small turns: half the angle about each axis
    np.testing.assert_allclose([2e3 * turn["z"] for turn in turns], yaw, rtol=1e-5, atol=1e-9)
    places = [message["pose"]["position"]["x"] for _, message in messages["/facets/pose"]]
    np.testing.assert_allclose(1e3 * np.array(places), poses["tx_mm"], atol=1e-12)
    times = np.array([time for time, _ in messages["/facets/sample"]])
    np.testing.assert_allclose(np.diff(times) / 1e9, np.diff(poses["host_s"]), atol=1e-6)
