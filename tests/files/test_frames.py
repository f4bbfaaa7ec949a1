"""Tables as data frames, and what other programs get of them."""

import numpy as np
import pandas as pd
import pytest

import facets
from facets import InputError
from facets.files import tables

ABOUT = {"config": "paper", "unit of load": "kN"}
COLUMNS = {
    "time_s": np.array([0.0, 0.5, 1.0]),
    "seq": np.array([1, 2, 2**60 + 1]),
    "tz_mm": np.array([0.1, np.nan, 1 / 3]),
    "load": np.array([1.0, 2.0, 3.0]),
    "status": np.array(["converged", "", "no light"]),
}


@pytest.mark.parametrize("ending", tables.ENDINGS)
def test_a_table_of_each_format_is_the_same_frame(tmp_path, ending):
    tables.write_table(tmp_path / f"t{ending}", COLUMNS, ABOUT)
    frame = facets.read_table(tmp_path / f"t{ending}")
    for name, values in COLUMNS.items():
        np.testing.assert_array_equal(frame[name].to_numpy(values.dtype), values)
    units = {"time_s": "s", "tz_mm": "mm", "load": "kN"}
    assert frame.attrs == {**ABOUT, "units": units}


def test_what_is_no_number_in_a_column_of_numbers_is_missing(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("# seed: 1\na;word\n1;x\n# a comment\noops;y\n3\n")
    frame = facets.read_table(str(path))
    np.testing.assert_array_equal(frame.a, [1, np.nan, 3])
    assert frame.word.tolist() == ["x", "y", ""]


def test_frames_are_read_as_tables_are():
    frame = pd.DataFrame({"a": [1, 2, 3], "temperature_c": [20, 293.15, None], "w": list("xyz")})
    table = tables.FrameTable(frame)
    first, second = tables.read_chunks(table, ["a"], ["temperature_c"], rows=2)
    np.testing.assert_array_equal(first.columns["temperature_c"], [20, np.nan])
    assert second.lines.tolist() == [3]
    assert tables.read_words(table, "w") == ["x", "y", "z"]
    for name, says in (("w", "column w holds"), ("z", "the data frame: missing columns: z")):
        with pytest.raises(InputError, match=says):
            list(tables.read_chunks(table, [name]))


def test_an_index_with_a_name_is_a_column():
    frame = pd.DataFrame({"time_s": [0.0, 0.5, 1.0], "run": 1, "tz_mm": [1.0, 2.0, 3.0]})
    for names in ("time_s", ["run", "time_s"]):
        table = frame.set_index(names)
        (chunk,) = tables.read_chunks(tables.FrameTable(table), ["time_s", "tz_mm"])
        assert chunk.columns["time_s"].tolist() == [0.0, 0.5, 1.0]
        assert facets.to_sep005(table)[0]["fs"] == 2.0
        assert table.index.names == np.atleast_1d(names).tolist()
    assert facets.to_xarray(frame.set_index("time_s")).tz_mm.dims == ("time_s",)


def test_signals_of_sep005_have_one_rate_or_times():
    sep005 = pytest.importorskip("sdypy_sep005")
    even = pd.DataFrame({"board_us": [0, 333, 667, 1000], "tz_mm": 1.0, "status": "x"})
    even.attrs["recorded"] = "2026-11-26T06:00:00+00:00"
    (signal,) = facets.to_sep005(even)
    checked = sep005.Sep005Data.model_validate(signal)
    assert (checked.name, checked.unit_str, checked.fs) == ("tz_mm", "mm", pytest.approx(3000))
    assert checked.start_timestamp == even.attrs["recorded"]
    (signal,) = facets.to_sep005(even.drop(index=1))
    assert sep005.Sep005Data.model_validate(signal).time == [0, 667e-6, 1e-3]
    with pytest.raises(InputError, match="no column of times; needed: time_s or board_us"):
        facets.to_sep005(even[["tz_mm"]])


TIMES = {
    "datetime": pd.date_range("2026-01-01", periods=3, freq="s"),
    "with a zone": pd.date_range("2026-01-01", periods=3, freq="s", tz="UTC"),
    "timedelta": pd.to_timedelta([0, 1, 2], unit="s"),
    "objects": pd.Series([np.timedelta64(n, "s") for n in range(3)], dtype=object),
    "text": ["0.0", "0.5", "1.0"],
}


@pytest.mark.parametrize("kind", TIMES)
def test_dates_durations_and_text_are_not_taken_for_seconds(kind):
    frame = pd.DataFrame({"time_s": TIMES[kind], "tz_mm": 1.0})
    uses = [facets.to_sep005]
    if kind != "text":
        uses.append(lambda frame: list(tables.read_chunks(tables.FrameTable(frame), ["time_s"])))
    for use in uses:
        with pytest.raises(InputError, match=r"column time_s holds .*, not numbers; give seconds"):
            use(frame)


def test_signals_of_sep005_are_all_numbers_but_the_times():
    frame = pd.DataFrame({"time_s": [0.0, 1.0], "host_s": 0.0, "utc_s": 0.0, "wait_us": [1, 2]})
    frame = frame.assign(flow_l_s=[1.0, 2.0], word_mm=["a", "b"], digits_mm=["1", "2"])
    frame["count_mm"] = pd.array([1, None], dtype="Int64")
    signals = {signal["name"]: signal for signal in facets.to_sep005(frame)}
    assert list(signals) == ["wait_us", "flow_l_s", "count_mm"]
    np.testing.assert_array_equal(signals["count_mm"]["data"], [1, np.nan])


def test_names_that_a_dataset_cannot_have_are_refused():
    pytest.importorskip("xarray")
    frame = pd.DataFrame({"tz_mm": [1.0, 2.0], "row": [1.0, 2.0]})
    with pytest.raises(InputError, match="column row has the name of the dataset's dimension; ren"):
        facets.to_xarray(frame)
    assert "row" in facets.to_xarray(frame.assign(time_s=[0.0, 1.0]))
    twice = pd.DataFrame([[0.0, 1.0, 2.0]], columns=["time_s", "a_mm", "a_mm"])
    for use in (facets.to_xarray, facets.to_sep005):
        with pytest.raises(InputError, match="columns that appear twice: a_mm"):
            use(twice)


def test_a_dataset_of_xarray_has_units_and_provenance():
    pytest.importorskip("xarray")
    frame = pd.DataFrame({"tz_mm": [1.0, 2.0]}, index=[5, 6])
    frame.attrs = {"config": "paper", "units": {"tz_mm": "mm"}}
    data = facets.to_xarray(frame)
    assert (data.tz_mm.dims, data.tz_mm.units) == (("row",), "mm")
    assert data.row.values.tolist() == [5, 6]
    assert data.attrs == {"config": "paper"}
    timed = facets.to_xarray(frame.assign(time_s=[0.0, 1.0]))
    assert (timed.tz_mm.dims, timed.time_s.units) == (("time_s",), "s")
