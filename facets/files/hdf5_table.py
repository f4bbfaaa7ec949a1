"""Tables in HDF5 as NeXus arranges them, for MATLAB, xarray, silx and h5web.

    /entry                NXentry: provenance as attributes, `title`
    /entry/configuration  NXnote: the configuration as JSON
    /entry/data           NXdata: one dataset for each column, with `units`; the attribute `columns`
                          has their order. The uncertainty of NAME is u_NAME and, under the name
                          that NeXus gives it, NAME_errors. Covariances are datasets (n, 6, 6)
    /entry/channels       an NXlog for each auxiliary channel: `value` and `time`

The first dimension of all datasets is a dimension scale, which netCDF-4 readers find: the times or,
without times, the numbers of the rows.
"""

from __future__ import annotations

import errno
import os
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from ..core.errors import InputError
from ..core.extras import require_extra
from ..core.names import POSE, READING_COLUMNS, STATE_COLUMNS, escape_undecodable
from .columns import (
    CONFIGURATION,
    COVARIANCE_AXES,
    ROW,
    Chunk,
    Columns,
    axis_of,
    columns_to_read,
    covariance_places,
    pack_covariances,
    refuse_text,
    row_chunks,
    unit_of_column,
    units_of,
)
from .whole import free_space

SIGNATURE = b"\x89HDF"
KIND = "an HDF5 table"
DATA = "entry/data"
#: Attribute of the group `DATA` with the names of the columns.
COLUMNS = "columns"
#: Attributes of NXentry that are not provenance.
NEXUS = ("NX_class", "default")
#: Size of the library's buffer for the unwritten end of each dataset, bytes.
CACHE_BYTES = 2**20
#: Count of numbers in a chunk of a dataset, which is compressed and read at once.
CHUNK_NUMBERS = 25_000
#: A row of bytes is stored uncompressed if its first bytes, this many, cannot be compressed.
SAMPLE_BYTES = 256


@contextmanager
def open_group(path: Path) -> Iterator[Any]:
    """Open the group with the columns of a table. Raises `InputError` if there is none."""
    h5py = require_extra("h5py", str(path))
    try:
        with h5py.File(path, "r", locking=False) as file:
            group = file.get(DATA)
            if group is None or COLUMNS not in group.attrs:
                raise InputError(
                    f"{path}: is an HDF5 file that facets did not write: the group {DATA} with the "
                    f"attribute {COLUMNS} is missing; export a table as CSV from the program that "
                    "wrote the file"
                )
            yield group
    except (OSError, RuntimeError, LookupError, TypeError, ValueError) as error:
        raise InputError(f"{path}: cannot be read as HDF5: {error}") from None


def names_in(group: Any) -> list[str]:
    return [str(name) for name in group.attrs[COLUMNS]]


def read_chunks(
    path: Path, needed: Sequence[str], optional: Sequence[str], rows: int
) -> Iterator[Chunk]:
    with open_group(path) as group:
        use = columns_to_read(path, names_in(group), needed, optional)
        count = len(group[group.attrs["signal"]])
        for name in use:
            if name in group and group[name].dtype.kind not in "iufb":
                raise refuse_text(path, name, "text")
        size = path.stat().st_size
        yield from row_chunks(count, rows, size, lambda part: columns_in(group, use, part))


def columns_in(group: Any, names: Sequence[str], part: slice) -> dict[str, Any]:
    """Read some rows of columns, among them elements of covariances."""
    places = covariance_places(names_in(group))
    needed = {places[name][0] for name in names if name in places}
    matrices = {matrix: group[matrix][part] for matrix in needed}
    columns = {}
    for name in names:
        if name in places:
            matrix, i, j = places[name]
            columns[name] = matrices[matrix][:, i, j]
        else:
            dataset = group[name]
            columns[name] = (text_of(dataset) if dataset.dtype.kind in "OS" else dataset)[part]
    return columns


def text_of(dataset: Any) -> Any:
    """A dataset of text, with a replacement for bytes that are not UTF-8, as in CSV."""
    return dataset.asstr(errors="replace")


def read_head(path: Path) -> dict[str, str]:
    with open_group(path) as group:
        entry = group.parent
        head = {key: str(value) for key, value in entry.attrs.items() if key not in NEXUS}
        if CONFIGURATION in entry:
            head[CONFIGURATION] = text_of(entry[CONFIGURATION]["data"])[()]
        return {key: escape_undecodable(value) for key, value in head.items()}


def column_names(path: Path) -> list[str]:
    with open_group(path) as group:
        return names_in(group)


def read_columns(path: Path, names: Sequence[str]) -> dict[str, Any]:
    with open_group(path) as group:
        return columns_in(group, names, slice(None))


class Hdf5Writer:
    """Writer that appends blocks of rows to an HDF5 table; the first block sets its columns."""

    def __init__(self, path: Path, about: Mapping[str, str], columns: Columns) -> None:
        self.h5py = require_extra("h5py", str(path))
        self.path, self.rows, self.unwritten = path, 0, 0
        # `Whole` locks the file; the library's own lock would fail.
        self.file = self.h5py.File(path, "w", locking=False)
        self.file.attrs.update({"NX_class": "NXroot", "default": "entry"})
        self.entry = add_group(self.file, "entry", "NXentry")
        self.data = add_group(self.entry, "data", "NXdata")
        self.axis = axis_of(columns)
        self.write_head(about)
        self.add_columns(columns, units_of(columns, about))
        self.name_signals(list(columns))
        self.add_logs([name for name in columns if f"unit of {name}" in about])

    def write_head(self, about: Mapping[str, str]) -> None:
        self.entry["title"] = about.get("command", "facets")
        self.entry.attrs["default"] = "data"
        self.entry.attrs.update({key: about[key] for key in about if key != CONFIGURATION})
        if CONFIGURATION in about:
            note = add_group(self.entry, CONFIGURATION, "NXnote")
            note["type"], note["data"] = "application/json", about[CONFIGURATION]

    def add_columns(self, columns: Columns, units: Mapping[str, str]) -> None:
        """Create empty datasets for columns, with their units and dimensions."""
        packed = self.pack(columns)
        for name, values in packed.items():
            dataset = self.add_dataset(name, values)
            if name in units:
                dataset.attrs["units"] = units[name]
        self.data[self.axis].make_scale(self.axis)
        for name in packed.keys() - {self.axis}:
            self.data[name].dims[0].attach_scale(self.data[self.axis])
        for name in set(packed) - set(columns) - {ROW}:
            self.describe_covariance(self.data[name])

    def add_dataset(self, name: str, values: Any) -> Any:
        """Create an empty dataset for values (n, ...) of the type of these."""
        shape = values.shape[1:]
        return self.data.create_dataset(
            name,
            (0, *shape),
            self.h5py.string_dtype() if values.dtype.kind in "UO" else values.dtype,
            maxshape=(None, *shape),
            chunks=(CHUNK_NUMBERS // int(np.prod(shape)), *shape),
            compression=1,
            shuffle=True,
        )

    def describe_covariance(self, dataset: Any) -> None:
        """Add the names of the components, and their units, to a covariance (n, 6, 6)."""
        dataset.attrs["component_units"] = [unit_of_column(name) for name in STATE_COLUMNS[:6]]
        for n, name in enumerate(COVARIANCE_AXES, start=1):
            if name not in self.data:
                self.data[name] = POSE
                self.data[name].make_scale(name)
            dataset.dims[n].attach_scale(self.data[name])

    def name_signals(self, names: list[str]) -> None:
        """Mark the signals that programs draw: the pose, else the readings, with uncertainties."""
        poses = [name for name in STATE_COLUMNS[:6] if name in names]
        drawn = poses or [name for name in READING_COLUMNS if name in names]
        drawn = drawn or [name for name in names if self.data[name].dtype.kind == "f"] or names
        self.data.attrs.update({"signal": drawn[0], "axes": [self.axis], COLUMNS: names})
        self.data.attrs["auxiliary_signals"] = drawn[1:]
        for name in names:
            if f"u_{name}" in names:
                self.data[f"{name}_errors"] = self.link(f"u_{name}")

    def add_logs(self, names: list[str]) -> None:
        """Describe auxiliary channels as logs, with the same values and times."""
        if names and self.axis != ROW:
            channels = add_group(self.entry, "channels", "NXcollection")
            for name in names:
                log = add_group(channels, name, "NXlog")
                log["value"], log["time"] = self.link(name), self.link(self.axis)

    def link(self, name: str) -> Any:
        """A link to a column, which keeps its name: netCDF names dimensions by their scales."""
        return self.h5py.SoftLink(f"/{DATA}/{name}")

    def pack(self, columns: Columns) -> dict[str, Any]:
        """The datasets of columns; with the numbers of the rows if there are no times."""
        packed = pack_covariances(columns)
        if self.axis == ROW:
            count = len(next(iter(packed.values())))
            packed[ROW] = self.rows + 1 + np.arange(count)
        return packed

    def write(self, columns: Columns) -> None:
        packed = self.pack(columns)
        self.require_space(packed)
        start = self.rows
        self.rows += len(next(iter(packed.values())))
        with system_errors():
            for name, values in packed.items():
                self.data[name].resize(self.rows, axis=0)
                write_rows(self.data[name], start, values)

    def require_space(self, packed: Mapping[str, Any]) -> None:
        """Raise `OSError` if rows would not fit on the disk, because the library ends the process
        if it cannot close its file on a full disk."""
        added = sum(values.nbytes for values in packed.values())
        self.unwritten = min(self.unwritten, CACHE_BYTES * len(packed)) + added
        if free_space(self.path) < self.unwritten:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def close(self) -> None:
        with system_errors():
            self.file.close()


def write_rows(dataset: Any, start: int, values: Any) -> None:
    """Write rows of a dataset from `start` on; the library, which is slower, writes only text and
    incomplete chunks."""
    length = dataset.chunks[0]
    for piece in np.split(values, range(-start % length, len(values), length)):
        if len(piece) == length and dataset.dtype == values.dtype != object:
            dataset.id.write_direct_chunk((start, *(0,) * (values.ndim - 1)), compress(piece))
        elif len(piece):
            dataset[start : start + len(piece)] = piece
        start += len(piece)


def compress(numbers: Any) -> bytes:
    """Compress a chunk for the library's filters, shuffle and gzip, in a quarter of their time.

    Bytes of equal significance form a row; a row of noise, such as the last bytes of floats, is
    stored uncompressed.
    """
    significant = np.ascontiguousarray(numbers).view(np.uint8).reshape(-1, numbers.itemsize)
    rows: Any = np.ascontiguousarray(significant.T)
    parts = [b"\x78\x01"]
    for row in rows:
        is_noise = len(zlib.compress(row[:SAMPLE_BYTES], 1)) >= SAMPLE_BYTES
        stream = zlib.compressobj(0 if is_noise else 1, wbits=-15, strategy=zlib.Z_RLE)
        parts += [stream.compress(row), stream.flush(zlib.Z_SYNC_FLUSH)]
    return b"".join([*parts, b"\x03\x00", zlib.adler32(rows).to_bytes(4, "big")])


def add_group(parent: Any, name: str, kind: str) -> Any:
    """Add a group with its NeXus class."""
    group = parent.create_group(name)
    group.attrs["NX_class"] = kind
    return group


@contextmanager
def system_errors() -> Iterator[None]:
    """Context that raises the library's errors, such as for a full disk, as `OSError`."""
    try:
        yield
    except RuntimeError as error:
        raise OSError(str(error)) from None
