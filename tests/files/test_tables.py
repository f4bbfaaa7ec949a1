"""Tables: every row accounted for, every file whole or absent."""

import subprocess
import sys

import numpy as np
import pytest

from facets import InputError, OutputError
from facets.files import tables

pytestmark = pytest.mark.installed


def read(path, needed=("a", "b"), optional=(), rows=1000):
    chunks = list(tables.read_chunks(path, needed, optional, rows))
    columns = {
        name: np.concatenate([c.columns[name] for c in chunks]) for name in chunks[0].columns
    }
    lines = np.concatenate([c.lines for c in chunks])
    bad = np.concatenate([c.unparsable for c in chunks])
    return columns, lines.tolist(), lines[bad].tolist()


@pytest.fixture
def write(tmp_path):
    """Writes text or bytes to `t.csv`, or a file of another name."""

    def write(content, name="t.csv"):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write


@pytest.mark.parametrize("rows", [1, 3, 1000])
def test_broken_rows_are_found_at_their_lines_and_never_read_as_data(write, rows):
    path = write(
        '# a comment\n\na,b\n1,2\n\n# another\nx,3\n4,5,6\n7\n8,"9\n10,11\n,12\nnan,13\n14,1'
    )
    columns, lines, bad = read(path, rows=rows)
    assert lines == [4, 7, 8, 9, 10, 11, 12, 13, 14]
    assert bad == [7, 8, 9, 10]
    assert np.isnan(columns["b"][1:5]).all()
    assert columns["b"][5:].tolist() == [11, 12, 13, 1]
    assert np.isnan(columns["a"][6:8]).all()


@pytest.mark.parametrize(
    ("raw", "good", "lines"),
    [
        ("b,other,a\n2,x,1\n4,y,3\n", [1, 3], []),
        ("a,b,c\n1,2,3\n4,5", [1], [3]),  # the last row is cut in a column
        ('"a"\t"b"\n"1.5"\t2\n3\t"-4e1"\n5\t"x"\n', [1.5, 3], [4]),
        (b"a,b\n1,2\n\xff\xfe\x00,3\n4,5\n", [1, 4], [3]),
        ("a,b\n1,2\n1_0,3\n4,5\n", [1, 4], [3]),
        ("a,b\n1,2\n0x10,3\n4,5\n", [1, 4], [3]),
    ],
)
def test_what_is_no_number_is_a_broken_row(write, raw, good, lines):
    path = write(raw)
    columns, _, bad = read(path)
    assert columns["a"][np.isfinite(columns["a"] + columns["b"])].tolist() == good
    assert bad == lines
    if lines == [3]:
        with pytest.raises(InputError, match=r"t\.csv:3: this row"):
            tables.read_numbers(path)


@pytest.mark.parametrize("beside", ["word", "4"])
@pytest.mark.parametrize("mark", [",", ";", "."])
@pytest.mark.parametrize("size", [1, 30, 100_000])
def test_a_number_is_the_same_in_a_block_of_any_lines(write, monkeypatch, size, mark, beside):
    monkeypatch.setattr(tables, "BLOCK_BYTES", size)
    cells = {
        "1": 1, "-0": -0.0, "-0e1": -0.0, "1e400": np.inf, "-Infinity": -np.inf, "+7": 7,
        "": np.nan, "nan": np.nan, " 007 ": 7, '"2"': 2, "9007199254740993": 2.0**53,
        "5e-324": 5e-324, "-2e23": -2e23,
    }  # fmt: skip
    spoilt = ["1_0", "x", "0x1", "1d5", "true", "[1]", "1 2", "\u0661", f"1{mark}2"]
    rows = [mark.join([str(n), cell, beside]) for n, cell in enumerate([*cells, *spoilt, "3"])]
    path = write("\r\n".join(["sep=" + mark, mark.join("bac"), *rows, "4"]))
    columns, lines, bad = read(path)
    assert lines == list(range(3, 4 + len(rows)))
    first = 3 + len(cells)
    assert bad == [*range(first, first + len(spoilt)), lines[-1]]
    expected = np.array([*cells.values(), *(np.nan for _ in spoilt), 3, np.nan])
    np.testing.assert_array_equal(columns["a"], expected)
    np.testing.assert_array_equal(np.signbit(columns["a"]), np.signbit(expected))
    assert read(write("a\n\n2\n"), ["a"])[1] == [3]
    assert read(write("a,b\n1,2\n3"), ["a"])[2] == [3]


def test_quotes_are_the_same_to_each_reader_and_swallow_no_lines(write):
    path = write('a,b\n0,"1\n1,2\n2,"3\n')
    columns, _, bad = read(path)
    assert (columns["b"][1], bad) == (2, [2, 4])
    whole = tables.read_columns(path)
    assert whole["a"].tolist() == [0, 1, 2]
    assert whole["b"].tolist() == tables.read_words(path, "b") == ['"1', "2", '"3']
    path = write('a;b\n"0.1"; "x y"\n"2" ;"z"\n"";""\n')
    columns = tables.read_columns(path)
    np.testing.assert_array_equal(columns["a"], [0.1, 2, np.nan])
    assert columns["b"].tolist() == tables.read_words(path, "b") == ["x y", "z", ""]


def test_a_ragged_row_is_named_by_its_line_in_the_file(write):
    path = write("# seed: 1\n\na,b\n1,2\n\n# more\n3,4,5\n")
    with pytest.raises(InputError, match="csv:7: this row has 3 cells, and the header in line 3 h"):
        tables.read_columns(path)


@pytest.mark.parametrize(
    "raw",
    [
        b"\xef\xbb\xbfa,b\n1,2\n",
        b"a,b\r\n1,2\r\n",
        b"a;b\n1;2\n",
        b'"a","b"\n1,2\n',
        b" a, b \n 1, 2 \n",
        b"a,b\n1,2,\n",
        b"a,b,,\r\n1,2,,, \r\n",
        b"sep=;\r\na;b\r\n1;2;\r\n",
        b'\xef\xbb\xbf"sep=|"\na|b\n1|2\n',
    ],
    ids=[
        "byte order mark",
        "CRLF",
        "semicolons",
        "quoted names",
        "blanks",
        "comma at the end",
        "commas at the end",
        "sep=;",
        "sep=|",
    ],
)
def test_what_spreadsheets_make_of_csv(write, raw):
    columns, _, bad = read(write(raw))
    assert bad == []
    assert columns["a"].tolist() == [1]
    assert columns["b"].tolist() == [2]
    whole = tables.read_columns(write(raw))
    assert {name: values.tolist() for name, values in whole.items()} == {"a": [1], "b": [2]}
    assert tables.read_numbers(write(raw))[1].tolist() == [[1, 2]]


@pytest.mark.parametrize(
    ("raw", "says"),
    [
        ("a,b\n1,2\n".encode("utf-16"), "is UTF-16 text; save it as UTF-8"),
        (b"PK\x03\x04 and more", "a spreadsheet or an archive"),
        (b"PAR1 and more", "is a Parquet table; name it .parquet"),
        (b"a,b\n12:00:01,2\n12:00:02,3\n", r"t\.csv:2: column a holds '12:00:01', not a number"),
        (b"a;b\n1,5;2\n2,5;3\n", "column a holds '1,5', not a number; write decimals after a p"),
        ("# seed: 1\nReport of today\na,b\n1,2\n", "in line 2: .*found: Report of today"),
        ("a,b\n1,2,3\n4,5,6\n", r"t\.csv:2: this row has 3 cells, and the header in line 1 has 2"),
    ],
)
def test_what_is_no_table_of_numbers_is_named(write, raw, says):
    path = write(raw)
    with pytest.raises(InputError, match=says):
        read(path)


@pytest.mark.parametrize("ending", tables.ENDINGS)
def test_values_in_another_unit_are_missing_and_a_column_of_them_is_refused(tmp_path, ending):
    path = tmp_path / f"t{ending}"
    broken = {"temperature_c": [20.0, 293.15, np.nan, 21.0, np.inf], "seq_c": [1e3] * 5}
    tables.write_table(path, broken, {})
    columns, _, _ = read(path, broken)
    np.testing.assert_array_equal(columns["temperature_c"], [20.0, np.nan, np.nan, 21.0, np.nan])
    np.testing.assert_array_equal(columns["seq_c"], broken["seq_c"])
    tables.write_table(path, {"temperature_c": [np.nan, 293.15, 294.0]}, {})
    with pytest.raises(InputError, match=r"e_c holds 293\.15; plausible: -60 to 150 degC"):
        read(path, ("temperature_c",))


def test_a_parquet_column_that_holds_no_numbers_is_named(tmp_path):
    import pyarrow as pa
    import pyarrow.parquet as pq

    for column, says in (([[1.0]], "column a holds list"), (["1"], "column a holds string")):
        pq.write_table(pa.table({"a": column, "b": [1.0]}), tmp_path / "t.parquet")
        with pytest.raises(InputError, match=says):
            read(tmp_path / "t.parquet")


@pytest.mark.parametrize("length", [40, -1, 0])
def test_a_damaged_parquet_table_is_refused_by_each_reader(tmp_path, length):
    path = tmp_path / "t.parquet"
    tables.write_table(path, {"a": np.arange(99.0)}, {})
    data = path.read_bytes()
    path.write_bytes(data[:length] if length else data[:-20] + b"\xff" * 12 + data[-8:])
    for use in (tables.column_names, tables.read_frame, lambda path: read(path, ["a"])):
        with pytest.raises(InputError, match=r"t\.parquet: cannot be read as a Parquet table"):
            use(path)


def test_other_bad_files_are_named(tmp_path, write):
    for path, says in (
        (tmp_path / "none.csv", r"none\.csv: no such file"),
        (tmp_path, "is a folder, not a table"),
        (write("a,b\n", "t.txt"), r"ends in \.csv, \.csv\.gz, \.parquet, \.h5 or \.tdms"),
        (write("a,b\n", "t.parquet"), "not a Parquet table"),
        (write("", "t.h5"), r"t\.h5: is empty"),
        (write("psi_a_mm,b,c,b\n", "twice.csv"), "appear twice: b"),
        (write("psi_a,b\n1,2\n"), r"missing columns: psi_a_mm, c; did you mean 'psi_a'"),
        (
            write("psi_a_um,b\n1,2\n", "um.csv"),
            r"psi_a_mm, c; psi_a_um has another unit: convert it to mm",
        ),
    ):
        with pytest.raises(InputError, match=says):
            read(path, ("psi_a_mm", "b", "c"))


@pytest.mark.parametrize("ending", tables.ENDINGS)
def test_what_is_written_is_read_back_to_the_bit(tmp_path, ending):
    path = tmp_path / f"t{ending}"
    a = np.array([0.1, -1e-300, 5e300, np.nan, 1 / 3])
    words = ["x y", "ü", "", "x y", "日"]
    tables.write_table(path, {"a": a, "word": np.array(words), "b": a * 2}, {"seed": "1"})
    assert tables.read_words(path, "word") == words
    columns, lines, bad = read(path, rows=2)
    assert bad == []
    assert lines == list(range(3, 8) if ending.startswith(".csv") else range(1, 6))
    np.testing.assert_array_equal(columns["a"], a)
    np.testing.assert_array_equal(columns["b"], a * 2)
    assert list(tmp_path.iterdir()) == [path]


def test_each_cell_is_written_in_its_place(tmp_path):
    numbers = np.arange(2500) / 4
    columns = {
        "a": numbers, "b": np.where(numbers == 1, np.nan, -numbers), "n": np.arange(2500),
        "w": np.array(["x", "]"])[np.arange(2500) % 2], "is": numbers > 3,
        "i": np.where(numbers == 2, np.inf, numbers),
    }  # fmt: skip
    tables.write_table(tmp_path / "t.csv", columns, {})
    header, *lines = (tmp_path / "t.csv").read_text().splitlines()
    assert header == "a,b,n,w,is,i"
    for row, line in zip(zip(*columns.values(), strict=True), lines, strict=True):
        assert line == ",".join(map(str, row)).replace("True", "true").replace("False", "false")


def test_a_damaged_compressed_table_is_named(tmp_path):
    path, plain = tmp_path / "t.csv.gz", tmp_path / "t.csv"
    tables.write_table(path, {"a": np.random.default_rng(1).random(9999)}, {"seed": "1"})
    assert tables.read_head(path) == {"seed": "1"}
    plain.write_bytes(path.read_bytes())
    with pytest.raises(InputError, match=r"is compressed; name it \.csv\.gz"):
        read(plain, ["a"])
    for content, says in ((path.read_bytes()[:-999], "ended before"), (b"a\n", "Not a gzipped")):
        path.write_bytes(content)
        with pytest.raises(InputError, match=rf"t\.csv\.gz: cannot be read: .*{says}"):
            read(path, ["a"])


def test_a_dash_is_the_standard_input_and_output(tmp_path):
    code = (
        "from pathlib import Path\n"
        "from facets.files import tables\n"
        "(chunk,) = tables.read_chunks(Path('-'), ['a'], ['b'])\n"
        "tables.write_table(Path('-'), chunk.columns, {'seed': '1'})\n"
    )
    words = [sys.executable, "-c", code]
    done = subprocess.run(words, cwd=tmp_path, input=b"b,a\n1,2\n", stdout=-1, check=True)
    assert done.stdout == b"# seed: 1\na,b\n2.0,1.0\n"
    assert list(tmp_path.iterdir()) == []


def test_a_table_says_how_it_was_made_and_parquet_the_units(tmp_path):
    import pyarrow.parquet as pq

    about = {"command": "facets\nsolve", "seed": "3"}
    columns = {"v_tx_mm_s": [1.0], "u_yaw_urad": [2.0], "status": np.array(["a"])}
    for name in ("t.csv", "t.parquet"):
        tables.write_table(tmp_path / name, columns, about)
    text = (tmp_path / "t.csv").read_text()
    assert text.startswith(
        "# command: facets solve\n# seed: 3\nv_tx_mm_s,u_yaw_urad,status\n1.0,2.0,"
    )
    schema = pq.read_schema(tmp_path / "t.parquet")
    assert schema.metadata[b"seed"] == b"3"
    units = [schema.field(name).metadata for name in columns]
    assert units == [{b"unit": b"mm/s"}, {b"unit": b"urad"}, None]


def test_a_place_that_can_not_be_written_is_refused_before_the_work(tmp_path, write):
    path = write("old")
    (tmp_path / "folder").mkdir()
    for place, says in (
        (path / "t.csv", "is a file; name another folder"),
        (tmp_path / "folder", "is a folder; name a file"),
        (tmp_path / ("n" * 300) / "t.csv", "File name too long"),
    ):
        with pytest.raises(OutputError, match=says):
            tables.refuse_to_overwrite([place], force=True)
    with pytest.raises(OutputError, match="exists already; use --force"):
        tables.refuse_to_overwrite([path], force=False)
    tables.refuse_to_overwrite([path], force=True)
    tables.refuse_to_overwrite([tmp_path / "a" / "b" / "t.csv"], force=False)
    assert sorted(tmp_path.iterdir()) == [tmp_path / "folder", path]


@pytest.mark.parametrize(
    ("name", "half", "whole"),
    [
        ("t.gltf", b'{"a": [1, 2', b'{"a": [1, 2]}'),
        ("t.svg", b"<svg><path", b"<svg></svg>\n"),
        ("t.html", b"<html><body>", b"<html></html>\n"),
        ("t.gif", b"GIF89a...", b"GIF89a...;"),
        ("t.mp4", b"\0\0\0\x0cftypisom\0\0\0\x20mdat", b"\0\0\0\x0cftypisom\0\0\0\x08moov"),
        ("t.png", b"\x89PNG", b"\x89PNG\0\0\0\0IEND\xaeB`\x82"),
    ],
)
def test_a_file_that_was_cut_off_does_not_get_its_name(tmp_path, name, half, whole):
    path = tmp_path / name

    def write(data):
        with tables.Whole(path) as temporary:
            temporary.write_bytes(data)

    with pytest.raises(OutputError, match="it was cut off; is the disk full"):
        write(half)
    assert list(tmp_path.iterdir()) == []
    write(whole)
    assert path.read_bytes() == whole


def test_a_file_is_on_the_disk_before_it_has_its_name(tmp_path, monkeypatch):
    import os

    path, seen = tmp_path / "t.csv", []
    monkeypatch.setattr(os, "fsync", lambda handle: seen.append(path.exists()))
    with tables.Whole(path) as temporary:
        temporary.write_text("a\n")
    assert seen == [False, True]  # the file, then the folder that has its name
