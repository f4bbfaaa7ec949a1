"""A recording as MCAP, read back by the format's own library."""

from __future__ import annotations

import json

import numpy as np
import pytest
from commands import command
from facets.experiments import kills

from facets.live import recorded_poses

pytestmark = pytest.mark.installed


@pytest.mark.slow
def test_every_sample_is_in_the_file_with_its_schema(tmp_path):
    reader = pytest.importorskip("mcap.reader")
    (tmp_path / "board.bin").write_bytes(kills.stream(300))
    command(
        "acquire", "bench", "--port", "file:board.bin", "--folder", "rec", "--plain", cwd=tmp_path
    )
    result = command("replay", "rec", "-o", "poses.mcap", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    poses = recorded_poses(tmp_path / "rec")
    found = {"/facets/sample": [], "/facets/pose": []}
    with (tmp_path / "poses.mcap").open("rb") as file:
        opened = reader.make_reader(file)
        for schema, channel, message in opened.iter_messages():
            assert schema.encoding == "jsonschema"
            json.loads(schema.data)
            found[channel.topic].append((message.log_time, json.loads(message.data)))
        about = {one.name: one.metadata for one in opened.iter_metadata()}
    assert about["facets"]["config"] == "bench"
    samples = [message for _, message in found["/facets/sample"]]
    assert [one["seq"] for one in samples] == poses["seq"].tolist()
    yaw = np.array([one["pose"]["yaw_mrad"] for one in samples])
    np.testing.assert_allclose(yaw, poses["yaw_mrad"], rtol=1e-8)
    turns = [message["pose"]["orientation"] for _, message in found["/facets/pose"]]
    # small turns: half the angle about each axis
    np.testing.assert_allclose([2e3 * turn["z"] for turn in turns], yaw, rtol=1e-5, atol=1e-9)
    places = [message["pose"]["position"]["x"] for _, message in found["/facets/pose"]]
    np.testing.assert_allclose(1e3 * np.array(places), poses["tx_mm"], atol=1e-12)
    times = np.array([time for time, _ in found["/facets/sample"]])
    np.testing.assert_allclose(np.diff(times) / 1e9, np.diff(poses["host_s"]), atol=1e-6)
