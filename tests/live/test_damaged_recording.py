"""A recording whose files were cut, spoilt, swapped or lost: each command says which, and why."""

from __future__ import annotations

import json
import re
import shutil
import zlib

import pytest
from commands import command
from recorded import BLOCKS, EACH, record
from ruamel.yaml import YAML

import facets
from facets.config import fingerprint
from facets.live import are_events_whole


@pytest.fixture(scope="module")
def original(tmp_path_factory):
    place = tmp_path_factory.mktemp("recordings")
    record(place / "rec")
    record(place / "other", first=100, count=BLOCKS - 2)
    return place


@pytest.fixture
def place(original, tmp_path):
    shutil.copytree(original, tmp_path, dirs_exist_ok=True)
    return tmp_path


def cut(path, share=0.6):
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share)])


def flip(path):
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0x55
    path.write_bytes(bytes(data))


def compare(place, *more):
    result = command("replay", "rec", "--compare", *more, cwd=place)
    assert "Traceback" not in result.stderr
    return result.returncode, result.stdout + result.stderr


def test_a_whole_recording_is_identical(place):
    status, text = compare(place)
    assert status == 0
    assert f"{BLOCKS * EACH} recorded poses: identical" in text


def test_poses_that_are_cut_off_are_missed(place):
    cut(place / "rec" / "poses.arrows")
    status, text = compare(place)
    assert status == 1
    assert f" of {BLOCKS * EACH} recorded poses: identical" in text
    assert "rec/poses.arrows: " in text
    assert "poses are missing or damaged" in text
    assert f"to {BLOCKS * EACH - 1}, have no recorded pose" in text


@pytest.mark.parametrize("change", [flip, cut, lambda path: path.unlink()])
def test_a_change_of_events_is_told(place, change):
    change(place / "rec" / "events.jsonl")
    status, text = compare(place)
    assert status == 1
    assert "recorded poses: identical" in text
    assert (
        "how many poses were recorded is unknown"
        if change is cut
        else "events.jsonl is changed or missing"
    ) in text


def test_each_event_proves_those_before_it(place):
    path = place / "rec" / "events.jsonl"
    lines = path.read_bytes().splitlines(keepends=True)
    assert are_events_whole(path.read_bytes())
    spoilt = lines[0].replace(b"monotonic", b"monotonac")
    for changed in ([spoilt, *lines[1:]], lines[1:], lines[::-1]):
        assert not are_events_whole(b"".join(changed))
    assert are_events_whole(b"".join(lines)[:-5])  # torn, as by a failing power
    assert are_events_whole(b'{"event": "closed"}\n')  # of a version without sums


def test_poses_that_are_gone_are_not_identical(place):
    (place / "rec" / "poses.arrows").write_bytes(b"")
    status, text = compare(place)
    assert status == 1
    assert f"0 of {BLOCKS * EACH} recorded poses: nothing can be compared" in text


def test_an_index_that_is_cut_off_is_the_known_cause(place):
    cut(place / "rec" / "index.bin")
    status, text = compare(place)
    assert status == 1
    assert "rows of index.bin are missing" in text
    assert "they differ in host_s" in text
    assert "the largest difference" not in text
    assert "the recording is damaged (see above) from sample" in text
    assert "disk" not in text


def test_spoilt_bytes_are_not_blamed_on_the_disk(place):
    flip(place / "rec" / "bytes.bin")
    status, text = compare(place)
    assert status == 1
    assert "1 were recorded and their bytes cannot be read any more" in text
    assert "disk" not in text


def test_poses_of_another_recording_have_no_known_cause(place):
    shutil.copy(place / "other" / "poses.arrows", place / "rec" / "poses.arrows")
    status, text = compare(place)
    assert status == 1
    assert "NOT equal" in text
    assert "the cause is unknown" in text


def test_another_configuration_is_the_known_cause(place):
    (place / "rig.yaml").write_text("extends: bench\nsensor:\n  psd: {a: {radius_mm: 250.1}}\n")
    status, text = compare(place, "--config", "rig.yaml")
    assert status == 1
    assert "the poses are solved with rig.yaml, not with the recording's own configuration" in text


def test_a_recording_that_was_killed_is_replayed_and_says_that_its_count_is_unknown(tmp_path):
    record(tmp_path / "rec", close=False)
    cut(tmp_path / "rec" / "poses.arrows")
    assert command("replay", "rec", cwd=tmp_path).returncode == 0
    status, text = compare(tmp_path)
    assert status == 1
    assert "how many poses were recorded is unknown" in text


@pytest.mark.parametrize(
    ("name", "what", "words"),
    [
        ("meta.yaml", "cut", "rec/meta.yaml: is damaged: it holds no configuration"),
        (
            "meta.yaml",
            "swap",
            "rec/meta.yaml: is not the file with which this recording was closed",
        ),
        ("meta.yaml", "lose", "rec/meta.yaml: is missing; the received bytes are in rec/bytes.bin"),
        ("bytes.bin", "empty", "rec/bytes.bin: is empty"),
        ("bytes.bin", "swap", "rec/index.bin: none of its 12 rows agrees with rec/bytes.bin"),
        ("bytes.bin", "lose", "rec/bytes.bin: is missing"),
        ("index.bin", "swap", "rec/index.bin: none of its 10 rows agrees with rec/bytes.bin"),
        ("index.bin", "lose", "rec/index.bin: is missing; `facets replay rec --recover`"),
        ("index.bin", "folder", "rec/index.bin: cannot be read"),
    ],
)
def test_a_file_that_is_wrong_is_named_in_one_sentence(place, name, what, words):
    path = place / "rec" / name
    if what == "cut":
        cut(path, 0.002)
    elif what == "swap":
        shutil.copy(place / "other" / name, path)
    elif what == "empty":
        path.write_bytes(b"")
    else:
        path.unlink()
        if what == "folder":
            path.mkdir()
    for words_of_command in (("replay", "rec"), ("noise", "rec", "--write", "n.yaml")):
        result = command(*words_of_command, cwd=place)
        assert result.returncode == 2
        assert words in result.stderr
        assert len(result.stderr.splitlines()) == 1
    assert not (place / "n.yaml").exists()
    if name == "index.bin":
        result = command("replay", "rec", "--recover", "-o", "poses.csv", cwd=place)
        assert result.returncode == 0, result.stderr
        assert f"rec: {BLOCKS * EACH} samples" in result.stdout


@pytest.mark.parametrize("name", ["index.bin", "poses.arrows", "events.jsonl", "bytes.bin"])
def test_nonsense_in_a_file_is_no_traceback(place, name):
    (place / "rec" / name).write_bytes(bytes(range(256)) * 17)
    for words in (
        ("replay", "rec", "--compare"),
        ("replay", "rec", "--recover", "-o", "poses.csv"),
    ):
        result = command(*words, cwd=place)
        assert result.returncode in (0, 1, 2)
        assert "Traceback" not in result.stderr


def test_a_configuration_that_lost_its_end_is_not_completed_by_defaults(tmp_path):
    """Also of a recording that was not closed."""
    record(tmp_path / "rec", close=False)
    path = tmp_path / "rec" / "meta.yaml"
    text = path.read_text()
    path.write_text(text[: text.index("  solve:")])
    result = command("replay", "rec", cwd=tmp_path)
    assert result.returncode == 2
    assert "rec/meta.yaml: is damaged or was changed" in result.stderr


def test_a_recording_of_a_later_version_is_told_under_its_own_name(place):
    path = place / "rec" / "meta.yaml"
    text = path.read_text().replace("resolved:\n", "resolved:\n  novelty: {a: 1}\n")
    text = text.replace(f"facets: {facets.__version__}", "facets: 99.1")
    resolved = YAML(typ="safe").load(text)["resolved"]
    path.write_text(re.sub("config_sha256: .*", f"config_sha256: {fingerprint(resolved)}", text))
    events = place / "rec" / "events.jsonl"
    *others, last = events.read_text().splitlines()
    sealed = json.loads(last) | {"meta_crc": zlib.crc32(path.read_bytes())}
    events.write_text("\n".join([*others, json.dumps(sealed)]) + "\n")
    result = command("replay", "rec", cwd=place)
    assert result.returncode == 2
    assert "rec/meta.yaml: novelty: unknown key" in result.stderr
    assert "facets 99.1 made this recording" in result.stderr
    assert "tmp" not in result.stderr
