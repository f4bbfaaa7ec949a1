"""Tables that LabVIEW wrote."""

import numpy as np
import pytest
from nptdms import ChannelObject, RootObject, TdmsWriter

from facets import InputError
from facets.files import tables

WAVE = {"wf_increment": 0.25, "wf_start_offset": 1.0}


def write(path, *channels):
    with TdmsWriter(path) as file:
        for part in range(2):  # LabVIEW writes in segments
            objects = [
                ChannelObject("group", name, values[3 * part : 3 * part + 3], about)
                for name, values, about in channels
            ]
            file.write_segment([RootObject({"author": "lab"}), *objects])
    return path


def test_channels_are_columns_with_units_and_times(tmp_path):
    force, place = np.arange(5.0), np.arange(5) / 8
    path = write(
        tmp_path / "t.tdms",
        ("Drive Force", force, {"unit_string": "N"}),
        ("ref_tx_mm", place, WAVE),
    )
    chunks = list(tables.read_chunks(path, ["ref_tx_mm"], ["time_s"], rows=2))
    assert [len(chunk.lines) for chunk in chunks] == [2, 2, 1]
    time = np.concatenate([chunk.columns["time_s"] for chunk in chunks])
    assert time.tolist() == [1.0, 1.25, 1.5, 1.75, 2.0]
    frame = tables.read_frame(path)
    assert list(frame) == ["time_s", "drive_force_n", "ref_tx_mm"]
    assert frame.drive_force_n.tolist() == force.tolist()
    assert frame.attrs["author"] == "lab"


def test_what_is_no_table_is_named(tmp_path):
    five, two = np.arange(5.0), np.arange(2.0)
    for channels, says in (
        ([("a", five, {}), ("b", two, {})], r"differ in length \(a 5, b 2\)"),
        ([("a", five, {}), ("A", five, {})], "two channels give the same column"),
        ([("a", np.array(list("vwxyz")), {})], "column a holds object, not numbers"),
        ([("b", five, {})], "missing columns: a"),
    ):
        with pytest.raises(InputError, match=says):
            list(tables.read_chunks(write(tmp_path / "t.tdms", *channels), ["a"]))
    (tmp_path / "t.tdms").write_text("a\n1\n")
    with pytest.raises(InputError, match="not a TDMS file"):
        list(tables.read_chunks(tmp_path / "t.tdms", ["a"]))
    with pytest.raises(InputError, match=r"name ends in \.csv, \.csv\.gz, \.parquet or \.h5"):
        tables.write_table(tmp_path / "new.tdms", {"a": five}, {})
