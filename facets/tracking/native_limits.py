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
    """Limits of speed and acceleration, which drivers of controllers with such limits share.

    Every method raises `StageError` if the stage does not answer, answers with an error or cannot
    be understood. Limits (2, 2) or (3, 2) are in the controller's own units: row 0 is the speed,
    the other rows are accelerations; the columns are the axes x and y.
    original: the limits before the first of ours; NaN for one that the controller does not have.
    """

    settings: Settings
    original: Floats | None = None

    def place(self) -> Floats:
        """The beam's place by the encoders: (2,) mm."""
        raise NotImplementedError

    def read_limits(self) -> Floats:
        """Read the controller's limits; see the class for their shape and units."""
        raise NotImplementedError

    def write_limits(self, limits: Floats) -> None:
        """Set the controller's limits, of the shape that `read_limits` returns."""
        raise NotImplementedError

    def hold_back(self, speed: float | Floats, acceleration: float | Floats) -> None:
        """Write these limits, numbers or one for each axis, or the limits of `stage.native_limits`
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
        """Write the limits that the controller had before, once the stage is at rest; write nothing
        if it does not come to rest within MAX_READINGS readings."""
        if self.original is None:
            return
        before = self.place()
        for _ in range(MAX_READINGS):
            place = self.place()
            if np.abs(place - before).max() <= REST_STEPS * self.settings.step:
                self.write_limits(self.original)
                break
            before = place
