"""Published rows with filtered poses beside the raw ones."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...core.names import READING_COLUMNS, STATE_COLUMNS, STATE_UNITS
from ...detectors.noise import least_light
from ..run.filtering import PoseFilter
from .sample_rows import FILTER_COLUMNS, FILTERED, SAMPLE

if TYPE_CHECKING:
    from ...core.settings import Config


def widen_dtype(dtype: np.dtype[np.void]) -> np.dtype[np.void]:
    """Of rows with the filtered pose and its standard uncertainties at their end."""
    return np.dtype([*dtype.descr, *((name, "<f8") for name in FILTER_COLUMNS)])


#: A row: that of SAMPLE, then `FILTER_COLUMNS`; 338 bytes.
WIDE = widen_dtype(SAMPLE)


class RowFilter:
    """Puts what a filter says beside each row."""

    def __init__(self, config: Config, model: str, carried: bool = False) -> None:
        self.filter = PoseFilter(config, model, carried)
        self.floor = least_light(config.sensor)

    def widen(self, rows: NDArray[np.void]) -> NDArray[np.void]:
        """Rows with `FILTER_COLUMNS`; NaN where there is no filtered pose."""
        found = np.empty(len(rows), widen_dtype(rows.dtype))
        for name in rows.dtype.names or ():
            found[name] = rows[name]
        states = np.column_stack([rows[name] for name in STATE_COLUMNS]) * STATE_UNITS
        sigma = np.column_stack([rows[f"u_{name}"] for name in STATE_COLUMNS]) * STATE_UNITS
        power = np.column_stack([rows[name] for name in READING_COLUMNS[2::3]])
        states[rows["status"] != 0] = np.nan
        places, spread = self.filter.add(
            1e-6 * rows["board_us"].astype(float), states, sigma, power > self.floor
        )
        for n, name in enumerate(FILTERED):
            found[name] = places[:, n] / STATE_UNITS[n]
            found[f"u_{name}"] = spread[:, n] / STATE_UNITS[n]
        return found

    @property
    def doubt(self) -> str:
        """Why there are no filtered poses, or nothing."""
        one = self.filter.filter
        return one.sentence() if one.begun and one.is_beyond_chance else ""

    @property
    def sentence(self) -> str:
        return self.filter.filter.sentence()
