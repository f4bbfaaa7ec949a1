"""Tables in HDF5: independent readers find numbers, units, axes and uncertainties."""

from itertools import pairwise

import h5py
import numpy as np
import pytest

import facets
from facets import POSE, InputError, OutputError
from facets.core import STATE_COLUMNS
from facets.files import tables

COUNT = 7
MATRICES = np.random.default_rng(1).random((COUNT, 6, 6))
MATRICES += MATRICES.transpose(0, 2, 1)
ABOUT = {
    "command": "facets solve",
    "config_sha256": "12ab",
    "configuration": '{"solve":{}}',
    "unit of force_n": "kN",
}


def make_columns():
    rng = np.random.default_rng(2)
    columns = {"time_s": 0.5 * np.arange(COUNT), "seq": np.arange(COUNT)}
    columns |= {name: rng.random(COUNT) for name in STATE_COLUMNS[:6]}
    columns |= {f"u_{name}": rng.random(COUNT) for name in STATE_COLUMNS[:6]}
    columns["status"] = np.array(["converged", "no light", "ü"] * 2 + ["converged"])
    places = {name: (i, j) for i in range(6) for j in range(i, 6) for name in [cov_name(i, j)]}
    columns |= {name: MATRICES[:, i, j] for name, (i, j) in places.items()}
    return columns | {"force_n": rng.random(COUNT)}


def cov_name(i, j):
    units = ["mm" if n < 3 else "mrad" for n in (i, j)]
    unit = f"{units[0]}2" if units[0] == units[1] else "_".join(units)
    return f"cov_{POSE[i]}_{POSE[j]}_{unit}"


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    """A table that was written in pieces of 3 rows."""
    path, columns = tmp_path_factory.mktemp("tables") / "poses.h5", make_columns()
    with tables.open_writer(path, ABOUT) as writer:
        for n in range(0, COUNT, 3):
            writer.write({name: values[n : n + 3] for name, values in columns.items()})
    return path


def test_nexusformat_finds_signal_axes_errors_units_and_logs(path):
    nexus = pytest.importorskip("nexusformat.nexus")
    root, columns = nexus.nxload(path), make_columns()
    data = root.NXentry[0].NXdata[0]
    assert data.nxsignal.nxname == "tx_mm"
    np.testing.assert_array_equal(data.nxsignal.nxvalue, columns["tx_mm"])
    assert [axis.nxname for axis in data.nxaxes] == ["time_s"]
    assert data.nxaxes[0].attrs["units"] == "s"
    for name in STATE_COLUMNS[:6]:
        assert data[name].attrs["units"] == name.rpartition("_")[2]
        np.testing.assert_array_equal(data[f"{name}_errors"].nxvalue, columns[f"u_{name}"])
    (log,) = root.NXentry[0].channels.NXlog
    np.testing.assert_array_equal(log.value.nxvalue, columns["force_n"])
    np.testing.assert_array_equal(log.time.nxvalue, columns["time_s"])
    assert log.value.attrs["units"] == "kN"
    assert root.entry.configuration.data.nxvalue == ABOUT["configuration"]


def test_xarray_finds_dimensions_units_and_covariances(path):
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("h5netcdf")
    with xarray.open_dataset(path, group="entry/data", engine="h5netcdf") as data:
        assert data.tz_mm.dims == ("time_s",)
        assert data.tz_mm.units == "mm"
        np.testing.assert_array_equal(data.tz_mm_errors, make_columns()["u_tz_mm"])
        assert data.cov_pose.dims == ("time_s", "cov_row", "cov_column")
        np.testing.assert_array_equal(data.cov_pose, MATRICES)
        assert data.cov_row.values.tolist() == list(POSE)
        assert data.status.values.tolist() == make_columns()["status"].tolist()


def test_pymodaq_reads_numbers_and_units(path, tmp_path, monkeypatch):
    """Its browser writes into the file, and its settings into the home."""
    monkeypatch.setenv("HOME", str(tmp_path))
    browsing = pytest.importorskip("pymodaq_data.h5modules.browsing")
    copy = tmp_path / "copy.h5"
    copy.write_bytes(path.read_bytes())
    browser = browsing.H5BrowserUtil(backend="h5py")
    browser.open_file(copy, "r+")
    node = browser.get_node("/entry/data/tz_mm")
    assert node.read().tolist() == make_columns()["tz_mm"].tolist()
    assert node.attrs["units"] == "mm"
    browser.close_file()


def test_blocks_of_any_length_are_read_to_the_bit(tmp_path):
    """Chunks of noise, repeated numbers, counters, small numbers, words and covariances, some of
    them whole in one block."""
    count, rng = 52_000, np.random.default_rng(3)
    columns = {
        "tx_mm": rng.standard_normal(count),
        "bx_mm": np.full(count, 0.1),
        "seq": np.arange(count),
        "flags": rng.integers(0, 9, count, np.uint8),
        "status": rng.choice(["converged", "no light"], count).astype(object),
    } | {cov_name(i, j): rng.random(count) for i in range(6) for j in range(i, 6)}
    with tables.open_writer(tmp_path / "t.h5", {}) as writer:
        for start, stop in pairwise([0, 10, 51_000, count]):
            writer.write({name: values[start:stop] for name, values in columns.items()})
    read = tables.read_columns(tmp_path / "t.h5")
    assert list(read) == list(columns)
    for name, values in columns.items():
        np.testing.assert_array_equal(read[name], values)
    chunks = tables.read_chunks(tmp_path / "t.h5", [cov_name(0, 4)])
    parts = [chunk.columns[cov_name(0, 4)] for chunk in chunks]
    np.testing.assert_array_equal(np.concatenate(parts), columns[cov_name(0, 4)])


def test_rows_are_the_axis_of_a_table_without_times(tmp_path):
    with tables.open_writer(tmp_path / "t.h5", {}) as writer:
        for _ in range(2):
            writer.write({"word": np.array(["a", "b"]), "size_mm": np.array([1.0, 2.0])})
    with h5py.File(tmp_path / "t.h5") as file:
        data = file["entry/data"]
        assert data.attrs["signal"] == "size_mm"
        assert data[data.attrs["axes"][0]][:].tolist() == [1, 2, 3, 4]
    assert list(tables.read_frame(tmp_path / "t.h5")) == ["word", "size_mm"]


def test_other_files_are_named(path, tmp_path):
    content = path.read_bytes()
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["a"] = [1.0]
    (tmp_path / "text.h5").write_text("a,b\n1,2\n")
    (tmp_path / "cut.h5").write_bytes(content[: len(content) // 2])
    (tmp_path / "named.csv").write_bytes(content)
    for name, says in (
        ("other.h5", "is an HDF5 file that facets did not write"),
        ("text.h5", "not an HDF5 table"),
        ("cut.h5", "cannot be read as HDF5: .*truncated"),
        ("named.csv", r"is an HDF5 table; name it \.h5"),
    ):
        with pytest.raises(InputError, match=says):
            list(tables.read_chunks(tmp_path / name, ["a"]))
    with pytest.raises(InputError, match="column status holds text, not numbers"):
        list(tables.read_chunks(path, ["status"]))


def test_a_full_disk_leaves_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr("facets.files.hdf5_table.free_space", lambda path: 10_000)
    with pytest.raises(OutputError, match=r"t\.h5: cannot be written: No space left"):
        tables.write_table(tmp_path / "t.h5", {"a": np.zeros(10_000)}, {})
    assert list(tmp_path.iterdir()) == []


def test_text_that_is_not_utf8_is_marked(path, tmp_path):
    copy = tmp_path / "copy.h5"
    copy.write_bytes(path.read_bytes())
    with h5py.File(copy, "r+") as file:
        file["entry/data/status"][1] = b"dose\xe9"
        file["entry"].attrs.create("command", b"solve r\xe9.csv", dtype=h5py.string_dtype())
    frame = facets.read_table(copy)
    assert frame["status"][1] == "dose\ufffd"
    assert frame.attrs["command"] == r"solve r\xe9.csv"
    assert tables.read_words(copy, "status")[0] == "converged"
