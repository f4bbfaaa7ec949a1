"""Fig. 8: a turn about z, with errors in six axes."""

from __future__ import annotations

from functools import partial

from . import motion
from .experiment import Table

TITLE = "Fig. 8: turn about z"
CONFIG = "paper"


def compute(quick: bool) -> Table:
    return motion.simulate_table(CONFIG, "yaw-sweep")


claims = motion.errors_in_six_axes
picture = partial(motion.motion_figure, axes=("yaw",))
