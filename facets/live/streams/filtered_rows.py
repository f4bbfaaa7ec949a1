"""Published rows with filtered poses beside the raw ones."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...core.names import READING_COLUMNS, STATE_COLUMNS, STATE_UNITS
from ...detectors.noise import least_light
from ...estimation.object_pose import ObjectPose, carry_pose
from ...estimation.table import covariance_columns, result_columns
from ..run.filtering import FilteredPoses, PoseFilter
from .sample_rows import FILTER_COLUMNS, FILTERED, SAMPLE

if TYPE_CHECKING:
    from ...core.settings import Config
    from ...core.units import Floats


def widen_dtype(
    dtype: np.dtype[np.void], names: tuple[str, ...] = FILTER_COLUMNS
) -> np.dtype[np.void]:
    """Of rows with the filtered pose and its standard uncertainties at their end."""
    return np.dtype([*dtype.descr, *((name, "<f8") for name in names)])


#: A row: that of SAMPLE, then `FILTER_COLUMNS`; 338 bytes.
WIDE = widen_dtype(SAMPLE)


class RowFilter:
    """Puts what a filter says beside each row.

    names: `FILTER_COLUMNS`, and the columns of the object and of covariances, if there are any.
    """

    def __init__(
        self, config: Config, model: str, carried: bool = False, covariance: bool = False
    ) -> None:
        self.object, self.covariance = config.object, covariance
        has_more = covariance or config.object is not None
        self.filter = PoseFilter(config, model, carried, has_more)
        self.floor = least_light(config.sensor)
        nothing = FilteredPoses(*(np.empty((0, *[6] * n)) for n in (1, 1, 2)))
        self.names = (*FILTER_COLUMNS, *self.further(nothing))

    def further(self, found: FilteredPoses) -> dict[str, Floats]:
        """The columns of the object, and on request of covariances."""
        columns: dict[str, Floats] = {}
        if found.covariance is None:
            return columns
        if self.covariance:
            mirror = ObjectPose(found.poses, None, found.covariance, None, None, False)
            columns = covariance_columns(mirror, "filtered_")
        if self.object is not None:
            there = carry_pose(found.poses, found.covariance, self.object)
            columns |= result_columns(there, "filtered_object_", self.covariance)
        return columns

    def widen(self, rows: NDArray[np.void]) -> NDArray[np.void]:
        """Rows with the columns `names`; NaN where there is no filtered pose."""
        found = np.empty(len(rows), widen_dtype(rows.dtype, self.names))
        for name in rows.dtype.names or ():
            found[name] = rows[name]
        states = np.column_stack([rows[name] for name in STATE_COLUMNS]) * STATE_UNITS
        sigma = np.column_stack([rows[f"u_{name}"] for name in STATE_COLUMNS]) * STATE_UNITS
        power = np.column_stack([rows[name] for name in READING_COLUMNS[2::3]])
        states[rows["status"] != 0] = np.nan
        filtered = self.filter.add(
            1e-6 * rows["board_us"].astype(float), states, sigma, power > self.floor
        )
        for n, name in enumerate(FILTERED):
            found[name] = filtered.poses[:, n] / STATE_UNITS[n]
            found[f"u_{name}"] = filtered.uncertainty[:, n] / STATE_UNITS[n]
        for name, values in self.further(filtered).items():
            found[name] = values
        return found

    @property
    def doubt(self) -> str:
        """Why there are no filtered poses, or nothing."""
        one = self.filter.filter
        return one.sentence() if one.begun and one.is_beyond_chance else ""

    @property
    def sentence(self) -> str:
        return self.filter.filter.sentence()
