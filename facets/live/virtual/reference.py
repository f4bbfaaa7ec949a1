"""A reference instrument of the virtual bench, like a hexapod or an autocollimator."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ...core.units import Floats
from ...files.provenance import provenance_header
from ...files.tables import write_table
from ...simulation.reference import reference_columns, reference_poses

if TYPE_CHECKING:
    from pathlib import Path

    from ...core.settings import Config
    from .mirror import Mirror

#: Time between two readings of the reference, s.
REFERENCE_INTERVAL_S = 0.01


class Reference:
    """Reads the mirror's pose by the host's clock, with the errors of `calibrate.reference`."""

    def __init__(self, config: Config, mirror: Mirror, seed: int) -> None:
        self.mirror, self.about = mirror, provenance_header(config, seed)
        rng = np.random.default_rng([seed, 6])
        self.poses = reference_poses(mirror.states[:, :6], config.calibrate.reference, rng)
        self.times: list[Floats] = []
        self.rows: list[Floats] = []
        self.last = -1

    def read(self, times: Floats, host: Floats) -> None:
        """Read the pose at those of the bench's times (n,), s, at which a reading is due.

        host: the host's times (n,), s, at the same moments.
        """
        intervals = (host / REFERENCE_INTERVAL_S).astype(np.int64)
        due = np.diff(intervals, prepend=self.last) > 0
        self.last = int(intervals[-1])
        self.times.append(host[due])
        self.rows.append(self.mirror.between(times[due], self.poses))

    def columns(self) -> dict[str, Floats]:
        """Columns (n,), time_s and ref_tx_mm ..., of a table for `facets calibrate --reference`."""
        if not self.times:
            return {"time_s": np.zeros(0)}
        return {"time_s": np.concatenate(self.times)} | reference_columns(np.concatenate(self.rows))

    def write(self, path: Path) -> None:
        """Write all readings as a table for `facets calibrate --reference`."""
        write_table(path, self.columns(), self.about)
