"""Fig. 7: a translation along x under a fixed beam, with errors in six axes."""

from __future__ import annotations

from functools import partial

from . import motion
from .experiment import Table

TITLE = "Fig. 7: translation along x"
CONFIG = "paper"


def compute(quick: bool) -> Table:
    return motion.simulate_table(CONFIG, "x-steps")


claims = motion.errors_in_six_axes
picture = partial(motion.motion_figure, axes=("tx",))
