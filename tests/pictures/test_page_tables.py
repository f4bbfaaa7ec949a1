"""Numbers from outside on the rig's page: typed readings, tables that are dropped and played."""

import json

import numpy as np
import pytest
from commands import command
from sensors import states

import facets
from facets.core import READING_COLUMNS, STATE_COLUMNS

pytestmark = pytest.mark.slow
PAPER = facets.Sensor()
TRUE = states(40, seed=8, offset=0.1, angle=0.004)
POSE = ",".join(STATE_COLUMNS[:6])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Readings with a time and a row without light; and the poses that facets solves."""
    import pandas as pd

    folder = tmp_path_factory.mktemp("tables")
    table = pd.DataFrame(facets.readings(PAPER, TRUE), columns=READING_COLUMNS)
    table.loc[5] = np.nan
    table.insert(0, "time_s", 0.01 * np.arange(40))
    (folder / "readings.csv").write_text("# config: bench\n" + table.to_csv(index=False), "utf-8")
    assert command("solve", "paper", "readings.csv", "-o", "poses.csv", cwd=folder).returncode < 2
    return folder


def await_text(flat, name, words):
    flat.await_true(f"document.getElementById('{name}').textContent.includes({json.dumps(words)})")


def distance(flat, state):
    """The largest difference of the page's state from another, mm and rad."""
    return np.abs(np.array(flat.ask("page.state()")) - state).max()


def choose(flat, path):
    """Choose a file by the page's button, as a person does."""
    root = flat.send("DOM.getDocument")["root"]["nodeId"]
    node = flat.send("DOM.querySelector", nodeId=root, selector="#file")["nodeId"]
    flat.send("DOM.setFileInputFiles", nodeId=node, files=[str(path)])


def drop(flat, name, content):
    flat.ask(
        "(() => { const data = new DataTransfer();"
        f" data.items.add(new File([{json.dumps(content)}], {json.dumps(name)}));"
        " const more = {dataTransfer: data, bubbles: true, cancelable: true};"
        " const event = (kind) => new DragEvent(kind, more);"
        " document.body.dispatchEvent(event('dragover'));"
        " document.body.dispatchEvent(event('drop')); })()"
    )


def test_a_table_of_poses_is_played_to_its_end(flat, folder):
    choose(flat, folder / "poses.csv")
    await_text(flat, "row", "row 1 of 40")
    assert "0.000 s" in flat.text_of("row")
    flat.put("at", 7)
    assert distance(flat, TRUE[7]) < 1e-6
    flat.put("at", 5)
    assert "no pose: non finite; the mirror is drawn where it was" in flat.text_of("row")
    flat.put("at", 0)
    flat.ask(
        "document.getElementById('speed').value = '10'; document.getElementById('run').click()"
    )
    await_text(flat, "row", "row 40 of 40")


def test_a_dropped_table_of_readings_is_solved_row_by_row(flat, folder):
    drop(flat, "readings.csv", (folder / "readings.csv").read_text("utf-8"))
    await_text(flat, "row", "row 1 of 40")
    assert "made with the configuration bench; this page shows paper" in flat.text_of("news")
    for n in (3, 17):
        flat.put("at", n)
        wanted = facets.solve(PAPER, facets.readings(PAPER, TRUE[n : n + 1])).state[0]
        assert distance(flat, wanted) < 1e-9
        assert "solved from its readings" in flat.text_of("row")
    flat.put("at", 5)
    assert "no pose: " in flat.text_of("row")
    cells = "[...document.querySelectorAll('[data-reading]')].map((one) => one.textContent)"
    assert set(flat.ask(cells)) == {"lost"}


BAD = {
    "": "The file is empty",
    "a,b\n1,2\n": "neither all columns of a pose (tx_mm, ",
    f"{POSE[:-9]}\n1,2,3,4,5\n": "For a pose it lacks yaw_mrad",
    f"# x\n{POSE}\n# y\n1,2,3,4,5,6\n1,2,3,4,5,0x5\n": "Line 5, column yaw_mrad: “0x5” is",
    f"{POSE}\n1,2,3,4,5,6\n\n1,2,3": "Line 4 has 3 values; the first line names 6 columns",
    f"{POSE.replace(',', ';')}\n1;2;3;4;5;0,5\n": "“0,5” is not a number",
    f'{POSE},s\n1,2,3,4,5,6,"\n': "a quotation mark is not closed",
    f"{POSE}\n": "column names, but no rows",
    "PK\x03\x04": "a workbook or an archive",
}


def test_a_file_that_cannot_be_read_says_why_and_nothing_is_lost(flat, folder):
    drop(flat, "poses.csv", (folder / "poses.csv").read_text("utf-8"))
    await_text(flat, "row", "poses.csv: row 1")
    flat.put("at", 9)
    before = flat.ask("page.state()"), flat.text_of("row")
    for content, words in BAD.items():
        drop(flat, "bad.csv", content)
        await_text(flat, "news", words)
        assert flat.text_of("news").startswith("bad.csv: ")
        assert (flat.ask("page.state()"), flat.text_of("row")) == before
    flat.ask("page.take([new File([new Uint8Array([255, 254, 0, 65])], 'b.bin')])")
    assert "not text in UTF-8" in flat.text_of("news")


def test_a_known_beam_is_where_the_table_of_readings_says(flat):
    state = np.array([0.05, -0.02, 0.1, 0.002, -0.001, 0.003, 0.04, -0.03])
    values = ",".join(map(repr, facets.readings(PAPER, state).tolist()))
    names = ",".join((*READING_COLUMNS, *STATE_COLUMNS[6:]))
    flat.put("estimate-beam", "known")
    drop(flat, "beam.csv", f"{names}\n{values},0.04,-0.03\n{values},,\n")
    await_text(flat, "row", "beam.csv: row 1")
    assert distance(flat, state) < 1e-9
    unknown = "the table does not say where the known beam was"
    flat.put("at", 1)
    assert unknown in flat.text_of("row")
    drop(flat, "guess.csv", f"{names},u_bx_mm\n{values},0.04,-0.03,0.001\n")
    await_text(flat, "row", "guess.csv: row 1")
    assert unknown in flat.text_of("row")
    flat.ask("PAGE.offset = [0.01, 0.02]")  # of a configuration's solve.beam_offset_um
    drop(flat, "beam.csv", f"{names}\n{values},0.03,-0.05\n")
    await_text(flat, "row", "beam.csv: row 1")
    assert distance(flat, state) < 1e-9
    flat.ask("PAGE.offset = [0, 0]")
    flat.put("estimate-beam", "free")


def test_readings_that_are_typed_are_solved(flat):
    values = facets.readings(PAPER, TRUE[0]).tolist()
    state = facets.solve(PAPER, values).state
    flat.put("own-text", " ".join(map(repr, values)))
    assert "Solved in " in flat.text_of("own-said")
    assert distance(flat, state) < 1e-9
    assert flat.text_of("source") == "your own"
    for typed, words in (
        ("1 2 3", "3 of 9 numbers"),
        ("1 2 x", "“x” is not a number"),
        ("0 0 0 0 0 0 0 0 0", "No pose: "),
    ):
        flat.put("own-text", typed)
        assert words in flat.text_of("own-said")
        assert distance(flat, state) < 1e-9
    flat.put("own-text", f"{','.join(READING_COLUMNS)}\n{','.join(map(repr, values))}")
    assert "pasted table: row 1 of 1" in flat.text_of("row")
    assert distance(flat, state) < 1e-9
