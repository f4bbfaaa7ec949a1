"""Fig. 4: the determinant of Eq. (11) over random states, against the apex's distance, Eq. (12)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

import facets
from facets.characterization.singularity import measures, samples
from facets.characterization.state_box import apex_offset, range_box
from facets.core.hues import chosen_hues
from facets.pictures import style

from .experiment import NONE, PaperClaim, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TITLE = "Fig. 4: the determinant of the Jacobian over random states"
CONFIG = "fig4"
CLASSES = 60


def compute(quick: bool) -> Table:
    """Least, median and largest determinant in classes of the apex's distance from the beam."""
    config = facets.load(CONFIG)
    domain = range_box(config.sensor, config.range)
    count = 20_000 if quick else 200_000
    states = np.concatenate(list(samples(domain, count, "uniform", seed=1)))
    values = measures(config.sensor, states, spectra=False)[:, 0]
    offset = apex_offset(states)
    edges = np.linspace(0, 1.0001 * offset.max(), CLASSES + 1)
    which = np.digitize(offset, edges) - 1
    held = [values[which == n] for n in range(CLASSES)]
    full = [n for n in range(CLASSES) if len(held[n])]
    return {
        "distance_mm": (edges[:-1] + np.diff(edges) / 2)[full],
        "states": np.array([len(held[n]) for n in full]),
        "least": np.array([held[n].min() for n in full]),
        "median": np.array([np.median(held[n]) for n in full]),
        "largest": np.array([held[n].max() for n in full]),
    }


def claims(table: Table) -> list[PaperClaim]:
    states = int(table["states"].sum())
    positive = table["least"].min() > 0
    return [
        PaperClaim("states drawn", "", 200_000, states, "an input; the paper says over 200 000",
              is_input=True),
        PaperClaim("of one sign", "", 1, float(positive),
              "the paper's is negative: its psi runs the other way; a sign is no property"),
        PaperClaim("least determinant", "mm^6 mW^2", NONE, table["least"].min(),
              "the paper gives a picture; `uniqueness` proves a bound"),
        PaperClaim("largest determinant", "mm^6 mW^2", NONE, table["largest"].max(),
              "at rest, with the apex in the beam's centre"),
    ]  # fmt: skip


def picture(table: Table) -> Figure:
    hues = chosen_hues()
    with style.style_context():
        drawing = style.figure(style.SINGLE, 3.1)
        panel = drawing.subplots()
        place = table["distance_mm"]
        panel.fill_between(place, table["least"], table["largest"], color=hues.accent, alpha=0.25,
                           lw=0, label="from least to largest")  # fmt: skip
        panel.plot(place, table["median"], color=hues.accent, label="median")
        panel.axhline(0, color=hues.alarm, ls="--", label="singular")
        panel.set(xlabel="distance of the apex from the beam, mm",
                  ylabel="determinant of Eq. (11), mm⁶ mW²")  # fmt: skip
        panel.ticklabel_format(axis="y", style="sci", scilimits=(-2, 4))
        panel.legend()
    return drawing
