"""What every released version of facets has written is still read, and gives the same numbers."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import get_args, get_type_hints

import numpy as np
import pytest
from facets.experiments import check_certificate
from recorded import record

import facets
from facets.core import READING_COLUMNS, STATE_COLUMNS, STATE_UNITS
from facets.files import join_columns, read_chunks, read_head, tables
from facets.live import (
    Damage,
    Pipeline,
    are_events_whole,
    board_solution,
    parser,
    recorded_config,
    recorded_poses,
    replay,
)

VERSIONS = sorted(path for path in Path(__file__).parent.iterdir() if path.name[0].isdigit())
POSE = STATE_COLUMNS[:6]


@pytest.fixture(params=VERSIONS, ids=lambda path: path.name)
def stored(request):
    return request.param


@pytest.fixture
def expected(stored):
    return json.loads((stored / "expected.json").read_text())


def assert_poses(columns, expected, atol, prefixes=("", "object_", "displacement_")):
    for prefix in prefixes:
        key = prefix.removesuffix("_") or "poses"
        poses = np.stack([columns[prefix + name] for name in POSE], axis=1)
        np.testing.assert_allclose(poses, np.array(expected[key])[:, :6], rtol=0, atol=atol)


def read(path, names):
    (chunk,) = read_chunks(path, names)
    assert not chunk.unparsable.any()
    return chunk.columns


def test_every_stored_file_is_as_it_was_made(stored, expected):
    files = {path.relative_to(stored).as_posix(): path for path in stored.rglob("*.*")}
    del files["expected.json"]
    sums = {name: hashlib.sha256(path.read_bytes()).hexdigest() for name, path in files.items()}
    assert sums == expected["sha256"]


@pytest.mark.parametrize("ending", tables.ENDINGS)
def test_tables_of_readings_and_poses(stored, expected, run_in_process, tmp_path, ending):
    words = ("--zero", "row:1", "-o", "again.csv")
    config, readings = stored / "config.yaml", stored / f"readings{ending}"
    assert run_in_process("solve", config, readings, *words)[0] == 0
    head = read_head(stored / f"poses{ending}")
    assert (head["config"], head["facets"]) == ("config", f"{stored.name}.0")
    names = [prefix + name for prefix in ("", "object_", "displacement_") for name in POSE]
    for path in (tmp_path / "again.csv", stored / f"poses{ending}"):
        assert_poses(read(path, names), expected, 1e-9)


def test_a_calibration_with_its_covariance(stored, expected):
    config = facets.load(stored / "calibrated.yaml")
    calibration = config.sensor.calibration
    assert list(calibration.names) == expected["parameters"]
    np.testing.assert_allclose(
        np.sqrt(np.diag(calibration.covariance)), expected["uncertainties"], rtol=1e-12
    )
    readings = read(stored / "readings.csv", READING_COLUMNS)
    solution = facets.solve(config.sensor, np.stack(list(readings.values()), axis=1))
    assert (solution.calibration_uncertainty[:, :6] > 0).all()


KEYS = get_type_hints(type(facets.load("bench").acquire))
FRAMES = set(product(get_args(KEYS["format"]), (*get_args(KEYS["content"]), "poses")))


@pytest.mark.parametrize(("form", "content"), sorted(FRAMES - {("text", "poses")}))
@pytest.mark.parametrize("channels", [0, 2])
def test_frames_of_every_format_and_content(stored, expected, form, content, channels):
    data = (stored / "streams" / f"{form}-{content}-{channels}.bin").read_bytes()
    samples, count = parser(form, content, channels).feed(data), len(expected["poses"])
    assert samples.seq.tolist() == list(range(count))
    assert samples.time.tolist() == list(range(0, 100 * count, 100))
    assert not samples.flags.any()
    values = np.array(expected["channels"])[:, :channels]
    if content == "poses":
        states = board_solution(samples)["state"] / STATE_UNITS
        np.testing.assert_allclose(states, expected["poses"], rtol=1e-6)
        assert np.isnan(samples.channels).all()
        return
    assert samples.counts.tolist() == expected["counts"][content]
    np.testing.assert_array_equal(samples.channels, values)
    config = recorded_config(stored / "recording")
    named = config.acquire.channels[:channels]
    acquire = replace(config.acquire, format=form, content=content, channels=named)
    poses = Pipeline(replace(config, acquire=acquire)).feed(data, 100.0)
    assert_poses(poses.columns(), expected, 2e-4, ("", "object_"))


def test_a_recording(stored, expected):
    folder, damage = stored / "recording", Damage()
    parts = list(replay(folder, Pipeline(recorded_config(folder)), damage=damage))
    assert damage == Damage()
    assert are_events_whole((folder / "events.jsonl").read_bytes())
    for columns in (join_columns([part.columns() for part in parts]), recorded_poses(folder)):
        assert_poses(columns, expected, 2e-4, ("", "object_"))
        force, temperature = np.array(expected["channels"]).T
        np.testing.assert_array_equal(columns["force_n"], 0.5 * force)
        np.testing.assert_array_equal(columns["temperature_c"], temperature)
    assert [len(part) for part in parts] == [2, 2, 2]


def test_a_certificate(stored, expected):
    assert 0.9 < check_certificate.check(stored / "certificate.json").margin <= expected["margin"]


def messages(path):
    reader = pytest.importorskip("mcap.reader")
    with path.open("rb") as file:
        return [
            (channel.topic, schema.name, json.loads(message.data))
            for schema, channel, message in reader.make_reader(file).iter_messages()
        ]


def test_an_mcap_is_written_as_it_was(stored, run_in_process, tmp_path):
    assert run_in_process("replay", stored / "recording", "-o", "again.mcap")[0] == 0
    again, kept = messages(tmp_path / "again.mcap"), messages(stored / "poses.mcap")
    assert len(again) == len(kept) == 18
    for (*where, new), (*topic, old) in zip(again, kept, strict=True):
        assert where == topic
        assert_same(new, old)


def assert_same(new, old):
    if isinstance(old, dict):
        assert new.keys() >= old.keys()
        for name, value in old.items():
            assert_same(new[name], value)
    else:
        assert new == (pytest.approx(old, rel=1e-6, abs=1e-9) if isinstance(old, float) else old)


def test_what_this_version_writes_is_stored(tmp_path):
    """A new layout of recordings needs a stored one; formats and tables are asked for above."""
    record(tmp_path / "new")
    assert layout_of(tmp_path / "new") == layout_of(VERSIONS[-1] / "recording")


def layout_of(folder):
    last = json.loads((folder / "events.jsonl").read_text().splitlines()[-1])
    size = (folder / "index.bin").stat().st_size / last["rows"]
    poses = {name for name in recorded_poses(folder) if "object" not in name}
    names = sorted(path.name for path in folder.iterdir())
    return names, size, sorted(last), poses - {"force_n", "temperature_c"}
