"""A recording whose files were cut, spoilt, swapped or lost: each command says which, and why."""

from __future__ import annotations

import re
import shutil

import pytest
from recorded import BLOCKS, EACH, record
from ruamel.yaml import YAML

import facets
from facets.config import fingerprint

ALL = BLOCKS * EACH


@pytest.fixture(scope="module")
def original(tmp_path_factory):
    place = tmp_path_factory.mktemp("recordings")
    record(place / "rec")
    record(place / "other", first=100, count=BLOCKS - 2)
    record(place / "killed", close=False)
    return place


@pytest.fixture
def place(original, tmp_path):
    """A folder with copies of a whole recording, of another, and of one without its end."""
    shutil.copytree(original, tmp_path, dirs_exist_ok=True)
    return tmp_path


@pytest.fixture
def compare(place, run_in_process):
    """Compares a recording with its replay: status, and all that is said."""

    def call(*more, name="rec"):
        status, out, err = run_in_process("replay", name, "--compare", *more)
        assert "Traceback" not in err
        return status, out + err

    return call


def cut(path, share=0.6):
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share)])


def flip(path):
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0x55
    path.write_bytes(bytes(data))


def lose_an_event(path):
    path.write_bytes(path.read_bytes().partition(b"\n")[2])


@pytest.mark.parametrize("change", [flip, cut, lose_an_event])
def test_a_change_of_events_is_told(place, compare, change):
    """Each event proves those before it."""
    change(place / "rec" / "events.jsonl")
    status, text = compare()
    assert status == 1
    assert "recorded poses: identical" in text
    unknown = "how many poses were recorded is unknown"  # torn, as by a failing power
    assert (unknown if change is cut else "events.jsonl is changed or missing") in text


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        (
            "poses.arrows",
            cut,
            [
                f" of {ALL} recorded poses: identical",
                "rec/poses.arrows: ",
                "poses are missing or damaged",
                f" to {ALL - 1}, have no recorded pose",
            ],
        ),
        (
            "poses.arrows",
            lambda path: path.write_bytes(b""),
            [f"0 of {ALL} recorded poses: nothing can be compared"],
        ),
        (
            "poses.arrows",
            lambda path: shutil.copy(path.parents[1] / "other" / path.name, path),
            ["NOT equal", "the cause is unknown"],
        ),
        (
            "index.bin",
            cut,
            [
                "rows of index.bin are missing",
                "they differ in host_s",
                "the recording is damaged (see above) from sample",
            ],
        ),
        (
            "bytes.bin",
            flip,
            ["1 were recorded and their bytes cannot be read any more"],
        ),
    ],
)
def test_what_is_missing_or_differs_is_said_with_its_cause(place, compare, name, change, words):
    change(place / "rec" / name)
    status, text = compare()
    assert status == 1
    for part in words:
        assert part in text
    assert "disk" not in text  # it refused nothing


def test_another_configuration_is_the_known_cause(place, compare):
    (place / "rig.yaml").write_text("extends: bench\nsensor:\n  psd: {a: {radius_mm: 250.1}}\n")
    status, text = compare("--config", "rig.yaml")
    assert status == 1
    assert "the poses are solved with rig.yaml, not with the recording's own configuration" in text


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
def test_a_file_that_is_wrong_is_named_in_one_sentence(place, run_in_process, name, what, words):
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
    status, _, err = run_in_process("replay", "rec")
    assert status == 2
    assert words in err
    assert len(err.splitlines()) == 1
    if name == "index.bin":
        status, out, err = run_in_process("replay", "rec", "--recover", "-o", "poses.csv")
        assert status == 0, err
        assert f"rec: {ALL} samples" in out


def test_a_configuration_that_lost_its_end_is_not_completed_by_defaults(place, run_in_process):
    """Also of a recording that was not closed."""
    path = place / "killed" / "meta.yaml"
    text = path.read_text()
    path.write_text(text[: text.index("  solve:")])
    status, _, err = run_in_process("replay", "killed")
    assert status == 2
    assert "killed/meta.yaml: is damaged or was changed" in err


def test_a_recording_of_a_later_version_is_told_under_its_own_name(place, run_in_process):
    path = place / "killed" / "meta.yaml"  # not sealed by an end
    text = path.read_text().replace("resolved:\n", "resolved:\n  novelty: {a: 1}\n")
    text = text.replace(f"facets: {facets.__version__}", "facets: 99.1")
    resolved = YAML(typ="safe").load(text)["resolved"]
    path.write_text(re.sub("config_sha256: .*", f"config_sha256: {fingerprint(resolved)}", text))
    status, _, err = run_in_process("replay", "killed")
    assert status == 2
    assert "killed/meta.yaml: novelty: unknown key" in err
    assert "facets 99.1 made this recording" in err
