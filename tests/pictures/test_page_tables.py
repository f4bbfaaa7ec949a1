"""Numbers from outside on the rig's page: typed readings, tables that are dropped and played."""

from __future__ import annotations

import json

import numpy as np
import pytest
from commands import command
from sensors import states

import facets
from facets.core import READING_COLUMNS, STATE_COLUMNS, STATE_UNITS

pytestmark = pytest.mark.slow
PAPER = facets.Sensor()
TRUE = states(40, seed=8, offset=0.1, angle=0.004)
POSE = ",".join(STATE_COLUMNS[:6])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Readings with a time and a row without light; and the poses that facets solves."""
    folder = tmp_path_factory.mktemp("tables")
    rows = [[0.01 * n, *reading] for n, reading in enumerate(facets.readings(PAPER, TRUE))]
    rows[5][1:] = [""] * 9
    lines = ["# config: bench", ",".join(("time_s", *READING_COLUMNS))]
    lines += [",".join(map(str, row)) for row in rows]
    (folder / "readings.csv").write_text("\n".join(lines), "utf-8")
    assert command("solve", "paper", "readings.csv", "-o", "poses.csv", cwd=folder).returncode < 2
    return folder


@pytest.fixture(scope="module")
def page(flat):
    return flat


def text(page, name):
    return page.ask(f"document.getElementById('{name}').textContent")


def await_text(page, name, words):
    page.await_true(f"document.getElementById('{name}').textContent.includes({json.dumps(words)})")


def distance(page, state):
    """The largest difference of the page's state from another, mm and rad."""
    return np.abs(np.array(page.ask("page.state()")) - state).max()


def choose(page, path):
    """Choose a file by the page's button, as a person does."""
    root = page.send("DOM.getDocument")["root"]["nodeId"]
    node = page.send("DOM.querySelector", nodeId=root, selector="#file")["nodeId"]
    page.send("DOM.setFileInputFiles", nodeId=node, files=[str(path)])


def drop(page, name, content):
    page.ask(
        "(() => { const data = new DataTransfer();"
        f" data.items.add(new File([{json.dumps(content)}], {json.dumps(name)}));"
        " const more = {dataTransfer: data, bubbles: true, cancelable: true};"
        " const event = (kind) => new DragEvent(kind, more);"
        " document.body.dispatchEvent(event('dragover'));"
        " document.body.dispatchEvent(event('drop')); })()"
    )


def put(page, name, value):
    page.ask(
        f"(() => {{ const one = document.getElementById('{name}'); one.value = {json.dumps(value)};"
        " one.dispatchEvent(new Event('input')); })()"
    )


def test_a_table_of_poses_is_played_to_its_end(page, folder):
    choose(page, folder / "poses.csv")
    await_text(page, "row", "row 1 of 40")
    assert "0.000 s" in text(page, "row")
    put(page, "at", 7)
    assert distance(page, TRUE[7]) < 1e-6
    put(page, "at", 5)
    assert "no pose: non finite; the mirror is drawn where it was" in text(page, "row")
    put(page, "at", 0)
    page.ask(
        "document.getElementById('speed').value = '10'; document.getElementById('run').click()"
    )
    await_text(page, "row", "row 40 of 40")
    assert page.ask("document.getElementById('run').textContent") == "Play"
    page.ask("document.getElementById('shut').click()")
    assert page.ask("document.getElementById('player').hidden")


def test_a_dropped_table_of_readings_is_solved_row_by_row(page, folder):
    drop(page, "readings.csv", (folder / "readings.csv").read_text("utf-8"))
    await_text(page, "row", "row 1 of 40")
    assert "made with the configuration bench; this page shows paper" in text(page, "news")
    for n in (3, 17):
        put(page, "at", n)
        wanted = facets.solve(PAPER, facets.readings(PAPER, TRUE[n : n + 1])).state[0]
        assert distance(page, wanted) < 1e-9
        assert "solved from its readings" in text(page, "row")
    put(page, "at", 5)
    assert "no pose: " in text(page, "row")
    cells = page.ask(
        "[...document.querySelectorAll('[data-reading]')].map((one) => one.textContent)"
    )
    assert set(cells) == {"lost"}


BAD = {
    "": "The file is empty",
    "a,b\n1,2\n": "neither all columns of a pose (tx_mm, ",
    f"{POSE[:-9]}\n1,2,3,4,5\n": "For a pose it lacks yaw_mrad",
    f"# x\n{POSE}\n# y\n1,2,3,4,5,6\n1,2,3,4,5,?\n": "Line 5, column yaw_mrad: “?” is",
    f"{POSE}\n1,2,3,4,5,6\n\n1,2,3": "Line 4 has 3 values; the first line names 6 columns",
    f"{POSE}\r\n1,2,3,4,5,6\r\n1,2,3,4,5,0x5\r\n": "Line 3, column yaw_mrad",
    f"{POSE.replace(',', ';')}\n1;2;3;4;5;0,5\n": "“0,5” is not a number",
    f'{POSE},s\n1,2,3,4,5,6,"\n': "a quotation mark is not closed",
    f"{POSE}\n": "column names, but no rows",
    "PAR1\x00": "This is Parquet",
    "PK\x03\x04": "a workbook or an archive",
}


def test_a_file_that_cannot_be_read_says_why_and_nothing_is_lost(page, folder):
    drop(page, "poses.csv", (folder / "poses.csv").read_text("utf-8"))
    await_text(page, "row", "poses.csv: row 1")
    put(page, "at", 9)
    before = page.ask("page.state()"), text(page, "row")
    for content, words in BAD.items():
        drop(page, "bad.csv", content)
        await_text(page, "news", words)
        assert text(page, "news").startswith("bad.csv: ")
        assert text(page, "news").endswith("What was shown is kept.")
        assert (page.ask("page.state()"), text(page, "row")) == before
    page.ask("page.take([new File([new Uint8Array([255, 254, 0, 65])], 'b.bin')])")
    assert "not text in UTF-8" in text(page, "news")


def test_a_known_beam_is_where_the_table_of_readings_says(page):
    state = np.array([0.05, -0.02, 0.1, 0.002, -0.001, 0.003, 0.04, -0.03])
    values = ",".join(map(repr, facets.readings(PAPER, state).tolist()))
    names = ",".join((*READING_COLUMNS, *STATE_COLUMNS[6:]))
    put(page, "estimate-beam", "known")
    drop(page, "beam.csv", f"{names}\n{values},0.04,-0.03\n{values},,\n")
    await_text(page, "row", "beam.csv: row 1")
    assert distance(page, state) < 1e-9
    put(page, "at", 1)
    assert "no pose: the table does not say where the known beam was" in text(page, "row")
    drop(page, "guess.csv", f"{names},u_bx_mm\n{values},0.04,-0.03,0.001\n")
    await_text(page, "row", "guess.csv: row 1")
    assert "the table does not say where the known beam was" in text(page, "row")
    page.ask("PAGE.offset = [0.01, 0.02]")  # of a configuration's solve.beam_offset_um
    drop(page, "beam.csv", f"{names}\n{values},0.03,-0.05\n")
    await_text(page, "row", "beam.csv: row 1")
    assert distance(page, state) < 1e-9
    page.ask("PAGE.offset = [0, 0]")
    put(page, "estimate-beam", "free")


def test_readings_that_are_typed_are_solved(page):
    state = np.array([0.05, -0.02, 0.1, 0.002, -0.001, 0.003, 0, 0])
    values = facets.readings(PAPER, state)
    put(page, "own-text", " ".join(map(repr, values.tolist())))
    assert "Solved in " in text(page, "own-said")
    solution = facets.solve(PAPER, values[None])
    assert distance(page, solution.state[0]) < 1e-9
    assert text(page, "source") == "your own"
    put(page, "estimate-beam", "known")  # the knowledge of the page's other solved pose, too
    put(page, "own-text", " ".join(map(repr, (values + 1e-3).tolist())))
    solution = facets.solve(PAPER, values[None] + 1e-3, beam="known")
    assert distance(page, solution.state[0]) < 1e-9
    put(page, "estimate-beam", "free")
    before = page.ask("page.state()")
    for typed, words in (
        ("1 2 3", "3 of 9 numbers"),
        ("1 2 3 4 5 6 7 8 9 10", "10 of 9 numbers"),
        ("1 2 x", "“x” is not a number"),
        ("0 0 0 0 0 0 0 0 0", "No pose: "),
    ):
        put(page, "own-text", typed)
        assert words in text(page, "own-said")
        assert page.ask("page.state()") == before
    lines = [",".join(READING_COLUMNS), ",".join(map(repr, values.tolist()))]
    put(page, "own-text", "\n".join(lines))
    assert "pasted table: row 1 of 1" in text(page, "row")
    shown = np.array(page.ask("page.state()"))
    assert np.allclose(shown / STATE_UNITS, state / STATE_UNITS, atol=1e-8)
