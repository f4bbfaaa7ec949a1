"""Section 4: what the paper's conclusions claim of the sensor as a whole."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import facets
from facets.characterization.ranges import largest_box
from facets.characterization.resolution import estimators, resolve

from .experiment import PaperClaim, Table, columns_of, no_picture

TITLE = "Section 4: the claims of the conclusions"
CONFIG = "paper"
#: Half widths with the square's proportions that exceed the sensor's reach.
SQUARE = np.array([20.0, 20.0, 0, 0, 0, 0])


def compute(quick: bool) -> Table:
    config = facets.load(CONFIG)
    rows = []
    for tracking, paper in ((False, 0.25), (True, 8.0)):
        rules = replace(config.range, tracking=tracking)
        half, _ = largest_box(config.sensor, rules, np.zeros(6), SQUARE)
        beam = "following" if tracking else "fixed"
        rows.append((f"square in x and y; beam {beam}", "mm", paper, 2 * half[0]))
    tracked = replace(config.range, tracking=True)
    worst = 2 * resolve(config.sensor, tracked, estimators(0.005))[0].worst
    rows += [
        ("coarsest of z", "um", 2.8, 1e3 * worst[2]),
        ("coarsest of x and y", "um", 2.8, 1e3 * worst[:2].max()),
        ("coarsest rotation", "urad", 13.0, 1e6 * worst[3:].max()),
    ]
    return columns_of("what unit paper ours", rows)


WHY = {
    "square in x and y; beam fixed": "the fit of Table 2: the square inside its range",
    "square in x and y; beam following": 'the paper says "over 8 mm"; its stage ended there',
    "coarsest of z": "one noise of the centroids, fitted",
    "coarsest of x and y": "with the beam free x and y are coarser than z; see known-beam",
    "coarsest rotation": "one noise of the centroids, fitted",
}


def claims(table: Table) -> list[PaperClaim]:
    rows = zip(*(table[name].tolist() for name in ("what", "unit", "paper", "ours")), strict=True)
    return [PaperClaim(what, unit, paper, ours, WHY[what]) for what, unit, paper, ours in rows]


picture = no_picture
