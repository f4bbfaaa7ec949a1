"""Results appear together or not at all: after an error, a full disk or ^C at any step."""

import errno
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from facets import OutputError
from facets.files import ResultSet, Whole, readable_path, remove_older

FULL = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def tree(folder):
    """All that is in a folder, hidden files and empty folders too."""
    return {
        str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None
        for path in folder.rglob("*")
    }


def write_three(folder):
    """A set over two folders, with an older file replaced, a new one, and an older one gone."""
    with ResultSet():
        for name in ("here/old.csv", "new/deep/first.csv", "new/deep/second.csv"):
            with Whole(folder / name) as temporary:
                temporary.write_text(f"new {name}")
        remove_older(folder / "here" / "gone.csv")
        assert readable_path(folder / "here" / "old.csv").read_text() == "new here/old.csv"
        assert not readable_path(folder / "here" / "gone.csv").exists()
        assert (folder / "here" / "old.csv").read_text() == "old"


@pytest.fixture
def older(tmp_path):
    (tmp_path / "here").mkdir()
    for name in ("old.csv", "gone.csv"):
        (tmp_path / "here" / name).write_text("old")
    return tmp_path


def test_all_of_a_set_appears_at_the_end(older):
    write_three(older)
    assert tree(older) == {
        "here": None,
        "here/old.csv": b"new here/old.csv",
        "new": None,
        "new/deep": None,
        "new/deep/first.csv": b"new new/deep/first.csv",
        "new/deep/second.csv": b"new new/deep/second.csv",
    }


def test_what_the_disk_refuses_is_told_with_the_file_and_other_errors_as_they_are(tmp_path):
    for raised, told in ((FULL, OutputError), (KeyError("x"), KeyError)):
        with pytest.raises(told) as caught, Whole(tmp_path / "a.csv"):
            raise raised
        assert told is KeyError or "a.csv: cannot be written" in str(caught.value)
    assert tree(tmp_path) == {}


#: What a set does with the disk, and how often.
STEPS = [("os.open", 3), ("os.fsync", 5), ("Path.mkdir", 3), ("os.link", 2), ("Path.replace", 3)]


def failing(monkeypatch, name, step, error):
    """Makes the call number `step` of a function of `os` or `Path` fail; counts the calls."""
    owner, attribute = (os, name[3:]) if name.startswith("os.") else (Path, name[5:])
    genuine, calls = getattr(owner, attribute), [0]

    def call(*words, **options):
        calls[0] += 1
        if calls[0] == step:
            raise error
        return genuine(*words, **options)

    monkeypatch.setattr(owner, attribute, call)
    return calls


@pytest.mark.parametrize(
    ("error", "says"),
    [(FULL, "cannot be written: No space left"), (KeyboardInterrupt("^C"), "C")],
    ids=["full disk", "interrupt"],
)
@pytest.mark.parametrize(("name", "step"), [(n, k + 1) for n, most in STEPS for k in range(most)])
def test_after_a_failure_at_any_step_all_is_as_it_was(older, monkeypatch, name, step, error, says):
    before = tree(older)
    calls = failing(monkeypatch, name, step, error)
    if name == "os.link" and error is FULL:  # a disk without them: copies
        write_three(older)
        assert (older / "here" / "old.csv").read_text() == "new here/old.csv"
        assert calls[0] >= step
        return
    with pytest.raises((OutputError, KeyboardInterrupt), match=says):
        write_three(older)
    monkeypatch.undo()
    assert calls[0] >= step
    assert tree(older) == before


def test_a_signal_does_not_come_between_the_moves_of_a_set(older, monkeypatch):
    genuine = Path.replace

    def replace(path, target):
        signal.raise_signal(signal.SIGINT)
        return genuine(path, target)

    monkeypatch.setattr(Path, "replace", replace)
    with pytest.raises(KeyboardInterrupt):
        write_three(older)
    monkeypatch.undo()
    assert sorted(tree(older)) == ["here", "here/old.csv", "new", "new/deep",
                                   "new/deep/first.csv", "new/deep/second.csv"]  # fmt: skip


def test_a_file_alone_belongs_to_no_set(tmp_path):
    def fail():
        with ResultSet():
            with Whole(tmp_path / "kept.o", alone=True) as temporary:
                temporary.write_text("kept")
            assert (tmp_path / "kept.o").exists()
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fail()
    assert tree(tmp_path) == {"kept.o": b"kept"}


def test_the_next_writer_removes_the_hidden_file_of_a_killed_one(tmp_path):
    path = tmp_path / "poses.csv"
    code = (
        "import os, signal, sys\n"
        "from pathlib import Path\n"
        "from facets.files.whole import Whole\n"
        "with Whole(Path('poses.csv')) as temporary:\n"
        "    temporary.write_text('half')\n"
        "    print('written', flush=True)\n"
        "    sys.stdin.read()\n"
    )
    with subprocess.Popen([sys.executable, "-c", code], cwd=tmp_path, stdin=-1, stdout=-1) as one:
        assert one.stdout.readline() == b"written\n"
        for count in (1, 0):
            with Whole(path) as temporary:
                temporary.write_text("whole")
            assert len(tree(tmp_path)) == 1 + count
            one.kill()
            one.wait()
    assert tree(tmp_path) == {"poses.csv": b"whole"}


OPTIMUM = "extends: layout\noptimize: {starts: 1, variables: {radius_mm: [100, 260]}}\n"
COMMANDS = [
    ("simulate", "paper", "--motion", "yaw-sweep", "-d", "out"),
    ("resolution", "paper", "-d", "out"),
    ("range-map", "paper", "--axes", "tx,ty", "-d", "out"),
    ("jacobian", "paper", "--states", "1000", "--no-search-worst",
     "--box", "tx_mm=0.01", "--certify", "-d", "out"),
    ("tolerances", "layout", "--heads", "10", "-d", "out"),
    ("optimize", "mine.yaml", "--certify", "0", "-o", "out/x.yaml"),
    ("export-c", "paper", "-d", "out"),
]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("words", COMMANDS, ids=lambda words: " ".join(words[:2]))
def test_every_command_writes_all_its_results_in_one_set(
    words, tmp_path, run_in_process, monkeypatch
):
    (tmp_path / "mine.yaml").write_text(OPTIMUM)
    before, sets = tree(tmp_path), []

    def publish(results):
        sets.append(set(results.files))
        raise FULL if len(words) % 2 else KeyboardInterrupt

    monkeypatch.setattr(ResultSet, "publish", publish)
    assert run_in_process(*words)[0] in (2, 130)
    assert tree(tmp_path) == before
    assert len(sets) == 1
    assert len(sets[0]) > 1


@pytest.mark.slow
def test_a_search_keeps_its_parts_alone_where_its_results_can_not_be_written(
    tmp_path, run_in_process, monkeypatch
):
    def publish(results):
        raise FULL

    (tmp_path / "mine.yaml").write_text(OPTIMUM)
    monkeypatch.setattr(ResultSet, "publish", publish)
    assert run_in_process("explore", "mine.yaml", "--designs", "32", "-d", "out")[0] == 2
    parts = {"out", "out/parts", "out/parts/0000000000.parquet"}
    assert set(tree(tmp_path)) == {"mine.yaml"} | parts
