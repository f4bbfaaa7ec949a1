"""Not in the paper: a proof, not samples as in Fig. 4, that readings determine the pose."""

from __future__ import annotations

import numpy as np

import facets
from facets.characterization.state_box import box_of_poses, least_share
from facets.proof.uniqueness import certify

from .experiment import NONE, PaperClaim, Table, columns_of, no_picture

TITLE = "Beyond the paper: uniqueness, proved"
CONFIG = "paper"
#: Ends of a box of poses that contains the measurement range of `paper`, mm and rad. It is larger
#: than the ranges of the axes, since several axes may move together.
LOW = (-15.323, -15.872, -8.459, -0.019847, -0.021832, -0.034298)
HIGH = (15.549, 15.872, 8.268, 0.019847, 0.021442, 0.034298)


def compute(quick: bool) -> Table:
    """Certify the paper's sensor over a box that holds its range, by interval arithmetic."""
    config = facets.load(CONFIG)
    fraction = least_share(config.sensor, config.range)
    box = box_of_poses(np.array(LOW), np.array(HIGH))
    certificate = certify(config.sensor, box, fraction)
    rows = [
        ("proved one to one", "", float(certificate.unique)),
        ("pieces of the box", "", float(len(certificate.pieces))),
        ("lower bound of the determinant", "mm^6 mW^2", certificate.at_least),
        ("least light on a facet that is covered", "uW", 1e3 * fraction * config.sensor.beam.power),
    ]
    return columns_of("what unit ours", rows)


def claims(table: Table) -> list[PaperClaim]:
    rows = zip(*(table[name].tolist() for name in ("what", "unit", "ours")), strict=True)
    why = "the paper concludes it from 200 000 samples; docs/uniqueness.md has the theorem"
    return [PaperClaim(what, unit, 1 if what.startswith("proved") else NONE, ours, why)
            for what, unit, ours in rows]  # fmt: skip


picture = no_picture
