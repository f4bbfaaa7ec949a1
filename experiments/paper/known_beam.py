"""Not in the paper: if the beam is at rest, x and y are measured many times better."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

import facets
from facets.characterization.resolution import uncertainties
from facets.core.hues import MARKS, chosen_hues
from facets.core.knowledge import Knowledge, Prior
from facets.core.names import POSE
from facets.pictures import style
from facets.pictures.style import unit_of

from .experiment import PaperClaim, Table, columns_of
from .table2 import RESOLUTION

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TITLE = "Beyond the paper: what a known beam is worth"
CONFIG = "paper"
#: Standard uncertainty (1 sigma) of the beam's known position, mm.
KNOWN = (0.0, 0.0001, 0.0003, 0.001, 0.003, 0.01, 0.03, 0.1, np.inf)


def compute(quick: bool) -> Table:
    sensor = facets.load(CONFIG).sensor
    factors = np.array([unit_of(name)[3] for name in POSE])
    rows = []
    for beam_sigma in KNOWN:
        how = Knowledge(beam=Prior((0.0, 0.0), beam_sigma))
        sigma = uncertainties(sensor, np.zeros((1, 8)), how)[0] * factors
        rows.append((1e3 * beam_sigma, *sigma))
    return columns_of("beam_um tx_um ty_um tz_um roll_urad pitch_urad yaw_urad", rows)


def claims(table: Table) -> list[PaperClaim]:
    free, still = (np.flatnonzero(table["beam_um"] == um)[0] for um in (np.inf, 0.0))
    results = []
    for axis, paper in zip(("tx", "ty"), RESOLUTION, strict=False):
        fine = 2 * table[f"{axis}_um"]
        results += [
            PaperClaim(f"resolution in {axis} at rest; beam free", "um", paper,
                  fine[free], "the paper's own is between the two: its beam stood still"),
            PaperClaim(f"resolution in {axis} at rest; beam known", "um", paper,
                  fine[still], "the powers then tell the apex's offset alone"),
        ]  # fmt: skip
    return results


def picture(table: Table) -> Figure:
    hues = chosen_hues()
    with style.style_context():
        drawing = style.figure(style.SINGLE, 3.2)
        panel = drawing.subplots()
        some = (table["beam_um"] > 0) & np.isfinite(table["beam_um"])
        free = np.flatnonzero(np.isinf(table["beam_um"]))[0]
        for axis in ("tx", "tz"):
            fine, hue = 2 * table[f"{axis}_um"], hues.axes[axis]
            panel.loglog(table["beam_um"][some], fine[some], marker=MARKS[axis], ms=5, color=hue,
                         label=style.component_label(axis))  # fmt: skip
            panel.axhline(fine[free], color=hue, ls=(0, (1, 1.5)), lw=1.4)
        panel.plot([], [], color=hues.soft, ls=(0, (1, 1.5)), label="the same, beam free")
        panel.set(xlabel="standard uncertainty of the beam's place, µm",
                  ylabel="resolution at rest (2 sigma), µm")  # fmt: skip
        for ruler in (panel.xaxis, panel.yaxis):
            style.plain_log(ruler)
        panel.legend()
    return drawing
