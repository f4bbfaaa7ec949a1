"""Fig. 9: a motion of all six axes, with errors in six axes."""

from __future__ import annotations

from functools import partial

from facets.core.names import POSE

from . import motion
from .experiment import Table

TITLE = "Fig. 9: motion of all six axes"
CONFIG = "paper"


def compute(quick: bool) -> Table:
    return motion.simulate_table(CONFIG, "multi-axis")


claims = motion.errors_in_six_axes
picture = partial(motion.motion_figure, axes=POSE)
