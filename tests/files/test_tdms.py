"""Tables that LabVIEW wrote."""

from contextlib import suppress

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


@pytest.mark.parametrize(
    ("name", "unit", "column", "label"),
    [
        ("Torque", "Nm", "torque", "Nm"),
        ("Acc mm/s²", "mm/s^2", "acc_mm_s2", "mm/s^2"),
        ("Force N", "N", "force_n", "N"),
        ("Room °C", "degC", "room_c", "degC"),
        ("Angle °/s", "deg/s", "angle_deg_s", "deg/s"),
        ("Ratio", "1", "ratio", None),
    ],
)
def test_no_unit_is_invented(tmp_path, name, unit, column, label):
    """Which units a column's name ends with: tests of auxiliary channels."""
    path = write(tmp_path / "t.tdms", (name, np.arange(5.0), {"unit_string": unit}))
    frame = tables.read_frame(path)
    assert list(frame) == [column]
    assert frame.attrs["units"].get(column) == label


@pytest.mark.parametrize(("name", "unit"), [("Force N", "kN"), ("Torque Nm", "Nm"), ("a_mm", "1")])
def test_a_unit_that_contradicts_the_name_is_refused(tmp_path, name, unit):
    path = write(tmp_path / "t.tdms", (name, np.arange(5.0), {"unit_string": unit}))
    for use in (tables.column_names, tables.read_head, tables.read_frame):
        with pytest.raises(InputError, match=f"'{name}' has the unit_string '{unit}', but as"):
            use(path)


def test_waveforms_of_several_rates_or_starts_have_no_common_times(tmp_path):
    five, path = np.arange(5.0), tmp_path / "t.tdms"
    start = np.datetime64("2026-11-28T05:00:00.000000")
    begun = WAVE | {"wf_start_time": start}
    for first, other in (
        (WAVE, WAVE | {"wf_increment": 0.5}),
        (WAVE, WAVE | {"wf_start_offset": 0.0}),
        (begun, begun | {"wf_start_time": start + np.timedelta64(3, "ms")}),
        (begun, WAVE),  # which began when is not known
    ):
        for more in ([], [("time_s", five, {})]):
            write(path, ("a", five, first), ("b", five, other), *more)
            with pytest.raises(InputError, match=r"differ in wf_.* \(a .*, b .*\); save"):
                list(tables.read_chunks(path, ["a"]))
    write(path, ("a", five, WAVE | {"wf_xunit_string": "ms"}))
    with pytest.raises(InputError, match="'a' has wf_xunit_string 'ms'; allowed: s"):
        tables.read_frame(path)
    sooner = {"wf_start_time": start - np.timedelta64(500, "ms"), "wf_start_offset": 1.5}
    write(path, ("a", five, begun), ("b", five, WAVE | sooner))
    assert tables.column_names(path) == ["time_s", "a", "b"]
    write(path, ("a", five, WAVE), ("b", five, WAVE), ("c", five, {}))
    assert tables.column_names(path) == ["time_s", "a", "b", "c"]


def test_a_cut_or_empty_file_is_refused(tmp_path):
    path = write(tmp_path / "t.tdms", ("a", np.arange(5.0), {}), ("b", np.arange(5.0), {}))
    data = path.read_bytes()
    for length in (10, 40, len(data) // 2, len(data) - 60, len(data) - 8, len(data) - 1):
        path.write_bytes(data[:length])
        for use in (tables.column_names, tables.read_head, tables.read_frame):
            with pytest.raises(InputError, match="is cut off: the file ends within a segment"):
                use(path)
    with TdmsWriter(path) as file:
        file.write_segment([RootObject({"author": "lab"})])
    with pytest.raises(InputError, match="holds no channels"):
        tables.read_frame(path)


@pytest.mark.parametrize("value", [0, 0x0F, 0xFF])
def test_a_damaged_file_raises_no_other_error(tmp_path, value):
    path = write(tmp_path / "t.tdms", ("a", np.arange(5.0), WAVE | {"unit_string": "N"}))
    data = path.read_bytes()
    for place in range(4, len(data)):
        path.write_bytes(data[:place] + bytes([value]) + data[place + 1 :])
        with suppress(InputError), np.errstate(all="ignore"):
            tables.read_frame(path)
