"""Not in the paper: a proof, where Fig. 4 samples, that readings and poses go one to one."""

from __future__ import annotations

from typing import TYPE_CHECKING

import facets
from facets.characterization.state_box import box_of_poses, least_share, range_box
from facets.proof.range_cover import cover_range
from facets.proof.uniqueness import certify

from .experiment import NONE, PaperClaim, Table, columns_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TITLE = "Beyond the paper: uniqueness, proved"
CONFIG = "paper"


def compute(quick: bool) -> Table:
    """Certify the paper's sensor over its whole range by interval arithmetic."""
    config = facets.load(CONFIG)
    least = least_share(config.sensor, config.range)
    cover = cover_range(config.sensor, config.range, least)
    axes = range_box(config.sensor, config.range)
    box = axes if cover is None else box_of_poses(cover.low, cover.high)
    certificate = certify(config.sensor, box, share=least)
    rows = [
        ("proved one to one", "", float(certificate.unique)),
        ("proved to hold every pose of the range", "", float(cover is not None)),
        ("pieces of the box", "", float(len(certificate.pieces))),
        ("lower bound of the determinant", "mm^6 mW^2", certificate.at_least),
        ("least light on a facet that is covered", "uW", 1e3 * least * config.sensor.beam.power),
    ]
    return columns_of("what unit ours", rows)


def claims(table: Table) -> list[PaperClaim]:
    rows = zip(*(table[name].tolist() for name in ("what", "unit", "ours")), strict=True)
    why = "the paper concludes it from 200 000 samples; docs/uniqueness.md has the theorem"
    return [PaperClaim(what, unit, 1 if what.startswith("proved") else NONE, ours, why)
            for what, unit, ours in rows]  # fmt: skip


def picture(table: Table) -> Figure | None:
    return None
