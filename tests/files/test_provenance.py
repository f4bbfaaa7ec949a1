"""A former result is taken for the configuration that it was made from, and for no other."""

import sys

import numpy as np
import pytest
from commands import command
from recorded import record

import facets
from facets import InputError
from facets.core import READING_COLUMNS
from facets.design import part_of, space_of
from facets.files import provenance, tables

LAYOUT, PAPER = facets.load("layout"), facets.load("paper")


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_a_table_says_from_which_configuration_it_was_made(tmp_path, ending):
    path = tmp_path / f"t.{ending}"
    tables.write_table(path, {"a": np.zeros(3)}, provenance.provenance_header(LAYOUT, 1))
    made = tables.read_head(path)
    assert made["config"] == "layout"
    provenance.require_origin(path, made, LAYOUT, "")
    older = made | {"config_sha256": "0" * 64, "facets": "0.1"}
    for head, config, says in (
        (made, PAPER, "from configuration layout, not from paper; do so"),
        (older, LAYOUT, r"another state of layout, by facets 0\.1"),
        ({}, LAYOUT, "does not say"),
    ):
        with pytest.raises(InputError, match=says):
            provenance.require_origin(path, head, config, "do so")


@pytest.fixture
def explored(tmp_path):
    """A folder of designs of `layout`, as `facets explore` leaves it."""
    table = part_of(space_of(LAYOUT, ["head_mm"], 2, 1), 0)
    about = provenance.provenance_header(LAYOUT, 1)
    (tmp_path / "out" / "parts").mkdir(parents=True)
    for name, more in (
        ("parts/0000000000.parquet", {}),
        ("front.csv", {}),
        ("pareto.csv", {"point": np.arange(2)}),
    ):
        tables.write_table(tmp_path / "out" / name, {**more, **table}, about)
    (tmp_path / "other.yaml").write_text("extends: layout\nsensor: {psd: {height_mm: 1}}\n")
    return tmp_path


@pytest.mark.parametrize(
    "words",
    [("--pick", "0", "-d", "out", "-o", "mine.yaml"), ("-d", "out"), ("--front", "-d", "out")],
)
def test_designs_of_another_configuration_are_not_taken(explored, run_in_process, words):
    def tree():
        return {path: path.read_bytes() for path in explored.rglob("*") if path.is_file()}

    before = tree()
    status, _, err = run_in_process("explore", "other.yaml", *words)
    assert status == 2
    assert "was made from configuration layout, not from" in err
    assert tree() == before


def test_designs_of_the_same_configuration_are_taken(explored, run_in_process):
    words = ("explore", "layout", "--pick", "1", "-d", "out", "-o", "mine.yaml")
    assert run_in_process(*words)[0] == 0
    assert facets.load(explored / "mine.yaml").path.is_file()


def test_a_recording_of_another_sensor_is_not_drawn(tmp_path, run_in_process):
    record(tmp_path / "recording", count=2)
    words = ("render", "paper", "--recording", "recording", "-o", "film.gif")
    status, _, err = run_in_process(*words)
    assert status == 2
    assert "recording: was made from configuration" in err
    assert not (tmp_path / "film.gif").exists()


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no such names")
@pytest.mark.parametrize("ending", ["csv", "parquet", "h5"])
def test_names_that_are_not_utf8_are_written_as_escapes(ending, tmp_path):
    readings, config = tmp_path / f"r\udce9.{ending}", "c\udce9.yaml"
    (tmp_path / config).write_text("extends: paper\n")
    rows = facets.readings(PAPER.sensor, np.zeros((3, 8)))
    tables.write_table(readings, dict(zip(READING_COLUMNS, rows.T, strict=True)), {})
    poses = tmp_path / f"p\udce9.{ending}"
    done = command("solve", config, readings.name, "-o", poses.name, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith(rf"3 of 3 rows solved: p\xe9.{ending}")
    made = tables.read_head(poses)
    assert made["config"] == r"c\xe9"
    assert made["command"] == rf"facets solve 'c\xe9.yaml' 'r\xe9.{ending}' -o 'p\xe9.{ending}'"
    assert len(tables.read_columns(poses)["tx_mm"]) == 3
