"""Table 2: ranges and resolutions of six axes.

Two numbers are fitted, both in configs/paper.yaml. The position noise, 2.6 um at 0.1 mW (1 sigma),
to the resolutions in z, roll, pitch and yaw: twice the worst standard deviation of the paper's
inversion over each axis's own range. The least signal-to-noise ratio, 810, to the ranges in x and y
under a fixed beam. Ranges go equally far to both sides.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

import facets
from facets.characterization.ranges import axis_ranges
from facets.characterization.resolution import estimators, resolve
from facets.core.hues import chosen_hues
from facets.core.names import POSE
from facets.pictures import style
from facets.pictures.style import unit_of

from .experiment import PaperClaim, Table, columns_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TITLE = "Table 2: ranges and resolutions"
CONFIG = "paper"
#: The paper's ranges, mm and mrad.
RANGE_MM_MRAD = (0.36, 0.39, 12.3, 28.0, 24.5, 48.0)
FOLLOWING = (13.6, 11.8)
RESOLUTION = (2.6, 1.9, 2.8, 9.4, 8.7, 13.0)
FIXED, TRACKING = "beam fixed", "beam following"
EDGE = "the nominal geometry; spots inside the 1/e^2 circle stay on the PSD"
COARSE = "six centroids tell x and y where the beam is free: coarser at one noise than z"
OFF = "worst at the end of the range in x or y, where a detector has a ninth of the light"
WHY = {
    ("range", FIXED): {"tx": "fitted: the least signal-to-noise ratio is", "ty": "the same fit"},
    ("resolution", TRACKING): {"tx": COARSE, "ty": COARSE},
    ("resolution", FIXED): {"tx": f"{COARSE}; {OFF}", "ty": "both"},
}
FIT = "one noise of the centroids, fitted to these four"


def compute(quick: bool) -> Table:
    config = facets.load(CONFIG)
    rows = []
    for beam, measured in ((FIXED, RANGE_MM_MRAD), (TRACKING, FOLLOWING)):
        rules = replace(config.range, tracking=beam == TRACKING)
        ranges = axis_ranges(config.sensor, rules, np.zeros(6))
        for axis, paper in zip(ranges, measured, strict=False):
            unit, factor, _, _ = unit_of(axis.name)
            rows.append(("range", beam, axis.name, unit, paper, factor * axis.symmetric))
    for beam in (TRACKING, FIXED):
        rules = replace(config.range, tracking=beam == TRACKING)
        inversion = resolve(config.sensor, rules, estimators(0.005))[0]
        for name, paper, worst in zip(POSE, RESOLUTION, inversion.worst, strict=True):
            _, _, unit, factor = unit_of(name)
            unit = unit.replace("µ", "u")
            rows.append(("resolution", beam, name, unit, paper, 2 * factor * worst))
    return columns_of("quantity beam axis unit paper ours", rows)


def claims(table: Table) -> list[PaperClaim]:
    results = []
    for n, (quantity, beam, axis) in enumerate(
        zip(table["quantity"], table["beam"], table["axis"], strict=True)
    ):
        other = EDGE if quantity == "range" else FIT
        why = WHY.get((quantity, beam), {}).get(axis, other)
        results.append(
            PaperClaim(f"{quantity} in {axis}; {beam}", str(table["unit"][n]),
                  float(table["paper"][n]), float(table["ours"][n]), why)
        )  # fmt: skip
    return results


def picture(table: Table) -> Figure:
    """Plot the ratio of model to paper for each axis, with a line at 1 for agreement."""
    hues = chosen_hues()
    ways = ((FIXED, "o", -0.13, False), (TRACKING, "D", 0.13, True))
    with style.style_context():
        drawing = style.figure(style.FULL, 3.1)
        panels = drawing.subplots(1, 2, sharey=True)
        for panel, quantity in zip(panels, ("range", "resolution"), strict=True):
            panel.axvline(1, color=hues.soft, lw=1.2)
            for beam, mark, shift, filled in ways:
                rows = (table["quantity"] == quantity) & (table["beam"] == beam)
                places = [POSE.index(name) + shift for name in table["axis"][rows]]
                ratio = table["ours"][rows] / table["paper"][rows]
                panel.plot(ratio, places, mark, ms=6, color=hues.accent, mew=1.4, label=beam,
                           mfc=hues.accent if filled else hues.ground)  # fmt: skip
            panel.set(title=quantity, xlabel="model over paper", xscale="log")
            style.plain_log(panel.xaxis)
            panel.grid(visible=False, axis="y")
        panels[0].set_yticks(range(6), [style.component_label(name) for name in POSE])
        panels[0].set_ylim(5.6, -0.6)
        style.panels_legend(drawing, panels, 2)
    return drawing
