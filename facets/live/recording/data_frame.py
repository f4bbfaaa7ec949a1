"""Everything that facets writes as rows, as a data frame of pandas."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ...core.arguments import check_arguments
from ...core.channels import describe_channels
from ...core.errors import InputError
from ...estimation.solution import worded_columns
from ...files.frame_table import make_frame
from ...files.provenance import configuration_entry, provenance_header
from ...files.tables import read_frame
from .pose_table import recorded_poses
from .reader import meta_of
from .replay import recorded_config

if TYPE_CHECKING:
    from pandas import DataFrame


@check_arguments
def read_table(path: str | Path) -> DataFrame:
    """Read a table, or the poses of a recording, as a data frame of pandas.

    Parameters
    ----------
    path
        A table (.csv, .csv.gz, .parquet, .h5, .tdms), or the folder of a recording, whose poses are
        those of the run; `facets replay` solves a recording again.

    Returns
    -------
    DataFrame
        The columns as they are in the file, with their units in their names. `attrs["units"]` has
        the units by column; the other entries of `attrs` are the head of the table, such as
        `config`, `config_sha256`, `command` and `made`, and except in CSV `configuration`, as JSON.

    Raises
    ------
    InputError
        If the file cannot be read, is none of these, or needs an extra that is not installed.

    Examples
    --------
    >>> import os, tempfile, facets
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = os.path.join(folder, "log.csv")
    ...     with open(path, "w") as file:
    ...         _ = file.write("# seed: 1\\ntime_s,temperature_c\\n0,20.5\\n60,20.7\\n")
    ...     log = facets.read_table(path)
    >>> log.temperature_c.max(), log.attrs
    (np.float64(20.7), {'seed': '1', 'units': {'time_s': 's', 'temperature_c': 'degC'}})
    """
    place = Path(path)
    return read_recording(place) if place.is_dir() else read_frame(place)


def read_recording(folder: Path) -> DataFrame:
    """The recorded poses as a data frame.  Raises `InputError` if there are none."""
    config, made = recorded_config(folder), meta_of(folder)
    columns = recorded_poses(folder)
    if not columns:
        raise InputError(
            f"{folder}: holds no poses; `facets replay {folder} -o poses.parquet` solves its bytes"
        )
    about = {key: str(made[key]) for key in provenance_header(config) if key in made}
    about |= configuration_entry(config) | {"recorded": about.get("made", "")}
    return make_frame(worded_columns(columns), about | describe_channels(config.acquire.channels))
