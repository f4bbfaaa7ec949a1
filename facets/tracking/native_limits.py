"""Limits of speed and acceleration that a controller keeps, in its own units.

They hold whatever `stage.step_um` is, and where the program or the computer dies.
"""

from __future__ import annotations

import numpy as np

from ..core.units import Floats
from .stage import StageError

#: Largest excess of a limit that is read back, as a share: controllers round to whole units.
ROUNDED = 0.01


class NativeLimits:
    """What the drivers of controllers with such limits share.

    original: the limits before the first of ours; NaN for one that the controller does not have.
    """

    original: Floats | None = None

    def read_limits(self) -> Floats:
        """The controller's limits (n, 2), of each axis: the speed, then accelerations."""
        raise NotImplementedError

    def write_limits(self, limits: Floats) -> None:
        """Set the controller's limits (n, 2)."""
        raise NotImplementedError

    def hold_back(self, most: Floats) -> None:
        """Write limits (n, 2) or (n, 1) into the controller. Raises `StageError` if the controller
        keeps others."""
        before = self.read_limits()
        if self.original is None:
            self.original = before
        most = np.broadcast_to(most, before.shape)
        self.write_limits(most)
        kept = self.read_limits()
        if ((kept <= 0) | (kept > most * (1 + ROUNDED))).any():
            raise StageError(
                f"the stage keeps the limits {kept.tolist()} of its axes' speed and acceleration, "
                f"in its own units, where it was told {most.tolist()}"
            )

    def give_back(self) -> None:
        """Write the limits that the controller had before."""
        if self.original is not None:
            self.write_limits(self.original)
