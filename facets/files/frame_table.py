"""Tables as pandas data frames: read like files, and made for users."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.arguments import check_arguments
from ..core.errors import InputError
from ..core.extras import require_extra
from ..core.names import POSE
from ..core.units import Floats
from .columns import (
    COVARIANCE_AXES,
    ROW,
    TIME_COLUMNS,
    TIMES,
    Chunk,
    Columns,
    axis_of,
    columns_to_read,
    pack_covariances,
    refuse_text,
    row_chunks,
    row_times,
    units_of,
)

if TYPE_CHECKING:
    from pandas import DataFrame, Series
    from xarray import Dataset

#: Largest deviation of times from equal spacing, in steps; a board counts integer microseconds.
LARGEST_JITTER = 0.1
#: Kinds that pandas infers for columns of numbers.
NUMBERS = ("integer", "floating", "mixed-integer-float", "decimal", "boolean")


@dataclass(frozen=True)
class FrameTable:
    """A data frame that is read like a table in a file; named levels of its index are columns."""

    source: DataFrame

    @cached_property
    def frame(self) -> DataFrame:
        """The data frame with the named levels of its index as columns."""
        other = (None, ROW, *self.source.columns)
        return self.source.reset_index(
            [name for name in self.source.index.names if name not in other]
        )

    def __str__(self) -> str:
        return "the data frame"


def read_chunks(
    table: FrameTable, needed: Sequence[str], optional: Sequence[str], rows: int
) -> Iterator[Chunk]:
    frame = table.frame
    use = columns_to_read(table, column_names(table), needed, optional)
    columns = {name: numbers_of(table, name) for name in use}
    yield from row_chunks(
        len(frame), rows, 0, lambda part: {name: values[part] for name, values in columns.items()}
    )


def numbers_of(table: FrameTable, name: str) -> Floats:
    """A column as floats (n,), NaN where it has no value.

    Raises `InputError` for text, and for dates and durations, whose numbers have no stated unit.
    """
    values = table.frame[name]
    try:
        if not infer_kind(values).startswith(("datetime", "timedelta")):
            return values.to_numpy(np.float64, na_value=np.nan)
    except (TypeError, ValueError):
        pass
    raise refuse_text(table, name, values.dtype)


def infer_kind(values: Series[Any]) -> str:
    """Kind of a column's values as pandas names it, such as "floating"."""
    from pandas.api.types import infer_dtype

    return infer_dtype(values, skipna=True)


def columns_of(frame: DataFrame) -> dict[str, Any]:
    """The columns of a data frame, by name as text.

    Raises `InputError` if two columns have the same name.
    """
    table = FrameTable(frame)
    columns_to_read(table, column_names(table), (), ())
    return {str(name): table.frame[name].to_numpy() for name in table.frame.columns}


def column_names(table: FrameTable) -> list[str]:
    return [str(name) for name in table.frame.columns]


def read_columns(table: FrameTable, names: Sequence[str]) -> dict[str, Any]:
    return {name: table.frame[name].to_numpy() for name in names}


def units_in(table: DataFrame) -> dict[str, str]:
    """The units of a data frame's columns, from its `attrs` or else from the columns' names."""
    units = {f"unit of {name}": unit for name, unit in table.attrs.get("units", {}).items()}
    return units_of(columns_of(table), units)


def make_frame(
    columns: Columns, about: Mapping[str, Any] | None = None, index: Any = None
) -> DataFrame:
    """Make a data frame of columns, with their units and the provenance in `attrs`.

    about: the provenance.  index: of the data frame; None: row numbers from 0.
    """
    import pandas as pd

    frame = pd.DataFrame({name: np.ravel(values) for name, values in columns.items()}, index)
    frame.attrs |= {**(about or {}), "units": units_of(columns, about or {})}
    return frame


@check_arguments
def to_xarray(table: DataFrame) -> Dataset:
    """Make a dataset of xarray from a data frame with units, such as `facets.read_table` gives.

    Parameters
    ----------
    table
        The data frame. The first of its columns time_s, board_us, frequency_hz, position_mm and
        position_deg is the dimension; without one it is the frame's index, as `row`.

    Returns
    -------
    Dataset
        A variable for each column, with the attribute `units`; covariances are variables (n, 6, 6),
        mm and mrad. The provenance is in the attributes of the dataset.

    Raises
    ------
    InputError
        If xarray is not installed (the extra `xarray`), if two columns have the same name, or if
        one has the name of a dimension, such as `row`.

    Examples
    --------
    >>> import numpy as np, facets
    >>> sensor = facets.Sensor()
    >>> solution = facets.solve(sensor, facets.readings(sensor, np.zeros((3, 8))))
    >>> poses = facets.to_xarray(solution.to_frame(covariance=True))
    >>> poses.tz_mm.units, poses.cov_pose.shape
    ('mm', (3, 6, 6))
    """
    xarray = require_extra("xarray", "facets.to_xarray")
    columns, units = columns_of(table), units_in(table)
    dimensions = (axis_of(columns), *COVARIANCE_AXES)
    variables = {}
    coordinates: dict[str, Any] = {ROW: table.index} if ROW in dimensions else {}
    for name, values in pack_covariances(columns).items():
        attributes = {"units": units[name]} if name in units else {}
        variables[name] = (dimensions[: values.ndim], values, attributes)
        coordinates |= {axis: list(POSE) for axis in dimensions[1 : values.ndim]}
    for name in coordinates.keys() & variables.keys():
        raise InputError(
            f"the data frame: column {name} has the name of the dataset's dimension; rename it"
        )
    about = {key: value for key, value in table.attrs.items() if key != "units"}
    dataset: Dataset = xarray.Dataset(variables, coordinates, about)
    return dataset


@check_arguments
def to_sep005(table: DataFrame) -> list[dict[str, Any]]:
    """Make the list of dictionaries by which SDyPy's packages exchange signals (SEP005).

    Parameters
    ----------
    table
        A data frame with units and a column time_s or board_us, such as
        `facets.read_table` gives.

    Returns
    -------
    list of dict
        One for each column of numbers with a unit, except the times time_s, board_us, host_s and
        utc_s. Each has `name`, `data`, `unit_str`, and `fs` in Hz if the times are equally spaced,
        otherwise `time` in s.

    Raises
    ------
    InputError
        If the table has no column of times, or one that holds no numbers, or if two columns have
        the same name.

    Examples
    --------
    >>> import pandas as pd, facets
    >>> poses = pd.DataFrame({"time_s": [0.0, 0.5, 1.0], "tz_mm": [1.0, 2.0, 3.0]})
    >>> facets.to_sep005(poses)
    [{'name': 'tz_mm', 'data': array([1., 2., 3.]), 'unit_str': 'mm', 'fs': 2.0}]
    """
    axis = axis_of(columns_of(table))
    if axis not in TIMES:
        raise InputError(f"the table has no column of times; needed: {' or '.join(TIMES)}")
    source = FrameTable(table)
    if infer_kind(source.frame[axis]) not in NUMBERS:
        raise refuse_text(source, axis, source.frame[axis].dtype)
    times = [name for name in TIME_COLUMNS if name in source.frame]
    time = row_times({name: numbers_of(source, name) for name in times})
    even = np.linspace(time[0], time[-1], len(time)) if len(time) > 1 else np.empty(0)
    step = np.diff(even[:2]).sum()
    is_even = step > 0 and np.abs(time - even).max() <= LARGEST_JITTER * step
    when: dict[str, Any] = {"fs": float(1 / step)} if is_even else {"time": time.tolist()}
    if "recorded" in table.attrs:
        when["start_timestamp"] = table.attrs["recorded"]
    return [
        {"name": name, "data": numbers_of(source, name), "unit_str": unit, **when}
        for name, unit in units_in(table).items()
        if name not in TIME_COLUMNS and infer_kind(source.frame[name]) in NUMBERS
    ]
