"""A reference beside the virtual bench: what a hexapod or an autocollimator says of its mirror."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ...core.units import Floats
from ...simulation.reference import reference_columns, reference_poses

if TYPE_CHECKING:
    from ...core.settings import Config
    from .mirror import Mirror

#: How often it is read, s.
REFERENCE_INTERVAL_S = 0.01


class Reference:
    """Reads the mirror's pose, as well as `calibrate.reference` says, by the host's clock."""

    def __init__(self, config: Config, mirror: Mirror, seed: int) -> None:
        self.mirror = mirror
        rng = np.random.default_rng([seed, 6])
        self.poses = reference_poses(mirror.states[:, :6], config.calibrate.reference, rng)
        self.times: list[Floats] = []
        self.rows: list[Floats] = []
        self.last = -1

    def read(self, times: Floats, host: Floats) -> None:
        """Reads where it is due, of the bench's times (n,), s, which are the host's `host`."""
        intervals = (host / REFERENCE_INTERVAL_S).astype(np.int64)
        due = np.diff(intervals, prepend=self.last) > 0
        self.last = int(intervals[-1])
        self.times.append(host[due])
        self.rows.append(self.mirror.between(times[due], self.poses))

    def columns(self) -> dict[str, Floats]:
        """Columns time_s and ref_tx_mm ..., as `facets calibrate --reference` takes them."""
        if not self.times:
            return {"time_s": np.zeros(0)}
        return {"time_s": np.concatenate(self.times)} | reference_columns(np.concatenate(self.rows))
