"""Limits of speed and acceleration that a controller keeps, in its own units.

They hold where the program or the computer dies, and `stage.native_limits` whatever the units are.
"""

from __future__ import annotations

import numpy as np

from ..core.settings import Stage as Settings
from ..core.units import Floats
from .stage import StageError

#: Largest relative excess of a limit that is read back: controllers round to whole units.
MAX_RELATIVE_EXCESS = 0.01
#: A stage that moves by no more than these steps between two readings of its place is at rest.
REST_STEPS = 2
#: A stage that is not at rest after this many readings keeps the lower limits.
MAX_READINGS = 1000


class NativeLimits:
    """The part that drivers of controllers with limits of their own share.

    original: the limits before the first of ours; NaN for one that the controller does not have.
    """

    settings: Settings
    original: Floats | None = None

    def place(self) -> Floats:
        """The beam's place by the encoders."""
        raise NotImplementedError

    def read_limits(self) -> Floats:
        """The controller's limits (n, 2), of each axis: the speed, then accelerations."""
        raise NotImplementedError

    def write_limits(self, limits: Floats) -> None:
        """Set the controller's limits (n, 2)."""
        raise NotImplementedError

    def hold_back(self, speed: float | Floats, acceleration: float | Floats) -> None:
        """Write these limits, in the controller's units, or the limits of `stage.native_limits`
        where they are lower. Raises `StageError` if the controller keeps others."""
        before = self.read_limits()
        most = np.empty_like(before)
        native = self.settings.native_limits or (np.inf, np.inf)
        most[0], most[1:] = np.minimum(speed, native[0]), np.minimum(acceleration, native[1])
        if np.abs(before / most - 1).max() <= MAX_RELATIVE_EXCESS:
            return
        if self.original is None:
            self.original = before
        self.write_limits(most)
        limits = self.read_limits()
        if ((limits <= 0) | (limits > most * (1 + MAX_RELATIVE_EXCESS))).any():
            raise StageError(
                f"the stage keeps the limits {limits.tolist()} of its axes' speed and "
                f"acceleration, in its own units, where it was told {most.tolist()}"
            )

    def restore_limits(self) -> None:
        """Write the limits that the controller had before, once the stage is at rest."""
        if self.original is None:
            return
        before = self.place()
        for _ in range(MAX_READINGS):
            place = self.place()
            if np.abs(place - before).max() <= REST_STEPS * self.settings.step:
                self.write_limits(self.original)
                break
            before = place
